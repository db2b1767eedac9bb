//! Drifting poses: each frame is laid on what the map knows before the map learns it.
//!
//! The poses of odometry are right from one frame to the next and wrong in the long run. The depth of a frame at its
//! believed pose, compared with the surfels in view, says by how much: the motion `(ω, t)` of the camera's points
//! that minimises `Σ w (n · (q + ω × q + t − p))²` over points `q` and the surfels `p`, `n` under them (Chen and Medioni,
//! ICRA 1991), held by what odometry may err from one frame to the next. Errors of a frame are small, so that one step
//! a frame is enough.

use crate::frame::{dot, sub};
use crate::project::{Lens, Seen, bits};
use crate::store::{Step, Store};
use crate::surfels::BLOCK;
use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// What is corrected.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Tracking {
    /// Nothing: poses are taken as they are given.
    #[default]
    Off,
    /// Places, and turns about this upward direction of the world: the tilt is known from gravity.
    Upright([f32; 3]),
    /// Places and turns.
    Free,
}

/// Error of odometry from one frame to the next, metres and radians.
const STEP: (f64, f64) = (0.005, 0.001);
/// A motion of more such errors than this is none: the camera is not where it is believed to be.
const FARTHEST: f64 = 20.0;
/// One surfel in so many is compared.
const EVERY: u32 = 4;
/// As many of these err alike.
const ALIKE: f64 = 2.0;
/// A tilt that is known does not change.
const RIGID: f64 = 1e10;
/// Surfels seen more obliquely (normal · ray of unit depth) say nothing.
const FACING: f32 = 0.2;
/// Surfels below which a frame is taken at its believed pose.
const FEWEST: u32 = 50;

/// The motion of the camera, in its own frame, that lays the frame on the surfels of these bricks; none where too few
/// are seen, or where it is beyond odometry.
pub(crate) fn motion(step: Step<'_>, bricks: &[u32], store: &Store) -> Option<Isometry3<f32>> {
    let mut sums = Sums::gather(step, bricks, store)?;
    for k in 0..3 {
        sums.normal[(k, k)] += 1.0 / (STEP.1 * STEP.1);
        sums.normal[(3 + k, 3 + k)] += 1.0 / (STEP.0 * STEP.0);
    }
    if let Tracking::Upright(up) = step.params.tracking {
        let up = Vector3::from(step.pose.unturn(up)).cast::<f64>().normalize();
        let tilt = Matrix3::identity() - up * up.transpose();
        let turns = sums.normal.fixed_view::<3, 3>(0, 0) + tilt * RIGID;
        sums.normal.fixed_view_mut::<3, 3>(0, 0).copy_from(&turns);
    }
    let by = sums.normal.cholesky()?.solve(&sums.right);
    let (turn, shift) = (by.fixed_rows::<3>(0).into_owned(), by.fixed_rows::<3>(3).into_owned());
    let plausible = turn.norm() <= FARTHEST * STEP.1 && shift.norm() <= FARTHEST * STEP.0;
    let turn = UnitQuaternion::from_scaled_axis(turn.cast());
    plausible.then(|| Isometry3::from_parts(Translation3::from(shift.cast::<f32>()), turn))
}

/// The normal equations `normal · (ω, t) = right`, camera frame.
struct Sums {
    normal: Matrix6<f64>,
    right: Vector6<f64>,
}

impl Sums {
    fn gather(step: Step<'_>, bricks: &[u32], store: &Store) -> Option<Self> {
        let Step { frame, params, pose, now, .. } = step;
        let lens = Lens::new(&frame.camera?, pose, params);
        let turn = (0..BLOCK as u32).filter(|k| (k + now).is_multiple_of(EVERY)).fold(0, |t, k| t | 1 << k);
        let (mut normal, mut right, mut n) = (Matrix6::zeros(), Vector6::zeros(), 0);
        for block in bricks.iter().filter_map(|&b| store.bricks.list.get(b as usize)).flat_map(|b| &b.blocks)
        {
            let hot = &store.surfels.hot[block.first as usize / BLOCK];
            let seen = lens.project(hot);
            for k in bits(seen.inside & !u32::from(hot.unstable) & turn) {
                if let Some((row, off, w)) = residual(step, &seen, k) {
                    normal.syger(w, &row, &row, 1.0);
                    right += row * (w * off);
                    n += 1;
                }
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        (n >= FEWEST).then_some(Self { normal, right })
    }
}

/// Derivative by `(ω, t)`, distance and weight of the pixel under a surfel from the surfel's plane.
#[inline]
fn residual(step: Step<'_>, seen: &Seen, k: usize) -> Option<(Vector6<f64>, f64, f64)> {
    let Step { frame, params, .. } = step;
    let (x, y, n) = (seen.x[k] as usize, seen.y[k] as usize, seen.normal(k));
    let z = frame.z[y * frame.width + x];
    let ray = [frame.ray_x[x], frame.ray_y[y], 1.0];
    if z == 0.0 || dot(n, ray) > -FACING {
        return None;
    }
    let q = ray.map(|r| r * z);
    let sigma = frame.noise.row(z).sigma;
    let off = dot(n, sub(seen.point(k), q));
    if off.abs() > params.gate_sigmas * sigma + 2.0 * params.pose_error {
        return None;
    }
    // Cauchy's weights.
    let variance = sigma * sigma + params.pose_error * params.pose_error + off * off;
    let (n, q) = (Vector3::from(n).cast::<f64>(), Vector3::from(q).cast::<f64>());
    let r = q.cross(&n);
    Some((Vector6::new(r.x, r.y, r.z, n.x, n.y, n.z), off.into(), 1.0 / (ALIKE * f64::from(variance))))
}
