//! Writes depth and instance images of a visit, and a plan of the room, and measures the time per
//! frame.
//!
//! `cargo run --release -p room-synth --example render -- OUT [room 0] [seed 1] [split train] [step 30]`

#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "an example prints and measures")]

use nalgebra::Point3;
use room_synth::{PHONE, SensorParams, Split, World, WorldParams};
use scan3r::{Dataset as _, Frame};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default: usize| args.get(k).map_or(Ok(default), |a| a.parse());
    let out = args.first().map_or("/tmp/room-synth", String::as_str);
    let (room, seed, step) = (number(1, 0)?, number(2, 1)? as u64, number(4, 30)?);
    let split = Split::parse(args.get(3).map_or("train", String::as_str))
        .ok_or("split is train, validation or test")?;
    std::fs::create_dir_all(out)?;
    let world = World::new(split, seed, room + 1, &WorldParams::default());
    let (scan, kind) = (&world.generated()[room].scans[0], world.generated()[room].kind);
    println!("{kind}: {} instances", scan.instances.len());
    for i in &scan.instances {
        let b = scan.oriented_box(i);
        println!(
            "{:>3} {:<16} {:.2?} at {:.2?} on {:?}",
            i.id,
            i.label,
            i.size(),
            b.pose.translation.vector.as_slice(),
            i.supports
        );
    }
    let start = Instant::now();
    let frames: Vec<Frame> = world.frames(&scan.id, 0)?.collect::<Result<_, _>>()?;
    println!(
        "{} frames, {:.3} ms each",
        frames.len(),
        1000.0 * start.elapsed().as_secs_f64() / frames.len() as f64
    );
    let clean = WorldParams { sensor: SensorParams::clean(), ..WorldParams::default() };
    let bare = World::new(split, seed, room + 1, &clean);
    let start = Instant::now();
    let n = bare.frames(&scan.id, 0)?.count();
    println!("{:.3} ms each without a sensor", 1000.0 * start.elapsed().as_secs_f64() / n as f64);
    let start = Instant::now();
    let annotation = world.annotation(&scan.id)?;
    println!(
        "{} annotated points in {:.1} ms",
        annotation.points.len(),
        1000.0 * start.elapsed().as_secs_f64()
    );
    let mut sheet = Sheet::new(8, 4);
    for (k, (frame, ids)) in world.labelled_frames(&scan.id, 0)?.enumerate() {
        if k % step == 0 && k / step < 16 {
            sheet.paste(2 * (k / step), |u, v| depth_colour(frame.depth[v * 224 + u]));
            sheet.paste(2 * (k / step) + 1, |u, v| id_colour(ids[v * 224 + u]));
        }
    }
    sheet.write(&Path::new(out).join(format!("frames-{room}.png")))?;
    plan(&annotation, &frames, &Path::new(out).join(format!("plan-{room}.png")))
}

/// Seen from above and from one side: the annotated points, and the camera's way in white.
fn plan(a: &scan3r::Annotation, frames: &[Frame], path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let (w, h) = (1400_usize, 700_usize);
    let mut rgb = vec![20_u8; w * h * 3];
    let lo = a.points.iter().fold(Point3::new(f32::MAX, f32::MAX, f32::MAX), |m, p| m.inf(p));
    let hi = a.points.iter().fold(Point3::new(f32::MIN, f32::MIN, f32::MIN), |m, p| m.sup(p));
    let scale = 680.0 / (hi - lo).xy().max();
    let ceiling: Vec<u32> = a.labels.iter().filter(|(_, l)| *l == "ceiling").map(|(k, _)| *k).collect();
    let mut order: Vec<usize> = (0..a.points.len()).filter(|&k| !ceiling.contains(&a.instances[k])).collect();
    order.sort_by(|&p, &q| a.points[p].z.total_cmp(&a.points[q].z));
    let mut dot = |x: f32, y: f32, size: usize, c: [u8; 3]| {
        for (dx, dy) in (0..size * size).map(|k| (k % size, k / size)) {
            let (x, y) = (x as usize + dx, y as usize + dy);
            if x < w && y < h {
                rgb[3 * (y * w + x)..3 * (y * w + x) + 3].copy_from_slice(&c);
            }
        }
    };
    let shade = |k: usize| {
        id_colour(a.instances[k])
            .map(|c| (f32::from(c) * (0.4 + 0.6 * (a.points[k].z - lo.z) / (hi.z - lo.z))) as u8)
    };
    for &k in &order {
        dot((a.points[k].x - lo.x) * scale, (a.points[k].y - lo.y) * scale, 3, shade(k));
    }
    for f in frames.iter().filter_map(|f| f.world_from_camera) {
        dot((f.translation.x - lo.x) * scale, (f.translation.y - lo.y) * scale, 3, [255; 3]);
    }
    order.sort_by(|&p, &q| a.points[p].y.total_cmp(&a.points[q].y));
    for &k in &order {
        dot(700.0 + (a.points[k].x - lo.x) * scale, 690.0 - (a.points[k].z - lo.z) * scale, 3, shade(k));
    }
    write_png(path, w as u32, h as u32, &rgb)
}

struct Sheet {
    columns: usize,
    width: usize,
    rgb: Vec<u8>,
}

impl Sheet {
    /// A sheet of upright images (turned by 90 degrees).
    fn new(columns: usize, rows: usize) -> Self {
        let (width, height) = (columns * 176, rows * 228);
        Self { columns, width, rgb: vec![255; width * height * 3] }
    }

    fn paste(&mut self, place: usize, colour: impl Fn(usize, usize) -> [u8; 3]) {
        let (x0, y0) = (place % self.columns * 176, place / self.columns * 228);
        for v in 0..PHONE.height as usize {
            for u in 0..PHONE.width as usize {
                let at = 3 * ((y0 + u) * self.width + x0 + 171 - v);
                self.rgb[at..at + 3].copy_from_slice(&colour(u, v));
            }
        }
    }

    fn write(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        write_png(path, self.width as u32, (self.rgb.len() / 3 / self.width) as u32, &self.rgb)
    }
}

fn depth_colour(d: f32) -> [u8; 3] {
    if d <= 0.0 { [120, 0, 0] } else { [(255.0 * (1.0 - d / 5.0)).clamp(0.0, 255.0) as u8; 3] }
}

fn id_colour(id: u32) -> [u8; 3] {
    if id == 0 {
        return [0; 3];
    }
    let h = id.wrapping_mul(0x9e37_79b1);
    [60 + (h >> 24) as u8 % 190, 60 + (h >> 16) as u8 % 190, 60 + (h >> 8) as u8 % 190]
}

fn write_png(path: &Path, w: u32, h: u32, rgb: &[u8]) -> Result<(), Box<dyn std::error::Error>> {
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(std::fs::File::create(path)?), w, h);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(rgb)?;
    println!("{}", path.display());
    Ok(())
}
