//! The scene graph: objects and what relates them.

mod chunk;
mod others;
mod store;

use crate::footprint::Grid;
use crate::{Box3, Error, LabelId, PredicateId};
use chunk::Out;
pub use others::Others;
use std::collections::BTreeSet;
use std::fmt;
use std::sync::OnceLock;
use store::Store;

/// Names a node within one graph.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u64);

/// One object.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Unique within its graph.
    pub id: NodeId,
    /// Most probable class.
    pub label: LabelId,
    /// Probability of `label`, 0 to 1.
    pub score: f32,
    /// Place and size.
    pub bounds: Box3,
    /// The next best classes and their probabilities, falling.
    pub others: Others,
    /// How often it was observed, over visits.
    pub sightings: u32,
    /// Visits that looked at its place and did not observe it.
    pub misses: u32,
    /// When it was last observed, seconds.
    pub last_seen: f64,
}

impl Node {
    /// Most further classes of a node.
    pub const MAX_OTHERS: usize = 2;

    /// A node that was observed once, at time 0, with full confidence.
    #[must_use]
    pub fn new(id: NodeId, label: LabelId, bounds: Box3) -> Self {
        Self {
            id,
            label,
            score: 1.0,
            bounds,
            others: Others::default(),
            sightings: 1,
            misses: 0,
            last_seen: 0.0,
        }
    }

    /// The best class and the others, with their probabilities.
    pub fn classes(&self) -> impl Iterator<Item = (LabelId, f32)> + '_ {
        std::iter::once((self.label, self.score)).chain(self.others.iter())
    }
}

/// "`s` `p` `t`", for example "chair standing on floor".
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Subject.
    pub s: NodeId,
    /// Object.
    pub t: NodeId,
    /// Predicate.
    pub p: PredicateId,
    /// Probability, 0 to 1.
    pub score: f32,
}

/// Nodes in the order of their ids, edges in the order (subject, object, predicate), each edge once
/// and only between nodes that are there.
#[derive(Clone, Default)]
pub struct SceneGraph {
    nodes: Store,
    edges: usize,
    /// Object and subject of all pairs with an edge, from the first time that it is asked for: graphs that are only
    /// read and sent do without.
    pairs: OnceLock<BTreeSet<(NodeId, NodeId)>>,
}

impl PartialEq for SceneGraph {
    fn eq(&self, other: &Self) -> bool {
        self.nodes().eq(other.nodes()) && self.edges().eq(other.edges())
    }
}

impl fmt::Debug for SceneGraph {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (nodes, edges): (Vec<Node>, Vec<Edge>) = (self.nodes().collect(), self.edges().collect());
        f.debug_struct("SceneGraph").field("nodes", &nodes).field("edges", &edges).finish()
    }
}

/// An iterator over so many.
#[derive(Clone)]
struct Counted<I> {
    items: I,
    left: usize,
}

impl<I: Iterator> Iterator for Counted<I> {
    type Item = I::Item;

    fn next(&mut self) -> Option<I::Item> {
        self.left = self.left.saturating_sub(1);
        self.items.next()
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        (self.left, Some(self.left))
    }
}

impl<I: Iterator> ExactSizeIterator for Counted<I> {}

fn edge(s: NodeId, o: &Out) -> Edge {
    Edge { s, t: o.t, p: o.p, score: o.score }
}

impl SceneGraph {
    /// Adds a node, or replaces the one of the same id and keeps its edges.
    pub fn insert_node(&mut self, node: Node) {
        self.nodes.insert(&node);
    }

    /// Adds an edge; of two equal ones the higher score stays.
    ///
    /// # Errors
    /// An end that is not in the graph, or both ends the same.
    pub fn insert_edge(&mut self, e: Edge) -> Result<(), Error> {
        let bad = |problem| Err(Error::Edge { s: e.s.0, t: e.t.0, problem });
        let Some(subject) = self.nodes.find(e.s) else { return bad("the subject is not in the graph") };
        if self.nodes.find(e.t).is_none() {
            return bad("the object is not in the graph");
        }
        if e.s == e.t {
            return bad("joins a node with itself");
        }
        if self.nodes.relate(subject, e.t, e.p, e.score) {
            self.edges += 1;
            if let Some(pairs) = self.pairs.get_mut() {
                pairs.insert((e.t, e.s));
            }
        }
        Ok(())
    }

    /// Takes a node out, with all its edges.
    pub fn remove_node(&mut self, id: NodeId) -> Option<Node> {
        self.remove_edges(id);
        let at = self.nodes.find(id)?;
        Some(self.nodes.remove(at))
    }

    /// Takes out all edges that start or end at a node.
    pub fn remove_edges(&mut self, id: NodeId) {
        let subjects: Vec<NodeId> = self.subjects(id).collect();
        for s in subjects {
            self.remove_edges_between(s, id);
        }
        let objects: Vec<NodeId> = self.outgoing(id).map(|e| e.t).collect();
        if let Some(at) = self.nodes.find(id) {
            self.edges -= self.nodes.part(at, |_| true);
        }
        if let Some(pairs) = self.pairs.get_mut() {
            objects.into_iter().for_each(|t| {
                pairs.remove(&(t, id));
            });
        }
    }

