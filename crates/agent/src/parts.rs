//! Which segments are parts of one object: average-linkage clustering of neighbours.

use crate::{NodeSet, SAME_PART, Scores};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Summed likeness of two groups and the number of their pairs of neighbours.
type Link = (f32, u32);

/// Representative (smallest index) of each segment's object. Starting from single segments, the two
/// groups that are most alike are joined until none are more alike than `least`; the likeness of two
/// groups is the mean over their pairs of neighbours of [`likeness`]. One doubtful pair thus cannot
/// chain two objects together, nor a doubtful class keep a part out.
pub(crate) fn groups(set: &NodeSet, scores: &Scores, predicate_names: &[String], least: f32) -> Vec<usize> {
    let mut group: Vec<usize> = (0..set.nodes.len()).collect();
    let Some(same) = predicate_names.iter().position(|n| n == SAME_PART) else { return group };
    let mut links = links(set, scores, same);
    let mut heap = BinaryHeap::new();
    for (i, of) in links.iter().enumerate() {
        of.range(i + 1..).for_each(|(&j, &l)| heap.extend(candidate(i, j, l, least)));
    }
    while let Some((value, Reverse(i), Reverse(j))) = heap.pop() {
        // Groups that have changed since have younger candidates.
        if links[i].get(&j).is_none_or(|&l| mean(l).to_bits() != value) {
            continue;
        }
        group.iter_mut().filter(|g| **g == j).for_each(|g| *g = i);
        links[i].remove(&j);
        for (k, (sum, n)) in std::mem::take(&mut links[j]) {
            links[k].remove(&j);
            if k == i {
                continue;
            }
            let (other, m) = links[i].get(&k).copied().unwrap_or_default();
            let link = (sum + other, n + m);
            links[i].insert(k, link);
            links[k].insert(i, link);
            heap.extend(candidate(i.min(k), i.max(k), link, least));
        }
    }
    group
}

/// A pair of groups that may be joined; the most alike, then the smallest indices come first.
fn candidate(i: usize, j: usize, link: Link, least: f32) -> Option<(u32, Reverse<usize>, Reverse<usize>)> {
    // Bits of non-negative floats order as their values.
    (mean(link) > least.max(0.0)).then(|| (mean(link).to_bits(), Reverse(i), Reverse(j)))
}

fn mean((sum, n): Link) -> f32 {
    sum / n.max(1) as f32
}

/// Of each segment the links to its neighbours.
fn links(set: &NodeSet, scores: &Scores, same: usize) -> Vec<BTreeMap<usize, Link>> {
    let mut sums: BTreeMap<(usize, usize), f32> = BTreeMap::new();
    for (&[i, j], s) in set.edges.iter().zip(&scores.predicates) {
        *sums.entry((i.min(j), i.max(j))).or_default() += s[same] / 2.0;
    }
    let mut links = vec![BTreeMap::new(); set.nodes.len()];
    for ((i, j), same_part) in sums {
        let link = (same_part * cosine(&scores.classes[i], &scores.classes[j]), 1);
        links[i].insert(j, link);
        links[j].insert(i, link);
    }
    links
}

/// Cosine of the angle between two vectors of non-negative numbers.
fn cosine(a: &[f32], b: &[f32]) -> f32 {
    let dot = |x: &[f32], y: &[f32]| x.iter().zip(y).map(|(p, q)| p * q).sum::<f32>();
    (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(1e-9)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NodeInput;
    use graph_align::Box3;
    use gsm::SegmentId;
    use proptest::prelude::*;

    fn inputs(classes: &[[f32; 3]], pairs: &BTreeMap<(usize, usize), f32>) -> (NodeSet, Scores) {
        let node = |k: usize| NodeInput {
            id: SegmentId(k as u32 + 1),
            surfels: 100,
            area: 1.0,
            bounds: Box3::new([0.0; 3], [1.0; 3]).expect("finite"),
            points: Vec::new(),
        };
        let edges: Vec<[usize; 2]> = pairs.keys().flat_map(|&(i, j)| [[i, j], [j, i]]).collect();
        let scores = Scores {
            classes: classes.iter().map(|c| c.to_vec()).collect(),
            predicates: edges.iter().map(|e| vec![pairs[&(e[0].min(e[1]), e[0].max(e[1]))], 0.0]).collect(),
        };
        (NodeSet { nodes: (0..classes.len()).map(node).collect(), edges, to_walls: 0.0 }, scores)
    }

    /// The same by its definition: all pairs of groups anew at every step.
    fn by_definition(classes: &[[f32; 3]], pairs: &BTreeMap<(usize, usize), f32>, least: f32) -> Vec<usize> {
        let mut groups: Vec<Vec<usize>> = (0..classes.len()).map(|k| vec![k]).collect();
        loop {
            let mut best: Option<(f32, usize, usize)> = None;
            for a in 0..groups.len() {
                for b in a + 1..groups.len() {
                    let all: Vec<f32> = groups[a]
                        .iter()
                        .flat_map(|&i| groups[b].iter().map(move |&j| (i.min(j), i.max(j))))
                        .filter_map(|(i, j)| Some(pairs.get(&(i, j))? * cosine(&classes[i], &classes[j])))
                        .collect();
                    let mean = all.iter().sum::<f32>() / all.len().max(1) as f32;
                    if mean > least && best.is_none_or(|b| mean > b.0) {
                        best = Some((mean, a, b));
                    }
                }
            }
            let Some((_, a, b)) = best else { break };
            let joined = groups.remove(b);
            groups[a].extend(joined);
        }
        let mut out = vec![0; classes.len()];
        for g in &groups {
            let first = *g.iter().min().expect("no empty group");
            g.iter().for_each(|&k| out[k] = first);
        }
        out
    }

    proptest! {
        #[test]
        fn groups_are_those_of_the_definition(
            classes in prop::collection::vec(prop::array::uniform3(1_u8..20), 1..9),
            pairs in prop::collection::btree_map((0_usize..9, 0_usize..9), 1_u32..4000, 0..30),
            least in 0.05_f32..0.6,
        ) {
            let classes: Vec<[f32; 3]> = classes.iter().map(|c| c.map(f32::from)).collect();
            // Primes in the scores keep means apart, so that rounding decides nothing.
            let pairs: BTreeMap<(usize, usize), f32> = pairs
                .into_iter()
                .filter(|((i, j), _)| i < j && *j < classes.len())
                .map(|(k, v)| (k, (v * 997 % 4001) as f32 / 4001.0))
                .collect();
            let (set, scores) = inputs(&classes, &pairs);
            let names = [SAME_PART.to_owned(), "on".to_owned()];
            prop_assert_eq!(groups(&set, &scores, &names, least), by_definition(&classes, &pairs, least));
        }
    }

    #[test]
    fn one_doubtful_pair_does_not_chain() {
        // Two chairs of three parts each; one pair across is as likely as those within.
        let mut pairs: BTreeMap<(usize, usize), f32> = BTreeMap::new();
        for (i, j) in [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)] {
            pairs.insert((i, j), 0.8);
        }
        for (i, j) in [(0, 3), (0, 4), (1, 3), (1, 4), (1, 5)] {
            pairs.insert((i, j), 0.05);
        }
        pairs.insert((2, 5), 0.8);
        let (set, scores) = inputs(&[[1.0, 0.0, 0.0]; 6], &pairs);
        let names = [SAME_PART.to_owned(), "on".to_owned()];
        assert_eq!(groups(&set, &scores, &names, 0.3), [0, 0, 0, 3, 3, 3]);
    }
}
