//! Two views of one place that show different parts of its objects: their sides instead of their centres.
//!
//! Where an object was seen in part its centre and size say little, but a side that was seen is where it is. So boxes
//! along the walls are compared side by side; [`Seen`] says how far apart two sides that are one may lie. A pair is
//! worth `ln` of the product over its six sides, times the window in which its counterpart might lie by chance, times the
//! ratio of classes as in [`evidence`](super::evidence). Walls and floors take part: their sides are the surest.
//!
//! Every pair of boxes proposes the poses that lay one side on another in each direction; the fullest bins are fitted,
//! reweighted by how surely each side was seen by both. The directions of the walls leave four turns.

use super::index::{Index, Item};
use super::vote::{self, Hit};
use super::{RobustParams, Work};
use crate::seen::{NOISE, Seen};
use crate::{LabelId, SceneGraph};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f32::consts::FRAC_PI_2;

/// Where a counterpart might lie by chance: m² on the ground times metres of height, at sizes as they come.
const WINDOW: f32 = 4.0 * 4.0 * 1.5;
/// What one pair may be worth, and what a pair by choice among several costs.
const MOST: f32 = 12.0;
const CHOICE: f32 = 0.7;
/// Pairs of less likely classes propose no pose (natural log).
const UNLIKELY: f32 = -2.0;
/// Side of the bins of proposed shifts, metres; peaks that are looked at, and fitted, of so many bins; rounds of a fit.
const BIN: f32 = 0.15;
const PEAKS: usize = 32;
const FITTED: usize = 12;
const BINS: usize = 400;
const ROUNDS: usize = 8;
/// Noise of a side in the first round, on top of that of the last and in units of it: the bins are wide.
const WIDE: f32 = 5.0;
/// Bins of turn from one quarter to the next, so that they do not touch.
const QUARTER: usize = 7;
/// Noise of the direction of an oblong box, radians, and how far off the walls a box counts as along them.
const TURN_NOISE: f32 = 0.05;
const ALONG: f32 = 0.2;
/// Boxes lower than this are flat: their height is where they were seen, metres.
const FLAT: f32 = 0.2;
/// Boxes with so much space between them in some direction are no pair, metres.
const APART: f32 = 0.5;
/// Boxes of one graph beyond which nothing is tried: this is for rooms, not for buildings.
const MOST_BOXES: usize = 64;

/// A pose that sides agree on.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    pub reference_from_query: Isometry3<f32>,
    pub evidence: f32,
    /// Pairs of which none is structure, and their share of the evidence: rooms of one plan have the same walls.
    pub objects: (usize, f32),
    /// Objects that should have been met: of the graph that has fewer where the other's are.
    pub common: usize,
    /// Whether something flat agrees in height: tall things that the image cut off at the top or below agree at
    /// any height.
    pub level: bool,
}

/// Boxes of one graph, in an order of content.
struct Boxes {
    items: Vec<Item>,
    /// Sides, height and direction of each on the ground.
    feet: Vec<([f32; 3], f32)>,
    middle: Vector3<f32>,
    /// The direction of the walls.
    turn: f32,
}

impl Boxes {
    /// None where too few footprints are known, or far too many.
    fn of(items: impl Iterator<Item = Item>, fewest: usize) -> Option<Self> {
        let known = items.filter(|i| i.bounds.footprint().is_some());
        let mut items: Vec<Item> = known.take(MOST_BOXES + 1).collect();
        if !(fewest..=MOST_BOXES).contains(&items.len()) {
            return None;
        }
        items.sort_by(Item::order);
        let foot = |i: &Item| {
            let f = i.bounds.footprint()?;
            let [l, w] = f.sides();
            Some(([l, w, i.bounds.extent().z], f.yaw))
        };
        let feet: Vec<_> = items.iter().filter_map(foot).collect();
        let sum = items.iter().fold(Vector3::<f64>::zeros(), |s, i| s + i.p.coords.cast::<f64>());
        let middle = (sum / items.len() as f64).cast::<f32>();
        // Directions agree up to quarter turns: four times the angle is what is averaged.
        let (mut sin, mut cos) = (0.0, 0.0);
        for ([l, w, h], yaw) in &feet {
            let weight = oblong(*l, *w) * l.max(*w) * h.max(0.1);
            let (s, c) = (4.0 * yaw).sin_cos();
            (sin, cos) = (sin + weight * s, cos + weight * c);
        }
        Some(Self { items, feet, middle, turn: sin.atan2(cos) / 4.0 })
    }

