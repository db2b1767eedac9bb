//! Invariants of alignment, update, fold and frames, over random graphs.

#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

mod common;

use common::{graph, is_sound, renamed};
use graph_align::{
    Algorithm, Box3, Edge, Key, LabelId, Node, NodeId, Observation, Outcome, PaperParams, Params,
    PredicateId, Query, Replica, SceneGraph, Verdict, Why, align, update,
};
use proptest::prelude::*;

fn params(reading: &str, seed: u64) -> Params {
    let paper = PaperParams::reading(reading).expect("known");
    Params { algorithm: Algorithm::Paper, paper, seed, ..Params::default() }
}

fn rename(id: NodeId) -> NodeId {
    NodeId((id.0 * 0x9E37_79B9) ^ 0x5555)
}

/// A match with its ids renamed.
fn renamed_outcome(o: &Outcome) -> Outcome {
    let Outcome::Match(m) = o else { return o.clone() };
    let mut m = m.clone();
    m.pairs = m.pairs.iter().map(|&(q, r)| (rename(q), rename(r))).collect();
    m.pairs.sort_unstable();
    m.verdicts = m
        .verdicts
        .iter()
        .map(|(&q, &v)| {
            let v = match v {
                Verdict::Same(r) => Verdict::Same(rename(r)),
                Verdict::Relabelled(r) => Verdict::Relabelled(rename(r)),
                Verdict::Moved(r) => Verdict::Moved(rename(r)),
                Verdict::New => Verdict::New,
            };
            (rename(q), v)
        })
        .collect();
    Outcome::Match(m)
}

proptest! {
    #![proptest_config(common::cases(200))]

    #[test]
    fn a_graph_merged_with_itself_is_itself(g in graph(25), seed in any::<u64>()) {
        let p = params("default", seed);
        let outcome = align(&g, &Query::new(&g), &p);
        if let Outcome::Match(m) = &outcome {
            prop_assert!(m.verdicts.iter().all(|(q, v)| *v == Verdict::Same(*q)));
            let merged = update(&g, &Query::new(&g), &outcome, &p);
            prop_assert_eq!(merged.len(), g.len());
            prop_assert!(merged.edges().map(|e| (e.s, e.t, e.p)).eq(g.edges().map(|e| (e.s, e.t, e.p))));
        } else {
            prop_assert!(align(&g, &Query::new(&g), &p) == outcome);
        }
    }

    #[test]
    fn ids_and_order_do_not_matter(a in graph(20), b in graph(20), seed in any::<u64>(), reading in 0..PaperParams::READINGS.len()) {
        let mut p = params(PaperParams::READINGS[reading], seed);
        p.paper.budget = 20_000;
        p.paper.theta_len = 1;
        let plain = align(&a, &Query::new(&b), &p);
        let (ra, rb) = (renamed(&a, rename), renamed(&b, rename));
        prop_assert_eq!(align(&ra, &Query::new(&rb), &p), renamed_outcome(&plain));
        prop_assert_eq!(align(&a, &Query::new(&b), &p), plain);
    }

    #[test]
    fn no_node_is_lost_and_edges_live(a in graph(20), b in graph(20), seed in any::<u64>()) {
        let mut p = params("default", seed);
        p.paper.theta_len = 1;
        p.paper.small_query = 0;
        let outcome = align(&a, &Query::new(&b), &p);
        let merged = update(&a, &Query::new(&b), &outcome, &p);
        prop_assert!(is_sound(&merged));
        let new = match &outcome {
            Outcome::Match(m) => {
                let images: std::collections::BTreeSet<_> = m.pairs.iter().map(|p| p.1).collect();
                prop_assert_eq!(images.len(), m.pairs.len());
                m.verdicts.values().filter(|v| **v == Verdict::New).count()
            }
            _ => b.len(),
        };
        prop_assert_eq!(merged.len(), a.len() + new);
        prop_assert!(a.nodes().all(|n| merged.node(n.id).is_some()));
    }

    #[test]
    fn any_order_of_arrival_folds_to_the_same(graphs in prop::collection::vec(graph(10), 1..7), shuffle in any::<u64>()) {
        let mut p = params("default", 1);
        p.paper.small_query = 0;
        p.paper.theta_len = 0;
        let all: Vec<Observation> = graphs
            .into_iter()
            .enumerate()
            .map(|(k, graph)| Observation {
                key: Key { start_ds: (k as u32 * 37) % 50, agent: k as u16 % 3, epoch: 0, seq: k as u32 },
                end_ds: 100,
                frame: k as u32 % 2,
                graph: graph.quantised(),
                looked: None,
            })
            .collect();
        let mut one = Replica::default();
        for o in &all {
            prop_assert!(one.apply(o.clone()).expect("first"));
            prop_assert!(!one.apply(o.clone()).expect("again"));
        }
        let mut two = Replica::default();
        for k in 0..all.len() {
            two.apply(all[(k + shuffle as usize % all.len()) % all.len()].clone()).expect("rotated");
        }
        prop_assert_eq!(one.fold(&p), two.fold(&p));
        let mut forged = all[0].clone();
        forged.end_ds += 1;
        prop_assert!(two.apply(forged).is_err());
    }
}

