//! Edges: concave creases and steps between the smoothed surfaces on the two sides of a pixel.

use crate::Params;
use crate::frame::{BAND, EDGE, Frame, NO_PLANE, dot};
use crate::lanes::{LANES, Lanes, first, load, some, wide, word};
use crate::noise::RADIUS_MAX;
use rayon::prelude::*;

/// Sides are compared at this distance at most, pixels.
const MOST: usize = RADIUS_MAX as usize + 1;

/// Writes `edge`. A pixel is an edge when it has no normal, when a link to one of its four neighbours is broken,
/// or when the points on both sides of it, along row or column at the window's reach, form a concave crease
/// (`(N₂ − N₁)·(P₂ − P₁) < 0`, after Stein et al. 2014) or a step.
pub(crate) fn edges(frame: &mut Frame, params: &Params) {
    let mut edge = std::mem::take(&mut frame.edge);
    let ray_x = [&[0.0; MOST][..], &frame.ray_x].concat();
    let test = Test { frame, ray_x, crease: params.concave_angle.cos(), steps: params.step_sigmas };
    let w = frame.width;
    edge.par_chunks_mut(BAND * w).enumerate().for_each(|(b, edge)| {
        wide(
            #[inline(always)]
            || {
                let mut reach = Reach::new(w);
                for (y, edge) in edge.chunks_exact_mut(w).enumerate() {
                    let y = b * BAND + y;
                    reach.read(test.frame, y, edge);
                    test.row(y, &reach, edge);
                }
            },
        );
    });
    frame.edge = edge;
}

/// The distances at which the two sides of each pixel of a row are compared, along row and column; 0 where a link is
/// broken.
struct Reach {
    along: Vec<u8>,
    across: Vec<u8>,
}

impl Reach {
    fn new(width: usize) -> Self {
        // Words are read beyond the last pixel.
        let row = || vec![0; width + LANES];
        Self { along: row(), across: row() }
    }

    /// Of row `y`; writes what makes a pixel of it an edge by itself.
    #[inline(always)]
    fn read(&mut self, frame: &Frame, y: usize, edge: &mut [u8]) {
        let row = y * edge.len()..(y + 1) * edge.len();
        let [l, r, u, d] = &frame.arms;
        let arms =
            (l[row.clone()].iter().zip(&r[row.clone()])).zip(u[row.clone()].iter().zip(&d[row.clone()]));
        let input = arms.zip(&frame.reach[row.clone()]);
        for ((((&l, &r), (&u, &d)), &reach), (along, across)) in
            input.zip(self.along.iter_mut().zip(&mut self.across))
        {
            (*along, *across) = (l.min(r).min(reach), u.min(d).min(reach));
        }
        let reach = self.along.iter().zip(&self.across);
        for ((edge, &own), (&along, &across)) in edge.iter_mut().zip(&frame.smooth[row]).zip(reach) {
            let none = if own == 0.0 { EDGE | NO_PLANE } else { 0 };
            *edge = if along.min(across) == 0 { EDGE } else { 0 } | none;
        }
    }
}

/// Normal (three), depth and ray (two) of eight pixels on either side.
type Sides = [[Lanes; 6]; 2];

struct Test<'a> {
    frame: &'a Frame,
    /// Rays of the columns, with zeros before them for the sides of pixels that do not matter.
    ray_x: Vec<f32>,
    /// Cosine of the angle of a crease.
    crease: f32,
    /// Sigmas of a step.
    steps: f32,
}

