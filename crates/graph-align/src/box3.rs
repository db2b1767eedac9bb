//! Axis-aligned boxes.

use crate::Error;
use nalgebra::{Isometry3, Point3, Vector3};

/// Coordinates beyond this are refused, metres.
const MAX_COORDINATE: f32 = 1e6;

/// An axis-aligned box: centroid and full side lengths, metres. All numbers are finite and no side
/// is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    centroid: Point3<f32>,
    extent: Vector3<f32>,
}

impl Box3 {
    /// From centroid and full side lengths.
    ///
    /// # Errors
    /// Numbers that are not finite, beyond 1e6 m, or negative sides.
    pub fn new(centroid: [f32; 3], extent: [f32; 3]) -> Result<Self, Error> {
        if let Some(c) = centroid.iter().find(|c| !c.is_finite() || c.abs() > MAX_COORDINATE) {
            return Err(Error::value("centroid", format!("{c}, want a finite number below 1e6 m")));
        }
        if let Some(e) = extent.iter().find(|e| !(0.0..=MAX_COORDINATE).contains(*e)) {
            return Err(Error::value("extent", format!("{e}, want 0 to 1e6 m")));
        }
        // -0 would make equal boxes differ in their bytes.
        let plus = |v: [f32; 3]| v.map(|x| x + 0.0);
        Ok(Self { centroid: plus(centroid).into(), extent: plus(extent).into() })
    }

    /// Centre.
    #[must_use]
    pub fn centroid(&self) -> Point3<f32> {
        self.centroid
    }

    /// Full side lengths.
    #[must_use]
    pub fn extent(&self) -> Vector3<f32> {
        self.extent
    }

    /// Smallest corner.
    #[must_use]
    pub fn min(&self) -> Point3<f32> {
        self.centroid - self.extent / 2.0
    }

    /// Largest corner.
    #[must_use]
    pub fn max(&self) -> Point3<f32> {
        self.centroid + self.extent / 2.0
    }

    /// Distance of the centres.
    #[must_use]
    pub fn distance(&self, other: &Self) -> f32 {
        (self.centroid - other.centroid).norm()
    }

    /// Volume shared over volume of the union; 0 where both are flat.
    ///
    /// ```
    /// use graph_align::Box3;
    /// let a = Box3::new([0.0; 3], [1.0; 3])?;
    /// let b = Box3::new([0.25, 0.0, 0.0], [1.0; 3])?;
    /// assert!((a.iou(&b) - 0.6).abs() < 1e-6); // (a - d) / (a + d)
    /// # Ok::<(), graph_align::Error>(())
    /// ```
    #[must_use]
    pub fn iou(&self, other: &Self) -> f32 {
        let (a, b) = (self.min(), self.max());
        let (c, d) = (other.min(), other.max());
        let shared: f32 = (0..3).map(|k| (b[k].min(d[k]) - a[k].max(c[k])).max(0.0)).product();
        let both = self.extent.product() + other.extent.product() - shared;
        if both > 0.0 { shared / both } else { 0.0 }
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        let (lo, hi) = (self.min().inf(&other.min()), self.max().sup(&other.max()));
        Self { centroid: nalgebra::center(&lo, &hi), extent: hi - lo }
    }

    /// The box around this box after a rigid motion. Turning by anything but a multiple of 90
    /// degrees makes it larger.
    #[must_use]
    pub fn transformed(&self, t: &Isometry3<f32>) -> Self {
        if *t == Isometry3::identity() {
            return *self;
        }
        let r = t.rotation.to_rotation_matrix();
        let extent = r.matrix().abs() * self.extent;
        Self { centroid: t * self.centroid, extent }
    }
}
