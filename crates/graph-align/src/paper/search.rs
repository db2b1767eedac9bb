//! GRAPHSEARCH: growing a map from an anchor along edges.

use super::PaperParams;
use crate::{NodeId, PredicateId, SceneGraph};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

/// Query node to reference node.
pub(super) type NodeMap = BTreeMap<NodeId, NodeId>;

pub(super) struct Found {
    pub(super) map: NodeMap,
    pub(super) out_of_budget: bool,
}

/// One step along an edge.
#[derive(Clone, Copy)]
struct Neighbour {
    id: NodeId,
    predicate: PredicateId,
    /// True when the edge starts at the node whose list this is.
    outward: bool,
}

/// Nodes with what the search needs of them, in an order that does not depend on ids.
struct Adjacency<'a> {
    graph: &'a SceneGraph,
    lists: BTreeMap<NodeId, Vec<Neighbour>>,
    order: Vec<NodeId>,
}

impl<'a> Adjacency<'a> {
    fn new(graph: &'a SceneGraph) -> Self {
        let mut order: Vec<NodeId> = graph.nodes().map(|n| n.id).collect();
        order.sort_by(|a, b| by_content(graph, *a, *b));
        let lists = order
            .iter()
            .map(|&id| {
                let out = graph.outgoing(id).map(|e| Neighbour { id: e.t, predicate: e.p, outward: true });
                let inc = graph.incoming(id).map(|e| Neighbour { id: e.s, predicate: e.p, outward: false });
                let mut list: Vec<_> = out.chain(inc).collect();
                list.sort_by(|a, b| {
                    by_content(graph, a.id, b.id)
                        .then_with(|| (a.predicate, a.outward).cmp(&(b.predicate, b.outward)))
                });
                (id, list)
            })
            .collect();
        Self { graph, lists, order }
    }

    fn of(&self, id: NodeId) -> &[Neighbour] {
        self.lists.get(&id).map_or(&[], Vec::as_slice)
    }
}

/// Order by class, place, size and score; ids decide between nodes that are equal in all of them.
fn by_content(graph: &SceneGraph, a: NodeId, b: NodeId) -> Ordering {
    let key = |id| {
        graph.node(id).map(|n| {
            let (c, e) = (n.bounds.centroid(), n.bounds.extent());
            (n.label, [c.x, c.y, c.z, e.x, e.y, e.z, n.score])
        })
    };
    match (key(a), key(b)) {
        (Some((la, ka)), Some((lb, kb))) => la
            .cmp(&lb)
            .then_with(|| {
                ka.iter().zip(&kb).map(|(x, y)| x.total_cmp(y)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
            })
            .then(a.cmp(&b)),
        _ => a.cmp(&b),
    }
}

/// Tries anchors in a seeded random order; each is mapped to every reference node of its class in
/// turn. The largest map over an anchor's candidates counts, and the first anchor whose map exceeds
/// theta_len ends the search.
pub(super) fn search(reference: &SceneGraph, query: &SceneGraph, params: &PaperParams, seed: u64) -> Found {
    let (q, r) = (Adjacency::new(query), Adjacency::new(reference));
    let mut anchors = q.order.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for i in (1..anchors.len()).rev() {
        anchors.swap(i, (rng.next_u64() % (i as u64 + 1)) as usize);
    }
    let mut run = Run { q: &q, r: &r, params, work: 0, map: NodeMap::new(), visit: BTreeSet::new() };
    let mut best = NodeMap::new();
    for anchor in anchors {
        let label = query.node(anchor).map(|n| n.label);
        for &candidate in &r.order {
            if reference.node(candidate).map(|n| n.label) != label {
                continue;
            }
            if params.reset {
                run.map.clear();
                run.visit.clear();
            }
            run.map.insert(anchor, candidate);
            let finished = run.grow(anchor);
            if run.map.len() > best.len() {
                best = run.map.clone();
            }
            if !finished {
                return Found { map: best, out_of_budget: true };
            }
        }
        if best.len() > params.theta_len {
            break;
        }
    }
    Found { map: best, out_of_budget: false }
}

struct Run<'a> {
    q: &'a Adjacency<'a>,
    r: &'a Adjacency<'a>,
    params: &'a PaperParams,
    work: u64,
    map: NodeMap,
    visit: BTreeSet<NodeId>,
}

/// One call of GRAPHSEARCH that has not returned yet.
struct Call {
    node: NodeId,
    /// Position in the query node's neighbours.
    u: usize,
    /// Position in the neighbours of its image.
    v: usize,
    /// The image when the call began: later overwriting does not move the call.
    image: NodeId,
    /// The caller's visit set, where every call has its own.
    outer_visit: Option<BTreeSet<NodeId>>,
}

impl Run<'_> {
    /// GRAPHSEARCH from a mapped node, with a stack of its own. False when the budget ran out.
    fn grow(&mut self, from: NodeId) -> bool {
        let mut stack = Vec::new();
        self.enter(&mut stack, from);
        while let Some(call) = stack.last_mut() {
            let Some(&u) = self.q.of(call.node).get(call.u) else {
                if let Some(outer) = call.outer_visit.take() {
                    self.visit = outer;
                }
                stack.pop();
                continue;
            };
            if call.v == 0 && self.visit.contains(&u.id) {
                call.u += 1;
                continue;
            }
            let Some(&v) = self.r.of(call.image).get(call.v) else {
                (call.u, call.v) = (call.u + 1, 0);
                continue;
            };
            call.v += 1;
            self.work += 1;
            if self.work > self.params.budget {
                return false;
            }
            if !self.fits(&u, &v) {
                continue;
            }
            if self.params.first_image {
                (call.u, call.v) = (call.u + 1, 0);
            }
            self.map.insert(u.id, v.id);
            self.enter(&mut stack, u.id);
        }
        true
    }

    fn enter(&mut self, stack: &mut Vec<Call>, node: NodeId) {
        let Some(&image) = self.map.get(&node) else { return };
        let outer_visit = self.params.visit_per_call.then(|| self.visit.clone());
        self.visit.insert(node);
        stack.push(Call { node, u: 0, v: 0, image, outer_visit });
    }

    fn fits(&self, u: &Neighbour, v: &Neighbour) -> bool {
        let label = |g: &SceneGraph, id| g.node(id).map(|n| n.label);
        let edge = !self.params.compare_predicates || (u.predicate == v.predicate && u.outward == v.outward);
        let free = !self.params.injective || self.map.iter().all(|(q, r)| *r != v.id || *q == u.id);
        edge && label(self.q.graph, u.id) == label(self.r.graph, v.id) && free
    }
}
