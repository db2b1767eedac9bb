//! Nodes and the edges that start at them, in the order of their ids, in chunks.

use super::chunk::{CHUNK, Chunk, EDGES, Out};
use super::{Node, NodeId};
use crate::PredicateId;

/// A place in the store: chunk, and node within it.
#[derive(Clone, Copy)]
pub(super) struct Place {
    chunk: usize,
    node: usize,
}

/// A sorted list in chunks, none of them empty.
#[derive(Clone, Default)]
pub(super) struct Store {
    chunks: Vec<Chunk>,
    len: usize,
}

impl Store {
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Where an id is, or belongs.
    fn search(&self, id: NodeId) -> Result<Place, Place> {
        let chunk = self.chunks.partition_point(|c| c.nodes.last().is_some_and(|n| n.id < id));
        let Some(c) = self.chunks.get(chunk) else { return Err(Place { chunk, node: 0 }) };
        let place = |node| Place { chunk, node };
        c.nodes.binary_search_by(|n| n.id.cmp(&id)).map(place).map_err(place)
    }

    pub(super) fn find(&self, id: NodeId) -> Option<Place> {
        self.search(id).ok()
    }

    pub(super) fn node(&self, at: Place) -> Node {
        self.chunks[at.chunk].node(at.node)
    }

    /// Puts a node in, or replaces that of the same id and keeps its edges.
    pub(super) fn insert(&mut self, node: &Node) {
        let at = match self.search(node.id) {
            Ok(at) => {
                self.chunks[at.chunk].set(at.node, node);
                return;
            }
            Err(at) => at,
        };
        self.len += 1;
        let Some(chunk) = self.chunks.get_mut(at.chunk) else {
            // Behind all others: chunks that grow at their end are filled.
            if self.chunks.last().is_none_or(|l| l.nodes.len() == CHUNK) {
                self.chunks.push(Chunk::default());
            }
            if let Some(last) = self.chunks.last_mut() {
                last.insert(last.nodes.len(), node);
            }
            return;
        };
        chunk.insert(at.node, node);
        if chunk.nodes.len() > CHUNK {
            self.halve(at.chunk);
        }
    }

    fn halve(&mut self, chunk: usize) {
        let half = self.chunks[chunk].nodes.len() / 2;
        let half = self.chunks[chunk].split_off(half);
        self.chunks.insert(chunk + 1, half);
    }

    /// Takes a node out, and the edges that start at it.
    pub(super) fn remove(&mut self, at: Place) -> Node {
        let node = self.chunks[at.chunk].remove(at.node);
        self.len -= 1;
        let left = &self.chunks[at.chunk];
        let few = |next: &Chunk| {
            let (nodes, edges) = (next.nodes.len() + left.nodes.len(), next.out.len() + left.out.len());
            nodes <= CHUNK / 2 && edges <= EDGES / 2
        };
        if left.nodes.is_empty() {
            self.chunks.remove(at.chunk);
        } else if self.chunks.get(at.chunk + 1).is_some_and(few) {
            let next = self.chunks.remove(at.chunk + 1);
            self.chunks[at.chunk].append(next);
        }
        node
    }

    /// Changes all nodes, each by itself; their ids stay.
    pub(super) fn each(&mut self, mut change: impl FnMut(&mut Node)) {
        for chunk in &mut self.chunks {
            for k in 0..chunk.nodes.len() {
                let mut node = chunk.node(k);
                change(&mut node);
                chunk.set(k, &node);
            }
        }
    }

    pub(super) fn last(&self) -> Option<NodeId> {
        Some(self.chunks.last()?.nodes.last()?.id)
    }

    pub(super) fn nodes(&self) -> impl Iterator<Item = Node> + Clone {
        self.chunks.iter().flat_map(|c| (0..c.nodes.len()).map(|k| c.node(k)))
    }

    /// The edges that start at a node, in the order (object, predicate).
    pub(super) fn out(&self, at: Place) -> &[Out] {
        self.chunks[at.chunk].out(at.node)
    }

    /// The edges from one node to another, of every predicate.
    pub(super) fn to(&self, at: Place, t: NodeId) -> &[Out] {
        let out = self.out(at);
        let from = out.partition_point(|o| o.t < t);
        let n = out[from..].partition_point(|o| o.t == t);
        &out[from..from + n]
    }

