//! What the map expects to see steadies the depth image before its normals and edges are taken.
//!
//! A window that averages noise away also averages steps away. Where the sensor's errors are independent from frame
//! to frame, the surfels in view know the depth better than the frame does, and the windows can be small.

use crate::frame::dot;
use crate::lanes::wide;
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

type Column = [f32; BLOCK];

/// The pixels under the surfels of a block; zeros where there is none.
#[derive(Default)]
struct Under {
    z: Column,
    sigma: Column,
    ray: [Column; 2],
}

impl Under {
    /// The weights of the surfels, and their offsets from the measured depth; zeros where they do not agree.
    #[inline(always)]
    fn predictions(
        &self,
        Step { params, .. }: Step<'_>,
        seen: &Seen,
        confidence: &Column,
        pose_variance: f32,
    ) -> (Column, Column) {
        // Copies on the stack, which the compiler knows to be apart.
        let Self { z, sigma, ray } = *self;
        let Seen { point: p, normal: n, .. } = *seen;
        let (confidence, gate, pose_error) = (*confidence, params.gate_sigmas, params.pose_error);
        let (mut weights, mut offs) = ([0.0; BLOCK], [0.0; BLOCK]);
        for k in 0..BLOCK {
            let (p, n) = ([p[0][k], p[1][k], p[2][k]], [n[0][k], n[1][k], n[2][k]]);
            let tolerance = gate * sigma[k] + pose_error;
            let near = (z[k] != 0.0) & ((p[2] - z[k]).abs() <= 4.0 * tolerance);
            let facing = dot(n, [ray[0][k], ray[1][k], 1.0]);
            let off = dot(n, p) / facing - z[k];
            let agrees = near & (facing <= -FACING) & (off.abs() * -facing <= tolerance);
            let variance = sigma[k] * sigma[k];
            let weight = variance / (pose_variance + variance / confidence[k]);
            weights[k] = if agrees { weight } else { 0.0 };
            offs[k] = if agrees { off } else { 0.0 };
        }
        (weights, offs)
    }
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
            if samples.pitch == 1 {
                self.add_block(step, &seen, &surfels.hot[first / BLOCK].confidence, pose_variance);
                continue;
            }
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

    /// Adds what the surfels of a block predict for the pixels that they fall on: [`add`](Self::add) side by side.
    fn add_block(&mut self, step: Step<'_>, seen: &Seen, confidence: &[f32; BLOCK], pose_variance: f32) {
        let frame = step.frame;
        let mut under = Under::default();
        for k in bits(seen.inside) {
            let (x, y) = (seen.x[k] as usize, seen.y[k] as usize);
            under.z[k] = frame.z[y * frame.width + x];
            under.sigma[k] = frame.noise.sigma(under.z[k]);
            under.ray[0][k] = frame.ray_x[x];
            under.ray[1][k] = frame.ray_y[y];
        }
        let (weight, off) = wide(
            #[inline(always)]
            || under.predictions(step, seen, confidence, pose_variance),
        );
        for k in bits(seen.inside) {
            let sum = &mut self.sums[seen.y[k] as usize * frame.width + seen.x[k] as usize];
            // Nothing is added to what is not predicted.
            sum[0] += weight[k];
            sum[1] += weight[k] * off[k];
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

    /// Means of the measurements `z` and their predictions as inverse depths, and the factors by which their standard
    /// deviations fall; 1 where nothing was predicted.
    pub(crate) fn steady(&self, z: &[f32], inverse: &mut [f32], gain: &mut [f32]) {
        wide(
            #[inline(always)]
            || {
                let output = inverse.iter_mut().zip(gain);
                for ((&[weight, offset], &z), (inverse, gain)) in self.sums.iter().zip(z).zip(output) {
                    let all = 1.0 + weight;
                    let mean = (z + offset / all).recip();
                    *inverse = if weight > 0.0 { mean } else { *inverse };
                    *gain = if weight > 0.0 { all.sqrt().recip() } else { 1.0 };
                }
            },
        );
    }
}