    /// Those from which an edge leads to a node, rising, each once.
    fn subjects(&self, t: NodeId) -> impl Iterator<Item = NodeId> + '_ {
        let pairs = self.pairs.get_or_init(|| self.edges().map(|e| (e.t, e.s)).collect());
        pairs.range((t, NodeId(0))..=(t, NodeId(u64::MAX))).map(|p| p.1)
    }

    /// Score of an edge, if it is there.
    #[must_use]
    pub fn edge(&self, s: NodeId, t: NodeId, p: PredicateId) -> Option<f32> {
        self.edges_between(s, t).find(|e| e.p == p).map(|e| e.score)
    }

    /// Takes out one edge.
    #[cfg(feature = "wire")]
    pub(crate) fn remove_edge(&mut self, e: &Edge) {
        self.remove_edges_if(e.s, e.t, |p| p == e.p);
    }

    /// Takes out the edges from one node to another, of every predicate.
    pub(crate) fn remove_edges_between(&mut self, s: NodeId, t: NodeId) {
        self.remove_edges_if(s, t, |_| true);
    }

    fn remove_edges_if(&mut self, s: NodeId, t: NodeId, gone: impl Fn(PredicateId) -> bool) {
        let Some(at) = self.nodes.find(s) else { return };
        self.edges -= self.nodes.part(at, |o| o.t == t && gone(o.p));
        if self.nodes.to(at, t).is_empty()
            && let Some(pairs) = self.pairs.get_mut()
        {
            pairs.remove(&(t, s));
        }
    }

    /// Edges from one node to another, of every predicate.
    pub(crate) fn edges_between(&self, s: NodeId, t: NodeId) -> impl Iterator<Item = Edge> + '_ {
        let out = self.nodes.find(s).map_or(&[][..], |at| self.nodes.to(at, t));
        out.iter().map(move |o| edge(s, o))
    }

    /// A node by its id.
    #[must_use]
    pub fn node(&self, id: NodeId) -> Option<Node> {
        self.nodes.find(id).map(|at| self.nodes.node(at))
    }

    /// True with a node of this id.
    #[must_use]
    pub fn has_node(&self, id: NodeId) -> bool {
        self.nodes.find(id).is_some()
    }

    /// Changes a node, whose id must stay; nothing where there is none.
    pub(crate) fn change_node(&mut self, id: NodeId, change: impl FnOnce(&mut Node)) {
        if let Some(mut node) = self.node(id) {
            change(&mut node);
            self.nodes.insert(&node);
        }
    }

    /// Nodes in the order of their ids.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = Node> + Clone + '_ {
        Counted { items: self.nodes.nodes(), left: self.nodes.len() }
    }

    /// Edges in the order (subject, object, predicate).
    pub fn edges(&self) -> impl ExactSizeIterator<Item = Edge> + Clone + '_ {
        Counted { items: self.nodes.edges().map(|(s, o)| edge(s, o)), left: self.edges }
    }

    /// Edges that start at a node.
    pub fn outgoing(&self, id: NodeId) -> impl Iterator<Item = Edge> + '_ {
        let out = self.nodes.find(id).map_or(&[][..], |at| self.nodes.out(at));
        out.iter().map(move |o| edge(id, o))
    }

    /// Edges that end at a node.
    pub fn incoming(&self, id: NodeId) -> impl Iterator<Item = Edge> + '_ {
        self.subjects(id).flat_map(move |s| self.edges_between(s, id))
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// True without nodes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// An id that no node has: `wanted` if it is free, else the one after the largest.
    #[must_use]
    pub fn free_id(&self, wanted: NodeId) -> NodeId {
        if !self.has_node(wanted) {
            return wanted;
        }
        let largest = self.nodes.last().map_or(0, |id| id.0);
        // With the largest possible id taken, the first gap will do.
        let after = largest.checked_add(1).map(NodeId);
        after.unwrap_or_else(|| (0..).map(NodeId).find(|id| !self.has_node(*id)).unwrap_or(wanted))
    }

    /// The graph without nodes of the class `unnamed` and those below the probability `least` (up to
    /// the quantum of frames), and without their edges.
    #[must_use]
    pub fn named(&self, unnamed: Option<LabelId>, least: f32) -> Self {
        let mut out = Self::default();
        for n in self.nodes().filter(|n| Some(n.label) != unnamed && n.score + 0.5 / SCORE_STEPS >= least) {
            out.insert_node(n);
        }
        for e in self.edges() {
            // Edges to what was left out go with it.
            let _ = out.insert_edge(e);
        }
        out
    }

    /// The graph as it travels: lengths rounded to 1 cm, scores to 1/127, times to 0.1 s.
    #[must_use]
    pub fn quantised(&self) -> Self {
        let mut out = self.clone();
        let cm = |v: f32| ((f64::from(v) * 100.0).round() / 100.0) as f32;
        out.nodes.each_score(quantise_score);
        out.nodes.each(|n| {
            let (c, e) = (n.bounds.centroid(), n.bounds.extent());
            // Rounding keeps numbers finite and sides non-negative, so the box stays valid.
            if let Ok(b) = Box3::new([c.x, c.y, c.z].map(cm), [e.x, e.y, e.z].map(cm)) {
                let footprint = n.bounds.footprint().map(|f| Grid::of(&f).footprint());
                n.bounds = footprint.map_or(Ok(b), |f| b.with_footprint(f)).unwrap_or(b);
            }
            n.score = quantise_score(n.score);
            n.others = n.others.iter().map(|(l, p)| (l, quantise_score(p))).collect();
            n.last_seen = (n.last_seen * 10.0).round() / 10.0;
        });
        out
    }
}

