//! Rooms on a grid in one domain frame.

use crate::{Error, seeds};
use graph_align::Box3;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use scan3r::Dataset;

/// Rows of rooms are about this wide, metres.
const ROW_WIDTH: f32 = 60.0;

/// Where a room stands in the domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// Points of the reference scan to the domain frame: yaw and shift.
    pub domain_from_reference: Isometry3<f32>,
    /// The room's outer box in the domain frame.
    pub bounds: Box3,
}

/// Places the first `rooms` rooms, each with its own yaw, `gap` metres between outer boxes. A room's
/// place depends on the rooms before it alone, so a smaller domain is a prefix of a larger one.
///
/// # Errors
/// An unreadable scan, or one without a single annotated vertex.
pub fn place(data: &dyn Dataset, rooms: usize, gap: f32, seed: u64) -> Result<Vec<Placement>, Error> {
    let mut out = Vec::with_capacity(rooms);
    let (mut x, mut y, mut depth) = (0.0_f32, 0.0_f32, 0.0_f32);
    for (k, room) in data.rooms().iter().take(rooms).enumerate() {
        let yaw = seeds::unit(&mut seeds::stream(seed, "world", &[k as u64])) * std::f64::consts::TAU;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw as f32);
        let (lo, hi) = bounds(data.annotation(&room.reference)?.points.iter().map(|p| turn * p))
            .ok_or_else(|| Error::Pipeline(format!("scan {}: no annotated vertex", room.reference)))?;
        let size = hi - lo;
        if x > 0.0 && x + size.x > ROW_WIDTH {
            (x, y, depth) = (0.0, y + depth + gap, 0.0);
        }
        let shift = Vector3::new(x - lo.x, y - lo.y, -lo.z);
        let corner = lo + shift;
        out.push(Placement {
            domain_from_reference: Isometry3::from_parts(Translation3::from(shift), turn),
            bounds: Box3::new((corner + size / 2.0).coords.into(), size.into())?,
        });
        x += size.x + gap;
        depth = depth.max(size.y);
    }
    Ok(out)
}

/// Smallest and largest coordinates, `None` without points.
pub fn bounds(points: impl Iterator<Item = Point3<f32>>) -> Option<(Point3<f32>, Point3<f32>)> {
    points.fold(None, |b, p| {
        Some(b.map_or((p, p), |(lo, hi): (Point3<f32>, Point3<f32>)| (lo.inf(&p), hi.sup(&p))))
    })
}

/// The room whose box is nearest to a point (0 inside), the first of equals.
#[must_use]
pub fn nearest_room(placements: &[Placement], p: &Point3<f32>) -> usize {
    let distance = |b: &Box3| {
        let (lo, hi) = (b.min(), b.max());
        (0..3).map(|k| (lo[k] - p[k]).max(p[k] - hi[k]).max(0.0).powi(2)).sum::<f32>()
    };
    (0..placements.len())
        .min_by(|&a, &b| distance(&placements[a].bounds).total_cmp(&distance(&placements[b].bounds)))
        .unwrap_or(0)
}
