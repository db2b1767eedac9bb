//! One agent alone: `sgfn` replaces a room when it comes back, `sgfn-keep` appends.

use super::{Local, Made, System};
use crate::scenario::{Plan, Visit};
use graph_align::{Edge, Node, NodeId, SceneGraph};

/// The visits that a single agent makes: each round-0 room once, then every rescan.
pub(super) fn visits(plan: &Plan) -> Vec<(usize, &Visit)> {
    plan.visits.iter().enumerate().filter(|(_, v)| v.pass == 0).collect()
}

/// Runs a single-agent system. `locals` are in the order of `plan.visits`, graphs in the domain
/// frame.
#[must_use]
pub fn single_agent(system: System, plan: &Plan, locals: &[&Local]) -> Made {
    let mut made = Made::default();
    let mut of_room: std::collections::BTreeMap<usize, Vec<NodeId>> = std::collections::BTreeMap::new();
    let mut order = visits(plan);
    // Round 0 first, as the single agent has all reference scans before any rescan.
    order.sort_by_key(|(k, v)| (v.round > 0, *k));
    for (n, (k, v)) in order.into_iter().enumerate() {
        let local = locals[k];
        made.visits += 1;
        made.frames += u64::from(local.frames);
        made.total_cpu_s += local.cpu_s;
        made.world_s += local.world_s;
        made.total_wall_s += local.wall_s;
        if system != System::SgfnKeep {
            for id in of_room.remove(&v.room).unwrap_or_default() {
                made.graph.remove_node(id);
            }
        }
        let ids = insert(&mut made.graph, &local.graphs[&system.variant()], (n as u64) << 24);
        of_room.entry(v.room).or_default().extend(ids);
    }
    made.frames_max_agent = made.frames;
    made
}

/// Adds a graph under ids from `base`; says which.
fn insert(into: &mut SceneGraph, graph: &SceneGraph, base: u64) -> Vec<NodeId> {
    let id = |n: NodeId| NodeId(base + n.0);
    for n in graph.nodes() {
        into.insert_node(Node { id: id(n.id), ..n.clone() });
    }
    for e in graph.edges() {
        // Both ends were just inserted.
        let _ = into.insert_edge(Edge { s: id(e.s), t: id(e.t), ..e });
    }
    graph.nodes().map(|n| id(n.id)).collect()
}
