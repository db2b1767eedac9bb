//! Many rooms behind the interface of a recorded data set.

use crate::layout::layout;
use crate::path::{RATE, path};
use crate::relations::relations;
use crate::render::{Image, Scene};
use crate::rescan::{ambiguity, reference_from_room, rescan};
use crate::rng::{Draw, key};
use crate::room::{Room, Scan};
use crate::sensor::{Sensor, SensorParams, Tracker};
use crate::split::Split;
use crate::surface::annotate;
use nalgebra::Isometry3;
use rayon::prelude::*;
use scan3r::{Annotation, Dataset, Error, Frame, FrameStream, Intrinsics, Relation, RoomEntry};
use std::collections::BTreeMap;

/// How a world is recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldParams {
    /// The depth camera's faults.
    pub sensor: SensorParams,
    /// The depth camera.
    pub intrinsics: Intrinsics,
    /// Mean number of frames per visit, at 5 Hz.
    pub frames: f32,
    /// Whether rooms are scanned again after things have changed.
    pub rescans: bool,
}

/// Depth camera of 3RScan's phone: pixels are not square, the image lies on its side.
pub const PHONE: Intrinsics =
    Intrinsics { fx: 176.594, fy: 240.808, cx: 114.613, cy: 85.7915, width: 224, height: 172 };

impl Default for WorldParams {
    fn default() -> Self {
        Self { sensor: SensorParams::default(), intrinsics: PHONE, frames: 245.0, rescans: true }
    }
}

/// Generated rooms. Room i depends on (split, seed, i) alone: a smaller world is a prefix.
pub struct World {
    split: Split,
    params: WorldParams,
    rooms: Vec<Room>,
    entries: Vec<RoomEntry>,
    /// Scan id to (room, scan).
    index: BTreeMap<String, (usize, usize)>,
}

impl World {
    /// Generates `rooms` rooms. Rooms are furnished here; images are made when they are asked for.
    #[must_use]
    pub fn new(split: Split, seed: u64, rooms: usize, params: &WorldParams) -> Self {
        let rooms: Vec<Room> =
            (0..rooms as u64).into_par_iter().map(|i| room(split, seed, i, params.rescans)).collect();
        let entries = rooms.iter().map(|r| r.entry.clone()).collect();
        let index = rooms
            .iter()
            .enumerate()
            .flat_map(|(r, room)| {
                room.scans.iter().enumerate().map(move |(s, scan)| (scan.id.clone(), (r, s)))
            })
            .collect();
        Self { split, params: params.clone(), rooms, entries, index }
    }

    /// The split that the shapes come from.
    #[must_use]
    pub fn split(&self) -> Split {
        self.split
    }

    /// The rooms with everything that is in them, in the order of [`Dataset::rooms`].
    #[must_use]
    pub fn generated(&self) -> &[Room] {
        &self.rooms
    }

    /// The room and the scan of that id.
    ///
    /// # Errors
    /// [`Error::UnknownScan`].
    pub fn scan(&self, id: &str) -> Result<(&Room, &Scan), Error> {
        let &(r, s) = self.index.get(id).ok_or_else(|| Error::UnknownScan(id.to_owned()))?;
        Ok((&self.rooms[r], &self.rooms[r].scans[s]))
    }

    /// The frames of a visit, each with the physical instance per pixel of the clean render (0 =
    /// nothing is there), where the noisy depth may be 0 or fly.
    ///
    /// # Errors
    /// [`Error::UnknownScan`].
    pub fn labelled_frames(&self, scan: &str, visit: u64) -> Result<LabelledFrames, Error> {
        let (room, scan) = self.scan(scan)?;
        Ok(LabelledFrames { visit: Visit::new(room, scan, visit, &self.params) })
    }
}

/// A uuid-shaped name.
fn uuid(seed: u64, indices: &[u64]) -> String {
    let (a, b) = (key(seed, "scan id a", indices), key(seed, "scan id b", indices));
    format!(
        "{:08x}-{:04x}-4{:03x}-8{:03x}-{:012x}",
        a >> 32,
        a >> 16 & 0xffff,
        a & 0xfff,
        b >> 48 & 0xfff,
        b & 0xffff_ffff_ffff
    )
}

