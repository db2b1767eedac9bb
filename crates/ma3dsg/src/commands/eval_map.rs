//! `ma3dsg eval-map`: the map over time on generated rooms. What goes when things are moved, and whether a frame
//! costs more after many rooms than in a fresh map.

use super::say;
use crate::{clock, pipeline};
use anyhow::{Context, Result};
use bench_3rscan::Surface;
use gsm::{DepthView, Map, Profile};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use room_synth::{Room, Scan, SensorParams, Split, World, WorldParams};
use scan3r::{Dataset, Frame};
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Frames that look through a place, or see it, before its surfels are counted.
const FRAMES: u32 = 5;
/// A surfel is still there when one lies so near, metres, and faces alike.
const NEAR: f32 = 0.02;
/// A depth is clearly before or behind a surfel by more than this, metres.
const CLEAR: f32 = 0.05;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Which rooms.
    #[arg(long, default_value = "validation", value_parser = ["train", "validation", "test"])]
    split: String,
    /// Number of rooms.
    #[arg(long, default_value_t = 6)]
    rooms: usize,
    /// Seed.
    #[arg(long, default_value_t = 21)]
    seed: u64,
    /// Instead walk through all rooms with one map, and time it beside fresh maps.
    #[arg(long)]
    walk: bool,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let split = Split::parse(&self.split).context("--split")?;
        say(format!("{} generated {} rooms, seed {}", self.rooms, self.split, self.seed));
        let noisy = SensorParams::default();
        if self.walk {
            let params = WorldParams { rescans: false, sensor: noisy, ..WorldParams::default() };
            let world = World::new(split, self.seed, self.rooms, &params);
            // One thread, so that the clock sees all of the work.
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
            pool.install(|| walk(&world, &pipeline::segmentation(Profile::TofPhone)))?;
            return Ok(ExitCode::SUCCESS);
        }
        let clean = WorldParams { sensor: SensorParams::clean(), ..WorldParams::default() };
        let truth = World::new(split, self.seed, self.rooms, &clean);
        let real = World::new(
            split,
            self.seed,
            self.rooms,
            &WorldParams { sensor: noisy, ..WorldParams::default() },
        );
        for (name, world, profile) in [("clean", &truth, Profile::Ideal), ("noisy", &real, Profile::TofPhone)]
        {
            let params = pipeline::segmentation(profile);
            let counts: Vec<Fates> = truth
                .generated()
                .par_iter()
                .map(|room| rescan(world, &truth, room, &params))
                .collect::<Result<_>>()?;
            let mut all = Fates::default();
            counts.iter().for_each(|c| all.add(c));
            all.print(name);
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Surfels of the old map, and those of them that are gone after the rescan.
#[derive(Clone, Copy, Default)]
struct Fates {
    through: [u64; 2],
    seen: [u64; 2],
    hidden: [u64; 2],
    outside: [u64; 2],
}

impl Fates {
    fn parts(&mut self) -> [&mut [u64; 2]; 4] {
        [&mut self.through, &mut self.seen, &mut self.hidden, &mut self.outside]
    }

    fn add(&mut self, other: &Self) {
        let mut other = *other;
        for (a, b) in self.parts().into_iter().zip(other.parts()) {
            (a[0], a[1]) = (a[0] + b[0], a[1] + b[1]);
        }
    }

    fn print(&self, name: &str) {
        let share =
            |[all, gone]: [u64; 2]| format!("{:.2} % of {all}", 100.0 * gone as f64 / all.max(1) as f64);
        say(format!("{name}, first rescan integrated into the map of the reference visit; surfels gone:"));
        say(format!(
            "  of removed or moved objects, looked through in {FRAMES} frames: {}",
            share(self.through)
        ));
        say(format!("  of static objects in view: {}", share(self.seen)));
        say(format!("  occluded: {}", share(self.hidden)));
        say(format!("  out of view: {}", share(self.outside)));
    }
}

fn view<'a>(frame: &'a Frame, world_from_scan: &Isometry3<f32>) -> Result<Option<DepthView<'a>>> {
    let i = frame.intrinsics;
    let intrinsics = gsm::Intrinsics::new(i.fx, i.fy, i.cx, i.cy, i.width, i.height)?;
    Ok(frame.world_from_camera.map(|pose| DepthView {
        depth: &frame.depth,
        intrinsics,
        world_from_camera: world_from_scan * pose,
        time: frame.time,
    }))
}

