//! `ma3dsg scan DIR -o OUT`: a recording to segments and a scene graph.

use super::say;
use crate::pipeline::{self, Quality};
use crate::progress::Progress;
use crate::weights::Weights;
use crate::{clock, files};
use agent::{Robot, RobotParams};
use anyhow::{Context, Result};
use graph_align::Vocabulary;
use graph_align::json::{GraphFile, row_major};
use gsm::{Budget, DepthView, Measured, NoiseMeter, NoiseModel, Profile, SegmentId};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use scan3r::{Format, Frame, Recording};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Frames on which the sensor's noise is measured.
const MEASURED: usize = 10;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder of the recording.
    dir: PathBuf,
    /// 3rscan, 7scenes, tum, or auto.
    #[arg(long, default_value = "auto", value_parser = ["auto", "3rscan", "7scenes", "tum"])]
    format: String,
    /// Depth sensor: structured light, time of flight, rendered; auto follows the format, measured the first frames.
    #[arg(long, default_value = "auto", value_parser = ["auto", "measured", "tof", "structured", "ideal"])]
    noise: String,
    /// Milliseconds per frame for the segmentation: the working resolution follows from it.
    #[arg(long, value_name = "MS", conflicts_with = "scale")]
    budget_ms: Option<f64>,
    /// Working resolution as a share of the image's sides (1, 0.5, 0.25), or auto: about 160x120.
    #[arg(long, default_value = "auto")]
    scale: String,
    /// The poses are odometry's, which drifts: each frame is laid on the map before the map learns it.
    #[arg(long)]
    track: bool,
    /// Threads for segmentation and network; frames are decoded on another one.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Weights other than the shipped ones.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Folder for graph.json, segments.ply and frames.csv.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?.install(|| self.scan())
    }

    /// CPU seconds of the work on frames: with one thread its own, without that of decoding.
    fn seconds(&self) -> f64 {
        if self.threads == 1 { clock::thread_cpu_seconds() } else { clock::cpu_seconds() }
    }

    fn scan(&self) -> Result<ExitCode> {
        let weights = Weights::load(self.weights.as_deref())?;
        let recording = Recording::open(&self.dir, Format::parse(&self.format))?;
        recording.notes().iter().for_each(|n| eprintln!("note: {n}"));
        let (format, total, has_gravity) = (recording.format(), recording.len(), recording.has_gravity());
        let mut frames = recording.into_frames();
        let head: Vec<_> = frames.by_ref().take(MEASURED).collect();
        let measured = measure(&head);
        let (model, noise) = self.noise(format, measured.as_ref());
        let mut csv = "frame,ms_segment,ms_infer,surfels,active_surfels,segments\n".to_owned();
        let (mut robot, mut skipped, mut failure): (Option<Robot<'_>>, usize, Option<scan3r::Error>) =
            (None, 0, None);
        let mut last_row = 0;
        let progress = Progress::new("frames", total as u64);
        let mut budget = None;
        for frame in head.into_iter().chain(frames) {
            let frame = match frame {
                Ok(f) => f,
                Err(e) => {
                    failure = Some(e);
                    break;
                }
            };
            let robot = match &mut robot {
                Some(r) => r,
                none => none.insert(self.robot(&weights, model, has_gravity, frame.depth.len())?),
            };
            let start = self.seconds();
            let report = robot.segment(&frame);
            let segmented = self.seconds();
            if has_gravity && robot.inference_is_due() {
                robot.infer()?;
            }
            let inferred = self.seconds();
            if let Some(ms) = self.budget_ms {
                let new = || Budget::new(ms * 1e-3, frame.depth.len() as u32, robot.max_pixels());
                let pixels = budget.get_or_insert_with(new).spent(segmented - start);
                robot.set_max_pixels(pixels);
            }
            skipped += usize::from(report.skipped.is_some());
            last_row = csv.len();
            let c = report.counts;
            // Writing to a String cannot fail.
            let _ = writeln!(
                csv,
                "{},{:.3},{:.3},{},{},{}",
                frame.index,
                (segmented - start) * 1e3,
                (inferred - segmented) * 1e3,
                c.surfels,
                c.visited,
                c.segments
            );
            progress.step();
        }
        drop(progress);
        let Some(robot) = robot else {
            return Err(
                failure.map_or_else(|| anyhow::anyhow!("{}: no frame", self.dir.display()), Into::into)
            );
        };
        self.finish(robot, &weights, csv, last_row, has_gravity, &noise, (total, skipped))?;
        match failure {
            // What came before is written; the run still failed.
            Some(e) => Err(e).context("stopped early; what was read before is written"),
            None => Ok(ExitCode::SUCCESS),
        }
    }

    /// The noise model to be used, and where it comes from beside what was measured.
    fn noise(&self, format: Format, measured: Option<&Measured>) -> (NoiseModel, String) {
        let given = match (self.noise.as_str(), format) {
            ("tof", _) | ("auto" | "measured", Format::ThreeRScan) => Profile::TofPhone,
            ("ideal", _) => Profile::Ideal,
            _ => Profile::Structured,
        };
        let name = |p: Profile| match p {
            Profile::TofPhone => "tof",
            Profile::Ideal => "ideal",
            Profile::Structured => "structured",
        };
        let Some(m) = measured else { return (NoiseModel::of(given), name(given).to_owned()) };
        let model = if self.noise == "measured" { m.model } else { NoiseModel::of(given) };
        // Errors that neighbours share, as those of depth in steps are, do not show in their differences.
        let ratio = match m.model.profile {
            Profile::TofPhone => format!(" x {:.2}", m.ratio),
            Profile::Structured | Profile::Ideal => String::new(),
        };
        let seen = format!(
            "measured on {} frames: {}{ratio}, depth steps of {:.1} mm",
            m.frames,
            name(m.model.profile),
            m.step * 1e3
        );
        (model, format!("{} x {:.2} ({seen})", name(model.profile), model.scale))
    }

    fn robot<'m>(
        &self,
        weights: &'m Weights,
        noise: NoiseModel,
        has_gravity: bool,
        pixels: usize,
    ) -> Result<Robot<'m>> {
        let mut segmentation = gsm::Params { noise, ..gsm::Params::default() };
        if self.scale != "auto" {
            let s: f32 = self.scale.parse().ok().filter(|s| (0.01..=1.0).contains(s)).with_context(|| {
                format!("--scale {:?}, want auto or a share of the image's sides up to 1", self.scale)
            })?;
            segmentation.max_pixels = (pixels as f32 * s * s).ceil() as u32;
        }
        if self.track {
            let known = gsm::Tracking::Upright([0.0, 0.0, 1.0]);
            segmentation.tracking = if has_gravity { known } else { gsm::Tracking::Free };
        }
        let quality = if has_gravity { Quality::Bench } else { Quality::UpAtEnd };
        Ok(Robot::new(&weights.model, RobotParams { segmentation, ..pipeline::robot(quality) })?)
    }

    #[expect(clippy::too_many_arguments, reason = "the parts of one result")]
    fn finish(
        &self,
        mut robot: Robot<'_>,
        weights: &Weights,
        mut csv: String,
        last_row: usize,
        has_gravity: bool,
        noise: &str,
        (total, skipped): (usize, usize),
    ) -> Result<()> {
        let up = if has_gravity { Some(Vector3::z()) } else { robot.estimate_up() };
        let turn = match up {
            Some(up) if !has_gravity => upright(&up),
            _ => UnitQuaternion::identity(),
        };
        if !has_gravity {
            robot.set_up(turn);
        }
        let start = self.seconds();
        robot.infer()?;
        let mut vocabulary = Vocabulary::default();
        let (graph, instances) = robot.graph(&mut vocabulary)?;
        let ms = (self.seconds() - start) * 1e3;
        add_to_last_row(&mut csv, last_row, ms);
        let all = robot.graph_with_landmarks(&mut vocabulary)?;
        let unnamed = vocabulary.find_label(agent::NONE);
        let landmarks = GraphFile::with_landmarks(&all, &vocabulary, unnamed, pipeline::MIN_CLASS).landmarks;
        let mut file = GraphFile::of_graph(&graph, &vocabulary);
        // Numbered after the nodes.
        let first = graph.nodes().last().map_or(0, |n| n.id.0 + 1);
        file.landmarks = landmarks;
        file.landmarks.iter_mut().zip(first..).for_each(|(l, id)| l.id = id);
        file.gravity_aligned = Some(up.is_some());
        file.up = up.map(|_| [0.0, 0.0, 1.0]);
        file.world_from_recording =
            Some(row_major(&Isometry3::from_parts(nalgebra::Translation3::identity(), turn)));
        let source = match (has_gravity, up) {
            (true, _) => "the recording's z axis",
            (false, Some(_)) => "estimated from planes: the recording has no gravity axis",
            (false, None) => "unknown: the recording has no gravity axis and too few planes to estimate it",
        };
        file.provenance = json!({
            "command": std::env::args().collect::<Vec<_>>().join(" "),
            "version": env!("CARGO_PKG_VERSION"),
            "data": {"kind": "recording", "folder": self.dir, "frames": total, "skipped": skipped},
            "weights": weights.provenance(),
            "up": source,
            "noise": noise,
        });
        files::write(&self.out.join("graph.json"), &serde_json::to_vec_pretty(&file)?)?;
        files::write(&self.out.join("segments.ply"), &ply(&robot, &instances))?;
        files::write(&self.out.join("frames.csv"), csv.as_bytes())?;
        let stable = robot.map().surfels().filter(|s| s.stable).count();
        let labelled = robot.map().surfels().filter(|s| s.stable && s.segment.is_some()).count();
        say(format!(
            "{total} frames ({skipped} skipped), noise profile {noise}, up: {source}\n\
             {stable} stable surfels, {labelled} labelled, {} segments; graph of {} objects and {} relations\n\
             weights: {} ({}), trained on {}\nwritten to {}",
            robot.map().segments().count(),
            graph.len(),
            graph.edges().len(),
            weights.file,
            &weights.sha256[..12],
            weights.trained_on,
            self.out.display()
        ));
        if graph.is_empty() {
            let nodes = robot.nodes()?.nodes.len();
            eprintln!(
                "warning: the graph is empty: {nodes} segments were large enough for a node, none got a class of the set"
            );
        }
        Ok(())
    }
}

