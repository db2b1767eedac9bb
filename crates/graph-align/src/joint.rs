//! Many frames fitted at once to what was seen from several of them.
//!
//! Every frame may turn about the vertical and shift. The best turns and shifts minimise
//! sum w |T_a p - T_b q|² / sigma² over the places p, q of one object in two frames, plus the same over the
//! directions of its sides; w falls with the residual (Cauchy's weights), from a wide scale to the narrow one, since
//! errors of yaw are large residuals far from where a frame was found. Gauss-Newton; each step is solved by
//! conjugate gradients over the pulls themselves, so that a chain of frames moves as one. Fitting the frames in
//! turn, each to where the others stand, leaves chains where they were: the far end holds the middle.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3, Vector4};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// Gauss-Newton steps.
const ROUNDS: u32 = 14;
/// How much wider than in the end the weights' scales are at first; halved in every round.
const WIDER: f64 = 8.0;
/// Residual at which a pull weighs half, and noise of a middle, metres.
const SCALE: f64 = 0.08;
/// Directions that differ by more than this are those of different sides, radians.
const ALIKE: f64 = 0.1;
/// Share of its own stiffness that holds each frame where it is during one step.
const DAMPING: f64 = 1e-6;

/// One object, seen from two frames.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pull {
    pub(crate) a: usize,
    pub(crate) b: usize,
    /// Weight, beside others of the same object.
    pub(crate) share: f32,
    pub(crate) of: Common,
}

/// What two frames see of it, each in its own coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Common {
    /// Its middle.
    Place(Point3<f32>, Point3<f32>),
    /// Directions of its sides, radians modulo a quarter turn, and the variance of their difference.
    Side(f32, f32, f32),
}

/// A frame in the common one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) pose: Isometry3<f32>,
    /// Whether it may move.
    pub(crate) free: bool,
}

/// A pull at one round, linearised.
struct Row {
    a: usize,
    b: usize,
    /// Cauchy's weight times share, over the variance.
    w: f64,
    of: Kind,
}

enum Kind {
    /// Residual, and where each end lies from its frame's pivot, horizontally.
    Place(Vector3<f64>, [f64; 2], [f64; 2]),
    Side(f64),
}

/// Small motion: shift of the pivot, turn about it.
type Step = Vector4<f64>;

/// The frames' poses after the fit; those that are not free stay.
pub(crate) fn fitted(frames: &[Frame], pulls: &[Pull]) -> Vec<Isometry3<f32>> {
    let mut poses: Vec<Isometry3<f64>> = frames.iter().map(|f| f.pose.cast()).collect();
    for round in 0..ROUNDS {
        let wider = (WIDER * 0.5_f64.powi(round as i32)).max(1.0);
        let weights: Vec<f64> = pulls.iter().map(|p| weight(p, &poses, wider)).collect();
        let pivots = pivots(&poses, pulls, &weights);
        let rows: Vec<Row> = (pulls.iter().zip(&weights))
            .filter(|(_, w)| **w > 0.0)
            .map(|(p, w)| row(p, *w, &poses, &pivots))
            .collect();
        let steps = solve(&rows, frames);
        for (((pose, pivot), step), frame) in poses.iter_mut().zip(&pivots).zip(&steps).zip(frames) {
            if frame.free {
                let at = Translation3::from(pivot.coords);
                let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), step[3]);
                *pose = Translation3::from(step.xyz()) * at * turn * at.inverse() * *pose;
            }
        }
    }
    let kept = |(f, pose): (&Frame, &Isometry3<f64>)| if f.free { pose.cast() } else { f.pose };
    frames.iter().zip(&poses).map(kept).collect()
}

fn yaw(pose: &Isometry3<f64>) -> f64 {
    pose.rotation.euler_angles().2
}

/// a's direction less b's, both in the common frame, within an eighth of a turn.
fn lean(pull: (usize, f32), other: (usize, f32), poses: &[Isometry3<f64>]) -> f64 {
    let of = |(frame, side): (usize, f32)| f64::from(side) + yaw(&poses[frame]);
    (of(pull) - of(other) + FRAC_PI_4).rem_euclid(FRAC_PI_2) - FRAC_PI_4
}

