//! Normals from planes fitted over windows that grow with range and stop at jumps.
//!
//! On a plane `A X + B Y + C Z = 1` inverse depth is linear over the image: `1/z = A x' + B y' + C` with the ray
//! `(x', y', 1)`. A line is fitted to inverse depth along the row, and then one to the row fits along the column;
//! each fit spans the pixels that are joined to the centre (cross-shaped support, after Zhang, Lu, Lafruit 2009).
//!
//! Eight neighbours whose windows are alike, as most are, read their sums side by side. Bands of rows are worked in
//! parallel.

use crate::frame::{BAND, DOWN, Frame, RIGHT};
use crate::lanes::{LANES, Lanes, load, same, some, store, wide, word};
use crate::noise::{RADIUS_MAX, Window};
use rayon::prelude::*;

const SPAN: usize = 2 * RADIUS_MAX as usize + 2;

/// `12 / (n (n² − 1))`: inverse of the sum of squared offsets of n consecutive pixels.
fn inverse_spread() -> [f32; SPAN] {
    let mut table = [0.0; SPAN];
    for (n, t) in table.iter_mut().enumerate().skip(2) {
        let n = n as f32;
        *t = 12.0 / (n * (n * n - 1.0));
    }
    table
}

/// Writes `arms`, `row_fit`, `smooth`, `normal` and `cos`, and the windows where there is prediction.
pub(crate) fn normals(frame: &mut Frame) {
    let spread = inverse_spread();
    if frame.noise.independent {
        windows(frame);
    }
    arms(frame);
    fit_rows(frame, &spread);
    fit_columns(frame, &spread);
}

/// Looks up the windows after prediction.
fn windows(frame: &mut Frame) {
    let Frame { width, noise, z, gain, radius, reach, tight, .. } = frame;
    let band = BAND * *width;
    let planes = (z.par_chunks(band), gain.par_chunks(band));
    (planes, radius.par_chunks_mut(band), reach.par_chunks_mut(band), tight.par_chunks_mut(band))
        .into_par_iter()
        .for_each(|((z, gain), radius, reach, tight)| {
            wide(
                #[inline(always)]
                || {
                    let mut wanted = [[0.0; 64]; 2];
                    let input = z.chunks(64).zip(gain.chunks(64));
                    let output = radius.chunks_mut(64).zip(reach.chunks_mut(64)).zip(tight.chunks_mut(64));
                    for ((z, gain), ((radius, reach), tight)) in input.zip(output) {
                        let [side, sigma] = &mut wanted;
                        for ((&z, side), sigma) in z.iter().zip(&mut *side).zip(&mut *sigma) {
                            (*side, *sigma) = noise.row(z).wanted();
                        }
                        let wanted = side.iter().zip(&*sigma).zip(z.iter().zip(gain));
                        let output = radius.iter_mut().zip(reach).zip(tight);
                        for (((&side, &sigma), (&z, &gain)), ((radius, reach), tight)) in wanted.zip(output) {
                            let window = Window::new(side * gain.sqrt(), sigma * gain, true);
                            *radius = if z > 0.0 { window.radius } else { 0 };
                            (*reach, *tight) = (window.reach, window.smooth);
                        }
                    }
                },
            );
        });
}

/// Reach of unbroken links in the four directions, limited by the window radius of the pixel's range.
fn arms(frame: &mut Frame) {
    let Frame { width, height, links, radius, arms: [left, right, up, down], .. } = frame;
    let (w, h, links) = (*width, *height, &links[..]);
    let band = BAND * w;
    let rows = (links.par_chunks(band), radius.par_chunks(band));
    (rows, left.par_chunks_mut(band), right.par_chunks_mut(band)).into_par_iter().for_each(
        |((links, radius), left, right)| {
            wide(
                #[inline(always)]
                || {
                    let mut along = Along::new(w);
                    let rows = links.chunks_exact(w).zip(radius.chunks_exact(w));
                    for ((links, radius), (left, right)) in
                        rows.zip(left.chunks_exact_mut(w).zip(right.chunks_exact_mut(w)))
                    {
                        along.arms(links, radius, left, right);
                    }
                },
            );
        },
    );
    let rows = radius.par_chunks(band);
    (rows, up.par_chunks_mut(band), down.par_chunks_mut(band)).into_par_iter().enumerate().for_each(
        |(b, (radius, up, down))| {
            wide(
                #[inline(always)]
                || arms_across(links, (w, h), b * BAND, radius, up, down),
            );
        },
    );
}