/// What the first frames say of the sensor.
fn measure(frames: &[std::result::Result<Frame, scan3r::Error>]) -> Option<Measured> {
    let mut meter = NoiseMeter::default();
    for frame in frames.iter().flatten() {
        let k = frame.intrinsics;
        if let Ok(intrinsics) = gsm::Intrinsics::new(k.fx, k.fy, k.cx, k.cy, k.width, k.height) {
            let world_from_camera = Isometry3::identity();
            meter.add(&DepthView { depth: &frame.depth, intrinsics, world_from_camera, time: frame.time });
        }
    }
    meter.measured()
}

/// The rotation that turns `up` to +z.
fn upright(up: &Vector3<f32>) -> UnitQuaternion<f32> {
    UnitQuaternion::rotation_between(up, &Vector3::z())
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f32::consts::PI))
}

/// The final inference belongs to the last frame.
fn add_to_last_row(csv: &mut String, at: usize, ms: f64) {
    let row: Vec<String> = csv[at..].trim_end().split(',').map(str::to_owned).collect();
    if let Some(before) = row.get(2).and_then(|v| v.parse::<f64>().ok()) {
        let mut row = row;
        row[2] = format!("{:.3}", before + ms);
        csv.truncate(at);
        csv.push_str(&row.join(","));
        csv.push('\n');
    }
}

/// Surfels in the recording's own frame, binary little-endian.
fn ply(robot: &Robot<'_>, instances: &BTreeMap<SegmentId, u64>) -> Vec<u8> {
    let surfels: Vec<_> = robot.map().surfels().filter(|s| s.stable).collect();
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", surfels.len());
    for p in ["x", "y", "z", "nx", "ny", "nz"] {
        let _ = writeln!(out, "property float {p}");
    }
    out += "property int label\nproperty int instance\nend_header\n";
    let mut out = out.into_bytes();
    for s in surfels {
        let numbers = s.position.coords.iter().chain(s.normal.iter());
        out.extend(numbers.flat_map(|v| v.to_le_bytes()));
        let label = s.segment.map_or(0, |id| id.0 as i32);
        let instance = s.segment.and_then(|id| instances.get(&id)).map_or(0, |i| *i as i32 + 1);
        out.extend(label.to_le_bytes());
        out.extend(instance.to_le_bytes());
    }
    out
}
