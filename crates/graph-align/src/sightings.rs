//! Who saw which object where, and the frames that this implies.

use crate::joint::{self, Common, Frame, Pull};
use crate::{Box3, NodeId, Observation, SceneGraph};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Objects in common below which a frame stays where it was found.
const FEWEST: u32 = 3;
/// Frames by which the next ones hold one that saw the same object, each way.
const MOST: usize = 8;
/// A footprint of at least this length, metres, whose other side is at most this share of it is thin.
const THIN: (f32, f32) = (0.5, 0.3);
/// Noise of its direction: metres over the length, and never better than the last number, radians.
const LEAN: (f32, f32) = (0.008, 0.006);
/// Others of at least these sides, metres, tell a direction too, with this noise, radians: many of them outvote the one
/// wall that looks bent from one of two places.
const BROAD: ([f32; 2], f32) = ([0.3, 0.1], 0.0075);

/// An object as seen from one frame.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    frame: u32,
    p: Point3<f32>,
    /// Direction of its footprint's sides, radians modulo a quarter turn, and the inverse variance of it.
    side: Option<(f32, f32)>,
}

/// Places of objects in the frames from which they were seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sightings(BTreeMap<NodeId, Vec<Sighting>>);

impl Sightings {
    /// Those of one observation.
    pub(crate) fn of(o: &Observation) -> Self {
        Self::in_frame(o.frame, &o.graph)
    }

    /// Those of a graph whose nodes stand where they were seen, all in one frame.
    pub(crate) fn in_frame(frame: u32, graph: &SceneGraph) -> Self {
        let of = |b: &Box3| Sighting { frame, p: b.middle(), side: side(b) };
        Self(graph.nodes().map(|n| (n.id, vec![of(&n.bounds)])).collect())
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

    /// Frames that bring the sightings of each object together ([`joint`]): its places, and the directions of
    /// the sides of what is long. `objects` says whose centroids count; walls count by their sides alone. The
    /// root stays, those that are `held`, and those that share fewer than three objects with others.
    pub(crate) fn fit(
        &self,
        root: u32,
        frames: &BTreeMap<u32, Isometry3<f32>>,
        held: &BTreeSet<u32>,
        objects: impl Fn(NodeId) -> bool,
    ) -> BTreeMap<u32, Isometry3<f32>> {
        let number: BTreeMap<u32, usize> = frames.keys().enumerate().map(|(k, f)| (*f, k)).collect();
        let mut pulls = Vec::new();
        for (id, seen) in &self.0 {
            pulls_of(&by_frame(seen, &number), objects(*id), &mut pulls);
        }
        let mut common = vec![0_u32; frames.len()];
        for p in pulls.iter().filter(|p| matches!(p.of, Common::Place(..))) {
            common[p.a] += 1;
            common[p.b] += 1;
        }
        let free = |f: u32, k: usize| f != root && !held.contains(&f) && common[k] >= FEWEST;
        let start: Vec<Frame> =
            frames.iter().enumerate().map(|(k, (f, t))| Frame { pose: *t, free: free(*f, k) }).collect();
        frames.keys().copied().zip(joint::fitted(&start, &pulls)).collect()
    }
}

/// What each frame saw of one object, by the frame's place in the list: the mean of its sightings.
fn by_frame(seen: &[Sighting], number: &BTreeMap<u32, usize>) -> Vec<(usize, Sighting)> {
    let mut groups: BTreeMap<usize, Vec<&Sighting>> = BTreeMap::new();
    for s in seen {
        if let Some(k) = number.get(&s.frame) {
            groups.entry(*k).or_default().push(s);
        }
    }
    let mean = |s: &[&Sighting]| {
        let sum = s.iter().fold(Vector3::zeros(), |m, s| m + s.p.coords);
        Sighting { p: Point3::from(sum / s.len() as f32), side: mean_side(s), ..*s[0] }
    };
    groups.into_iter().map(|(k, s)| (k, mean(&s))).collect()
}

/// The mean direction, as angles modulo a quarter turn are averaged, and the sum of the weights.
fn mean_side(seen: &[&Sighting]) -> Option<(f32, f32)> {
    let (mut sin, mut cos, mut w) = (0.0, 0.0, 0.0);
    for (yaw, weight) in seen.iter().filter_map(|s| s.side) {
        sin += weight * (4.0 * yaw).sin();
        cos += weight * (4.0 * yaw).cos();
        w += weight;
    }
    (w > 0.0).then(|| (f32::atan2(sin, cos) / 4.0, w))
}

/// Pulls between the frames that saw one object; of many frames each is held by the next ones.
fn pulls_of(seen: &[(usize, Sighting)], object: bool, out: &mut Vec<Pull>) {
    let n = seen.len();
    for step in 1..=(n / 2).min(MOST) {
        // Half a round meets every pair twice.
        let starts = if 2 * step == n { step } else { n };
        for k in 0..starts {
            let ((a, s), (b, t)) = (seen[k], seen[(k + step) % n]);
            let share = 1.0 / n.min(2 * MOST + 1) as f32;
            if object {
                out.push(Pull { a, b, share, of: Common::Place(s.p, t.p) });
            }
            if let (Some((p, v)), Some((q, w))) = (s.side, t.side) {
                out.push(Pull { a, b, share, of: Common::Side(p, q, 1.0 / v + 1.0 / w) });
            }
        }
    }
}

/// The direction of a footprint's sides, and the inverse variance of it; none of what is small.
fn side(b: &Box3) -> Option<(f32, f32)> {
    let f = b.footprint()?;
    let [l, w] = f.sides();
    let (long, short) = (l.max(w), l.min(w));
    let sigma = if long > THIN.0 && short < THIN.1 * long {
        (LEAN.0 / long).max(LEAN.1)
    } else if long > BROAD.0[0] && short > BROAD.0[1] {
        BROAD.1
    } else {
        return None;
    };
    Some((f.yaw, 1.0 / (sigma * sigma)))
}
