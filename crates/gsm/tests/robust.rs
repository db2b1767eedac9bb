//! Any input: no panic, bounded memory, sums that agree with their members.

#![allow(clippy::unwrap_used, reason = "a failed test may panic")]

use gsm::{DepthView, Evicted, Intrinsics, Map, NoiseModel, Params, Profile, Tracking};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, Unit, Vector3};
use proptest::prelude::*;

/// What is done to a map.
#[derive(Debug, Clone)]
enum Action {
    /// A frame: kind of image, seed, pose.
    Frame(u8, u64, [f32; 7]),
    Scale(u32),
    Correct(f64, f64, [f32; 3]),
    Evict([f32; 3], f32),
    Restore,
}

/// Mostly plain numbers, sometimes the ones that hurt.
fn number(reach: f32) -> impl Strategy<Value = f32> {
    prop_oneof![
        20 => -reach..reach,
        1 => prop_oneof![
            Just(f32::NAN), Just(f32::INFINITY), Just(f32::NEG_INFINITY), Just(f32::MAX), Just(1e6), Just(-0.0)
        ],
    ]
}

fn action() -> impl Strategy<Value = Action> {
    let pose = (number(0.1), number(0.1), number(0.1), number(1.0), number(1.0), number(1.0), 0u8..8);
    let pose = pose.prop_map(|(x, y, z, a, b, c, jump)| {
        [if jump == 0 { 30.0 * a } else { 1.0 }, 0.2 * a, 0.2 * b, 0.2 * c, x, y, z]
    });
    prop_oneof![
        12 => (0u8..8, any::<u64>(), pose).prop_map(|(k, s, p)| Action::Frame(k, s, p)),
        1 => (1u32..5000).prop_map(Action::Scale),
        1 => (0.0..20.0f64, 0.0..20.0f64, prop::array::uniform3(number(1.0)))
            .prop_map(|(a, b, t)| Action::Correct(a, b, t)),
        1 => (prop::array::uniform3(number(1.0)), number(2.0)).prop_map(|(c, r)| Action::Evict(c, r)),
        1 => Just(Action::Restore),
    ]
}

fn image(kind: u8, seed: u64, n: usize, w: usize) -> Vec<f32> {
    let mut state = seed | 1;
    let mut draw = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 32) as u32
    };
    (0..if kind == 7 { n / 2 } else { n })
        .map(|i| match kind {
            0 => 0.0,
            1 => 1.5,
            2 => (draw() >> 16) as f32 * 1e-3,
            3 => f32::from_bits(draw()),
            4 => f32::NAN,
            5 => 1.0 + 0.02 * (i % w) as f32 + if 2 * (i % w) > w { 0.4 } else { 0.0 },
            _ => 1.2 + 0.01 * (i / w.max(1)) as f32 + 0.01 * (draw() % 100) as f32 / 100.0,
        })
        .collect()
}

fn check(map: &Map, limit: u32) {
    let (mut stable, mut all) = (0u64, 0);
    for s in map.surfels() {
        assert!(s.position.iter().chain(s.normal.iter()).all(|v| v.is_finite()), "{s:?}");
        assert!(s.radius > 0.0 && s.confidence <= 40.0, "{s:?}");
        all += 1;
        stable += u64::from(s.stable && s.segment.is_some());
    }
    assert_eq!(map.segments().map(|s| s.moments().count()).sum::<u64>(), stable);
    assert!(all <= limit);
    assert!(map.segments().all(|s| s.plane().rms.is_finite()));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(300) })]
    #[test]
    fn any_actions_leave_a_sound_map(
        (w, h) in (1u32..70, 1u32..50),
        focal in 0.3f32..3.0,
        profile in prop::sample::select(vec![Profile::Structured, Profile::TofPhone, Profile::Ideal]),
        tracking in prop::sample::select(vec![Tracking::Off, Tracking::Free, Tracking::Upright([0.0, -0.6, 0.8])]),
        max_pixels in prop::sample::select(vec![40_000u32, 700, 3]),
        max_samples in prop::sample::select(vec![40_000u32, 300, 2]),
        max_surfels in prop::sample::select(vec![100_000u32, 400]),
        actions in prop::collection::vec(action(), 1..40),
    ) {
        let k = Intrinsics::new(focal * w as f32, focal * w as f32, 0.5 * w as f32, 0.5 * h as f32, w, h).unwrap();
        let noise = NoiseModel::of(profile);
        let params = Params { noise, max_pixels, max_samples, max_surfels, max_bricks: 5000, tracking, ..Params::default() };
        let mut map = Map::new(params).unwrap();
        let mut out = Evicted::default();
        for (i, action) in actions.into_iter().enumerate() {
            match action {
                Action::Frame(kind, seed, [q, x, y, z, a, b, c]) => {
                    let depth = image(kind, seed, (w * h) as usize, w as usize);
                    let rotation = Quaternion::new(q, x, y, z);
                    let rotation = if q == 1.0 { Unit::new_normalize(rotation) } else { Unit::new_unchecked(rotation) };
                    let world_from_camera = Isometry3::from_parts(Translation3::new(a, b, c), rotation);
                    let before = map.surfels().count();
                    let view = DepthView { depth: &depth, intrinsics: k, world_from_camera, time: i as f64 };
                    let report = map.integrate(&view);
                    if report.skipped.is_some() {
                        prop_assert!(map.surfels().count() == before && report.events.is_empty());
                    }
                }
                Action::Scale(n) => map.set_max_pixels(n),
                Action::Correct(from, to, t) => {
                    let t = t.map(|v| if v.is_finite() { v.clamp(-100.0, 100.0) } else { 0.0 });
                    map.apply_correction(from, to, &Isometry3::new(Vector3::from(t), Vector3::from(t) * 0.3));
                }
                Action::Evict(c, r) => {
                    let (c, r) = (Point3::from(c), Vector3::repeat(r));
                    let fresh = map.evict_outside(c - r, c + r);
                    map.restore(std::mem::replace(&mut out, fresh));
                }
                Action::Restore => {
                    map.restore(std::mem::take(&mut out));
                }
            }
        }
        check(&map, max_surfels);
        let t = map.correction();
        prop_assert!(t.translation.vector.norm() < 1e4 && (t.rotation.norm() - 1.0).abs() < 1e-3);
    }
}
