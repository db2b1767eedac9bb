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
pub(super) struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u64(u64::from(b)));
    }

    fn write_u32(&mut self, v: u32) {
        self.write_u64(u64::from(v));
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

/// The pairs of a bin. Most bins hold one or two, which then need no memory of their own.
#[derive(Clone, Debug)]
enum Bin {
    Few(u8, [[u32; 2]; 2]),
    Many(Vec<[u32; 2]>),
}

impl Default for Bin {
    fn default() -> Self {
        Self::Few(0, [[0; 2]; 2])
    }
}

impl Bin {
    fn pairs(&self) -> &[[u32; 2]] {
        match self {
            Self::Few(n, pairs) => &pairs[..usize::from(*n)],
            Self::Many(pairs) => pairs,
        }
    }

    fn push(&mut self, pair: [u32; 2]) {
        match self {
            Self::Few(n, pairs) if usize::from(*n) < pairs.len() => {
                pairs[usize::from(*n)] = pair;
                *n += 1;
            }
            Self::Few(_, pairs) => *self = Self::Many(vec![pairs[0], pairs[1], pair]),
            Self::Many(pairs) => pairs.push(pair),
        }
    }

    /// Takes a pair out; true when it was there.
    fn remove(&mut self, pair: [u32; 2]) -> bool {
        let Some(at) = self.pairs().iter().position(|p| *p == pair) else { return false };
        match self {
            Self::Few(n, pairs) => {
                *n -= 1;
                pairs[at] = pairs[usize::from(*n)];
            }
            Self::Many(pairs) => {
                pairs.swap_remove(at);
            }
        }
        true
    }
}

/// Places of items, to ask whether one is among them.
#[allow(clippy::disallowed_types, reason = "never walked through: its order decides nothing")]
pub(super) type Slots = std::collections::HashSet<u32, BuildHasherDefault<Mix>>;

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
    /// Probability of all classes that it does not name, kept away from 0, and how many it names.
    pub rest: (f32, f32),
    pub p: Point3<f32>,
    pub size: Size,
    pub bounds: Box3,
}

impl Item {
    pub(super) fn of(node: &Node) -> Self {
        let mut others = [(LabelId::default(), 0.0); Node::MAX_OTHERS];
        others.iter_mut().zip(node.others.iter()).for_each(|(slot, o)| *slot = o);
        let score = node.score.clamp(0.05, 0.95);
        let named = others.iter().filter(|o| o.1 > 0.0);
        let rest = named.fold((1.0 - score, 1.0), |(rest, count), o| (rest - o.1, count + 1.0));
        Self {
            id: node.id,
            label: node.label,
            score,
            others,
            rest: (rest.0.max(0.02), rest.1),
            p: node.bounds.middle(),
            size: Size::of(node),
            bounds: node.bounds,
        }
    }

    /// The classes beside its label that it names, and their probabilities.
    fn named(&self) -> impl Iterator<Item = &(LabelId, f32)> {
        self.others.iter().filter(|o| o.1 > 0.0)
    }

    /// The classes that it names, its label first.
    pub(super) fn classes(&self) -> impl Iterator<Item = LabelId> + '_ {
        std::iter::once(self.label).chain(self.named().map(|o| o.0))
    }

    /// Probability of a class that it names.
    pub(super) fn named_probability(&self, label: LabelId) -> Option<f32> {
        if label == self.label {
            return Some(self.score);
        }
        self.named().find(|o| o.0 == label).map(|o| o.1)
    }

    /// Probability of each class that it does not name: they share what is left.
    pub(super) fn other_probability(&self, kinds: f32) -> f32 {
        self.rest.0 / (kinds - self.rest.1).max(1.0)
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

/// An item as its neighbours see it.
#[derive(Clone, Copy, Debug)]
struct End {
    slot: u32,
    label: LabelId,
    p: Point3<f32>,
}

impl End {
    fn of(item: &Item, slot: u32) -> Self {
        Self { slot, label: item.label, p: item.p }
    }
}

/// An item as pairs are compared by: what is looked at most lies close together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Brief {
    pub p: Point3<f32>,
    height: f32,
    foot: f32,
}

impl Brief {
    pub(super) fn of(item: &Item) -> Self {
        Self { p: item.p, height: item.size.height, foot: item.size.foot }
    }

