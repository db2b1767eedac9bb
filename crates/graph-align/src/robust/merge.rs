//! Merging a query into its reference with the evidence of both.

use super::{Index, RobustParams};
use crate::{Box3, Edge, LabelId, Match, Node, NodeId, SceneGraph, Verdict};
use nalgebra::{Isometry3, Translation3};
use std::collections::{BTreeMap, BTreeSet};

/// Merges `query` into `graph` as `m` says, and keeps an index of the graph up to date. Beside it
/// what was done.
///
/// Same and relabelled nodes gather classes and sightings; moved ones take the query's box and
/// edges, and what stood on them goes along; nodes of `m.removed` and `m.unmet` count a miss and go when their sightings do not outweigh it.
pub(crate) fn merge(
    graph: &mut SceneGraph,
    index: Option<&mut Index>,
    query: &SceneGraph,
    m: &Match,
    params: &RobustParams,
) -> Merged {
    let mut touched: BTreeSet<NodeId> = BTreeSet::new();
    let carried = carried(graph, query, m, params);
    for &r in m.removed.iter().chain(&m.unmet) {
        let mut worn = false;
        graph.change_node(r, |node| {
            node.misses = node.misses.saturating_add(1);
            worn = node.misses >= patience(node, params);
        });
        if worn {
            graph.remove_node(r);
            touched.insert(r);
        }
    }
    let mut image = BTreeMap::new();
    for q in query.nodes() {
        let verdict = m.verdicts.get(&q.id).copied().unwrap_or(Verdict::New);
        let seen = q.bounds.transformed(&m.reference_from_query);
        let known = match verdict {
            Verdict::Same(r) | Verdict::Relabelled(r) | Verdict::Moved(r) => Some(r),
            Verdict::New => None,
        };
        let id = match known.filter(|r| graph.has_node(*r)) {
            Some(r) => {
                see_again(graph, r, &q, &seen, verdict, params);
                r
            }
            None => add(graph, &q, &m.reference_from_query),
        };
        image.insert(q.id, id);
        touched.insert(id);
    }
    for (&child, ride) in &carried {
        if !graph.has_node(child) {
            continue;
        }
        graph.change_node(child, |node| node.bounds = node.bounds.transformed(&ride.shift));
        touched.insert(child);
        // The support's old edges went; both ends are in the graph.
        let _ = graph.insert_edge(ride.edge);
    }
    edges(graph, query, &image);
    if let Some(index) = index {
        for &id in &touched {
            match graph.node(id) {
                Some(node) => index.insert(&node),
                None => index.remove(id),
            }
        }
    }
    Merged { touched, image, carried: carried.into_keys().collect() }
}

/// Where a node goes that stands on one that moved.
struct Ride {
    /// How far from the middle of the support it stood, metres.
    from_middle: f32,
    shift: Isometry3<f32>,
    edge: Edge,
}

/// Nodes that stood on one that moved, with an edge to it, and were not seen anywhere: they go with it. A
/// place that was looked at and empty still counts as a miss.
fn carried(
    graph: &SceneGraph,
    query: &SceneGraph,
    m: &Match,
    params: &RobustParams,
) -> BTreeMap<NodeId, Ride> {
    let met = |v: &Verdict| match *v {
        Verdict::Same(r) | Verdict::Relabelled(r) | Verdict::Moved(r) => Some(r),
        Verdict::New => None,
    };
    let seen: BTreeSet<NodeId> = m.verdicts.values().filter_map(met).collect();
    let mut out: BTreeMap<NodeId, Ride> = BTreeMap::new();
    for (q, verdict) in &m.verdicts {
        let Verdict::Moved(r) = *verdict else { continue };
        let (Some(now), Some(support)) = (query.node(*q), graph.node(r)) else { continue };
        let now = m.reference_from_query * now.bounds.middle();
        for edge in graph.incoming(r).filter(|e| !seen.contains(&e.s)) {
            let Some(child) = graph.node(edge.s) else { continue };
            let off = child.bounds.centroid() - support.bounds.centroid();
            let half = support.bounds.extent() / 2.0;
            let on = off.x.abs() <= half.x && off.y.abs() <= half.y && off.z > -half.z;
            if !on || params.structure.contains(&child.label) {
                continue;
            }
            let shift = Translation3::from(now - support.bounds.middle()).into();
            let ride = Ride { from_middle: off.norm(), shift, edge };
            // Of two supports the nearer one.
            if out.get(&edge.s).is_none_or(|o| ride.from_middle < o.from_middle) {
                out.insert(edge.s, ride);
            }
        }
    }
    out
}

/// What a merge did.
pub(crate) struct Merged {
    /// Nodes that changed, came or went.
    pub touched: BTreeSet<NodeId>,
    /// The node that each node of the query became.
    pub image: BTreeMap<NodeId, NodeId>,
    /// Nodes that went along with what they stood on.
    pub carried: Vec<NodeId>,
}

