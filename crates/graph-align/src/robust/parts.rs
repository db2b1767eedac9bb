//! Nodes that are parts of one object become one.

use super::change::shared;
use super::index::Item;
use super::merge::fuse_classes;
use super::{Index, RobustParams, Work, plane};
use crate::{Edge, Node, NodeId, SceneGraph};
use std::collections::{BTreeMap, BTreeSet};

/// Pairs of nodes that are compared by one merge: a bound for crowds beyond any furnished place.
const MOST_PAIRS: u64 = 1 << 22;
/// Probability from which another class is a possible one.
const RIVAL: f32 = 0.12;
/// Boxes of structure are grown by this before they are compared, metres.
const GROWN: f32 = 0.1;

/// Joins nodes that are parts of others of their class: what lies mostly inside another, and of what was seen
/// `together`, in one visit, also pieces of one wall or floor. Of two, the one that was seen more often, then
/// the larger one, then the older one stays. Beside it (gone, stayed) in the order of joining.
pub(crate) fn join(
    graph: &mut SceneGraph,
    index: &mut Index,
    touched: &BTreeSet<NodeId>,
    together: &BTreeSet<NodeId>,
    params: &RobustParams,
) -> Vec<(NodeId, NodeId)> {
    let mut joined = Vec::new();
    let mut work = Work::new(MOST_PAIRS);
    for &id in touched {
        while let Some((keep, gone)) = part_near(graph, index, id, together, params, &mut work) {
            let Some(part) = graph.node(gone) else { break };
            let edges: Vec<Edge> = graph.outgoing(gone).chain(graph.incoming(gone)).collect();
            graph.remove_node(gone);
            index.remove(gone);
            joined.push((gone, keep));
            hand_over(graph, &edges, gone, keep);
            graph.change_node(keep, |node| {
                if node.label != part.label {
                    fuse_classes(node, &part, params);
                }
                node.bounds = node.bounds.union(&part.bounds);
                node.last_seen = node.last_seen.max(part.last_seen);
            });
            if let Some(node) = graph.node(keep) {
                index.insert(&node);
            }
            if gone == id {
                break;
            }
        }
    }
    joined
}

/// The edges of a node that is gone become those of another. Where both had edges with one node, those
/// with the surest of them stay: two parts of an object have one relation with their neighbour.
fn hand_over(graph: &mut SceneGraph, edges: &[Edge], gone: NodeId, keep: NodeId) {
    let mut surest: BTreeMap<(NodeId, NodeId), f32> = BTreeMap::new();
    let swap = |n: NodeId| if n == gone { keep } else { n };
    for e in edges {
        let best = surest.entry((swap(e.s), swap(e.t))).or_default();
        *best = best.max(e.score);
    }
    for (&(s, t), &best) in &surest {
        if graph.edges_between(s, t).any(|e| e.score >= best) {
            continue;
        }
        graph.remove_edges_between(s, t);
        for e in edges.iter().filter(|e| (swap(e.s), swap(e.t)) == (s, t)) {
            // An edge between the two is no edge any more.
            let _ = graph.insert_edge(Edge { s, t, ..*e });
        }
    }
}

/// (which stays, which goes) of the pair of a node and the neighbour that is a part of it, or it of that: the
/// one that shares most with it, else of structure seen `together` with it the nearest in its plane.
fn part_near(
    graph: &SceneGraph,
    index: &Index,
    id: NodeId,
    together: &BTreeSet<NodeId>,
    params: &RobustParams,
    work: &mut Work,
) -> Option<(NodeId, NodeId)> {
    let node = graph.node(id).filter(|_| !work.exhausted)?;
    let own = Item::of(&node);
    let mut near = Vec::new();
    let mut check = |_: u32, r: &Item| {
        if work.spend(1) && r.id != id {
            near.push(*r);
        }
    };
    let structure = params.structure.contains(&node.label);
    if structure {
        index.structure_near(&node.bounds, params.gap, &mut check);
    } else {
        index.near(&own.p, (node.bounds.extent().norm() / 2.0).min(10.0) + 1.5, &mut check);
    }
    let beside = |r: &Item| {
        let both = together.contains(&id) && together.contains(&r.id);
        let gap = plane::gap(&node.bounds, &r.bounds).filter(|g| both && g.width() <= params.gap)?;
        (!near.iter().any(|w| gap.holds(&w.bounds))).then_some(-gap.width())
    };
    let closeness = |r: &Item| match (structure, r.label == node.label) {
        (true, true) => {
            let share = shared(&node.bounds, &r.bounds, GROWN);
            if share > params.part[0] { Some(share) } else { beside(r) }
        }
        (true, false) => None,
        (false, same) => {
            let kin = same
                || params.is_named(&node)
                    && graph.node(r.id).is_some_and(|o| params.is_named(&o) && rivals(&node, &o));
            let least = if same { params.part[1] } else { params.part[2] };
            Some(shared(&node.bounds, &r.bounds, 0.0)).filter(|share| kin && *share > least)
        }
    };
    let candidates = near.iter().filter_map(|r| Some((closeness(r)?, r)));
    let (_, other) = candidates.max_by(|a, b| a.0.total_cmp(&b.0).then_with(|| b.1.order(a.1)))?;
    let rank =
        |n: &Node, i: &Item| (n.sightings, ordered(n.bounds.extent().product()), std::cmp::Reverse(i.id));
    let theirs = graph.node(other.id)?;
    Some(if rank(&node, &own) >= rank(&theirs, other) { (id, other.id) } else { (other.id, id) })
}

/// Whether each of two nodes takes the other's class to be possible.
fn rivals(a: &Node, b: &Node) -> bool {
    let thinks = |x: &Node, y: &Node| x.others.iter().any(|o| o.0 == y.label && o.1 >= RIVAL);
    thinks(a, b) || thinks(b, a)
}

/// A non-negative number as an integer of the same order.
fn ordered(v: f32) -> u32 {
    v.max(0.0).to_bits()
}
