//! Axis-aligned boxes.

use crate::Error;
use nalgebra::{Isometry3, Point3, Vector3};
use std::f32::consts::FRAC_PI_2;

/// Coordinates beyond this are refused, metres.
const MAX_COORDINATE: f32 = 1e6;

/// An axis-aligned box: centroid and full side lengths, metres. All numbers are finite and no side
/// is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    centroid: Point3<f32>,
    extent: Vector3<f32>,
    footprint: Maybe,
}

/// A footprint that may not be known, in no more than its numbers: the yaw of none is no number.
#[derive(Clone, Copy)]
struct Maybe(Footprint);

impl Maybe {
    fn of(f: Option<Footprint>) -> Self {
        Self(f.unwrap_or(Footprint { sides: [0.0; 2], yaw: f32::NAN }))
    }

    fn get(self) -> Option<Footprint> {
        (!self.0.yaw.is_nan()).then_some(self.0)
    }
}

impl PartialEq for Maybe {
    fn eq(&self, other: &Self) -> bool {
        self.get() == other.get()
    }
}

impl std::fmt::Debug for Maybe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.get().fmt(f)
    }
}

/// The rectangle on the ground, about the centroid, that holds an object tighter than its axis-aligned
/// box where the object is turned: what a change of frame goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Side lengths, metres.
    pub sides: [f32; 2],
    /// Angle from x to the first side, radians, 0 to a quarter turn.
    pub yaw: f32,
}

impl Footprint {
    /// Half of the sides' extents along x and y after a turn.
    fn half(&self, turn: f32) -> [f32; 2] {
        let (sin, cos) = (self.yaw + turn).sin_cos();
        let [l, w] = self.sides;
        [(l * cos.abs() + w * sin.abs()) / 2.0, (l * sin.abs() + w * cos.abs()) / 2.0]
    }

    fn turned(&self, turn: f32) -> Self {
        let quarters = ((self.yaw + turn) / FRAC_PI_2).floor();
        let yaw = (self.yaw + turn - quarters * FRAC_PI_2).clamp(0.0, FRAC_PI_2);
        let [l, w] = self.sides;
        Self { sides: if quarters.rem_euclid(2.0) == 0.0 { [l, w] } else { [w, l] }, yaw }
    }
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
        Ok(Self { centroid: plus(centroid).into(), extent: plus(extent).into(), footprint: Maybe::of(None) })
    }

    /// The same box with a footprint.
    ///
    /// # Errors
    /// Sides that are negative or beyond 1e6 m, a yaw outside 0 to a quarter turn.
    pub fn with_footprint(self, footprint: Footprint) -> Result<Self, Error> {
        if footprint.sides.iter().any(|s| !(0.0..=MAX_COORDINATE).contains(s)) {
            return Err(Error::value(
                "footprint",
                format!("{:?}, want sides of 0 to 1e6 m", footprint.sides),
            ));
        }
        if !(0.0..=FRAC_PI_2).contains(&footprint.yaw) {
            return Err(Error::value(
                "footprint",
                format!("yaw {}, want 0 to a quarter turn", footprint.yaw),
            ));
        }
        Ok(Self { footprint: Maybe::of(Some(footprint)), ..self })
    }

    /// The footprint, if one is known.
    #[must_use]
    pub fn footprint(&self) -> Option<Footprint> {
        self.footprint.get()
    }

    /// Diagonal of the footprint, or of the box seen from above.
    #[must_use]
    pub fn ground_diagonal(&self) -> f32 {
        let [l, w] = self.footprint().map_or([self.extent.x, self.extent.y], |f| f.sides);
        l.hypot(w)
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
        let centroid = nalgebra::center(&lo, &hi);
        Self { centroid, extent: hi - lo, footprint: Maybe::of(self.footprint_of_both(other, &centroid)) }
    }

    /// A footprint about a centre that holds those of both, along this one's sides.
    pub(crate) fn footprint_of_both(&self, other: &Self, centre: &Point3<f32>) -> Option<Footprint> {
        let (a, b) = (self.footprint()?, other.footprint()?);
        let (sin, cos) = a.yaw.sin_cos();
        let reach = |c: &Point3<f32>, half: [f32; 2]| {
            let (dx, dy) = (c.x - centre.x, c.y - centre.y);
            [(dx * cos + dy * sin).abs() + half[0], (dy * cos - dx * sin).abs() + half[1]]
        };
        let (p, q) = (reach(&self.centroid, a.half(-a.yaw)), reach(&other.centroid, b.half(-a.yaw)));
        Some(Footprint { sides: [0, 1].map(|k| 2.0 * p[k].max(q[k])), yaw: a.yaw })
    }

    /// As [`Self::footprint_of_both`], no side longer than the longer one of both.
    pub(crate) fn footprint_of_longer(&self, other: &Self, centre: &Point3<f32>) -> Option<Footprint> {
        let (a, b) = (self.footprint()?, other.footprint()?);
        let longer = b.half(-a.yaw).map(|h| 2.0 * h);
        let both = self.footprint_of_both(other, centre)?;
        Some(Footprint { sides: [0, 1].map(|k| both.sides[k].min(a.sides[k].max(longer[k]))), ..both })
    }

    /// The box around this box after a rigid motion. A turn by anything but a multiple of 90 degrees
    /// makes it larger, unless a footprint says how the object lies.
    #[must_use]
    pub fn transformed(&self, t: &Isometry3<f32>) -> Self {
        if *t == Isometry3::identity() {
            return *self;
        }
        let r = t.rotation.to_rotation_matrix();
        let mut extent = r.matrix().abs() * self.extent;
        // Upright motions keep the footprint; others tilt it out of the ground.
        let upright = r.matrix()[(2, 2)] > 0.9999;
        let turn = r.matrix()[(1, 0)].atan2(r.matrix()[(0, 0)]);
        let footprint = self.footprint().filter(|_| upright).map(|f| f.turned(turn));
        if let Some(f) = footprint {
            let [x, y] = f.half(0.0);
            (extent.x, extent.y) = (extent.x.min(2.0 * x), extent.y.min(2.0 * y));
        }
        Self { centroid: t * self.centroid, extent, footprint: Maybe::of(footprint) }
    }
}
