//! Comparators: what one would write in place of `graph_align`, done with care. Both draw pairs of nodes of equal class
//! and like size, build the dense table of which pairs keep their distance, solve it, fit yaw and shift (or any rotation
//! without gravity), and verify by one-to-one inliers under the fitted pose.
//!
//! - [`Solver::Spectral`]: the principal eigenvector of the table (Leordeanu and Hebert 2005), taken greedily.
//! - [`Solver::Clique`]: the largest set of pairs that all agree, by branch and bound within a budget.

use graph_align::{Match, NodeId, Outcome, Query, SceneGraph, Verdict, Vocabulary, Why};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Which solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solver {
    /// Principal eigenvector.
    Spectral,
    /// Largest clique.
    Clique,
}

/// Most pairs in the table; those of the rarest classes stay.
const MOST: usize = 2_000;
/// Noise of distances and heights, metres; pairs farther apart than three of it disagree.
const SIGMA: f32 = 0.12;
/// Inliers are within this of each other under the pose, metres.
const INLIER: f32 = 0.35;
/// Log ratios of height and footprint up to which two nodes may be one.
const SIZE: f32 = 0.45;
/// Least inliers of a match, and their least share of the query's objects.
const LEAST: (usize, f32) = (5, 0.12);
/// Another place with this share of the inliers makes the answer ambiguous.
const RIVAL: f32 = 0.9;
/// Branches of the clique search.
const BRANCHES: usize = 20_000;

struct Spot {
    id: NodeId,
    label: u16,
    p: Point3<f32>,
    size: [f32; 2],
}

fn spots(g: &SceneGraph, names: &Vocabulary) -> Vec<Spot> {
    let structure: Vec<_> = ["wall", "floor", "ceiling"].iter().filter_map(|n| names.find_label(n)).collect();
    let of = |n: graph_align::Node| {
        let e = n.bounds.extent().map(|v| v.max(0.02));
        let size = [e.z.ln(), n.bounds.ground_diagonal().max(0.02).ln()];
        Spot { id: n.id, label: n.label.0, p: n.bounds.centroid(), size }
    };
    g.nodes().filter(|n| !structure.contains(&n.label)).map(of).collect()
}

/// Pairs (query, reference) that may be one object.
fn putatives(query: &[Spot], reference: &[Spot], upright: bool) -> Vec<[usize; 2]> {
    let mut share: BTreeMap<u16, usize> = BTreeMap::new();
    reference.iter().for_each(|r| *share.entry(r.label).or_default() += 1);
    let alike = |q: &Spot, r: &Spot| {
        let size = (0..2).all(|k| (q.size[k] - r.size[k]).abs() < SIZE);
        q.label == r.label && (size || !upright) && (!upright || (q.p.z - r.p.z).abs() < 2.5)
    };
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for (i, q) in query.iter().enumerate() {
        pairs.extend(reference.iter().enumerate().filter(|(_, r)| alike(q, r)).map(|(j, _)| [i, j]));
    }
    pairs.sort_by_key(|p| (share[&reference[p[1]].label], *p));
    pairs.truncate(MOST);
    pairs
}

/// How well two pairs agree, 0 to 1.
fn agreement(query: &[Spot], reference: &[Spot], a: [usize; 2], b: [usize; 2], upright: bool) -> f32 {
    if a[0] == b[0] || a[1] == b[1] {
        return 0.0;
    }
    let (dq, dr) = (query[a[0]].p - query[b[0]].p, reference[a[1]].p - reference[b[1]].p);
    let off = if upright {
        (dq.xy().norm() - dr.xy().norm()).abs().max((dq.z - dr.z).abs())
    } else {
        (dq.norm() - dr.norm()).abs()
    };
    if off > 3.0 * SIGMA { 0.0 } else { (-0.5 * (off / SIGMA).powi(2)).exp() }
}

