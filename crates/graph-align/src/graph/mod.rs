//! The scene graph: objects and what relates them.

mod others;
mod store;

use crate::footprint::Grid;
use crate::{Box3, Error, LabelId, PredicateId};
pub use others::Others;
use store::{Entry, Out, Store};

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
#[derive(Clone, Debug, Default)]
pub struct SceneGraph {
    nodes: Store,
    edges: usize,
}

impl PartialEq for SceneGraph {
    fn eq(&self, other: &Self) -> bool {
        self.nodes().eq(other.nodes()) && self.edges().eq(other.edges())
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
        self.nodes.insert(node);
    }

    /// Adds an edge; of two equal ones the higher score stays.
    ///
    /// # Errors
    /// An end that is not in the graph, or both ends the same.
    pub fn insert_edge(&mut self, e: Edge) -> Result<(), Error> {
        let bad = |problem| Err(Error::Edge { s: e.s.0, t: e.t.0, problem });
        if self.nodes.get(e.t).is_none() && self.nodes.get(e.s).is_some() {
            return bad("the object is not in the graph");
        }
        let Some(subject) = self.nodes.get_mut(e.s) else { return bad("the subject is not in the graph") };
        if e.s == e.t {
            return bad("joins a node with itself");
        }
        let first = subject.to(e.t).is_empty();
        let out = &mut subject.links().out;
        match out.binary_search_by(|o| (o.t, o.p).cmp(&(e.t, e.p))) {
            Ok(k) => out[k].score = out[k].score.max(e.score),
            Err(k) => {
                out.insert(k, Out { t: e.t, p: e.p, score: e.score });
                self.edges += 1;
            }
        }
        if first && let Some(object) = self.nodes.get_mut(e.t) {
            let from = &mut object.links().from;
            if let Err(k) = from.binary_search(&e.s) {
                from.insert(k, e.s);
            }
        }
        Ok(())
    }

    /// Takes a node out, with all its edges.
    pub fn remove_node(&mut self, id: NodeId) -> Option<Node> {
        self.remove_edges(id);
        self.nodes.remove(id).map(|e| e.node)
    }

    /// Takes out all edges that start or end at a node.
    pub fn remove_edges(&mut self, id: NodeId) {
        let Some(entry) = self.nodes.get_mut(id) else { return };
        let links = entry.take_links();
        self.edges -= links.out.len();
        for pair in links.out.chunk_by(|a, b| a.t == b.t) {
            self.forget_subject(pair[0].t, id);
        }
        for s in links.from {
            self.remove_out(s, |o| o.t == id);
        }
    }

    fn remove_out(&mut self, s: NodeId, gone: impl Fn(&Out) -> bool) {
        if let Some(subject) = self.nodes.get_mut(s) {
            let out = &mut subject.links().out;
            let before = out.len();
            out.retain(|o| !gone(o));
            self.edges -= before - out.len();
        }
    }

    /// No edge from `s` to `t` is left.
    fn forget_subject(&mut self, t: NodeId, s: NodeId) {
        if let Some(object) = self.nodes.get_mut(t)
            && let Ok(k) = object.from().binary_search(&s)
        {
            object.links().from.remove(k);
        }
    }

    /// Score of an edge, if it is there.
    #[must_use]
    pub fn edge(&self, s: NodeId, t: NodeId, p: PredicateId) -> Option<f32> {
        self.nodes.get(s)?.to(t).iter().find(|o| o.p == p).map(|o| o.score)
    }

    /// Takes out one edge.
    #[cfg(feature = "wire")]
    pub(crate) fn remove_edge(&mut self, e: &Edge) {
        self.remove_edges_if(e.s, e.t, |o| o.p == e.p);
    }

    /// Takes out the edges from one node to another, of every predicate.
    pub(crate) fn remove_edges_between(&mut self, s: NodeId, t: NodeId) {
        self.remove_edges_if(s, t, |_| true);
    }

    fn remove_edges_if(&mut self, s: NodeId, t: NodeId, gone: impl Fn(&Out) -> bool) {
        self.remove_out(s, |o| o.t == t && gone(o));
        if self.edges_between(s, t).next().is_none() {
            self.forget_subject(t, s);
        }
    }

