//! Depth at working resolution: the mean of the block's pixels that lie on the surface of its centre.

use crate::frame::Frame;
use crate::{DepthView, Params};

/// Writes `z` and `inverse`. A block takes the depth of a centre pixel and averages what lies within
/// three sigmas and a 60 degree slope of it, so that foreground and background never mix.
pub(crate) fn shrink(frame: &mut Frame, view: &DepthView<'_>, params: &Params) {
    match frame.factor {
        1 => shrink_by::<1>(frame, view, params),
        2 => shrink_by::<2>(frame, view, params),
        4 => shrink_by::<4>(frame, view, params),
        8 => shrink_by::<8>(frame, view, params),
        16 => shrink_by::<16>(frame, view, params),
        _ => shrink_by::<32>(frame, view, params),
    }
}

fn shrink_by<const K: usize>(frame: &mut Frame, view: &DepthView<'_>, params: &Params) {
    let (w, stride) = (frame.width, view.intrinsics.width() as usize);
    let (low, high) = (params.min_depth, params.max_depth);
    let keep = |d: f32| if d >= low && d <= high { d } else { 0.0 };
    let mut valid = 0;
    for y in 0..frame.height {
        let rows: [&[f32]; K] = std::array::from_fn(|r| {
            // An image smaller than a block repeats its last row.
            let row = (y * K + r).min(view.intrinsics.height() as usize - 1);
            &view.depth[row * stride..(row + 1) * stride]
        });
        for x in 0..w {
            let z = if K == 1 { keep(rows[0][x]) } else { block_mean(&rows, x * K, keep, frame) };
            let i = y * w + x;
            frame.z[i] = z;
            let inverse = if z > 0.0 { 1.0 / z } else { 0.0 };
            frame.inverse[i] = inverse;
            frame.slack[i] = frame.noise.sigma(z) * inverse * inverse;
            valid += usize::from(z > 0.0);
        }
    }
    frame.valid = valid;
}

#[inline]
fn block_mean<const K: usize>(
    rows: &[&[f32]; K],
    first: usize,
    keep: impl Fn(f32) -> f32,
    frame: &Frame,
) -> f32 {
    let (low, high) = ((K - 1) / 2, K / 2);
    // A row narrower than a block ends early.
    let last = rows[0].len() - 1;
    let at = |r: usize, c: usize| keep(rows[r][(first + c).min(last)]);
    let centre = [(high, high), (low, low), (high, low), (low, high)];
    let Some(reference) = centre.iter().map(|&(r, c)| at(r, c)).find(|&d| d > 0.0) else { return 0.0 };
    let reach = 3.0 * frame.noise.sigma(reference) + 0.9 * frame.spacing * reference;
    let (mut sum, mut n) = ([0f32; K], [0f32; K]);
    for row in rows {
        let Some(row) = row.get(first..first + K).and_then(|r| r.first_chunk::<K>()) else { continue };
        for c in 0..K {
            let off = row[c] - reference;
            let inside = off.abs() <= reach;
            sum[c] += if inside { off } else { 0.0 };
            n[c] += if inside { 1.0 } else { 0.0 };
        }
    }
    reference + sum.iter().sum::<f32>() / n.iter().sum::<f32>().max(1.0)
}
