//! Who saw which object where, and the frames that this implies.

use crate::{NodeId, Observation, fit};
use nalgebra::{Isometry3, Point3};
use std::collections::BTreeMap;

/// Rounds over all frames.
const ROUNDS: usize = 30;
/// Residual at which a sighting weighs half, metres.
const SCALE: f32 = 0.15;

/// Centroids of objects in the frames from which they were seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sightings(BTreeMap<NodeId, Vec<(u32, Point3<f32>)>>);

impl Sightings {
    /// Those of one observation.
    pub(crate) fn of(o: &Observation) -> Self {
        Self(o.graph.nodes().map(|n| (n.id, vec![(o.frame, n.bounds.centroid())])).collect())
    }

    /// Adds others under the ids that their nodes have become.
    pub(crate) fn add(&mut self, other: &Self, image: &BTreeMap<NodeId, NodeId>) {
        for (id, seen) in &other.0 {
            if let Some(id) = image.get(id) {
                self.0.entry(*id).or_default().extend(seen);
            }
        }
    }

    /// Drops those of an object that moved.
    pub(crate) fn forget(&mut self, id: NodeId) {
        self.0.remove(&id);
    }

    /// Drops those of nodes that were joined to another: their centroids are those of parts.
    pub(crate) fn join(&mut self, joined: &[(NodeId, NodeId)]) {
        for (gone, _) in joined {
            self.0.remove(gone);
        }
    }

    /// Frames that bring the sightings of each object together: in turn, every frame but the root is
    /// fitted by weighted least squares to where the other frames see its objects.
    /// Frames without common objects stay.
    pub(crate) fn fit(
        &self,
        root: u32,
        frames: &BTreeMap<u32, Isometry3<f32>>,
        objects: impl Fn(NodeId) -> bool,
    ) -> BTreeMap<u32, Isometry3<f32>> {
        let common: Vec<&[(u32, Point3<f32>)]> = self
            .0
            .iter()
            .filter(|(id, seen)| objects(**id) && seen.iter().any(|s| s.0 != seen[0].0))
            .map(|(_, seen)| seen.as_slice())
            .collect();
        let mut out = frames.clone();
        for _ in 0..ROUNDS {
            for frame in frames.keys().filter(|f| **f != root) {
                let points = correspondences(&common, *frame, &out);
                if points.len() >= 3 {
                    out.insert(*frame, fit::rigid(&points, true));
                }
            }
        }
        out
    }
}

/// (in `frame`, where the other frames see the same object, weight).
fn correspondences(
    common: &[&[(u32, Point3<f32>)]],
    frame: u32,
    frames: &BTreeMap<u32, Isometry3<f32>>,
) -> Vec<(Point3<f32>, Point3<f32>, f32)> {
    let mut out = Vec::new();
    let Some(own) = frames.get(&frame) else { return out };
    for seen in common {
        let (mut sum, mut n) = (nalgebra::Vector3::zeros(), 0.0);
        for (f, p) in seen.iter().filter(|s| s.0 != frame) {
            if let Some(t) = frames.get(f) {
                sum += (t * p).coords;
                n += 1.0;
            }
        }
        if n == 0.0 {
            continue;
        }
        let there = Point3::from(sum / n);
        for (_, p) in seen.iter().filter(|s| s.0 == frame) {
            let off = (own * p - there).norm() / SCALE;
            out.push((*p, there, 1.0 / (1.0 + off * off)));
        }
    }
    out
}
