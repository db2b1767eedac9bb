//! Votes of labelled pairs for poses, and the correspondences behind the best of them.

use super::index::{BIN, Index, Item, bin};
use super::{RobustParams, Work};
use crate::fit;
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;

/// Bins of yaw in a full turn.
const YAWS: i32 = 30;
/// Side of the bins of the place where the query's centre lands, horizontal and vertical, metres.
const PLACE: f32 = 0.8;
const HEIGHT: f32 = 1.0;
/// Bins whose surroundings are summed up.
const BEST_BINS: usize = 160;
/// Pairs nearer than this tell too little about yaw, metres.
const SHORTEST: f32 = 0.4;
/// Largest difference of a pair's distances, horizontal and vertical, metres.
const PAIR_GATE: f32 = 0.45;
/// Sum of the weights of one query pair's hits.
const UNIT: u32 = 1 << 20;

/// A reference pair that looks like a query pair, and the bin of the pose under which it does.
struct Hit {
    query: [u16; 2],
    reference: [u32; 2],
    bin: Bin,
    weight: u32,
}

type Bin = [i32; 4];

/// The bin of a yaw and of the place where the query's centre lands.
fn bin_of(yaw: f32, at: &Point3<f32>) -> Bin {
    let place = |v: f32, side: f32| (v / side).floor() as i32;
    let turn = (yaw.rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU * YAWS as f32) as i32;
    [turn.min(YAWS - 1), place(at.x, PLACE), place(at.y, PLACE), place(at.z, HEIGHT)]
}

/// Whether two bins touch; yaw wraps round.
fn touch(a: &Bin, b: &Bin) -> bool {
    let yaw = (a[0] - b[0]).rem_euclid(YAWS);
    (yaw <= 1 || yaw == YAWS - 1) && (1..4).all(|k| (a[k] - b[k]).abs() <= 1)
}

/// What limits the search to the surroundings of a known pose.
pub(super) struct Near<'a> {
    pub prior: &'a Isometry3<f32>,
    pub range: f32,
}

/// Poses that many pairs vote for, best first, at most `params.peaks`.
///
/// Each query pair shares one vote out among the reference pairs that look like it, so that common
/// pairs weigh little. Pairs are looked up from the rarest on, until the budget is spent.
pub(super) fn poses(
    index: &Index,
    query: &[Item],
    near: Option<&Near<'_>>,
    params: &RobustParams,
    work: &mut Work,
) -> Vec<Isometry3<f32>> {
    let centre = centre(query);
    let hits = match near {
        None => indexed_hits(index, query, &centre, params, work),
        Some(n) => near_hits(index, query, &centre, n, work),
    };
    let mut table: BTreeMap<Bin, u64> = BTreeMap::new();
    for h in &hits {
        *table.entry(h.bin).or_default() += u64::from(h.weight);
    }
    peaks(&table, params.peaks).iter().filter_map(|p| solve(index, query, &hits, p)).collect()
}

/// Mean of the centroids.
pub(super) fn centre(query: &[Item]) -> Point3<f32> {
    let n = query.len().max(1) as f64;
    let sum = query.iter().fold(Vector3::<f64>::zeros(), |s, i| s + i.p.coords.cast::<f64>());
    Point3::from((sum / n).cast::<f32>())
}

/// The bins with the largest sums over themselves and their neighbours; no two of them touch.
fn peaks(table: &BTreeMap<Bin, u64>, count: usize) -> Vec<Bin> {
    let mut best: Vec<(u64, Bin)> = table.iter().map(|(b, w)| (*w, *b)).collect();
    let order = |a: &(u64, Bin), b: &(u64, Bin)| b.0.cmp(&a.0).then(a.1.cmp(&b.1));
    if best.len() > BEST_BINS {
        best.select_nth_unstable_by(BEST_BINS, order);
        best.truncate(BEST_BINS);
    }
    for (sum, b) in &mut best {
        *sum = around(table, b);
    }
    best.sort_unstable_by(order);
    let mut out: Vec<Bin> = Vec::new();
    for (_, b) in best {
        if out.len() == count {
            break;
        }
        if !out.iter().any(|o| touch(o, &b)) {
            out.push(b);
        }
    }
    out
}

