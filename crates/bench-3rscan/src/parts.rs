//! Measures of a segmentation against true parts, from the overlaps alone.
//!
//! Notation: true parts `g`, segments `s`, overlap `n(g, s)`, sizes `|g|`, `|s|`, all elements `n`. Elements without a
//! segment (`None`) count in `g` and `n` but in no segment: they lower covering and completeness.

use serde::Serialize;
use std::collections::BTreeMap;

/// Overlaps of true parts with segments.
#[derive(Debug, Clone, Default)]
pub struct Overlaps {
    cells: BTreeMap<(u32, Option<u32>), u64>,
}

/// The measures; each from 0 to 1 but the error, which can exceed 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PartScores {
    /// `Σ |g|/n · max_s |g ∩ s| / |g ∪ s|`.
    pub covering: f64,
    /// Adjusted Rand index; elements without a segment are one part of their own.
    pub ari: f64,
    /// `Σ_g Σ_s min(n(g, s), |s| − n(g, s)) / n`.
    pub under_segmentation: f64,
    /// `Σ_s max_g n(g, s) / n` over elements with a segment: falls with under-segmentation.
    pub purity: f64,
    /// `Σ_g max_s n(g, s) / n`: falls with over-segmentation.
    pub completeness: f64,
}

impl Overlaps {
    /// Counts one element.
    pub fn add(&mut self, truth: u32, segment: Option<u32>) {
        *self.cells.entry((truth, segment)).or_default() += 1;
    }

    /// Per segment the elements of every true part in it.
    pub fn by_segment(&self) -> BTreeMap<u32, BTreeMap<u32, u64>> {
        let mut all: BTreeMap<u32, BTreeMap<u32, u64>> = BTreeMap::new();
        for (&(g, s), &n) in &self.cells {
            if let Some(s) = s {
                *all.entry(s).or_default().entry(g).or_default() += n;
            }
        }
        all
    }

    /// Sizes of the true parts.
    pub fn parts(&self) -> BTreeMap<u32, u64> {
        sums(self.cells.iter().map(|(&(g, _), &n)| (g, n)))
    }

    fn segments(&self) -> BTreeMap<Option<u32>, u64> {
        sums(self.cells.iter().map(|(&(_, s), &n)| (s, n)))
    }

    /// Per segment the true part that holds most of it (the lower number at a tie).
    pub fn majority(&self) -> BTreeMap<u32, u32> {
        let mut best: BTreeMap<u32, (u64, u32)> = BTreeMap::new();
        for (&(g, s), &n) in &self.cells {
            let Some(s) = s else { continue };
            let b = best.entry(s).or_default();
            if n > b.0 {
                *b = (n, g);
            }
        }
        best.into_iter().map(|(s, (_, g))| (s, g)).collect()
    }

    /// Best intersection over union of every true part with a segment, 0 without one.
    pub fn best_iou(&self) -> BTreeMap<u32, f64> {
        let (parts, segments) = (self.parts(), self.segments());
        let mut best: BTreeMap<u32, f64> = parts.keys().map(|&g| (g, 0.0)).collect();
        for (&(g, s), &n) in self.cells.iter().filter(|(k, _)| k.1.is_some()) {
            let iou = n as f64 / (parts[&g] + segments[&s] - n) as f64;
            let b = best.entry(g).or_default();
            *b = b.max(iou);
        }
        best
    }

    /// All measures; `None` without elements.
    pub fn scores(&self) -> Option<PartScores> {
        let (parts, segments) = (self.parts(), self.segments());
        let n: u64 = parts.values().sum();
        if n == 0 {
            return None;
        }
        let all = n as f64;
        let covering = self.best_iou().iter().map(|(g, iou)| parts[g] as f64 * iou).sum::<f64>() / all;
        let (mut error, mut labelled) = (0, 0);
        let (mut of_segment, mut of_part) = (BTreeMap::new(), BTreeMap::new());
        for (&(g, s), &n) in &self.cells {
            if s.is_none() {
                continue;
            }
            labelled += n;
            error += n.min(segments[&s] - n);
            let (a, b): (&mut u64, &mut u64) =
                (of_segment.entry(s).or_default(), of_part.entry(g).or_default());
            *a = n.max(*a);
            *b = n.max(*b);
        }
        let pairs = |k: u64| k as f64 * (k as f64 - 1.0) / 2.0;
        let (a, b): (f64, f64) =
            (parts.values().map(|&k| pairs(k)).sum(), segments.values().map(|&k| pairs(k)).sum());
        let both: f64 = self.cells.values().map(|&k| pairs(k)).sum();
        let expected = if n > 1 { a * b / pairs(n) } else { 0.0 };
        let spread = 0.5 * (a + b) - expected;
        Some(PartScores {
            covering,
            // Both all one part, or both all single elements: the same partition.
            ari: if spread.abs() < 1e-9 { 1.0 } else { (both - expected) / spread },
            under_segmentation: error as f64 / all,
            purity: of_segment.values().sum::<u64>() as f64 / labelled.max(1) as f64,
            completeness: of_part.values().sum::<u64>() as f64 / all,
        })
    }
}

fn sums<K: Ord>(items: impl Iterator<Item = (K, u64)>) -> BTreeMap<K, u64> {
    let mut total = BTreeMap::new();
    for (k, n) in items {
        *total.entry(k).or_default() += n;
    }
    total
}

