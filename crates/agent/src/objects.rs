//! Segments to objects: parts joined, the network's second look at the joined ones, pieces of walls joined.

use crate::{Error, NodeInput, NodeSet, Scores, parts, walls};
use graph_align::Box3;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// Objects of one or more segments, with what the network thinks of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objects {
    /// One node per object; neighbours in both directions.
    pub set: NodeSet,
    /// Of the objects and their pairs.
    pub scores: Scores,
    /// The object of each segment.
    pub of: Vec<usize>,
}

impl Objects {
    /// Joins the parts of each object: groups of segments are joined while the mean over their pairs
    /// of neighbours of (probability of `same part`) x (cosine of the class probabilities) exceeds
    /// `min_same_part`. An object's classes are the mean over its segments, weighted by surfels; the
    /// predicates of a pair of objects the mean over their pairs of segments. `gap` as in
    /// [`NodeSet::new`].
    ///
    /// # Errors
    /// Scores that do not fit the node set.
    pub fn join(
        set: &NodeSet,
        scores: &Scores,
        predicate_names: &[String],
        min_same_part: f32,
        gap: f32,
    ) -> Result<Self, Error> {
        if scores.classes.len() != set.nodes.len() || scores.predicates.len() != set.edges.len() {
            return Err(Error::Weights(format!(
                "{} class and {} predicate rows for {} nodes and {} pairs",
                scores.classes.len(),
                scores.predicates.len(),
                set.nodes.len(),
                set.edges.len()
            )));
        }
        Ok(Self::combined(set, scores, &parts::groups(set, scores, predicate_names, min_same_part), gap))
    }

    /// Joins the pieces of each wall: walls in one plane with no more than 1.5 m between them, unless another wall
    /// ends there. `gap` as in [`NodeSet::new`].
    pub fn join_walls(&mut self, class_names: &[String], gap: f32) {
        let group = walls::groups(&self.set.nodes, &self.scores.classes, class_names);
        if group.iter().enumerate().all(|(k, &g)| k == g) {
            return;
        }
        let joined = Self::combined(&self.set, &self.scores, &group, gap);
        let of = self.of.iter().map(|&k| joined.of[k]).collect();
        *self = Self { of, ..joined };
    }

    /// One object for each group of nodes.
    fn combined(set: &NodeSet, scores: &Scores, group: &[usize], gap: f32) -> Self {
        let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        group.iter().enumerate().for_each(|(k, &g)| members.entry(g).or_default().push(k));
        let mut of = vec![0; set.nodes.len()];
        for (object, ms) in members.values().enumerate() {
            ms.iter().for_each(|&m| of[m] = object);
        }
        let nodes = members.values().map(|ms| joined(set, ms)).collect();
        let classes = members.values().map(|ms| class_mean(set, scores, ms)).collect();
        let means = pair_means(set, scores, &of);
        // Segments can be neighbours where the boxes of their objects are, and only there.
        let set = NodeSet::new(nodes, gap);
        let none = vec![0.0; scores.predicates.first().map_or(0, Vec::len)];
        let predicates = set.edges.iter().map(|e| means.get(e).unwrap_or(&none).clone()).collect();
        Self { set, scores: Scores { classes, predicates }, of }
    }

    /// What the network says of the objects as nodes of their own enters with a weight of 0 to 1.
    /// Pairs of which no segments were neighbours had no scores so far.
    pub fn look_again(&mut self, second: &Scores, weight: f32) {
        let blend = |of: &mut Vec<f32>, new: &[f32], w: f32| {
            of.iter_mut().zip(new).for_each(|(a, b)| *a += w * (b - *a));
        };
        for (a, b) in self.scores.classes.iter_mut().zip(&second.classes) {
            blend(a, b, weight);
        }
        for (a, b) in self.scores.predicates.iter_mut().zip(&second.predicates) {
            let unknown = a.iter().all(|v| *v == 0.0);
            blend(a, b, if unknown { 1.0 } else { weight });
        }
    }
}

/// The node of all members: the box around theirs, points of each in proportion to its surfels, as
/// many as the member with most has.
fn joined(set: &NodeSet, members: &[usize]) -> NodeInput {
    let of = |m: &usize| &set.nodes[*m];
    let surfels: u32 = members.iter().map(|m| of(m).surfels).sum();
    let most = members.iter().map(|m| of(m).points.len()).max().unwrap_or(0);
    let mut points: Vec<(Point3<f32>, Vector3<f32>)> = Vec::with_capacity(most + members.len());
    for m in members {
        let own = &of(m).points;
        let share = most as u64 * u64::from(of(m).surfels) / u64::from(surfels.max(1));
        let n = (share as usize).max(1).min(own.len());
        points.extend((0..n).map(|k| own[k * own.len() / n]));
    }
    let bounds: Box3 = members[1..].iter().fold(of(&members[0]).bounds, |b, m| b.union(&of(m).bounds));
    NodeInput {
        id: of(&members[0]).id,
        surfels,
        area: members.iter().map(|m| of(m).area).sum(),
        bounds,
        points,
    }
}

/// Mean of the class probabilities, weighted by surfels.
fn class_mean(set: &NodeSet, scores: &Scores, members: &[usize]) -> Vec<f32> {
    let total: f32 = members.iter().map(|&m| set.nodes[m].surfels as f32).sum();
    let mut mean = vec![0.0; scores.classes[members[0]].len()];
    for &m in members {
        let w = set.nodes[m].surfels as f32 / total.max(1.0);
        mean.iter_mut().zip(&scores.classes[m]).for_each(|(a, v)| *a += w * v);
    }
    mean
}

/// Mean predicates over the pairs of segments of each pair of objects.
fn pair_means(set: &NodeSet, scores: &Scores, of: &[usize]) -> BTreeMap<[usize; 2], Vec<f32>> {
    let mut sums: BTreeMap<[usize; 2], (Vec<f32>, f32)> = BTreeMap::new();
    for (&[i, j], s) in set.edges.iter().zip(&scores.predicates) {
        if of[i] != of[j] {
            let (sum, n) = sums.entry([of[i], of[j]]).or_insert_with(|| (vec![0.0; s.len()], 0.0));
            sum.iter_mut().zip(s).for_each(|(x, v)| *x += v);
            *n += 1.0;
        }
    }
    let mean = |(mut sum, n): (Vec<f32>, f32)| {
        sum.iter_mut().for_each(|v| *v /= n);
        sum
    };
    sums.into_iter().map(|(pair, s)| (pair, mean(s))).collect()
}
