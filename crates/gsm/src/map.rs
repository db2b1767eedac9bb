//! The map and its frame loop.

use crate::associate::{Association, Pose};
use crate::batch::Ahead;
use crate::bricks::Bricks;
use crate::event::{Counts, FrameReport, SegmentId};
use crate::image::Image;
use crate::merge::Merges;
use crate::predict::Prediction;
use crate::segment::{Segment, Surfel};
use crate::segments::Segments;
use crate::split::Splits;
use crate::store::{Step, Store};
use crate::surfels::Surfels;
use crate::visibility::Visibility;
use crate::vote::Votes;
use crate::{DepthView, Error, Params, Tracking, fuse, track, visibility};
use nalgebra::{Isometry3, Point3, Vector3};

/// Bricks that are checked for timed-out surfels per frame, in or out of view.
const SWEEP: usize = 64;

/// The stages of a frame, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Depth at working resolution.
    Shrink,
    /// Bricks in view and the visibility grid.
    Look,
    /// Depth expected by the map.
    Predict,
    /// Links between pixels.
    Links,
    /// Normals.
    Normals,
    /// Edges.
    Edges,
    /// Regions.
    Regions,
    /// Samples.
    Samples,
    /// Projective association.
    Associate,
    /// Votes.
    Vote,
    /// Fusion and new surfels.
    Fuse,
    /// Merges, time-outs, events.
    Merge,
}

/// A growing surfel map with segments. All state of a recording; one per robot.
#[derive(Debug)]
pub struct Map {
    pub(crate) params: Params,
    pub(crate) image: Image,
    pub(crate) ahead: [Ahead; 2],
    pub(crate) store: Store,
    /// Times of the frames, the first one unused.
    pub(crate) times: Vec<f64>,
    prediction: Prediction,
    association: Association,
    votes: Votes,
    verdicts: fuse::Verdicts,
    pub(crate) merges: Merges,
    splits: Splits,
    pub(crate) visible: Vec<u32>,
    /// Frames integrated.
    pub(crate) now: u32,
    pub(crate) last_centre: Option<[f32; 3]>,
    pub(crate) sweep: usize,
    /// Believed places to those of the map.
    correction: Isometry3<f32>,
}

impl Map {
    /// An empty map.
    ///
    /// # Errors
    /// [`Error::Params`] when a parameter is out of range.
    pub fn new(params: Params) -> Result<Self, Error> {
        params.validate()?;
        let bricks = Bricks::new(params.brick, params.max_bricks);
        Ok(Self {
            params,
            image: Image::default(),
            ahead: Default::default(),
            store: Store { surfels: Surfels::default(), bricks, segments: Segments::default() },
            times: vec![f64::NAN],
            prediction: Prediction::default(),
            association: Association::default(),
            votes: Votes::default(),
            verdicts: fuse::Verdicts::default(),
            merges: Merges::default(),
            splits: Splits::default(),
            visible: Vec::new(),
            now: 0,
            last_centre: None,
            sweep: 0,
            correction: Isometry3::identity(),
        })
    }

    /// Adds one posed depth image. Never fails: an unusable frame changes nothing and is reported as skipped.
    pub fn integrate(&mut self, view: &DepthView<'_>) -> FrameReport {
        self.integrate_observed(view, |_| ())
    }

    /// Like [`integrate`](Self::integrate), calling `done` at the end of every stage, so that the caller can time
    /// them.
    pub fn integrate_observed(&mut self, view: &DepthView<'_>, mut done: impl FnMut(Stage)) -> FrameReport {
        let mut report =
            FrameReport { skipped: self.image.read(view, &self.params), ..FrameReport::default() };
        done(Stage::Shrink);
        if report.skipped.is_some() {
            return report;
        }
        let pose = self.enter(view, &mut report);
        done(Stage::Look);
        if self.params.noise.is_independent() {
            let step = step(&self.image, &self.params, &pose, self.now);
            self.prediction.gather(step, &self.visible, &self.store);
            self.image.frame.steady(&self.prediction);
        }
        done(Stage::Predict);
        self.image.segment(&self.params, &mut done);
        self.learn(&pose, &mut report, &mut done);
        report
    }

