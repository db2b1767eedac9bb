//! Some nodes with the edges that start at them, in little more memory than their numbers take: 72 bytes a node, 36 its
//! footprint, 16 an edge. `docs/wire.md` holds decoding to that.

use super::{Node, NodeId, Others};
use crate::{Box3, Footprint, LabelId, PredicateId};
use nalgebra::{Point3, Vector3};

/// Most nodes of a chunk, and most edges if it has more nodes than one: what an insertion moves at most. Tests reach the
/// one with few edges.
pub(super) const CHUNK: usize = 64;
pub(super) const EDGES: usize = if cfg!(test) { 16 } else { 4096 };

/// A node as it is kept.
#[derive(Clone)]
pub(super) struct Packed {
    pub id: NodeId,
    last_seen: f64,
    centroid: Point3<f32>,
    extent: Vector3<f32>,
    score: f32,
    others: Others,
    sightings: u32,
    misses: u32,
    label: LabelId,
    /// Place in the chunk's list of footprints, [`NONE`] without one.
    footprint: u8,
}

impl Packed {
    fn new(node: &Node, footprint: u8) -> Self {
        let Node { id, label, score, ref bounds, others, sightings, misses, last_seen } = *node;
        let (centroid, extent) = (bounds.centroid(), bounds.extent());
        Self { id, last_seen, centroid, extent, score, others, sightings, misses, label, footprint }
    }
}

const NONE: u8 = u8::MAX;
const _: () = assert!(size_of::<Packed>() <= 72 && size_of::<Out>() <= 16 && CHUNK < NONE as usize);

/// An edge as its subject's chunk holds it.
#[derive(Clone, Copy)]
pub(super) struct Out {
    pub t: NodeId,
    pub score: f32,
    pub p: PredicateId,
    /// Place of the subject in the chunk.
    pub s: u8,
}

/// Some nodes with rising ids.
#[derive(Clone, Default)]
pub(super) struct Chunk {
    pub nodes: Vec<Packed>,
    /// In any order.
    pub footprints: Vec<Footprint>,
    /// Rising by (subject, object, predicate).
    pub out: Vec<Out>,
}

impl Chunk {
    pub(super) fn node(&self, k: usize) -> Node {
        let Packed { id, last_seen, centroid, extent, score, others, sightings, misses, label, footprint } =
            self.nodes[k];
        let footprint = self.footprints.get(usize::from(footprint)).copied();
        let bounds = Box3::again(centroid, extent, footprint);
        Node { id, label, score, bounds, others, sightings, misses, last_seen }
    }

    /// Puts another node in the place of one.
    pub(super) fn set(&mut self, k: usize, node: &Node) {
        let (old, new) = (usize::from(self.nodes[k].footprint), node.bounds.footprint());
        self.nodes[k] = match (self.footprints.get_mut(old), new) {
            (Some(place), Some(f)) => {
                *place = f;
                Packed::new(node, old as u8)
            }
            _ => {
                self.drop_footprint(k);
                self.pack(node)
            }
        };
    }

    pub(super) fn pack(&mut self, node: &Node) -> Packed {
        let Some(f) = node.bounds.footprint() else { return Packed::new(node, NONE) };
        self.footprints.push(f);
        Packed::new(node, self.footprints.len() as u8 - 1)
    }

    fn drop_footprint(&mut self, k: usize) {
        let place = std::mem::replace(&mut self.nodes[k].footprint, NONE);
        if place != NONE {
            self.footprints.swap_remove(place.into());
            let last = self.footprints.len() as u8;
            self.nodes.iter_mut().filter(|n| n.footprint == last).for_each(|n| n.footprint = place);
        }
    }

    pub(super) fn insert(&mut self, k: usize, node: &Node) {
        let packed = self.pack(node);
        self.nodes.insert(k, packed);
        let behind = self.behind(k);
        self.out[behind..].iter_mut().for_each(|o| o.s += 1);
    }

    /// Takes a node out, and the edges that start at it.
    pub(super) fn remove(&mut self, k: usize) -> Node {
        let node = self.node(k);
        self.drop_footprint(k);
        let (from, to) = (self.behind(k), self.behind(k + 1));
        self.out.drain(from..to);
        self.out[from..].iter_mut().for_each(|o| o.s -= 1);
        self.nodes.remove(k);
        node
    }

    /// Where the edges of a node and those behind it begin.
    pub(super) fn behind(&self, k: usize) -> usize {
        self.out.partition_point(|o| usize::from(o.s) < k)
    }

    pub(super) fn out(&self, k: usize) -> &[Out] {
        &self.out[self.behind(k)..self.behind(k + 1)]
    }

    /// Takes the nodes from one on out, with their edges.
    pub(super) fn split_off(&mut self, k: usize) -> Self {
        let out = self.out.split_off(self.behind(k));
        let mut rest = Self { nodes: self.nodes.split_off(k), footprints: self.footprints.clone(), out };
        rest.out.iter_mut().for_each(|o| o.s -= k as u8);
        self.settle();
        rest.settle();
        rest
    }

    /// Takes the nodes of the next chunk over.
    pub(super) fn append(&mut self, next: Self) {
        let (nodes, footprints) = (self.nodes.len() as u8, self.footprints.len() as u8);
        self.footprints.extend(next.footprints);
        self.out.extend(next.out.into_iter().map(|o| Out { s: o.s + nodes, ..o }));
        let moved = |f: u8| if f == NONE { NONE } else { f + footprints };
        self.nodes.extend(next.nodes.into_iter().map(|n| Packed { footprint: moved(n.footprint), ..n }));
    }

    /// Keeps the footprints that its nodes have.
    fn settle(&mut self) {
        let all = std::mem::take(&mut self.footprints);
        for n in &mut self.nodes {
            if let Some(f) = all.get(usize::from(n.footprint)) {
                n.footprint = self.footprints.len() as u8;
                self.footprints.push(*f);
            }
        }
    }
}