fn weight(pull: &Pull, poses: &[Isometry3<f64>], wider: f64) -> f64 {
    let share = f64::from(pull.share);
    match pull.of {
        Common::Place(p, q) => {
            let r = (poses[pull.a] * p.cast::<f64>() - poses[pull.b] * q.cast::<f64>()).norm() / SCALE;
            share / (1.0 + (r / wider).powi(2)) / (SCALE * SCALE)
        }
        Common::Side(a, b, variance) => {
            let (r, v) = (lean((pull.a, a), (pull.b, b), poses), f64::from(variance));
            if r.abs() < ALIKE { share / (1.0 + r * r / v / (wider * wider)) / v } else { 0.0 }
        }
    }
}

/// The weighted middle of what pulls at each frame: about it, turn and shift are independent.
fn pivots(poses: &[Isometry3<f64>], pulls: &[Pull], weights: &[f64]) -> Vec<Point3<f64>> {
    let mut sums = vec![(Vector3::zeros(), 0.0); poses.len()];
    for (pull, w) in pulls.iter().zip(weights) {
        if let Common::Place(p, q) = pull.of {
            for (frame, at) in [(pull.a, p), (pull.b, q)] {
                sums[frame].0 += (poses[frame] * at.cast::<f64>()).coords * *w;
                sums[frame].1 += w;
            }
        }
    }
    sums.iter().map(|(sum, n)| if *n > 0.0 { (sum / *n).into() } else { Point3::origin() }).collect()
}

fn row(pull: &Pull, w: f64, poses: &[Isometry3<f64>], pivots: &[Point3<f64>]) -> Row {
    let (a, b) = (pull.a, pull.b);
    let of = match pull.of {
        Common::Place(p, q) => {
            let (p, q) = (poses[a] * p.cast::<f64>(), poses[b] * q.cast::<f64>());
            let lever = |at: &Point3<f64>, pivot: &Point3<f64>| [pivot.y - at.y, at.x - pivot.x];
            Kind::Place(p - q, lever(&p, &pivots[a]), lever(&q, &pivots[b]))
        }
        Common::Side(s, t, _) => Kind::Side(lean((a, s), (b, t), poses)),
    };
    Row { a, b, w, of }
}

impl Row {
    /// The change of the residual that steps make.
    fn forward(&self, steps: &[Step]) -> Vector3<f64> {
        let (s, t) = (&steps[self.a], &steps[self.b]);
        match &self.of {
            Kind::Place(_, l, m) => {
                let turn = Vector3::new(l[0] * s[3] - m[0] * t[3], l[1] * s[3] - m[1] * t[3], 0.0);
                s.xyz() - t.xyz() + turn
            }
            Kind::Side(_) => Vector3::new(s[3] - t[3], 0.0, 0.0),
        }
    }

    /// Adds what a residual asks of both frames.
    fn backward(&self, r: &Vector3<f64>, out: &mut [Step]) {
        let (of_a, of_b) = match &self.of {
            Kind::Place(_, l, m) => {
                let along = |lever: &[f64; 2]| lever[0] * r.x + lever[1] * r.y;
                (Vector4::new(r.x, r.y, r.z, along(l)), Vector4::new(r.x, r.y, r.z, along(m)))
            }
            Kind::Side(_) => (Vector4::new(0.0, 0.0, 0.0, r.x), Vector4::new(0.0, 0.0, 0.0, r.x)),
        };
        out[self.a] += of_a * self.w;
        out[self.b] -= of_b * self.w;
    }

    fn residual(&self) -> Vector3<f64> {
        match self.of {
            Kind::Place(r, ..) => r,
            Kind::Side(r) => Vector3::new(r, 0.0, 0.0),
        }
    }