    /// The mirror image in x.
    fn mirrored(&self) -> Self {
        let items = self.items.iter().map(|i| Item { p: [-i.p.x, i.p.y, i.p.z].into(), ..*i }).collect();
        let feet = self.feet.iter().map(|(sides, yaw)| (*sides, -yaw)).collect();
        let middle = Vector3::new(-self.middle.x, self.middle.y, self.middle.z);
        Self { items, feet, middle, turn: -self.turn }
    }

    /// As seen from the middle, turned.
    fn turned(&self, turn: f32, structure: &[LabelId]) -> Vec<Slab> {
        let (sin, cos) = turn.sin_cos();
        let slab = |(item, &([l, w, h], yaw)): (&Item, &([f32; 3], f32))| {
            let d = item.p.coords - self.middle;
            let quarters = ((yaw + turn) / FRAC_PI_2).round();
            let off = yaw + turn - quarters * FRAC_PI_2;
            let [l, w] = if quarters.rem_euclid(2.0) == 0.0 { [l, w] } else { [w, l] };
            let (s, c) = if off.abs() > ALONG { off.abs().sin_cos() } else { (0.0, 1.0) };
            let sides = [l * c + w * s, l * s + w * c, h].map(|v| v.max(0.03));
            Slab {
                centre: [cos * d.x - sin * d.y, sin * d.x + cos * d.y, d.z],
                half: sides.map(|v| v / 2.0),
                length: sides.map(Sides::class),
                structure: structure.contains(&item.label),
                off,
                oblong: oblong(l, w),
            }
        };
        self.items.iter().zip(&self.feet).map(slab).collect()
    }
}

fn about_z(angle: f32) -> UnitQuaternion<f32> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
}

/// How far from a square, 0 to 1.
fn oblong(l: f32, w: f32) -> f32 {
    (l - w).abs() / (l + w).max(1e-3)
}

/// A box along the axes of a frame that lies along the walls.
#[derive(Clone, Copy)]
struct Slab {
    centre: [f32; 3],
    half: [f32; 3],
    /// Classes of its lengths, see [`Sides`].
    length: [u8; 3],
    structure: bool,
    /// Its own direction against the axes, radians.
    off: f32,
    oblong: f32,
}

impl Slab {
    fn is_flat(&self) -> bool {
        self.half[2] < FLAT / 2.0 && self.half[0].min(self.half[1]) > FLAT / 2.0
    }
}

/// `ln f` of the distance of two sides by steps of 1 / 128 m, for the lengths 0.1, 0.2, ... 3.2 m.
struct Sides(Vec<[f32; 257]>);

impl Sides {
    fn new() -> Self {
        let table = |class: i32| {
            let seen = Seen::of(0.1 * 2f32.powi(class));
            std::array::from_fn(|k| seen.density(k as f32 / 128.0).ln())
        };
        Self((0..6).map(table).collect())
    }

    fn class(length: f32) -> u8 {
        (length / 0.1).log2().round().clamp(0.0, 5.0) as u8
    }
}

fn at(table: &[f32; 257], d: f32) -> f32 {
    table[((d.abs() * 128.0) as usize).min(256)]
}

