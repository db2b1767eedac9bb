//! What a pose is worth: one-to-one pairs under it, and the log of how much better it explains both
//! graphs than chance does.
//!
//! For a query node q and a reference node r at horizontal distance d and height difference h under
//! the pose, the evidence is `ln L + ln S + ln G`:
//! - L, labels: `sum p_q(c) p_r(c) / pi(c)` over the classes c that either names (probabilities p,
//!   share pi of the class in the reference); classes that a node does not name share what is left;
//! - S, sizes: a Gaussian of the log ratios of height and footprint against that of any two objects;
//! - G, place: `exp(-d^2 / 2 s^2) / (2 pi s^2 rho)` with rho objects per square metre, and the same
//!   for heights against objects of one kind, whose heights agree anyway.
//!
//! S and G are mixed with a share of outliers. The noise s is that of the pairs themselves, pulled
//! towards a prior.

use super::index::{Index, Item, Slots};
use super::{RobustParams, Work};
use crate::{LabelId, Looked, Query, fit};
use nalgebra::{Isometry3, Point3};
use std::cell::Cell;

/// Noise of centroids that is assumed before any pair is seen, metres, and how many pairs that
/// assumption is worth.
const SIGMA: (f32, f32) = (0.12, 3.0);
/// Noise of log sizes: height, footprint (it grows by a turn), and diagonal of tilted boxes.
const SIZE_NOISE: [f32; 3] = [0.2, 0.25, 0.4];
/// Spread of log sizes and heights over objects of one kind.
const SIZE_SPREAD: f32 = 0.5;
const HEIGHT_SPREAD: f32 = 0.25;
/// Most fits until a pose rests.
const SETTLE: usize = 20;
/// Distances within which an object's surroundings are known where nothing says what was seen.
const KNOWN: f32 = 1.0;

/// A pair and its evidence.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair<'a> {
    pub query: usize,
    pub slot: u32,
    pub item: &'a Item,
    pub evidence: f32,
    /// Distance under the pose, metres.
    pub distance: f32,
}

/// A pose and what speaks for it.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis<'a> {
    pub pose: Isometry3<f32>,
    pub pairs: Vec<Pair<'a>>,
    /// Sum of the evidence of the pairs less what is missing, natural log.
    pub evidence: f32,
    /// What is known of the frames beside the graphs adds this where poses are compared.
    pub preference: f32,
    /// Noise of the pairs' centroids, metres per axis.
    pub sigma: f32,
    /// Query nodes without a pair at places that the reference knows.
    pub query_missing: usize,
    /// Reference nodes without a pair at places that the query saw.
    pub reference_missing: usize,
}

impl Hypothesis<'_> {
    /// By what poses are put in order.
    pub(super) fn rank(&self) -> f32 {
        self.evidence + self.preference
    }
}

/// What all hypotheses of one search share.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub index: &'a Index,
    pub query: &'a [Item],
    pub looked: Option<&'a Looked>,
    /// The query's x axis is turned round.
    pub mirrored: bool,
    pub upright: bool,
    pub params: &'a RobustParams,
    pub memo: &'a Memo,
}

/// The shares of labels and sizes in the evidence of pairs, which no pose changes, of those that were asked for
/// last: by object of the query and place in the index.
pub(super) struct Memo(Vec<Cell<(u64, [f32; 2])>>);

impl Memo {
    /// For a query of so many objects.
    pub(super) fn new(objects: usize) -> Self {
        Self(vec![Cell::default(); (32 * objects).clamp(256, 1 << 15).next_power_of_two()])
    }

    fn of(&self, query: usize, slot: u32, make: impl FnOnce() -> [f32; 2]) -> [f32; 2] {
        // No pair has the key 0, with which it begins.
        let key = (query as u64 + 1) << 32 | u64::from(slot);
        let at = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as usize & (self.0.len() - 1);
        let Some(cell) = self.0.get(at) else { return make() };
        if cell.get().0 != key {
            cell.set((key, make()));
        }
        cell.get().1
    }
}

