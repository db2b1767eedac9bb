//! Two views of one place that show different parts of its objects: their sides instead of their centres.
//!
//! Where an object was seen in part its centre and size say little, but a side that was seen is where it is. So boxes
//! along the walls are compared side by side; [`Seen`](crate::seen::Seen) says how far apart two sides that are one may lie. A pair is
//! worth `ln` of the product over its six sides, times the window in which its counterpart might lie by chance, times the
//! ratio of classes as in [`evidence`](super::evidence). Walls and floors take part: their sides are the surest.
//!
//! Every pair of boxes proposes the poses that lay one side on another in each direction; the fullest bins are fitted,
//! reweighted by how surely each side was seen by both. The directions of the walls leave four turns.

mod boxes;
mod face;
mod worth;

use super::index::{Index, Item};
use super::vote;
use super::{RobustParams, Work};
use crate::{LabelId, SceneGraph};
use boxes::Boxes;
use face::{Face, Fitted, Motion};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f32::consts::FRAC_PI_2;
use worth::{Sides, classes};

/// Peaks of the proposed shifts that are looked at, and fitted, of so many bins.
const PEAKS: usize = 32;
const FITTED: usize = 12;
const BINS: usize = 400;
/// Bins of turn from one quarter to the next, so that they do not touch.
const QUARTER: usize = 7;

/// A pose that sides agree on.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    pub reference_from_query: Isometry3<f32>,
    pub evidence: f32,
    /// Pairs of which none is structure, and their share of the evidence: rooms of one plan have the same walls.
    pub objects: (usize, f32),
    /// Objects that should have been met: of the graph that has fewer where the other's are.
    pub common: usize,
    /// Whether something flat agrees in height: tall things that the image cut off at the top or below agree at
    /// any height.
    pub level: bool,
}

fn about_z(angle: f32) -> UnitQuaternion<f32> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
}

/// Two graphs of rooms with known footprints. Which of them is laid on which follows from what they hold, so that the
/// answer is the same seen from either.
pub(super) struct Views<'a> {
    reference: Boxes,
    query: Boxes,
    /// Whether `query` here is the reference of who asks, and the other way round.
    swapped: bool,
    classes: Vec<f32>,
    sides: Sides,
    structure: &'a [LabelId],
}

impl<'a> Views<'a> {
    /// None where footprints are not known, or the graphs are no rooms.
    pub(super) fn of(index: &Index, query: &SceneGraph, params: &'a RobustParams) -> Option<Self> {
        let fewest = params.fewest + 1;
        let mut query = Boxes::of(query.nodes().map(|n| Item::of(&n)), fewest)?;
        let mut reference = Boxes::of(index.all().copied(), fewest)?;
        let swapped = query.amount() > reference.amount();
        if swapped {
            std::mem::swap(&mut query, &mut reference);
        }
        let classes = classes(&reference.items, &query.items);
        let (sides, structure) = (Sides::new(), &params.structure);
        Some(Self { reference, query, swapped, classes, sides, structure })
    }

    /// Poses of the query on which sides agree, best first.
    pub(super) fn poses(&self, work: &mut Work) -> Vec<Pose> {
        let seen_so = |p: Pose| Pose { reference_from_query: self.seen_so(&p.reference_from_query), ..p };
        self.search(&self.query, work).into_iter().map(seen_so).collect()
    }

    /// What poses of the mirror image are worth, the best first.
    pub(super) fn mirrored(&self, work: &mut Work) -> Vec<f32> {
        self.search(&self.query.mirrored(), work).into_iter().map(|p| p.evidence).collect()
    }

    /// A pose laid by sides: near it, where they agree at least as well.
    pub(super) fn laid(&self, pose: &Isometry3<f32>, work: &mut Work) -> Option<Pose> {
        let Start { turn, motion } = self.start(pose);
        self.face(turn, work, |face, work| {
            let laid = [face.settle(motion, work)?, face.at(motion)];
            let laid = laid.into_iter().reduce(|a, b| if b.evidence >= a.evidence { b } else { a })?;
            let laid = self.pose(&self.query, turn, laid);
            Some(Pose { reference_from_query: self.seen_so(&laid.reference_from_query), ..laid })
        })
    }

    /// The least evidence that a pose loses when it slides or turns a little. None beyond the budget.
    pub(super) fn hold(&self, pose: &Isometry3<f32>, work: &mut Work) -> Option<f32> {
        let Start { turn, motion } = self.start(pose);
        self.face(turn, work, |face, work| face.hold(motion, work))
    }

