//! All knobs, flat, with their defaults.

use crate::{Error, NoiseModel, Tracking};

/// Parameters of a [`Map`](crate::Map). One default serves all sensors; only `noise` names the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Params {
    /// The sensor (default structured light).
    pub noise: NoiseModel,
    /// The image is halved until it has at most so many pixels (default 40 000: 640×480 is worked at 160×120,
    /// 224×172 natively).
    pub max_pixels: u32,
    /// The map learns one measurement per pixel, or per block of 2×2, 4×4, ... pixels while they are more than this
    /// (default 40 000): a surfel stands for a block.
    pub max_samples: u32,
    /// Depth nearer than this is invalid, metres (default 0.3).
    pub min_depth: f32,
    /// Depth beyond this is invalid, metres (default 5).
    pub max_depth: f32,
    /// Wanted standard error of normals, radians (default 0.07): windows grow until it is met.
    pub normal_error: f32,
    /// A concave crease of more than this angle is an edge, radians (default 0.30).
    pub concave_angle: f32,
    /// A step of more than this many sigmas between smoothed neighbours is an edge (default 5).
    pub step_sigmas: f32,
    /// A frame region of fewer samples is not a region (default 16).
    pub min_region_pixels: u32,
    /// A point belongs to a surfel within this many sigmas along the normal (default 3).
    pub gate_sigmas: f32,
    /// Allowance for pose and calibration errors, added to every gate, metres (default 0.01).
    pub pose_error: f32,
    /// Least cosine between the normals of a point and its surfel (default 0.7).
    pub gate_normal_cos: f32,
    /// Surfaces seen more obliquely than this cosine are not fused (default 0.2).
    pub min_incidence_cos: f32,
    /// Surfels are not set closer than three quarters of this, metres (default 0.012).
    pub min_spacing: f32,
    /// Sightings that make a surfel stable (default 3).
    pub stable_sightings: u32,
    /// An unstable surfel that was not seen for so many frames is removed (default 15).
    pub unstable_frames: u32,
    /// A region takes a segment's id when the segment holds this share of its labelled pixels (default 0.3).
    pub take_share: f32,
    /// Two segments merge when this share of their common border is joined in the frames (default 0.6).
    pub merge_share: f32,
    /// The least number of border pixels, summed over frames, before a merge is considered (default 40).
    pub merge_border: f32,
    /// Side of a brick of the map and of a cell of the visibility grid, metres (default 0.25).
    pub brick: f32,
    /// Most surfels that are kept; new ones are refused and counted beyond (default 24 million).
    pub max_surfels: u32,
    /// Most bricks that are kept; new ones are refused and counted beyond (default 1 million).
    pub max_bricks: u32,
    /// A step of the camera between two frames of more than this is reported as a jump, metres (default 0.7).
    pub jump: f32,
    /// Whether poses that drift are corrected by what the map knows (default off); see
    /// [`Map::correction`](crate::Map::correction).
    pub tracking: Tracking,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            noise: NoiseModel::default(),
            max_pixels: 40_000,
            max_samples: 40_000,
            min_depth: 0.3,
            max_depth: 5.0,
            normal_error: 0.07,
            concave_angle: 0.30,
            step_sigmas: 5.0,
            min_region_pixels: 16,
            gate_sigmas: 3.0,
            pose_error: 0.01,
            gate_normal_cos: 0.7,
            min_incidence_cos: 0.2,
            min_spacing: 0.012,
            stable_sightings: 3,
            unstable_frames: 15,
            take_share: 0.3,
            merge_share: 0.6,
            merge_border: 40.0,
            brick: 0.25,
            max_surfels: 24_000_000,
            max_bricks: 1_000_000,
            jump: 0.7,
            tracking: Tracking::Off,
        }
    }
}

impl Params {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Params`] names the first field out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let real = [
            ("noise.scale", self.noise.scale, 0.01, 100.0),
            ("min_depth", self.min_depth, 0.01, 10.0),
            ("max_depth", self.max_depth, 0.1, 50.0),
            ("normal_error", self.normal_error, 0.001, 1.0),
            ("concave_angle", self.concave_angle, 0.01, 3.0),
            ("step_sigmas", self.step_sigmas, 0.5, 100.0),
            ("gate_sigmas", self.gate_sigmas, 0.5, 100.0),
            ("pose_error", self.pose_error, 0.0, 1.0),
            ("gate_normal_cos", self.gate_normal_cos, 0.0, 1.0),
            ("min_incidence_cos", self.min_incidence_cos, 0.0, 1.0),
            ("min_spacing", self.min_spacing, 0.0005, 1.0),
            ("take_share", self.take_share, 0.01, 1.0),
            ("merge_share", self.merge_share, 0.01, 1.0),
            ("merge_border", self.merge_border, 1.0, 1e6),
            ("brick", self.brick, 0.05, 2.0),
            ("jump", self.jump, 0.01, 1e6),
        ];
        for (field, value, low, high) in real {
            if !(value >= low && value <= high) {
                let expected = "a finite value in the documented range";
                return Err(Error::Params { field, value: f64::from(value), expected });
            }
        }
        let count = [
            ("max_pixels", self.max_pixels),
            ("max_samples", self.max_samples),
            ("min_region_pixels", self.min_region_pixels),
            ("stable_sightings", self.stable_sightings),
            ("unstable_frames", self.unstable_frames),
            ("max_surfels", self.max_surfels),
            ("max_bricks", self.max_bricks),
        ];
        for (field, value) in count {
            if value == 0 || value > 1 << 30 {
                return Err(Error::Params { field, value: f64::from(value), expected: "1 to 2^30" });
            }
        }
        if let Tracking::Upright(up) = self.tracking
            && !(1e-3..1e3).contains(&up.iter().map(|v| v * v).sum::<f32>())
        {
            let (field, value) = ("tracking", f64::from(up[2]));
            return Err(Error::Params { field, value, expected: "a direction that is not zero" });
        }
        if self.min_depth >= self.max_depth {
            let value = f64::from(self.min_depth);
            return Err(Error::Params { field: "min_depth", value, expected: "less than max_depth" });
        }
        Ok(())
    }
}
