//! What decoding a frame asks of memory: `cargo run -r -p benches --bin wire_memory -- FILE.bin`, FILE.bin under `wire/`
//! of a bench run. Beside its frames, two that are made to ask for much: equal nodes, and a clique of edges.

#![allow(clippy::print_stdout, reason = "a program speaks")]

use graph_align::{
    Box3, Edge, Error, Key, LabelId, Node, NodeId, Observation, PredicateId, SceneGraph, Vocabulary, wire,
};
use peak_alloc::PeakAlloc;
use scan3r::LabelSet;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Bytes at the peak of decoding beyond those before it, and those that the observation holds.
fn decode(frame: &[u8], names: &Vocabulary) -> Result<(usize, usize), Error> {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let o = wire::decode(frame, names)?;
    let (peak, held) = (MEMORY.peak_usage() - before, MEMORY.current_usage() - before);
    drop(o);
    Ok((peak, held))
}

fn made(graph: SceneGraph, names: &Vocabulary) -> Result<Vec<u8>, Error> {
    let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: 0 };
    wire::encode(&Observation { key, end_ds: 0, frame: 0, graph, looked: None }, names)
}

fn nodes(n: u64) -> Result<SceneGraph, Error> {
    let mut g = SceneGraph::default();
    for k in 0..n {
        g.insert_node(Node::new(NodeId(k), LabelId(0), Box3::new([0.0; 3], [1.0; 3])?));
    }
    Ok(g)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("want FILE.bin")?;
    let set = LabelSet::L20;
    let names =
        Vocabulary::new(set.classes().iter().copied().chain(["none"]), set.predicates().iter().copied())?;
    let file = std::fs::read(path)?;
    let (mut bytes, mut peaks, mut holds, mut worst) = (0, 0, 0, 0.0_f64);
    for frame in wire::split(&file)? {
        let (peak, held) = decode(frame, &names)?;
        bytes += frame.len();
        peaks += peak;
        holds += held;
        worst = worst.max(peak as f64 / frame.len() as f64);
    }
    let ratio = |a: usize, b: usize| a as f64 / b as f64;
    println!(
        "frames of the file: {bytes} bytes, peak {:.1} times, held {:.1} times, worst peak {worst:.1} times",
        ratio(peaks, bytes),
        ratio(holds, bytes)
    );
    let mut clique = nodes(150)?;
    for (s, t) in (0..150).flat_map(|s| (0..150).map(move |t| (s, t))).filter(|(s, t)| s != t) {
        clique.insert_edge(Edge { s: NodeId(s), t: NodeId(t), p: PredicateId(0), score: 1.0 })?;
    }
    for (name, graph) in [("2,000 equal nodes", nodes(2_000)?), ("150 nodes, all related alike", clique)] {
        let frame = made(graph, &names)?;
        let (peak, held) = decode(&frame, &names)?;
        println!(
            "{name}: {} bytes, peak {:.1} times, held {:.1} times",
            frame.len(),
            ratio(peak, frame.len()),
            ratio(held, frame.len())
        );
    }
    Ok(())
}
