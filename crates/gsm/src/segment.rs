//! Read access to the segments and surfels of a map.

use crate::event::SegmentId;
use crate::map::Map;
use crate::moments::Moments;
use crate::segments::Record;
use nalgebra::{Point3, Vector3};

/// One surfel, world frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surfel {
    /// Centre.
    pub position: Point3<f32>,
    /// Unit normal, towards the side it was seen from.
    pub normal: Vector3<f32>,
    /// Radius of its disc.
    pub radius: f32,
    /// Sightings less contradictions, up to 40.
    pub confidence: f32,
    /// Segment, `None` = not labelled.
    pub segment: Option<SegmentId>,
    /// Seen often enough to count.
    pub stable: bool,
}

/// A plane fitted to a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal, towards the side it was seen from.
    pub normal: Vector3<f32>,
    /// `normal · x = offset` on the plane, metres.
    pub offset: f32,
    /// Root mean square distance of the surfels, metres.
    pub rms: f32,
}

/// Axis-aligned box in the world frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Lower corner.
    pub low: Point3<f32>,
    /// Upper corner.
    pub high: Point3<f32>,
}

/// A segment of the map; figures are over its stable surfels.
#[derive(Debug, Clone, Copy)]
pub struct Segment<'a> {
    pub(crate) map: &'a Map,
    pub(crate) record: &'a Record,
}

impl Segment<'_> {
    /// Its name.
    pub fn id(&self) -> SegmentId {
        SegmentId(self.record.id)
    }

    /// Number of stable surfels.
    pub fn surfels(&self) -> u32 {
        self.record.moments.count() as u32
    }

    /// Exact moments about [`Map::origin`].
    pub fn moments(&self) -> &Moments {
        &self.record.moments
    }

    /// Frame of its first sighting (the map's own count).
    pub fn born(&self) -> u32 {
        self.record.born
    }

    /// Mean position.
    pub fn centroid(&self) -> Point3<f32> {
        self.map.origin() + self.record.moments.mean().coords.cast::<f32>()
    }

    /// Standard deviation along the world axes (divided by n − 1), metres.
    pub fn std(&self) -> Vector3<f32> {
        let n = f64::from(self.surfels().max(2));
        let d = self.record.moments.covariance().diagonal();
        d.map(|v| (v.max(0.0) * n / (n - 1.0)).sqrt() as f32)
    }

    /// Least-squares plane.
    pub fn plane(&self) -> Plane {
        let (axis, rms) = self.record.moments.plane();
        let axis = axis.cast::<f32>();
        let facing: f32 = self.sample(64).iter().map(|(_, n)| n.dot(&axis)).sum();
        let normal = if facing < 0.0 { -axis } else { axis };
        Plane { normal, offset: normal.dot(&self.centroid().coords), rms: rms as f32 }
    }

    /// Area of the surfels' discs, m²; an estimate that counts overlapping discs twice.
    pub fn area(&self) -> f32 {
        self.stable().map(|id| 2.0 * self.map.store.surfels.radius(id).powi(2)).sum()
    }

    /// Box between the 0.5 % and 99.5 % quantiles of the surfels along each world axis; `None` when empty.
    pub fn aabb(&self) -> Option<Aabb> {
        let mut axes = [const { Vec::new() }; 3];
        for id in self.stable() {
            for (axis, v) in axes.iter_mut().zip(self.map.store.surfels.position(id)) {
                axis.push(v);
            }
        }
        let n = axes[0].len();
        if n == 0 {
            return None;
        }
        let cut = n / 200;
        let span = axes.map(|mut v| {
            let low = *v.select_nth_unstable_by(cut, f32::total_cmp).1;
            let high = *v.select_nth_unstable_by(n - 1 - cut, f32::total_cmp).1;
            (low, high)
        });
        Some(Aabb { low: Point3::from(span.map(|s| s.0)), high: Point3::from(span.map(|s| s.1)) })
    }

    /// Up to `n` stable surfels as (position, normal), spread evenly over the member list; the same for the same
    /// history.
    pub fn sample(&self, n: usize) -> Vec<(Point3<f32>, Vector3<f32>)> {
        let all = self.surfels() as usize;
        let n = n.min(all);
        let (mut taken, mut passed) = (0, 0);
        let mut points = Vec::with_capacity(n);
        for id in self.stable() {
            // Member `passed` is taken when it crosses the next multiple of all / n.
            if taken < n && passed * n >= taken * all {
                let hot = self.map.store.surfels.hot(id);
                points.push((Point3::from(hot.position), Vector3::from(hot.normal)));
                taken += 1;
            }
            passed += 1;
        }
        points
    }

    fn stable(&self) -> impl Iterator<Item = u32> + '_ {
        let surfels = &self.map.store.surfels;
        self.record.members.iter().copied().filter(|&id| surfels.is_stable(id))
    }
}
