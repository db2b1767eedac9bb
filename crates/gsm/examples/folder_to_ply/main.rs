//! Segments a folder of posed depth images (7-Scenes or TUM RGB-D) and writes the stable surfels as a labelled PLY in
//! the recording's frame.
//!
//! `cargo run --release -p ma3dsg-gsm --example folder_to_ply -- DIR OUT.ply [options]`
//! options: `--pixels N` (working pixels), `--noise structured|tof|ideal`, `--reverse`, `--passes N`,
//! `--turn SEED` (poses pre-multiplied by a random rigid transform), `--threads N` (default 1), `--batch N` (frames handed over at once), `--coverage` (share of voxels hit), `--set FIELD=VALUE`.
//! Times are CPU of all threads, and wall.
#![allow(clippy::print_stdout, reason = "a command-line example")]

mod recording;

use gsm::{DepthView, Intrinsics, Map, NoiseModel, Params, Profile, estimate_up};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use recording::{Frame, Recording};
use std::error::Error;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let options = Options::parse()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    Ok(pool.install(|| run(&options).map_err(|e| e.to_string()))?)
}

fn run(options: &Options) -> Result<()> {
    let recording = Recording::read(&options.folder, options.reverse, options.last)?;
    let intrinsics = recording.intrinsics;
    let mut map = Map::new(options.params.clone())?;
    let mut clock = Clock::default();
    let world = options.turn.map(random_pose).unwrap_or_else(Isometry3::identity);
    let (mut skipped, mut events) = (0, 0);
    if recording.unposed > 0 {
        println!("{} images have no pose within 0.02 s and are left out", recording.unposed);
    }
    let mut frames = recording.frames;
    frames.iter_mut().for_each(|f| f.world_from_camera = world * f.world_from_camera);
    let views: Vec<_> = frames
        .iter()
        .map(|f| DepthView {
            depth: &f.depth,
            intrinsics,
            world_from_camera: f.world_from_camera,
            time: f.time,
        })
        .collect();
    for pass in 0..options.passes {
        let (mut total, mut wall) = (Vec::new(), Vec::new());
        for (n, batch) in views.chunks(options.batch).enumerate() {
            let (start, begun) = (cpu_ms(), now());
            clock.last = start;
            let reports = if let [one] = batch {
                vec![map.integrate_observed(one, |stage| clock.stop(stage as usize))]
            } else {
                map.integrate_all(batch)
            };
            total.push((cpu_ms() - start) / batch.len() as f64);
            wall.push(begun.elapsed().as_secs_f64() * 1e3 / batch.len() as f64);
            for (i, report) in reports.iter().enumerate() {
                skipped += usize::from(report.skipped.is_some());
                events += report.events.len();
                if options.verbose {
                    println!("{} {:?} {:?}", n * options.batch + i, report.counts, report.events);
                }
            }
        }
        total.sort_by(f64::total_cmp);
        wall.sort_by(f64::total_cmp);
        println!(
            "pass {pass}: {} frames ({skipped} skipped), median {:.2} ms, p95 {:.2} ms CPU; median {:.2} ms wall",
            frames.len(),
            total[total.len() / 2],
            total[total.len() * 95 / 100],
            wall[wall.len() / 2]
        );
    }
    if options.batch == 1 {
        clock.print(frames.len() * options.passes);
    }
    let surfels = map.surfels().count();
    if let Some(file) = &options.frame {
        write_frame(file, &map)?;
    }
    println!(
        "{surfels} surfels, {} segments, {events} events, {:.1} bytes per surfel, {} cells looked at, up {:?}",
        map.segments().count(),
        map.bytes() as f64 / surfels.max(1) as f64,
        map.visibility().cells().len(),
        estimate_up(&map).map(|u| (world.rotation.inverse() * u).data.0)
    );
    if options.coverage {
        for Coverage { frames, hit, centre, disc, near } in coverage(&frames, intrinsics, &map) {
            let share = |n: usize| 100.0 * n as f64 / hit.max(1) as f64;
            println!(
                "{hit} voxels of 2 cm hit by two or more valid depths in {frames} or more frames: a surfel's centre in \
                 {:.1} %, some of its disc in {:.1} %, in it or a neighbour in {:.1} %",
                share(centre),
                share(disc),
                share(near)
            );
        }
    }
    write_ply(&options.out, &map, &world.inverse())
}

/// Voxels of 2 cm that two or more valid depths hit in so many frames, and those of them that hold the centre of a
/// stable surfel, a part of its disc, or such a part there or in the 26 around.
struct Coverage {
    frames: usize,
    hit: usize,
    centre: usize,
    disc: usize,
    near: usize,
}