/// What frames need beside nodes and edges: graphs as lists, in which a node has a place.
#[cfg(feature = "wire")]
impl SceneGraph {
    /// Bytes of a node but for its footprint, and of an edge.
    pub(crate) const NODE_MEMORY: usize = size_of::<chunk::Packed>();
    pub(crate) const EDGE_MEMORY: usize = size_of::<Out>();

    /// Of `n` nodes with rising ids, of which it is known before which have a footprint, in no more memory than they
    /// take.
    pub(crate) fn rising(
        n: usize,
        footprints: impl Iterator<Item = bool>,
        next: impl FnMut() -> Result<Node, Error>,
    ) -> Result<Self, Error> {
        Ok(Self { nodes: Store::rising(n, footprints, next)?, ..Self::default() })
    }

    /// All edges of a graph that was just made by [`Self::rising`], as places of its nodes, rising, each once:
    /// in no more memory than they take.
    pub(crate) fn fill(&mut self, edges: impl Iterator<Item = ([usize; 2], PredicateId, f32)> + Clone) {
        self.edges = self.nodes.fill(edges);
    }

    /// The place of a node in the list of all nodes.
    pub(crate) fn places(&self) -> impl Fn(NodeId) -> Option<usize> + '_ {
        let starts = self.nodes.starts();
        move |id| self.nodes.place(id, &starts)
    }
}

/// Steps of a probability in frames.
pub(crate) const SCORE_STEPS: f32 = 127.0;

pub(crate) fn quantise_score(s: f32) -> f32 {
    (s.clamp(0.0, 1.0) * SCORE_STEPS).round() / SCORE_STEPS
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Edges are known from both ends, whenever it is asked first.
        #[test]
        fn edges_are_known_from_both_ends(
            steps in prop::collection::vec((0_u8..8, 0_u64..9, 0_u64..9, 0_u16..2), 0..120),
            asked in 0_usize..120,
        ) {
            let mut graph = SceneGraph::default();
            let mut nodes: BTreeSet<u64> = BTreeSet::new();
            let mut edges: BTreeSet<(u64, u64, u16)> = BTreeSet::new();
            for (k, (what, s, t, p)) in steps.into_iter().enumerate() {
                if k == asked {
                    let _ = graph.incoming(NodeId(t)).count();
                }
                match what {
                    0 => {
                        prop_assert_eq!(graph.remove_node(NodeId(s)).is_some(), nodes.remove(&s));
                        edges.retain(|e| e.0 != s && e.1 != s);
                    }
                    1 => {
                        graph.remove_edges(NodeId(s));
                        edges.retain(|e| e.0 != s && e.1 != s);
                    }
                    2 => {
                        graph.remove_edges_between(NodeId(s), NodeId(t));
                        edges.retain(|e| (e.0, e.1) != (s, t));
                    }
                    3 | 4 => {
                        let bounds = Box3::new([0.0; 3], [1.0; 3]).expect("a box");
                        graph.insert_node(Node::new(NodeId(s), LabelId(0), bounds));
                        nodes.insert(s);
                    }
                    _ => {
                        let e = Edge { s: NodeId(s), t: NodeId(t), p: PredicateId(p), score: 1.0 };
                        let fits = s != t && nodes.contains(&s) && nodes.contains(&t);
                        prop_assert_eq!(graph.insert_edge(e).is_ok(), fits);
                        if fits {
                            edges.insert((s, t, p));
                        }
                    }
                }
            }
            let plain = |e: Edge| (e.s.0, e.t.0, e.p.0);
            prop_assert!(graph.edges().map(plain).eq(edges.iter().copied()));
            prop_assert_eq!(graph.edges().len(), edges.len());
            for id in 0..9 {
                let of = |end: fn(&(u64, u64, u16)) -> u64| edges.iter().copied().filter(move |e| end(e) == id);
                prop_assert!(graph.incoming(NodeId(id)).map(plain).eq(of(|e| e.1)));
                prop_assert!(graph.outgoing(NodeId(id)).map(plain).eq(of(|e| e.0)));
            }
        }
    }
}