    /// All edges with their subjects, in the order (subject, object, predicate).
    pub(super) fn edges(&self) -> impl Iterator<Item = (NodeId, &Out)> + Clone {
        self.chunks.iter().flat_map(|c| c.out.iter().map(|o| (c.nodes[usize::from(o.s)].id, o)))
    }

    /// Adds an edge, or raises its score; whether it is new.
    pub(super) fn relate(&mut self, at: Place, t: NodeId, p: PredicateId, score: f32) -> bool {
        let Chunk { nodes, out, .. } = &mut self.chunks[at.chunk];
        let s = at.node as u8;
        match out.binary_search_by(|o| (o.s, o.t, o.p).cmp(&(s, t, p))) {
            Ok(k) => {
                out[k].score = out[k].score.max(score);
                false
            }
            Err(k) => {
                out.insert(k, Out { t, score, p, s });
                if out.len() > EDGES && nodes.len() > 1 {
                    self.halve(at.chunk);
                }
                true
            }
        }
    }

    /// Takes out edges of a node; how many.
    pub(super) fn part(&mut self, at: Place, gone: impl Fn(&Out) -> bool) -> usize {
        let chunk = &mut self.chunks[at.chunk];
        let own = chunk.behind(at.node)..chunk.behind(at.node + 1);
        chunk.out.extract_if(own, |o| gone(o)).count()
    }

    /// Changes the scores of all edges.
    pub(super) fn each_score(&mut self, change: impl Fn(f32) -> f32) {
        self.chunks.iter_mut().flat_map(|c| &mut c.out).for_each(|o| o.score = change(o.score));
    }
}

/// What the wire needs: lists in the order of places.
#[cfg(any(feature = "wire", test))]
impl Store {
    /// Of `n` nodes with rising ids, in no more memory than they take: which have a footprint is known before.
    pub(super) fn rising<E>(
        n: usize,
        mut footprints: impl Iterator<Item = bool>,
        mut next: impl FnMut() -> Result<Node, E>,
    ) -> Result<Self, E> {
        let mut chunks = Vec::with_capacity(n.div_ceil(CHUNK));
        for from in (0..n).step_by(CHUNK) {
            let size = CHUNK.min(n - from);
            let there = footprints.by_ref().take(size).filter(|f| *f).count();
            let mut chunk = Chunk {
                nodes: Vec::with_capacity(size),
                footprints: Vec::with_capacity(there),
                out: Vec::new(),
            };
            for _ in 0..size {
                let packed = chunk.pack(&next()?);
                chunk.nodes.push(packed);
            }
            chunks.push(chunk);
        }
        Ok(Self { chunks, len: n })
    }

    /// Gives a list as [`Self::rising`] makes it all its edges: (subject, object) as places, predicate and score,
    /// rising, each once. Returns how many there were.
    pub(super) fn fill(
        &mut self,
        mut edges: impl Iterator<Item = ([usize; 2], PredicateId, f32)> + Clone,
    ) -> usize {
        let mut all = 0;
        for c in 0..self.chunks.len() {
            let here = edges.clone().take_while(|e| e.0[0] / CHUNK == c).count();
            let mut out = Vec::with_capacity(here);
            for ([s, t], p, score) in edges.by_ref().take(here) {
                let t = self.chunks[t / CHUNK].nodes[t % CHUNK].id;
                out.push(Out { t, score, p, s: (s % CHUNK) as u8 });
            }
            self.chunks[c].out = out;
            all += here;
        }
        all
    }

    /// Where the chunks begin in the list of all nodes.
    pub(super) fn starts(&self) -> Vec<u32> {
        let mut next = 0;
        let start = |c: &Chunk| {
            next += c.nodes.len() as u32;
            next - c.nodes.len() as u32
        };
        self.chunks.iter().map(start).collect()
    }

    /// The place of an id in the list of all nodes, given [`Self::starts`].
    pub(super) fn place(&self, id: NodeId, starts: &[u32]) -> Option<usize> {
        let at = self.find(id)?;
        Some(*starts.get(at.chunk)? as usize + at.node)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Box3, Footprint, LabelId};
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn node(id: u64, score: f32) -> Node {
        let bounds = Box3::new([0.0; 3], [1.0; 3]).expect("a box");
        // Some have a footprint, each its own.
        let round =
            (!(score as u32).is_multiple_of(3)).then(|| Footprint::rectangle([1.0 + score, 1.0], 0.0));
        let bounds = round.map_or(bounds, |f| bounds.with_footprint(f).expect("a footprint"));
        Node { score, ..Node::new(NodeId(id), LabelId(0), bounds) }
    }