    /// Where the fit of a pose begins. Of a pose that tilts, what it is without the tilt.
    fn start(&self, pose: &Isometry3<f32>) -> Start {
        let (reference, query, pose) = (&self.reference, &self.query, self.seen_so(pose));
        let x = pose.rotation * Vector3::x();
        let yaw = x.y.atan2(x.x) - reference.turn + query.turn;
        let quarter = (yaw / FRAC_PI_2).round();
        let middle = pose * Point3::from(query.middle) - reference.middle;
        let shift = about_z(-reference.turn) * middle.coords;
        let motion = Motion { turn: yaw - quarter * FRAC_PI_2, shift: shift.into() };
        Start { turn: quarter * FRAC_PI_2 - query.turn, motion }
    }

    /// Both graphs along the walls, the query turned. None beyond the budget.
    fn face<T>(
        &self,
        turn: f32,
        work: &mut Work,
        then: impl FnOnce(&Face<'_>, &mut Work) -> Option<T>,
    ) -> Option<T> {
        let slabs = self.reference.turned(-self.reference.turn, self.structure);
        let turned = self.query.turned(turn, self.structure);
        if !work.spend((slabs.len() * turned.len()) as u64) {
            return None;
        }
        then(&Face::new(&slabs, &turned, &self.classes, &self.sides), work)
    }

    /// A pose of the one, as seen from the one that is asked.
    fn seen_so(&self, pose: &Isometry3<f32>) -> Isometry3<f32> {
        if self.swapped { pose.inverse() } else { *pose }
    }

    /// The pose of a query turned by `turn` and moved.
    fn pose(&self, query: &Boxes, turn: f32, fitted: Fitted) -> Pose {
        let Fitted { motion, evidence, objects, common, level } = fitted;
        let reference = &self.reference;
        let rotation = about_z(reference.turn + motion.turn + turn);
        let middle = reference.middle + about_z(reference.turn) * Vector3::from(motion.shift);
        let shift = Translation3::from(middle - rotation * query.middle);
        Pose {
            reference_from_query: Isometry3::from_parts(shift, rotation),
            evidence,
            objects,
            common,
            level,
        }
    }

    fn search(&self, query: &Boxes, work: &mut Work) -> Vec<Pose> {
        let reference = &self.reference;
        let slabs = reference.turned(-reference.turn, self.structure);
        let turns: [f32; 4] = std::array::from_fn(|k| k as f32 * FRAC_PI_2 - query.turn);
        let turned = turns.map(|turn| query.turned(turn, self.structure));
        let mut faces = Vec::with_capacity(4);
        for turned in &turned {
            if !work.spend((slabs.len() * turned.len()) as u64) {
                return Vec::new();
            }
            faces.push(Face::new(&slabs, turned, &self.classes, &self.sides));
        }
        let pose = |(_, k, motion): (f32, usize, Motion)| {
            Some(self.pose(query, turns[k], faces[k].settle(motion, work)?))
        };
        let mut found: Vec<Pose> = starts(&faces).into_iter().filter_map(pose).collect();
        found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        found
    }
}

/// Where a fit begins: the query's turn to the walls, and the motion beside it.
struct Start {
    turn: f32,
    motion: Motion,
}

/// The most promising proposals, best first: what they are worth as they are, the turn, the motion.
fn starts(faces: &[Face<'_>]) -> Vec<(f32, usize, Motion)> {
    let (mut hits, mut shifts) = (Vec::new(), Vec::new());
    for (quarter, face) in (0..).step_by(QUARTER).zip(faces) {
        face.propose(quarter, &mut hits, &mut shifts);
    }
    let sorted = vote::Sorted::of(&hits);
    let start = |peak: vote::Bin| {
        // The middle of what lies in the bin, by weight.
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for h in sorted.hits_around(&peak).filter(|&h| hits[h].bin == peak) {
            let weight = hits[h].weight as f32;
            (sum, total) = (std::array::from_fn(|k| sum[k] + weight * shifts[h][k]), total + weight);
        }
        let motion = Motion { turn: 0.0, shift: sum.map(|v| v / total) };
        let k = peak[0] as usize / QUARTER;
        (faces[k].pairs(&faces[k].moved(&motion)).1, k, motion)
    };
    let mut starts: Vec<_> = vote::peaks(&hits, &sorted, PEAKS, BINS).into_iter().map(start).collect();
    starts.sort_by(|a, b| b.0.total_cmp(&a.0));
    starts.truncate(FITTED);
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Box3, Footprint, Node, NodeId};

    /// Boxes given by their lowest and highest corners.
    fn graph(boxes: &[[[f32; 3]; 2]]) -> SceneGraph {
        let mut graph = SceneGraph::default();
        for (id, [low, high]) in boxes.iter().enumerate() {
            let size: [f32; 3] = std::array::from_fn(|k| high[k] - low[k]);
            let middle = std::array::from_fn(|k| (high[k] + low[k]) / 2.0);
            let foot = Footprint::rectangle([size[0], size[1]], 0.0);
            let bounds = Box3::new(middle, size).and_then(|b| b.with_footprint(foot)).expect("finite");
            graph.insert_node(Node::new(NodeId(id as u64), LabelId(id as u16 % 3), bounds));
        }
        graph
    }

    fn best(reference: &[[[f32; 3]; 2]], query: &[[[f32; 3]; 2]]) -> Pose {
        let params = RobustParams::default();
        let index = Index::of(&graph(reference), &params);
        let views = Views::of(&index, &graph(query), &params).expect("rooms");
        views.poses(&mut Work::new(1 << 20)).first().expect("a pose").clone()
    }

    /// Six pillars, and of one view a part in height.
    fn pillars(low: f32, high: f32) -> Vec<[[f32; 3]; 2]> {
        let feet = [[0.0, 0.0], [2.0, 0.3], [3.1, 1.9], [0.4, 2.6], [1.2, 1.3], [4.0, 3.0]];
        let side = |k: usize| 0.3 + 0.11 * k as f32;
        let pillar = |(k, [x, y]): (usize, [f32; 2])| [[x, y, low], [x + side(k), y + 0.4, high]];
        feet.into_iter().enumerate().map(pillar).collect()
    }

    #[test]
    fn sides_are_laid_on_sides() {
        let floor = [[-1.0, -1.0, -0.05], [4.5, 3.5, 0.0]];
        let (mut a, mut b) = (pillars(0.0, 2.0), pillars(0.0, 2.0));
        // Half of the fifth is hidden from the one, half of the sixth from the other.
        (a[4][1][0], b[5][0][0]) = (a[4][1][0] - 0.35, b[5][0][0] + 0.4);
        a.push(floor);
        b.push(floor);
        let pose = best(&a, &b);
        assert!(pose.reference_from_query.translation.vector.norm() < 0.01, "{pose:?}");
        assert!(pose.reference_from_query.rotation.angle() < 0.01 && pose.level, "{pose:?}");
        assert_eq!(pose.objects.0, 7);
    }

    #[test]
    fn a_motion_of_both_moves_the_pose() {
        let params = RobustParams::default();
        let mut seen = [pillars(0.0, 2.0), pillars(0.0, 2.0)];
        seen.iter_mut().for_each(|s| s.push([[-1.0, -1.0, -0.05], [4.5, 3.5, 0.0]]));
        (seen[0][4][1][0], seen[1][2][0][1]) = (seen[0][4][1][0] - 0.35, seen[1][2][0][1] + 0.2);
        for k in 0..12 {
            let k = k as f32;
            let (a, of_a) = moved(&seen[0], 0.4 * k - 2.0, [3.0 * k, 7.0 - k, 0.1 * k]);
            let (b, of_b) = moved(&seen[1], 2.9 - 0.7 * k, [9.0 - k, k * k, 1.0]);
            let index = Index::of(&a, &params);
            let views = Views::of(&index, &b, &params).expect("rooms");
            let found = views.poses(&mut Work::new(1 << 20));
            let off = of_a.inverse() * found[0].reference_from_query * of_b;
            assert!(off.translation.vector.norm() < 0.02 && off.rotation.angle() < 0.005, "{k}: {off}");
        }
    }

    /// A graph in a frame of its own, and that frame.
    fn moved(boxes: &[[[f32; 3]; 2]], yaw: f32, shift: [f32; 3]) -> (SceneGraph, Isometry3<f32>) {
        let t = Isometry3::new(shift.into(), Vector3::z() * yaw);
        let mut out = SceneGraph::default();
        for n in graph(boxes).nodes() {
            out.insert_node(Node { bounds: n.bounds.transformed(&t), ..n.clone() });
        }
        (out, t)
    }

    #[test]
    fn a_pose_nearby_is_laid_by_sides() {
        let params = RobustParams::default();
        let (mut a, mut b) = (pillars(0.0, 2.0), pillars(0.0, 2.0));
        (a[4][1][0], b[5][0][0]) = (a[4][1][0] - 0.35, b[5][0][0] + 0.4);
        for k in 0..12 {
            let k = k as f32;
            let (a, of_a) = moved(&a, 0.5 * k - 2.0, [2.0 * k, 5.0 - k, 0.1 * k]);
            let (b, of_b) = moved(&b, 2.9 - 0.8 * k, [9.0 - k, k * k, 1.0]);
            let index = Index::of(&a, &params);
            let views = Views::of(&index, &b, &params).expect("rooms");
            let truth = of_a * of_b.inverse();
            let centre = Translation3::from(of_b * Vector3::new(2.0, 1.5, 1.0) + of_b.translation.vector);
            let turn = Isometry3::rotation(Vector3::z() * 0.05 * (k - 6.0).signum());
            let aside = Translation3::new(0.2 * k.cos(), 0.2 * k.sin(), -0.1);
            let near = truth * centre * aside * turn * centre.inverse();
            let laid = views.laid(&near, &mut Work::new(1 << 20)).expect("sides agree better there");
            let off = of_a.inverse() * laid.reference_from_query * of_b;
            assert!(off.translation.vector.norm() < 0.02 && off.rotation.angle() < 0.005, "{k}: {off}");
            assert!(views.laid(&near, &mut Work::new(10)).is_none(), "no budget");
        }
    }

    #[test]
    fn what_is_found_by_middles_is_laid_by_sides() {
        let floor = [[-1.0, -1.0, -0.05], [4.5, 3.5, 0.0]];
        let (mut a, mut b) = (pillars(0.0, 2.0), pillars(0.0, 2.0));
        a.push(floor);
        // Two fifths of each are hidden from the one, on the same side: the middles agree on a place that is off.
        b.iter_mut().for_each(|p| p[1][0] -= 0.4 * (p[1][0] - p[0][0]));
        b.push(floor);
        let (b, of_b) = moved(&b, 0.8, [3.0, -2.0, 0.5]);
        let query = crate::Query::new(&b);
        let index = Index::of(&graph(&a), &RobustParams::default());
        let off = |o: crate::Outcome| match o {
            crate::Outcome::Match(m) => {
                let off = m.reference_from_query * of_b;
                (off.translation.vector.xy().norm(), off.rotation.angle())
            }
            other => panic!("{other:?}"),
        };
        let by_middles = off(super::super::align_first(&index, &query, &RobustParams::default()));
        let by_sides = off(super::super::align(&index, &query, &RobustParams::default()));
        assert!(by_middles.0 > 0.08 && by_sides.0 < 0.05, "{by_middles:?}, {by_sides:?}");
        assert!(by_sides.1 < by_middles.1, "{by_middles:?}, {by_sides:?}");
    }

    /// Benches of 1.6 m side by side, and what a view shows of them: of each end so much is hidden, metres.
    fn benches(hidden: [[f32; 2]; 6], along: usize) -> SceneGraph {
        let across = 1 - along;
        let bench = |(k, [low, high]): (usize, [f32; 2])| {
            let (mut from, mut to) = ([0.0; 3], [0.0, 0.0, 0.5 + 0.1 * k as f32]);
            (from[along], to[along]) = (low, 1.6 - high);
            from[across] = [0.0, 0.9, 1.5, 2.8, 3.5, 4.9][k];
            to[across] = from[across] + 0.3 + 0.05 * k as f32;
            [from, to]
        };
        graph(&hidden.into_iter().enumerate().map(bench).collect::<Vec<_>>())
    }

    #[test]
    fn what_can_slide_is_refused() {
        let params = RobustParams::default();
        let ends = [[0.2, 0.5], [0.5, 0.2], [0.35, 0.25], [0.1, 0.4], [0.55, 0.35], [0.3, 0.6]];
        for along in 0..2 {
            let index = Index::of(&benches([[0.0; 2]; 6], along), &params);
            let ask =
                |hidden| super::super::align(&index, &crate::Query::new(&benches(hidden, along)), &params);
            // Where all ends are seen, and where those of one side and some of the other are.
            for seen in [[[0.0; 2]; 6], ends.map(|[low, _]| [if low < 0.25 { 0.0 } else { low }, 0.0])] {
                let crate::Outcome::Match(m) = ask(seen) else { panic!("{along}: {:?}", ask(seen)) };
                assert!(m.reference_from_query.translation.vector.norm() < 0.05, "{along}: {m:?}");
            }
            // Where no end is, they lie anywhere along.
            let open = ask(ends);
            assert!(matches!(open, crate::Outcome::NoMatch { why: crate::Why::Loose }), "{along}: {open:?}");
        }
    }

    #[test]
    fn what_the_image_cut_off_at_one_height_is_not_level() {
        let pose = best(&pillars(0.0, 0.6), &pillars(1.3, 1.9));
        // All sides agree, at a height that is wrong by 1.3 m.
        assert!(
            (pose.reference_from_query.translation.z + 1.3).abs() < 0.05 && pose.evidence > 40.0,
            "{pose:?}"
        );
        assert!(!pose.level, "{pose:?}");
    }

    #[test]
    fn nothing_is_tried_beyond_the_budget_or_without_footprints() {
        let params = RobustParams::default();
        let graph = graph(&pillars(0.0, 2.0));
        let index = Index::of(&graph, &params);
        let mut work = Work::new(10);
        assert!(Views::of(&index, &graph, &params).expect("rooms").poses(&mut work).is_empty());
        let mut bare = SceneGraph::default();
        for n in graph.nodes() {
            let bounds = Box3::new(n.bounds.centroid().into(), n.bounds.extent().into()).expect("finite");
            bare.insert_node(Node { bounds, ..n.clone() });
        }
        assert!(Views::of(&index, &bare, &params).is_none());
    }
}