fn integrate(map: &mut Map, world: &World, scan: &str, world_from_scan: &Isometry3<f32>) -> Result<()> {
    for (frame, _) in world.labelled_frames(scan, 0)? {
        if let Some(view) = view(&frame, world_from_scan)? {
            map.integrate(&view);
        }
    }
    Ok(())
}

/// A surfel of the old map and what the rescan shows of its place.
struct Old {
    position: Point3<f32>,
    normal: Vector3<f32>,
    /// Whether its object is where it was.
    stays: bool,
    through: u32,
    seen: u32,
    hidden: u32,
    border: u32,
}

fn rescan(world: &World, truth: &World, room: &Room, params: &gsm::Params) -> Result<Fates> {
    let mut fates = Fates::default();
    let [reference, again, ..] = &room.scans[..] else { return Ok(fates) };
    let mut map = Map::new(params.clone())?;
    integrate(&mut map, world, &reference.id, &Isometry3::identity())?;
    let surface = Surface::new(truth.annotation(&reference.id)?);
    let moved = moved(reference, again);
    let mut old: Vec<Old> = map
        .surfels()
        .filter(|s| s.stable)
        .filter_map(|s| {
            let stays = match surface.instance_at(&s.position).map(|id| moved.get(&id)) {
                Some(Some(Some(moved))) => !moved,
                // Of no known object, or of one that was moved a little.
                _ => return None,
            };
            let (position, normal) = (s.position, s.normal);
            Some(Old { position, normal, stays, through: 0, seen: 0, hidden: 0, border: 0 })
        })
        .collect();
    let reference_from_again = (reference.scan_from_room * again.scan_from_room.inverse()).cast::<f32>();
    for (frame, _) in truth.labelled_frames(&again.id, 0)? {
        if let Some(view) = view(&frame, &reference_from_again)? {
            old.par_iter_mut().for_each(|o| o.watch(&view, params));
        }
    }
    integrate(&mut map, world, &again.id, &reference_from_again)?;
    let cells = Cells::new(&map);
    for o in &old {
        let fate = match (o.through, o.seen, o.hidden, o.border) {
            (through, 0, _, _) if !o.stays && through >= FRAMES => &mut fates.through,
            (0, seen, _, _) if o.stays && seen >= FRAMES => &mut fates.seen,
            (0, 0, hidden, 0) if hidden > 0 => &mut fates.hidden,
            (0, 0, 0, 0) => &mut fates.outside,
            _ => continue,
        };
        fate[0] += 1;
        fate[1] += u64::from(!cells.holds(&o.position, &o.normal));
    }
    Ok(fates)
}

/// Per instance of the reference whether it was removed or moved; `None` when moved too little to tell.
fn moved(reference: &Scan, again: &Scan) -> BTreeMap<u32, Option<bool>> {
    let fate = |i: &room_synth::Instance| {
        let Some(now) = again.instance(i.id) else { return Some(true) };
        let (a, b) = (i.room_from_object, now.room_from_object);
        let (shift, turn) =
            ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation));
        match (shift, turn) {
            (s, t) if s < 0.005 && t < 0.01 => Some(false),
            (s, t) if s > 0.15 || t > 0.5 => Some(true),
            _ => None,
        }
    };
    reference.instances.iter().map(|i| (i.id, fate(i))).collect()
}

impl Old {
    /// What a true depth image says of the place, by the 3×3 pixels around it.
    fn watch(&mut self, view: &DepthView<'_>, params: &gsm::Params) {
        let (k, p) = (&view.intrinsics, view.world_from_camera.inverse_transform_point(&self.position));
        if p.z < params.min_depth || p.z > 4.0 {
            return;
        }
        let (u, v) = (k.fx() * p.x / p.z + k.cx(), k.fy() * p.y / p.z + k.cy());
        let (w, h) = (k.width() as usize, k.height() as usize);
        if !(u >= 1.0 && v >= 1.0 && u < w as f32 - 2.0 && v < h as f32 - 2.0) {
            return;
        }
        let (x, y) = (u.round() as usize, v.round() as usize);
        let around = (0..9).map(|i| view.depth[(y + i / 3 - 1) * w + x + i % 3 - 1]);
        let (mut beyond, mut before, mut near) = (0, 0, 0);
        for d in around {
            beyond += u32::from(d > p.z + CLEAR);
            before += u32::from(d > 0.0 && d < p.z - CLEAR);
            near += u32::from((d - p.z).abs() <= CLEAR);
        }
        match (beyond, before, near) {
            (9, ..) => self.through += 1,
            (_, 9, _) => self.hidden += 1,
            (_, _, 9) => self.seen += 1,
            _ => self.border += 1,
        }
    }
}