    proptest! {
        /// It is an ordered map of nodes, whatever is put in and taken out, and one of the edges that start at them.
        #[test]
        fn as_ordered_maps(
            start in 0_u64..300,
            steps in prop::collection::vec((0_u8..4, 0_u64..600, 0_u64..600, 0_u16..3), 0..900),
        ) {
            let first = |k: u64| node(2 * k, k as f32);
            let mut next = (0..start).map(first);
            let there = (0..start).map(|k| first(k).bounds.footprint().is_some());
            let made = Store::rising(start as usize, there, || next.next().ok_or(()));
            let mut store = made.expect("as many nodes as asked for");
            let mut nodes: BTreeMap<u64, Node> = (0..start).map(|k| (2 * k, first(k))).collect();
            let mut edges: BTreeMap<(u64, u64, u16), f32> = BTreeMap::new();
            for (k, (what, id, t, p)) in steps.into_iter().enumerate() {
                let at = store.find(NodeId(id));
                prop_assert_eq!(at.map(|at| store.node(at)), nodes.get(&id).cloned());
                match (what, at) {
                    (0, Some(at)) => {
                        prop_assert_eq!(Some(store.remove(at)), nodes.remove(&id));
                        edges.retain(|e, _| e.0 != id);
                    }
                    (1, Some(at)) => {
                        let new = store.relate(at, NodeId(t), PredicateId(p), k as f32);
                        prop_assert_eq!(new, edges.insert((id, t, p), k as f32).is_none());
                    }
                    (2, Some(at)) => {
                        let there = edges.range((id, t, 0)..(id, t + 1, 0)).count();
                        prop_assert_eq!(store.to(at, NodeId(t)).len(), there);
                        prop_assert_eq!(store.part(at, |o| o.t == NodeId(t)), there);
                        edges.retain(|e, _| (e.0, e.1) != (id, t));
                    }
                    _ => {
                        store.insert(&node(id, k as f32));
                        nodes.insert(id, node(id, k as f32));
                    }
                }
            }
            prop_assert_eq!(store.len(), nodes.len());
            let whole = |c: &Chunk| (1..=CHUNK).contains(&c.nodes.len());
            prop_assert!(store.chunks.iter().all(whole));
            prop_assert!(store.nodes().eq(nodes.values().cloned()));
            prop_assert_eq!(store.last().map(|id| id.0), nodes.keys().last().copied());
            let out = |(s, o): (NodeId, &Out)| ((s.0, o.t.0, o.p.0), o.score);
            prop_assert!(store.edges().map(out).eq(edges.iter().map(|(e, score)| (*e, *score))));
            let starts = store.starts();
            for (place, id) in nodes.keys().enumerate() {
                prop_assert_eq!(store.place(NodeId(*id), &starts), Some(place));
            }
            // No footprint is kept that no node has.
            let kept: usize = store.chunks.iter().map(|c| c.footprints.len()).sum();
            prop_assert_eq!(kept, nodes.values().filter(|n| n.bounds.footprint().is_some()).count());
        }

        /// Filled with lists, it is what single insertions make.
        #[test]
        fn filled_as_one_by_one(n in 1_usize..200, edges in prop::collection::btree_set((0_usize..200, 0_usize..200, 0_u16..2), 0..600)) {
            let make = |k: usize| node(3 * k as u64, k as f32);
            let mut at = 0;
            let there = (0..n).map(|k| make(k).bounds.footprint().is_some());
            let next = || { at += 1; Ok::<_, ()>(make(at - 1)) };
            let mut filled = Store::rising(n, there, next).expect("no errors");
            let edges: Vec<_> = edges.into_iter().filter(|e| e.0.max(e.1) < n).collect();
            prop_assert_eq!(filled.fill(edges.iter().map(|&(s, t, p)| ([s, t], PredicateId(p), 0.5))), edges.len());
            let mut store = Store::default();
            (0..n).for_each(|k| store.insert(&make(k)));
            for &(s, t, p) in &edges {
                let at = store.find(make(s).id).expect("its subject");
                prop_assert!(store.relate(at, make(t).id, PredicateId(p), 0.5));
            }
            prop_assert!(filled.nodes().eq(store.nodes()));
            prop_assert!(filled.edges().map(|(s, o)| (s, o.t, o.p)).eq(store.edges().map(|(s, o)| (s, o.t, o.p))));
        }
    }
}