impl Test<'_> {
    /// Finds the edges of row `y` among the pixels whose links hold.
    #[inline(always)]
    fn row(&self, y: usize, reach: &Reach, edge: &mut [u8]) {
        let w = edge.len();
        for (x, edge) in edge.chunks_mut(LANES).enumerate().map(|(c, e)| (c * LANES, e)) {
            let (k, m) = (word(&reach.along, x), word(&reach.across, x));
            let care = some(k) & some(m);
            if care == 0 {
                continue;
            }
            let (place, i) = ([x, y], y * w + x);
            let mut hit = [0; LANES];
            // The pixels of one reach at a time: mostly all.
            let mut left = care;
            while left != 0 {
                let (reach, lanes) = first(k, left);
                or_some(&mut hit, self.creased(&self.beside(place, reach), i), lanes);
                left &= !lanes;
            }
            left = care;
            while left != 0 {
                let (reach, lanes) = first(m, left);
                or_some(&mut hit, self.creased(&self.above(place, reach), i), lanes);
                left &= !lanes;
            }
            for (e, hit) in edge.iter_mut().zip(hit) {
                *e |= hit as u8 * EDGE;
            }
        }
    }

    /// What lies `k` columns to both sides of eight pixels.
    #[inline(always)]
    fn beside(&self, [x, y]: [usize; 2], k: usize) -> Sides {
        let f = self.frame;
        let ray_y = [f.ray_y[y]; LANES];
        let (a, b) = (load(&self.ray_x, MOST + x - k), load(&self.ray_x, MOST + x + k));
        let i = y * f.width + x;
        [self.side(i - k, a, ray_y), self.side(i + k, b, ray_y)]
    }

    /// What lies `m` rows above and below eight pixels.
    #[inline(always)]
    fn above(&self, [x, y]: [usize; 2], m: usize) -> Sides {
        let f = self.frame;
        let ray_x = load(&self.ray_x, MOST + x);
        let (i, step) = (y * f.width + x, m * f.width);
        let (a, b) = ([f.ray_y[y - m]; LANES], [f.ray_y[y + m]; LANES]);
        [self.side(i - step, ray_x, a), self.side(i + step, ray_x, b)]
    }

    #[inline(always)]
    fn side(&self, i: usize, ray_x: Lanes, ray_y: Lanes) -> [Lanes; 6] {
        let [nx, ny, nz] = &self.frame.normal;
        [load(nx, i), load(ny, i), load(nz, i), load(&self.frame.smooth, i), ray_x, ray_y]
    }

    /// Whether the surface bends inwards or steps (1) between the two sides of each of the pixels from `i` on.
    #[inline(always)]
    fn creased(&self, [a, b]: &Sides, i: usize) -> [u32; LANES] {
        let tight = load(&self.frame.tight, i);
        let mut hit = [0; LANES];
        for j in 0..LANES {
            let (n1, n2) = ([a[0][j], a[1][j], a[2][j]], [b[0][j], b[1][j], b[2][j]]);
            let (z1, z2) = (a[3][j], b[3][j]);
            let across = [z2 * b[4][j] - z1 * a[4][j], z2 * b[5][j] - z1 * a[5][j], z2 - z1];
            let bent = dot(n1, n2) < self.crease;
            let inwards = dot([n2[0] - n1[0], n2[1] - n1[1], n2[2] - n1[2]], across) < 0.0;
            let mean = [n1[0] + n2[0], n1[1] + n2[1], n1[2] + n2[2]];
            // height > step + |across| / 20, without the root.
            let excess = 0.5 * dot(mean, across).abs() - self.steps * tight[j];
            let stepped = (excess > 0.0) & (400.0 * excess * excess > dot(across, across));
            hit[j] = u32::from((z1 != 0.0) & (z2 != 0.0) & ((bent & inwards) | (!bent & stepped)));
        }
        hit
    }
}

