//! What the map expects to see steadies the depth image before its normals and edges are taken.
//!
//! A window that averages noise away also averages steps away. Where the sensor's errors are independent from frame
//! to frame, the surfels in view know the depth better than the frame does, and the windows can be small.

use crate::frame::dot;
use crate::project::{Lens, Seen, bits};
use crate::store::{Step, Store};
use crate::surfels::BLOCK;

/// Standard deviation of a pose, as part of the gate's allowance for it.
const POSE: f32 = 0.3;
/// Surfels seen more obliquely (normal · ray of unit depth) predict nothing.
const FACING: f32 = 0.2;

/// Per pixel the surfels' weight in measurements and their weighted offset from the measured depth, metres.
#[derive(Debug, Default)]
pub(crate) struct Prediction {
    sums: Vec<[f32; 2]>,
}

impl Prediction {
    /// Gathers the surfels that the frame sees again. Each predicts the depth `d` at which the ray of its pixel meets
    /// its plane, with weight `σ² / (σ_pose² + σ² / c)` for `c` sightings.
    pub(crate) fn gather(&mut self, step: Step<'_>, visible: &[u32], store: &Store) {
        let Step { frame, samples, pose, params, .. } = step;
        self.sums.clear();
        self.sums.resize(frame.z.len(), [0.0; 2]);
        let Some(camera) = frame.camera else { return };
        let lens = Lens::new(&camera, pose, params);
        let pose_variance = (POSE * params.pose_error).powi(2);
        let Store { surfels, bricks, .. } = store;
        // A surfel predicts all pixels of its block.
        let (before, after) = ((samples.pitch - 1) / 2, samples.pitch / 2);
        for block in visible.iter().flat_map(|&b| &bricks.list[b as usize].blocks) {
            let first = block.first as usize;
            let seen = lens.project(&surfels.hot[first / BLOCK]);
            for k in bits(seen.inside) {
                let confidence = surfels.hot[first / BLOCK].confidence[k];
                let (x, y) = (seen.x[k] as usize, seen.y[k] as usize);
                for y in y.saturating_sub(before)..(y + after + 1).min(frame.height) {
                    for x in x.saturating_sub(before)..(x + after + 1).min(frame.width) {
                        self.add(step, &seen, k, confidence, [x, y], pose_variance);
                    }
                }
            }
        }
    }

    /// Adds what a surfel predicts for a pixel, if they agree.
    #[inline]
    fn add(
        &mut self,
        Step { frame, params, .. }: Step<'_>,
        seen: &Seen,
        k: usize,
        confidence: f32,
        [x, y]: [usize; 2],
        pose_variance: f32,
    ) {
        let p = seen.point(k);
        let i = y * frame.width + x;
        let z = frame.z[i];
        let sigma = frame.noise.row(z).sigma;
        let tolerance = params.gate_sigmas * sigma + params.pose_error;
        if z == 0.0 || (p[2] - z).abs() > 4.0 * tolerance {
            return;
        }
        let n = seen.normal(k);
        let facing = dot(n, [frame.ray_x[x], frame.ray_y[y], 1.0]);
        if facing > -FACING {
            return;
        }
        let off = dot(n, p) / facing - z;
        if off.abs() * -facing <= tolerance {
            let variance = sigma * sigma;
            let weight = variance / (pose_variance + variance / confidence);
            self.sums[i][0] += weight;
            self.sums[i][1] += weight * off;
        }
    }

    /// Mean of the measurement at `z` and its predictions as an inverse depth, with the factor by which its standard
    /// deviation falls; `None` where nothing was predicted.
    #[inline]
    pub(crate) fn steady(&self, pixel: usize, z: f32) -> Option<(f32, f32)> {
        let [weight, offset] = self.sums[pixel];
        let all = 1.0 + weight;
        (weight > 0.0).then(|| ((z + offset / all).recip(), all.sqrt().recip()))
    }
}
