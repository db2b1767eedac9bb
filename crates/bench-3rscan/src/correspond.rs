//! Which predicted node is which true node (BENCH.md section 3).

use crate::truth::{Truth, TruthNode};
use graph_align::{Box3, Node, NodeId, SceneGraph};
use std::collections::{BTreeMap, BTreeSet};

/// Boxes are grown about their centre to at least this per axis, metres.
const MIN_SIDE: f32 = 0.10;

/// What a pair has to satisfy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// IoU above this, and the centre distance.
    Iou(f32),
    /// The centre distance alone.
    Centre,
}

/// A box grown to 0.10 m per axis.
#[must_use]
pub fn grown(b: &Box3) -> Box3 {
    let e = b.extent().map(|v| v.max(MIN_SIDE));
    // The centre stays and sides only grow to 0.1 m, so the box stays valid.
    Box3::new(b.centroid().coords.into(), e.into()).unwrap_or(*b)
}

/// max(0.5 m, half the true box's longest extent).
#[must_use]
pub fn reach(truth: &Box3) -> f32 {
    (truth.extent().max() / 2.0).max(0.5)
}

/// Predicted node to index into `truth.nodes`, one-to-one, greedy by (IoU falling, distance, true
/// id, predicted id). Ignored true nodes take no part; labels never decide.
#[must_use]
pub fn correspond(truth: &Truth, graph: &SceneGraph, limit: Limit) -> BTreeMap<NodeId, usize> {
    let predicted = sorted_by_x(graph);
    let mut pairs = Vec::new();
    for (k, t) in truth.nodes.iter().enumerate().filter(|(_, t)| !t.ignore) {
        for (p, overlap, distance) in near(t, &predicted) {
            let fits = match limit {
                Limit::Iou(min) => overlap > min,
                Limit::Centre => true,
            };
            if fits {
                pairs.push((-overlap, distance, t.id, p.id, k));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then((a.2, a.3).cmp(&(b.2, b.3))));
    let mut taken = BTreeSet::new();
    let mut out = BTreeMap::new();
    for (_, _, _, p, k) in pairs {
        if !out.contains_key(&p) && taken.insert(k) {
            out.insert(p, k);
        }
    }
    out
}

/// Predicted nodes whose best overlap is an instance outside the label set.
#[must_use]
pub fn on_clutter(truth: &Truth, graph: &SceneGraph) -> BTreeSet<NodeId> {
    let predicted = sorted_by_x(graph);
    let mut best: BTreeMap<NodeId, (f32, bool)> = BTreeMap::new();
    for t in &truth.nodes {
        for (p, overlap, _) in near(t, &predicted) {
            let b = best.entry(p.id).or_insert((0.0, false));
            if overlap > b.0 {
                *b = (overlap, t.label.is_none());
            }
        }
    }
    best.into_iter().filter(|(_, (_, clutter))| *clutter).map(|(id, _)| id).collect()
}

fn sorted_by_x(graph: &SceneGraph) -> Vec<(Node, Box3)> {
    let with_box = |n: Node| {
        let grown = grown(&n.bounds);
        (n, grown)
    };
    let mut v: Vec<_> = graph.nodes().map(with_box).collect();
    v.sort_by(|a, b| a.1.centroid().x.total_cmp(&b.1.centroid().x).then(a.0.id.cmp(&b.0.id)));
    v
}

/// Predicted nodes within reach of a true one, with IoU and centre distance.
fn near<'a>(t: &TruthNode, predicted: &'a [(Node, Box3)]) -> Vec<(&'a Node, f32, f32)> {
    let (reach, bounds) = (reach(&t.bounds), grown(&t.bounds));
    let x = bounds.centroid().x;
    let from = predicted.partition_point(|(_, b)| b.centroid().x < x - reach);
    predicted[from..]
        .iter()
        .take_while(|(_, b)| b.centroid().x <= x + reach)
        .map(|(p, b)| (p, bounds.iou(b), bounds.distance(b)))
        .filter(|(_, _, d)| *d <= reach)
        .collect()
}
