//! Nodes with their edges, in the order of their ids, in little more memory than they take themselves.

use super::{Node, NodeId};
use crate::PredicateId;

/// Most nodes of a chunk: what an insertion moves at most.
const CHUNK: usize = 64;

/// An edge as its subject holds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Out {
    pub t: NodeId,
    pub p: PredicateId,
    pub score: f32,
}

/// The edges of a node.
#[derive(Clone, Debug, Default)]
pub(super) struct Links {
    /// Those that start here, in the order (object, predicate).
    pub out: Vec<Out>,
    /// Subjects of those that end here, rising, each once.
    pub from: Vec<NodeId>,
}

/// A node and its edges.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub node: Node,
    /// Many have none.
    links: Option<Box<Links>>,
}

impl Entry {
    fn new(node: Node) -> Self {
        Self { node, links: None }
    }

    /// Edges that start here, in the order (object, predicate).
    pub(super) fn out(&self) -> &[Out] {
        self.links.as_ref().map_or(&[], |l| &l.out)
    }

    /// Subjects of edges that end here, rising, each once.
    pub(super) fn from(&self) -> &[NodeId] {
        self.links.as_ref().map_or(&[], |l| &l.from)
    }

    /// The edges to one node, of every predicate.
    pub(super) fn to(&self, t: NodeId) -> &[Out] {
        let out = self.out();
        let from = out.partition_point(|o| o.t < t);
        let n = out[from..].partition_point(|o| o.t == t);
        &out[from..from + n]
    }

    /// The edges, to be changed.
    pub(super) fn links(&mut self) -> &mut Links {
        self.links.get_or_insert_default()
    }

    /// The edges, of which the node has none any more.
    pub(super) fn take_links(&mut self) -> Links {
        self.links.take().map(|l| *l).unwrap_or_default()
    }
}

/// A sorted list in chunks, none of them empty.
#[derive(Clone, Debug, Default)]
pub(super) struct Store {
    chunks: Vec<Vec<Entry>>,
    len: usize,
}

impl Store {
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Chunk and place in it of an id, or where it belongs.
    fn find(&self, id: NodeId) -> Result<(usize, usize), (usize, usize)> {
        let c = self.chunks.partition_point(|c| c.last().is_some_and(|e| e.node.id < id));
        let Some(chunk) = self.chunks.get(c) else { return Err((c, 0)) };
        match chunk.binary_search_by(|e| e.node.id.cmp(&id)) {
            Ok(k) => Ok((c, k)),
            Err(k) => Err((c, k)),
        }
    }

    pub(super) fn get(&self, id: NodeId) -> Option<&Entry> {
        self.find(id).ok().map(|(c, k)| &self.chunks[c][k])
    }

    pub(super) fn get_mut(&mut self, id: NodeId) -> Option<&mut Entry> {
        self.find(id).ok().map(|(c, k)| &mut self.chunks[c][k])
    }

    /// Puts a node in, or replaces that of the same id and keeps its edges.
    pub(super) fn insert(&mut self, node: Node) {
        let (c, k) = match self.find(node.id) {
            Ok((c, k)) => {
                self.chunks[c][k].node = node;
                return;
            }
            Err(place) => place,
        };
        self.len += 1;
        let last = self.chunks.len();
        let Some(chunk) = self.chunks.get_mut(c) else {
            // Behind all others: chunks that grow at their end are filled.
            match self.chunks.last_mut().filter(|l| l.len() < CHUNK) {
                Some(l) => l.push(Entry::new(node)),
                None => self.chunks.insert(last, vec![Entry::new(node)]),
            }
            return;
        };
        chunk.insert(k, Entry::new(node));
        if chunk.len() > CHUNK {
            let half = chunk.split_off(chunk.len() / 2);
            self.chunks.insert(c + 1, half);
        }
    }

    pub(super) fn remove(&mut self, id: NodeId) -> Option<Entry> {
        let (c, k) = self.find(id).ok()?;
        let entry = self.chunks[c].remove(k);
        self.len -= 1;
        let left = self.chunks[c].len();
        if left == 0 {
            self.chunks.remove(c);
        } else if self.chunks.get(c + 1).is_some_and(|n| n.len() + left <= CHUNK / 2) {
            let next = self.chunks.remove(c + 1);
            self.chunks[c].extend(next);
        }
        Some(entry)
    }