/// Workspace for the arms along a row.
struct Along {
    /// Ones where a pixel is linked to its right, with zeros around.
    joined: Vec<u8>,
    /// Ones where all links so far hold.
    whole: Vec<u8>,
}

impl Along {
    const REACH: usize = RADIUS_MAX as usize;

    fn new(width: usize) -> Self {
        Self { joined: vec![0; width + 2 * Self::REACH], whole: vec![0; width] }
    }

    /// The horizontal arms of a row.
    #[inline(always)]
    fn arms(&mut self, links: &[u8], radius: &[u8], left: &mut [u8], right: &mut [u8]) {
        for (joined, &link) in self.joined[Self::REACH..].iter_mut().zip(links) {
            *joined = link & RIGHT;
        }
        let most = usize::from(radius.iter().fold(0, |most, &r| most.max(r)));
        self.arm(radius, left, (1..=most).map(|k| Self::REACH - k));
        self.arm(radius, right, (0..most).map(|k| Self::REACH + k));
    }

    /// As many links from each pixel on as hold one after the other, up to its radius: the first of the row's are at
    /// `places`.
    #[inline(always)]
    fn arm(&mut self, radius: &[u8], arm: &mut [u8], places: impl Iterator<Item = usize>) {
        arm.fill(0);
        self.whole.fill(1);
        for place in places {
            let links = &self.joined[place..place + arm.len()];
            for ((arm, whole), &link) in arm.iter_mut().zip(&mut self.whole).zip(links) {
                *whole &= link;
                *arm += *whole;
            }
        }
        for (arm, &r) in arm.iter_mut().zip(radius) {
            *arm = (*arm).min(r);
        }
    }
}

/// The vertical ones of the band from row `first` on.
#[inline(always)]
fn arms_across(
    links: &[u8],
    (w, h): (usize, usize),
    first: usize,
    radius: &[u8],
    up: &mut [u8],
    down: &mut [u8],
) {
    let (reach, last) = (RADIUS_MAX as usize, first + radius.len() / w);
    let mut run = vec![0u8; w];
    let follow = |run: &mut [u8], links: &[u8]| {
        for (run, &link) in run.iter_mut().zip(links) {
            *run = (run.saturating_add(1)) & ((link & DOWN) / DOWN).wrapping_neg();
        }
    };
    let limit = |arm: &mut [u8], run: &[u8], radius: &[u8]| {
        for ((arm, &run), &r) in arm.iter_mut().zip(run).zip(radius) {
            *arm = run.min(r);
        }
    };
    for y in first.saturating_sub(reach)..last {
        if y > 0 {
            follow(&mut run, &links[(y - 1) * w..y * w]);
        }
        if y >= first {
            let own = (y - first) * w..(y - first + 1) * w;
            limit(&mut up[own.clone()], &run, &radius[own]);
        }
    }
    run.fill(0);
    for y in (first..(last + reach).min(h)).rev() {
        follow(&mut run, &links[y * w..(y + 1) * w]);
        if y < last {
            let own = (y - first) * w..(y - first + 1) * w;
            limit(&mut down[own.clone()], &run, &radius[own]);
        }
    }
}

