//! `ma3dsg eval-seg`: the segmentation on generated rooms with truth, noise-free and with the sensor's noise.

use super::say;
use crate::progress::Progress;
use crate::{files, pipeline};
use agent::NodeParams;
use anyhow::{Context, Result};
use bench_3rscan::parts::{Overlaps, PartScores, boundary_recall};
use bench_3rscan::{Surface, flush};
use gsm::{DepthView, Intrinsics, Map, Profile};
use rayon::prelude::*;
use room_synth::{SensorParams, Split, World, WorldParams};
use scan3r::{Dataset, LabelSet};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::ExitCode;

/// Depth samples over the visit from which an instance counts in the node curve.
const SAMPLES: [u64; 6] = [500, 1000, 1500, 3000, 6000, 12_000];
/// Boundaries are compared within so many pixels.
const REACH: usize = 2;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Which rooms.
    #[arg(long, default_value = "test", value_parser = ["train", "validation", "test"])]
    split: String,
    /// Number of rooms; of each its first visit.
    #[arg(long, default_value_t = 6)]
    rooms: usize,
    /// Seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Also with each kind of the sensor's faults alone.
    #[arg(long)]
    faults: bool,
    /// List the segments that add most to the under-segmentation error.
    #[arg(long)]
    mixed: bool,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Figures of one room.
#[derive(Serialize)]
struct Room {
    scan: String,
    frames: usize,
    surfels: usize,
    segments: usize,
    nodes: usize,
    scores: PartScores,
    /// The same with pieces of one class in one plane, such as those of a cut wall, taken for one part.
    surfaces: PartScores,
    /// Boundary pixels found within two pixels, and all.
    boundary: [u64; 2],
    /// Per class: stable surfels, surfels weighted by best overlap, instances of 1500 samples, nodes among them.
    classes: BTreeMap<&'static str, [f64; 4]>,
    /// Segments that hold most of more than one part: their share of the under-segmentation error, and what is in them.
    mixed: Vec<(f64, String)>,
    /// Instances with at least so many samples, and those that a node stands for.
    curve: Vec<[u64; 3]>,
    /// The same with pieces of one class in one plane taken for one instance.
    surface_curve: Vec<[u64; 3]>,
}

