//! Bricks in view, and the coarse grid of what was looked through, seen, or not looked at.

use crate::Intrinsics;
use crate::associate::Pose;
use crate::bricks::Bricks;
use crate::frame::{Frame, dot};
use crate::lanes::{LANES, Lanes, wide};
use crate::store::Step;
use nalgebra::Point3;

/// Answer of [`Visibility::query`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Looked {
    /// The larger part of what was observed of the box was empty when last looked at; the share of the whole box.
    Through(f32),
    /// Surfaces were seen in the box.
    Seen,
    /// Less than a fifth of the box was observed.
    Not,
}

/// Octants of a box by their last observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Seen through.
    pub through: u32,
    /// Holding a surface.
    pub surface: u32,
    /// All octants whose centre lies in the box (at least one).
    pub all: u32,
}

/// One cell of the grid that holds an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Integer coordinates; the cell spans `key * side` to `(key + 1) * side`.
    pub key: [i32; 3],
    /// Octants last seen through; bit = x + 2y + 4z with 1 for the upper half.
    pub through: u8,
    /// Octants last seen holding a surface.
    pub surface: u8,
}

/// The visibility grid of a map: 16 bytes of brick header per observed cell, two bits per octant.
#[derive(Debug, Clone, Copy)]
pub struct Visibility<'a> {
    pub(crate) bricks: &'a Bricks,
}

impl Visibility<'_> {
    /// Side of a cell, metres; observations are per octant, of half this side.
    pub fn side(&self) -> f32 {
        self.bricks.side
    }

    /// Cells with an observation, in order of their key.
    pub fn cells(&self) -> Vec<Cell> {
        let mut cells: Vec<Cell> = self
            .bricks
            .list
            .iter()
            .filter(|b| b.through | b.surface != 0)
            .map(|b| Cell { key: b.key, through: b.through, surface: b.surface })
            .collect();
        cells.sort_unstable_by_key(|c| c.key);
        cells
    }

    /// Counts the octants whose centre lies in the axis-aligned box (world frame, metres); at least the one that
    /// holds the box's centre. A box of more than 2^24 octants, or one that is not finite, counts as unobserved.
    pub fn tally(&self, low: Point3<f32>, high: Point3<f32>) -> Tally {
        let half = 0.5 * self.bricks.side;
        let mut from = [0i64; 3];
        let mut to = [0i64; 3];
        let mut all = 1f64;
        for k in 0..3 {
            // Octant i has its centre at (i + 0.5) half.
            from[k] = (low[k] / half - 0.5).ceil() as i64;
            to[k] = (high[k] / half - 0.5).floor() as i64;
            if to[k] < from[k] {
                from[k] = (0.5 * (low[k] + high[k]) / half).floor() as i64;
                to[k] = from[k];
            }
            all *= (to[k] - from[k] + 1) as f64;
        }
        if !(low.iter().chain(high.iter()).all(|v| v.abs() < 1e6) && all < 16_777_216.0) {
            return Tally { all: 1, ..Tally::default() };
        }
        let mut tally = Tally { all: all as u32, ..Tally::default() };
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    let key = [x, y, z].map(|v| v.div_euclid(2) as i32);
                    let bit = 1u8 << ((x & 1) + 2 * (y & 1) + 4 * (z & 1));
                    if let Some(b) = self.bricks.find(key) {
                        tally.through += u32::from(self.bricks.list[b].through & bit != 0);
                        tally.surface += u32::from(self.bricks.list[b].surface & bit != 0);
                    }
                }
            }
        }
        tally
    }

    /// Whether a box was looked through, seen, or not looked at.
    pub fn query(&self, low: Point3<f32>, high: Point3<f32>) -> Looked {
        let t = self.tally(low, high);
        let (through, surface, all) = (t.through as f32, t.surface as f32, t.all as f32);
        if through + surface < 0.2 * all {
            Looked::Not
        } else if through > surface {
            Looked::Through(through / all)
        } else {
            Looked::Seen
        }
    }
}

/// Lists the bricks that may hold visible surfels, and marks octants in view as seen through or as surface.
/// Returns the number of bricks that could not be made because the map is full.
pub(crate) fn look(step: Step<'_>, bricks: &mut Bricks, visible: &mut Vec<u32>) -> u32 {
    let Step { frame, pose, now, .. } = step;
    visible.clear();
    let far = farthest(&frame.z);
    let side = bricks.side;
    let ball = 0.5 * side * 3f32.sqrt();
    let sides = side_planes(frame);
    let (low, high) = reach(frame, pose, far + ball, side);
    let step = pose.unturn([side, 0.0, 0.0]);
    let mut refused = 0;
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            let first = [low[0], y, z].map(|k| (k as f32 + 0.5) * side);
            let mut c = pose.view(first);
            for x in low[0]..=high[0] {
                let centre = c;
                c = [c[0] + step[0], c[1] + step[1], c[2] + step[2]];
                if centre[2] < -ball
                    || centre[2] > far + ball
                    || sides.iter().any(|&s| dot(s, centre) < -ball)
                {
                    continue;
                }
                let key = [x, y, z];
                let known = bricks.find(key);
                if let Some(b) = known.filter(|&b| !bricks.list[b].blocks.is_empty()) {
                    visible.push(b as u32);
                }
                if (x + y + z + now as i32) & 1 == 0 {
                    refused += u32::from(!mark(frame, pose, bricks, known, key, centre));
                }
            }
        }
    }
    refused
}

