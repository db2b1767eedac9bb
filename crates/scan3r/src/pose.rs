//! Camera poses as text: 4x4 row-major (3RScan, 7-Scenes) and `t tx ty tz qx qy qz qw` (TUM).

use crate::Error;
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use std::fmt::Write;
use std::path::Path;

/// Translations beyond this are no pose of a room, metres.
const MAX_TRANSLATION: f64 = 1e4;

/// `world_from_camera` of a 4x4 text file; `None` where a number is not finite, which is how
/// recordings mark lost tracking. The rotation is made orthonormal.
///
/// # Errors
/// Fewer than 16 numbers, or a matrix that is no rotation (within 2 %).
pub fn parse_pose(text: &str, path: &Path) -> Result<Option<Isometry3<f32>>, Error> {
    let bad = |problem: String| Error::format(path, "pose", problem);
    let v: Vec<f64> = text
        .split_whitespace()
        .map(|t| t.parse::<f64>().map_err(|_| bad(format!("{t:?} is no number"))))
        .collect::<Result<_, _>>()?;
    if v.len() != 16 {
        return Err(bad(format!("{} numbers, want the 16 of a 4x4 matrix", v.len())));
    }
    if v.iter().any(|x| !x.is_finite()) {
        return Ok(None);
    }
    let m = Matrix3::new(v[0], v[1], v[2], v[4], v[5], v[6], v[8], v[9], v[10]);
    if (m.transpose() * m - Matrix3::identity()).amax() > 2e-2 || m.determinant() < 0.0 {
        return Err(bad("the upper 3x3 block is no rotation".into()));
    }
    let t = Translation3::new(v[3], v[7], v[11]);
    if t.vector.amax() > MAX_TRANSLATION {
        return Err(bad(format!("translation {:?}, want metres", [v[3], v[7], v[11]])));
    }
    Ok(Some(Isometry3::from_parts(t, rotation_near(&m)).cast()))
}

/// The rotation nearest to a matrix that is almost one. A matrix that is one to rounding is taken as
/// it is: iterating on it would only add noise.
fn rotation_near(m: &Matrix3<f64>) -> UnitQuaternion<f64> {
    let exact = (m.transpose() * m - Matrix3::identity()).amax() < 1e-12;
    let r = if exact {
        Rotation3::from_matrix_unchecked(*m)
    } else {
        Rotation3::from_matrix_eps(m, 1e-12, 100, Rotation3::identity())
    };
    let q = UnitQuaternion::from_rotation_matrix(&r);
    // q and -q are one rotation: one of them is enough.
    if q.w < 0.0 { UnitQuaternion::new_unchecked(-q.into_inner()) } else { q }
}

/// The 4x4 text of a pose; lost tracking is written as minus infinity, as 3RScan does. Numbers are
/// written in full: reading gives the pose back but for the last bit, and a [`settled`] pose exactly.
#[must_use]
pub fn pose_text(pose: Option<&Isometry3<f32>>) -> String {
    let mut out = String::new();
    let m = pose.map(|p| {
        let r = UnitQuaternion::new_normalize(p.rotation.into_inner().cast::<f64>());
        Isometry3::from_parts(p.translation.cast::<f64>(), r).to_homogeneous()
    });
    for r in 0..4 {
        for c in 0..4 {
            let sep = if c == 3 { '\n' } else { ' ' };
            // Writing to a String cannot fail.
            let _ = match &m {
                Some(m) => write!(out, "{}{sep}", m[(r, c)]),
                None => write!(out, "-inf{sep}"),
            };
        }
    }
    out
}

/// A pose within 2e-5 (mostly 1e-7) of `pose` that survives writing and reading to the last bit. Generated
/// recordings use it, so that a written data set gives what the rendered one gave.
#[must_use]
pub fn settled(pose: &Isometry3<f32>) -> Isometry3<f32> {
    let read =
        |p: &Isometry3<f32>| parse_pose(&pose_text(Some(p)), Path::new("")).ok().flatten().unwrap_or(*p);
    let mut p = read(pose);
    for round in 0..400_u16 {
        let next = read(&p);
        if next == p {
            break;
        }
        p = next;
        if round % 4 == 3 {
            // Rounding goes round in a circle: leave it, each time along another axis.
            let mut q = p.rotation.into_inner();
            q.coords[usize::from(round / 4) % 3] += 4e-7;
            p.rotation = UnitQuaternion::new_normalize(q);
        }
    }
    p
}

/// Time and pose of one line of a TUM trajectory.
///
/// # Errors
/// Fewer than 8 numbers, numbers that are not finite, a quaternion of no length.
pub fn parse_tum_line(line: &str, path: &Path, number: usize) -> Result<(f64, Isometry3<f32>), Error> {
    let bad = |problem: String| Error::format(path, format!("line {number}"), problem);
    let v: Vec<f64> = line
        .split_whitespace()
        .map(|t| t.parse::<f64>().ok().filter(|x| x.is_finite()))
        .collect::<Option<_>>()
        .filter(|v: &Vec<f64>| v.len() == 8)
        .ok_or_else(|| bad("want `t tx ty tz qx qy qz qw`".into()))?;
    let q = Quaternion::new(v[7], v[4], v[5], v[6]);
    let q = UnitQuaternion::try_new(q, 1e-6).ok_or_else(|| bad("a quaternion of length 0".into()))?;
    Ok((v[0], Isometry3::from_parts(Translation3::new(v[1], v[2], v[3]), q).cast()))
}
