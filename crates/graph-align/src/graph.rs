//! The scene graph: objects and what relates them.

use crate::{Box3, Error, Footprint, LabelId, PredicateId};
use std::collections::{BTreeMap, BTreeSet};
use std::f32::consts::FRAC_PI_2;

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
    /// The next best classes and their probabilities, falling, at most [`Node::MAX_OTHERS`].
    pub others: Vec<(LabelId, f32)>,
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
        Self { id, label, score: 1.0, bounds, others: Vec::new(), sightings: 1, misses: 0, last_seen: 0.0 }
    }

    /// The best class and the others, with their probabilities.
    pub fn classes(&self) -> impl Iterator<Item = (LabelId, f32)> + '_ {
        std::iter::once((self.label, self.score)).chain(self.others.iter().copied())
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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneGraph {
    nodes: BTreeMap<NodeId, Node>,
    edges: BTreeMap<(NodeId, NodeId, PredicateId), f32>,
    /// (object, subject, predicate): the same edges from their other end.
    incoming: BTreeSet<(NodeId, NodeId, PredicateId)>,
}

impl SceneGraph {
    /// Adds a node, or replaces the one of the same id and keeps its edges.
    pub fn insert_node(&mut self, node: Node) {
        self.nodes.insert(node.id, node);
    }

    /// Adds an edge; of two equal ones the higher score stays.
    ///
    /// # Errors
    /// An end that is not in the graph, or both ends the same.
    pub fn insert_edge(&mut self, e: Edge) -> Result<(), Error> {
        let problem = if !self.nodes.contains_key(&e.s) {
            "the subject is not in the graph"
        } else if !self.nodes.contains_key(&e.t) {
            "the object is not in the graph"
        } else if e.s == e.t {
            "joins a node with itself"
        } else {
            let score = self.edges.entry((e.s, e.t, e.p)).or_insert(e.score);
            *score = score.max(e.score);
            self.incoming.insert((e.t, e.s, e.p));
            return Ok(());
        };
        Err(Error::Edge { s: e.s.0, t: e.t.0, problem })
    }

    /// Takes a node out, with all its edges.
    pub fn remove_node(&mut self, id: NodeId) -> Option<Node> {
        let node = self.nodes.remove(&id)?;
        self.remove_edges(id);
        Some(node)
    }

    /// Takes out all edges that start or end at a node.
    pub fn remove_edges(&mut self, id: NodeId) {
        let edges: Vec<_> = self.outgoing(id).chain(self.incoming(id)).map(|e| (e.s, e.t, e.p)).collect();
        for (s, t, p) in edges {
            self.edges.remove(&(s, t, p));
            self.incoming.remove(&(t, s, p));
        }
    }

    /// Score of an edge, if it is there.
    #[must_use]
    pub fn edge(&self, s: NodeId, t: NodeId, p: PredicateId) -> Option<f32> {
        self.edges.get(&(s, t, p)).copied()
    }

    /// Takes out one edge.
    pub(crate) fn remove_edge(&mut self, e: &Edge) {
        self.edges.remove(&(e.s, e.t, e.p));
        self.incoming.remove(&(e.t, e.s, e.p));
    }

