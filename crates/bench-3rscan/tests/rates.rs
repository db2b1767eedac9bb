//! Counts and rates: what has to hold whatever the graph says.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use bench_3rscan::correspond::{Limit, correspond};
use bench_3rscan::rates::{Counts, Three, measure};
use bench_3rscan::truth::Truth;
use common::{copy_of, graph, placements, truth};
use graph_align::{Edge, LabelId, Node, NodeId, SceneGraph};
use proptest::prelude::*;
use proptest::strategy::ValueTree as _;
use std::collections::BTreeSet;

fn kinds(t: &Three) -> [Counts; 3] {
    [t.object, t.predicate, t.triplet]
}

/// The definitions over the correspondence, pair by pair.
fn by_hand(truth: &Truth, graph: &SceneGraph, limit: Limit) -> [usize; 3] {
    let m = correspond(truth, graph, limit);
    let right =
        |p: &NodeId| m.get(p).is_some_and(|k| truth.nodes[*k].label == Some(graph.node(*p).unwrap().label));
    let object = graph.nodes().filter(|n| right(&n.id)).count();
    let (mut predicate, mut triplet) = (0, 0);
    for &(s, t, p) in &truth.edges {
        let hit = graph.edges().find(|e| {
            let id = |n: &NodeId| m.get(n).map(|k| truth.nodes[*k].id);
            e.p == p && id(&e.s) == Some(s) && id(&e.t) == Some(t)
        });
        predicate += usize::from(hit.is_some());
        triplet += usize::from(hit.is_some_and(|e| right(&e.s) && right(&e.t)));
    }
    [object, predicate, triplet]
}