/// Points of a disc, 5 mm apart.
fn disc(s: gsm::Surfel) -> impl Iterator<Item = Point3<f32>> {
    let (position, radius) = (s.position, s.radius);
    let a = s.normal.cross(&Vector3::ith(s.normal.iamin(), 1.0)).normalize();
    let b = s.normal.cross(&a);
    let steps = (radius / 0.005) as i32;
    (-steps..=steps)
        .flat_map(move |i| (-steps..=steps).map(move |j| (i as f32 * 0.005, j as f32 * 0.005)))
        .filter(move |(u, v)| u * u + v * v <= radius * radius)
        .map(move |(u, v)| position + a * u + b * v)
}

fn coverage(frames: &[Frame], k: Intrinsics, map: &Map) -> [Coverage; 3] {
    let (near, far) = (map.params().min_depth, map.params().max_depth);
    let key = |p: Point3<f32>| [p.x, p.y, p.z].map(|v| (v / 0.02).floor() as i16);
    let mut hit: Vec<[i16; 3]> = Vec::new();
    let mut all: Vec<[i16; 3]> = Vec::new();
    for Frame { depth, world_from_camera: pose, .. } in frames {
        for (i, &z) in depth.iter().enumerate().filter(|(_, z)| **z >= near && **z <= far) {
            let (x, y) = ((i % k.width() as usize) as f32, (i / k.width() as usize) as f32);
            hit.push(key(pose * Point3::new((x - k.cx()) / k.fx() * z, (y - k.cy()) / k.fy() * z, z)));
        }
        hit.sort_unstable();
        all.extend(hit.chunk_by(|a, b| a == b).filter(|run| run.len() > 1).map(|run| run[0]));
        hit.clear();
    }
    all.sort_unstable();
    let voxels = |points: &mut dyn Iterator<Item = Point3<f32>>| {
        let mut held: Vec<[i16; 3]> = points.map(key).collect();
        held.sort_unstable();
        held.dedup();
        held
    };
    let centres = voxels(&mut map.surfels().filter(|s| s.stable).map(|s| s.position));
    let discs = voxels(&mut map.surfels().filter(|s| s.stable).flat_map(disc));
    let holds = |held: &[[i16; 3]], k: [i16; 3]| held.binary_search(&k).is_ok();
    let about =
        |k: [i16; 3]| (0..27).map(move |i| [k[0] + i / 9 - 1, k[1] + i / 3 % 3 - 1, k[2] + i % 3 - 1]);
    [1, 3, 9].map(|frames| {
        let hit: Vec<[i16; 3]> =
            all.chunk_by(|a, b| a == b).filter(|run| run.len() >= frames).map(|run| run[0]).collect();
        let count = |test: &dyn Fn([i16; 3]) -> bool| hit.iter().filter(|k| test(**k)).count();
        Coverage {
            frames,
            hit: hit.len(),
            centre: count(&|k| holds(&centres, k)),
            disc: count(&|k| holds(&discs, k)),
            near: count(&|k| about(k).any(|k| holds(&discs, k))),
        }
    })
}

struct Options {
    folder: PathBuf,
    out: PathBuf,
    params: Params,
    reverse: bool,
    turn: Option<u64>,
    passes: usize,
    threads: usize,
    batch: usize,
    coverage: bool,
    verbose: bool,
    frame: Option<PathBuf>,
    last: usize,
}

impl Options {
    fn parse() -> Result<Self> {
        let mut args = std::env::args().skip(1);
        let usage =
            "folder_to_ply DIR OUT.ply [--pixels N] [--noise P] [--reverse] [--passes N] [--turn SEED]";
        let folder = args.next().ok_or(usage)?.into();
        let out = args.next().ok_or(usage)?.into();
        let params = Params::default();
        let mut o = Self {
            folder,
            out,
            params,
            reverse: false,
            turn: None,
            passes: 1,
            threads: 1,
            batch: 1,
            coverage: false,
            verbose: false,
            frame: None,
            last: usize::MAX,
        };
        while let Some(flag) = args.next() {
            match flag.as_str() {
                "--reverse" => o.reverse = true,
                "--frame" => o.frame = Some(args.next().ok_or(usage)?.into()),
                "--last" => o.last = args.next().ok_or(usage)?.parse()?,
                "--verbose" => o.verbose = true,
                "--pixels" => o.params.max_pixels = args.next().ok_or(usage)?.parse()?,
                "--turn" => o.turn = Some(args.next().ok_or(usage)?.parse()?),
                "--passes" => o.passes = args.next().ok_or(usage)?.parse()?,
                "--coverage" => o.coverage = true,
                "--batch" => o.batch = args.next().ok_or(usage)?.parse::<usize>()?.max(1),
                "--threads" => o.threads = args.next().ok_or(usage)?.parse()?,
                "--noise" => {
                    o.params.noise = NoiseModel::of(match args.next().ok_or(usage)?.as_str() {
                        "structured" => Profile::Structured,
                        "tof" => Profile::TofPhone,
                        "ideal" => Profile::Ideal,
                        _ => return Err(usage.into()),
                    })
                }
                "--set" => {
                    let pair = args.next().ok_or(usage)?;
                    let (field, value) = pair.split_once('=').ok_or(usage)?;
                    set(&mut o.params, field, value.parse()?)?;
                }
                _ => return Err(usage.into()),
            }
        }
        Ok(o)
    }
}