/// Pairs in the order of the principal eigenvector of their table, each with its predecessors consistent.
fn spectral(n: usize, table: &[f32]) -> Vec<usize> {
    let mut v = vec![1.0_f32; n];
    for _ in 0..30 {
        let mut next: Vec<f32> =
            (0..n).map(|i| table[i * n..(i + 1) * n].iter().zip(&v).map(|(a, x)| a * x).sum()).collect();
        let norm = next.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-12);
        next.iter_mut().for_each(|x| *x /= norm);
        v = next;
    }
    let mut order: Vec<usize> = (0..n).filter(|&i| v[i] > 1e-3).collect();
    order.sort_by(|&a, &b| v[b].total_cmp(&v[a]).then(a.cmp(&b)));
    let mut chosen: Vec<usize> = Vec::new();
    for i in order {
        let agree = chosen.iter().filter(|&&c| table[i * n + c] > 0.0).count();
        if 2 * agree >= chosen.len() {
            chosen.push(i);
        }
    }
    chosen
}

/// The largest set of pairs that all agree, as far as the budget goes; the largest degrees first.
fn clique(n: usize, table: &[f32]) -> Vec<usize> {
    let words = n.div_ceil(64);
    let mut bits = vec![0_u64; n * words];
    for i in 0..n {
        (0..n).filter(|&j| table[i * n + j] > 0.3).for_each(|j| bits[i * words + j / 64] |= 1 << (j % 64));
    }
    let mut roots: Vec<usize> = (0..n).collect();
    let degree = |i: usize| bits[i * words..(i + 1) * words].iter().map(|w| w.count_ones()).sum::<u32>();
    roots.sort_by_key(|&i| (std::cmp::Reverse(degree(i)), i));
    let (mut best, mut left) = (Vec::new(), BRANCHES);
    for root in roots {
        let candidates = bits[root * words..(root + 1) * words].to_vec();
        grow(&bits, words, &mut vec![root], candidates, &mut best, &mut left);
        if left == 0 {
            break;
        }
    }
    best
}

fn grow(
    bits: &[u64],
    words: usize,
    chosen: &mut Vec<usize>,
    candidates: Vec<u64>,
    best: &mut Vec<usize>,
    left: &mut usize,
) {
    *left = left.saturating_sub(1);
    if chosen.len() > best.len() {
        best.clone_from(chosen);
    }
    let mut candidates = candidates;
    loop {
        let count: u32 = candidates.iter().map(|w| w.count_ones()).sum();
        if *left == 0 || chosen.len() + count as usize <= best.len() {
            return;
        }
        // The candidate that agrees with most others.
        let all = (0..words * 64).filter(|&i| candidates[i / 64] >> (i % 64) & 1 == 1);
        let common = |i: usize| -> u32 {
            (0..words).map(|w| (candidates[w] & bits[i * words + w]).count_ones()).sum()
        };
        let Some(i) = all.max_by_key(|&i| (common(i), std::cmp::Reverse(i))) else { return };
        let inner = (0..words).map(|w| candidates[w] & bits[i * words + w]).collect();
        chosen.push(i);
        grow(bits, words, chosen, inner, best, left);
        chosen.pop();
        candidates[i / 64] &= !(1 << (i % 64));
    }
}

/// Least squares over pairs of points.
fn fit(pairs: &[(Point3<f32>, Point3<f32>)], upright: bool) -> Isometry3<f32> {
    let n = pairs.len().max(1) as f32;
    let mean = |k: usize| {
        pairs.iter().map(|p| if k == 0 { p.0.coords } else { p.1.coords }).sum::<Vector3<f32>>() / n
    };
    let (a0, b0) = (mean(0), mean(1));
    let h: Matrix3<f32> = pairs.iter().map(|(a, b)| (b.coords - b0) * (a.coords - a0).transpose()).sum();
    let r = if upright {
        let yaw = (h[(1, 0)] - h[(0, 1)]).atan2(h[(0, 0)] + h[(1, 1)]);
        Rotation3::from_axis_angle(&Vector3::z_axis(), yaw)
    } else {
        let svd = h.svd(true, true);
        let (u, vt) = (svd.u.unwrap_or_default(), svd.v_t.unwrap_or_default());
        let sign = Vector3::new(1.0, 1.0, (u * vt).determinant().signum());
        Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&sign) * vt)
    };
    let q = UnitQuaternion::from_rotation_matrix(&r);
    Isometry3::from_parts(Translation3::from(b0 - q * a0), q)
}

