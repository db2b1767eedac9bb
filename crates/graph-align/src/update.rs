//! Applying an answer to the reference.

use crate::{Algorithm, Edge, Match, Node, NodeId, Outcome, Params, Query, SceneGraph, Verdict, robust};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// The reference after the query has been merged into it as `outcome` says.
///
/// *Robust*: nodes that were seen again gather classes (means over sightings) and sightings, and
/// their box is that of the last view, extended a little towards what was known
/// ([`RobustParams::slack`](crate::RobustParams::slack)); moved ones take the query's box and edges;
/// relations between nodes that were both seen again become the query's, others stay; nodes of
/// [`Match::removed`] count a miss and go when [`RobustParams::patience`](crate::RobustParams::patience)
/// is spent.
///
/// *Paper*: a match: the box becomes the union, the class stays; relabelled: box and class become the
/// query's; in both the edges of the node become the query's.
///
/// New nodes and their edges are added and keep their id where it is free. Without a match
/// everything is appended, at the prior where there is one.
#[must_use]
pub fn update(reference: &SceneGraph, query: &Query<'_>, outcome: &Outcome, params: &Params) -> SceneGraph {
    match outcome {
        Outcome::Match(m) if params.algorithm == Algorithm::Robust => {
            let mut out = reference.clone();
            robust::merge::merge(&mut out, None, query.graph, m, &params.robust);
            out
        }
        Outcome::Match(m) => merge(reference, query.graph, m),
        Outcome::Ambiguous { .. } | Outcome::NoMatch { .. } => {
            append(reference, query.graph, &query.prior.unwrap_or_else(Isometry3::identity))
        }
    }
}

/// The reference and the query as new nodes and edges.
#[must_use]
pub fn append(
    reference: &SceneGraph,
    query: &SceneGraph,
    reference_from_query: &Isometry3<f32>,
) -> SceneGraph {
    let mut out = reference.clone();
    let mut image = BTreeMap::new();
    for q in query.nodes() {
        image.insert(q.id, add(&mut out, &q, reference_from_query));
    }
    add_edges(&mut out, query, &image);
    out
}

fn merge(reference: &SceneGraph, query: &SceneGraph, m: &Match) -> SceneGraph {
    let mut out = reference.clone();
    for &r in &m.removed {
        out.remove_node(r);
    }
    let mut image = BTreeMap::new();
    for q in query.nodes() {
        let verdict = m.verdicts.get(&q.id).copied().unwrap_or(Verdict::New);
        let known = match verdict {
            Verdict::Same(r) | Verdict::Relabelled(r) | Verdict::Moved(r) => {
                observe(&mut out, &q, r, verdict, m)
            }
            Verdict::New => None,
        };
        let id = known.unwrap_or_else(|| add(&mut out, &q, &m.reference_from_query));
        image.insert(q.id, id);
    }
    add_edges(&mut out, query, &image);
    out
}

/// Merges a query node into reference node `r`; `None` if `r` is gone.
fn observe(out: &mut SceneGraph, q: &Node, r: NodeId, verdict: Verdict, m: &Match) -> Option<NodeId> {
    let mut node = out.node(r)?;
    let seen = q.bounds.transformed(&m.reference_from_query);
    match verdict {
        Verdict::Relabelled(_) => {
            node.label = q.label;
            node.score = q.score;
            node.bounds = seen;
        }
        Verdict::Moved(_) => node.bounds = seen,
        Verdict::Same(_) | Verdict::New => {
            let (a, b) = (node.sightings as f32, q.sightings as f32);
            node.score = (node.score * a + q.score * b) / (a + b).max(1.0);
            node.bounds = node.bounds.union(&seen);
        }
    }
    node.sightings = node.sightings.saturating_add(q.sightings);
    node.last_seen = node.last_seen.max(q.last_seen);
    out.insert_node(node);
    out.remove_edges(r);
    Some(r)
}

fn add(out: &mut SceneGraph, q: &Node, reference_from_query: &Isometry3<f32>) -> NodeId {
    let id = out.free_id(q.id);
    out.insert_node(Node { id, bounds: q.bounds.transformed(reference_from_query), ..q.clone() });
    id
}

fn add_edges(out: &mut SceneGraph, query: &SceneGraph, image: &BTreeMap<NodeId, NodeId>) {
    for e in query.edges() {
        if let (Some(&s), Some(&t)) = (image.get(&e.s), image.get(&e.t)) {
            // Both ends were just written, and verdicts are one-to-one: only a caller's own verdicts
            // that send both ends to one node make this edge vanish.
            let _ = out.insert_edge(Edge { s, t, ..e });
        }
    }
}