fn set(p: &mut Params, field: &str, v: f32) -> Result<()> {
    match field {
        "noise_scale" => p.noise.scale = v,
        "normal_error" => p.normal_error = v,
        "concave_angle" => p.concave_angle = v,
        "step_sigmas" => p.step_sigmas = v,
        "min_region_pixels" => p.min_region_pixels = v as u32,
        "gate_sigmas" => p.gate_sigmas = v,
        "pose_error" => p.pose_error = v,
        "gate_normal_cos" => p.gate_normal_cos = v,
        "take_share" => p.take_share = v,
        "merge_share" => p.merge_share = v,
        "merge_border" => p.merge_border = v,
        "max_depth" => p.max_depth = v,
        "max_samples" => p.max_samples = v as u32,
        "min_spacing" => p.min_spacing = v,
        "brick" => p.brick = v,
        _ => return Err(format!("no parameter {field}").into()),
    }
    Ok(())
}

/// The last frame's segments in colours of their ids, edges dark, as a portable pixmap.
fn write_frame(path: &Path, map: &Map) -> Result<()> {
    let (width, mut segments) = map.frame_segments();
    if path.to_string_lossy().contains("region") {
        segments = map.frame_regions().1.iter().map(|&r| (r != 0).then_some(gsm::SegmentId(r))).collect();
    }
    let (_, edges) = map.frame_edges();
    let mut out = BufWriter::new(fs::File::create(path)?);
    writeln!(out, "P6 {width} {} 255", segments.len() / width.max(1))?;
    for (s, edge) in segments.iter().zip(edges) {
        let h = s.map_or(0, |id| id.0.wrapping_mul(2_654_435_761) | 0x0040_4040);
        let dim = |v: u32| (v & 255) as u8 / if edge { 2 } else { 1 };
        out.write_all(&[dim(h >> 24), dim(h >> 16), dim(h >> 8)])?;
    }
    Ok(out.flush()?)
}

/// CPU milliseconds per stage.
#[derive(Default)]
struct Clock {
    last: f64,
    stages: [f64; 16],
}

impl Clock {
    fn stop(&mut self, stage: usize) {
        let now = cpu_ms();
        self.stages[stage] += now - self.last;
        self.last = now;
    }

    fn print(&self, frames: usize) {
        let names = [
            "shrink",
            "look",
            "predict",
            "links",
            "normals",
            "edges",
            "regions",
            "samples",
            "associate",
            "vote",
            "fuse",
            "merge",
        ];
        let n = frames.max(1) as f64;
        let line: Vec<_> = names.iter().zip(self.stages).map(|(s, t)| format!("{s} {:.3}", t / n)).collect();
        println!("mean ms: {}", line.join(", "));
    }
}

#[allow(clippy::disallowed_methods, reason = "an example times")]
fn now() -> std::time::Instant {
    std::time::Instant::now()
}

#[allow(unsafe_code, reason = "the process's CPU clock has no safe binding in std")]
fn cpu_ms() -> f64 {
    let mut t = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `t` outlives the call, which writes nothing else.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &raw mut t) };
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

fn random_pose(seed: u64) -> Isometry3<f32> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut draw = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / 16_777_216.0 - 0.5
    };
    let axis = Vector3::new(draw(), draw(), draw()).normalize() * (draw() * 6.0);
    let shift = Vector3::new(draw(), draw(), draw()) * 10.0;
    Isometry3::from_parts(shift.into(), UnitQuaternion::from_scaled_axis(axis))
}

fn write_ply(path: &Path, map: &Map, recording_from_world: &Isometry3<f32>) -> Result<()> {
    let stable: Vec<_> = map.surfels().filter(|s| s.stable).collect();
    let mut out = BufWriter::new(fs::File::create(path)?);
    write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", stable.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property float {name}")?;
    }
    write!(out, "property int label\nproperty int instance\nend_header\n")?;
    for s in stable {
        let p = recording_from_world * s.position;
        let n = recording_from_world * s.normal;
        for v in [p.x, p.y, p.z, n.x, n.y, n.z] {
            out.write_all(&v.to_le_bytes())?;
        }
        let label = s.segment.map_or(0, |id| id.0 as i32);
        out.write_all(&label.to_le_bytes())?;
        out.write_all(&label.to_le_bytes())?;
    }
    Ok(out.flush()?)
}
