//! Random scene graphs for property tests.

#![allow(dead_code, reason = "each test binary uses its share")]

use graph_align::{Box3, Edge, LabelId, Node, NodeId, PredicateId, SceneGraph, Vocabulary};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// The same `n` cases on every run, so that a failure is the change's and no draw of luck. To look
/// elsewhere: `PROPTEST_RNG_SEED=7 PROPTEST_CASES=1500`; what fails there is pinned as a test of its own.
pub(crate) fn cases(n: u32) -> ProptestConfig {
    let asked = ProptestConfig::default();
    let cases = if std::env::var_os("PROPTEST_CASES").is_some() { asked.cases } else { n };
    let rng_seed = match asked.rng_seed {
        RngSeed::Random => RngSeed::Fixed(1),
        fixed @ RngSeed::Fixed(_) => fixed,
    };
    ProptestConfig { cases, rng_seed, ..asked }
}

pub(crate) const LABELS: u16 = 6;
pub(crate) const PREDICATES: u16 = 3;

pub(crate) fn vocabulary() -> Vocabulary {
    let l: Vec<String> = (0..LABELS).map(|k| format!("label{k}")).collect();
    let p: Vec<String> = (0..PREDICATES).map(|k| format!("predicate{k}")).collect();
    Vocabulary::new(l.iter().map(String::as_str), p.iter().map(String::as_str)).expect("few names")
}

/// A graph with up to `n` nodes on distinct places and up to 3n edges.
pub(crate) fn graph(n: usize) -> impl Strategy<Value = SceneGraph> {
    let node = (
        0..LABELS,
        prop::array::uniform3(-500_i32..500),
        prop::array::uniform3(5_u16..200),
        0_u8..=127,
        1_u32..9,
        0_u32..5000,
        prop::collection::vec((0..LABELS, 0_u8..=127), 0..3),
        0_u32..4,
    );
    let edge = (any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0..PREDICATES, 0_u8..=127);
    (prop::collection::vec(node, 0..n), prop::collection::vec(edge, 0..3 * n)).prop_map(|(nodes, edges)| {
        let mut g = SceneGraph::default();
        let count = nodes.len();
        for (k, (label, c, e, score, sightings, seen, others, misses)) in nodes.into_iter().enumerate() {
            let bounds =
                Box3::new(c.map(|v| v as f32 / 100.0), e.map(|v| f32::from(v) / 100.0)).expect("finite");
            g.insert_node(Node {
                id: NodeId(k as u64 * 7 + 3),
                label: LabelId(label),
                score: f32::from(score) / 127.0,
                bounds: if k % 3 == 0 { bounds } else { footprint(bounds, k) },
                others: others.into_iter().map(|(l, s)| (LabelId(l), f32::from(s) / 127.0)).collect(),
                sightings,
                misses,
                last_seen: f64::from(seen) / 10.0,
            });
        }
        for (s, t, p, score) in edges {
            if count > 1 {
                let (s, t) = (NodeId(s.index(count) as u64 * 7 + 3), NodeId(t.index(count) as u64 * 7 + 3));
                if s != t {
                    let e = Edge { s, t, p: PredicateId(p), score: f32::from(score) / 127.0 };
                    g.insert_edge(e).expect("living ends");
                }
            }
        }
        g
    })
}

/// A box with a footprint of some shape, about some place in it.
fn footprint(b: Box3, k: usize) -> Box3 {
    let e = b.extent();
    let mut f = graph_align::Footprint::rectangle([e.x, e.y], (k * 137 % 1024) as f32 / 1023.0 * 1.57);
    for (i, r) in f.reach.iter_mut().enumerate() {
        *r *= 0.6 + 0.4 * ((k * 31 + i * 17) % 11) as f32 / 10.0;
    }
    b.with_footprint(f).expect("reaches of at least 0")
}

/// The same graph under other ids, its nodes in another order.
pub(crate) fn renamed(g: &SceneGraph, rename: impl Fn(NodeId) -> NodeId) -> SceneGraph {
    let mut out = SceneGraph::default();
    for n in g.nodes() {
        out.insert_node(Node { id: rename(n.id), ..n });
    }
    for e in g.edges() {
        out.insert_edge(Edge { s: rename(e.s), t: rename(e.t), ..e }).expect("living ends");
    }
    out
}

/// Edges only between living nodes, seen from both ends.
pub(crate) fn is_sound(g: &SceneGraph) -> bool {
    g.edges().all(|e| {
        g.has_node(e.s)
            && g.has_node(e.t)
            && g.outgoing(e.s).any(|o| o == e)
            && g.incoming(e.t).any(|o| o == e)
    })
}

/// Any set of cells on the grid of frames.
pub(crate) fn looked() -> impl Strategy<Value = graph_align::Looked> {
    let cell = prop::array::uniform3(-9_i32..9);
    (prop::collection::vec(cell, 0..60), prop::array::uniform3(-500_i32..500)).prop_map(|(cells, origin)| {
        let origin = origin.map(|c| (f64::from(c) / 100.0) as f32);
        graph_align::Looked::new(0.5, origin, &cells).expect("small")
    })
}