    /// Whether two objects may be one: sizes within a factor of two.
    pub(super) fn alike(&self, other: &Self) -> bool {
        (self.height - other.height).abs() < 0.7 && (self.foot - other.foot).abs() < 0.7
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
    /// Of the items, those that are gone left as they were.
    briefs: Vec<Brief>,
    free: Vec<u32>,
    slots: BTreeMap<NodeId, u32>,
    cells: Table<Vec<End>>,
    /// Structure by the place of its centroid.
    frame: Table<Vec<End>>,
    /// Half the longest diagonal of structure so far.
    longest: f32,
    pairs: Table<Bin>,
    /// Objects by label, and the number of labels that ever occurred.
    labels: Vec<Option<u32>>,
    kinds: usize,
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
        let mut items: Vec<Item> = graph.nodes().map(|n| Item::of(&n)).collect();
        items.sort_unstable_by(Item::order);
        index.items.reserve(items.len());
        index.briefs.reserve(items.len());
        index.cells.reserve(items.len());
        items.into_iter().for_each(|i| index.insert_item(i));
        index
    }

    /// Adds a node; one of the same id is replaced.
    pub fn insert(&mut self, node: &Node) {
        self.remove(node.id);
        self.insert_item(Item::of(node));
    }

    /// Adds an item of an id that is not there.
    fn insert_item(&mut self, item: Item) {
        let structure = self.structure.contains(&item.label);
        let near = if structure { Vec::new() } else { self.neighbours(&item.p) };
        let slot = self.free.pop().unwrap_or(self.items.len() as u32);
        if slot as usize == self.items.len() {
            self.items.push(None);
            self.briefs.push(Brief::of(&item));
        }
        self.items[slot as usize] = Some(item);
        self.briefs[slot as usize] = Brief::of(&item);
        self.slots.insert(item.id, slot);
        let cells = if structure { &mut self.frame } else { &mut self.cells };
        let cell = cells.entry(cell_key(cell(item.p.x), cell(item.p.y))).or_default();
        let first = cell.is_empty();
        cell.push(End::of(&item, slot));
        if structure {
            self.longest = self.longest.max(item.bounds.extent().norm() / 2.0);
            return;
        }
        self.occupied += usize::from(first);
        self.objects += 1;
        let label = usize::from(item.label.0);
        if label >= self.labels.len() {
            self.labels.resize(label + 1, None);
        }
        self.kinds += usize::from(self.labels[label].is_none());
        *self.labels[label].get_or_insert(0) += 1;
        for other in near {
            for_orientations(&End::of(&item, slot), &other, |key, pair| {
                let bin = self.pairs.entry(key).or_default();
                if bin.pairs().len() < PER_BIN {
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
            cell.retain(|e| e.slot != slot);
            last = cell.is_empty();
        }
        if structure {
            return;
        }
        self.occupied -= usize::from(last);
        self.objects -= 1;
        if let Some(Some(n)) = self.labels.get_mut(usize::from(item.label.0)) {
            *n -= 1;
        }
        for other in self.neighbours(&item.p) {
            for_orientations(&End::of(&item, slot), &other, |key, pair| {
                let gone = self.pairs.get_mut(&key).is_some_and(|bin| bin.remove(pair));
                self.entries -= usize::from(gone);
            });
        }
    }

    /// Objects with which one is paired.
    fn neighbours(&self, p: &Point3<f32>) -> Vec<End> {
        let mut near = Vec::with_capacity(NEIGHBOURS);
        self.walk(false, p, self.range, |end| {
            if near.len() < NEIGHBOURS {
                near.push(*end);
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

    /// All items, structure too, in no particular order.
    pub(super) fn all(&self) -> impl Iterator<Item = &Item> {
        self.items.iter().flatten()
    }

    /// What pairs with the item at a place are compared by.
    pub(super) fn brief(&self, slot: u32) -> Option<&Brief> {
        self.briefs.get(slot as usize)
    }

    /// Structure whose box may be nearer to a box than `gap`, in no particular order.
    pub(super) fn structure_near<'a>(&'a self, b: &Box3, gap: f32, f: impl FnMut(u32, &'a Item)) {
        self.structure_within(&b.centroid(), b.extent().norm() / 2.0 + self.longest + gap.max(0.0), f);
    }

    /// Structure whose centroid is within a horizontal distance, in no particular order.
    pub(super) fn structure_within<'a>(&'a self, p: &Point3<f32>, range: f32, f: impl FnMut(u32, &'a Item)) {
        self.walk(true, p, range, self.items_of(f));
    }

    /// Objects within a horizontal distance, in no particular order.
    pub(super) fn near<'a>(&'a self, p: &Point3<f32>, range: f32, f: impl FnMut(u32, &'a Item)) {
        self.walk(false, p, range, self.items_of(f));
    }

    fn items_of<'a>(&'a self, mut f: impl FnMut(u32, &'a Item)) -> impl FnMut(&End) {
        move |end| {
            if let Some(item) = self.item(end.slot) {
                f(end.slot, item);
            }
        }
    }

    fn walk(&self, structure: bool, p: &Point3<f32>, range: f32, mut f: impl FnMut(&End)) {
        let mut check = |end: &End| {
            let (dx, dy) = (end.p.x - p.x, end.p.y - p.y);
            if dx * dx + dy * dy <= range * range {
                f(end);
            }
        };
        let span = |v: f32| cell(v - range)..=cell(v + range);
        let cells = if structure { &self.frame } else { &self.cells };
        if (f64::from(range) / f64::from(CELL)).powi(2) > self.items.len() as f64 + 64.0 {
            // More cells than nodes: a box that spans kilometres, say.
            let there = self.items.iter().zip(0..).filter_map(|(i, slot)| Some((i.as_ref()?, slot)));
            for (item, slot) in there.filter(|(i, _)| self.structure.contains(&i.label) == structure) {
                check(&End::of(item, slot));
            }
            return;
        }
        for i in span(p.x) {
            for j in span(p.y) {
                let list = cells.get(&cell_key(i, j)).map_or(&[][..], Vec::as_slice);
                list.iter().take(PER_CELL).for_each(&mut check);
            }
        }
    }

    /// Pairs of these labels whose distances fall into one bin.
    pub(super) fn pairs(&self, labels: [LabelId; 2], dxy: i32, dz: i32) -> &[[u32; 2]] {
        self.pairs.get(&pair_key(labels, dxy, dz)).map_or(&[], Bin::pairs)
    }

    /// Share of a label among all objects, smoothed.
    pub(super) fn share(&self, label: LabelId) -> f32 {
        let n = self.labels.get(usize::from(label.0)).copied().flatten().unwrap_or(0) as f32;
        (n + 1.0) / (self.objects as f32 + self.kinds())
    }

    /// Number of labels, at least ten.
    pub(super) fn kinds(&self) -> f32 {
        (self.kinds as f32).max(10.0)
    }

    /// Objects per square metre where there are any.
    pub(super) fn density(&self) -> f32 {
        let area = self.occupied.max(1) as f32 * CELL * CELL;
        (self.objects as f32 / area).clamp(0.3, 4.0)
    }
}

fn cell(v: f32) -> i32 {
    floor(v / CELL)
}

/// Without a call of a library where the processor at hand may have no instruction for it.
fn floor(v: f32) -> i32 {
    let cut = v as i32;
    cut.saturating_sub(i32::from(cut as f32 > v))
}

fn cell_key(i: i32, j: i32) -> u64 {
    u64::from(i as u32) << 32 | u64::from(j as u32)
}

/// Bin of a distance.
pub(super) fn bin(d: f32) -> i32 {
    floor(d / BIN)
}

fn pair_key([a, b]: [LabelId; 2], dxy: i32, dz: i32) -> u64 {
    u64::from(a.0) << 48 | u64::from(b.0) << 32 | u64::from(dxy as u16) << 16 | u64::from(dz as u16)
}

/// A pair of two labels is kept once, the smaller label first; one of equal labels both ways round.
fn for_orientations(a: &End, b: &End, mut f: impl FnMut(u64, [u32; 2])) {
    let mut put = |a: &End, b: &End| {
        let d = b.p - a.p;
        f(pair_key([a.label, b.label], bin(d.x.hypot(d.y)), bin(d.z)), [a.slot, b.slot]);
    };
    if a.label <= b.label {
        put(a, b);
    }
    if b.label <= a.label {
        put(b, a);
    }
}