    /// Edges from one node to another, of every predicate.
    pub(crate) fn edges_between(&self, s: NodeId, t: NodeId) -> impl Iterator<Item = Edge> + '_ {
        self.edges
            .range((s, t, PredicateId(0))..=(s, t, PredicateId(u16::MAX)))
            .map(|(&(s, t, p), &score)| Edge { s, t, p, score })
    }

    /// Takes out the edges from one node to another, of every predicate.
    pub(crate) fn remove_edges_between(&mut self, s: NodeId, t: NodeId) {
        let range = (s, t, PredicateId(0))..=(s, t, PredicateId(u16::MAX));
        let gone: Vec<_> = self.edges.range(range).map(|(k, _)| *k).collect();
        for (s, t, p) in gone {
            self.edges.remove(&(s, t, p));
            self.incoming.remove(&(t, s, p));
        }
    }

    /// A node by its id.
    #[must_use]
    pub fn node(&self, id: NodeId) -> Option<&Node> {
        self.nodes.get(&id)
    }

    /// A node by its id, to be changed; its id must stay.
    pub(crate) fn node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        self.nodes.get_mut(&id)
    }

    /// Nodes in the order of their ids.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = &Node> {
        self.nodes.values()
    }

    /// Edges in the order (subject, object, predicate).
    pub fn edges(&self) -> impl ExactSizeIterator<Item = Edge> + '_ {
        self.edges.iter().map(|(&(s, t, p), &score)| Edge { s, t, p, score })
    }

    /// Edges that start at a node.
    pub fn outgoing(&self, id: NodeId) -> impl Iterator<Item = Edge> + '_ {
        self.edges
            .range((id, NodeId(0), PredicateId(0))..=(id, NodeId(u64::MAX), PredicateId(u16::MAX)))
            .map(|(&(s, t, p), &score)| Edge { s, t, p, score })
    }

    /// Edges that end at a node.
    pub fn incoming(&self, id: NodeId) -> impl Iterator<Item = Edge> + '_ {
        self.incoming
            .range((id, NodeId(0), PredicateId(0))..=(id, NodeId(u64::MAX), PredicateId(u16::MAX)))
            .filter_map(|&(t, s, p)| Some(Edge { s, t, p, score: *self.edges.get(&(s, t, p))? }))
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// True without nodes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// An id that no node has: `wanted` if it is free, else the one after the largest.
    #[must_use]
    pub fn free_id(&self, wanted: NodeId) -> NodeId {
        if !self.nodes.contains_key(&wanted) {
            return wanted;
        }
        let largest = self.nodes.last_key_value().map_or(0, |(id, _)| id.0);
        // With the largest possible id taken, the first gap will do.
        let after = largest.checked_add(1).map(NodeId);
        after.unwrap_or_else(|| (0..).map(NodeId).find(|id| !self.nodes.contains_key(id)).unwrap_or(wanted))
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
        for n in out.nodes.values_mut() {
            let (c, e) = (n.bounds.centroid(), n.bounds.extent());
            // Rounding keeps numbers finite and sides non-negative, so the box stays valid.
            if let Ok(b) = Box3::new([c.x, c.y, c.z].map(cm), [e.x, e.y, e.z].map(cm)) {
                let footprint = n.bounds.footprint().map(quantise_footprint);
                n.bounds = footprint.map_or(Ok(b), |f| b.with_footprint(f)).unwrap_or(b);
            }
            n.score = quantise_score(n.score);
            n.others.iter_mut().for_each(|o| o.1 = quantise_score(o.1));
            n.last_seen = (n.last_seen * 10.0).round() / 10.0;
        }
        out.edges.values_mut().for_each(|s| *s = quantise_score(*s));
        out
    }
}

/// Steps of a probability in frames.
pub(crate) const SCORE_STEPS: f32 = 127.0;

/// Steps of a quarter turn in frames.
pub(crate) const YAW_STEPS: f32 = 1023.0;

pub(crate) fn quantise_footprint(f: Footprint) -> Footprint {
    let cm = |v: f32| ((f64::from(v) * 100.0).round() / 100.0) as f32;
    let step = (f.yaw / FRAC_PI_2 * YAW_STEPS).round();
    Footprint { sides: f.sides.map(cm), yaw: yaw_of(step as u16) }
}

/// The yaw of a step.
pub(crate) fn yaw_of(step: u16) -> f32 {
    (f32::from(step) / YAW_STEPS * FRAC_PI_2).min(FRAC_PI_2)
}

pub(crate) fn quantise_score(s: f32) -> f32 {
    (s.clamp(0.0, 1.0) * SCORE_STEPS).round() / SCORE_STEPS
}
