//! Depth at working resolution: the mean of the block's pixels that lie on the surface of its centre.

use crate::frame::{BAND, Frame};
use crate::lanes::wide;
use crate::noise::NoiseTable;
use crate::{DepthView, Params};
use rayon::prelude::*;

/// Writes `z`, `inverse`, `slack` and the windows without prediction. A block takes the depth of a centre pixel and
/// averages what lies within three sigmas and a 60 degree slope of it, so that foreground and background never mix.
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
    let Frame { width, noise, z, inverse, slack, radius, reach, tight, spacing, .. } = frame;
    let (w, band) = (*width, BAND * *width);
    let source = Source {
        depth: view.depth,
        stride: view.intrinsics.width() as usize,
        rows: view.intrinsics.height() as usize,
        low: params.min_depth,
        high: params.max_depth,
        noise,
        slope: 0.9 * *spacing,
    };
    let output = (z.par_chunks_mut(band), inverse.par_chunks_mut(band), slack.par_chunks_mut(band));
    let windows = (radius.par_chunks_mut(band), reach.par_chunks_mut(band), tight.par_chunks_mut(band));
    frame.valid = (output, windows)
        .into_par_iter()
        .enumerate()
        .map(|(b, ((z, inverse, slack), (radius, reach, tight)))| {
            let mut scratch = Scratch::new::<K>(w);
            let mut valid = 0;
            for at in (0..z.len()).step_by(w) {
                let own = at..at + w;
                let (z, inverse) = (&mut z[own.clone()], &mut inverse[own.clone()]);
                let windows = (&mut radius[own.clone()], &mut reach[own.clone()], &mut tight[own.clone()]);
                let y = b * BAND + at / w;
                valid += wide(
                    #[inline(always)]
                    || {
                        source.row::<K>(y, z, &mut scratch);
                        finish(z, inverse, &mut slack[own], windows, noise, &mut scratch.bin)
                    },
                );
            }
            valid
        })
        .sum();
}

/// Inverse depth, its sigma and the window of every pixel of a row; returns the number of valid ones.
#[inline(always)]
fn finish(
    z: &[f32],
    inverse: &mut [f32],
    slack: &mut [f32],
    (radius, reach, tight): (&mut [u8], &mut [u8], &mut [f32]),
    noise: &NoiseTable,
    bin: &mut [u32],
) -> usize {
    let mut valid = 0u32;
    for ((bin, inverse), &z) in bin.iter_mut().zip(inverse.iter_mut()).zip(z) {
        *bin = NoiseTable::bin(z);
        *inverse = if z > 0.0 { 1.0 / z } else { 0.0 };
        valid += u32::from(z > 0.0);
    }
    let windows = radius.iter_mut().zip(reach).zip(tight);
    for (((&bin, &inverse), slack), ((radius, reach), tight)) in
        bin.iter().zip(&*inverse).zip(slack).zip(windows)
    {
        let row = noise.at(bin);
        *slack = row.sigma * inverse * inverse;
        *radius = if inverse > 0.0 { row.window.radius } else { 0 };
        (*reach, *tight) = (row.window.reach, row.window.smooth);
    }
    valid as usize
}

/// The image that is shrunk.
struct Source<'a> {
    depth: &'a [f32],
    stride: usize,
    rows: usize,
    low: f32,
    high: f32,
    noise: &'a NoiseTable,
    /// Depth that a block may span on a surface, per metre.
    slope: f32,
}

/// Rows of a band: per source column the reference of its block, how far one may be off it, the sum of what is off by
/// less and its number; and per working pixel its range bin.
struct Scratch {
    reference: Vec<f32>,
    limit: Vec<f32>,
    sum: Vec<f32>,
    number: Vec<f32>,
    bin: Vec<u32>,
}

impl Scratch {
    fn new<const K: usize>(w: usize) -> Self {
        let wide = || vec![0.0; if K == 1 { 0 } else { w * K }];
        Self { reference: wide(), limit: wide(), sum: wide(), number: wide(), bin: vec![0; w] }
    }
}