fn fit_rows(frame: &mut Frame, spread: &[f32; SPAN]) {
    let Frame { width, inverse, arms: [left, right, ..], row_fit: [value, slope, valid], .. } = frame;
    let (w, band) = (*width, BAND * *width);
    let input = (inverse.par_chunks(band), left.par_chunks(band), right.par_chunks(band));
    let output = (value.par_chunks_mut(band), slope.par_chunks_mut(band), valid.par_chunks_mut(band));
    (input, output).into_par_iter().for_each(|((inverse, left, right), (value, slope, valid))| {
        wide(
            #[inline(always)]
            || {
                let mut prefix = RowSums { value: vec![0.0; w + 1], first: vec![0.0; w + 1] };
                for at in (0..inverse.len()).step_by(w) {
                    let own = at..at + w;
                    prefix.sum(&inverse[own.clone()]);
                    let (left, right) = (&left[own.clone()], &right[own.clone()]);
                    let fit = [&mut value[own.clone()], &mut slope[own.clone()], &mut valid[own.clone()]];
                    fit_row(&prefix, &inverse[own], left, right, fit, spread);
                }
            },
        );
    });
}

/// Prefix sums along a row: of the values, and of the values times their column.
struct RowSums {
    value: Vec<f64>,
    first: Vec<f64>,
}

impl RowSums {
    #[inline(always)]
    fn sum(&mut self, row: &[f32]) {
        let (mut s0, mut s1, mut column) = (0f64, 0f64, 0f64);
        let sums = self.value[1..].iter_mut().zip(&mut self.first[1..]);
        for (&v, (value, first)) in row.iter().zip(sums) {
            s0 += f64::from(v);
            s1 += f64::from(v) * column;
            column += 1.0;
            (*value, *first) = (s0, s1);
        }
    }
}

/// Value and slope at column `x` of the line through `n` columns whose sums are `s0`, `s1`, and whose middle lies
/// `off` columns right of `x`.
#[inline(always)]
fn line(s0: f64, s1: f64, x: usize, off: f64, n: f32, spread: f32) -> (f32, f32) {
    let slope = (s1 - (x as f64 + off) * s0) as f32 * spread;
    (s0 as f32 / n + slope * (-off) as f32, slope)
}

#[inline(always)]
fn fit_row(
    sums: &RowSums,
    row: &[f32],
    left: &[u8],
    right: &[u8],
    [value, slope, valid]: [&mut [f32]; 3],
    spread: &[f32; SPAN],
) {
    let w = row.len();
    let mut x = 0;
    while x < w {
        if x + LANES <= w
            && let (Some(l), Some(r)) = (same(word(left, x), !0), same(word(right, x), !0))
            && l + r >= 2
        {
            let (n, off) = (l + r + 1, 0.5 * (r as f64 - l as f64));
            let range = |s: usize| s..s + LANES;
            let (from, to) = (range(x - l), range(x + r + 1));
            let (a0, a1) = (&sums.value[from.clone()], &sums.first[from]);
            let (b0, b1) = (&sums.value[to.clone()], &sums.first[to]);
            let (mut v, mut s) = ([0.0; LANES], [0.0; LANES]);
            for k in 0..LANES {
                let (s0, s1) = (b0[k] - a0[k], b1[k] - a1[k]);
                (v[k], s[k]) = line(s0, s1, x + k, off, n as f32, spread[n]);
            }
            store(value, x, v);
            store(slope, x, s);
            store(valid, x, [1.0; LANES]);
            x += LANES;
            continue;
        }
        for x in x..(x + LANES).min(w) {
            let (l, r) = (left[x] as usize, right[x] as usize);
            let n = l + r + 1;
            (value[x], slope[x], valid[x]) = (row[x], 0.0, 0.0);
            if n >= 3 {
                let s0 = sums.value[x + r + 1] - sums.value[x - l];
                let s1 = sums.first[x + r + 1] - sums.first[x - l];
                (value[x], slope[x]) = line(s0, s1, x, 0.5 * (r as f64 - l as f64), n as f32, spread[n]);
                valid[x] = 1.0;
            }
        }
        x += LANES;
    }
}