    /// Edges from one node to another, of every predicate.
    pub(crate) fn edges_between(&self, s: NodeId, t: NodeId) -> impl Iterator<Item = Edge> + '_ {
        self.nodes.get(s).into_iter().flat_map(move |e| e.to(t).iter().map(move |o| edge(s, o)))
    }

    /// A node by its id.
    #[must_use]
    pub fn node(&self, id: NodeId) -> Option<&Node> {
        self.nodes.get(id).map(|e| &e.node)
    }

    /// A node by its id, to be changed; its id must stay.
    pub(crate) fn node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        self.nodes.get_mut(id).map(|e| &mut e.node)
    }

    /// Nodes in the order of their ids.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = &Node> + Clone {
        Counted { items: self.nodes.iter().map(|e| &e.node), left: self.nodes.len() }
    }

    /// Edges in the order (subject, object, predicate).
    pub fn edges(&self) -> impl ExactSizeIterator<Item = Edge> + Clone + '_ {
        let of = |e: &'_ Entry| e.node.id;
        let items = self.nodes.iter().flat_map(move |e| e.out().iter().map(move |o| edge(of(e), o)));
        Counted { items, left: self.edges }
    }

    /// Edges that start at a node.
    pub fn outgoing(&self, id: NodeId) -> impl Iterator<Item = Edge> + '_ {
        self.nodes.get(id).into_iter().flat_map(move |e| e.out().iter().map(move |o| edge(id, o)))
    }

    /// Edges that end at a node.
    pub fn incoming(&self, id: NodeId) -> impl Iterator<Item = Edge> + '_ {
        let subjects = self.nodes.get(id).into_iter().flat_map(|e| e.from());
        subjects.flat_map(move |&s| self.edges_between(s, id))
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
        if self.node(wanted).is_none() {
            return wanted;
        }
        let largest = self.nodes.last().map_or(0, |e| e.node.id.0);
        // With the largest possible id taken, the first gap will do.
        let after = largest.checked_add(1).map(NodeId);
        after.unwrap_or_else(|| (0..).map(NodeId).find(|id| self.node(*id).is_none()).unwrap_or(wanted))
    }

    /// The graph without nodes of the class `unnamed` and those below the probability `least` (up to
    /// the quantum of frames), and without their edges.
    #[must_use]
    pub fn named(&self, unnamed: Option<LabelId>, least: f32) -> Self {
        let mut out = Self::default();
        for n in self.nodes().filter(|n| Some(n.label) != unnamed && n.score + 0.5 / SCORE_STEPS >= least) {
            out.insert_node(n.clone());
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
        for entry in out.nodes.iter_mut() {
            if !entry.out().is_empty() {
                entry.links().out.iter_mut().for_each(|o| o.score = quantise_score(o.score));
            }
            let n = &mut entry.node;
            let (c, e) = (n.bounds.centroid(), n.bounds.extent());
            // Rounding keeps numbers finite and sides non-negative, so the box stays valid.
            if let Ok(b) = Box3::new([c.x, c.y, c.z].map(cm), [e.x, e.y, e.z].map(cm)) {
                let footprint = n.bounds.footprint().map(|f| Grid::of(&f).footprint());
                n.bounds = footprint.map_or(Ok(b), |f| b.with_footprint(f)).unwrap_or(b);
            }
            n.score = quantise_score(n.score);
            n.others = n.others.iter().map(|(l, p)| (l, quantise_score(p))).collect();
            n.last_seen = (n.last_seen * 10.0).round() / 10.0;
        }
        out
    }
}

/// What frames need beside nodes and edges: graphs as lists, in which a node has a place.
#[cfg(feature = "wire")]
impl SceneGraph {
    /// Of `n` nodes with rising ids, in no more memory than they take.
    pub(crate) fn rising(n: usize, next: impl FnMut() -> Result<Node, Error>) -> Result<Self, Error> {
        Ok(Self { nodes: Store::rising(n, next)?, edges: 0 })
    }

    /// All edges of a graph that was just made by [`Self::rising`], as places of its nodes, rising, each once:
    /// in no more memory than they take.
    pub(crate) fn fill(&mut self, edges: impl Iterator<Item = ([usize; 2], PredicateId, f32)> + Clone) {
        let (mut last, mut out) = (None, 0);
        let mut from = vec![0_u32; self.len()];
        let mut pairs = edges.clone().map(|e| e.0).peekable();
        while let Some(pair) = pairs.next() {
            out += 1;
            from[pair[1]] += u32::from(last.replace(pair) != Some(pair));
            if pairs.peek().is_none_or(|next| next[0] != pair[0])
                && let Some(subject) = self.nodes.at_mut(pair[0])
            {
                subject.links().out.reserve_exact(std::mem::take(&mut out));
            }
        }
        for (entry, from) in self.nodes.iter_mut().zip(from).filter(|(_, from)| *from > 0) {
            entry.links().from.reserve_exact(from as usize);
        }
        last = None;
        for (pair, p, score) in edges {
            let ends = pair.map(|k| self.nodes.id_at(k));
            let [Some(s), Some(t)] = ends else { continue };
            if let Some(subject) = self.nodes.at_mut(pair[0]) {
                subject.links().out.push(Out { t, p, score });
                self.edges += 1;
            }
            if last.replace(pair) != Some(pair)
                && let Some(object) = self.nodes.at_mut(pair[1])
            {
                object.links().from.push(s);
            }
        }
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
