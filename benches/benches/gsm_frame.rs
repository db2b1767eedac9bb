//! One frame into the surfel map of an analytic room: on one thread also stage by stage, with the bytes that each must
//! touch beside a copy of as many bytes in the same run; at 640×480 on one thread and on two.

#![allow(clippy::disallowed_methods, reason = "a bench times")]

use criterion::{Criterion, Throughput};
use gsm::{Counts, DepthView, Intrinsics, Map, NoiseModel, Params, Profile, Stage};
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

/// Names of the stages, in order, and the bytes that each must touch per working pixel (p), per sample (s) and per
/// visited surfel (v): what it reads and writes once, whatever the way it is computed.
const STAGES: [(&str, [f64; 3]); 12] = [
    // Depth in, z, inverse, slack and window out.
    ("shrink", [4.0 + 18.0, 0.0, 0.0]),
    ("look", [0.0; 3]),
    ("predict", [0.0; 3]),
    ("links", [4.0 + 4.0 + 1.0, 0.0, 0.0]),
    // Links, windows and inverse in; plane, depth and cosine out.
    ("normals", [1.0 + 1.0 + 4.0 + 20.0, 0.0, 0.0]),
    ("edges", [16.0 + 5.0 + 4.0 + 1.0, 0.0, 0.0]),
    ("regions", [1.0 + 1.0 + 4.0, 0.0, 0.0]),
    ("samples", [0.0, 32.0 + 32.0, 0.0]),
    // Hot halves in and out, a sample and a hit each.
    ("associate", [0.0, 32.0 + 12.0, 40.0 + 40.0]),
    ("vote", [0.0, 12.0 + 32.0 + 8.0, 0.0]),
    ("fuse", [0.0, 12.0 + 32.0, 12.0]),
    ("merge", [0.0; 3]),
];

/// Nanoseconds per byte of copying a block of this size: what touching the memory alone costs, in this run.
fn copy_ns_per_byte(bytes: usize) -> f64 {
    let (from, mut to) = (vec![1u8; bytes.max(4096)], vec![0u8; bytes.max(4096)]);
    let mut times: Vec<f64> = (0..40)
        .map(|_| {
            let start = std::time::Instant::now();
            to.copy_from_slice(black_box(&from));
            black_box(&mut to);
            start.elapsed().as_secs_f64() * 1e9 / (2 * from.len()) as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Prints per stage the median time, the bytes that must be touched, what a copy of as many bytes takes, and the
/// ratio of the two.
fn stages(name: &str, step: &mut impl FnMut(&mut dyn FnMut(Stage)) -> Counts) {
    let mut times: Vec<[f64; STAGES.len()]> = Vec::new();
    let mut counts = Counts::default();
    for _ in 0..FRAMES {
        let mut row = [0.0; STAGES.len()];
        let mut last = std::time::Instant::now();
        counts = step(&mut |stage| {
            row[stage as usize] += last.elapsed().as_secs_f64() * 1e6;
            last = std::time::Instant::now();
        });
        times.push(row);
    }
    let pixels = f64::from(counts.working_size.0) * f64::from(counts.working_size.1);
    let amounts = [pixels, f64::from(counts.samples), f64::from(counts.visited)];
    eprintln!("{name}: stage, median microseconds, bytes, a copy's microseconds, ratio");
    let (mut all, mut floor) = (0.0, 0.0);
    for (k, (stage, per)) in STAGES.iter().enumerate() {
        let mut column: Vec<f64> = times.iter().map(|r| r[k]).collect();
        column.sort_by(f64::total_cmp);
        let (time, bytes) =
            (column[column.len() / 2], per.iter().zip(amounts).map(|(a, b)| a * b).sum::<f64>());
        // A copy reads one half and writes the other.
        let copy = copy_ns_per_byte(bytes as usize / 2) * bytes * 1e-3;
        (all, floor) = (all + time, floor + copy);
        let ratio = if bytes > 0.0 { format!("{:.1}", time / copy) } else { "-".into() };
        eprintln!("  {stage:<10} {time:>8.1} {bytes:>10.0} {copy:>8.1} {ratio:>6}");
    }
    eprintln!("  {:<10} {all:>8.1} {:>10} {floor:>8.1} {:>6.1}", "all", "", all / floor);
}

fn frames(c: &mut Criterion, (width, height): (u32, u32), noise: NoiseModel, threads: usize) -> Result<()> {
    let (w, h) = (width as f32, height as f32);
    let k = Intrinsics::new(0.7 * w, 0.7 * w, (w - 1.0) / 2.0, (h - 1.0) / 2.0, width, height)?;
    let images: Vec<Vec<f32>> = (0..FRAMES).map(|i| render(&k, &pose(i))).collect();
    // Worked at full size: the default would halve the larger image.
    let mut map = Map::new(Params { noise, max_pixels: width * height, ..Params::default() })?;
    let mut next = 0;
    let mut step = |done: &mut dyn FnMut(Stage)| {
        let i = next % FRAMES;
        let view = DepthView {
            depth: &images[i],
            intrinsics: k,
            world_from_camera: pose(i),
            time: 0.2 * next as f64,
        };
        next += 1;
        map.integrate_observed(&view, done).counts
    };
    // Two turns fill the map; what is measured is a frame of a room that is known.
    let filled = (0..2 * FRAMES).map(|_| step(&mut |_| ())).last().unwrap_or_default();
    let name = format!("gsm {width}x{height}, {threads} threads");
    eprintln!(
        "{name}: working size {:?}, {} samples, {} surfels, {} segments before the first measured frame",
        filled.working_size, filled.samples, filled.surfels, filled.segments
    );
    if threads == 1 {
        stages(&name, &mut step);
    }
    let mut g = c.benchmark_group(name);
    g.throughput(Throughput::Bytes(4 * u64::from(width * height)));
    g.bench_function("integrate", |b| b.iter(|| step(&mut |_| ())));
    g.finish();
    Ok(())
}

fn run(threads: usize) -> Result<()> {
    let mut c = Criterion::default().configure_from_args();
    let ideal = NoiseModel::of(Profile::Ideal);
    if threads == 1 {
        frames(&mut c, (160, 120), ideal, threads)?;
        frames(&mut c, (224, 172), NoiseModel::of(Profile::TofPhone), threads)?;
        frames(&mut c, (320, 240), ideal, threads)?;
    }
    frames(&mut c, (640, 480), ideal, threads)?;
    c.final_summary();
    Ok(())
}

fn main() -> Result<()> {
    for threads in [1, 2] {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| run(threads))?;
    }
    Ok(())
}
