//! A block of surfels against the samples that it falls on: which are seen, and what they learn.

use crate::lanes::wide;
use crate::project::{Lens, Seen, bits};
use crate::samples::Samples;
use crate::store::Step;
use crate::surfels::{BLOCK, Column, HotBlock};

/// Where errors are independent, surfels average them: fused is mostly the measured depth, since smoothing would
/// blur steps for good.
const RAW: f32 = 0.75;
/// What lies so many tolerances before the measured depth and is not seen there is looked through.
const BEFORE: f32 = 0.8;
/// Sightings beyond this do not count.
pub(crate) const CONFIDENCE_MAX: f32 = 40.0;

/// The samples under the surfels of a block, field by field; zeros where there is none.
#[derive(Default)]
struct Under {
    z: Column,
    smooth: Column,
    normal: [Column; 3],
    cos: Column,
    tolerance: Column,
    ray: [Column; 2],
}

/// What became of the surfels of a block, a bit each.
#[derive(Debug, Default)]
pub(crate) struct Marks {
    /// Seen again.
    pub(crate) seen: u32,
    /// Clearly before the measured surface.
    pub(crate) before: u32,
    /// Near the measured surface, but not of it.
    pub(crate) stray: u32,
    /// Averaged with their sample.
    pub(crate) fused: u32,
    /// Square of the distance from the sample's point.
    pub(crate) distance: Column,
}

/// What decides whether a surfel is seen.
pub(crate) struct Gate<'a> {
    pub(crate) lens: Lens<'a>,
    pub(crate) step: Step<'a>,
    /// Part of the measured depth in what is fused; the rest is the smoothed one.
    raw: f32,
    /// How far behind and before the surface a parallel sheet counts as its double, in tolerances. Errors in patterns
    /// that stay leave such sheets on both sides; where errors are independent, what lies behind is hidden.
    sheet: (f32, f32),
}

impl<'a> Gate<'a> {
    pub(crate) fn new(lens: Lens<'a>, step: Step<'a>) -> Self {
        let (raw, sheet) = if step.frame.noise.independent { (RAW, (-1.0, 2.0)) } else { (0.0, (-3.0, 3.0)) };
        Self { lens, step, raw, sheet }
    }

    /// Compares the surfels with the samples under them, and averages position along the normal, normal, radius and
    /// confidence of those that are seen.
    pub(crate) fn look(&self, hot: &mut HotBlock, seen: &Seen) -> Marks {
        let under = self.under(seen);
        wide(
            #[inline(always)]
            || self.lanes(hot, seen, &under),
        )
    }

    fn under(&self, seen: &Seen) -> Under {
        let samples = self.step.samples;
        let mut under = Under::default();
        for k in bits(seen.inside) {
            let (x, y) = (seen.x[k] as usize, seen.y[k] as usize);
            let s = &samples.list[y * samples.width + x];
            (under.z[k], under.smooth[k]) = (s.z, s.smooth);
            (under.normal[0][k], under.normal[1][k], under.normal[2][k]) = s.normal.into();
            (under.cos[k], under.tolerance[k]) = (s.cos, s.tolerance);
            (under.ray[0][k], under.ray[1][k]) = (samples.ray_x[x], samples.ray_y[y]);
        }
        under
    }