/// Share of true boundary pixels that have a found one within `reach` pixels (Chebyshev distance), as (found, all).
/// Images are row-major; a pixel is a boundary when its right or lower neighbour has another label; pixels labelled
/// `None` and their neighbours are left out.
pub fn boundary_recall(
    width: usize,
    truth: &[Option<u32>],
    found: &[Option<u32>],
    reach: usize,
) -> (u64, u64) {
    if width == 0 || truth.len() != found.len() {
        return (0, 0);
    }
    let height = truth.len() / width;
    let crossing = |image: &[Option<u32>], x: usize, y: usize, lost: bool| {
        let own = image[y * width + x];
        let differs = |x: usize, y: usize| {
            let other = image[y * width + x];
            own != other && (lost || own.is_some() && other.is_some())
        };
        x + 1 < width && differs(x + 1, y) || y + 1 < height && differs(x, y + 1)
    };
    let (mut hit, mut all) = (0, 0);
    for y in 0..height {
        for x in 0..width {
            if !crossing(truth, x, y, false) {
                continue;
            }
            all += 1;
            let near = (y.saturating_sub(reach)..=(y + reach).min(height - 1)).any(|v| {
                (x.saturating_sub(reach)..=(x + reach).min(width - 1)).any(|u| crossing(found, u, v, true))
            });
            hit += u64::from(near);
        }
    }
    (hit, all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Element = (u32, Option<u32>);

    /// The definitions over elements and pairs of elements, without a table.
    fn by_hand(list: &[Element]) -> PartScores {
        let n = list.len() as f64;
        let count = |f: &dyn Fn(&Element) -> bool| list.iter().filter(|e| f(e)).count() as f64;
        let mut gs: Vec<u32> = list.iter().map(|e| e.0).collect();
        let mut ss: Vec<Option<u32>> = list.iter().map(|e| e.1).collect();
        gs.sort_unstable();
        gs.dedup();
        ss.sort_unstable();
        ss.dedup();
        let mut out = PartScores::default();
        for &g in &gs {
            let (mut iou, mut most) = (0.0f64, 0.0f64);
            for &s in ss.iter().filter(|s| s.is_some()) {
                let both = count(&|e| e.0 == g && e.1 == s);
                iou = iou.max(both / count(&|e| e.0 == g || e.1 == s));
                most = most.max(both);
                out.under_segmentation += both.min(count(&|e| e.0 != g && e.1 == s)) / n;
            }
            out.covering += count(&|e| e.0 == g) * iou / n;
            out.completeness += most / n;
        }
        let labelled = count(&|e| e.1.is_some());
        for &s in ss.iter().filter(|s| s.is_some()) {
            let most = gs.iter().map(|&g| count(&|e| e.0 == g && e.1 == s)).fold(0.0, f64::max);
            out.purity += most / labelled;
        }
        // Rand's four kinds of pairs; Hubert and Arabie's index in their terms.
        let (mut tp, mut fp, mut fneg, mut tn) = (0.0, 0.0, 0.0, 0.0);
        for (i, a) in list.iter().enumerate() {
            for b in &list[..i] {
                match (a.0 == b.0, a.1 == b.1) {
                    (true, true) => tp += 1.0,
                    (false, true) => fp += 1.0,
                    (true, false) => fneg += 1.0,
                    (false, false) => tn += 1.0,
                }
            }
        }
        let below = (tp + fneg) * (fneg + tn) + (tp + fp) * (fp + tn);
        out.ari = if below == 0.0 { 1.0 } else { 2.0 * (tp * tn - fneg * fp) / below };
        out
    }

    proptest! {
        #[test]
        fn scores_equal_their_definitions(
            list in prop::collection::vec((0u32..5, prop::option::weighted(0.9, 0u32..6)), 2..40),
        ) {
            let mut table = Overlaps::default();
            list.iter().for_each(|&(g, s)| table.add(g, s));
            let (a, b) = (table.scores().unwrap(), by_hand(&list));
            for (x, y) in [
                (a.covering, b.covering),
                (a.ari, b.ari),
                (a.under_segmentation, b.under_segmentation),
                (a.purity, if list.iter().any(|e| e.1.is_some()) { b.purity } else { 0.0 }),
                (a.completeness, b.completeness),
            ] {
                prop_assert!((x - y).abs() < 1e-9, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn a_perfect_segmentation_and_a_single_segment() {
        let (mut same, mut one) = (Overlaps::default(), Overlaps::default());
        for i in 0..100 {
            same.add(i % 4, Some(10 + i % 4));
            one.add(i % 4, Some(0));
        }
        let s = same.scores().unwrap();
        assert_eq!(
            (s.covering, s.ari, s.under_segmentation, s.purity, s.completeness),
            (1.0, 1.0, 0.0, 1.0, 1.0)
        );
        let s = one.scores().unwrap();
        assert_eq!((s.covering, s.under_segmentation, s.purity, s.completeness), (0.25, 1.0, 0.25, 1.0));
        assert!(s.ari.abs() < 1e-9 && Overlaps::default().scores().is_none());
    }

    #[test]
    fn boundaries_count_within_reach() {
        let truth: Vec<Option<u32>> = (0..100).map(|i| Some(u32::from(i % 10 >= 5))).collect();
        let shifted = |k: usize| (0..100).map(|i| Some(u32::from(i % 10 >= k))).collect::<Vec<_>>();
        assert_eq!(boundary_recall(10, &truth, &shifted(5), 0), (10, 10));
        assert_eq!(boundary_recall(10, &truth, &shifted(7), 2), (10, 10));
        assert_eq!(boundary_recall(10, &truth, &shifted(8), 2), (0, 10));
        assert_eq!(boundary_recall(10, &truth, &vec![None; 100], 2), (0, 10));
    }
}