    /// The frame's pose, corrected where poses drift; what is in view, and what was looked through.
    pub(crate) fn enter(&mut self, view: &DepthView<'_>, report: &mut FrameReport) -> Pose {
        let believed = self.correction * view.world_from_camera;
        let mut pose = Pose::new(&believed);
        report.jumped = self.begin(&pose, view.time);
        if self.params.tracking != Tracking::Off {
            // What the last frame saw is most of what this one sees.
            let step = step(&self.image, &self.params, &pose, self.now);
            if let Some(motion) = track::motion(step, &self.visible, &self.store) {
                let moved = believed * motion;
                self.correction = moved * view.world_from_camera.inverse();
                self.correction.rotation.renormalize();
                pose = Pose::new(&moved);
            }
        }
        self.look(&pose, report);
        pose
    }

    /// Maps the world as the poses have it into the map's: what [`Params::tracking`] has found so far.
    pub fn correction(&self) -> Isometry3<f32> {
        self.correction
    }

    /// What is in view, and what was looked through.
    fn look(&mut self, pose: &Pose, report: &mut FrameReport) {
        let step = step(&self.image, &self.params, pose, self.now);
        report.counts.refused += visibility::look(step, &mut self.store.bricks, &mut self.visible);
    }

    /// The map takes over what the segmented image shows.
    pub(crate) fn learn(&mut self, pose: &Pose, report: &mut FrameReport, done: &mut impl FnMut(Stage)) {
        let step = step(&self.image, &self.params, pose, self.now);
        let (counts, events) = (&mut report.counts, &mut report.events);
        let (association, votes, store) = (&mut self.association, &mut self.votes, &mut self.store);
        association.run(step, &self.visible, store, counts);
        done(Stage::Associate);

        // Regions of the frame become segments of the map.
        votes.run(step, association, store, events);
        self.splits.run(step, association, votes, store, events);
        done(Stage::Vote);

        fuse::label(step, association, votes, store, &mut self.verdicts);
        fuse::create(step, association, votes, store, counts);
        done(Stage::Fuse);
        self.merges.run(step, votes, store, events);
        counts.expired += expire(step, store, &mut self.sweep);
        store.segments.settle(events);
        self.merges.forget_closed(&store.segments);
        self.count(counts);
        done(Stage::Merge);
    }

    /// Counts the frame; true when the camera jumped.
    pub(crate) fn begin(&mut self, pose: &Pose, time: f64) -> bool {
        if self.now == 0 {
            self.store.segments.origin = pose.centre;
        }
        self.now += 1;
        self.times.push(time);
        let last = self.last_centre.replace(pose.centre);
        last.is_some_and(|c| {
            (0..3).map(|k| (c[k] - pose.centre[k]).powi(2)).sum::<f32>() > self.params.jump.powi(2)
        })
    }

    fn count(&self, counts: &mut Counts) {
        counts.working_size = (self.image.frame.width as u32, self.image.frame.height as u32);
        counts.samples = self.image.samples.list.len() as u32;
        counts.valid = self.image.frame.valid as u32;
        counts.regions = self.image.frame.region_size.len() as u32 - 1;
        counts.bricks = self.visible.len() as u32;
        counts.surfels = self.store.surfels.len() as u32;
        counts.segments = self.store.segments.open_slots().count() as u32;
    }

    /// Segments of the last integrated frame, per working pixel, row-major (`None` = no region there), with the
    /// working columns.
    pub fn frame_segments(&self) -> (usize, Vec<Option<SegmentId>>) {
        let slot = |&region: &u32| self.votes.segment_of.get(region as usize).copied().unwrap_or(0);
        let id =
            |s: u32| (s != 0 && self.store.segments.is_open(s - 1)).then(|| self.store.segments.id(s - 1));
        (self.image.frame.width, self.image.frame.label.iter().map(slot).map(id).collect())
    }