    #[inline(always)]
    fn lanes(&self, hot: &mut HotBlock, seen: &Seen, under: &Under) -> Marks {
        // Copies on the stack, which the compiler knows to be apart.
        let Gate { raw, sheet, step: Step { params, samples, pose, .. }, .. } = *self;
        let (parallel_cos, least_cos, spacing) =
            (params.gate_normal_cos, params.min_incidence_cos, samples.spacing);
        let turn = *pose;
        let Seen { point, normal: own, .. } = *seen;
        let Under { z, smooth, normal: n, cos, tolerance, ray } = *under;
        let HotBlock { mut position, mut normal, mut radius, mut confidence, .. } = *hot;
        let mut marks = [[0u32; BLOCK]; 4];
        let mut distance = [0f32; BLOCK];
        for k in 0..BLOCK {
            let p = [point[0][k], point[1][k], point[2][k]];
            let n = [n[0][k], n[1][k], n[2][k]];
            let (x, y, tolerance, cos) = (ray[0][k], ray[1][k], tolerance[k], cos[k]);
            let live = z[k] != 0.0;
            let far = z[k] + 3.0 * tolerance + 0.1 * z[k];
            let reached = live & (smooth[k] != 0.0) & (p[2] <= far);
            let off = [p[0] - smooth[k] * x, p[1] - smooth[k] * y, p[2] - smooth[k]];
            let ahead = off[0] * n[0] + off[1] * n[1] + off[2] * n[2];
            let parallel = own[0][k] * n[0] + own[1][k] * n[1] + own[2][k] * n[2] >= parallel_cos;
            // On a slanted plane what is seen may lie well before its pixel's depth.
            let hit = reached & parallel & (ahead.abs() <= tolerance);
            let nearer = live & !hit & (p[2] < z[k] - BEFORE * tolerance);
            let open = reached & !hit & !nearer;
            // A sheet beside the surface, or a wrongly turned disc within: not what the camera would see there.
            let (behind, before) = if parallel { sheet } else { (-0.5, 0.5) };
            let about = (ahead >= behind * tolerance) & (ahead <= before * tolerance);
            distance[k] = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];

            // Along the pixel's ray, what is z deeper lies z times their product behind.
            let facing = n[0] * x + n[1] * y + n[2];
            let ahead = ahead - raw * (z[k] - smooth[k]) * facing;
            let learns = hit & (cos >= least_cos);
            let gain = if learns { cos / (confidence[k] + cos) } else { 0.0 };
            let step = ahead * gain;
            let n = turn.turn(n);
            let m = [normal[0][k], normal[1][k], normal[2][k]];
            let m = [m[0] + (n[0] - m[0]) * gain, m[1] + (n[1] - m[1]) * gain, m[2] + (n[2] - m[2]) * gain];
            // One Newton step towards unit length: the length is within 10 % of it and gains at every sighting.
            let scale = 1.5 - 0.5 * (m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
            let scale = if learns { scale } else { 1.0 };
            for a in 0..3 {
                position[a][k] -= n[a] * step;
                normal[a][k] = m[a] * scale;
            }
            let disc = radius[k].min(crate::fuse::radius(spacing, smooth[k], cos));
            radius[k] = if learns { disc } else { radius[k] };
            let sure = (confidence[k] + 1.0).min(CONFIDENCE_MAX);
            confidence[k] = if learns { sure } else { confidence[k] };
            marks[0][k] = u32::from(hit) << k;
            marks[1][k] = u32::from(nearer) << k;
            marks[2][k] = u32::from(open & about) << k;
            marks[3][k] = u32::from(learns) << k;
        }
        (hot.position, hot.normal, hot.radius, hot.confidence) = (position, normal, radius, confidence);
        let mut all = [0; 4];
        for (all, marks) in all.iter_mut().zip(&marks) {
            marks.iter().for_each(|m| *all |= m);
        }
        let [seen, before, stray, fused] = all;
        Marks { seen, before, stray, fused, distance }
    }

    /// Whether all valid depths of the 3×3 samples around a surfel, at least six, lie beyond it.
    pub(crate) fn looks_through(&self, seen: &Seen, k: usize) -> bool {
        let samples: &Samples = self.step.samples;
        let (x, y) = (seen.x[k] as usize, seen.y[k] as usize);
        let z = seen.point[2][k] + BEFORE * samples.list[y * samples.width + x].tolerance;
        let mut beyond = 0;
        for row in y.saturating_sub(1)..(y + 2).min(samples.height) {
            for column in x.saturating_sub(1)..(x + 2).min(samples.width) {
                let d = samples.list[row * samples.width + column].z;
                if d > 0.0 && d <= z {
                    return false;
                }
                beyond += u32::from(d > z);
            }
        }
        beyond >= 6
    }
}