fn around(table: &BTreeMap<Bin, u64>, b: &Bin) -> u64 {
    let mut sum = 0;
    for yaw in [-1, 0, 1].map(|d| (b[0] + d).rem_euclid(YAWS)) {
        for x in b[1] - 1..=b[1] + 1 {
            for y in b[2] - 1..=b[2] + 1 {
                let rows = table.range([yaw, x, y, b[3] - 1]..=[yaw, x, y, b[3] + 1]);
                sum += rows.map(|(_, w)| *w).sum::<u64>();
            }
        }
    }
    sum
}

/// The pose behind a peak: correspondences by the votes of the pairs that they are part of, taken
/// one-to-one from the strongest on, then a least-squares fit.
fn solve(index: &Index, query: &[Item], hits: &[Hit], peak: &Bin) -> Option<Isometry3<f32>> {
    let mut votes: BTreeMap<(u16, u32), u64> = BTreeMap::new();
    for h in hits.iter().filter(|h| touch(&h.bin, peak)) {
        for k in 0..2 {
            *votes.entry((h.query[k], h.reference[k])).or_default() += u64::from(h.weight);
        }
    }
    let mut list: Vec<(u64, u16, u32)> = votes.into_iter().map(|((q, r), w)| (w, q, r)).collect();
    list.sort_by(|a, b| {
        b.0.cmp(&a.0).then(a.1.cmp(&b.1)).then_with(|| match (index.item(a.2), index.item(b.2)) {
            (Some(x), Some(y)) => x.order(y),
            _ => std::cmp::Ordering::Equal,
        })
    });
    let strongest = list.first()?.0;
    let (mut used_q, mut used_r) = (Vec::new(), Vec::new());
    let mut points = Vec::new();
    for (w, q, r) in list {
        if w * 8 < strongest || used_q.contains(&q) || used_r.contains(&r) {
            continue;
        }
        used_q.push(q);
        used_r.push(r);
        points.push((query[q as usize].p, index.item(r)?.p, w as f32));
    }
    (points.len() >= 2).then(|| fit::rigid(&points, true))
}

/// Whether two objects may be one: sizes within a factor of two.
pub(super) fn alike(a: &Item, b: &Item) -> bool {
    (a.size.height - b.size.height).abs() < 0.7 && (a.size.foot - b.size.foot).abs() < 0.7
}

/// The pose that carries one pair onto another.
fn hit(query: &[Item], [i, j]: [u16; 2], centre: &Point3<f32>, a: (u32, &Item), b: (u32, &Item)) -> Hit {
    let (qa, qb) = (&query[i as usize], &query[j as usize]);
    let (q, r) = (qb.p - qa.p, b.1.p - a.1.p);
    let (dot, cross) = (q.x * r.x + q.y * r.y, q.x * r.y - q.y * r.x);
    let n = dot.hypot(cross).max(1e-9);
    let (cos, sin) = (dot / n, cross / n);
    let from = centre - nalgebra::center(&qa.p, &qb.p);
    let turned = Vector3::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y, from.z);
    Hit {
        query: [i, j],
        reference: [a.0, b.0],
        bin: bin_of(cross.atan2(dot), &(nalgebra::center(&a.1.p, &b.1.p) + turned)),
        weight: 0,
    }
}

fn fits(q: &Vector3<f32>, r: &Vector3<f32>) -> bool {
    (q.x.hypot(q.y) - r.x.hypot(r.y)).abs() < PAIR_GATE && (q.z - r.z).abs() < PAIR_GATE
}

/// Shares one vote out among the hits from `from` on.
fn share(hits: &mut [Hit], from: usize) {
    let n = (hits.len() - from).max(1) as u32;
    hits[from..].iter_mut().for_each(|h| h.weight = (UNIT / n).max(1));
}