    pub(super) fn last(&self) -> Option<&Entry> {
        self.chunks.last()?.last()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Entry> + Clone {
        self.chunks.iter().flatten()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Entry> {
        self.chunks.iter_mut().flatten()
    }
}

/// What the wire needs: lists in the order of places.
#[cfg(any(feature = "wire", test))]
impl Store {
    /// Of `n` nodes with rising ids.
    pub(super) fn rising<E>(n: usize, mut next: impl FnMut() -> Result<Node, E>) -> Result<Self, E> {
        let mut chunks = Vec::with_capacity(n.div_ceil(CHUNK));
        for from in (0..n).step_by(CHUNK) {
            let mut chunk = Vec::with_capacity(CHUNK.min(n - from));
            for _ in from..n.min(from + CHUNK) {
                chunk.push(Entry::new(next()?));
            }
            chunks.push(chunk);
        }
        Ok(Self { chunks, len: n })
    }

    /// Where the chunks begin in the list of all nodes.
    pub(super) fn starts(&self) -> Vec<u32> {
        let mut next = 0;
        let start = |c: &Vec<Entry>| {
            next += c.len() as u32;
            next - c.len() as u32
        };
        self.chunks.iter().map(start).collect()
    }

    /// The place of an id in the list of all nodes, given [`Self::starts`].
    pub(super) fn place(&self, id: NodeId, starts: &[u32]) -> Option<usize> {
        let (c, k) = self.find(id).ok()?;
        Some(*starts.get(c)? as usize + k)
    }

    /// The entry at a place of a list as [`Self::rising`] makes it.
    pub(super) fn at_mut(&mut self, place: usize) -> Option<&mut Entry> {
        self.chunks.get_mut(place / CHUNK)?.get_mut(place % CHUNK)
    }

    /// The id at a place of such a list.
    pub(super) fn id_at(&self, place: usize) -> Option<NodeId> {
        Some(self.chunks.get(place / CHUNK)?.get(place % CHUNK)?.node.id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Box3, LabelId};
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn node(id: u64, score: f32) -> Node {
        let bounds = Box3::new([0.0; 3], [1.0; 3]).expect("a box");
        Node { score, ..Node::new(NodeId(id), LabelId(0), bounds) }
    }

    proptest! {
        /// It is an ordered map, whatever is put in and taken out.
        #[test]
        fn as_an_ordered_map(
            start in 0_u64..300,
            steps in prop::collection::vec((any::<bool>(), 0_u64..600), 0..900),
        ) {
            let mut store = Store::rising(start as usize, {
                let mut k = 0;
                move || { k += 2; Ok::<_, ()>(node(k - 2, 0.0)) }
            }).expect("no errors");
            let mut map: BTreeMap<u64, f32> = (0..start).map(|k| (2 * k, 0.0)).collect();
            for (k, (put, id)) in steps.into_iter().enumerate() {
                if put {
                    store.insert(node(id, k as f32));
                    map.insert(id, k as f32);
                } else {
                    prop_assert_eq!(store.remove(NodeId(id)).map(|e| e.node.score), map.remove(&id));
                }
                prop_assert_eq!(store.get(NodeId(id)).map(|e| e.node.score), map.get(&id).copied());
            }
            prop_assert_eq!(store.len(), map.len());
            prop_assert!(store.chunks.iter().all(|c| (1..=CHUNK).contains(&c.len())));
            let starts = store.starts();
            for (place, (e, (id, score))) in store.iter().zip(&map).enumerate() {
                prop_assert_eq!((e.node.id.0, e.node.score), (*id, *score));
                prop_assert_eq!(store.place(e.node.id, &starts), Some(place));
            }
            prop_assert_eq!(store.iter().count(), map.len());
            prop_assert_eq!(store.last().map(|e| e.node.id.0), map.keys().last().copied());
        }
    }
}
