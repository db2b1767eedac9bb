//! `Map::integrate`: an input is read as a camera, parameters and a run of twelve frames.

use crate::{Random, Reader, Shown, log};
use gsm::{DepthView, Error, FrameReport, Intrinsics, Map, NoiseModel, Params, Profile, Tracking};
use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};
use std::collections::BTreeSet;

impl Reader<'_> {
    /// Mostly plain numbers within ±`scale`, sometimes the ones that hurt.
    fn real(&mut self, scale: f32) -> f32 {
        match self.byte() {
            255 => [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, f32::MIN_POSITIVE, -0.0]
                [usize::from(self.byte()) % 6],
            _ => (f32::from(self.byte()) - 128.0) / 128.0 * scale,
        }
    }
}

/// Runs an input; its behaviours, or what is wrong.
pub(crate) fn run(input: &[u8]) -> Result<Shown, String> {
    let mut r = Reader(input);
    let mut seen = BTreeSet::new();
    let only = |behaviour: u64| Ok(Shown { behaviours: BTreeSet::from([behaviour]), found: None });
    let sizes = [1, 2, 3, 17, 40, 64, 97, 160];
    let (w, h) = (sizes[usize::from(r.byte()) % 8], sizes[usize::from(r.byte()) % 8]);
    let focal = r.real(1.0).abs() * 2.0 * w as f32;
    let camera = Intrinsics::new(focal, focal, 0.5 * w as f32 + r.real(9.0), 0.5 * h as f32, w, h);
    let profile = [Profile::Structured, Profile::TofPhone, Profile::Ideal][usize::from(r.byte()) % 3];
    let params = Params {
        noise: NoiseModel { profile, scale: 1.0 + r.real(0.99) },
        max_pixels: [40_000, 500, 3][usize::from(r.byte()) % 3],
        max_surfels: [100_000, 300][usize::from(r.byte()) % 2],
        tracking: [Tracking::Off, Tracking::Free, Tracking::Upright([r.real(1.0), r.real(1.0), 1.0])]
            [usize::from(r.byte()) % 3],
        ..Params::default()
    };
    let limit = params.max_surfels;
    let (intrinsics, mut map) = match (camera, Map::new(params)) {
        (Ok(c), Ok(m)) => (c, m),
        (Err(Error::Intrinsics { field, .. }), _) => return only(field.len() as u64),
        _ => return only(1),
    };
    for index in 0..12 {
        let depth = image(&mut r, w as usize, h as usize);
        let q = Quaternion::new(1.0 + r.real(0.02), r.real(0.3), r.real(0.3), r.real(0.1));
        // Normalised as a tracker would, or left as it is.
        let q = if r.byte() < 230 { UnitQuaternion::new_normalize(q) } else { Unit::new_unchecked(q) };
        let reach = if r.byte() < 220 { 0.1 } else { 200.0 };
        let t = Vector3::new(r.real(reach), r.real(reach), r.real(reach));
        let world_from_camera = Isometry3::from_parts(Translation3::from(t), q);
        let report = map.integrate(&DepthView {
            depth: &depth,
            intrinsics,
            world_from_camera,
            time: f64::from(index),
        });
        seen.extend(behaviours(&report));
    }
    check(&map, limit).map(|()| Shown { behaviours: seen, found: None })
}

/// A slanted or stepped surface, noise, a constant, nothing, or the wrong length.
fn image(r: &mut Reader<'_>, w: usize, h: usize) -> Vec<f32> {
    let kind = r.byte() % 8;
    let (base, slope, step) = (1.5 + r.real(1.4), r.real(0.02), r.real(0.5));
    let mut noise = Random(u64::from(r.byte()));
    (0..if kind == 7 { w * h / 2 } else { w * h })
        .map(|k| {
            let x = k % w;
            match kind {
                0 => 0.0,
                1 => base,
                2 => f32::from((noise.next() >> 48) as u16) * 1e-3,
                3 => f32::from_bits(noise.next() as u32),
                4 => base + slope * x as f32 + if 2 * x > w { step } else { 0.0 },
                5 if noise.below(20) == 0 => 0.0,
                _ => base + slope * (k / w) as f32 + 0.02 * (noise.below(100) as f32 / 100.0 - 0.5),
            }
        })
        .collect()
}

fn behaviours(report: &FrameReport) -> Vec<u64> {
    let c = &report.counts;
    let numbers = [
        c.valid,
        c.regions,
        c.visited,
        c.matched,
        c.created,
        c.expired,
        c.contradicted,
        c.refused,
        c.segments,
    ];
    let mut all: Vec<u64> =
        numbers.iter().enumerate().map(|(k, n)| 100 + 40 * k as u64 + log(u64::from(*n))).collect();
    all.push(20 + report.skipped.map_or(0, |s| s as u64 + 1) + 8 * u64::from(report.jumped));
    all.extend(report.events.iter().map(|e| {
        // The variant's name by its length: all differ but two, which their first letter tells apart.
        let name = format!("{e:?}");
        let n = name.find(['(', ' ', '{']).unwrap_or(name.len());
        1000 + 100 * u64::from(name.as_bytes()[0]) + n as u64
    }));
    all
}

/// What must hold of every map.
fn check(map: &Map, limit: u32) -> Result<(), String> {
    let (mut stable, mut all) = (0u64, 0u32);
    for s in map.surfels() {
        if !s.position.iter().chain(s.normal.iter()).all(|v| v.is_finite()) {
            return Err(format!("a surfel that is not finite: {s:?}"));
        }
        all += 1;
        stable += u64::from(s.stable && s.segment.is_some());
    }
    let counted: u64 = map.segments().map(|s| s.moments().count()).sum();
    if counted != stable {
        return Err(format!("moments count {counted}, stable surfels with a segment {stable}"));
    }
    if all > limit {
        return Err(format!("{all} surfels, limit {limit}"));
    }
    Ok(())
}