/// Surfels by cells of [`NEAR`].
struct Cells(Vec<([i32; 3], Point3<f32>, Vector3<f32>)>);

impl Cells {
    fn new(map: &Map) -> Self {
        let mut cells: Vec<_> = map.surfels().map(|s| (key(&s.position), s.position, s.normal)).collect();
        cells.sort_unstable_by_key(|c| c.0);
        Self(cells)
    }

    fn holds(&self, p: &Point3<f32>, normal: &Vector3<f32>) -> bool {
        let [x, y, z] = key(p);
        (0..27).any(|i| {
            let k = [x + i / 9 - 1, y + i / 3 % 3 - 1, z + i % 3 - 1];
            let first = self.0.partition_point(|c| c.0 < k);
            self.0[first..]
                .iter()
                .take_while(|c| c.0 == k)
                .any(|(_, q, n)| (p - q).norm() < NEAR && n.dot(normal) > 0.7)
        })
    }
}

fn key(p: &Point3<f32>) -> [i32; 3] {
    [p.x, p.y, p.z].map(|v| (v / NEAR).floor() as i32)
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// Walks through the rooms, 30 m apart, with one map, each frame also given to a map of its room alone.
fn walk(world: &World, params: &gsm::Params) -> Result<()> {
    let mut all = Map::new(params.clone())?;
    let (mut walked, mut fresh) = (Vec::new(), Vec::new());
    let (mut surfels, mut ratios, mut area) = (0, Vec::new(), 0.0);
    for (n, room) in world.rooms().iter().enumerate() {
        let apart = Isometry3::translation(30.0 * (n % 8) as f32, 30.0 * (n / 8) as f32, 0.0);
        let mut own = Map::new(params.clone())?;
        let (from, mut first) = (walked.len(), 0);
        for (frame, _) in world.labelled_frames(&room.reference, 0)? {
            let Some(view) = view(&frame, &apart)? else { continue };
            // By turns, so that neither finds the caches warmer than the other.
            let time = |map: &mut Map, times: &mut Vec<f64>| {
                let start = clock::thread_cpu_seconds();
                map.integrate(&view);
                times.push(clock::thread_cpu_seconds() - start);
            };
            if first % 2 == 0 {
                time(&mut all, &mut walked);
                time(&mut own, &mut fresh);
            } else {
                time(&mut own, &mut fresh);
                time(&mut all, &mut walked);
            }
            first += 1;
        }
        ratios.push(median(&mut walked[from..].to_vec()) / median(&mut fresh[from..].to_vec()).max(1e-9));
        surfels += own.surfels().count();
        area += area_of(&own);
    }
    let last = ratios.last().copied().unwrap_or_default();
    let (a, b) = (median(&mut walked), median(&mut fresh));
    let (held, bytes) = (all.surfels().count(), all.bytes());
    say(format!(
        "walk: {} frames; median {:.2} ms with one map, {:.2} ms with fresh ones, ratio {:.3}; in the last room {last:.3}",
        walked.len(),
        a * 1e3,
        b * 1e3,
        a / b.max(1e-9)
    ));
    say(format!(
        "surfels: {held} in one map, {surfels} in fresh ones, ratio {:.3}; {:.1} bytes each",
        held as f64 / surfels.max(1) as f64,
        bytes as f64 / held.max(1) as f64
    ));
    say(format!(
        "per m2 of surface (squares of 5 cm that hold surfels, {area:.0} m2): {:.0} surfels, {:.0} bytes",
        surfels as f64 / area,
        bytes as f64 / area
    ));
    Ok(())
}

/// Area of the surfels' surfaces: cells of 5 cm across the main axis of the normal, m2.
fn area_of(map: &Map) -> f64 {
    let mut cells: Vec<(usize, [i32; 3])> = map
        .surfels()
        .filter(|s| s.stable)
        .map(|s| {
            // A surface that faces along an axis is a height over the other two; heights are told apart by 20 cm.
            let axis = s.normal.iamax();
            let side = |k: usize| if k == axis { 0.2 } else { 0.05 };
            (axis, [0, 1, 2].map(|k| (s.position[k] / side(k)).floor() as i32))
        })
        .collect();
    cells.sort_unstable();
    cells.dedup();
    cells.len() as f64 * 0.0025
}
