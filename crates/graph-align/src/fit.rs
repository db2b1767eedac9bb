//! Rigid fits on corresponding points.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Least squares: the transform that carries each `from` to its `to`, with weights (Umeyama 1991
/// without scale). `upright`: yaw and shift alone, psi = atan2(sum w (a x b)_z, sum w a . b) over
/// centred horizontal parts. Sums run in the order given, in f64.
pub(crate) fn rigid(points: &[(Point3<f32>, Point3<f32>, f32)], upright: bool) -> Isometry3<f32> {
    let total: f64 = points.iter().map(|p| f64::from(p.2)).sum();
    if total <= 0.0 {
        return Isometry3::identity();
    }
    let wide = |p: &Point3<f32>| p.coords.cast::<f64>();
    let (mut a0, mut b0) = (Vector3::zeros(), Vector3::zeros());
    for (a, b, w) in points {
        a0 += wide(a) * (f64::from(*w) / total);
        b0 += wide(b) * (f64::from(*w) / total);
    }
    let mut h = Matrix3::zeros();
    for (a, b, w) in points {
        h += (wide(b) - b0) * (wide(a) - a0).transpose() * f64::from(*w);
    }
    let rotation = if upright {
        let (sin, cos) = (h[(1, 0)] - h[(0, 1)], h[(0, 0)] + h[(1, 1)]);
        Rotation3::from_axis_angle(&Vector3::z_axis(), f64::atan2(sin, cos))
    } else {
        let svd = h.svd(true, true);
        let (u, vt) = (svd.u.unwrap_or_default(), svd.v_t.unwrap_or_default());
        let mut s = Matrix3::identity();
        s[(2, 2)] = (u * vt).determinant().signum();
        Rotation3::from_matrix_unchecked(u * s * vt)
    };
    let q = UnitQuaternion::from_rotation_matrix(&rotation);
    Isometry3::from_parts(Translation3::from(b0 - q * a0), q).cast()
}
