//! `ma3dsg check DIR`: what is wrong with a recording.

use super::say;
use crate::pipeline;
use agent::integrate;
use anyhow::{Result, bail};
use gsm::Map;
use nalgebra::{Isometry3, Vector3};
use scan3r::{Format, Frame, Recording};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder of the recording.
    dir: PathBuf,
    /// 3rscan, 7scenes, tum, or auto.
    #[arg(long, default_value = "auto", value_parser = ["auto", "3rscan", "7scenes", "tum"])]
    format: String,
    /// Frames that are looked at, evenly spread.
    #[arg(long, default_value_t = 120)]
    frames: usize,
}

/// What was read.
#[derive(Default)]
struct Seen {
    kept: Vec<Frame>,
    total: usize,
    without_pose: usize,
    empty: usize,
    invalid: f64,
    broken: Vec<String>,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let recording = Recording::open(&self.dir, Format::parse(&self.format))?;
        let (format, gravity, notes) =
            (recording.format(), recording.has_gravity(), recording.notes().to_vec());
        let seen = self.read(recording);
        let mut wrong: Vec<String> = seen.broken.iter().take(5).cloned().collect();
        if seen.broken.len() > 5 {
            wrong.push(format!("and {} more unreadable frames", seen.broken.len() - 5));
        }
        say(format!(
            "format {}, {} frames, {} without a valid pose, {} without depth, {:.1} % of pixels invalid",
            format.name(),
            seen.total,
            seen.without_pose,
            seen.empty,
            100.0 * seen.invalid / seen.total.max(1) as f64
        ));
        notes.iter().for_each(|n| say(format!("note: {n}")));
        if seen.total == 0 {
            bail!("{}: no readable frame: {}", self.dir.display(), wrong.join("; "));
        }
        if seen.without_pose * 4 > seen.total {
            wrong.push(format!("poses: {} of {} frames have none", seen.without_pose, seen.total));
        }
        if seen.empty * 4 > seen.total {
            wrong.push(format!("depth: {} of {} frames are empty", seen.empty, seen.total));
        }
        wrong.extend(units(&seen.kept));
        wrong.extend(poses(&seen.kept));
        wrong.extend(up(&seen.kept, gravity)?);
        if wrong.is_empty() {
            say("nothing wrong found");
            return Ok(ExitCode::SUCCESS);
        }
        wrong.iter().for_each(|w| say(format!("wrong: {w}")));
        Ok(ExitCode::FAILURE)
    }

    fn read(&self, recording: Recording) -> Seen {
        let every = recording.len().div_ceil(self.frames.max(1)).max(1);
        let mut s = Seen::default();
        for (k, frame) in recording.into_frames().enumerate() {
            let f = match frame {
                Ok(f) => f,
                Err(e) => {
                    s.broken.push(format!("frame {k}: {e}"));
                    continue;
                }
            };
            let valid = f.depth.iter().filter(|z| **z > 0.0).count();
            s.total += 1;
            s.without_pose += usize::from(f.world_from_camera.is_none());
            s.empty += usize::from(valid < 10);
            s.invalid += 1.0 - valid as f64 / f.depth.len().max(1) as f64;
            if k % every == 0 && f.world_from_camera.is_some() && valid >= 10 {
                s.kept.push(f);
            }
        }
        s
    }
}

/// Rooms are seen from 0.3 to 8 m.
fn units(frames: &[Frame]) -> Option<String> {
    let mut medians: Vec<f32> = frames
        .iter()
        .map(|f| {
            let mut v: Vec<f32> = f.depth.iter().copied().filter(|z| *z > 0.0).collect();
            let k = v.len() / 2;
            *v.select_nth_unstable_by(k, f32::total_cmp).1
        })
        .collect();
    medians.sort_by(f32::total_cmp);
    let m = *medians.get(medians.len() / 2)?;
    (!(0.3..=8.0).contains(&m)).then(|| {
        format!("units: the median depth is {m} m, rooms are seen from 0.3 to 8 m; is the depth scale of the format right?")
    })
}

/// How well two frames agree: the share of points of `a` that `b` sees at their depth within 5 %.
fn agreement(a: &Frame, b: &Frame, b_from_a: &Isometry3<f32>) -> Option<f32> {
    let (k, mut seen, mut hit) = (a.intrinsics, 0, 0);
    for v in (0..k.height).step_by(7) {
        for u in (0..k.width).step_by(7) {
            let z = a.depth[(v * k.width + u) as usize];
            if z <= 0.0 {
                continue;
            }
            let p = b_from_a * k.unproject(u as f32, v as f32, z);
            let i = b.intrinsics;
            let (x, y) = (p.x / p.z * i.fx + i.cx, p.y / p.z * i.fy + i.cy);
            if p.z <= 0.1 || x < 0.0 || y < 0.0 || x >= i.width as f32 || y >= i.height as f32 {
                continue;
            }
            let there = b.depth[y as usize * i.width as usize + x as usize];
            if there > 0.0 {
                seen += 1;
                hit += usize::from((there - p.z).abs() < 0.05 * p.z);
            }
        }
    }
    (seen >= 50).then(|| hit as f32 / seen as f32)
}

