//! Running fusion of scores per node and pair.

use gsm::SegmentId;
use std::collections::BTreeMap;

/// Weight at which a running mean stops getting heavier (SceneGraphFusion's cap).
const MAX_WEIGHT: f32 = 100.0;

/// A running mean of probability vectors: p <- (p w + p_new) / (w + 1), w capped.
#[derive(Clone, Debug, PartialEq)]
pub struct Fused {
    /// Mean probabilities.
    pub p: Vec<f32>,
    weight: f32,
}

impl Fused {
    /// The first sample.
    #[must_use]
    pub fn first(p: &[f32]) -> Self {
        Self { p: p.to_vec(), weight: 1.0 }
    }

    /// One more sample.
    pub fn add(&mut self, new: &[f32]) {
        for (p, n) in self.p.iter_mut().zip(new) {
            *p = (*p * self.weight + n) / (self.weight + 1.0);
        }
        self.weight = (self.weight + 1.0).min(MAX_WEIGHT);
    }
}

/// Class and predicate probabilities of a node set, row by row in its order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scores {
    /// Per node.
    pub classes: Vec<Vec<f32>>,
    /// Per directed pair.
    pub predicates: Vec<Vec<f32>>,
}

/// Fused scores by segment.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Memory {
    nodes: BTreeMap<SegmentId, Fused>,
    pairs: BTreeMap<(SegmentId, SegmentId), Fused>,
}

impl Memory {
    pub(crate) fn add_node(&mut self, id: SegmentId, p: &[f32]) {
        add(&mut self.nodes, id, p);
    }

    pub(crate) fn add_pair(&mut self, ids: (SegmentId, SegmentId), p: &[f32]) {
        add(&mut self.pairs, ids, p);
    }

    pub(crate) fn node(&self, id: SegmentId) -> Option<&Fused> {
        self.nodes.get(&id)
    }

    pub(crate) fn pair(&self, ids: (SegmentId, SegmentId)) -> Option<&Fused> {
        self.pairs.get(&ids)
    }

    /// `from` became a part of `into`: its mean enters as one sample, its pairs go over.
    pub(crate) fn merge(&mut self, from: SegmentId, into: SegmentId) {
        if let Some(f) = self.nodes.remove(&from) {
            self.add_node(into, &f.p);
        }
        let touched: Vec<_> = self.pairs.keys().filter(|(a, b)| *a == from || *b == from).copied().collect();
        for (a, b) in touched {
            let swap = |x| if x == from { into } else { x };
            if let Some(f) = self.pairs.remove(&(a, b))
                && swap(a) != swap(b)
            {
                self.add_pair((swap(a), swap(b)), &f.p);
            }
        }
    }

    pub(crate) fn forget(&mut self, id: SegmentId) {
        self.nodes.remove(&id);
        self.pairs.retain(|(a, b), _| *a != id && *b != id);
    }
}

fn add<K: Ord>(map: &mut BTreeMap<K, Fused>, key: K, p: &[f32]) {
    map.entry(key).and_modify(|f| f.add(p)).or_insert_with(|| Fused::first(p));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_samples_and_the_hand_over_of_pairs() {
        let mut f = Fused::first(&[1.0, 0.0]);
        f.add(&[0.0, 1.0]);
        f.add(&[0.0, 1.0]);
        assert!((f.p[0] - 1.0 / 3.0).abs() < 1e-6);
        let [a, b, c] = [1, 2, 3].map(SegmentId);
        let mut m = Memory::default();
        m.add_node(a, &[1.0]);
        m.add_node(b, &[0.0]);
        m.add_pair((a, b), &[0.3]);
        m.add_pair((b, c), &[0.4]);
        m.merge(b, a);
        assert_eq!(m.node(a).map(|f| f.p[0]), Some(0.5));
        assert!(m.node(b).is_none() && m.pair((a, b)).is_none());
        assert_eq!(m.pair((a, c)).map(|f| f.p[0]), Some(0.4));
        m.forget(c);
        assert!(m.pair((a, c)).is_none());
    }
}