#[derive(Serialize)]
struct Condition {
    name: &'static str,
    /// Name of the noise profile.
    profile: &'static str,
    mean: PartScores,
    surfaces: PartScores,
    boundary_recall: Option<f64>,
    rooms: Vec<Room>,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let split = Split::parse(&self.split).context("--split")?;
        let mut conditions = vec![
            ("clean", SensorParams::clean(), Profile::Ideal, "ideal"),
            ("noisy", SensorParams::default(), Profile::TofPhone, "tof"),
        ];
        if self.faults {
            conditions.extend(faults().map(|(name, sensor)| (name, sensor, Profile::TofPhone, "tof")));
        }
        let progress = Progress::new("rooms", (conditions.len() * self.rooms) as u64);
        let mut all = Vec::new();
        for (name, sensor, profile, profile_name) in conditions {
            let params = WorldParams { rescans: false, sensor, ..WorldParams::default() };
            let world = World::new(split, self.seed, self.rooms, &params);
            let segmentation = pipeline::segmentation(profile);
            let rooms: Vec<Room> = world
                .rooms()
                .par_iter()
                .map(|room| {
                    let figures = measure(&world, &room.reference, &segmentation);
                    progress.step();
                    figures
                })
                .collect::<Result<_>>()?;
            let boundary = sum(rooms.iter().map(|r| r.boundary));
            all.push(Condition {
                name,
                profile: profile_name,
                mean: mean(rooms.iter().map(|r| &r.scores)),
                surfaces: mean(rooms.iter().map(|r| &r.surfaces)),
                boundary_recall: (boundary[1] > 0).then(|| boundary[0] as f64 / boundary[1] as f64),
                rooms,
            });
        }
        drop(progress);
        say(format!("{} generated {} rooms, seed {}, first visits", self.rooms, split.name(), self.seed));
        all.iter().for_each(|c| print(c, self.mixed));
        if let Some(file) = &self.json {
            files::write(file, &serde_json::to_vec_pretty(&all)?)?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// The phone's faults one by one, the rest as it should be.
fn faults() -> [(&'static str, SensorParams); 4] {
    let (all, none) = (SensorParams::default(), SensorParams::clean());
    let base = SensorParams { range: all.range, ..none };
    [
        ("range alone", base.clone()),
        ("depth noise alone", SensorParams { sigma: all.sigma, quantise: true, ..base.clone() }),
        (
            "losses and flying pixels alone",
            SensorParams { flying: all.flying, edge_loss: all.edge_loss, loss: all.loss, ..base.clone() },
        ),
        (
            "pose errors alone",
            SensorParams { jitter: all.jitter, drift: all.drift, pose_loss: all.pose_loss, ..base },
        ),
    ]
}

fn sum<const N: usize>(items: impl Iterator<Item = [u64; N]>) -> [u64; N] {
    items.fold([0; N], |a, b| std::array::from_fn(|k| a[k] + b[k]))
}

fn mean<'a>(scores: impl ExactSizeIterator<Item = &'a PartScores> + Clone) -> PartScores {
    let of = |f: fn(&PartScores) -> f64| scores.clone().map(f).sum::<f64>() / scores.len().max(1) as f64;
    PartScores {
        covering: of(|s| s.covering),
        ari: of(|s| s.ari),
        under_segmentation: of(|s| s.under_segmentation),
        purity: of(|s| s.purity),
        completeness: of(|s| s.completeness),
    }
}

fn print(c: &Condition, mixed: bool) {
    let m = &c.mean;
    say(format!(
        "{} (profile {}): covering {:.3}  ARI {:.3}  under-segmentation {:.3}  boundary recall {}  purity {:.3}  completeness {:.3}",
        c.name,
        c.profile,
        m.covering,
        m.ari,
        m.under_segmentation,
        c.boundary_recall.map_or("-".to_owned(), |r| format!("{r:.3}")),
        m.purity,
        m.completeness
    ));
    let m = &c.surfaces;
    say(format!(
        "  pieces of one class in one plane taken for one part: covering {:.3}  ARI {:.3}  under-segmentation {:.3}  purity {:.3}  completeness {:.3}",
        m.covering, m.ari, m.under_segmentation, m.purity, m.completeness
    ));
    for r in &c.rooms {
        say(format!(
            "  {}: {} frames, {} surfels, {} segments, {} nodes; covering {:.3} ARI {:.3} under-segmentation {:.3}",
            r.scan,
            r.frames,
            r.surfels,
            r.segments,
            r.nodes,
            r.scores.covering,
            r.scores.ari,
            r.scores.under_segmentation
        ));
        for (error, text) in r.mixed.iter().filter(|_| mixed) {
            say(format!("    {error:.3} {text}"));
        }
    }
    for (k, low) in SAMPLES.iter().enumerate() {
        let share = |[_, of, got]: [u64; 3]| {
            format!("{got} of {of} became a node ({:.1} %)", 100.0 * got as f64 / of.max(1) as f64)
        };
        say(format!(
            "  instances with at least {low} depth samples: {}; pieces of one plane taken for one: {}",
            share(sum(c.rooms.iter().map(|r| r.curve[k]))),
            share(sum(c.rooms.iter().map(|r| r.surface_curve[k])))
        ));
    }
    let mut classes: BTreeMap<&str, [f64; 4]> = BTreeMap::new();
    for (name, v) in c.rooms.iter().flat_map(|r| &r.classes) {
        let t = classes.entry(name).or_default();
        t.iter_mut().zip(v).for_each(|(t, v)| *t += v);
    }
    for (name, [n, weighted, of, got]) in classes {
        say(format!("  {name}: covering {:.3}, nodes {got:.0} of {of:.0}", weighted / n.max(1.0)));
    }
}

/// The segments that add most to the under-segmentation error: their share, and the label, number and part of the room
/// of what is in them.
fn mixed(overlaps: &Overlaps, labels: &BTreeMap<u32, String>) -> Vec<(f64, String)> {
    let by_segment = overlaps.by_segment();
    let all = by_segment.values().flat_map(|of| of.values()).sum::<u64>().max(1) as f64;
    let mut list: Vec<(f64, String)> = by_segment
        .values()
        .map(|of| {
            let size: u64 = of.values().sum();
            let error: u64 = of.values().map(|&n| n.min(size - n)).sum();
            let mut parts: Vec<_> = of.iter().filter(|(_, n)| **n * 20 > size).collect();
            parts.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
            let name = |id: &u32| labels.get(id).map_or("unlabelled", String::as_str);
            let text = parts.iter().map(|(id, n)| format!("{} {id}: {:.3}", name(id), **n as f64 / all));
            (error as f64 / all, text.collect::<Vec<_>>().join(", "))
        })
        .collect();
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    list.truncate(8);
    list
}

/// The parts that most of a node lies in.
fn stood_for(overlaps: &Overlaps, nodes: &BTreeSet<u32>) -> BTreeSet<u32> {
    overlaps.majority().into_iter().filter(|(s, _)| nodes.contains(s)).map(|(_, g)| g).collect()
}

/// For each of [`SAMPLES`] the parts of so many depth samples, and those among them that a node stands for.
fn curve(samples: &BTreeMap<u32, u64>, stood_for: &BTreeSet<u32>) -> Vec<[u64; 3]> {
    let at = |&low: &u64| {
        let of = samples.iter().filter(|&(_, &n)| n >= low);
        [low, of.clone().count() as u64, of.filter(|(id, _)| stood_for.contains(id)).count() as u64]
    };
    SAMPLES.iter().map(at).collect()
}

/// Segments one visit and compares.
fn measure(world: &World, scan: &str, segmentation: &gsm::Params) -> Result<Room> {
    let mut map = Map::new(segmentation.clone())?;
    let mut samples: BTreeMap<u32, u64> = BTreeMap::new();
    let mut boundary = [0; 2];
    let mut frames = 0;
    for (frame, ids) in world.labelled_frames(scan, 0)? {
        let Some(world_from_camera) = frame.world_from_camera else { continue };
        let i = frame.intrinsics;
        let intrinsics = Intrinsics::new(i.fx, i.fy, i.cx, i.cy, i.width, i.height)?;
        for (&d, &id) in frame.depth.iter().zip(&ids) {
            if d > 0.0 && id != 0 {
                *samples.entry(id).or_default() += 1;
            }
        }
        map.integrate(&DepthView { depth: &frame.depth, intrinsics, world_from_camera, time: frame.time });
        frames += 1;
        let (width, found) = map.frame_segments();
        if width == i.width as usize {
            let in_range = |d: f32| d >= segmentation.min_depth && d <= segmentation.max_depth;
            let truth: Vec<_> = frame
                .depth
                .iter()
                .zip(&ids)
                .map(|(&d, &id)| (in_range(d) && id != 0).then_some(id))
                .collect();
            let found: Vec<_> = found.iter().map(|s| s.map(|s| s.0)).collect();
            let (hit, all) = boundary_recall(width, &truth, &found, REACH);
            boundary = [boundary[0] + hit, boundary[1] + all];
        }
    }
    let surface = Surface::new(world.annotation(scan)?);
    let (mut overlaps, mut flushed) = (Overlaps::default(), Overlaps::default());
    let whole = flush::surfaces(surface.annotation());
    let stable: Vec<_> = map.surfels().filter(|s| s.stable).collect();
    for s in &stable {
        if let Some(truth) = surface.instance_at(&s.position).filter(|&t| t != 0) {
            overlaps.add(truth, s.segment.map(|s| s.0));
            flushed.add(whole.get(&truth).copied().unwrap_or(truth), s.segment.map(|s| s.0));
        }
    }
    let p = NodeParams::default();
    let nodes: BTreeSet<u32> = map
        .segments()
        .filter(|s| s.surfels() >= p.min_surfels && s.area() >= p.min_area)
        .map(|s| s.id().0)
        .collect();
    let stood_for = stood_for(&overlaps, &nodes);
    let mut surface_samples: BTreeMap<u32, u64> = BTreeMap::new();
    for (id, n) in &samples {
        *surface_samples.entry(whole.get(id).copied().unwrap_or(*id)).or_default() += n;
    }
    let mut classes: BTreeMap<&'static str, [f64; 4]> = BTreeMap::new();
    let (sizes, iou) = (overlaps.parts(), overlaps.best_iou());
    for (id, label) in &surface.annotation().labels {
        let Some(class) = LabelSet::L20.class_of(label) else { continue };
        let t = classes.entry(class).or_default();
        if let (Some(&n), Some(iou)) = (sizes.get(id), iou.get(id)) {
            t[0] += n as f64;
            t[1] += n as f64 * iou;
        }
        if samples.get(id).is_some_and(|&n| n >= 1500) {
            t[2] += 1.0;
            t[3] += f64::from(u8::from(stood_for.contains(id)));
        }
    }
    Ok(Room {
        scan: scan.to_owned(),
        frames,
        surfels: stable.len(),
        segments: map.segments().count(),
        nodes: nodes.len(),
        scores: overlaps.scores().unwrap_or_default(),
        surfaces: flushed.scores().unwrap_or_default(),
        boundary,
        mixed: mixed(&flushed, &surface.annotation().labels),
        classes,
        curve: curve(&samples, &stood_for),
        surface_curve: curve(&surface_samples, &self::stood_for(&flushed, &nodes)),
    })
}