impl Source<'_> {
    #[inline(always)]
    fn keep(&self, d: f32) -> f32 {
        if (d >= self.low) & (d <= self.high) { d } else { 0.0 }
    }

    /// A row of the source; an image smaller than a block repeats its last row.
    #[inline(always)]
    fn source(&self, row: usize) -> &[f32] {
        let row = row.min(self.rows - 1);
        &self.depth[row * self.stride..(row + 1) * self.stride]
    }

    #[inline(always)]
    fn row<const K: usize>(&self, y: usize, z: &mut [f32], scratch: &mut Scratch) {
        if K == 1 {
            for (z, &d) in z.iter_mut().zip(self.source(y)) {
                *z = self.keep(d);
            }
            return;
        }
        let Scratch { reference, limit, sum, number, .. } = scratch;
        self.references::<K>(y, reference, limit);
        // A row narrower than a block ends early.
        let n = self.stride.min(reference.len());
        let rows: [&[f32]; K] = std::array::from_fn(|k| &self.source(y * K + k)[..n]);
        let (sums, numbers) = (&mut sum[..n], &mut number[..n]);
        let (references, limits) = (&reference[..n], &limit[..n]);
        for x in 0..n {
            let (mut all, mut inside) = (0.0, 0.0);
            for row in &rows {
                let off = row[x] - references[x];
                let near = off.abs() <= limits[x];
                all += if near { off } else { 0.0 };
                inside += if near { 1.0 } else { 0.0 };
            }
            (sums[x], numbers[x]) = (all, inside);
        }
        let blocks = reference.chunks_exact(K).zip(sum.chunks_exact(K).zip(number.chunks_exact(K)));
        for (z, (reference, (sum, number))) in z.iter_mut().zip(blocks) {
            let mean = sum.iter().sum::<f32>() / number.iter().sum::<f32>().max(1.0);
            *z = if reference[0] > 0.0 { reference[0] + mean } else { 0.0 };
        }
    }

    /// The depth of the first valid centre pixel of every block, for each of its columns.
    #[inline(always)]
    fn references<const K: usize>(&self, y: usize, reference: &mut [f32], limit: &mut [f32]) {
        let (low, high) = ((K - 1) / 2, K / 2);
        let (above, below) = (self.source(y * K + low), self.source(y * K + high));
        let last = self.stride - 1;
        let blocks = reference.chunks_exact_mut(K).zip(limit.chunks_exact_mut(K));
        for (x, (reference, limit)) in blocks.enumerate() {
            let (left, right) = ((x * K + low).min(last), (x * K + high).min(last));
            let mut d = self.keep(below[right]);
            for other in [above[left], below[left], above[right]] {
                d = if d > 0.0 { d } else { self.keep(other) };
            }
            reference.fill(d);
            limit.fill(if d > 0.0 { 3.0 * self.noise.sigma(d) + self.slope * d } else { 0.0 });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    proptest! {
        /// Blocks across steps, with holes and what no sensor gives.
        #[test]
        fn a_block_is_the_mean_of_what_is_near_its_middle(
            w in 1usize..40, h in 1usize..24, halvings in 1u32..4,
            cells in prop::collection::vec((0u8..20, 0f32..0.02), 40 * 24),
        ) {
            let k = 1usize << halvings;
            let depth: Vec<f32> = (0..w * h)
                .map(|i| match cells[i] {
                    (0, _) => 0.0,
                    (1, _) => f32::NAN,
                    (2, d) => 90.0 + d,
                    (3..8, d) => 2.3 + d,
                    (_, d) => 2.0 + d,
                })
                .collect();
            let camera = Intrinsics::new(50.0, 50.0, 5.0, 5.0, w as u32, h as u32).unwrap();
            let pose = Isometry3::identity();
            let view = DepthView { depth: &depth, intrinsics: camera, world_from_camera: pose, time: 0.0 };
            let params = Params { max_pixels: ((w / k).max(1) * (h / k).max(1)) as u32, ..Params::default() };
            let mut frame = Frame::default();
            frame.shrink(&view, &params);
            let k = frame.factor as usize;
            let at = |x: usize, y: usize| depth[y.min(h - 1) * w + x.min(w - 1)];
            let valid = |d: &f32| (params.min_depth..=params.max_depth).contains(d);
            for i in 0..frame.z.len() {
                let (x, y) = (i % frame.width * k, i / frame.width * k);
                let (low, high) = ((k - 1) / 2, k / 2);
                let middle = [[high, high], [low, low], [low, high], [high, low]];
                let reference = middle.map(|[a, b]| at(x + a, y + b)).into_iter().find(valid);
                let want = reference.map_or(0.0, |d| {
                    let limit = 3.0 * frame.noise.sigma(d) + 0.9 * frame.spacing * d;
                    let columns = x..(x + k).min(w);
                    let block = (y..y + k).flat_map(|y| columns.clone().map(move |x| at(x, y)));
                    let near: Vec<f32> = block.filter(|v| (v - d).abs() <= limit).collect();
                    near.iter().sum::<f32>() / near.len() as f32
                });
                prop_assert!((frame.z[i] - want).abs() < 1e-5, "{} {} {}", i, frame.z[i], want);
            }
        }
    }
}