/// The largest depth, eight at a time.
fn farthest(z: &[f32]) -> f32 {
    wide(
        #[inline(always)]
        || {
            let mut far = [0.0; LANES];
            let eights = z.chunks_exact(LANES);
            let rest = eights.remainder();
            for eight in eights {
                far.iter_mut().zip(eight).for_each(|(m, &z)| *m = if z > *m { z } else { *m });
            }
            far.iter().chain(rest).fold(0f32, |m, &z| m.max(z))
        },
    )
}

/// Inward normals of the four sides of the view pyramid, camera frame.
fn side_planes(frame: &Frame) -> [[f32; 3]; 4] {
    let half = 0.5 * frame.spacing;
    let (l, r) = (frame.ray_x[0] - half, frame.ray_x[frame.width - 1] + half);
    let (t, b) = (frame.ray_y[0] - half, frame.ray_y[frame.height - 1] + half);
    let unit = |v: [f32; 3]| {
        let n = dot(v, v).sqrt();
        v.map(|c| c / n)
    };
    [unit([1.0, 0.0, -l]), unit([-1.0, 0.0, r]), unit([0.0, 1.0, -t]), unit([0.0, -1.0, b])]
}

/// Keys of the bricks around the view pyramid up to depth `far`; at most 64 per axis.
fn reach(frame: &Frame, pose: &Pose, far: f32, side: f32) -> ([i32; 3], [i32; 3]) {
    let (mut low, mut high) = (pose.centre, pose.centre);
    for x in [frame.ray_x[0], frame.ray_x[frame.width - 1]] {
        for y in [frame.ray_y[0], frame.ray_y[frame.height - 1]] {
            let p = pose.place([x * far, y * far, far]);
            for k in 0..3 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
    }
    let key = |v: f32, k: usize| {
        let home = (pose.centre[k] / side).floor();
        (v / side).floor().clamp(home - 64.0, home + 64.0) as i32
    };
    ([0, 1, 2].map(|k| key(low[k], k) - 1), [0, 1, 2].map(|k| key(high[k], k) + 1))
}

/// Depth, column and row of the middles of a cell's octants.
#[inline(always)]
fn octants(camera: &Intrinsics, axes: [[f32; 3]; 3], centre: [f32; 3]) -> (Lanes, Lanes, Lanes) {
    let mut p = centre.map(|c| [c; LANES]);
    for (k, axis) in axes.iter().enumerate() {
        for (p, &a) in p.iter_mut().zip(axis) {
            for (octant, p) in p.iter_mut().enumerate() {
                *p += if octant >> k & 1 == 1 { a } else { -a };
            }
        }
    }
    let [x, y, z] = p;
    let (mut u, mut v) = ([0.0; LANES], [0.0; LANES]);
    for k in 0..LANES {
        u[k] = camera.fx() * x[k] / z[k] + camera.cx() + 0.5;
        v[k] = camera.fy() * y[k] / z[k] + camera.cy() + 0.5;
    }
    (z, u, v)
}

/// Marks the octants of one cell; false when a needed brick could not be made.
fn mark(
    frame: &Frame,
    pose: &Pose,
    bricks: &mut Bricks,
    known: Option<usize>,
    key: [i32; 3],
    centre: [f32; 3],
) -> bool {
    let Some(camera) = &frame.camera else { return true };
    let quarter = 0.25 * bricks.side;
    let axes = [[quarter, 0.0, 0.0], [0.0, quarter, 0.0], [0.0, 0.0, quarter]].map(|a| pose.unturn(a));
    let (depth, u, v) = wide(
        #[inline(always)]
        || octants(camera, axes, centre),
    );
    let (mut through, mut surface) = (0u8, 0u8);
    for (octant, ((z, u), v)) in depth.into_iter().zip(u).zip(v).enumerate() {
        if z < 0.1 || !(u >= 0.0 && v >= 0.0 && u < frame.width as f32 && v < frame.height as f32) {
            continue;
        }
        let d = frame.z[v as usize * frame.width + u as usize];
        if d > z + 1.75 * quarter + 3.0 * frame.noise.sigma(d) {
            through |= 1 << octant;
        } else if d > 0.0 && (d - z).abs() <= 1.2 * quarter {
            surface |= 1 << octant;
        }
    }
    if through | surface == 0 {
        return true;
    }
    let Some(b) = known.or_else(|| bricks.find_or_make(key)) else { return false };
    let brick = &mut bricks.list[b];
    brick.through = brick.through & !surface | through;
    brick.surface = brick.surface & !through | surface;
    true
}
