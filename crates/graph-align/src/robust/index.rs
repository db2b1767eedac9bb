//! What is looked up about a reference: where its objects are, and which labelled pairs it holds.

use super::RobustParams;
use crate::{Box3, LabelId, Node, NodeId, SceneGraph};
use nalgebra::Point3;
use std::collections::BTreeMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Side of the cells in which objects are looked up, metres.
const CELL: f32 = 1.25;
/// Width of the bins of pair distances, horizontal and vertical, metres.
pub(super) const BIN: f32 = 0.3;

/// Nodes of one cell that are looked at, neighbours with which a node is paired, pairs of one bin that
/// are kept: far beyond any furnished place. Frames from elsewhere may put 65,536 nodes on one spot.
const PER_CELL: usize = 64;
const NEIGHBOURS: usize = 192;
const PER_BIN: usize = 1 << 13;

/// The hash of keys that are well spread by one multiplication.
#[derive(Default)]
struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u64(u64::from(b)));
    }

    fn write_u64(&mut self, v: u64) {
        let x = (self.0 ^ v).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = x ^ (x >> 29);
    }
}

#[allow(
    clippy::disallowed_types,
    reason = "looked up by key, never walked through: its order decides nothing"
)]
type Table<V> = std::collections::HashMap<u64, V, BuildHasherDefault<Mix>>;

/// The size of an object in numbers that a turn about the vertical hardly changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Size {
    /// ln of the height.
    pub height: f32,
    /// ln of the footprint's diagonal.
    pub foot: f32,
    /// ln of the box's diagonal.
    pub all: f32,
}

impl Size {
    fn of(node: &Node) -> Self {
        let e = node.bounds.extent();
        let ln = |v: f32| v.max(0.03).ln();
        Self { height: ln(e.z), foot: ln(node.bounds.ground_diagonal()), all: ln(e.norm()) }
    }
}

/// A node as the search sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Item {
    pub id: NodeId,
    pub label: LabelId,
    /// Probability of the label, kept away from certainty.
    pub score: f32,
    /// The next best classes; unused ones have probability 0.
    pub others: [(LabelId, f32); Node::MAX_OTHERS],
    pub p: Point3<f32>,
    pub size: Size,
    pub bounds: Box3,
}

impl Item {
    pub(super) fn of(node: &Node) -> Self {
        Self {
            id: node.id,
            label: node.label,
            score: node.score.clamp(0.05, 0.95),
            others: std::array::from_fn(|k| node.others.get(k).copied().unwrap_or_default()),
            p: node.bounds.centroid(),
            size: Size::of(node),
            bounds: node.bounds,
        }
    }

    /// The classes that it names.
    pub(super) fn classes(&self) -> impl Iterator<Item = LabelId> + '_ {
        let others = self.others.iter().filter(|o| o.1 > 0.0).map(|o| o.0);
        std::iter::once(self.label).chain(others)
    }

    /// Probability of a class; classes that are not listed share what is left.
    pub(super) fn probability(&self, label: LabelId, kinds: f32) -> f32 {
        if label == self.label {
            return self.score;
        }
        let listed = self.others.iter().filter(|o| o.1 > 0.0);
        let (mut rest, mut left) = (1.0 - self.score, kinds - 1.0);
        for o in listed {
            if o.0 == label {
                return o.1;
            }
            (rest, left) = (rest - o.1, left - 1.0);
        }
        rest.max(0.02) / left.max(1.0)
    }

    /// An order by content; ids decide only between objects that equal each other.
    pub(super) fn order(&self, other: &Self) -> std::cmp::Ordering {
        let key = |i: &Self| [i.p.x, i.p.y, i.p.z, i.size.height, i.size.foot, i.score];
        let (a, b) = (key(self), key(other));
        let floats = a.iter().zip(&b).map(|(x, y)| x.total_cmp(y)).find(|o| o.is_ne());
        self.label
            .cmp(&other.label)
            .then(floats.unwrap_or(std::cmp::Ordering::Equal))
            .then(self.id.cmp(&other.id))
    }
}

