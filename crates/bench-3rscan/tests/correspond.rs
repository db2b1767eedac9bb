//! Correspondence against its definition, spelled out over all pairs.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use bench_3rscan::correspond::{Limit, correspond, on_clutter};
use bench_3rscan::truth::Truth;
use common::{graph, truth};
use graph_align::{NodeId, SceneGraph};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Centre and sides, grown; the overlap of two boxes from their corners.
type Plain = ([f32; 3], [f32; 3]);

fn plain(b: &graph_align::Box3) -> Plain {
    (b.centroid().coords.into(), <[f32; 3]>::from(b.extent()).map(|e| e.max(0.1)))
}

fn overlap(a: &Plain, b: &Plain) -> f64 {
    let mut shared = 1.0;
    for k in 0..3 {
        let hi = f64::from(a.0[k] + a.1[k] / 2.0).min(f64::from(b.0[k] + b.1[k] / 2.0));
        let lo = f64::from(a.0[k] - a.1[k] / 2.0).max(f64::from(b.0[k] - b.1[k] / 2.0));
        shared *= (hi - lo).max(0.0);
    }
    let volume = |x: &Plain| x.1.iter().map(|e| f64::from(*e)).product::<f64>();
    shared / (volume(a) + volume(b) - shared)
}

fn distance(a: &Plain, b: &Plain) -> f64 {
    (0..3).map(|k| f64::from(a.0[k] - b.0[k]).powi(2)).sum::<f64>().sqrt()
}

/// BENCH.md section 3, word by word: all pairs, then the best that is left, again and again.
fn by_hand(truth: &Truth, graph: &SceneGraph, limit: Limit) -> BTreeMap<NodeId, usize> {
    // Values that differ by rounding alone are ties.
    let round = |v: f64| (v * 1e4).round() as i64;
    let mut left = Vec::new();
    for (k, t) in truth.nodes.iter().enumerate().filter(|(_, t)| !t.ignore) {
        for p in graph.nodes() {
            let (a, b) = (plain(&t.bounds), plain(&p.bounds));
            let (iou, d) = (overlap(&a, &b), distance(&a, &b));
            let longest = t.bounds.extent().iter().copied().fold(0.0_f32, f32::max);
            let iou_fits = match limit {
                Limit::Iou(min) => iou > f64::from(min) + 1e-7,
                Limit::Centre => true,
            };
            if iou_fits && d <= f64::from(longest / 2.0).max(0.5) {
                left.push((std::cmp::Reverse(round(iou)), round(d), t.id, p.id, k));
            }
        }
    }
    let mut out = BTreeMap::new();
    while let Some(best) = left.iter().min().copied() {
        out.insert(best.3, best.4);
        left.retain(|c| c.2 != best.2 && c.3 != best.3);
    }
    out
}

fn limits() -> [Limit; 4] {
    [Limit::Iou(0.0), Limit::Iou(0.25), Limit::Iou(0.5), Limit::Centre]
}

/// Sums of squares of how well the pairs lie: unlike the pairs themselves, this does not depend on
/// how rounding breaks a tie.
fn quality(truth: &Truth, graph: &SceneGraph, m: &BTreeMap<NodeId, usize>) -> Vec<i64> {
    let mut v: Vec<i64> = m
        .iter()
        .map(|(p, k)| {
            let o = overlap(&plain(&truth.nodes[*k].bounds), &plain(&graph.node(*p).unwrap().bounds));
            (o * 1e3).round() as i64
        })
        .collect();
    v.sort_unstable();
    v
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    #[test]
    fn greedy_equals_the_naive_twin(t in truth(14), g in graph(14)) {
        for limit in limits() {
            let (fast, slow) = (correspond(&t, &g, limit), by_hand(&t, &g, limit));
            prop_assert_eq!(fast, slow, "{:?}", limit);
        }
    }

    #[test]
    fn pairs_are_one_to_one_and_stay_without_ignored_nodes(t in truth(14), g in graph(14)) {
        for limit in limits() {
            let m = correspond(&t, &g, limit);
            let true_ends: BTreeSet<_> = m.values().collect();
            prop_assert_eq!(true_ends.len(), m.len());
            prop_assert!(m.values().all(|k| !t.nodes[*k].ignore));
            let mut bare = t.clone();
            bare.nodes.retain(|n| !n.ignore);
            let same = correspond(&bare, &g, limit);
            prop_assert_eq!(quality(&t, &g, &m), quality(&bare, &g, &same));
        }
    }

    #[test]
    fn labels_decide_nothing(t in truth(12), g in graph(12), turn in 1_u16..9) {
        let mut other = t.clone();
        for n in &mut other.nodes {
            n.label = n.label.map(|l| graph_align::LabelId((l.0 + turn) % common::LABELS));
        }
        prop_assert_eq!(correspond(&t, &g, Limit::Iou(0.0)), correspond(&other, &g, Limit::Iou(0.0)));
    }

    #[test]
    fn clutter_is_what_overlaps_best_with_an_instance_outside_the_set(t in truth(12), g in graph(12)) {
        let got = on_clutter(&t, &g);
        for p in g.nodes() {
            let all = t.nodes.iter().filter_map(|n| {
                let (a, b) = (plain(&n.bounds), plain(&p.bounds));
                let longest = n.bounds.extent().iter().copied().fold(0.0_f32, f32::max);
                (distance(&a, &b) <= f64::from(longest / 2.0).max(0.5)).then(|| (overlap(&a, &b), n.label.is_none()))
            });
            let best = |clutter: bool| {
                all.clone().filter(|(_, c)| *c == clutter).map(|(o, _)| o).fold(0.0, f64::max)
            };
            // Equal overlaps may go either way.
            if (best(true) - best(false)).abs() > 1e-5 {
                prop_assert_eq!(got.contains(&p.id), best(true) > best(false), "{:?}", p.id);
            }
        }
    }
}

#[test]
fn flat_and_distant_boxes() {
    use bench_3rscan::correspond::{grown, reach};
    use graph_align::Box3;
    let sheet = Box3::new([1.0, 2.0, 3.0], [2.0, 0.0, 0.04]).unwrap();
    assert_eq!(<[f32; 3]>::from(grown(&sheet).extent()), [2.0, 0.1, 0.1]);
    assert_eq!(grown(&sheet).centroid(), sheet.centroid());
    assert!((reach(&sheet) - 1.0).abs() < 1e-6);
    assert!((reach(&Box3::new([0.0; 3], [0.3; 3]).unwrap()) - 0.5).abs() < 1e-6);
}
