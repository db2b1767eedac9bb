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

/// A box that stands upright, world frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UprightBox {
    /// Centre.
    pub centre: Point3<f32>,
    /// Right-handed unit axes; the last one is up.
    pub axes: [Vector3<f32>; 3],
    /// Half of the extents along the axes.
    pub half: [f32; 3],
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
        let [x, y, z] = axes.map(span);
        let span = [x?, y?, z?];
        Some(Aabb { low: Point3::from(span.map(|s| s.0)), high: Point3::from(span.map(|s| s.1)) })
    }

    /// The box of least base that stands along `up` (any length), between the 0.5 % and 99.5 % quantiles of the
    /// surfels; turned in steps of a degree. `None` when empty, or when `up` is no direction.
    pub fn upright_box(&self, up: &Vector3<f32>) -> Option<UprightBox> {
        let up = up.try_normalize(1e-6)?;
        let side = up.cross(&Vector3::ith(up.iamin(), 1.0)).try_normalize(1e-6)?;
        let other = up.cross(&side);
        let points: Vec<[f32; 3]> = self
            .stable()
            .map(|id| Vector3::from(self.map.store.surfels.position(id)))
            .map(|p| [side.dot(&p), other.dot(&p), up.dot(&p)])
            .collect();
        // The turn is found on some of them.
        let some: Vec<_> = points.iter().step_by(points.len() / 500 + 1).copied().collect();
        let base = |points: &[[f32; 3]], degrees: usize| -> Option<[(f32, f32); 2]> {
            let (sin, cos) = (degrees as f32).to_radians().sin_cos();
            let along = span(points.iter().map(|p| cos * p[0] + sin * p[1]).collect())?;
            let across = span(points.iter().map(|p| cos * p[1] - sin * p[0]).collect())?;
            Some([along, across])
        };
        let area = |degrees: &usize| {
            // A wall has no base: its thickness must not decide alone.
            base(&some, *degrees).map_or(f32::INFINITY, |b| b.iter().map(|(l, h)| h - l + 0.02).product())
        };
        let degrees = (0..90).min_by(|a, b| area(a).total_cmp(&area(b)))?;
        let ([along, across], height) =
            (base(&points, degrees)?, span(points.iter().map(|p| p[2]).collect())?);
        let (sin, cos) = (degrees as f32).to_radians().sin_cos();
        let axes = [side * cos + other * sin, other * cos - side * sin, up];
        let spans = [along, across, height];
        let centre = axes.iter().zip(spans).map(|(a, (l, h))| a * (0.5 * (l + h))).sum::<Vector3<f32>>();
        Some(UprightBox { centre: Point3::from(centre), axes, half: spans.map(|(l, h)| 0.5 * (h - l)) })
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

/// The 0.5 % and 99.5 % quantiles of some values.
fn span(mut v: Vec<f32>) -> Option<(f32, f32)> {
    let (n, cut) = (v.len(), v.len() / 200);
    if n == 0 {
        return None;
    }
    let low = *v.select_nth_unstable_by(cut, f32::total_cmp).1;
    let high = *v.select_nth_unstable_by(n - 1 - cut, f32::total_cmp).1;
    Some((low, high))
}