fn fit_columns(frame: &mut Frame, spread: &[f32; SPAN]) {
    let Frame { width, height, camera, ray_x, ray_y, ray_scale, z, arms: [_, _, up, down], .. } = frame;
    let Frame { row_fit, smooth, normal: [nx, ny, nz], cos, .. } = frame;
    let (w, h) = (*width, *height);
    let Some(camera) = *camera else { return };
    // A thread's share of the bands, which reuse its sums.
    let bands = h.div_ceil(BAND).div_ceil(rayon::current_num_threads());
    let band = bands * BAND * w;
    let fit = Columns { w, h, focal: [camera.fx(), camera.fy()], ray_x, ray_y, row_fit, spread };
    let input = (z.par_chunks(band), ray_scale.par_chunks(band), up.par_chunks(band), down.par_chunks(band));
    let normal = (nx.par_chunks_mut(band), ny.par_chunks_mut(band), nz.par_chunks_mut(band));
    (input, normal, smooth.par_chunks_mut(band), cos.par_chunks_mut(band))
        .into_par_iter()
        .enumerate()
        .for_each(|(b, ((z, scale, up, down), (nx, ny, nz), smooth, cos))| {
            wide(
                #[inline(always)]
                || fit.bands(b * bands * BAND, [z, scale], [up, down], [smooth, nx, ny, nz, cos]),
            );
        });
}

/// What the fits along the columns share.
struct Columns<'a> {
    w: usize,
    h: usize,
    focal: [f32; 2],
    ray_x: &'a [f32],
    ray_y: &'a [f32],
    row_fit: &'a [Vec<f32>; 3],
    spread: &'a [f32; SPAN],
}

