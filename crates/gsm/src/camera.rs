//! The input: a pinhole camera and one borrowed depth image.

use crate::Error;
use nalgebra::Isometry3;

/// Largest image side that is accepted, in pixels.
pub const MAX_SIDE: u32 = 8192;

/// Pinhole intrinsics in pixels; pixel centres lie at integer coordinates. Valid by construction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    width: u32,
    height: u32,
}

impl Intrinsics {
    /// Checks and stores the values: focal lengths positive and finite, principal point finite, sides in
    /// `1..=`[`MAX_SIDE`].
    ///
    /// # Errors
    /// [`Error::Intrinsics`] names the first field that is not usable.
    pub fn new(fx: f32, fy: f32, cx: f32, cy: f32, width: u32, height: u32) -> Result<Self, Error> {
        let bad = |field, value: f64, expected| Err(Error::Intrinsics { field, value, expected });
        for (field, f) in [("fx", fx), ("fy", fy)] {
            if !(f.is_finite() && f > 1e-3 && f < 1e6) {
                return bad(field, f64::from(f), "a focal length between 0.001 and 1e6 pixels");
            }
        }
        for (field, c) in [("cx", cx), ("cy", cy)] {
            if !(c.is_finite() && c.abs() < 1e6) {
                return bad(field, f64::from(c), "a finite pixel coordinate");
            }
        }
        for (field, side) in [("width", width), ("height", height)] {
            if side == 0 || side > MAX_SIDE {
                return bad(field, f64::from(side), "1 to 8192 pixels");
            }
        }
        Ok(Self { fx, fy, cx, cy, width, height })
    }

    /// Horizontal focal length, pixels.
    pub fn fx(&self) -> f32 {
        self.fx
    }
    /// Vertical focal length, pixels.
    pub fn fy(&self) -> f32 {
        self.fy
    }
    /// Column of the principal point, pixels.
    pub fn cx(&self) -> f32 {
        self.cx
    }
    /// Row of the principal point, pixels.
    pub fn cy(&self) -> f32 {
        self.cy
    }
    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }
    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The camera whose pixels are `factor`×`factor` blocks of this one (whole blocks only, at least one):
    /// `f' = f / k`, `c' = (c + 0.5) / k − 0.5`.
    pub(crate) fn shrunk(&self, factor: u32) -> Self {
        let k = factor as f32;
        Self {
            fx: self.fx / k,
            fy: self.fy / k,
            cx: (self.cx + 0.5) / k - 0.5,
            cy: (self.cy + 0.5) / k - 0.5,
            width: (self.width / factor).max(1),
            height: (self.height / factor).max(1),
        }
    }
}

/// One posed depth image, borrowed from the caller.
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'a> {
    /// Depth along the optical axis in metres, row-major; 0, negative or non-finite = invalid.
    pub depth: &'a [f32],
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Maps camera points (x right, y down, z forward) into the world.
    pub world_from_camera: Isometry3<f32>,
    /// Time of the frame, seconds; only compared with other frames of the same map.
    pub time: f64,
}