/// Two rooms apart, so that copies in one cannot match the other's objects.
fn spread(mut t: Truth) -> Truth {
    for (k, n) in t.nodes.iter_mut().enumerate() {
        let c = n.bounds.centroid();
        n.bounds =
            graph_align::Box3::new([c.x + 20.0 * k as f32, c.y, c.z], n.bounds.extent().into()).unwrap();
    }
    t
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    #[test]
    fn counts_follow_their_definitions(t in truth(12), g in graph(12)) {
        let m = measure(&t, &g, &placements(2, 2.0));
        let counted = t.nodes.iter().filter(|n| !n.ignore).count();
        let four = [(Limit::Iou(0.0), m.main), (Limit::Iou(0.25), m.iou[0]), (Limit::Iou(0.5), m.iou[1]), (Limit::Centre, m.centre)];
        for (limit, three) in four {
            let c = kinds(&three);
            prop_assert_eq!(c.map(|c| c.tp), by_hand(&t, &g, limit));
            prop_assert_eq!(c.map(|c| c.tp + c.fn_), [counted, t.edges.len(), t.edges.len()]);
            prop_assert_eq!(c.map(|c| c.tp + c.fp), [g.len(), g.edges().len(), g.edges().len()]);
            prop_assert!(three.triplet.tp <= three.predicate.tp);
        }
    }

    #[test]
    fn rooms_sum_to_the_totals(t in truth(12), g in graph(12)) {
        let m = measure(&t, &g, &placements(2, 2.0));
        let mut sums = [[0; 3]; 3];
        for room in &m.per_room {
            for (s, c) in sums.iter_mut().zip(kinds(room)) {
                s[0] += c.tp;
                s[1] += c.fp;
                s[2] += c.fn_;
            }
        }
        prop_assert_eq!(sums, kinds(&m.main).map(|c| [c.tp, c.fp, c.fn_]));
        for (k, room) in m.per_room.iter().enumerate() {
            let there = t.nodes.iter().filter(|n| !n.ignore && n.room == k).count();
            prop_assert_eq!(room.object.tp + room.object.fn_, there);
        }
        prop_assert_eq!(m.per_class.iter().map(|c| c.1).sum::<usize>(), m.main.object.tp);
        prop_assert_eq!(m.per_class.iter().map(|c| c.2).sum::<usize>(), t.counts.nodes);
        prop_assert_eq!(m.per_predicate.iter().map(|c| c.1).sum::<usize>(), m.main.predicate.tp);
        prop_assert_eq!(m.per_predicate.iter().map(|c| c.2).sum::<usize>(), t.edges.len());
    }

    /// Every object alone in its place: there a stricter limit can only lose. (Among crowded boxes
    /// it need not: a better overlap with the wrong label can take a node that the stricter limit
    /// leaves to the right one.)
    #[test]
    fn a_stricter_limit_finds_no_more(t in truth(12).prop_map(spread), shift in prop::array::uniform3(-0.4_f32..0.4)) {
        let mut g = copy_of(&t, |id| id);
        for n in g.clone().nodes() {
            let c = n.bounds.centroid();
            let bounds = graph_align::Box3::new([c.x + shift[0], c.y + shift[1], c.z + shift[2]], n.bounds.extent().into()).unwrap();
            g.insert_node(Node { bounds, ..n.clone() });
        }
        let m = measure(&t, &g, &placements(2, 2.0));
        let chain = [m.centre, m.main, m.iou[0], m.iou[1]].map(|c| kinds(&c).map(|c| c.tp));
        for pair in chain.windows(2) {
            prop_assert!((0..3).all(|k| pair[0][k] >= pair[1][k]), "{:?}", chain);
        }
    }

    #[test]
    fn a_copy_of_the_truth_scores_100(t in truth(12).prop_map(spread), salt in any::<u64>()) {
        let g = copy_of(&t, |id| id.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ salt);
        let m = measure(&t, &g, &placements(2, 2.0));
        for three in [m.main, m.iou[0], m.iou[1], m.centre] {
            for c in kinds(&three) {
                prop_assert_eq!((c.fp, c.fn_), (0, 0));
                let r = c.rates();
                prop_assert_eq!([r.r, r.p, r.f1], [(c.tp > 0).then_some(100.0); 3]);
            }
        }
        prop_assert_eq!(m.class_mean_object, (t.counts.nodes > 0).then_some(100.0));
    }

    #[test]
    fn duplicates_are_false_positives(t in truth(10).prop_map(spread)) {
        let mut g = copy_of(&t, |id| id);
        for n in g.clone().nodes() {
            g.insert_node(Node { id: NodeId(n.id.0 + 1000), ..n.clone() });
        }
        for e in g.clone().edges() {
            g.insert_edge(Edge { s: NodeId(e.s.0 + 1000), t: NodeId(e.t.0 + 1000), ..e }).unwrap();
        }
        let m = measure(&t, &g, &placements(2, 2.0)).main;
        for c in kinds(&m) {
            prop_assert_eq!((c.fp, c.fn_), (c.tp, 0));
        }
    }

    #[test]
    fn a_wrong_label_costs_objects_and_triplets_but_no_predicate(t in truth(10).prop_map(spread)) {
        let mut g = copy_of(&t, |id| id);
        for n in g.clone().nodes() {
            g.insert_node(Node { label: LabelId(n.label.0 + common::LABELS), ..n.clone() });
        }
        let m = measure(&t, &g, &placements(2, 2.0)).main;
        prop_assert_eq!(kinds(&m).map(|c| c.tp), [0, t.edges.len(), 0]);
    }

    #[test]
    fn rates_follow_from_counts(tp in 0_usize..500, fp in 0_usize..500, fn_ in 0_usize..500) {
        let r = Counts { tp, fp, fn_ }.rates();
        let of = |n: usize| (n > 0).then(|| 100.0 * tp as f64 / n as f64);
        prop_assert_eq!((r.r, r.p), (of(tp + fn_), of(tp + fp)));
        // 2 tp / (2 tp + fp + fn) is the harmonic mean, written without the two rates.
        if let Some(f1) = r.f1 {
            prop_assert!((f1 - 200.0 * tp as f64 / (2 * tp + fp + fn_) as f64).abs() < 1e-9);
        }
        prop_assert_eq!(r.f1.is_some(), r.r.is_some() && r.p.is_some());
    }
}

#[test]
fn an_empty_graph_has_no_precision() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let t = (0..50)
        .map(|_| truth(12).new_tree(&mut runner).unwrap().current())
        .find(|t| !t.edges.is_empty())
        .unwrap();
    let m = measure(&t, &SceneGraph::default(), &placements(2, 2.0));
    for c in kinds(&m.main) {
        let r = c.rates();
        assert_eq!((r.r, r.p, r.f1), (Some(0.0), None, None));
    }
    let json = serde_json::to_value(m.main.object.rates()).unwrap();
    assert!(json["p"].is_null() && json["f1"].is_null());
    assert_eq!(json["r"], 0.0);
    let names: BTreeSet<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(names, BTreeSet::from(["tp", "fp", "fn", "r", "p", "f1"]));
}

#[test]
fn a_false_positive_goes_to_the_nearest_room() {
    let t = Truth { nodes: vec![], edges: vec![], counts: Default::default() };
    let rooms = placements(3, 4.0);
    let mut g = SceneGraph::default();
    // Rooms fill x = 0..4, 7..11 and 14..18.
    for (id, x) in [(1, 2.0), (2, 6.0), (3, 13.0), (4, 40.0)] {
        let b = graph_align::Box3::new([x, 1.0, 1.0], [0.2; 3]).unwrap();
        g.insert_node(Node::new(NodeId(id), LabelId(0), b));
    }
    let m = measure(&t, &g, &rooms);
    assert_eq!(m.per_room.iter().map(|r| r.object.fp).collect::<Vec<_>>(), [1, 1, 2]);
}
