//! Where the surfels of a block fall in the image.

use crate::associate::Pose;
use crate::lanes::{whole, wide};
use crate::surfels::{BLOCK, HotBlock};
use crate::{Intrinsics, Params};

/// A camera at a pose, shifted by half a pixel so that truncation rounds to the nearest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lens<'a> {
    pub(crate) pose: &'a Pose,
    near: f32,
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    width: f32,
    height: f32,
}

/// A block as the camera sees it.
#[derive(Debug)]
pub(crate) struct Seen {
    /// Live surfels within the image, a bit each; the rest is valid for these only.
    pub(crate) inside: u32,
    /// Surfels that wait for their removal.
    pub(crate) doomed: u32,
    /// Positions and normals, camera frame.
    pub(crate) point: [[f32; BLOCK]; 3],
    pub(crate) normal: [[f32; BLOCK]; 3],
    /// Columns and rows.
    pub(crate) x: [u32; BLOCK],
    pub(crate) y: [u32; BLOCK],
}

impl<'a> Lens<'a> {
    pub(crate) fn new(c: &Intrinsics, pose: &'a Pose, params: &Params) -> Self {
        let (width, height) = (c.width() as f32, c.height() as f32);
        let (cx, cy) = (c.cx() + 0.5, c.cy() + 0.5);
        Self { pose, near: params.min_depth, fx: c.fx(), fy: c.fy(), cx, cy, width, height }
    }

    /// Projects a block.
    #[inline]
    pub(crate) fn project(&self, hot: &HotBlock) -> Seen {
        wide(
            #[inline(always)]
            || self.lanes(hot),
        )
    }

    #[inline(always)]
    fn lanes(&self, hot: &HotBlock) -> Seen {
        // Copies on the stack, which the compiler knows to be apart.
        let Self { pose, near, fx, fy, cx, cy, width, height } = *self;
        let pose = *pose;
        let HotBlock { position, normal, radius, .. } = *hot;
        let (mut inside, mut doomed) = ([0u32; BLOCK], [0u32; BLOCK]);
        let (mut point, mut turned) = ([[0.0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
        let (mut x, mut y) = ([0; BLOCK], [0; BLOCK]);
        for k in 0..BLOCK {
            let p = pose.view([position[0][k], position[1][k], position[2][k]]);
            let n = pose.unturn([normal[0][k], normal[1][k], normal[2][k]]);
            let inverse = 1.0 / p[2];
            let u = fx * p[0] * inverse + cx;
            let v = fy * p[1] * inverse + cy;
            let within = (p[2] >= near) & (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height);
            inside[k] = u32::from(within & (radius[k] > 0.0)) << k;
            doomed[k] = u32::from(radius[k] < 0.0) << k;
            (x[k], y[k]) = (whole(u), whole(v));
            (point[0][k], point[1][k], point[2][k]) = (p[0], p[1], p[2]);
            (turned[0][k], turned[1][k], turned[2][k]) = (n[0], n[1], n[2]);
        }
        let (mut some, mut gone) = (0, 0);
        for k in 0..BLOCK {
            some |= inside[k];
            gone |= doomed[k];
        }
        Seen { inside: some, doomed: gone, point, normal: turned, x, y }
    }
}

impl Seen {
    /// Position of a surfel, camera frame.
    #[inline]
    pub(crate) fn point(&self, k: usize) -> [f32; 3] {
        [self.point[0][k], self.point[1][k], self.point[2][k]]
    }

    /// Normal of a surfel, camera frame.
    #[inline]
    pub(crate) fn normal(&self, k: usize) -> [f32; 3] {
        [self.normal[0][k], self.normal[1][k], self.normal[2][k]]
    }
}

/// The set bits, lowest first.
pub(crate) fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = mask.trailing_zeros() as usize;
        (mask != 0).then(|| {
            mask &= mask - 1;
            bit
        })
    })
}