/// Adds the bits of the lanes whose bytes are ones.
#[inline(always)]
fn or_some(a: &mut [u32; LANES], b: [u32; LANES], lanes: u64) {
    for j in 0..LANES {
        a[j] |= b[j] & (lanes >> (8 * j)) as u32 & 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DepthView, Intrinsics, NoiseModel, Profile};
    use nalgebra::Isometry3;
    use proptest::prelude::*;

    /// What the comparison of two sides says, by its definition; `None` where rounding decides.
    fn apart(frame: &Frame, params: &Params, i: usize, [a, b]: [usize; 2]) -> Option<bool> {
        let w = frame.width;
        let normal = |i: usize| frame.normal(i).map(f64::from);
        let point = |i: usize| {
            let z = f64::from(frame.smooth[i]);
            [z * f64::from(frame.ray_x[i % w]), z * f64::from(frame.ray_y[i / w]), z]
        };
        if frame.smooth[a] == 0.0 || frame.smooth[b] == 0.0 {
            return Some(false);
        }
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
        let (n1, n2, p1, p2) = (normal(a), normal(b), point(a), point(b));
        let across: [f64; 3] = std::array::from_fn(|k| p2[k] - p1[k]);
        let bend = dot(n1, n2) - f64::from(params.concave_angle).cos();
        let inwards = dot(std::array::from_fn(|k| n2[k] - n1[k]), across);
        let height = dot(std::array::from_fn(|k| (n1[k] + n2[k]) / 2.0), across).abs();
        let least = f64::from(params.step_sigmas * frame.tight[i]) + dot(across, across).sqrt() / 20.0;
        let unsure = bend.abs() < 1e-6 || inwards.abs() < 1e-7 || (height - least).abs() < 1e-6;
        (!unsure).then_some(if bend < 0.0 { inwards < 0.0 } else { height > least })
    }

    /// Whether a pixel is an edge, pixel by pixel.
    fn is_edge(frame: &Frame, params: &Params, i: usize) -> Option<bool> {
        let [left, right, up, down] = frame.arms.each_ref().map(|a| usize::from(a[i]));
        let (along, across) = (left.min(right), up.min(down));
        if frame.smooth[i] == 0.0 || along == 0 || across == 0 {
            return Some(true);
        }
        let reach = usize::from(frame.reach[i]);
        let (k, m) = (along.min(reach), across.min(reach) * frame.width);
        match [[i - k, i + k], [i - m, i + m]].map(|sides| apart(frame, params, i, sides)) {
            [Some(a), Some(b)] => Some(a || b),
            [Some(true), _] | [_, Some(true)] => Some(true),
            _ => None,
        }
    }

    proptest! {
        /// Slanted tiles of several depths and turns, with holes.
        #[test]
        fn edges_are_what_they_are_said_to_be(
            w in 1u32..70, h in 1u32..40, tile in 3u32..16, profile in 0usize..3, seed in any::<u64>(),
            tiles in prop::collection::vec((0.8f32..3.0, -0.5f32..0.5, -0.5f32..0.5), 1..6),
        ) {
            let mut dice = seed;
            let mut draw = || {
                dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (dice >> 40) as f32 / (1u64 << 24) as f32
            };
            let camera = Intrinsics::new(60.0, 60.0, w as f32 / 2.0, h as f32 / 2.0, w, h).unwrap();
            let depth: Vec<f32> = (0..w * h)
                .map(|i| {
                    let (x, y) = (i % w, i / w);
                    let (z, a, b) = tiles[((x / tile) + 3 * (y / tile)) as usize % tiles.len()];
                    let z = z + a * (x % tile) as f32 / 60.0 + b * (y % tile) as f32 / 60.0;
                    if draw() < 0.01 { 0.0 } else { z + 0.002 * (draw() - 0.5) }
                })
                .collect();
            let noise = NoiseModel::of([Profile::Structured, Profile::TofPhone, Profile::Ideal][profile]);
            let params = Params { noise, ..Params::default() };
            let pose = Isometry3::identity();
            let view = DepthView { depth: &depth, intrinsics: camera, world_from_camera: pose, time: 0.0 };
            let mut frame = Frame::default();
            frame.shrink(&view, &params);
            frame.segment(&params, 1, &mut |_| ());
            for i in 0..frame.edge.len() {
                if let Some(edge) = is_edge(&frame, &params, i) {
                    prop_assert_eq!(frame.edge[i] & EDGE != 0, edge, "pixel {}", i);
                }
                prop_assert_eq!(frame.edge[i] & NO_PLANE != 0, frame.smooth[i] == 0.0, "pixel {}", i);
            }
        }
    }
}