fn indexed_hits(
    index: &Index,
    query: &[Item],
    centre: &Point3<f32>,
    params: &RobustParams,
    work: &mut Work,
) -> Vec<Hit> {
    // (entries to look at, first node, second node), the smaller label first.
    let mut pairs: Vec<(usize, [u16; 2], [i32; 2])> = Vec::new();
    for i in 0..query.len() {
        // The loop itself is work, too, for a query of thousands of nodes.
        if !work.spend(query.len() as u64 / 16) {
            break;
        }
        for j in i + 1..query.len() {
            let [a, b] = if query[i].label <= query[j].label { [i, j] } else { [j, i] };
            let d = query[b].p - query[a].p;
            let dxy = d.x.hypot(d.y);
            if !(SHORTEST..params.pair_range).contains(&dxy) {
                continue;
            }
            let at = [bin(dxy), bin(d.z)];
            let labels = [query[a].label, query[b].label];
            let entries = probes(at).map(|[x, z]| index.pairs(labels, x, z).len()).sum();
            if entries > 0 {
                pairs.push((entries, [a as u16, b as u16], at));
            }
        }
    }
    pairs.sort_unstable();
    let mut hits = Vec::new();
    for (entries, [a, b], at) in pairs {
        if !work.spend(entries as u64) {
            break;
        }
        let (qa, qb) = (&query[a as usize], &query[b as usize]);
        let d = qb.p - qa.p;
        let from = hits.len();
        for [x, z] in probes(at) {
            for &[ra, rb] in index.pairs([qa.label, qb.label], x, z) {
                let (Some(ia), Some(ib)) = (index.item(ra), index.item(rb)) else { continue };
                if fits(&d, &(ib.p - ia.p)) && alike(qa, ia) && alike(qb, ib) {
                    hits.push(hit(query, [a, b], centre, (ra, ia), (rb, ib)));
                }
            }
        }
        share(&mut hits, from);
    }
    hits
}

/// The bin of a pair and its neighbours.
fn probes([x, z]: [i32; 2]) -> impl Iterator<Item = [i32; 2]> {
    (-1..=1).flat_map(move |i| (-1..=1).map(move |j| [x + i, z + j])).filter(|b| b[0] >= 0)
}

/// Hits among the objects near where a prior puts the query's nodes.
fn near_hits(
    index: &Index,
    query: &[Item],
    centre: &Point3<f32>,
    near: &Near<'_>,
    work: &mut Work,
) -> Vec<Hit> {
    let mut candidates: Vec<Vec<(u32, Item)>> = Vec::with_capacity(query.len());
    for q in query {
        let mut list = Vec::new();
        index.near(&(near.prior * q.p), near.range, |slot, r| {
            if r.label == q.label && alike(q, r) {
                list.push((slot, *r));
            }
        });
        list.sort_by(|a, b| a.1.order(&b.1));
        candidates.push(list);
    }
    let mut hits = Vec::new();
    for i in 0..query.len() {
        for j in i + 1..query.len() {
            let d = query[j].p - query[i].p;
            let tries = if d.x.hypot(d.y) < SHORTEST { 0 } else { candidates[i].len() * candidates[j].len() };
            if !work.spend(tries as u64 + u64::from(j.is_multiple_of(16))) {
                return hits;
            }
            if tries == 0 {
                continue;
            }
            let from = hits.len();
            for a in &candidates[i] {
                for b in &candidates[j] {
                    if a.0 != b.0 && fits(&d, &(b.1.p - a.1.p)) {
                        hits.push(hit(query, [i as u16, j as u16], centre, (a.0, &a.1), (b.0, &b.1)));
                    }
                }
            }
            share(&mut hits, from);
        }
    }
    hits
}

const _: () = assert!(BIN < PAIR_GATE + 0.3, "a pair within the gate lies in a probed bin, nearly always");