/// `ln` of `sum p_q(c) p_r(c) / pi(c)` for every pair, row by row of the reference; shares pi are those of both graphs.
fn classes(reference: &[Item], query: &[Item]) -> Vec<f32> {
    let mut mass: Vec<(LabelId, f32)> = Vec::new();
    for item in reference.iter().chain(query) {
        for c in item.classes() {
            let p = item.named_probability(c).unwrap_or(0.0);
            match mass.iter_mut().find(|m| m.0 == c) {
                Some(m) => m.1 += p,
                None => mass.push((c, p)),
            }
        }
    }
    mass.sort_by_key(|m| m.0);
    let kinds = (mass.len() as f32).max(10.0);
    let total: f32 = mass.iter().map(|m| m.1).sum::<f32>() + kinds;
    let share = |c: LabelId| {
        let m = mass.binary_search_by_key(&c, |m| m.0).map_or(0.0, |k| mass[k].1);
        (m + 1.0) / total
    };
    let ratio = |r: &Item, q: &Item| {
        let (other_r, other_q) = (r.other_probability(kinds), q.other_probability(kinds));
        let of = |c| {
            r.named_probability(c).unwrap_or(other_r) * q.named_probability(c).unwrap_or(other_q) / share(c)
        };
        let both = r.classes().chain(q.classes().filter(|&c| r.named_probability(c).is_none()));
        both.map(of).sum::<f32>().max(1e-3).ln()
    };
    reference.iter().flat_map(|r| query.iter().map(move |q| (r, q))).map(|(r, q)| ratio(r, q)).collect()
}

/// Both graphs along the walls, under one of the four turns.
struct Face<'a> {
    reference: &'a [Slab],
    query: &'a [Slab],
    sides: &'a Sides,
    /// Pairs that are worth something where their sides coincide.
    likely: Vec<Likely>,
}

/// A pair of boxes.
struct Likely {
    i: u16,
    j: u16,
    /// What classes and window add, and whether the classes propose poses.
    fixed: f32,
    proposes: bool,
    /// What it is worth where a side coincides in every direction.
    most: f32,
}

/// Places of two boxes, and what the pair is worth.
type Pair = (usize, usize, f32);

/// A turn beside that of the walls, and a shift.
#[derive(Clone, Copy)]
struct Motion {
    turn: f32,
    shift: [f32; 3],
}

/// A motion that rests.
struct Fitted {
    motion: Motion,
    evidence: f32,
    objects: (usize, f32),
    common: usize,
    level: bool,
}

impl<'a> Face<'a> {
    fn new(reference: &'a [Slab], query: &'a [Slab], classes: &[f32], sides: &'a Sides) -> Self {
        let mut face = Self { reference, query, sides, likely: Vec::new() };
        for (i, r) in reference.iter().enumerate() {
            for (j, q) in query.iter().enumerate() {
                let class = classes[i * query.len() + j];
                let fixed = class + WINDOW.ln();
                let most = face.worth(r, q, fixed, std::array::from_fn(|k| (r.half[k] - q.half[k]).abs()));
                if most > 0.0 {
                    let (i, j) = (i as u16, j as u16);
                    face.likely.push(Likely { i, j, fixed, proposes: class > UNLIKELY, most });
                }
            }
        }
        face
    }

    /// What a pair is worth whose centres are `d` apart.
    fn worth(&self, r: &Slab, q: &Slab, fixed: f32, d: [f32; 3]) -> f32 {
        let mut sum = fixed;
        for (k, d) in d.into_iter().enumerate() {
            let (table, off) = (&self.sides.0[r.length[k].max(q.length[k]) as usize], r.half[k] - q.half[k]);
            sum += at(table, d - off) + at(table, d + off);
        }
        sum.min(MOST) - CHOICE
    }

    /// Shifts under which sides of two boxes coincide in every direction.
    fn propose(&self, quarter: i32, hits: &mut Vec<Hit>, shifts: &mut Vec<[f32; 3]>) {
        for pair in self.likely.iter().filter(|p| p.proposes) {
            let (r, q) = (&self.reference[pair.i as usize], &self.query[pair.j as usize]);
            let half: [f32; 3] = std::array::from_fn(|k| r.half[k] - q.half[k]);
            // Boxes of one length have one place.
            let one = half.map(|h| h.abs() < NOISE / 2.0);
            for corner in (0..8).filter(|c| (0..3).all(|k| !one[k] || c >> k & 1 == 0)) {
                let side = |k: usize| match (one[k], corner >> k & 1) {
                    (true, _) => 0.0,
                    (_, 0) => half[k],
                    _ => -half[k],
                };
                let shift: [f32; 3] = std::array::from_fn(|k| r.centre[k] - q.centre[k] + side(k));
                let [x, y, z] = shift.map(|v| (v / BIN).floor() as i32);
                hits.push(Hit {
                    query: [pair.j; 2],
                    reference: [pair.i.into(); 2],
                    bin: [quarter, x, y, z],
                    weight: (pair.most * 1000.0) as u32,
                });
                shifts.push(shift);
            }
        }
    }