impl Columns<'_> {
    #[inline(always)]
    fn bands(&self, first: usize, input: [&[f32]; 2], arms: [&[u8]; 2], mut output: [&mut [f32]; 5]) {
        let w = self.w;
        let mut prefix = std::array::from_fn(|_| vec![0f32; (BAND + 2 * RADIUS_MAX as usize + 1) * w]);
        for at in (0..input[0].len()).step_by(BAND * w) {
            let own = at..(at + BAND * w).min(input[0].len());
            let output = output.each_mut().map(|o| &mut o[own.clone()]);
            let (input, arms) = (input.map(|i| &i[own.clone()]), arms.map(|a| &a[own.clone()]));
            self.band(first + at / w, input, arms, output, &mut prefix);
        }
    }

    #[inline(always)]
    fn band(
        &self,
        first: usize,
        input: [&[f32]; 2],
        arms: [&[u8]; 2],
        mut output: [&mut [f32]; 5],
        prefix: &mut [Vec<f32>; 4],
    ) {
        let (w, reach) = (self.w, RADIUS_MAX as usize);
        let last = first + input[0].len() / w;
        let (top, bottom) = (first.saturating_sub(reach), (last + reach).min(self.h));
        let middle = 0.5 * (top + bottom) as f32;
        self.sum(top, bottom, middle, prefix);
        for y in first..last {
            let own = (y - first) * w..(y - first + 1) * w;
            let row = Row {
                y: y as f32 - middle,
                ray_y: self.ray_y[y],
                prefix,
                place: y - top,
                z: &input[0][own.clone()],
                scale: &input[1][own.clone()],
                up: &arms[0][own.clone()],
                down: &arms[1][own.clone()],
            };
            self.row(&row, output.each_mut().map(|o| &mut o[own.clone()]));
        }
    }

    /// Prefix sums over rows, a row of zeros first; rows are counted from `middle`.
    #[inline(always)]
    fn sum(&self, top: usize, bottom: usize, middle: f32, prefix: &mut [Vec<f32>; 4]) {
        let w = self.w;
        prefix.iter_mut().for_each(|p| p[..w].fill(0.0));
        for y in top..bottom {
            let v = y as f32 - middle;
            let [value, slope, valid] = self.row_fit.each_ref().map(|f| &f[y * w..(y + 1) * w]);
            let at = (y - top) * w;
            let [p0, p1, p2, p3] = prefix.each_mut().map(|p| p[at..at + 2 * w].split_at_mut(w));
            add(p0, value, |s, x| s + x);
            add(p1, value, |s, x| s + v * x);
            for ((p, s), (&slope, &valid)) in p2.1.iter_mut().zip(&*p2.0).zip(slope.iter().zip(valid)) {
                *p = s + slope * valid;
            }
            add(p3, valid, |s, x| s + x);
        }
    }

    #[inline(always)]
    fn row(&self, row: &Row<'_>, output: [&mut [f32]; 5]) {
        let w = self.w;
        for x in (0..w).step_by(LANES) {
            let mut window = Windows::default();
            if x + LANES <= w
                && let (ups, downs) = (word(row.up, x), word(row.down, x))
                // Windows of one row give nothing, whatever they are.
                && let care = some(ups | downs)
                && let (Some(u), Some(d)) = (same(ups, care), same(downs, care))
            {
                for c in 0..4 {
                    let a = load(&row.prefix[c], (row.place - u) * w + x);
                    let b = load(&row.prefix[c], (row.place + d + 1) * w + x);
                    for k in 0..LANES {
                        window.sums[c][k] = b[k] - a[k];
                    }
                }
                for k in 0..LANES {
                    window.up[k] = if care >> (8 * k) & 1 == 0 { 0.0 } else { u as f32 };
                    window.down[k] = if care >> (8 * k) & 1 == 0 { 0.0 } else { d as f32 };
                }
                window.spread = [self.spread[u + d + 1]; LANES];
            } else {
                for (k, x) in (x..(x + LANES).min(w)).enumerate() {
                    let (u, d) = (row.up[x] as usize, row.down[x] as usize);
                    let (a, b) = ((row.place - u) * w + x, (row.place + d + 1) * w + x);
                    for c in 0..4 {
                        window.sums[c][k] = row.prefix[c][b] - row.prefix[c][a];
                    }
                    (window.up[k], window.down[k]) = (u as f32, d as f32);
                    window.spread[k] = self.spread[u + d + 1];
                }
            }
            let (z, scale, ray_x) = (load(row.z, x), load(row.scale, x), load(self.ray_x, x));
            let fits = self.fit(row, &window, z, scale, ray_x);
            for c in 0..5 {
                store(output[c], x, fits[c]);
            }
        }
    }

    /// Smoothed depth, normal and cosine of eight pixels; zeros where there is no plane.
    #[inline(always)]
    fn fit(&self, row: &Row<'_>, window: &Windows, z: Lanes, scale: Lanes, ray_x: Lanes) -> [Lanes; 5] {
        let mut out = [[0.0; LANES]; 5];
        let Windows { sums, up, down, spread } = window;
        for k in 0..LANES {
            let [s0, s1, slopes, count] = [sums[0][k], sums[1][k], sums[2][k], sums[3][k]];
            let n = up[k] + down[k] + 1.0;
            let (centre, off) = (row.y + 0.5 * (down[k] - up[k]), 0.5 * (up[k] - down[k]));
            let slope_v = (s1 - centre * s0) * spread[k];
            let inverse = s0 / n + slope_v * off;
            let slope_u = slopes / count;
            let (ax, ay) = (slope_u * self.focal[0], slope_v * self.focal[1]);
            let az = inverse - ax * ray_x[k] - ay * row.ray_y;
            let length = (ax * ax + ay * ay + az * az).sqrt();
            let good = (n >= 3.0) & (count >= 1.0) & (z[k] != 0.0) & (inverse > 1e-3) & (length > 1e-9);
            let unit = 1.0 / length;
            // The ray (x', y', 1) meets the plane A x' + B y' + C = 1/z: normal · ray = (1/z) / length.
            let fit = [1.0 / inverse, -ax * unit, -ay * unit, -az * unit, inverse * unit * scale[k]];
            for c in 0..5 {
                out[c][k] = if good { fit[c] } else { 0.0 };
            }
        }
        out
    }
}

/// Sums over the windows of eight pixels, their reach and the inverse spread of their rows.
#[derive(Default)]
struct Windows {
    /// Values, values times row, slopes, number of slopes.
    sums: [Lanes; 4],
    up: Lanes,
    down: Lanes,
    spread: Lanes,
}

/// One row of a band: its number from the band's middle, its place in the prefix sums, its pixels.
struct Row<'a> {
    y: f32,
    ray_y: f32,
    prefix: &'a [Vec<f32>; 4],
    place: usize,
    z: &'a [f32],
    scale: &'a [f32],
    up: &'a [u8],
    down: &'a [u8],
}

