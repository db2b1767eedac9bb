//! Normals from planes fitted over windows that grow with range and stop at jumps.
//!
//! On a plane `A X + B Y + C Z = 1` inverse depth is linear over the image: `1/z = A x' + B y' + C` with the ray
//! `(x', y', 1)`. A line is fitted to inverse depth along the row, and then one to the row fits along the column;
//! each fit spans the pixels that are joined to the centre (cross-shaped support, after Zhang, Lu, Lafruit 2009).

use crate::frame::{DOWN, Frame, RIGHT};
use crate::noise::RADIUS_MAX;

const SPAN: usize = 2 * RADIUS_MAX as usize + 2;
/// Rows per vertical band: prefix sums start anew in each, whatever the number of threads.
const BAND: usize = 32;

/// `12 / (n (n² − 1))`: inverse of the sum of squared offsets of n consecutive pixels.
fn inverse_spread() -> [f32; SPAN] {
    let mut table = [0.0; SPAN];
    for (n, t) in table.iter_mut().enumerate().skip(2) {
        let n = n as f32;
        *t = 12.0 / (n * (n * n - 1.0));
    }
    table
}

/// Writes `arms`, `row_fit`, `smooth` and `normal`.
pub(crate) fn normals(frame: &mut Frame) {
    arms(frame);
    let spread = inverse_spread();
    fit_rows(frame, &spread);
    for first in (0..frame.height).step_by(BAND) {
        fit_columns(frame, first, (first + BAND).min(frame.height), &spread);
    }
}

/// Reach of unbroken links in the four directions, limited by the window radius of the pixel's range.
fn arms(frame: &mut Frame) {
    let (w, h) = (frame.width, frame.height);
    let mut left = 0u8;
    let mut up = vec![0u8; w];
    for y in 0..h {
        for (x, up) in up.iter_mut().enumerate() {
            let i = y * w + x;
            left = if x > 0 && frame.links[i - 1] & RIGHT != 0 { left.saturating_add(1) } else { 0 };
            *up = if y > 0 && frame.links[i - w] & DOWN != 0 { up.saturating_add(1) } else { 0 };
            let r = if frame.z[i] > 0.0 { frame.noise.window(frame.z[i], frame.gain[i]).radius } else { 0 };
            frame.arms[i] = [left.min(r), r, (*up).min(r), r];
        }
    }
    let mut right = 0u8;
    let mut down = vec![0u8; w];
    for y in (0..h).rev() {
        for x in (0..w).rev() {
            let i = y * w + x;
            right = if x + 1 < w && frame.links[i] & RIGHT != 0 { right.saturating_add(1) } else { 0 };
            down[x] = if y + 1 < h && frame.links[i] & DOWN != 0 { down[x].saturating_add(1) } else { 0 };
            let arms = &mut frame.arms[i];
            arms[1] = arms[1].min(right);
            arms[3] = arms[3].min(down[x]);
        }
    }
}

fn fit_rows(frame: &mut Frame, spread: &[f32; SPAN]) {
    let w = frame.width;
    let mut prefix = vec![[0f64; 2]; w + 1];
    for y in 0..frame.height {
        let row = &frame.inverse[y * w..(y + 1) * w];
        let mut sum = [0f64; 2];
        for (x, &v) in row.iter().enumerate() {
            sum[0] += f64::from(v);
            sum[1] += f64::from(v) * x as f64;
            prefix[x + 1] = sum;
        }
        let fits = &mut frame.row_fit[y * w..(y + 1) * w];
        let arms = &frame.arms[y * w..(y + 1) * w];
        for x in 0..w {
            let (l, r) = (arms[x][0] as usize, arms[x][1] as usize);
            let n = l + r + 1;
            if n < 3 {
                fits[x] = [row[x], 0.0, 0.0];
                continue;
            }
            let (a, b) = (prefix[x - l], prefix[x + r + 1]);
            let (s0, s1) = (b[0] - a[0], b[1] - a[1]);
            let centre = x as f64 + 0.5 * (r as f64 - l as f64);
            let slope = (s1 - centre * s0) as f32 * spread[n];
            fits[x] = [s0 as f32 / n as f32 + slope * (x as f64 - centre) as f32, slope, 1.0];
        }
    }
}

fn fit_columns(frame: &mut Frame, first: usize, last: usize, spread: &[f32; SPAN]) {
    let (w, h) = (frame.width, frame.height);
    let Some(camera) = frame.camera else { return };
    let reach = RADIUS_MAX as usize;
    let (top, bottom) = (first.saturating_sub(reach), (last + reach).min(h));
    let middle = 0.5 * (top + bottom) as f32;
    let mut prefix = std::mem::take(&mut frame.prefix);
    prefix.resize((bottom - top + 1) * w, [0f32; 4]);
    prefix[..w].fill([0f32; 4]);
    for y in top..bottom {
        let v = y as f32 - middle;
        let (done, rest) = prefix.split_at_mut((y - top + 1) * w);
        let above = &done[(y - top) * w..];
        for (x, p) in rest[..w].iter_mut().enumerate() {
            let [value, slope, valid] = frame.row_fit[y * w + x];
            let s = above[x];
            *p = [s[0] + value, s[1] + v * value, s[2] + slope * valid, s[3] + valid];
        }
    }
    for y in first..last {
        for x in 0..w {
            let i = y * w + x;
            let (u, d) = (frame.arms[i][2] as usize, frame.arms[i][3] as usize);
            let n = u + d + 1;
            let (a, b) = (prefix[(y - u - top) * w + x], prefix[(y + d + 1 - top) * w + x]);
            let count = b[3] - a[3];
            if n < 3 || count < 1.0 || frame.z[i] == 0.0 {
                frame.normal[i] = [0.0; 3];
                frame.smooth[i] = 0.0;
                continue;
            }
            let centre = y as f32 - middle + 0.5 * (d as f32 - u as f32);
            let s0 = b[0] - a[0];
            let slope_v = (b[1] - a[1] - centre * s0) * spread[n];
            let inverse = s0 / n as f32 + slope_v * (0.5 * (u as f32 - d as f32));
            let slope_u = (b[2] - a[2]) / count;
            let (ax, ay) = (slope_u * camera.fx(), slope_v * camera.fy());
            let az = inverse - ax * frame.ray_x[x] - ay * frame.ray_y[y];
            let length = (ax * ax + ay * ay + az * az).sqrt();
            if !(inverse > 1e-3 && length > 1e-9) {
                frame.normal[i] = [0.0; 3];
                frame.smooth[i] = 0.0;
                continue;
            }
            frame.smooth[i] = 1.0 / inverse;
            let scale = 1.0 / length;
            frame.normal[i] = [-ax * scale, -ay * scale, -az * scale];
            // The ray (x', y', 1) meets the plane A x' + B y' + C = 1/z: normal · ray = (1/z) / length.
            frame.cos[i] = inverse * scale * frame.ray_scale[i];
        }
    }
    frame.prefix = prefix;
}

#[cfg(test)]
mod tests {
    use crate::frame::{Frame, dot};
    use crate::{DepthView, Intrinsics, NoiseModel, Params, Profile};
    use nalgebra::Isometry3;

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
                frame.segment(&params, &mut |_| ());
                let length = dot([a, b, c], [a, b, c]).sqrt();
                for (i, &z) in depth.iter().enumerate() {
                    let n = frame.normal[i];
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
