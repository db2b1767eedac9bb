//! Two graphs under one of the four turns: poses that lay sides on sides, and what they are worth.

use super::boxes::{ALONG, Slab};
use super::worth::Sides;
use crate::robust::Work;
use crate::robust::vote::Hit;
use crate::seen::{NOISE, Seen};
use nalgebra::{Matrix3, Vector3};
use std::f32::consts::FRAC_PI_4;

/// Where a counterpart might lie by chance: m² on the ground times metres of height, at sizes as they come.
const WINDOW: f32 = 4.0 * 4.0 * 1.5;
/// What one pair may be worth, and what a pair by choice among several costs.
const MOST: f32 = 12.0;
const CHOICE: f32 = 0.7;
/// Pairs of less likely classes propose no pose (natural log).
const UNLIKELY: f32 = -2.0;
/// Side of the bins of proposed shifts, metres; rounds of a fit.
const BIN: f32 = 0.15;
const ROUNDS: usize = 8;
/// Noise of a side in the first round, on top of that of the last and in units of it: the bins are wide.
const WIDE: f32 = 5.0;
/// Noise of the direction of an oblong box, radians.
const TURN_NOISE: f32 = 0.05;
/// Boxes with so much space between them in some direction are no pair, metres.
const APART: f32 = 0.5;

/// How far a pose that holds may not slide, metres, and what it may turn while it slides; how far it may not turn, radians.
const SLIDES: [f32; 2] = [0.2, 0.35];
const TURN: f32 = 0.05;
const TURNS: [f32; 2] = [0.1, 0.175];

/// Both graphs along the walls, under one of the four turns.
pub(super) struct Face<'a> {
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
pub(super) type Pair = (usize, usize, f32);

/// A turn beside that of the walls, and a shift.
#[derive(Clone, Copy)]
pub(super) struct Motion {
    pub turn: f32,
    pub shift: [f32; 3],
}

/// A motion that rests.
pub(super) struct Fitted {
    pub motion: Motion,
    pub evidence: f32,
    pub objects: (usize, f32),
    pub common: usize,
    pub level: bool,
}

impl<'a> Face<'a> {
    pub(super) fn new(reference: &'a [Slab], query: &'a [Slab], classes: &[f32], sides: &'a Sides) -> Self {
        let mut face = Self { reference, query, sides, likely: Vec::new() };
        for (i, r) in reference.iter().enumerate() {
            for (j, q) in query.iter().enumerate() {
                let class = classes[i * query.len() + j];
                let fixed = class + WINDOW.ln();
                let coincide = std::array::from_fn(|k| (r.half[k] - q.half[k]).abs());
                let most = face.worth(r, q, fixed, coincide).min(MOST) - CHOICE;
                if most > 0.0 {
                    let (i, j) = (i as u16, j as u16);
                    face.likely.push(Likely { i, j, fixed, proposes: class > UNLIKELY, most });
                }
            }
        }
        face
    }

    /// What a pair is worth whose centres are `d` apart, before the cap.
    fn worth(&self, r: &Slab, q: &Slab, fixed: f32, d: [f32; 3]) -> f32 {
        let mut sum = fixed;
        for (k, d) in d.into_iter().enumerate() {
            let (length, off) = (r.length[k].max(q.length[k]), r.half[k] - q.half[k]);
            sum += self.sides.ln_density(length, d - off) + self.sides.ln_density(length, d + off);
        }
        sum
    }

    /// Shifts under which sides of two boxes coincide in every direction.
    pub(super) fn propose(&self, quarter: i32, hits: &mut Vec<Hit>, shifts: &mut Vec<[f32; 3]>) {
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
    pub(super) fn pairs(&self, moved: &[[f32; 3]]) -> (Vec<Pair>, f32) {
        self.pairs_among(self.likely.iter(), moved, MOST)
    }

    /// The same among some pairs, with another cap on what one is worth.
    fn pairs_among<'p>(
        &self,
        likely: impl Iterator<Item = &'p Likely>,
        moved: &[[f32; 3]],
        cap: f32,
    ) -> (Vec<Pair>, f32) {
        let (n, m) = (self.reference.len(), self.query.len());
        let mut best = (vec![(0.0, m); n], vec![(0.0, n); m]);
        for pair in likely {
            let (i, j) = (pair.i as usize, pair.j as usize);
            let (r, q) = (&self.reference[i], &self.query[j]);
            let d: [f32; 3] = std::array::from_fn(|k| r.centre[k] - moved[j][k]);
            if !is_near(r, q, d, APART) {
                continue;
            }
            let worth = self.worth(r, q, pair.fixed, d).min(cap) - CHOICE;
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

    pub(super) fn moved(&self, motion: &Motion) -> Vec<[f32; 3]> {
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
    pub(super) fn settle(&self, mut motion: Motion, work: &mut Work) -> Option<Fitted> {
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
        Some(self.at(motion))
    }

    /// What a motion is worth as it is.
    pub(super) fn at(&self, motion: Motion) -> Fitted {
        let moved = self.moved(&motion);
        let (pairs, evidence) = self.pairs(&moved);
        let objects: Vec<f32> = pairs.iter().filter(|p| !self.is_structure(p)).map(|p| p.2).collect();
        let objects = (objects.len(), objects.iter().sum());
        Fitted { motion, evidence, objects, common: self.common(&moved), level: self.is_level(&moved) }
    }

    /// The least evidence that a motion loses when it slides or turns a little; of no pair is anything capped, since each
    /// that agrees holds it. None beyond the budget.
    pub(super) fn hold(&self, motion: Motion, work: &mut Work) -> Option<f32> {
        if !work.spend(self.likely.len() as u64) {
            return None;
        }
        // Pairs that come near each other anywhere on the way.
        let moved = self.moved(&motion);
        let farthest = |q: &Slab| SLIDES[1] + TURNS[1] * (q.centre[0].hypot(q.centre[1]));
        let comes_near = |p: &&Likely| {
            let (r, q, m) = (&self.reference[p.i as usize], &self.query[p.j as usize], moved[p.j as usize]);
            is_near(r, q, std::array::from_fn(|k| r.centre[k] - m[k]), APART + farthest(q))
        };
        let near: Vec<&Likely> = self.likely.iter().filter(comes_near).collect();
        let worth = |[x, y, z, turn]: [f32; 4]| {
            let by = Motion { turn: motion.turn + turn, shift: add(motion.shift, [x, y, z]) };
            self.pairs_among(near.iter().copied(), &self.moved(&by), f32::INFINITY).1
        };
        let slides = SLIDES.into_iter().flat_map(|r| {
            let to = move |k: usize| (k as f32 * FRAC_PI_4).sin_cos();
            let level =
                (0..8).map(to).flat_map(move |(s, c)| [-TURN, 0.0, TURN].map(|t| [r * c, r * s, 0.0, t]));
            level.chain([r, -r].map(|z| [0.0, 0.0, z, 0.0]))
        });
        let turns = TURNS.into_iter().flat_map(|t| [t, -t]).map(|t| [0.0, 0.0, 0.0, t]);
        let mut most = f32::MIN;
        for by in slides.chain(turns) {
            if !work.spend(near.len() as u64) {
                return None;
            }
            most = most.max(worth(by));
        }
        Some(worth([0.0; 4]) - most)
    }
}

/// Whether there is at most so much space between two boxes whose centres are `d` apart, in every direction.
fn is_near(r: &Slab, q: &Slab, d: [f32; 3], apart: f32) -> bool {
    (0..3).all(|k| d[k].abs() <= r.half[k] + q.half[k] + apart)
}

fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}
