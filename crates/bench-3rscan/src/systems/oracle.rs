//! The merge that knows which object is which: the ceiling of every alignment.

use super::Local;
use crate::scenario::Plan;
use graph_align::{Box3, Edge, LabelId, Node, NodeId, PredicateId, SceneGraph};
use scan3r::RoomEntry;
use std::collections::BTreeMap;

/// Evidence about one true object.
struct Object {
    /// Round of the scan that its box is from.
    round: usize,
    bounds: Box3,
    classes: BTreeMap<LabelId, f32>,
    sightings: u32,
    last_seen: f64,
}

/// (room, instance, index of the visit for nodes without an instance and for further pieces of one, else 0, node).
type Name = (usize, u32, usize, u64);

/// Directed edges by their ends: the round that they are from, and the summed score per predicate.
type Edges = BTreeMap<(Name, Name), (usize, BTreeMap<PredicateId, f32>)>;

/// Merges the network's local graphs by true instance: boxes of one round are united, a later
/// round's replace them; classes add up; an object that a rescan lists as removed goes. Nodes that
/// show no instance are kept until their room is visited again. With `within`, all pieces of an instance that one visit
/// shows are one object; without, only the largest stands for it and the others stay as they are, as in a merge that
/// associates visits.
pub(super) fn merge(plan: &Plan, locals: &[&Local], rooms: &[RoomEntry], within: bool) -> SceneGraph {
    let mut objects: BTreeMap<Name, Object> = BTreeMap::new();
    let mut edges = Edges::new();
    for (k, v) in plan.visits.iter().enumerate() {
        if v.round > 0 {
            let gone = rooms[v.room].scans[v.round - 1].removed.as_deref().unwrap_or(&[]);
            objects.retain(|n, _| n.0 != v.room || !(n.1 == 0 || gone.contains(&n.1)));
        }
        let local = locals[k];
        let graph = &local.graphs[&super::Variant::Network];
        let instance = |id: NodeId| local.instances.get(&id).copied().unwrap_or(0);
        let largest = largest(graph, instance);
        let name = |id: NodeId| match instance(id) {
            0 => (v.room, 0, k, id.0),
            i if within || largest.get(&i) == Some(&id) => (v.room, i, 0, 0),
            i => (v.room, i, k + 1, id.0),
        };
        for n in graph.nodes() {
            observe(&mut objects, name(n.id), &n, v.round, v.start);
        }
        for e in graph.edges() {
            let pair = (name(e.s), name(e.t));
            let known = edges.entry(pair).or_insert((v.round, BTreeMap::new()));
            if known.0 < v.round {
                *known = (v.round, BTreeMap::new());
            }
            *known.1.entry(e.p).or_default() += e.score;
        }
    }
    write(&objects, &edges)
}

/// The piece of every instance with the largest box.
fn largest(graph: &SceneGraph, instance: impl Fn(NodeId) -> u32) -> BTreeMap<u32, NodeId> {
    let mut best: BTreeMap<u32, (f32, NodeId)> = BTreeMap::new();
    for n in graph.nodes().filter(|n| instance(n.id) != 0) {
        let size = n.bounds.extent().iter().map(|e| e.max(0.01)).product();
        let held = best.entry(instance(n.id)).or_insert((size, n.id));
        if size > held.0 {
            *held = (size, n.id);
        }
    }
    best.into_iter().map(|(i, (_, id))| (i, id)).collect()
}

fn observe(objects: &mut BTreeMap<Name, Object>, name: Name, n: &Node, round: usize, start: f64) {
    let o = objects.entry(name).or_insert_with(|| Object {
        round,
        bounds: n.bounds,
        classes: BTreeMap::new(),
        sightings: 0,
        last_seen: 0.0,
    });
    o.bounds = if o.round < round { n.bounds } else { o.bounds.union(&n.bounds) };
    o.round = round;
    *o.classes.entry(n.label).or_default() += n.score;
    o.sightings += 1;
    o.last_seen = o.last_seen.max(start);
}

fn write(objects: &BTreeMap<Name, Object>, edges: &Edges) -> SceneGraph {
    let mut graph = SceneGraph::default();
    let ids: BTreeMap<Name, NodeId> =
        objects.keys().enumerate().map(|(k, n)| (*n, NodeId(k as u64))).collect();
    for (name, o) in objects {
        let total: f32 = o.classes.values().sum();
        let best = o.classes.iter().fold(None, |b: Option<(LabelId, f32)>, (&l, &s)| match b {
            Some((_, most)) if most >= s => b,
            _ => Some((l, s)),
        });
        let Some((label, score)) = best else { continue };
        graph.insert_node(Node {
            id: ids[name],
            label,
            score: score / total.max(1e-6),
            bounds: o.bounds,
            others: Default::default(),
            sightings: o.sightings,
            misses: 0,
            last_seen: o.last_seen,
        });
    }
    for ((s, t), (_, predicates)) in edges {
        let best = predicates.iter().fold(None, |b: Option<(PredicateId, f32)>, (&p, &s)| match b {
            Some((_, most)) if most >= s => b,
            _ => Some((p, s)),
        });
        if let (Some(&s), Some(&t), Some((p, score))) = (ids.get(s), ids.get(t), best)
            && s != t
        {
            // An end may have been removed since; then the edge is gone with it.
            let _ = graph.insert_edge(Edge { s, t, p, score: score.min(1.0) });
        }
    }
    graph
}