/// One-to-one pairs of equal class under a pose, the nearest first.
fn inliers(query: &[Spot], reference: &[Spot], pose: &Isometry3<f32>) -> Vec<[usize; 2]> {
    let mut near = Vec::new();
    for (i, q) in query.iter().enumerate() {
        let p = pose * q.p;
        for (j, r) in reference.iter().enumerate().filter(|(_, r)| r.label == q.label) {
            let d = (p - r.p).norm();
            if d < INLIER {
                near.push((d, i, j));
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut used_q, mut used_r) = (BTreeSet::new(), BTreeSet::new());
    let mut out = Vec::new();
    for (_, i, j) in near {
        if !used_q.contains(&i) && !used_r.contains(&j) {
            used_q.insert(i);
            used_r.insert(j);
            out.push([i, j]);
        }
    }
    out
}

/// A verified place: its pose and inliers.
type Place = (Isometry3<f32>, Vec<[usize; 2]>);

fn place(
    query: &[Spot],
    reference: &[Spot],
    pairs: &[[usize; 2]],
    solver: Solver,
    upright: bool,
) -> Option<Place> {
    let n = pairs.len();
    let mut table = vec![0.0_f32; n * n];
    for i in 0..n {
        for j in i + 1..n {
            let a = agreement(query, reference, pairs[i], pairs[j], upright);
            (table[i * n + j], table[j * n + i]) = (a, a);
        }
    }
    let chosen = match solver {
        Solver::Spectral => spectral(n, &table),
        Solver::Clique => clique(n, &table),
    };
    let mut found: Vec<[usize; 2]> = chosen.into_iter().map(|k| pairs[k]).collect();
    let mut pose = Isometry3::identity();
    for _ in 0..4 {
        if found.len() < 3 {
            return None;
        }
        let points: Vec<_> = found.iter().map(|&[i, j]| (query[i].p, reference[j].p)).collect();
        pose = fit(&points, upright);
        found = inliers(query, reference, &pose);
    }
    let enough = found.len() >= LEAST.0 && found.len() as f32 >= LEAST.1 * query.len() as f32;
    enough.then_some((pose, found))
}

/// Finds `query` in `reference`: the best place, and again without its pairs for rivals.
#[must_use]
pub fn align(reference: &SceneGraph, query: &Query<'_>, names: &Vocabulary, solver: Solver) -> Outcome {
    let (q, r) = (spots(query.graph, names), spots(reference, names));
    let upright = query.gravity_aligned;
    let mut pairs = putatives(&q, &r, upright);
    let Some(first) = place(&q, &r, &pairs, solver, upright) else {
        return Outcome::NoMatch { why: Why::NoSupport };
    };
    let taken: BTreeSet<[usize; 2]> = first.1.iter().copied().collect();
    pairs.retain(|p| !taken.contains(p));
    let mut places = vec![first];
    for _ in 0..8 {
        let Some(next) = place(&q, &r, &pairs, solver, upright) else { break };
        if (next.1.len() as f32) < RIVAL * places[0].1.len() as f32 {
            break;
        }
        let taken: BTreeSet<[usize; 2]> = next.1.iter().copied().collect();
        pairs.retain(|p| !taken.contains(p));
        let middle = q[next.1[0][0]].p;
        let same = |p: &Place| {
            let turn = (p.0.rotation.inverse() * next.0.rotation).angle();
            turn < 0.2 && (p.0 * middle - next.0 * middle).norm() < 0.5
        };
        if !places.iter().any(same) {
            places.push(next);
        }
    }
    let answer = |(pose, found): &Place| {
        let mut pairs: Vec<(NodeId, NodeId)> = found.iter().map(|&[i, j]| (q[i].id, r[j].id)).collect();
        pairs.sort_unstable();
        let mut verdicts: BTreeMap<NodeId, Verdict> =
            query.graph.nodes().map(|n| (n.id, Verdict::New)).collect();
        verdicts.extend(pairs.iter().map(|&(q, r)| (q, Verdict::Same(r))));
        Match {
            reference_from_query: *pose,
            score: pairs.len() as f32,
            pairs,
            margin: None,
            verdicts,
            removed: Vec::new(),
            unmet: Vec::new(),
        }
    };
    match places.as_slice() {
        [only] => Outcome::Match(answer(only)),
        all => Outcome::Ambiguous { candidates: all.iter().map(answer).collect() },
    }
}