impl<'a> Scene<'a> {
    pub(super) fn new(
        index: &'a Index,
        items: &'a [Item],
        query: &Query<'a>,
        params: &'a RobustParams,
        memo: &'a Memo,
    ) -> Self {
        Self {
            index,
            query: items,
            looked: query.looked,
            mirrored: false,
            upright: query.gravity_aligned,
            params,
            memo,
        }
    }

    /// Matches, fits, and matches again with narrower gates.
    pub(super) fn refine(&self, pose: &Isometry3<f32>, work: &mut Work) -> Option<Hypothesis<'a>> {
        let (mut pose, mut sigma) = (*pose, 0.35);
        for gate in [1.0, 0.8, 0.6, 0.6, 0.6, 0.6] {
            (pose, sigma) = self.fitted(&pose, gate, sigma, work)?;
        }
        self.judge(pose, sigma, work)
    }

    /// As [`Self::refine`], given up where the objects that find a counterpart at first could not exceed a bar.
    pub(super) fn refine_beyond(
        &self,
        pose: &Isometry3<f32>,
        most: &[f32],
        bar: f32,
        work: &mut Work,
    ) -> Option<Hypothesis<'a>> {
        let pairs = self.pairs(pose, 1.0, 0.35, work)?;
        let hope: f32 = pairs.iter().map(|p| most[p.query]).sum();
        if hope > bar { self.refine(pose, work) } else { None }
    }

    /// The largest evidence that each object of the query can have among some of the reference, wherever it
    /// lies: classes and sizes as they are, places without error, the least noise that pairs can show.
    pub(super) fn most(&self, place: &[(u32, Item)]) -> Vec<f32> {
        let (prior, weight) = SIGMA;
        let freedom = (self.query.len() as f32 - 2.0).max(0.0) + weight;
        let sigma = (weight * prior * prior / freedom).sqrt().max(0.05);
        let most = |q: &Item| {
            // Against itself all but the class is as good as it can be.
            let rest = self.evidence(q, q, &q.p, sigma) - self.label_ratio(q, q).ln();
            place.iter().fold(0.0_f32, |best, (_, r)| {
                let hope = self.label_ratio(q, r).ln() + rest;
                if hope > best { best.max(self.evidence(q, r, &r.p, sigma)) } else { best }
            })
        };
        self.query.iter().map(most).collect()
    }

    /// One matching and the pose and noise that it implies; none with fewer than three pairs.
    fn fitted(
        &self,
        pose: &Isometry3<f32>,
        gate: f32,
        sigma: f32,
        work: &mut Work,
    ) -> Option<(Isometry3<f32>, f32)> {
        let pairs = self.pairs(pose, gate, sigma, work)?;
        if pairs.len() < 3 {
            return None;
        }
        let scale = sigma * 1.5;
        let points: Vec<_> = pairs
            .iter()
            .map(|p| (self.query[p.query].p, p.item.p, 1.0 / (1.0 + (p.distance / scale).powi(2))))
            .collect();
        let pose = fit::rigid(&points, self.upright);
        Some((pose, self.noise(&pose, &pairs).max(sigma * 0.5)))
    }

    /// A refined pose, refined until it rests: candidates come near it from different sides.
    pub(super) fn settled(&self, h: &Hypothesis<'_>, work: &mut Work) -> Option<Hypothesis<'a>> {
        let (mut pose, mut sigma) = (h.pose, h.sigma);
        let at = super::vote::centre(self.query);
        for _ in 0..SETTLE {
            let (next, noise) = self.fitted(&pose, 0.6, sigma, work)?;
            let moved = (next * at - pose * at).norm() + 3.0 * next.rotation.angle_to(&pose.rotation);
            (pose, sigma) = (next, noise);
            if moved < 2e-4 {
                break;
            }
        }
        self.judge(pose, sigma, work)
    }

    /// Noise per axis of pairs under a pose that was fitted to them.
    fn noise(&self, pose: &Isometry3<f32>, pairs: &[Pair<'_>]) -> f32 {
        let horizontal = |p: &Pair<'_>| {
            let d = pose * self.query[p.query].p - p.item.p;
            d.x * d.x + d.y * d.y
        };
        let sum: f32 = pairs.iter().map(horizontal).sum();
        let (prior, weight) = SIGMA;
        let freedom = (pairs.len() as f32 - 2.0).max(0.0);
        ((sum + 2.0 * weight * prior * prior) / (2.0 * (freedom + weight))).sqrt().clamp(0.05, 0.4)
    }

    /// One-to-one pairs of positive evidence within a gate, best first. `None`: out of budget.
    fn pairs(&self, pose: &Isometry3<f32>, gate: f32, sigma: f32, work: &mut Work) -> Option<Vec<Pair<'a>>> {
        let mut all = Vec::new();
        for (k, q) in self.query.iter().enumerate() {
            let p = pose * q.p;
            let mut looked_at = 1;
            self.index.near(&p, gate, |slot, r| {
                looked_at += 1;
                let fixed = self.memo.of(k, slot, || self.fixed(q, r));
                let evidence = self.evidence_of(fixed, &p, &r.p, sigma);
                if evidence > 0.0 {
                    all.push(Pair { query: k, slot, item: r, evidence, distance: (p - r.p).norm() });
                }
            });
            if !work.spend(looked_at) {
                return None;
            }
        }
        all.sort_by(|a, b| {
            b.evidence.total_cmp(&a.evidence).then(a.query.cmp(&b.query)).then_with(|| a.item.order(b.item))
        });
        let mut used_q = vec![false; self.query.len()];
        let mut used_r = Slots::with_capacity_and_hasher(all.len(), Default::default());
        all.retain(|p| {
            !used_q[p.query] && used_r.insert(p.slot) && {
                used_q[p.query] = true;
                true
            }
        });
        Some(all)
    }

    /// Log-likelihood ratio of q at p and r being one object.
    pub(super) fn evidence(&self, q: &Item, r: &Item, p: &Point3<f32>, sigma: f32) -> f32 {
        self.evidence_of(self.fixed(q, r), p, &r.p, sigma)
    }

    /// The factors of labels and sizes.
    fn fixed(&self, q: &Item, r: &Item) -> [f32; 2] {
        let size = if self.upright {
            let h = (q.size.height - r.size.height) / SIZE_NOISE[0];
            let f = (q.size.foot - r.size.foot) / SIZE_NOISE[1];
            let gain = SIZE_SPREAD * SIZE_SPREAD / (SIZE_NOISE[0] * SIZE_NOISE[1]);
            gain * (-0.5 * (h * h + f * f)).exp()
        } else {
            let a = (q.size.all - r.size.all) / SIZE_NOISE[2];
            SIZE_SPREAD / SIZE_NOISE[2] * (-0.5 * a * a).exp()
        };
        [self.label_ratio(q, r), 0.8 * size + 0.2]
    }

    /// The same of an object at p and one at r, given those factors.
    fn evidence_of(&self, [label, size]: [f32; 2], p: &Point3<f32>, r: &Point3<f32>, sigma: f32) -> f32 {
        let (dx, dy, dz) = (p.x - r.x, p.y - r.y, p.z - r.z);
        let flat = (dx * dx + dy * dy) / (2.0 * sigma * sigma);
        let tau = std::f32::consts::TAU;
        let place = 0.95 * (-flat).exp() / (tau * sigma * sigma * self.index.density()) + 0.02;
        let high = (HEIGHT_SPREAD / sigma).max(1.0) * (-dz * dz / (2.0 * sigma * sigma)).exp();
        (label * place * (0.9 * high + 0.1) * size).ln()
    }

    /// `sum p_q(c) p_r(c) / pi(c)` over the classes that either names.
    fn label_ratio(&self, q: &Item, r: &Item) -> f32 {
        let kinds = self.index.kinds();
        let (other_q, other_r) = (q.other_probability(kinds), r.other_probability(kinds));
        let mut sum = 0.0;
        let mut add = |c: LabelId, p: f32, q: f32| sum += p * q / self.index.share(c);
        for c in q.classes() {
            let p = q.named_probability(c).unwrap_or(other_q);
            add(c, p, r.named_probability(c).unwrap_or(other_r));
        }
        for c in r.classes() {
            if q.named_probability(c).is_none() {
                add(c, other_q, r.named_probability(c).unwrap_or(other_r));
            }
        }
        sum.max(1e-3)
    }

    /// A pose as it is, without fitting it.
    pub(super) fn judge_at(&self, pose: &Isometry3<f32>, work: &mut Work) -> Hypothesis<'a> {
        let mut sigma = 0.2;
        for _ in 0..2 {
            if let Some(pairs) = self.pairs(pose, 0.6, sigma, work) {
                sigma = self.noise(pose, &pairs);
            }
        }
        let nothing = Hypothesis {
            pose: *pose,
            pairs: Vec::new(),
            evidence: f32::MIN,
            preference: 0.0,
            sigma,
            query_missing: 0,
            reference_missing: 0,
        };
        self.judge(*pose, sigma, work).unwrap_or(nothing)
    }

    /// The pairs under a pose, and what is missing.
    fn judge(&self, pose: Isometry3<f32>, sigma: f32, work: &mut Work) -> Option<Hypothesis<'a>> {
        let pairs = self.pairs(&pose, (4.0 * sigma).clamp(0.25, 0.8), sigma, work)?;
        let mut matched_q = vec![false; self.query.len()];
        pairs.iter().for_each(|p| matched_q[p.query] = true);
        let matched_r: Slots = pairs.iter().map(|p| p.slot).collect();
        let mut query_missing = 0;
        let mut in_view = Slots::default();
        for (k, q) in self.query.iter().enumerate() {
            let p = pose * q.p;
            let mut known = false;
            self.index.near(&p, KNOWN, |slot, _| {
                known = true;
                in_view.insert(slot);
            });
            query_missing += usize::from(known && !matched_q[k]);
        }
        if let Some(looked) = self.looked {
            let back = pose.inverse();
            let seen = |r: &Item| {
                let mut p = back * r.p;
                if self.mirrored {
                    p.x = -p.x;
                }
                looked.contains(&p)
            };
            in_view = self.around(&pose).into_iter().filter(|(_, r)| seen(r)).map(|(s, _)| s).collect();
        }
        if !work.spend(in_view.len() as u64 + self.query.len() as u64) {
            return None;
        }
        let reference_missing = in_view.difference(&matched_r).count();
        let gained: f32 = pairs.iter().map(|p| p.evidence).sum();
        let lost = self.params.missing * (query_missing + reference_missing) as f32;
        let evidence = gained - lost;
        Some(Hypothesis { pose, pairs, evidence, preference: 0.0, sigma, query_missing, reference_missing })
    }

    /// Reference objects in the surroundings of the query.
    pub(super) fn around(&self, pose: &Isometry3<f32>) -> Vec<(u32, Item)> {
        let Some(first) = self.query.first() else { return Vec::new() };
        let (mut lo, mut hi) = (pose * first.p, pose * first.p);
        for q in self.query {
            let p = pose * q.p;
            (lo, hi) = (lo.inf(&p), hi.sup(&p));
        }
        let mut out = Vec::new();
        let middle = nalgebra::center(&lo, &hi);
        self.index.near(&middle, (hi - lo).xy().norm() / 2.0 + 3.0, |slot, r| out.push((slot, *r)));
        out
    }
}