/// Visits in a row that must miss a node before it goes.
fn patience(node: &Node, params: &RobustParams) -> u32 {
    if node.sightings > 1 || node.score >= params.sure { params.patience[1] } else { params.patience[0] }
}

/// A node of the graph, seen once more; where it moved, all that was known of its place goes.
fn see_again(
    graph: &mut SceneGraph,
    r: NodeId,
    q: &Node,
    seen: &Box3,
    verdict: Verdict,
    params: &RobustParams,
) {
    let moved = matches!(verdict, Verdict::Moved(_));
    let slack = if params.structure.contains(&q.label) { f32::MAX } else { params.slack };
    graph.change_node(r, |node| {
        observe(node, q, params);
        node.bounds = if moved { *seen } else { combined(&node.bounds, seen, slack) };
    });
    if moved {
        graph.remove_edges(r);
    }
}

/// One more view of a node, but for its place.
fn observe(node: &mut Node, q: &Node, params: &RobustParams) {
    fuse_classes(node, q, params);
    node.sightings = node.sightings.saturating_add(q.sightings);
    node.misses = 0;
    node.last_seen = node.last_seen.max(q.last_seen);
}

/// Class probabilities as means over sightings; the best three stay. Of a named and an unnamed view
/// the unnamed one weighs less.
pub(super) fn fuse_classes(node: &mut Node, q: &Node, params: &RobustParams) {
    let (mut a, mut b) = (node.sightings.max(1) as f32, q.sightings.max(1) as f32);
    match (params.is_named(node), params.is_named(q)) {
        (true, false) => b *= params.unnamed_weight,
        (false, true) => a *= params.unnamed_weight,
        (true, true) | (false, false) => {}
    }
    let mut sums: BTreeMap<LabelId, f32> = BTreeMap::new();
    node.classes().for_each(|(l, p)| *sums.entry(l).or_default() += p * a);
    q.classes().for_each(|(l, p)| *sums.entry(l).or_default() += p * b);
    let mut order: Vec<(LabelId, f32)> = sums.into_iter().map(|(l, p)| (l, (p / (a + b)).min(1.0))).collect();
    order.sort_by(|x, y| y.1.total_cmp(&x.1).then(x.0.cmp(&y.0)));
    order.truncate(1 + Node::MAX_OTHERS);
    if let Some((&(label, score), rest)) = order.split_first() {
        (node.label, node.score) = (label, score);
        node.others = rest.iter().copied().collect();
    }
}

/// The box of the last view, extended towards what was known before by at most `slack` a side, and in no
/// direction beyond the longer of the two: where both are equally long, the object was displaced, not seen in part.
fn combined(known: &Box3, seen: &Box3, slack: f32) -> Box3 {
    if slack == f32::MAX {
        return known.union(seen);
    }
    let span = |[low, high]: [f32; 2], [known_low, known_high]: [f32; 2]| {
        let below = (low - known_low).clamp(0.0, slack);
        let above = (known_high - high).clamp(0.0, slack);
        let lacking = ((known_high - known_low) - (high - low)).max(0.0);
        let share = if below + above > lacking { lacking / (below + above) } else { 1.0 };
        [low - below * share, high + above * share]
    };
    let axes = [0, 1, 2].map(|k| span([seen.min()[k], seen.max()[k]], [known.min()[k], known.max()[k]]));
    let b = Box3::new(axes.map(|[l, h]| (l + h) / 2.0), axes.map(|[l, h]| h - l));
    b.map_or(*seen, |b| b.with_footprint_of(seen, known, span))
}

fn add(graph: &mut SceneGraph, q: &Node, reference_from_query: &Isometry3<f32>) -> NodeId {
    let id = graph.free_id(q.id);
    graph.insert_node(Node { id, bounds: q.bounds.transformed(reference_from_query), ..q.clone() });
    id
}

/// Relations between two nodes that were both seen again become the query's; others stay.
fn edges(graph: &mut SceneGraph, query: &SceneGraph, image: &BTreeMap<NodeId, NodeId>) {
    let mut seen: BTreeSet<(NodeId, NodeId)> = BTreeSet::new();
    let ends = |e: &Edge| Some((*image.get(&e.s)?, *image.get(&e.t)?));
    for (s, t) in query.edges().filter_map(|e| ends(&e)).filter(|(s, t)| s != t) {
        if seen.insert((s, t)) {
            graph.remove_edges_between(s, t);
        }
    }
    for e in query.edges() {
        if let Some((s, t)) = ends(&e) {
            // Both ends are in the graph; two query nodes of one image make no edge.
            let _ = graph.insert_edge(Edge { s, t, ..e });
        }
    }
}