/// Generates one room and its rescans.
fn room(split: Split, seed: u64, index: u64, rescans: bool) -> Room {
    let base = layout(seed, split, index);
    let root = key(seed, "room seed", &[split as u64, index]);
    let mut draw = Draw::new(root, "scans", &[]);
    let id = |scan: u64| uuid(root, &[scan]);
    let reference =
        Scan { id: id(0), scan_from_room: reference_from_room(&mut draw), instances: base.instances.clone() };
    // As in 3RScan's validation rooms.
    let numbers = [1, 2, 3, 4, 5, 9, 11];
    let n = numbers[draw.weighted([17.0, 16.0, 8.0, 3.0, 1.0, 1.0, 1.0].into_iter())];
    let mut next_id = base.next_id;
    let mut scans = vec![reference];
    let mut entries = Vec::new();
    for k in 1..=if rescans { n } else { 0 } {
        let draw = Draw::new(root, "rescan", &[k]);
        let r = rescan(&base, &scans[0], id(k), split, draw, &mut next_id);
        scans.push(r.scan);
        entries.push(r.entry);
    }
    let entry = RoomEntry {
        reference: id(0),
        split: split.name().to_owned(),
        ambiguity: ambiguity(&scans[0]),
        scans: entries,
    };
    Room { kind: base.kind, entry, scans, seed: root, floor: base.plan.rects }
}

/// One pass through a scan: the true path, and the sensor that walks it.
struct Visit {
    scene: Scene,
    image: Image,
    sensor: Sensor,
    tracker: Tracker,
    poses: Vec<Isometry3<f32>>,
    intrinsics: Intrinsics,
    seed: u64,
    next: usize,
}

/// The seed of a visit and its true camera poses in the scan's frame.
fn poses(room: &Room, scan: &Scan, visit: u64, params: &WorldParams) -> (u64, Vec<Isometry3<f32>>) {
    let which = room.scans.iter().position(|s| s.id == scan.id).unwrap_or(0) as u64;
    let seed = key(room.seed, "visit", &[which, visit]);
    let mut draw = Draw::new(seed, "path", &[]);
    let poses = path(room, scan, &mut draw, params.frames)
        .iter()
        .map(|p| (scan.scan_from_room * p.cast::<f64>()).cast())
        .collect();
    (seed, poses)
}

impl Visit {
    fn new(room: &Room, scan: &Scan, visit: u64, params: &WorldParams) -> Self {
        let (seed, poses) = poses(room, scan, visit, params);
        let scene = Scene::new(scan);
        Self {
            image: scene.image(&params.intrinsics),
            scene,
            sensor: Sensor::new(params.sensor.clone(), params.intrinsics),
            tracker: Tracker::new(params.sensor.clone()),
            poses,
            intrinsics: params.intrinsics,
            seed,
            next: 0,
        }
    }

    /// The next frame; the clean image stays in `self.image`.
    fn frame(&mut self) -> Option<Frame> {
        let pose = *self.poses.get(self.next)?;
        let index = self.next as u32;
        self.next += 1;
        let mut draw = Draw::new(self.seed, "frame", &[u64::from(index)]);
        self.scene.draw(&pose, &self.intrinsics, &mut self.image);
        let depth = self.sensor.measure(&self.image, &self.scene, &mut draw);
        let world_from_camera = self.tracker.report(&pose, &mut draw).map(|p| scan3r::pose::settled(&p));
        let time = f64::from(index) / f64::from(RATE);
        Some(Frame { index, time, depth, intrinsics: self.intrinsics, world_from_camera })
    }
}

/// Frames with the instance of every pixel; see [`World::labelled_frames`].
pub struct LabelledFrames {
    visit: Visit,
}

impl Iterator for LabelledFrames {
    type Item = (Frame, Vec<u32>);

    fn next(&mut self) -> Option<Self::Item> {
        let frame = self.visit.frame()?;
        let id = |&t: &u32| if t == u32::MAX { 0 } else { self.visit.scene.surface(t).0 };
        let ids = self.visit.image.triangle.iter().map(id).collect();
        Some((frame, ids))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let n = self.visit.poses.len() - self.visit.next;
        (n, Some(n))
    }
}

impl Dataset for World {
    fn kind(&self) -> &'static str {
        "generated"
    }

    fn has_own_path_per_visit(&self) -> bool {
        true
    }

    fn rooms(&self) -> &[RoomEntry] {
        &self.entries
    }

    fn annotation(&self, scan: &str) -> Result<Annotation, Error> {
        let (room, scan) = self.scan(scan)?;
        Ok(annotate(room, scan))
    }

    fn relations(&self, scan: &str) -> Result<Vec<Relation>, Error> {
        let (room, scan) = self.scan(scan)?;
        Ok(relations(&scan.instances, room.seed))
    }

    fn frame_count(&self, scan: &str, visit: u64) -> Result<u32, Error> {
        let (room, scan) = self.scan(scan)?;
        Ok(poses(room, scan, visit, &self.params).1.len() as u32)
    }

    fn frames(&self, scan: &str, visit: u64) -> Result<FrameStream<'_>, Error> {
        let (room, scan) = self.scan(scan)?;
        let mut visit = Visit::new(room, scan, visit, &self.params);
        Ok(Box::new(std::iter::from_fn(move || visit.frame().map(Ok))))
    }
}
