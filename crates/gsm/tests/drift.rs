//! Poses that drift are corrected by what the map knows.

#![allow(clippy::unwrap_used, reason = "a failed test may panic")]

use gsm::{DepthView, Error, Intrinsics, Map, NoiseModel, Params, Profile, Tracking};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

const FRAMES: usize = 240;

fn camera() -> Intrinsics {
    Intrinsics::new(146.0, 146.0, 79.5, 59.5, 160, 120).unwrap()
}

/// A room of 4 × 3 × 2.4 m, z up, with a box in it: the nearest hit of every ray, with noise of one sigma.
fn render(pose: &Isometry3<f32>, sigma: impl Fn(f32) -> f32, seed: u64) -> Vec<f32> {
    let k = camera();
    let mut state = seed;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32 - 0.5
    };
    let (low, high) = ([0.0, 0.0, 0.0], [4.0, 3.0, 2.4]);
    let (from, to) = ([2.4, 0.2, 0.0], [3.2, 1.1, 0.8]);
    let mut depth = Vec::new();
    for y in 0..k.height() {
        for x in 0..k.width() {
            let ray = Vector3::new((x as f32 - k.cx()) / k.fx(), (y as f32 - k.cy()) / k.fy(), 1.0);
            let (d, c) = (pose.rotation * ray, pose.translation.vector);
            // Out of the room, into the box.
            let wall = (0..3).map(|a| ((if d[a] > 0.0 { high[a] } else { low[a] }) - c[a]) / d[a]);
            let wall = wall.fold(f32::INFINITY, f32::min);
            let sides = (0..3).map(|a| ((from[a] - c[a]) / d[a], (to[a] - c[a]) / d[a]));
            let (near, far) =
                sides.fold((0.0_f32, f32::INFINITY), |(n, f), (p, q)| (n.max(p.min(q)), f.min(p.max(q))));
            let z = if near < far { near } else { wall };
            let noise = (0..12).map(|_| uniform()).sum::<f32>();
            depth.push(z + sigma(z) * noise);
        }
    }
    depth
}

/// Looks round and round from the middle of the room, a little down.
fn pose(i: usize) -> Isometry3<f32> {
    let t = i as f32 / FRAMES as f32 * std::f32::consts::TAU;
    let level = UnitQuaternion::from_euler_angles(-std::f32::consts::FRAC_PI_2 - 0.35, 0.0, 0.0);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.0 * t);
    Isometry3::from_parts(Translation3::new(1.4 + 0.2 * t.sin(), 1.5 + 0.2 * t.cos(), 1.3), turn * level)
}

/// What odometry has gathered in errors: 6 cm in the middle of the room and 2.9 degrees at the end.
fn drift(i: usize) -> Isometry3<f32> {
    let s = i as f32;
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.000_21 * s);
    Isometry3::from_parts(Translation3::new(0.000_45 * s, -0.000_2 * s, 0.000_1 * s), turn)
}

fn params(profile: Profile, tracking: Tracking) -> Params {
    Params { noise: NoiseModel::of(profile), tracking, ..Params::default() }
}

/// How far the frame's middle and direction lie off in the end: metres, radians.
fn error(params: Params, drift: impl Fn(usize) -> Isometry3<f32>) -> (f32, f32) {
    let mut map = Map::new(params.clone()).unwrap();
    for i in 0..FRAMES {
        let depth = render(&pose(i), |z| params.noise.sigma(z), i as u64);
        let world_from_camera = drift(i) * pose(i);
        let view = DepthView { depth: &depth, intrinsics: camera(), world_from_camera, time: i as f64 };
        assert_eq!(map.integrate(&view).skipped, None);
    }
    let left = map.correction() * drift(FRAMES - 1);
    let middle = Point3::new(2.0, 1.5, 1.2);
    ((left * middle - middle).norm(), left.rotation.angle())
}

#[test]
fn drift_does_not_get_into_the_map() {
    let up = Tracking::Upright([0.0, 0.0, 1.0]);
    for profile in [Profile::Ideal, Profile::TofPhone] {
        let (shift, turn) = error(params(profile, Tracking::Off), drift);
        assert!(shift > 0.06 && turn > 0.049, "the drift itself: {shift} m, {turn}");
        for tracking in [up, Tracking::Free] {
            let (shift, turn) = error(params(profile, tracking), drift);
            assert!(shift < 0.02 && turn < 0.009, "{profile:?} {tracking:?}: {shift} m, {turn}");
            // Poses without errors stay about what every gate allows for (`Params::pose_error`, 1 cm).
            let (shift, turn) = error(params(profile, tracking), |_| Isometry3::identity());
            assert!(shift < 0.015 && turn < 0.002, "{profile:?} {tracking:?}: {shift} m, {turn}");
        }
    }
}

#[test]
fn a_known_tilt_is_kept() {
    let mut map = Map::new(params(Profile::TofPhone, Tracking::Upright([0.0, 0.0, 2.0]))).unwrap();
    let sigma = map.params().noise;
    for i in 0..60 {
        let depth = render(&pose(i), |z| sigma.sigma(z), i as u64);
        let world_from_camera = drift(i) * pose(i);
        map.integrate(&DepthView { depth: &depth, intrinsics: camera(), world_from_camera, time: i as f64 });
    }
    let up = map.correction() * Vector3::z();
    assert!((up - Vector3::z()).norm() < 1e-4, "{up:?}");
    assert!(map.correction().translation.vector.norm() > 0.01, "something was corrected");
}

#[test]
fn many_at_once_are_as_one_by_one() {
    let images: Vec<_> = (0..24).map(|i| render(&pose(i), |_| 0.0, 0)).collect();
    let views: Vec<_> = images
        .iter()
        .enumerate()
        .map(|(i, depth)| DepthView {
            depth,
            intrinsics: camera(),
            world_from_camera: drift(8 * i) * pose(i),
            time: i as f64,
        })
        .collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut map = Map::new(params(Profile::Ideal, Tracking::Free)).unwrap();
            if threads == 1 {
                views.iter().for_each(|v| assert_eq!(map.integrate(v).skipped, None));
            } else {
                map.integrate_all(&views);
            }
            map
        })
    };
    let (one, many) = (run(1), run(3));
    assert!(one.surfels().eq(many.surfels()));
    assert_eq!(one.correction(), many.correction());
    assert_ne!(one.correction(), Isometry3::identity());
}

#[test]
fn up_must_be_a_direction() {
    for up in [[0.0; 3], [f32::NAN, 0.0, 1.0], [f32::INFINITY, 0.0, 0.0]] {
        let refused = Map::new(params(Profile::Ideal, Tracking::Upright(up)));
        assert!(matches!(refused, Err(Error::Params { field: "tracking", .. })), "{up:?}");
    }
}
