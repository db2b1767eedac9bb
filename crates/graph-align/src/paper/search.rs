//! GRAPHSEARCH: growing a map from an anchor along edges.

use super::PaperParams;
use crate::{LabelId, Node, NodeId, PredicateId, SceneGraph};
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
    label: LabelId,
    predicate: PredicateId,
    /// True when the edge starts at the node whose list this is.
    outward: bool,
}

/// Nodes with what the search needs of them, in an order that does not depend on ids.
struct Adjacency {
    lists: BTreeMap<NodeId, Vec<Neighbour>>,
    order: Vec<(NodeId, LabelId)>,
}

impl Adjacency {
    fn new(graph: &SceneGraph) -> Self {
        let mut nodes: Vec<Node> = graph.nodes().collect();
        nodes.sort_by(by_content);
        let ranks: BTreeMap<NodeId, usize> = nodes.iter().enumerate().map(|(k, n)| (n.id, k)).collect();
        // Both ends of an edge are in the graph.
        let rank = |id| ranks.get(&id).copied().unwrap_or(0);
        let step =
            |id, predicate, outward| Neighbour { id, label: nodes[rank(id)].label, predicate, outward };
        let list = |n: &Node| {
            let out = graph.outgoing(n.id).map(|e| step(e.t, e.p, true));
            let inc = graph.incoming(n.id).map(|e| step(e.s, e.p, false));
            let mut list: Vec<_> = out.chain(inc).collect();
            list.sort_by_key(|n| (rank(n.id), n.predicate, n.outward));
            (n.id, list)
        };
        let lists = nodes.iter().map(list).collect();
        Self { lists, order: nodes.iter().map(|n| (n.id, n.label)).collect() }
    }

    fn of(&self, id: NodeId) -> &[Neighbour] {
        self.lists.get(&id).map_or(&[], Vec::as_slice)
    }
}

/// Order by class, place, size and score; ids decide between nodes that are equal in all of them.
fn by_content(a: &Node, b: &Node) -> Ordering {
    let numbers = |n: &Node| {
        let (c, e) = (n.bounds.centroid(), n.bounds.extent());
        [c.x, c.y, c.z, e.x, e.y, e.z, n.score]
    };
    let (x, y) = (numbers(a), numbers(b));
    let differ = x.iter().zip(&y).map(|(x, y)| x.total_cmp(y)).find(|o| o.is_ne());
    a.label.cmp(&b.label).then(differ.unwrap_or(Ordering::Equal)).then(a.id.cmp(&b.id))
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
    for (anchor, label) in anchors {
        for &(candidate, _) in r.order.iter().filter(|c| c.1 == label) {
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
    q: &'a Adjacency,
    r: &'a Adjacency,
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
        let edge = !self.params.compare_predicates || (u.predicate == v.predicate && u.outward == v.outward);
        let free = !self.params.injective || self.map.iter().all(|(q, r)| *r != v.id || *q == u.id);
        edge && u.label == v.label && free
    }
}
