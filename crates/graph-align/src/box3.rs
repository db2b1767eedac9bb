//! Axis-aligned boxes.

use crate::{Error, Footprint};
use nalgebra::{Isometry3, Point3, Vector3};

/// Coordinates beyond this are refused, metres.
const MAX_COORDINATE: f32 = 1e6;

/// An axis-aligned box: centroid and full side lengths, metres. All numbers are finite and no side
/// is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    centroid: Point3<f32>,
    extent: Vector3<f32>,
    footprint: Option<Footprint>,
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
        Ok(Self { centroid: plus(centroid).into(), extent: plus(extent).into(), footprint: None })
    }

    /// The same box with a footprint.
    ///
    /// # Errors
    /// Reaches that are not finite, beyond 1e6 m or behind the line across, a yaw outside 0 to a quarter turn.
    pub fn with_footprint(self, footprint: Footprint) -> Result<Self, Error> {
        footprint.check(MAX_COORDINATE)?;
        // As above: no -0.
        let reach = footprint.reach.map(|r| r + 0.0);
        Ok(Self { footprint: Some(Footprint { reach, ..footprint }), ..self })
    }

    /// Of numbers that were those of a box.
    pub(crate) fn again(centroid: Point3<f32>, extent: Vector3<f32>, footprint: Option<Footprint>) -> Self {
        Self { centroid, extent, footprint }
    }

    /// The footprint, if one is known.
    #[must_use]
    pub fn footprint(&self) -> Option<Footprint> {
        self.footprint
    }

    /// Diagonal of the footprint, or of the box seen from above.
    #[must_use]
    pub fn ground_diagonal(&self) -> f32 {
        let [l, w] = self.footprint().map_or([self.extent.x, self.extent.y], |f| f.sides());
        l.hypot(w)
    }

    /// Centre.
    #[must_use]
    pub fn centroid(&self) -> Point3<f32> {
        self.centroid
    }

    /// Middle of the footprint's rectangle at the height of the centre, or the centre where no footprint is known: the
    /// one goes with the object when it turns, the other is that of the box in one frame.
    #[must_use]
    pub fn middle(&self) -> Point3<f32> {
        let [x, y] = self.footprint().map_or([0.0; 2], |f| f.middle());
        self.centroid + Vector3::new(x, y, 0.0)
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
        let both = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a.min(c), b.max(d)];
        Self { centroid: nalgebra::center(&lo, &hi), extent: hi - lo, footprint: None }
            .with_footprint_of(self, other, both)
    }

    /// With the footprint that `span` makes, along each of the first one's directions, of what two boxes take up; with
    /// none if one of them has none.
    pub(crate) fn with_footprint_of(
        self,
        first: &Self,
        other: &Self,
        span: impl Fn([f32; 2], [f32; 2]) -> [f32; 2],
    ) -> Self {
        let (Some(f), Some(g)) = (first.footprint(), other.footprint()) else {
            return Self { footprint: None, ..self };
        };
        let mut out = f;
        for k in 0..4 {
            let angle = f.angle(k);
            let (sin, cos) = angle.sin_cos();
            let at =
                |b: &Self| (b.centroid.x - self.centroid.x) * cos + (b.centroid.y - self.centroid.y) * sin;
            let [low, high] = span(f.span(angle, at(first)), g.span(angle, at(other)));
            (out.reach[k], out.reach[k + 4]) = (high, -low);
        }
        Self { footprint: Some(out.settled()), ..self }
    }

    /// The box around this box after a rigid motion. A turn by anything but a multiple of 90 degrees
    /// makes it larger, unless a footprint says how the object lies.
    #[must_use]
    pub fn transformed(&self, t: &Isometry3<f32>) -> Self {
        if *t == Isometry3::identity() {
            return *self;
        }
        let r = t.rotation.to_rotation_matrix();
        let extent = r.matrix().abs() * self.extent;
        let moved = Self { centroid: t * self.centroid, extent, footprint: None };
        // Upright motions keep the footprint; others tilt it out of the ground.
        let Some(f) = self.footprint().filter(|_| r.matrix()[(2, 2)] > 0.9999) else { return moved };
        let turn = r.matrix()[(1, 0)].atan2(r.matrix()[(0, 0)]);
        let [e, n, w, s] = f.with_box([self.extent.x / 2.0, self.extent.y / 2.0], turn);
        let (x, y) = ((e - w) / 2.0, (n - s) / 2.0);
        Self {
            centroid: moved.centroid + Vector3::new(x, y, 0.0),
            extent: Vector3::new((e + w).max(0.0), (n + s).max(0.0), extent.z),
            footprint: Some(f.turned(turn).seen_from(x, y)),
        }
    }
}
