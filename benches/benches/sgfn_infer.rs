//! The shipped network on 32 segments of 256 points, on one thread.

use benches::building::Dice;
use criterion::{Criterion, Throughput};
use sgfn_infer::{Graph, Model, Segment};
use std::hint::black_box;

const WEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/weights/sgfn-l20.safetensors");
const NODES: usize = 32;
const EDGES: usize = 200;
const POINTS: usize = 256;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Points on a box of random place and size; channels beyond xyz hold a unit vector each three.
fn segment(d: &mut Dice, channels: usize) -> Result<Segment> {
    let (centre, side) =
        ([0, 1, 2].map(|_| d.within(-3.0, 3.0) as f32), [0, 1, 2].map(|_| d.within(0.1, 1.5) as f32));
    let mut points = Vec::with_capacity(POINTS * channels);
    for _ in 0..POINTS {
        let face = d.below(3);
        let mut p = [0, 1, 2].map(|k| centre[k] + side[k] * d.within(-0.5, 0.5) as f32);
        p[face] = centre[face] + side[face] / 2.0;
        points.extend(p);
        points.extend((3..channels).map(|k| if k % 3 == face { 1.0 } else { 0.0 }));
    }
    Ok(Segment::new(&points, channels)?)
}

fn run() -> Result<()> {
    let model = Model::from_safetensors(&std::fs::read(WEIGHTS)?)?;
    let mut d = Dice::new(3);
    let channels = model.config().channels;
    let segments = (0..NODES).map(|_| segment(&mut d, channels)).collect::<Result<Vec<_>>>()?;
    let mut edges = Vec::new();
    while edges.len() < EDGES {
        let e = [d.below(NODES), d.below(NODES)];
        if e[0] != e[1] && !edges.contains(&e) {
            edges.push(e);
        }
    }
    let features = model.encode(&segments)?;
    let graph = Graph { segments: &segments, edges: &edges };

    let mut c = Criterion::default().configure_from_args();
    let mut g = c.benchmark_group("sgfn_infer");
    g.throughput(Throughput::Elements(NODES as u64));
    g.bench_function("encode 32 segments of 256 points", |b| b.iter(|| model.encode(black_box(&segments))));
    g.bench_function("attention and heads, 32 nodes, 200 edges", |b| {
        b.iter(|| model.infer_features(black_box(&features), &edges));
    });
    g.bench_function("whole inference, 32 nodes, 200 edges", |b| b.iter(|| model.infer(black_box(&graph))));
    g.finish();
    c.final_summary();
    Ok(())
}

fn main() -> Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(run)
}