    /// Adds its part of the normal equations' diagonal.
    fn stiffness(&self, out: &mut [Step]) {
        let (of_a, of_b) = match &self.of {
            Kind::Place(_, l, m) => {
                let own = |v: &[f64; 2]| Vector4::new(1.0, 1.0, 1.0, v[0] * v[0] + v[1] * v[1]);
                (own(l), own(m))
            }
            Kind::Side(_) => (Vector4::new(0.0, 0.0, 0.0, 1.0), Vector4::new(0.0, 0.0, 0.0, 1.0)),
        };
        out[self.a] += of_a * self.w;
        out[self.b] += of_b * self.w;
    }
}

/// Steps that solve the normal equations of the rows: conjugate gradients, preconditioned by the diagonal.
fn solve(rows: &[Row], frames: &[Frame]) -> Vec<Step> {
    let n = frames.len();
    let held = |v: &mut [Step]| {
        v.iter_mut().zip(frames).filter(|(_, f)| !f.free).for_each(|(s, _)| *s = Step::zeros());
    };
    let dot = |a: &[Step], b: &[Step]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    let mut diagonal = vec![Step::zeros(); n];
    let mut left = vec![Step::zeros(); n];
    for row in rows {
        row.stiffness(&mut diagonal);
        row.backward(&-row.residual(), &mut left);
    }
    held(&mut left);
    let eased = |r: &[Step]| -> Vec<Step> {
        let one = |(r, d): (&Step, &Step)| r.zip_map(d, |r, d| if d > 0.0 { r / d } else { 0.0 });
        r.iter().zip(&diagonal).map(one).collect()
    };
    let mut steps = vec![Step::zeros(); n];
    let mut z = eased(&left);
    let mut along = z.clone();
    let mut rz = dot(&left, &z);
    let enough = rz * 1e-16;
    for _ in 0..(8 * n).min(400) {
        if rz <= enough || rz <= 0.0 {
            break;
        }
        let mut image: Vec<Step> =
            along.iter().zip(&diagonal).map(|(s, d)| s.component_mul(d) * DAMPING).collect();
        for row in rows {
            row.backward(&row.forward(&along), &mut image);
        }
        held(&mut image);
        let by = rz / dot(&along, &image);
        if !by.is_finite() {
            break;
        }
        for k in 0..n {
            steps[k] += along[k] * by;
            left[k] -= image[k] * by;
        }
        z = eased(&left);
        let next = dot(&left, &z);
        for k in 0..n {
            along[k] = z[k] + along[k] * (next / rz);
        }
        rz = next;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: &mut u32) -> f32 {
        *k = k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*k >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    fn pose(x: f32, y: f32, yaw: f32) -> Isometry3<f32> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        Isometry3::from_parts(Translation3::new(x, y, 0.1), turn)
    }

    /// Robots in a chain, each with one room of six objects and a wall in common with the next, fifteen metres on.
    fn chain(noisy: f32, state: &mut u32) -> (Vec<Isometry3<f32>>, Vec<Frame>, Vec<Pull>) {
        let truth: Vec<_> = (0..6).map(|k| pose(7.0 * k as f32, -3.0 * k as f32, 0.9 * k as f32)).collect();
        let mut pulls = Vec::new();
        for a in 0..5 {
            let room = [15.0 * a as f32, 5.0 * (a % 2) as f32, 1.0];
            let (to_a, to_b) = (truth[a].inverse(), truth[a + 1].inverse());
            for _ in 0..6 {
                let at = Point3::from(room.map(|c| c + 2.0 * noise(state)));
                let off = Vector3::from_fn(|_, _| noisy * noise(state));
                pulls.push(Pull { a, b: a + 1, share: 0.5, of: Common::Place(to_a * at, to_b * (at + off)) });
            }
            let side = |t: &Isometry3<f32>| 0.4 + t.rotation.euler_angles().2;
            let sides = Common::Side(side(&to_a), side(&to_b) + 0.1 * noisy * noise(state), 1e-4);
            pulls.push(Pull { a, b: a + 1, share: 0.5, of: sides });
        }
        // Found one from the other, with errors that add up along the chain.
        let mut found = vec![Frame { pose: truth[0], free: false }];
        for k in 1..6 {
            let wrong = pose(0.1 * noise(state), 0.1 * noise(state), 0.03 * noise(state));
            let room = Translation3::new(15.0 * (k - 1) as f32, 0.0, 1.0);
            let step = room * wrong * room.inverse() * truth[k];
            found.push(Frame { pose: found[k - 1].pose * truth[k - 1].inverse() * step, free: true });
        }
        (truth, found, pulls)
    }

    fn farthest(truth: &[Isometry3<f32>], poses: &[Isometry3<f32>]) -> f32 {
        let at = Point3::new(75.0, 5.0, 1.0);
        let off = |(t, p): (&Isometry3<f32>, &Isometry3<f32>)| (p * t.inverse() * at - at).norm();
        truth.iter().zip(poses).map(off).fold(0.0, f32::max)
    }

    #[test]
    fn the_end_of_a_chain_is_where_it_was_seen() {
        let mut worst: f32 = 0.0;
        for seed in 0..20 {
            let mut state = seed;
            let (truth, found, pulls) = chain(0.0, &mut state);
            let before: Vec<_> = found.iter().map(|f| f.pose).collect();
            worst = worst.max(farthest(&truth, &before));
            let off = farthest(&truth, &fitted(&found, &pulls));
            assert!(off < 1e-3, "{off} m, seed {seed}");
        }
        assert!(worst > 2.0, "the start must be wrong, {worst} m");
    }

    /// The sum that the fit minimises, written out once more.
    fn cost(poses: &[Isometry3<f32>], pulls: &[Pull]) -> f64 {
        let rho = |r2: f64| r2.ln_1p();
        let one = |p: &Pull| match p.of {
            Common::Place(x, y) => {
                let at = |k: usize, x: &Point3<f32>| poses[k].cast::<f64>() * x.cast::<f64>();
                rho((at(p.a, &x) - at(p.b, &y)).norm_squared() / 0.0064)
            }
            Common::Side(s, t, v) => {
                let turn = |k: usize| f64::from(poses[k].rotation.euler_angles().2);
                let off = f64::from(s) + turn(p.a) - f64::from(t) - turn(p.b);
                let quarter = std::f64::consts::FRAC_PI_2;
                rho((off - quarter * (off / quarter).round()).powi(2) / f64::from(v))
            }
        };
        pulls.iter().map(|p| f64::from(p.share) * one(p)).sum()
    }

    #[test]
    fn no_small_motion_of_a_frame_fits_better() {
        let mut state = 5;
        let (_, found, pulls) = chain(0.1, &mut state);
        let poses = fitted(&found, &pulls);
        let best = cost(&poses, &pulls);
        for k in 1..6 {
            for (dx, dy, turn) in [(0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.003)] {
                for sign in [-1.0, 1.0] {
                    let room = Translation3::new(15.0 * k as f32, 5.0 * (k % 2) as f32, 0.0);
                    let motion = Isometry3::from_parts(
                        Translation3::new(sign * dx, sign * dy, 0.0),
                        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), sign * turn),
                    );
                    // The rest of the chain moves along, as what it saw together asks.
                    let mut moved = poses.clone();
                    moved[k..].iter_mut().for_each(|p| *p = room * motion * room.inverse() * *p);
                    let other = cost(&moved, &pulls);
                    assert!(other > best, "frame {k}: {other} below {best}");
                }
            }
        }
        assert_eq!(poses[0], found[0].pose);
    }

    #[test]
    fn nothing_seen_moves_nothing() {
        let frames = [Frame { pose: pose(1.0, 2.0, 0.3), free: true }; 3];
        assert_eq!(fitted(&frames, &[]), frames.map(|f| f.pose));
        let (p, q) = (Point3::new(1.0, 0.0, 0.0), Point3::new(1.0, 0.5, 0.0));
        let one = Pull { a: 0, b: 1, share: 0.5, of: Common::Place(p, q) };
        let after = fitted(&frames, &[one]);
        assert_eq!(after[2], frames[2].pose);
        assert!(after.iter().all(|t| t.translation.vector.iter().all(|c| c.is_finite())));
    }
}