    /// Pairs that choose each other, and what all are worth together.
    fn pairs(&self, moved: &[[f32; 3]]) -> (Vec<Pair>, f32) {
        let (n, m) = (self.reference.len(), self.query.len());
        let mut best = (vec![(0.0, m); n], vec![(0.0, n); m]);
        for pair in &self.likely {
            let (i, j) = (pair.i as usize, pair.j as usize);
            let (r, q) = (&self.reference[i], &self.query[j]);
            let d: [f32; 3] = std::array::from_fn(|k| r.centre[k] - moved[j][k]);
            if (0..3).any(|k| d[k].abs() > r.half[k] + q.half[k] + APART) {
                continue;
            }
            let worth = self.worth(r, q, pair.fixed, d);
            if worth > best.0[i].0 {
                best.0[i] = (worth, j);
            }
            if worth > best.1[j].0 {
                best.1[j] = (worth, i);
            }
        }
        let chosen =
            |(i, &(worth, j)): (usize, &(f32, usize))| (j < m && best.1[j].1 == i).then_some((i, j, worth));
        let pairs: Vec<Pair> = best.0.iter().enumerate().filter_map(chosen).collect();
        let worth = pairs.iter().map(|p| p.2).sum();
        (pairs, worth)
    }

    fn moved(&self, motion: &Motion) -> Vec<[f32; 3]> {
        let (sin, cos) = motion.turn.sin_cos();
        let [x, y, z] = motion.shift;
        let turned = |c: [f32; 3]| [cos * c[0] - sin * c[1] + x, sin * c[0] + cos * c[1] + y, c[2] + z];
        self.query.iter().map(|s| turned(s.centre)).collect()
    }

    /// The motion that the pairs imply: least squares over their sides, each by how surely both saw it.
    fn fit(&self, pairs: &[Pair], moved: &[[f32; 3]], motion: &Motion, noise: f32) -> Option<Motion> {
        let (mut a, mut b) = (Matrix3::<f64>::identity() * 1e-3, Vector3::<f64>::zeros());
        let (mut up, mut weight_up) = (0.0, 1e-3);
        let mut add = |row: &Vector3<f32>, off: f32, weight: f32| {
            let row = row.cast::<f64>();
            a += row * row.transpose() * f64::from(weight);
            b += row * f64::from(off * weight);
        };
        for &(i, j, _) in pairs {
            let (r, q) = (&self.reference[i], &self.query[j]);
            let from: [f32; 3] = std::array::from_fn(|k| r.centre[k] - moved[j][k]);
            let arm: [f32; 2] = std::array::from_fn(|k| moved[j][k] - motion.shift[k]);
            let rows = [Vector3::new(-arm[1], 1.0, 0.0), Vector3::new(arm[0], 0.0, 1.0)];
            for (k, (from, (r, q))) in from.iter().zip(r.half.iter().zip(q.half)).enumerate() {
                let both = Seen::of(2.0 * r.max(q));
                for off in [from - (r - q), from + (r - q)] {
                    let weight = both.chance(off, noise);
                    match rows.get(k) {
                        Some(row) => add(row, off, weight),
                        None => (up, weight_up) = (up + off * weight, weight_up + weight),
                    }
                }
            }
            let off = r.off - q.off - motion.turn;
            if off.abs() < ALONG {
                let weight = (NOISE / TURN_NOISE).powi(2) * r.oblong.min(q.oblong);
                add(&Vector3::x(), off, weight);
            }
        }
        let by = a.cholesky()?.solve(&b).cast::<f32>();
        let [x, y, z] = motion.shift;
        Some(Motion { turn: motion.turn + by.x, shift: [x + by.y, y + by.z, z + up / weight_up] })
    }