/// Tries other readings of the poses: inverted, and with translations or depths of another unit.
fn poses(frames: &[Frame]) -> Option<String> {
    let scaled =
        |p: &Isometry3<f32>, s: f32| Isometry3::from_parts((p.translation.vector * s).into(), p.rotation);
    type Reading = (&'static str, f32, bool);
    const READINGS: [Reading; 8] = [
        ("as given", 1.0, false),
        ("inverted: the files hold camera_from_world", 1.0, true),
        ("with translations in millimetres", 1e-3, false),
        ("with translations 1000 times as long", 1e3, false),
        ("with depth 5 times as large (a scale of 1000 against 5000 per metre)", 0.2, false),
        ("with depth a fifth as large (a scale of 5000 against 1000 per metre)", 5.0, false),
        ("inverted, with translations in millimetres", 1e-3, true),
        ("inverted, with depth 5 times as large", 0.2, true),
    ];
    let score = |&(_, scale, inverted): &Reading| {
        let pose = |f: &Frame| {
            let p = f.world_from_camera.map(|p| scaled(&p, scale))?;
            Some(if inverted { p.inverse() } else { p })
        };
        let moved = |a: &Frame, b: &Frame| -> Option<f32> {
            let b_from_a = pose(b)?.inverse() * pose(a)?;
            agreement(a, b, &b_from_a)
        };
        let all: Vec<f32> = frames.windows(2).filter_map(|w| moved(&w[0], &w[1])).collect();
        (all.len() >= 3).then(|| all.iter().sum::<f32>() / all.len() as f32)
    };
    let given = score(&READINGS[0]).unwrap_or(0.0);
    let best = READINGS[1..].iter().filter_map(|r| Some((score(r)?, r.0))).max_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((s, name)) if s > given + 0.1 => Some(format!(
            "poses: neighbouring frames agree in {:.0} % of their points as given, in {:.0} % {name}",
            100.0 * given,
            100.0 * s
        )),
        _ if frames.len() > 3 && given < 0.3 => Some(format!(
            "poses: neighbouring frames agree in {:.0} % of their points, and no other reading of the poses helps",
            100.0 * given
        )),
        _ => None,
    }
}

/// Whether z is up where the format promises it. Planes of a room are parallel or perpendicular to
/// gravity; which of these axes is up, planes alone do not say safely, but a camera in a hand moves
/// least along it.
fn up(frames: &[Frame], has_gravity: bool) -> Result<Option<String>> {
    let mut map = Map::new(pipeline::segmentation(gsm::Profile::TofPhone))?;
    for f in frames {
        integrate(&mut map, f);
    }
    let Some(up) = gsm::estimate_up(&map) else {
        say("gravity: too few planes to estimate up");
        return Ok(None);
    };
    let planes: Vec<(f32, Vector3<f32>)> =
        map.segments().filter(|s| s.surfels() >= 100).map(|s| (s.area(), s.plane().normal)).collect();
    let total: f32 = planes.iter().map(|p| p.0).sum();
    let aligned = |axis: &Vector3<f32>| {
        let fits = |n: &Vector3<f32>| n.dot(axis).abs() > 0.97 || n.dot(axis).abs() < 0.15;
        planes.iter().filter(|p| fits(&p.1)).map(|p| p.0).sum::<f32>() / total.max(1e-6)
    };
    let spread = |axis: &Vector3<f32>| {
        let v: Vec<f32> =
            frames.iter().filter_map(|f| Some(f.world_from_camera?.translation.vector.dot(axis))).collect();
        let mean = v.iter().sum::<f32>() / v.len().max(1) as f32;
        (v.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / v.len().max(1) as f32).sqrt()
    };
    let (z, angle) = (Vector3::z(), up.angle(&Vector3::z()).to_degrees());
    say(format!(
        "gravity: estimated up [{:.2}, {:.2}, {:.2}], {angle:.0} degrees from z; {:.0} % of the plane area fits z as up",
        up.x,
        up.y,
        up.z,
        100.0 * aligned(&z)
    ));
    let tilted = angle > 20.0 && aligned(&z) < aligned(&up) - 0.15;
    let lying = angle > 60.0 && spread(&z) > 2.0 * spread(&up) && spread(&z) > 0.2;
    Ok((has_gravity && (tilted || lying)).then(|| {
        format!("gravity: this format's z axis is up, but planes and path say {angle:.0} degrees off it")
    }))
}