fn clique(n: u64) -> SceneGraph {
    let mut g = SceneGraph::default();
    for i in 0..n {
        let b = Box3::new([i as f32, 0.0, 0.0], [0.5; 3]).expect("finite");
        g.insert_node(Node::new(NodeId(i), LabelId(0), b));
    }
    for i in 0..n {
        for j in (0..n).filter(|&j| j != i) {
            let e = Edge { s: NodeId(i), t: NodeId(j), p: PredicateId(0), score: 1.0 };
            g.insert_edge(e).expect("living ends");
        }
    }
    g
}

#[test]
fn the_budget_holds_on_cliques_and_hubs() {
    // K_12 in K_14 with a visit set per call would take some 1e15 steps.
    let mut p = params("per-call", 1);
    p.paper.theta_len = 12;
    p.paper.budget = 100_000;
    let (q, r) = (clique(12), clique(14));
    assert_eq!(align(&r, &Query::new(&q), &p), Outcome::NoMatch { why: Why::Budget });
    // With the shared visit set the same pair is done within the budget.
    p.paper.visit_per_call = false;
    p.paper.theta_len = 3;
    assert!(matches!(align(&r, &Query::new(&q), &p), Outcome::Match(_)));
}

#[test]
fn rules_on_two_boxes() {
    let node = |id, label, x: f32| {
        Node::new(NodeId(id), LabelId(label), Box3::new([x, 0.0, 0.0], [1.0; 3]).expect("finite"))
    };
    let graph = |nodes: &[Node]| {
        let mut g = SceneGraph::default();
        nodes.iter().for_each(|n| g.insert_node(n.clone()));
        g
    };
    let r = graph(&[node(1, 0, 0.0)]);
    let of = |q: Node, p: &PaperParams| {
        graph_align::paper::verdicts(&r, &graph(&[q]), &nalgebra::Isometry3::identity(), p)[&NodeId(9)]
    };
    let p = PaperParams::default();
    // Equal unit boxes at distance d have IoU (1 - d) / (1 + d): 0.4 at d = 3/7.
    assert_eq!(of(node(9, 0, 0.42), &p), Verdict::Same(NodeId(1)));
    assert_eq!(of(node(9, 0, 0.44), &p), Verdict::New);
    assert_eq!(of(node(9, 3, 0.42), &p), Verdict::Relabelled(NodeId(1)));
    let near = PaperParams::reading("near-same").expect("known");
    assert_eq!(of(node(9, 0, 1.4), &near), Verdict::Same(NodeId(1)));
    assert_eq!(of(node(9, 0, 1.6), &near), Verdict::New);
}