    fn is_structure(&self, &(i, j, _): &Pair) -> bool {
        self.reference[i].structure || self.query[j].structure
    }

    /// Objects whose centres lie in the rectangle of the other graph's centres: of the graph that has fewer there.
    fn common(&self, moved: &[[f32; 3]]) -> usize {
        let reference: Vec<[f32; 3]> = self.reference.iter().map(|r| r.centre).collect();
        let within = |slabs: &[Slab], centres: &[[f32; 3]], others: &[[f32; 3]]| {
            let bounds = [0, 1].map(|k| {
                others.iter().fold((f32::MAX, f32::MIN), |(low, high), c| (low.min(c[k]), high.max(c[k])))
            });
            let inside = |c: &[f32; 3]| (0..2).all(|k| bounds[k].0 <= c[k] && c[k] <= bounds[k].1);
            slabs.iter().zip(centres).filter(|(s, c)| !s.structure && inside(c)).count()
        };
        within(self.reference, &reference, moved).min(within(self.query, moved, &reference))
    }

    /// Whether something flat lies at one height in both, one above the other.
    fn is_level(&self, moved: &[[f32; 3]]) -> bool {
        let level = |r: &Slab, q: &Slab, m: &[f32; 3]| {
            let over = (0..2).all(|k| (r.centre[k] - m[k]).abs() < r.half[k] + q.half[k]);
            over && (r.centre[2] - m[2]).abs() < 3.0 * NOISE
        };
        let flat = || self.query.iter().zip(moved).filter(|(q, _)| q.is_flat());
        self.reference.iter().filter(|r| r.is_flat()).any(|r| flat().any(|(q, m)| level(r, q, m)))
    }

    /// A proposed motion, fitted.
    fn settle(&self, mut motion: Motion, work: &mut Work) -> Option<Fitted> {
        for round in 0..ROUNDS {
            if !work.spend(self.likely.len() as u64) {
                return None;
            }
            let moved = self.moved(&motion);
            let (pairs, _) = self.pairs(&moved);
            let noise = NOISE * (1.5 + WIDE * 0.5f32.powi(round as i32));
            motion = self.fit(&pairs, &moved, &motion, noise)?;
            if motion.turn.abs() > 2.0 * ALONG {
                return None;
            }
        }
        let moved = self.moved(&motion);
        let (pairs, evidence) = self.pairs(&moved);
        let objects: Vec<f32> = pairs.iter().filter(|p| !self.is_structure(p)).map(|p| p.2).collect();
        let objects = (objects.len(), objects.iter().sum());
        Some(Fitted { motion, evidence, objects, common: self.common(&moved), level: self.is_level(&moved) })
    }
}

/// Two graphs of rooms with known footprints.
pub(super) struct Views<'a> {
    reference: Boxes,
    query: Boxes,
    classes: Vec<f32>,
    sides: Sides,
    structure: &'a [LabelId],
}

impl<'a> Views<'a> {
    /// None where footprints are not known, or the graphs are no rooms.
    pub(super) fn of(index: &Index, query: &SceneGraph, params: &'a RobustParams) -> Option<Self> {
        let fewest = params.fewest + 1;
        let query = Boxes::of(query.nodes().map(Item::of), fewest)?;
        let reference = Boxes::of(index.all().copied(), fewest)?;
        let classes = classes(&reference.items, &query.items);
        Some(Self { reference, query, classes, sides: Sides::new(), structure: &params.structure })
    }

    /// Poses of the query on which sides agree, best first.
    pub(super) fn poses(&self, work: &mut Work) -> Vec<Pose> {
        self.search(&self.query, work)
    }

    /// The same of its mirror image.
    pub(super) fn mirrored(&self, work: &mut Work) -> Vec<Pose> {
        self.search(&self.query.mirrored(), work)
    }

