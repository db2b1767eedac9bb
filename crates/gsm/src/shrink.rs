//! Depth at working resolution: the mean of the block's pixels that lie on the surface of its centre.

use crate::frame::Frame;
use crate::{DepthView, Params};

/// Writes `z` and `inverse`. A block takes the depth of a centre pixel and averages what lies within
/// three sigmas and a 60 degree slope of it, so that foreground and background never mix.
pub(crate) fn shrink(frame: &mut Frame, view: &DepthView<'_>, params: &Params) {
    let k = frame.factor as usize;
    let stride = view.intrinsics.width() as usize;
    let (low, high) = (params.min_depth, params.max_depth);
    let keep = |d: f32| if d >= low && d <= high { d } else { 0.0 };
    let mut valid = 0;
    for y in 0..frame.height {
        for x in 0..frame.width {
            let z = if k == 1 {
                keep(view.depth[y * stride + x])
            } else {
                let first = y * k * stride + x * k;
                block_mean(view.depth, first, stride, k, keep, |z| {
                    3.0 * frame.noise.sigma(z) + 0.9 * frame.spacing * z
                })
            };
            let i = y * frame.width + x;
            frame.z[i] = z;
            frame.inverse[i] = if z > 0.0 { 1.0 / z } else { 0.0 };
            valid += usize::from(z > 0.0);
        }
    }
    frame.valid = valid;
}

fn block_mean(
    depth: &[f32],
    first: usize,
    stride: usize,
    k: usize,
    keep: impl Fn(f32) -> f32,
    tolerance: impl Fn(f32) -> f32,
) -> f32 {
    let (low, high) = ((k - 1) / 2, k / 2);
    let at = |r: usize, c: usize| keep(depth[first + r * stride + c]);
    let centre = [(high, high), (low, low), (high, low), (low, high)];
    let Some(reference) = centre.iter().map(|&(r, c)| at(r, c)).find(|&d| d > 0.0) else { return 0.0 };
    let reach = tolerance(reference);
    let (mut sum, mut n) = (0.0, 0.0);
    for r in 0..k {
        let row = &depth[first + r * stride..first + r * stride + k];
        for &d in row {
            let inside = if (d - reference).abs() <= reach { 1.0 } else { 0.0 };
            sum += if inside > 0.0 { d - reference } else { 0.0 };
            n += inside;
        }
    }
    reference + sum / n
}
