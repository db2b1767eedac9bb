//! The maps of one frame at working resolution, reused from frame to frame.

use crate::components::Runs;
use crate::noise::NoiseTable;
use crate::predict::Prediction;
use crate::{DepthView, Intrinsics, Params, Stage};

/// Link of a pixel to its right neighbour is unbroken.
pub(crate) const RIGHT: u8 = 1;
/// Link of a pixel to the one below is unbroken.
pub(crate) const DOWN: u8 = 2;
/// Pixel is a crease, a step or at an image edge: no seed of a region.
pub(crate) const EDGE: u8 = 1;
/// Pixel has no normal.
pub(crate) const NO_PLANE: u8 = 2;

/// Rows per band: bands are worked in parallel, and prefix sums start anew in each, whatever the number of threads.
pub(crate) const BAND: usize = 32;

/// Everything the kernels know about the current frame; images are row-major, camera frame, metres.
#[derive(Debug, Default)]
pub(crate) struct Frame {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) factor: u32,
    pub(crate) camera: Option<Intrinsics>,
    pub(crate) source: Option<Intrinsics>,
    /// Mean pixel width at 1 m.
    pub(crate) spacing: f32,
    /// Ray of column and row: a pixel's point is `z (ray_x, ray_y, 1)`.
    pub(crate) ray_x: Vec<f32>,
    pub(crate) ray_y: Vec<f32>,
    /// Inverse length of each pixel's ray.
    pub(crate) ray_scale: Vec<f32>,
    pub(crate) noise: NoiseTable,
    /// Block-averaged depth, 0 = invalid.
    pub(crate) z: Vec<f32>,
    /// Its inverse (linear over the image on a plane), steadied by prediction, 0 = invalid.
    pub(crate) inverse: Vec<f32>,
    /// Factor on sigma after prediction, 1 = nothing predicted.
    pub(crate) gain: Vec<f32>,
    /// Sigma of the inverse depth.
    pub(crate) slack: Vec<f32>,
    /// [`RIGHT`] and [`DOWN`] bits.
    pub(crate) links: Vec<u8>,
    /// Radius of the window, its reach, and sigma after smoothing.
    pub(crate) radius: Vec<u8>,
    pub(crate) reach: Vec<u8>,
    pub(crate) tight: Vec<f32>,
    /// Unbroken reach left, right, up, down within the window, pixels.
    pub(crate) arms: [Vec<u8>; 4],
    /// Row fit: value and slope of inverse depth, and 1 where the slope is valid.
    pub(crate) row_fit: [Vec<f32>; 3],
    /// Depth of the plane fitted around the pixel, 0 where there is no normal.
    pub(crate) smooth: Vec<f32>,
    /// Unit normal towards the camera, zero = none.
    pub(crate) normal: [Vec<f32>; 3],
    /// Cosine between normal and viewing ray.
    pub(crate) cos: Vec<f32>,
    /// [`EDGE`] and [`NO_PLANE`] bits.
    pub(crate) edge: Vec<u8>,
    /// Region of the pixel, 1.., 0 = none.
    pub(crate) label: Vec<u32>,
    /// Pixels per region; entry 0 counts the unlabelled ones.
    pub(crate) region_size: Vec<u32>,
    pub(crate) valid: usize,
    pub(crate) runs: Runs,
}

impl Frame {
    /// Depth at working resolution.
    pub(crate) fn shrink(&mut self, view: &DepthView<'_>, params: &Params) {
        self.fit(&view.intrinsics, params);
        crate::shrink::shrink(self, view, params);
    }

    /// Takes over what the map predicts.
    pub(crate) fn steady(&mut self, prediction: &Prediction) {
        prediction.steady(&self.z, &mut self.inverse, &mut self.gain);
    }

    /// Runs the image kernels: links, normals, edges, regions; `pitch` is the side of a sample in pixels.
    pub(crate) fn segment(&mut self, params: &Params, pitch: usize, done: &mut impl FnMut(Stage)) {
        crate::links::links(self);
        done(Stage::Links);
        crate::normals::normals(self);
        done(Stage::Normals);
        crate::edges::edges(self, params);
        done(Stage::Edges);
        crate::components::regions(self, params.min_region_pixels.saturating_mul((pitch * pitch) as u32));
        done(Stage::Regions);
    }

    /// Sizes all maps for a camera; cheap when it is the camera of the last frame.
    pub(crate) fn fit(&mut self, source: &Intrinsics, params: &Params) {
        let mut factor = 1;
        while (source.width() / factor) * (source.height() / factor) > params.max_pixels {
            factor *= 2;
        }
        if self.source == Some(*source) && self.factor == factor {
            return;
        }
        let camera = source.shrunk(factor);
        let (w, h) = (camera.width() as usize, camera.height() as usize);
        self.spacing = 0.5 * (1.0 / camera.fx() + 1.0 / camera.fy());
        self.noise =
            NoiseTable::new(&params.noise, factor, self.spacing, params.normal_error, params.max_depth);
        self.ray_x = (0..w).map(|x| (x as f32 - camera.cx()) / camera.fx()).collect();
        self.ray_y = (0..h).map(|y| (y as f32 - camera.cy()) / camera.fy()).collect();
        let n = w * h;
        self.ray_scale = (0..n)
            .map(|i| (self.ray_x[i % w].powi(2) + self.ray_y[i / w].powi(2) + 1.0).sqrt().recip())
            .collect();
        self.z = vec![0.0; n];
        self.inverse = vec![0.0; n];
        self.gain = vec![1.0; n];
        self.slack = vec![0.0; n];
        self.links = vec![0; n];
        self.radius = vec![0; n];
        self.reach = vec![0; n];
        self.tight = vec![0.0; n];
        self.arms = std::array::from_fn(|_| vec![0; n]);
        self.row_fit = std::array::from_fn(|_| vec![0.0; n]);
        self.smooth = vec![0.0; n];
        self.normal = std::array::from_fn(|_| vec![0.0; n]);
        self.cos = vec![0.0; n];
        self.edge = vec![EDGE | NO_PLANE; n];
        self.label = vec![0; n];
        (self.width, self.height, self.factor) = (w, h, factor);
        (self.camera, self.source) = (Some(camera), Some(*source));
    }

    /// Unit normal of a pixel, zero = none.
    #[inline(always)]
    pub(crate) fn normal(&self, i: usize) -> [f32; 3] {
        [self.normal[0][i], self.normal[1][i], self.normal[2][i]]
    }
}

/// Scalar product.
#[inline(always)]
pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Difference `a − b`.
#[inline(always)]
pub(crate) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
