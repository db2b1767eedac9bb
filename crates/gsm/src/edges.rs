//! Edges: concave creases and steps between the smoothed surfaces on the two sides of a pixel.

use crate::Params;
use crate::frame::{BAND, Frame};
use crate::lanes::{LANES, load, same, wide};
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
        let (mut along, mut across) = ([0u8; LANES], [0u8; LANES]);
        for (x, edge) in edge.chunks_mut(LANES).enumerate().map(|(c, e)| (c * LANES, e)) {
            self.reach(row + x, &mut along[..edge.len()], &mut across[..edge.len()]);
            let (k, m) = (u64::from_le_bytes(along), u64::from_le_bytes(across));
            if k == 0 || m == 0 {
                edge.fill(1);
                continue;
            }
            if edge.len() == LANES
                && let (Some(k), Some(m)) = (same(k), same(m))
            {
                let i = row + x;
                let tight = load(&self.frame.tight, i);
                let own = load(&self.frame.smooth, i);
                let [x1, x2] = [x - k, x + k].map(|x| load(&self.frame.ray_x, x));
                let (ray_x, ray_y) = (load(&self.frame.ray_x, x), self.frame.ray_y[y]);
                let sides = [self.side(i - k), self.side(i + k)];
                let hit = self.creased(sides, [x1, x2], [ray_y, ray_y], tight);
                let sides = [self.side(i - m * w), self.side(i + m * w)];
                let rays = [self.frame.ray_y[y - m], self.frame.ray_y[y + m]];
                let hit2 = self.creased(sides, [ray_x, ray_x], rays, tight);
                for (j, e) in edge.iter_mut().enumerate() {
                    *e = u8::from(hit[j] | hit2[j] | (own[j] == 0.0));
                }
                continue;
            }
            for (j, e) in edge.iter_mut().enumerate() {
                let (i, x) = (row + x + j, x + j);
                let (k, m) = (along[j] as usize, across[j] as usize);
                *e = u8::from(
                    k == 0 || m == 0 || self.frame.smooth[i] == 0.0 || self.creased_at(i, [x, y], [k, m]),
                );
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

    /// Normals and smoothed depths of the eight pixels from `i` on.
    #[inline(always)]
    fn side(&self, i: usize) -> [[f32; LANES]; 4] {
        let [x, y, z] = self.frame.normal.each_ref().map(|n| load(n, i));
        [x, y, z, load(&self.frame.smooth, i)]
    }

    /// One pixel at a time.
    fn creased_at(&self, i: usize, [x, y]: [usize; 2], [k, m]: [usize; 2]) -> bool {
        let f = self.frame;
        let one = |i: usize| {
            let [x, y, z] = f.normal(i);
            [[x], [y], [z], [f.smooth[i]]]
        };
        let (rx, ry, tight) = (&f.ray_x, &f.ray_y, [f.tight[i]]);
        self.creased([one(i - k), one(i + k)], [[rx[x - k]], [rx[x + k]]], [ry[y], ry[y]], tight)[0]
            || self.creased(
                [one(i - m * f.width), one(i + m * f.width)],
                [[rx[x]], [rx[x]]],
                [ry[y - m], ry[y + m]],
                tight,
            )[0]
    }

    /// Whether the surface bends inwards or steps between the two sides of each of `N` pixels, given by normal and
    /// depth, ray columns and ray rows.
    #[inline(always)]
    fn creased<const N: usize>(
        &self,
        [a, b]: [[[f32; N]; 4]; 2],
        [ax, bx]: [[f32; N]; 2],
        [ay, by]: [f32; 2],
        tight: [f32; N],
    ) -> [bool; N] {
        let mut hit = [false; N];
        for j in 0..N {
            let (n1, n2) = ([a[0][j], a[1][j], a[2][j]], [b[0][j], b[1][j], b[2][j]]);
            let (z1, z2) = (a[3][j], b[3][j]);
            let across = [z2 * bx[j] - z1 * ax[j], z2 * by - z1 * ay, z2 - z1];
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
