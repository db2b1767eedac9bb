//! What decoding asks of memory: at most eight times the frame, whatever its bytes. Alone in its program, whose
//! allocator counts.

#![cfg(feature = "wire")]
#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "common/building.rs"]
mod building;
mod common;

use building::{building, frame, with_evidence, with_footprints};
use common::{graph, looked, vocabulary};
use graph_align::{
    Box3, Edge, Footprint, LabelId, Looked, Node, NodeId, PredicateId, SceneGraph, Vocabulary, wire,
};
use peak_alloc::PeakAlloc;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What the text of an error may take.
const TEXT: usize = 256;

/// Bytes at the peak of decoding, and whether it is a frame.
fn peak(frame: &[u8], v: &Vocabulary) -> (usize, bool) {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let ok = wire::decode(frame, v).is_ok();
    (MEMORY.peak_usage() - before, ok)
}

/// Equal nodes, some with equal footprints, every one related to the next `related` in the same way: what a frame says in
/// the fewest bytes.
fn alike(nodes: u64, footprints: u64, related: u64) -> SceneGraph {
    let mut g = SceneGraph::default();
    for k in 0..nodes {
        let mut b = Box3::new([0.0; 3], [1.0; 3]).expect("finite");
        if k < footprints {
            b = b.with_footprint(Footprint::rectangle([1.0, 1.0], 0.0)).expect("a square");
        }
        g.insert_node(Node::new(NodeId(k), LabelId(0), b));
    }
    for (s, step) in (0..nodes).flat_map(|s| (1..=related).map(move |k| (s, k))) {
        let e = Edge { s: NodeId(s), t: NodeId((s + step) % nodes), p: PredicateId(0), score: 1.0 };
        g.insert_edge(e).expect("fewer related than nodes");
    }
    g
}

#[test]
fn eight_times_the_frame() {
    let v = vocabulary();
    for (nodes, footprints, related) in [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (64, 64, 1),
        (65, 1, 0),
        (2_000, 0, 0),
        (999, 998, 3),
        (150, 0, 149),
    ] {
        let bytes = wire::encode(&frame(alike(nodes, footprints, related), None), &v).expect("small");
        let (peak, ok) = peak(&bytes, &v);
        assert!(ok && peak <= 8 * bytes.len(), "{peak} bytes for {nodes} nodes in {}", bytes.len());
    }
    // A box of cells of which one is seen at either end.
    let far = Looked::new(0.5, [0.0; 3], &[[0; 3], [150, 150, 150]]).expect("small");
    let bytes = wire::encode(&frame(alike(300, 0, 2), Some(far)), &v).expect("small");
    assert!(peak(&bytes, &v).0 <= 8 * bytes.len());

    for (rooms, nodes, edges, names) in
        [(1, 30, 100, (20, 8)), (47, 766, 2_600, (20, 8)), (47, 1_588, 5_546, (160, 26))]
    {
        let (g, v) = building(rooms, nodes, edges, names, 5);
        let (full, looked) = with_evidence(&g, rooms, 6);
        let all = [frame(g, None), frame(full.clone(), Some(looked)), frame(with_footprints(&full, 7), None)];
        let ratios = all.map(|o| {
            let bytes = wire::encode(&o, &v).expect("small");
            peak(&bytes, &v).0 as f64 / bytes.len() as f64
        });
        println!("{nodes} nodes, {edges} edges: {ratios:.1?} times, plain, with evidence, with footprints");
        assert!(ratios.iter().all(|r| *r <= 8.0), "{ratios:?}");
    }

    // Any frame, whole, changed or cut off.
    let damage = (any::<prop::sample::Index>(), 1..=255_u8, any::<prop::sample::Index>());
    let case = (graph(100), prop::option::of(looked()), prop::collection::vec(damage, 20));
    let read = std::cell::Cell::new(0);
    let tried = TestRunner::new(common::cases(256)).run(&case, |(g, looked, damage)| {
        let bytes = wire::encode(&frame(g, looked), &v).expect("small");
        prop_assert!(peak(&bytes, &v).0 <= 8 * bytes.len());
        for (at, flip, cut) in damage {
            let mut bytes = bytes.clone();
            let at = at.index(bytes.len());
            bytes[at] ^= flip;
            for end in [bytes.len(), cut.index(bytes.len())] {
                let (peak, ok) = peak(&bytes[..end], &v);
                prop_assert!(peak <= 8 * end + TEXT, "{peak} bytes for {end}");
                read.set(read.get() + usize::from(ok));
            }
        }
        Ok(())
    });
    tried.expect("at most eight times the frame");
    println!("{} of {} damaged frames are frames all the same", read.get(), 2 * 20 * 256);
}
