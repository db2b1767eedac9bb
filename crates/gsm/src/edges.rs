//! Edges: concave creases and steps between the smoothed surfaces on the two sides of a pixel.

use crate::Params;
use crate::frame::{BAND, Frame};
use crate::lanes::{LANES, Lanes, load, same, wide};
use rayon::prelude::*;

/// Writes `edge`. A pixel is an edge when it has no normal, when a link to one of its four neighbours is broken,
/// or when the points on both sides of it, along row or column at the window's reach, form a concave crease
/// (`(N₂ − N₁)·(P₂ − P₁) < 0`, after Stein et al. 2014) or a step.
pub(crate) fn edges(frame: &mut Frame, params: &Params) {
    let mut edge = std::mem::take(&mut frame.edge);
    let test = Test { frame, crease: params.concave_angle.cos(), steps: params.step_sigmas };
    let w = frame.width;
    edge.par_chunks_mut(BAND * w).enumerate().for_each(|(b, edge)| {
        wide(
            #[inline(always)]
            || {
                for (y, edge) in edge.chunks_exact_mut(w).enumerate() {
                    test.row(b * BAND + y, edge);
                }
            },
        );
    });
    frame.edge = edge;
}

/// Normal (three), depth and ray (two) of eight pixels on either side.
type Sides = [[Lanes; 6]; 2];

struct Test<'a> {
    frame: &'a Frame,
    /// Cosine of the angle of a crease.
    crease: f32,
    /// Sigmas of a step.
    steps: f32,
}

impl Test<'_> {
    #[inline(always)]
    fn row(&self, y: usize, edge: &mut [u8]) {
        let w = edge.len();
        let row = y * w;
        let (mut along, mut across);
        for (x, edge) in edge.chunks_mut(LANES).enumerate().map(|(c, e)| (c * LANES, e)) {
            (along, across) = ([0; LANES], [0; LANES]);
            self.reach(row + x, &mut along[..edge.len()], &mut across[..edge.len()]);
            let (k, m) = (u64::from_le_bytes(along), u64::from_le_bytes(across));
            if k == 0 || m == 0 {
                edge.fill(1);
                continue;
            }
            let (own, tight) = (load(&self.frame.smooth, row + x), load(&self.frame.tight, row + x));
            let sides = match (same(k), same(m)) {
                (Some(k), Some(m)) if edge.len() == LANES => self.sides_alike([x, y], [k, m]),
                _ => self.sides([x, y], along, across),
            };
            let hit = sides.map(|s| self.creased(&s, &tight));
            for (j, e) in edge.iter_mut().enumerate() {
                let broken = (along[j] == 0) | (across[j] == 0) | (own[j] == 0.0);
                *e = u8::from(broken | hit[0][j] | hit[1][j]);
            }
        }
    }

    /// The distances at which the sides of the pixels from `i` on are compared along row and column; 0 where a link
    /// is broken.
    #[inline(always)]
    fn reach(&self, i: usize, along: &mut [u8], across: &mut [u8]) {
        let n = i..i + along.len();
        let [l, r, u, d] = self.frame.arms.each_ref().map(|a| &a[n.clone()]);
        let reach = &self.frame.reach[n];
        for (j, (along, across)) in along.iter_mut().zip(across).enumerate() {
            let (a, b) = (l[j].min(r[j]), u[j].min(d[j]));
            let open = if a.min(b) == 0 { 0 } else { reach[j] };
            (*along, *across) = (a.min(open), b.min(open));
        }
    }

    /// Both sides along the row and along the column of eight pixels, at the same distances.
    #[inline(always)]
    fn sides_alike(&self, [x, y]: [usize; 2], [k, m]: [usize; 2]) -> [Sides; 2] {
        let f = self.frame;
        let i = y * f.width + x;
        let side = |i: usize, ray_x: Lanes, ray_y: f32| {
            let [nx, ny, nz] = f.normal.each_ref().map(|n| load(n, i));
            [nx, ny, nz, load(&f.smooth, i), ray_x, [ray_y; LANES]]
        };
        let (a, b, own) = (load(&f.ray_x, x - k), load(&f.ray_x, x + k), load(&f.ray_x, x));
        let row = [side(i - k, a, f.ray_y[y]), side(i + k, b, f.ray_y[y])];
        let (up, down) = (i - m * f.width, i + m * f.width);
        [row, [side(up, own, f.ray_y[y - m]), side(down, own, f.ray_y[y + m])]]
    }

    /// The same at any distances.
    #[inline(always)]
    fn sides(&self, [x, y]: [usize; 2], along: [u8; LANES], across: [u8; LANES]) -> [Sides; 2] {
        let f = self.frame;
        let mut sides = [[[[0.0; LANES]; 6]; 2]; 2];
        let lanes = LANES.min(f.width - x);
        for j in 0..lanes {
            let (k, m, x) = (along[j] as usize, across[j] as usize, x + j);
            let i = y * f.width + x;
            let mut side = |d: usize, s: usize, i: usize, x: usize, y: usize| {
                let [nx, ny, nz] = f.normal(i);
                for (to, v) in sides[d][s].iter_mut().zip([nx, ny, nz, f.smooth[i], f.ray_x[x], f.ray_y[y]]) {
                    to[j] = v;
                }
            };
            side(0, 0, i - k, x - k, y);
            side(0, 1, i + k, x + k, y);
            side(1, 0, i - m * f.width, x, y - m);
            side(1, 1, i + m * f.width, x, y + m);
        }
        sides
    }

    /// Whether the surface bends inwards or steps between the two sides of each pixel.
    #[inline(always)]
    fn creased(&self, [a, b]: &Sides, tight: &Lanes) -> [bool; LANES] {
        let mut hit = [false; LANES];
        for j in 0..LANES {
            let (n1, n2) = ([a[0][j], a[1][j], a[2][j]], [b[0][j], b[1][j], b[2][j]]);
            let (z1, z2) = (a[3][j], b[3][j]);
            let across = [z2 * b[4][j] - z1 * a[4][j], z2 * b[5][j] - z1 * a[5][j], z2 - z1];
            let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let bent = dot(n1, n2) < self.crease;
            let inwards = dot([n2[0] - n1[0], n2[1] - n1[1], n2[2] - n1[2]], across) < 0.0;
            let mean = [n1[0] + n2[0], n1[1] + n2[1], n1[2] + n2[2]];
            // height > step + |across| / 20, without the root.
            let excess = 0.5 * dot(mean, across).abs() - self.steps * tight[j];
            let stepped = (excess > 0.0) & (400.0 * excess * excess > dot(across, across));
            hit[j] = (z1 != 0.0) & (z2 != 0.0) & ((bent & inwards) | (!bent & stepped));
        }
        hit
    }
}
