//! One depth image with its camera and pose.

use crate::Error;
use nalgebra::{Isometry3, Point3};

/// Largest width or height of an image that is accepted, in pixels.
pub const MAX_SIDE: u32 = 4096;

/// A pinhole camera without distortion; pixel centres are at integer coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length along the image's x axis, pixels.
    pub fx: f32,
    /// Focal length along the image's y axis, pixels.
    pub fy: f32,
    /// Principal point, pixels.
    pub cx: f32,
    /// Principal point, pixels.
    pub cy: f32,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
}

impl Intrinsics {
    /// Checks that the focal lengths are positive, everything is finite and the image has a size
    /// of 1 to [`MAX_SIDE`] a side.
    ///
    /// # Errors
    /// [`Error::Value`] naming the first field out of range.
    pub fn new(fx: f32, fy: f32, cx: f32, cy: f32, width: u32, height: u32) -> Result<Self, Error> {
        for (field, f) in [("fx", fx), ("fy", fy)] {
            if !(f.is_finite() && f > 0.0) {
                return Err(Error::Value {
                    field,
                    problem: format!("focal length {f}, want a positive number"),
                });
            }
        }
        for (field, c) in [("cx", cx), ("cy", cy)] {
            if !c.is_finite() {
                return Err(Error::Value {
                    field,
                    problem: format!("principal point {c}, want a finite number"),
                });
            }
        }
        for (field, n) in [("width", width), ("height", height)] {
            if n == 0 || n > MAX_SIDE {
                return Err(Error::Value { field, problem: format!("{n} pixels, want 1 to {MAX_SIDE}") });
            }
        }
        Ok(Self { fx, fy, cx, cy, width, height })
    }

    /// Number of pixels.
    #[must_use]
    pub fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Never true: an image has at least one pixel.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The point in the camera frame (x right, y down, z forward) at pixel (u, v) and depth z, metres.
    #[must_use]
    pub fn unproject(&self, u: f32, v: f32, z: f32) -> Point3<f32> {
        Point3::new((u - self.cx) / self.fx * z, (v - self.cy) / self.fy * z, z)
    }
}

/// One depth image. Depth is measured along the optical axis.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The number in the file's name; gaps are kept.
    pub index: u32,
    /// Seconds since the start of the recording.
    pub time: f64,
    /// Metres, row-major, `intrinsics.len()` values; 0 = no measurement.
    pub depth: Vec<f32>,
    /// The camera.
    pub intrinsics: Intrinsics,
    /// Camera points to the world of the recording; `None` where the recording has no valid pose.
    pub world_from_camera: Option<Isometry3<f32>>,
}