    /// A pose laid by sides: near it, where they agree better. None where they do not.
    pub(super) fn laid(&self, pose: &Isometry3<f32>, work: &mut Work) -> Option<Pose> {
        let (reference, query) = (&self.reference, &self.query);
        let x = pose.rotation * Vector3::x();
        let yaw = x.y.atan2(x.x) - reference.turn + query.turn;
        let quarter = (yaw / FRAC_PI_2).round();
        let turn = quarter * FRAC_PI_2 - query.turn;
        let slabs = reference.turned(-reference.turn, self.structure);
        let turned = query.turned(turn, self.structure);
        if !work.spend((slabs.len() * turned.len()) as u64) {
            return None;
        }
        let face = Face::new(&slabs, &turned, &self.classes, &self.sides);
        let middle = pose * Point3::from(query.middle) - reference.middle;
        let shift = about_z(-reference.turn) * middle.coords;
        let motion = Motion { turn: yaw - quarter * FRAC_PI_2, shift: shift.into() };
        let before = face.pairs(&face.moved(&motion)).1;
        let fitted = face.settle(motion, work)?;
        (fitted.evidence > before).then(|| self.pose(query, turn, fitted))
    }

    /// The pose of a query turned by `turn` and moved.
    fn pose(&self, query: &Boxes, turn: f32, fitted: Fitted) -> Pose {
        let Fitted { motion, evidence, objects, common, level } = fitted;
        let reference = &self.reference;
        let rotation = about_z(reference.turn + motion.turn + turn);
        let middle = reference.middle + about_z(reference.turn) * Vector3::from(motion.shift);
        let shift = Translation3::from(middle - rotation * query.middle);
        Pose {
            reference_from_query: Isometry3::from_parts(shift, rotation),
            evidence,
            objects,
            common,
            level,
        }
    }

    fn search(&self, query: &Boxes, work: &mut Work) -> Vec<Pose> {
        let reference = &self.reference;
        let slabs = reference.turned(-reference.turn, self.structure);
        let turns: [f32; 4] = std::array::from_fn(|k| k as f32 * FRAC_PI_2 - query.turn);
        let turned = turns.map(|turn| query.turned(turn, self.structure));
        let mut faces = Vec::with_capacity(4);
        for turned in &turned {
            if !work.spend((slabs.len() * turned.len()) as u64) {
                return Vec::new();
            }
            faces.push(Face::new(&slabs, turned, &self.classes, &self.sides));
        }
        let pose = |(_, k, motion): (f32, usize, Motion)| {
            Some(self.pose(query, turns[k], faces[k].settle(motion, work)?))
        };
        let mut found: Vec<Pose> = starts(&faces).into_iter().filter_map(pose).collect();
        found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        found
    }
}

