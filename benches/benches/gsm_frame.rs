//! One frame into the surfel map of an analytic room, beside a copy of the frame's bytes. One thread.

use criterion::{Criterion, Throughput};
use gsm::{DepthView, Intrinsics, Map, NoiseModel, Params, Profile};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::hint::black_box;

const FRAMES: usize = 60;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;
/// An axis-aligned box by its corners, metres, z up.
type Block = ([f32; 3], [f32; 3]);

/// Seen from within.
const ROOM: Block = ([0.0, 0.0, 0.0], [5.0, 4.0, 2.5]);
/// Seen from outside.
const THINGS: [Block; 6] = [
    ([0.0, 0.0, 0.0], [2.0, 1.6, 0.5]),
    ([3.8, 3.4, 0.0], [4.8, 4.0, 1.9]),
    ([4.2, 0.6, 0.0], [5.0, 2.2, 0.75]),
    ([3.6, 1.2, 0.0], [4.0, 1.6, 0.45]),
    ([0.4, 3.7, 0.9], [2.2, 4.0, 1.3]),
    ([1.2, 2.9, 0.0], [1.6, 3.3, 0.9]),
];

/// Ray parameters at which a line enters and leaves a box; no hit if the first is the larger one.
fn slab((lo, hi): Block, o: &Point3<f32>, d: &Vector3<f32>) -> (f32, f32) {
    (0..3).fold((f32::NEG_INFINITY, f32::INFINITY), |(near, far), k| {
        let (a, b) = ((lo[k] - o[k]) / d[k], (hi[k] - o[k]) / d[k]);
        (near.max(a.min(b)), far.min(a.max(b)))
    })
}

/// Poses on a small circle, looking outwards and 23 degrees down.
fn pose(i: usize) -> Isometry3<f32> {
    let (turn, down) = (i as f32 / FRAMES as f32 * std::f32::consts::TAU, 0.4_f32);
    let forward = Vector3::new(turn.cos() * down.cos(), turn.sin() * down.cos(), -down.sin());
    let right = Vector3::new(turn.sin(), -turn.cos(), 0.0);
    let axes = Rotation3::from_basis_unchecked(&[right, forward.cross(&right), forward]);
    let at = Translation3::new(2.6 + 0.2 * turn.cos(), 2.2 + 0.2 * turn.sin(), 1.4);
    Isometry3::from_parts(at, UnitQuaternion::from_rotation_matrix(&axes))
}

/// Depth in whole millimetres.
fn render(k: &Intrinsics, pose: &Isometry3<f32>) -> Vec<f32> {
    let o = Point3::from(pose.translation.vector);
    let pixel = |i: u32| {
        let (u, v) = ((i % k.width()) as f32, (i / k.width()) as f32);
        let d = pose.rotation * Vector3::new((u - k.cx()) / k.fx(), (v - k.cy()) / k.fy(), 1.0);
        let hits = THINGS.iter().map(|b| slab(*b, &o, &d)).filter(|(near, far)| *near > 0.0 && near <= far);
        let z = hits.map(|h| h.0).fold(slab(ROOM, &o, &d).1, f32::min);
        (z * 1000.0).round() / 1000.0
    };
    (0..k.width() * k.height()).map(pixel).collect()
}

fn frames(c: &mut Criterion, width: u32, height: u32) -> Result<()> {
    let (w, h) = (width as f32, height as f32);
    let k = Intrinsics::new(0.7 * w, 0.7 * w, (w - 1.0) / 2.0, (h - 1.0) / 2.0, width, height)?;
    let images: Vec<Vec<f32>> = (0..FRAMES).map(|i| render(&k, &pose(i))).collect();
    let noise = NoiseModel::of(Profile::Ideal);
    // Worked at full size: the default would halve the larger image.
    let mut map = Map::new(Params { noise, max_pixels: width * height, ..Params::default() })?;
    let mut next = 0;
    let mut step = |map: &mut Map| {
        let i = next % FRAMES;
        let view = DepthView {
            depth: &images[i],
            intrinsics: k,
            world_from_camera: pose(i),
            time: 0.2 * next as f64,
        };
        next += 1;
        map.integrate(&view)
    };
    // Two turns fill the map; what is measured is a frame of a room that is known.
    let filled = (0..2 * FRAMES).map(|_| step(&mut map)).last().unwrap_or_default();
    eprintln!(
        "{width} x {height}: working size {:?}, {} surfels, {} segments before the first measured frame",
        filled.counts.working_size, filled.counts.surfels, filled.counts.segments
    );

    let mut g = c.benchmark_group(format!("gsm {width}x{height}"));
    g.throughput(Throughput::Bytes(4 * u64::from(width * height)));
    g.bench_function("integrate", |b| b.iter(|| step(&mut map)));
    let (mut to, mut from) = (vec![0.0_f32; images[0].len()], 0);
    g.bench_function("copy of the frame", |b| {
        b.iter(|| {
            to.copy_from_slice(black_box(&images[from % FRAMES]));
            from += 1;
            black_box(&mut to);
        });
    });
    g.finish();
    Ok(())
}

fn run() -> Result<()> {
    let mut c = Criterion::default().configure_from_args();
    frames(&mut c, 160, 120)?;
    frames(&mut c, 320, 240)?;
    c.final_summary();
    Ok(())
}

fn main() -> Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(run)
}