/// The next row of prefix sums from the one above.
#[inline(always)]
fn add((above, own): (&mut [f32], &mut [f32]), values: &[f32], plus: impl Fn(f32, f32) -> f32) {
    for ((own, &above), &value) in own.iter_mut().zip(&*above).zip(values) {
        *own = plus(above, value);
    }
}

#[cfg(test)]
mod tests {
    use super::RADIUS_MAX;
    use crate::frame::{DOWN, Frame, RIGHT, dot};
    use crate::{DepthView, Intrinsics, NoiseModel, Params, Profile};
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn arms_end_at_the_first_broken_link(
            w in 1usize..80, h in 1usize..40, cells in prop::collection::vec((0u8..8, 0u8..=RADIUS_MAX), 3200),
        ) {
            let n = w * h;
            let link = |i: usize| {
                let right = if i % w + 1 < w && cells[i].0 % 5 != 0 { RIGHT } else { 0 };
                right | if i + w < n && cells[i].0 % 3 != 0 { DOWN } else { 0 }
            };
            let links: Vec<u8> = (0..n).map(link).collect();
            let radius: Vec<u8> = cells[..n].iter().map(|c| c.1).collect();
            let arms = std::array::from_fn(|_| vec![0; n]);
            let mut frame = Frame { width: w, height: h, links, radius, arms, ..Frame::default() };
            super::arms(&mut frame);
            for i in 0..n {
                let most = usize::from(frame.radius[i]);
                // Links left, right, up and down, from the pixel outwards.
                let whole = |k: usize, side: usize| match side {
                    0 => k < i % w && frame.links[i - k - 1] & RIGHT != 0,
                    1 => i % w + k < w && frame.links[i + k] & RIGHT != 0,
                    2 => k < i / w && frame.links[i - (k + 1) * w] & DOWN != 0,
                    _ => i / w + k < h && frame.links[i + k * w] & DOWN != 0,
                };
                for side in 0..4 {
                    let want = (0..most).take_while(|&k| whole(k, side)).count();
                    prop_assert_eq!(usize::from(frame.arms[side][i]), want, "pixel {}, side {}", i, side);
                }
            }
        }
    }

    /// Slanted planes fill the image across all band seams; every normal and smoothed depth is the plane's.
    #[test]
    fn planes_give_their_normal_at_every_pixel() {
        let (w, h) = (90, 110);
        let camera = Intrinsics::new(100.0, 120.0, 44.0, 50.0, w, h).unwrap();
        for profile in [Profile::Structured, Profile::TofPhone, Profile::Ideal] {
            let params = Params { noise: NoiseModel::of(profile), max_depth: 20.0, ..Params::default() };
            for [a, b, c] in [[0.0, 0.0, 0.5], [0.2, -0.1, 0.6], [-0.3, 0.3, 0.55], [0.0, 0.5, 0.7]] {
                let ray = |i: u32| [((i % w) as f32 - 44.0) / 100.0, ((i / w) as f32 - 50.0) / 120.0, 1.0];
                let depth: Vec<f32> = (0..w * h).map(|i| 1.0 / dot([a, b, c], ray(i))).collect();
                let view = DepthView {
                    depth: &depth,
                    intrinsics: camera,
                    world_from_camera: Isometry3::identity(),
                    time: 0.0,
                };
                let mut frame = Frame::default();
                frame.shrink(&view, &params);
                frame.segment(&params, 1, &mut |_| ());
                let length = dot([a, b, c], [a, b, c]).sqrt();
                for (i, &z) in depth.iter().enumerate() {
                    let n = frame.normal(i);
                    assert!(dot(n, [-a / length, -b / length, -c / length]) > 0.9999, "{i} {n:?}");
                    assert!((frame.smooth[i] / z - 1.0).abs() < 1e-3);
                    let r = ray(i as u32);
                    assert!((frame.cos[i] + dot(n, r) / dot(r, r).sqrt()).abs() < 1e-3);
                }
                assert_eq!(frame.region_size.len(), 2, "one plane, one region");
            }
        }
    }
}