/// The most promising proposals, best first: what they are worth as they are, the turn, the motion.
fn starts(faces: &[Face<'_>]) -> Vec<(f32, usize, Motion)> {
    let (mut hits, mut shifts) = (Vec::new(), Vec::new());
    for (quarter, face) in (0..).step_by(QUARTER).zip(faces) {
        face.propose(quarter, &mut hits, &mut shifts);
    }
    let sorted = vote::Sorted::of(&hits);
    let start = |peak: vote::Bin| {
        // The middle of what lies in the bin, by weight.
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for h in sorted.hits_around(&peak).filter(|&h| hits[h].bin == peak) {
            let weight = hits[h].weight as f32;
            (sum, total) = (std::array::from_fn(|k| sum[k] + weight * shifts[h][k]), total + weight);
        }
        let motion = Motion { turn: 0.0, shift: sum.map(|v| v / total) };
        let k = peak[0] as usize / QUARTER;
        (faces[k].pairs(&faces[k].moved(&motion)).1, k, motion)
    };
    let mut starts: Vec<_> = vote::peaks(&hits, &sorted, PEAKS, BINS).into_iter().map(start).collect();
    starts.sort_by(|a, b| b.0.total_cmp(&a.0));
    starts.truncate(FITTED);
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Box3, Footprint, Node, NodeId};

    /// Boxes given by their lowest and highest corners.
    fn graph(boxes: &[[[f32; 3]; 2]]) -> SceneGraph {
        let mut graph = SceneGraph::default();
        for (id, [low, high]) in boxes.iter().enumerate() {
            let size: [f32; 3] = std::array::from_fn(|k| high[k] - low[k]);
            let middle = std::array::from_fn(|k| (high[k] + low[k]) / 2.0);
            let foot = Footprint::rectangle([size[0], size[1]], 0.0);
            let bounds = Box3::new(middle, size).and_then(|b| b.with_footprint(foot)).expect("finite");
            graph.insert_node(Node::new(NodeId(id as u64), LabelId(id as u16 % 3), bounds));
        }
        graph
    }

    fn best(reference: &[[[f32; 3]; 2]], query: &[[[f32; 3]; 2]]) -> Pose {
        let params = RobustParams::default();
        let index = Index::of(&graph(reference), &params);
        let views = Views::of(&index, &graph(query), &params).expect("rooms");
        views.poses(&mut Work::new(1 << 20)).first().expect("a pose").clone()
    }

    /// Six pillars, and of one view a part in height.
    fn pillars(low: f32, high: f32) -> Vec<[[f32; 3]; 2]> {
        let feet = [[0.0, 0.0], [2.0, 0.3], [3.1, 1.9], [0.4, 2.6], [1.2, 1.3], [4.0, 3.0]];
        let side = |k: usize| 0.3 + 0.11 * k as f32;
        let pillar = |(k, [x, y]): (usize, [f32; 2])| [[x, y, low], [x + side(k), y + 0.4, high]];
        feet.into_iter().enumerate().map(pillar).collect()
    }

    #[test]
    fn sides_are_laid_on_sides() {
        let floor = [[-1.0, -1.0, -0.05], [4.5, 3.5, 0.0]];
        let (mut a, mut b) = (pillars(0.0, 2.0), pillars(0.0, 2.0));
        // Half of the fifth is hidden from the one, half of the sixth from the other.
        (a[4][1][0], b[5][0][0]) = (a[4][1][0] - 0.35, b[5][0][0] + 0.4);
        a.push(floor);
        b.push(floor);
        let pose = best(&a, &b);
        assert!(pose.reference_from_query.translation.vector.norm() < 0.01, "{pose:?}");
        assert!(pose.reference_from_query.rotation.angle() < 0.01 && pose.level, "{pose:?}");
        assert_eq!(pose.objects.0, 7);
    }

    #[test]
    fn a_motion_of_both_moves_the_pose() {
        let params = RobustParams::default();
        let mut seen = [pillars(0.0, 2.0), pillars(0.0, 2.0)];
        seen.iter_mut().for_each(|s| s.push([[-1.0, -1.0, -0.05], [4.5, 3.5, 0.0]]));
        (seen[0][4][1][0], seen[1][2][0][1]) = (seen[0][4][1][0] - 0.35, seen[1][2][0][1] + 0.2);
        for k in 0..12 {
            let k = k as f32;
            let (a, of_a) = moved(&seen[0], 0.4 * k - 2.0, [3.0 * k, 7.0 - k, 0.1 * k]);
            let (b, of_b) = moved(&seen[1], 2.9 - 0.7 * k, [9.0 - k, k * k, 1.0]);
            let index = Index::of(&a, &params);
            let views = Views::of(&index, &b, &params).expect("rooms");
            let found = views.poses(&mut Work::new(1 << 20));
            let off = of_a.inverse() * found[0].reference_from_query * of_b;
            assert!(off.translation.vector.norm() < 0.02 && off.rotation.angle() < 0.005, "{k}: {off}");
        }
    }

    /// A graph in a frame of its own, and that frame.
    fn moved(boxes: &[[[f32; 3]; 2]], yaw: f32, shift: [f32; 3]) -> (SceneGraph, Isometry3<f32>) {
        let t = Isometry3::new(shift.into(), Vector3::z() * yaw);
        let mut out = SceneGraph::default();
        for n in graph(boxes).nodes() {
            out.insert_node(Node { bounds: n.bounds.transformed(&t), ..n.clone() });
        }
        (out, t)
    }

    #[test]
    fn a_pose_nearby_is_laid_by_sides() {
        let params = RobustParams::default();
        let (mut a, mut b) = (pillars(0.0, 2.0), pillars(0.0, 2.0));
        (a[4][1][0], b[5][0][0]) = (a[4][1][0] - 0.35, b[5][0][0] + 0.4);
        for k in 0..12 {
            let k = k as f32;
            let (a, of_a) = moved(&a, 0.5 * k - 2.0, [2.0 * k, 5.0 - k, 0.1 * k]);
            let (b, of_b) = moved(&b, 2.9 - 0.8 * k, [9.0 - k, k * k, 1.0]);
            let index = Index::of(&a, &params);
            let views = Views::of(&index, &b, &params).expect("rooms");
            let truth = of_a * of_b.inverse();
            let centre = Translation3::from(of_b * Vector3::new(2.0, 1.5, 1.0) + of_b.translation.vector);
            let turn = Isometry3::rotation(Vector3::z() * 0.05 * (k - 6.0).signum());
            let aside = Translation3::new(0.2 * k.cos(), 0.2 * k.sin(), -0.1);
            let near = truth * centre * aside * turn * centre.inverse();
            let laid = views.laid(&near, &mut Work::new(1 << 20)).expect("sides agree better there");
            let off = of_a.inverse() * laid.reference_from_query * of_b;
            assert!(off.translation.vector.norm() < 0.02 && off.rotation.angle() < 0.005, "{k}: {off}");
            assert!(views.laid(&near, &mut Work::new(10)).is_none(), "no budget");
        }
    }

    #[test]
    fn what_is_found_by_middles_is_laid_by_sides() {
        let (a, mut b) = (pillars(0.0, 2.0), pillars(0.0, 2.0));
        // Half of each is hidden from the one, on the same side: the middles agree on a place that is off.
        b.iter_mut().for_each(|p| p[1][0] -= 0.4 * (p[1][0] - p[0][0]));
        let (b, of_b) = moved(&b, 0.8, [3.0, -2.0, 0.5]);
        let query = crate::Query::new(&b);
        let index = Index::of(&graph(&a), &RobustParams::default());
        let off = |o: crate::Outcome| match o {
            crate::Outcome::Match(m) => {
                let off = m.reference_from_query * of_b;
                (off.translation.vector.xy().norm(), off.rotation.angle())
            }
            other => panic!("{other:?}"),
        };
        let by_middles = off(super::super::align_first(&index, &query, &RobustParams::default()));
        let by_sides = off(super::super::align(&index, &query, &RobustParams::default()));
        assert!(by_middles.0 > 0.08 && by_sides.0 < 0.05, "{by_middles:?}, {by_sides:?}");
        assert!(by_sides.1 < by_middles.1, "{by_middles:?}, {by_sides:?}");
    }

    #[test]
    fn what_the_image_cut_off_at_one_height_is_not_level() {
        let pose = best(&pillars(0.0, 0.6), &pillars(1.3, 1.9));
        // All sides agree, at a height that is wrong by 1.3 m.
        assert!(
            (pose.reference_from_query.translation.z + 1.3).abs() < 0.05 && pose.evidence > 40.0,
            "{pose:?}"
        );
        assert!(!pose.level, "{pose:?}");
    }

    #[test]
    fn nothing_is_tried_beyond_the_budget_or_without_footprints() {
        let params = RobustParams::default();
        let graph = graph(&pillars(0.0, 2.0));
        let index = Index::of(&graph, &params);
        let mut work = Work::new(10);
        assert!(Views::of(&index, &graph, &params).expect("rooms").poses(&mut work).is_empty());
        let mut bare = SceneGraph::default();
        for n in graph.nodes() {
            let bounds = Box3::new(n.bounds.centroid().into(), n.bounds.extent().into()).expect("finite");
            bare.insert_node(Node { bounds, ..n.clone() });
        }
        assert!(Views::of(&index, &bare, &params).is_none());
    }
}
