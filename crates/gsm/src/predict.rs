//! What the map expects to see steadies the depth image before its normals and edges are taken.
//!
//! A window that averages noise away also averages steps away. Where the sensor's errors are independent from frame
//! to frame, the surfels in view know the depth better than the frame does, and the windows can be small.

use crate::frame::{Frame, dot};
use crate::lanes::wide;
use crate::project::{Lens, Seen, bits};
use crate::store::{Step, Store};
use crate::surfels::{BLOCK, Column};

/// Standard deviation of a pose, as part of the gate's allowance for it.
const POSE: f32 = 0.3;
/// Surfels seen more obliquely (normal · ray of unit depth) predict nothing.
const FACING: f32 = 0.2;

/// Per pixel the surfels' weight in measurements and their weighted offset from the measured depth, metres.
#[derive(Debug, Default)]
pub(crate) struct Prediction {
    sums: Vec<[f32; 2]>,
}

/// What decides what a surfel predicts.
#[derive(Clone, Copy)]
struct Rule {
    gate_sigmas: f32,
    pose_error: f32,
    pose_variance: f32,
}

/// A pixel: its depth and the standard deviation of that, and its ray.
#[derive(Clone, Copy)]
struct Pixel {
    z: f32,
    sigma: f32,
    ray: [f32; 2],
}

impl Pixel {
    fn of(frame: &Frame, x: usize, y: usize) -> Self {
        let z = frame.z[y * frame.width + x];
        Self { z, sigma: frame.noise.sigma(z), ray: [frame.ray_x[x], frame.ray_y[y]] }
    }
}

impl Rule {
    /// The weight with which a surfel at `p` with normal `n` predicts a pixel, and how far beyond the measured depth it
    /// does; zeros where they do not agree.
    #[inline(always)]
    fn predict(self, pixel: Pixel, p: [f32; 3], n: [f32; 3], confidence: f32) -> [f32; 2] {
        let Pixel { z, sigma, ray } = pixel;
        let tolerance = self.gate_sigmas * sigma + self.pose_error;
        let near = (z != 0.0) & ((p[2] - z).abs() <= 4.0 * tolerance);
        let facing = dot(n, [ray[0], ray[1], 1.0]);
        let off = dot(n, p) / facing - z;
        let agrees = near & (facing <= -FACING) & (off.abs() * -facing <= tolerance);
        let variance = sigma * sigma;
        let weight = variance / (self.pose_variance + variance / confidence);
        if agrees { [weight, off] } else { [0.0; 2] }
    }

    /// The same for the surfels of a block, each with a pixel of its own.
    #[inline(always)]
    fn predict_all(self, pixels: &Pixels, seen: &Seen, confidence: &Column) -> [Column; 2] {
        // Copies on the stack, which the compiler knows to be apart.
        let Pixels { z, sigma, ray } = *pixels;
        let Seen { point: p, normal: n, .. } = *seen;
        let confidence = *confidence;
        let mut predicted = [[0.0; BLOCK]; 2];
        for k in 0..BLOCK {
            let pixel = Pixel { z: z[k], sigma: sigma[k], ray: [ray[0][k], ray[1][k]] };
            let (p, n) = ([p[0][k], p[1][k], p[2][k]], [n[0][k], n[1][k], n[2][k]]);
            [predicted[0][k], predicted[1][k]] = self.predict(pixel, p, n, confidence[k]);
        }
        predicted
    }
}

/// The pixels under the surfels of a block; zeros where there is none.
#[derive(Default)]
struct Pixels {
    z: Column,
    sigma: Column,
    ray: [Column; 2],
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
        let rule = Rule {
            gate_sigmas: params.gate_sigmas,
            pose_error: params.pose_error,
            pose_variance: (POSE * params.pose_error).powi(2),
        };
        let Store { surfels, bricks, .. } = store;
        for block in visible.iter().flat_map(|&b| &bricks.list[b as usize].blocks) {
            let hot = &surfels.hot[block.first as usize / BLOCK];
            let seen = lens.project(hot);
            if samples.pitch == 1 {
                self.add_pixels(rule, frame, &seen, &hot.confidence);
            } else {
                self.add_blocks(rule, frame, &seen, &hot.confidence, samples.pitch);
            }
        }
    }

    /// Adds what surfels predict for the pixels that they fall on.
    fn add_pixels(&mut self, rule: Rule, frame: &Frame, seen: &Seen, confidence: &Column) {
        let mut pixels = Pixels::default();
        for k in bits(seen.inside) {
            let Pixel { z, sigma, ray } = Pixel::of(frame, seen.x[k] as usize, seen.y[k] as usize);
            (pixels.z[k], pixels.sigma[k]) = (z, sigma);
            (pixels.ray[0][k], pixels.ray[1][k]) = (ray[0], ray[1]);
        }
        let [weight, off] = wide(
            #[inline(always)]
            || rule.predict_all(&pixels, seen, confidence),
        );
        for k in bits(seen.inside) {
            let sum = &mut self.sums[seen.y[k] as usize * frame.width + seen.x[k] as usize];
            sum[0] += weight[k];
            sum[1] += weight[k] * off[k];
        }
    }

    /// Adds what surfels predict for all pixels of the block that each falls on.
    fn add_blocks(&mut self, rule: Rule, frame: &Frame, seen: &Seen, confidence: &Column, pitch: usize) {
        let (before, after) = ((pitch - 1) / 2, pitch / 2);
        for k in bits(seen.inside) {
            let (x, y) = (seen.x[k] as usize, seen.y[k] as usize);
            for y in y.saturating_sub(before)..(y + after + 1).min(frame.height) {
                for x in x.saturating_sub(before)..(x + after + 1).min(frame.width) {
                    let pixel = Pixel::of(frame, x, y);
                    let [weight, off] = rule.predict(pixel, seen.point(k), seen.normal(k), confidence[k]);
                    let sum = &mut self.sums[y * frame.width + x];
                    sum[0] += weight;
                    sum[1] += weight * off;
                }
            }
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
