//! Votes of labelled pairs for poses, and the correspondences behind the best of them.

use super::index::{BIN, Brief, Index, Item, bin};
use super::{RobustParams, Work};
use crate::fit;
use nalgebra::{Isometry3, Point3, Vector3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Bins of yaw in a full turn.
const YAWS: i32 = 30;
/// Side of the bins of the place where the query's centre lands, horizontal and vertical, metres.
const PLACE: f32 = 0.8;
const HEIGHT: f32 = 1.0;
/// Peaks that are tried around a prior.
const PRIOR_PEAKS: usize = 4;
/// Bins whose surroundings are summed up.
const BEST_BINS: usize = 160;
/// The same among the few objects of one place.
const PLACE_BINS: usize = 40;
/// Objects of the query that vote among those of one place, the ones with the fewest counterparts.
const RAREST: usize = 14;
/// Pairs nearer than this tell too little about yaw, metres.
const SHORTEST: f32 = 0.4;
/// Largest difference of a pair's distances, horizontal and vertical, metres.
const PAIR_GATE: f32 = 0.45;
/// Sum of the weights of one query pair's hits.
const UNIT: u32 = 1 << 20;

/// A reference pair that looks like a query pair, and the bin of the pose under which it does.
pub(super) struct Hit {
    pub query: [u16; 2],
    pub reference: [u32; 2],
    pub bin: Bin,
    pub weight: u32,
}

pub(super) type Bin = [i32; 4];

/// The bin of a yaw and of the place where the query's centre lands.
fn bin_of(yaw: f32, at: &Point3<f32>) -> Bin {
    let place = |v: f32, side: f32| (v / side).floor() as i32;
    let turn = (yaw / TAU * YAWS as f32) as i32;
    [turn.clamp(0, YAWS - 1), place(at.x, PLACE), place(at.y, PLACE), place(at.z, HEIGHT)]
}

/// Angle of (x, y) in 0 to a full turn, to 0.005: bins are forty times as wide. A polynomial, so that it
/// is fast and the same on every machine.
fn angle(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let a = ax.min(ay) / ax.max(ay).max(1e-30);
    let r = a * (0.9724 - 0.1919 * a * a);
    let r = if ay > ax { FRAC_PI_2 - r } else { r };
    let r = if x < 0.0 { PI - r } else { r };
    if y < 0.0 { TAU - r } else { r }
}

/// Hits in the order of their bins, bins as numbers that rise with [yaw, x, y, z].
pub(super) struct Sorted {
    /// Bin and place in the list of hits.
    order: Vec<(u64, u32)>,
    /// Bin, summed weight, and where it begins in `order`.
    bins: Vec<(u64, u64, u32)>,
}

/// A bin as a number: 16 bits each for the places, which wrap round after 26 km.
fn key(b: &Bin) -> u64 {
    let place = |v: i32| u64::from(v as u16 ^ 0x8000);
    (b[0] as u64) << 48 | place(b[1]) << 32 | place(b[2]) << 16 | place(b[3])
}

impl Sorted {
    pub(super) fn of(hits: &[Hit]) -> Self {
        let mut order: Vec<(u64, u32)> = hits.iter().zip(0..).map(|(h, k)| (key(&h.bin), k)).collect();
        order.sort_unstable();
        let mut bins: Vec<(u64, u64, u32)> = Vec::new();
        for (at, &(key, k)) in order.iter().enumerate() {
            let weight = u64::from(hits[k as usize].weight);
            match bins.last_mut() {
                Some(b) if b.0 == key => b.1 += weight,
                _ => bins.push((key, weight, at as u32)),
            }
        }
        Self { order, bins }
    }

    /// The bins that touch one, in nine runs: those of one yaw and one x lie together.
    fn around(&self, b: &Bin) -> impl Iterator<Item = (usize, &(u64, u64, u32))> {
        let b = *b;
        let rows =
            [-1, 0, 1].into_iter().flat_map(move |yaw| (b[1] - 1..=b[1] + 1).map(move |x| [b[0] + yaw, x]));
        let mid = key(&b) & 0xffff;
        rows.flat_map(move |[yaw, x]| {
            let row = |y, z| key(&[yaw.rem_euclid(YAWS), x, y, z]);
            let (low, high) = (row(b[2] - 1, b[3] - 1), row(b[2] + 1, b[3] + 1));
            let from = self.bins.partition_point(|b| b.0 < low);
            let run = self.bins[from..].iter().take_while(move |b| b.0 <= high).enumerate();
            run.filter(move |(_, b)| (b.0 & 0xffff).abs_diff(mid) <= 1).map(move |(k, b)| (from + k, b))
        })
    }

    /// Places of the hits whose bins touch one.
    pub(super) fn hits_around(&self, b: &Bin) -> impl Iterator<Item = usize> {
        self.around(b).flat_map(|(k, bin)| {
            let end = self.bins.get(k + 1).map_or(self.order.len(), |next| next.2 as usize);
            self.order[bin.2 as usize..end].iter().map(|o| o.1 as usize)
        })
    }
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
    let sorted = Sorted::of(&hits);
    // Around a prior there is room for few distinct poses.
    let count = if near.is_some() { params.peaks.min(PRIOR_PEAKS) } else { params.peaks };
    peaks(&hits, &sorted, count, BEST_BINS)
        .iter()
        .filter_map(|p| solve(index, query, &hits, &sorted, p))
        .collect()
}

/// Mean of the centroids.
pub(super) fn centre(query: &[Item]) -> Point3<f32> {
    let n = query.len().max(1) as f64;
    let sum = query.iter().fold(Vector3::<f64>::zeros(), |s, i| s + i.p.coords.cast::<f64>());
    Point3::from((sum / n).cast::<f32>())
}

/// Of the fullest `bins` those with the largest sums over themselves and their neighbours; no two of them touch.
pub(super) fn peaks(hits: &[Hit], sorted: &Sorted, count: usize, bins: usize) -> Vec<Bin> {
    let bin = |b: &(u64, u64, u32)| hits[sorted.order[b.2 as usize].1 as usize].bin;
    let mut best: Vec<(u64, Bin)> = sorted.bins.iter().map(|b| (b.1, bin(b))).collect();
    let order = |a: &(u64, Bin), b: &(u64, Bin)| b.0.cmp(&a.0).then(a.1.cmp(&b.1));
    if best.len() > bins {
        best.select_nth_unstable_by(bins, order);
        best.truncate(bins);
    }
    for (sum, b) in &mut best {
        *sum = sorted.around(b).map(|(_, b)| b.1).sum();
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

/// The pose behind a peak: correspondences by the votes of the pairs that they are part of, taken
/// one-to-one from the strongest on, then a least-squares fit.
fn solve(index: &Index, query: &[Item], hits: &[Hit], sorted: &Sorted, peak: &Bin) -> Option<Isometry3<f32>> {
    let near = sorted.hits_around(peak).map(|k| &hits[k]);
    let mut votes: Vec<(u16, u32, u64)> = Vec::new();
    for h in near {
        votes.extend((0..2).map(|k| (h.query[k], h.reference[k], u64::from(h.weight))));
    }
    votes.sort_unstable();
    let same = |a: &(u16, u32, u64), b: &(u16, u32, u64)| (a.0, a.1) == (b.0, b.1);
    let sum = |of: &[(u16, u32, u64)]| (of.iter().map(|v| v.2).sum::<u64>(), of[0].0, of[0].1);
    let mut list: Vec<(u64, u16, u32)> = votes.chunk_by(same).map(sum).collect();
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
fn alike(a: &Item, b: &Item) -> bool {
    Brief::of(a).alike(&Brief::of(b))
}

/// The pose that carries one pair onto another.
fn hit(
    query: &[Item],
    [i, j]: [u16; 2],
    centre: &Point3<f32>,
    a: (u32, &Point3<f32>),
    b: (u32, &Point3<f32>),
) -> Hit {
    let (qa, qb) = (&query[i as usize], &query[j as usize]);
    let (q, r) = (qb.p - qa.p, b.1 - a.1);
    let (dot, cross) = (q.x * r.x + q.y * r.y, q.x * r.y - q.y * r.x);
    let n = length(dot, cross).max(1e-9);
    let (cos, sin) = (dot / n, cross / n);
    let from = centre - nalgebra::center(&qa.p, &qb.p);
    let turned = Vector3::new(cos * from.x - sin * from.y, sin * from.x + cos * from.y, from.z);
    Hit {
        query: [i, j],
        reference: [a.0, b.0],
        bin: bin_of(angle(cross, dot), &(nalgebra::center(a.1, b.1) + turned)),
        weight: 0,
    }
}

fn fits(q: &Vector3<f32>, r: &Vector3<f32>) -> bool {
    (length(q.x, q.y) - length(r.x, r.y)).abs() < PAIR_GATE && (q.z - r.z).abs() < PAIR_GATE
}

/// Length of (x, y); coordinates are far below where squares overflow.
fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

/// Shares one vote out among the hits from `from` on.
fn share(hits: &mut [Hit], from: usize) {
    let n = (hits.len() - from).max(1) as u32;
    hits[from..].iter_mut().for_each(|h| h.weight = (UNIT / n).max(1));
}

/// The reference pairs of the bins in which one query pair looks.
type Probed<'a> = [&'a [[u32; 2]]; 9];

fn indexed_hits(
    index: &Index,
    query: &[Item],
    centre: &Point3<f32>,
    params: &RobustParams,
    work: &mut Work,
) -> Vec<Hit> {
    // (entries to look at, first and second node with the smaller label first, the entries).
    let mut pairs: Vec<(usize, [u16; 2], Probed<'_>)> = Vec::new();
    for i in 0..query.len() {
        // The loop itself is work, too, for a query of thousands of nodes.
        if !work.spend(query.len() as u64 / 16) {
            break;
        }
        for j in i + 1..query.len() {
            let [a, b] = if query[i].label <= query[j].label { [i, j] } else { [j, i] };
            let d = query[b].p - query[a].p;
            let dxy = length(d.x, d.y);
            if !(SHORTEST..params.pair_range).contains(&dxy) {
                continue;
            }
            let at = [bin(dxy), bin(d.z)];
            let labels = [query[a].label, query[b].label];
            let lists = probes(at).map(|[x, z]| index.pairs(labels, x, z));
            let entries = lists.iter().map(|l| l.len()).sum();
            if entries > 0 {
                pairs.push((entries, [a as u16, b as u16], lists));
            }
        }
    }
    pairs.sort_unstable_by_key(|p| (p.0, p.1));
    let mut hits = Vec::new();
    for (entries, [a, b], lists) in pairs {
        if !work.spend(entries as u64) {
            break;
        }
        let (qa, qb) = (&query[a as usize], &query[b as usize]);
        let d = qb.p - qa.p;
        let (sa, sb) = (Brief::of(qa), Brief::of(qb));
        let from = hits.len();
        for &[ra, rb] in lists.into_iter().flatten() {
            let (Some(ia), Some(ib)) = (index.brief(ra), index.brief(rb)) else { continue };
            if fits(&d, &(ib.p - ia.p)) && sa.alike(ia) && sb.alike(ib) {
                hits.push(hit(query, [a, b], centre, (ra, &ia.p), (rb, &ib.p)));
            }
        }
        share(&mut hits, from);
    }
    hits
}

/// The bin of a pair and its neighbours; distances below zero have no entries.
fn probes([x, z]: [i32; 2]) -> [[i32; 2]; 9] {
    std::array::from_fn(|k| [x + k as i32 / 3 - 1, z + k as i32 % 3 - 1])
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
    hits_among(&candidates, query, centre, work)
}

/// Poses under which much of the query lies among a few objects that are known by then, best first.
pub(super) fn poses_among(
    index: &Index,
    query: &[Item],
    place: &[(u32, Item)],
    work: &mut Work,
) -> Vec<Isometry3<f32>> {
    if !work.spend((query.len() * place.len()) as u64) {
        return Vec::new();
    }
    let alike_in_place = |q: &Item| {
        place.iter().filter(|(_, r)| r.label == q.label && alike(q, r)).copied().collect::<Vec<_>>()
    };
    let mut candidates: Vec<_> = query.iter().map(alike_in_place).collect();
    // A pose that explains most objects explains most of the rare ones.
    let mut rare: Vec<usize> = (0..query.len()).filter(|&k| !candidates[k].is_empty()).collect();
    rare.sort_by_key(|&k| (candidates[k].len(), k));
    rare.iter().skip(RAREST).for_each(|&k| candidates[k].clear());
    let hits = hits_among(&candidates, query, &centre(query), work);
    let sorted = Sorted::of(&hits);
    peaks(&hits, &sorted, PRIOR_PEAKS, PLACE_BINS)
        .iter()
        .filter_map(|p| solve(index, query, &hits, &sorted, p))
        .collect()
}

/// Hits among the objects that each of the query's may be.
fn hits_among(
    candidates: &[Vec<(u32, Item)>],
    query: &[Item],
    centre: &Point3<f32>,
    work: &mut Work,
) -> Vec<Hit> {
    let mut hits = Vec::new();
    for i in 0..query.len() {
        for j in i + 1..query.len() {
            let d = query[j].p - query[i].p;
            let tries =
                if length(d.x, d.y) < SHORTEST { 0 } else { candidates[i].len() * candidates[j].len() };
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
                        hits.push(hit(query, [i as u16, j as u16], centre, (a.0, &a.1.p), (b.0, &b.1.p)));
                    }
                }
            }
            share(&mut hits, from);
        }
    }
    hits
}

const _: () = assert!(BIN < PAIR_GATE + 0.3, "a pair within the gate lies in a probed bin, nearly always");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_near_those_of_atan2() {
        for k in 0..10_000 {
            let turn = k as f32 / 10_000.0 * TAU;
            let (y, x) = turn.sin_cos();
            let off = (angle(3.0 * y, 3.0 * x) - turn).abs();
            assert!(off.min(TAU - off) < 0.0051, "{turn}: off by {off}");
        }
        assert!(angle(0.0, 0.0).is_finite());
    }

    #[test]
    fn bins_that_touch_are_found() {
        // Every bin of a small block twice, in an order of no meaning.
        let mut hits: Vec<Hit> = (0..2 * 30 * 5 * 5 * 5)
            .map(|k| {
                let k = k * 7919 % (30 * 125);
                let bin = [k / 125, k / 25 % 5 - 2, k / 5 % 5 - 2, k % 5 - 2];
                Hit { query: [0, 1], reference: [0, 1], bin, weight: 1 + k as u32 % 3 }
            })
            .collect();
        hits.truncate(5000);
        let sorted = Sorted::of(&hits);
        for at in [[0, 0, 0, 0], [29, -2, 2, 1], [15, 1, -1, -2]] {
            let mut found: Vec<usize> = sorted.hits_around(&at).collect();
            found.sort_unstable();
            let want: Vec<usize> = (0..hits.len()).filter(|&k| touch(&hits[k].bin, &at)).collect();
            assert_eq!(found, want);
            let sum: u64 = sorted.around(&at).map(|(_, b)| b.1).sum();
            assert_eq!(sum, want.iter().map(|&k| u64::from(hits[k].weight)).sum::<u64>());
        }
    }
}