/// Objects of a reference by place, and its labelled pairs by distance.
///
/// It can be kept beside a growing graph: [`Self::insert`] and [`Self::remove`] cost some
/// microseconds per node. Structure ([`RobustParams::structure`]) is in no pair. Of crowds beyond any
/// furnished place only a part is looked at, so that time and memory stay bounded.
#[derive(Clone, Debug, Default)]
pub struct Index {
    range: f32,
    structure: Vec<LabelId>,
    items: Vec<Option<Item>>,
    free: Vec<u32>,
    slots: BTreeMap<NodeId, u32>,
    cells: Table<Vec<u32>>,
    /// Structure by the place of its centroid.
    frame: Table<Vec<u32>>,
    /// Half the longest diagonal of structure so far.
    longest: f32,
    pairs: Table<Vec<[u32; 2]>>,
    labels: BTreeMap<LabelId, u32>,
    objects: usize,
    occupied: usize,
    entries: usize,
}

impl Index {
    /// An index of nothing.
    #[must_use]
    pub fn new(params: &RobustParams) -> Self {
        Self { range: params.pair_range, structure: params.structure.clone(), ..Self::default() }
    }

    /// The index of a graph.
    #[must_use]
    pub fn of(graph: &SceneGraph, params: &RobustParams) -> Self {
        let mut index = Self::new(params);
        // In an order of content, so that ids do not decide what is kept of a crowd.
        let mut nodes: Vec<(Item, &Node)> = graph.nodes().map(|n| (Item::of(n), n)).collect();
        nodes.sort_by(|a, b| a.0.order(&b.0));
        nodes.iter().for_each(|(_, n)| index.insert(n));
        index
    }

    /// Adds a node; one of the same id is replaced.
    pub fn insert(&mut self, node: &Node) {
        self.remove(node.id);
        let item = Item::of(node);
        let structure = self.structure.contains(&item.label);
        let near = if structure { Vec::new() } else { self.neighbours(&item) };
        let slot = self.free.pop().unwrap_or(self.items.len() as u32);
        if slot as usize == self.items.len() {
            self.items.push(None);
        }
        self.items[slot as usize] = Some(item);
        self.slots.insert(item.id, slot);
        let cells = if structure { &mut self.frame } else { &mut self.cells };
        let cell = cells.entry(cell_key(cell(item.p.x), cell(item.p.y))).or_default();
        let first = cell.is_empty();
        cell.push(slot);
        if structure {
            self.longest = self.longest.max(item.bounds.extent().norm() / 2.0);
            return;
        }
        self.occupied += usize::from(first);
        self.objects += 1;
        *self.labels.entry(item.label).or_default() += 1;
        for (other, o) in near {
            for_orientations(&item, slot, &o, other, |key, pair| {
                let bin = self.pairs.entry(key).or_default();
                if bin.len() < PER_BIN {
                    bin.push(pair);
                    self.entries += 1;
                }
            });
        }
    }

    /// Takes a node out; one that is not there is no error.
    pub fn remove(&mut self, id: NodeId) {
        let Some(slot) = self.slots.remove(&id) else { return };
        let Some(item) = self.items[slot as usize].take() else { return };
        self.free.push(slot);
        let structure = self.structure.contains(&item.label);
        let cells = if structure { &mut self.frame } else { &mut self.cells };
        let mut last = false;
        if let Some(cell) = cells.get_mut(&cell_key(cell(item.p.x), cell(item.p.y))) {
            cell.retain(|&s| s != slot);
            last = cell.is_empty();
        }
        if structure {
            return;
        }
        self.occupied -= usize::from(last);
        self.objects -= 1;
        if let Some(n) = self.labels.get_mut(&item.label) {
            *n -= 1;
        }
        for (other, o) in self.neighbours(&item) {
            for_orientations(&item, slot, &o, other, |key, pair| {
                if let Some(list) = self.pairs.get_mut(&key)
                    && let Some(at) = list.iter().position(|p| *p == pair)
                {
                    list.swap_remove(at);
                    self.entries -= 1;
                }
            });
        }
    }

    /// Objects with which one is paired.
    fn neighbours(&self, item: &Item) -> Vec<(u32, Item)> {
        let mut near = Vec::new();
        self.near(&item.p, self.range, |slot, other| {
            if near.len() < NEIGHBOURS {
                near.push((slot, *other));
            }
        });
        near
    }

    /// Number of objects, structure left out.
    #[must_use]
    pub fn len(&self) -> usize {
        self.objects
    }