    /// Regions of the last integrated frame (1.., 0 = none), like [`frame_segments`](Self::frame_segments).
    pub fn frame_regions(&self) -> (usize, &[u32]) {
        (self.image.frame.width, &self.image.frame.label)
    }

    /// Edge pixels of the last integrated frame, like [`frame_segments`](Self::frame_segments).
    pub fn frame_edges(&self) -> (usize, Vec<bool>) {
        (self.image.frame.width, self.image.frame.edge.iter().map(|&e| e != 0).collect())
    }

    /// Changes [`Params::max_pixels`] from the next frame on; see [`Budget`](crate::Budget).
    pub fn set_max_pixels(&mut self, pixels: u32) {
        self.params.max_pixels = pixels.clamp(1, 1 << 30);
    }

    /// The parameters it was made with.
    pub fn params(&self) -> &Params {
        &self.params
    }

    /// Frames integrated so far.
    pub fn frames(&self) -> u32 {
        self.now
    }

    /// Zero of the segments' integer moments, world frame: the first camera's centre.
    pub fn origin(&self) -> Point3<f32> {
        Point3::from(self.store.segments.origin)
    }

    /// The live segments in the order of their ids.
    pub fn segments(&self) -> impl Iterator<Item = Segment<'_>> {
        let mut records: Vec<_> = self.store.segments.open_slots().collect();
        records.sort_unstable_by_key(|r| r.id);
        records.into_iter().map(|record| Segment { map: self, record })
    }

    /// A live segment by its id.
    pub fn segment(&self, id: SegmentId) -> Option<Segment<'_>> {
        let record = self.store.segments.open_slots().find(|r| r.id == id.0)?;
        Some(Segment { map: self, record })
    }

    /// Up to `n` stable surfels of a segment; see [`Segment::sample`]. Empty for an unknown id.
    pub fn segment_points(&self, id: SegmentId, n: usize) -> Vec<(Point3<f32>, Vector3<f32>)> {
        self.segment(id).map(|s| s.sample(n)).unwrap_or_default()
    }

    /// The live surfels in the order in which they are stored, which depends on the history alone.
    pub fn surfels(&self) -> impl Iterator<Item = Surfel> + '_ {
        (0..self.store.surfels.entries()).filter(|&i| self.store.surfels.is_live(i)).map(|i| {
            let hot = self.store.surfels.hot(i);
            Surfel {
                position: Point3::from(hot.position),
                normal: Vector3::from(hot.normal),
                radius: hot.radius,
                confidence: self.store.surfels.confidence(i),
                segment: (hot.segment != 0).then(|| self.store.segments.id(hot.segment - 1)),
                stable: self.store.surfels.is_stable(i),
            }
        })
    }

    /// What was looked through, seen, or not looked at.
    pub fn visibility(&self) -> Visibility<'_> {
        Visibility { bricks: &self.store.bricks }
    }

    /// Bytes held by surfels, bricks and segments, slack included (frame workspace excluded).
    pub fn bytes(&self) -> usize {
        self.store.surfels.bytes() + self.store.bricks.bytes() + self.store.segments.bytes()
    }
}

/// Removes timed-out unstable surfels from the next few bricks, so that none lingers out of view.
fn expire(step: Step<'_>, store: &mut Store, sweep: &mut usize) -> u32 {
    let mut expired = 0;
    let n = store.bricks.list.len();
    for _ in 0..SWEEP.min(n) {
        *sweep = (*sweep + 1) % n;
        if !store.bricks.list[*sweep].blocks.is_empty() {
            expired += store.weed(*sweep, step);
        }
    }
    expired
}

/// The current frame, as the stages of the map see it.
fn step<'a>(image: &'a Image, params: &'a Params, pose: &'a Pose, now: u32) -> Step<'a> {
    Step { frame: &image.frame, samples: &image.samples, pose, params, now }
}
