//! Up from the planes of a room, for recordings whose world has no gravity axis.

use crate::Map;
use nalgebra::{Vector3, zero};

/// Estimates the direction opposite to gravity, world frame, unit length; `None` without two good planes.
///
/// Every planar segment proposes its normal. An axis scores the area of the planes that are parallel or
/// perpendicular to it, as floors and walls are; more for parallel planes that all face the same way, as floors,
/// tables and seats do when seen by a camera between floor and ceiling, and as opposite walls do not.
pub fn estimate_up(map: &Map) -> Option<Vector3<f32>> {
    estimate(map, None)
}

/// As [`estimate_up`], for a camera that was held upright within 60 degrees in the mean: `camera_up` is the mean of
/// the image's upward direction (minus y of the camera) over the frames, world frame, of any length. A wall is then
/// not taken for a floor.
pub fn estimate_up_near(map: &Map, camera_up: &Vector3<f32>) -> Option<Vector3<f32>> {
    estimate(map, camera_up.try_normalize(1e-6))
}

fn estimate(map: &Map, camera_up: Option<Vector3<f32>>) -> Option<Vector3<f32>> {
    let mut planes: Vec<(f32, Vector3<f32>)> = map
        .segments()
        .filter(|s| s.surfels() >= 100)
        .filter_map(|s| {
            let plane = s.plane();
            (plane.rms < 0.025).then(|| (s.area(), plane.normal))
        })
        .collect();
    planes.sort_by(|a, b| b.0.total_cmp(&a.0));
    planes.truncate(64);
    let total: f32 = planes.iter().map(|p| p.0).sum();
    let mut best: Option<(f32, Vector3<f32>)> = None;
    for &(_, axis) in planes.iter().take(16) {
        if camera_up.is_some_and(|up| up.dot(&axis).abs() < 0.5) {
            continue;
        }
        let (mut parallel, mut upright, mut signed) = (0.0, 0.0, zero::<Vector3<f32>>());
        let mut net = 0.0;
        for &(area, normal) in &planes {
            let cos = axis.dot(&normal);
            if cos.abs() > 0.97 {
                parallel += area;
                net += area * cos.signum();
                signed += normal * (area * cos.signum());
            } else if cos.abs() < 0.12 {
                upright += area;
            }
        }
        let score = (parallel + upright) / total + net.abs() / total + 0.5 * (upright / total).min(0.5);
        if best.is_none_or(|(s, _)| score > s) && upright > 0.0 {
            best = Some((score, signed * net.signum()));
        }
    }
    let up = best.and_then(|(_, v)| v.try_normalize(1e-6))?;
    Some(if camera_up.is_some_and(|c| c.dot(&up) < 0.0) { -up } else { up })
}