    /// True without objects.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.objects == 0
    }

    /// Number of pair entries.
    #[must_use]
    pub fn pair_entries(&self) -> usize {
        self.entries
    }

    pub(super) fn item(&self, slot: u32) -> Option<&Item> {
        self.items.get(slot as usize)?.as_ref()
    }

    /// Structure whose box may touch a box, in no particular order.
    pub(super) fn structure_near(&self, b: &Box3, f: impl FnMut(u32, &Item)) {
        self.walk(true, &b.centroid(), b.extent().norm() / 2.0 + self.longest, f);
    }

    /// Structure whose centroid is within a horizontal distance, in no particular order.
    pub(super) fn structure_within(&self, p: &Point3<f32>, range: f32, f: impl FnMut(u32, &Item)) {
        self.walk(true, p, range, f);
    }

    /// Objects within a horizontal distance, in no particular order.
    pub(super) fn near(&self, p: &Point3<f32>, range: f32, f: impl FnMut(u32, &Item)) {
        self.walk(false, p, range, f);
    }

    fn walk(&self, structure: bool, p: &Point3<f32>, range: f32, mut f: impl FnMut(u32, &Item)) {
        let mut check = |slot: u32, item: &Item| {
            let (dx, dy) = (item.p.x - p.x, item.p.y - p.y);
            if dx * dx + dy * dy <= range * range {
                f(slot, item);
            }
        };
        let span = |v: f32| cell(v - range)..=cell(v + range);
        let cells = if structure { &self.frame } else { &self.cells };
        if (f64::from(range) / f64::from(CELL)).powi(2) > self.items.len() as f64 + 64.0 {
            // More cells than nodes: a box that spans kilometres, say.
            for (slot, item) in self.items.iter().enumerate() {
                if let Some(item) = item
                    && self.structure.contains(&item.label) == structure
                {
                    check(slot as u32, item);
                }
            }
            return;
        }
        for i in span(p.x) {
            for j in span(p.y) {
                let list = cells.get(&cell_key(i, j)).map_or(&[][..], Vec::as_slice);
                for &slot in list.iter().take(PER_CELL) {
                    if let Some(item) = self.item(slot) {
                        check(slot, item);
                    }
                }
            }
        }
    }

    /// Pairs of these labels whose distances fall into one bin.
    pub(super) fn pairs(&self, labels: [LabelId; 2], dxy: i32, dz: i32) -> &[[u32; 2]] {
        self.pairs.get(&pair_key(labels, dxy, dz)).map_or(&[], Vec::as_slice)
    }

    /// Share of a label among all objects, smoothed.
    pub(super) fn share(&self, label: LabelId) -> f32 {
        let n = self.labels.get(&label).copied().unwrap_or(0) as f32;
        (n + 1.0) / (self.objects as f32 + self.kinds())
    }

    /// Number of labels, at least ten.
    pub(super) fn kinds(&self) -> f32 {
        (self.labels.len() as f32).max(10.0)
    }

    /// Objects per square metre where there are any.
    pub(super) fn density(&self) -> f32 {
        let area = self.occupied.max(1) as f32 * CELL * CELL;
        (self.objects as f32 / area).clamp(0.3, 4.0)
    }
}

fn cell(v: f32) -> i32 {
    (v / CELL).floor() as i32
}

fn cell_key(i: i32, j: i32) -> u64 {
    u64::from(i as u32) << 32 | u64::from(j as u32)
}

/// Bin of a distance.
pub(super) fn bin(d: f32) -> i32 {
    (d / BIN).floor() as i32
}

fn pair_key([a, b]: [LabelId; 2], dxy: i32, dz: i32) -> u64 {
    u64::from(a.0) << 48 | u64::from(b.0) << 32 | u64::from(dxy as u16) << 16 | u64::from(dz as u16)
}

/// A pair of two labels is kept once, the smaller label first; one of equal labels both ways round.
fn for_orientations(a: &Item, sa: u32, b: &Item, sb: u32, mut f: impl FnMut(u64, [u32; 2])) {
    let mut put = |(a, sa): (&Item, u32), (b, sb): (&Item, u32)| {
        let d = b.p - a.p;
        f(pair_key([a.label, b.label], bin(d.x.hypot(d.y)), bin(d.z)), [sa, sb]);
    };
    if a.label <= b.label {
        put((a, sa), (b, sb));
    }
    if b.label <= a.label {
        put((b, sb), (a, sa));
    }
}
