//! Behaviour of the map on analytic scenes and on bad input.

#![allow(clippy::unwrap_used, reason = "a failed test may panic")]

use gsm::{DepthView, Intrinsics, Looked, Map, NoiseModel, Params, Profile, SegmentEvent, Skip, estimate_up};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

fn camera() -> Intrinsics {
    Intrinsics::new(146.0, 146.0, 79.5, 59.5, WIDTH, HEIGHT).unwrap()
}

fn ideal() -> Params {
    Params { noise: NoiseModel::of(Profile::Ideal), ..Params::default() }
}

/// Planes `normal · x = offset` in the world; the nearest positive hit of each ray.
fn render(planes: &[(Vector3<f32>, f32)], pose: &Isometry3<f32>) -> Vec<f32> {
    let k = camera();
    let mut depth = Vec::new();
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let ray = Vector3::new((x as f32 - k.cx()) / k.fx(), (y as f32 - k.cy()) / k.fy(), 1.0);
            let d = pose.rotation * ray;
            let hit = planes
                .iter()
                .map(|(n, o)| (o - n.dot(&pose.translation.vector)) / n.dot(&d))
                .filter(|t| *t > 0.0)
                .fold(f32::INFINITY, f32::min);
            depth.push(if hit < 9.0 { hit } else { 0.0 });
        }
    }
    depth
}

/// A back wall at z = 2.5 and a floor at y = 1 (y is down), seen from the origin: a concave corner.
fn corner() -> Vec<(Vector3<f32>, f32)> {
    vec![(Vector3::z(), 2.5), (Vector3::y(), 0.6)]
}

fn pose(i: usize) -> Isometry3<f32> {
    let t = i as f32;
    Isometry3::from_parts(
        Translation3::new(0.01 * t, 0.004 * t, -0.006 * t),
        UnitQuaternion::from_euler_angles(0.003 * t, -0.004 * t, 0.002 * t),
    )
}

fn run(params: Params, world: &Isometry3<f32>, frames: usize) -> Map {
    let mut map = Map::new(params).unwrap();
    for i in 0..frames {
        let depth = render(&corner(), &pose(i));
        let report = map.integrate(&view(&depth, world * pose(i), i));
        assert_eq!(report.skipped, None);
    }
    map
}

fn view(depth: &[f32], world_from_camera: Isometry3<f32>, i: usize) -> DepthView<'_> {
    DepthView { depth, intrinsics: camera(), world_from_camera, time: i as f64 }
}

#[test]
fn wall_and_floor_are_two_planes_with_their_normals() {
    let map = run(ideal(), &Isometry3::identity(), 8);
    let mut large: Vec<_> = map.segments().filter(|s| s.surfels() > 500).collect();
    large.sort_by_key(|s| std::cmp::Reverse(s.surfels()));
    assert_eq!(large.len(), 2, "{:?}", map.segments().map(|s| s.surfels()).collect::<Vec<_>>());
    for s in &large {
        let plane = s.plane();
        let wall = plane.normal.z.abs() > 0.9;
        let (truth, offset) = if wall { (-Vector3::z(), -2.5) } else { (-Vector3::y(), -0.6) };
        assert!(plane.normal.dot(&truth) > 0.999, "{plane:?}");
        assert!((plane.offset - offset).abs() < 0.02 && plane.rms < 0.01, "{plane:?}");
        let aabb = s.aabb().unwrap();
        assert!((aabb.low..=aabb.high).contains(&s.centroid()) || s.centroid() > aabb.low);
    }
    // Away from the corner every surfel has the label of its plane and lies on it.
    let wall = large.iter().find(|s| s.plane().normal.z.abs() > 0.9).unwrap().id();
    let (mut right, mut all) = (0, 0);
    for s in map.surfels().filter(|s| s.stable) {
        let p = s.position;
        if (0.6 - p.y).max(2.5 - p.z) < 0.2 {
            continue;
        }
        let on_wall = 2.5 - p.z < 0.6 - p.y;
        all += 1;
        right += usize::from((s.segment == Some(wall)) == on_wall);
        if (0.6 - p.y).min(2.5 - p.z) < 0.002 {
            let truth = if on_wall { -Vector3::z() } else { -Vector3::y() };
            assert!(s.normal.dot(&truth) > 0.99 || (0.6 - p.y).abs().max((2.5 - p.z).abs()) < 0.3);
        }
    }
    assert!(all > 5_000 && right as f32 > 0.99 * all as f32, "{right} of {all}");
    let up = estimate_up(&map).unwrap();
    assert!(up.dot(&-Vector3::y()).abs() > 0.99 || up.dot(&-Vector3::z()).abs() > 0.99);
}

#[test]
fn runs_repeat_bit_for_bit() {
    let (a, b) = (run(ideal(), &Isometry3::identity(), 6), run(ideal(), &Isometry3::identity(), 6));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let c = pool.install(|| run(ideal(), &Isometry3::identity(), 6));
    for other in [&b, &c] {
        assert!(a.surfels().eq(other.surfels()));
        assert!(
            a.segments().map(|s| (s.id(), *s.moments())).eq(other.segments().map(|s| (s.id(), *s.moments())))
        );
    }
}

#[test]
fn a_moved_world_gives_the_same_segments() {
    let world = Isometry3::new(Vector3::new(3.3, -7.1, 2.2), Vector3::new(0.4, 1.1, -0.7));
    let (a, b) = (run(ideal(), &Isometry3::identity(), 6), run(ideal(), &world, 6));
    let sizes = |m: &Map| {
        let mut v: Vec<_> = m.segments().map(|s| s.surfels()).filter(|&n| n > 200).collect();
        v.sort_unstable();
        v
    };
    let (sa, sb) = (sizes(&a), sizes(&b));
    assert_eq!(sa.len(), sb.len());
    for (x, y) in sa.iter().zip(&sb) {
        assert!(x.abs_diff(*y) * 50 <= *x, "{sa:?} {sb:?}");
    }
}

#[test]
fn moments_equal_direct_sums_over_the_members() {
    let map = run(ideal(), &Isometry3::identity(), 8);
    for s in map.segments().filter(|s| s.surfels() > 100) {
        let points: Vec<_> = map
            .surfels()
            .filter(|f| f.stable && f.segment == Some(s.id()))
            .map(|f| f.position.coords)
            .collect();
        assert_eq!(points.len(), s.surfels() as usize);
        let mean = points.iter().sum::<Vector3<f32>>() / points.len() as f32;
        assert!((mean - s.centroid().coords).norm() < 0.002);
        assert_eq!(map.segment_points(s.id(), 64).len(), 64.min(points.len()));
    }
}

#[test]
fn surfels_that_are_looked_through_disappear() {
    let mut map = Map::new(ideal()).unwrap();
    let screen = |c: u32, r: u32| (60..100).contains(&c) && (40..80).contains(&r);
    let image = |with: bool| -> Vec<f32> {
        (0..HEIGHT * WIDTH).map(|i| if with && screen(i % WIDTH, i / WIDTH) { 1.0 } else { 2.5 }).collect()
    };
    let near = |m: &Map| m.surfels().filter(|s| s.position.z < 1.5).count();
    for i in 0..6 {
        map.integrate(&view(&image(true), Isometry3::identity(), i));
    }
    let wall = map.surfels().filter(|s| s.position.z > 2.0).count();
    assert!(near(&map) > 1_000);
    let block = |m: &Map| m.visibility().query(Point3::new(-0.1, -0.1, 0.9), Point3::new(0.1, 0.1, 1.1));
    assert_eq!(block(&map), Looked::Seen);
    let mut removed = false;
    for i in 0..20 {
        let report = map.integrate(&view(&image(false), Isometry3::identity(), 6 + i));
        removed |= report.events.iter().any(|e| matches!(e, SegmentEvent::Removed(_)));
    }
    assert_eq!(near(&map), 0);
    assert!(removed && map.surfels().filter(|s| s.position.z > 2.0).count() >= wall);
    assert!(matches!(block(&map), Looked::Through(share) if share > 0.5), "{:?}", block(&map));
    let behind = map.visibility().query(Point3::new(-0.1, -0.1, 3.9), Point3::new(0.1, 0.1, 4.1));
    assert_eq!(behind, Looked::Not);
}

/// A floor at a slant, which one pixel spans for more than the tolerance: its surfels are seen again wherever they fall
/// within their pixel.
#[test]
fn a_slanted_floor_is_seen_again_wherever_pixels_fall() {
    let mut map = Map::new(ideal()).unwrap();
    let floor = [(Vector3::y(), 0.5)];
    let mut last = gsm::Counts::default();
    for i in 0..30 {
        let turn = 0.0021 * (i as f32 * 2.4).sin();
        let at = Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_euler_angles(-0.2 + turn, turn, 0.0),
        );
        let report = map.integrate(&view(&render(&floor, &at), at, i));
        assert_eq!(report.counts.contradicted, 0, "frame {i}");
        last = report.counts;
    }
    // The whole map lies in view.
    assert!(last.visited > 5_000);
    assert_eq!((last.matched, last.created), (last.visited, 0));
}

#[test]
fn bad_frames_are_skipped_and_change_nothing() {
    let mut map = run(ideal(), &Isometry3::identity(), 3);
    let before: Vec<_> = map.surfels().collect();
    let depth = render(&corner(), &pose(0));
    let nan = Isometry3::translation(f32::NAN, 0.0, 0.0);
    let far = Isometry3::translation(1e9, 0.0, 0.0);
    assert_eq!(map.integrate(&view(&depth, nan, 3)).skipped, Some(Skip::InvalidPose));
    assert_eq!(map.integrate(&view(&depth, far, 3)).skipped, Some(Skip::InvalidPose));
    let short = map.integrate(&view(&depth[1..], pose(0), 3));
    assert_eq!(short.skipped, Some(Skip::WrongSize));
    for junk in [0.0, f32::NAN, f32::INFINITY, -1.0, 1e30] {
        let depth = vec![junk; depth.len()];
        assert_eq!(map.integrate(&view(&depth, pose(0), 3)).skipped, Some(Skip::NoDepth));
    }
    assert!(map.surfels().eq(before));
    assert!(map.integrate(&view(&depth, Isometry3::translation(2.0, 0.0, 0.0), 3)).jumped);
}

/// A board 4 cm before a wall at 2 m, under white noise of 14 mm: no single frame shows the step well, the map does.
#[test]
fn a_step_below_three_sigmas_parts_two_segments() {
    let mut state = 3u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let noise = NoiseModel::of(Profile::TofPhone);
    let mut map = Map::new(Params { noise, ..Params::default() }).unwrap();
    for i in 0..25 {
        let x = 0.004 * i as f32;
        let depth: Vec<f32> = (0..WIDTH * HEIGHT)
            .map(|k| {
                let u = ((k % WIDTH) as f32 - camera().cx()) / camera().fx();
                let z = if x + 1.96 * u > 0.0 { 1.96 } else { 2.0 };
                let normal: f32 = (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
                z + noise.sigma(z) * normal
            })
            .collect();
        map.integrate(&view(&depth, Isometry3::translation(x, 0.0, 0.0), i));
    }
    // Away from the step, every surfel is of the segment of its side.
    let side = |left: bool| {
        let mut counts = std::collections::BTreeMap::new();
        for s in map.surfels().filter(|s| s.stable && s.position.x.abs() > 0.1) {
            if (s.position.x < 0.0) == left {
                *counts.entry(s.segment).or_insert(0usize) += 1;
            }
        }
        let all: usize = counts.values().sum();
        let (segment, most) = counts.into_iter().max_by_key(|c| c.1).unwrap();
        assert!(most * 100 >= all * 95, "{most} of {all}");
        segment.unwrap()
    };
    assert_ne!(side(true), side(false));
}

#[test]
fn odd_sizes_and_garbage_do_not_panic() {
    let mut state = 7u64;
    let mut draw = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 48) as u16
    };
    for (w, h) in [(1, 1), (1, 50), (50, 1), (3, 2), (31, 17), (4096, 3), (640, 480), (4096, 4096), (8192, 1)]
    {
        let intrinsics =
            Intrinsics::new(0.8 * w as f32, 0.8 * w as f32, 0.5 * w as f32, 0.5 * h as f32, w, h);
        let intrinsics = intrinsics.unwrap();
        for profile in [Profile::Structured, Profile::TofPhone] {
            let noise = NoiseModel::of(profile);
            let mut map = Map::new(Params { noise, ..Params::default() }).unwrap();
            for i in 0..4 {
                let n = (w * h) as usize;
                let depth: Vec<f32> = match i {
                    0 => (0..n).map(|_| f32::from(draw()) * 1e-3).collect(),
                    1 => vec![1.5; n],
                    _ => (0..n).map(|k| 1.0 + 0.001 * (k % 97) as f32).collect(),
                };
                // A teleport, then a frame that sees the surfels of the one before.
                let world_from_camera = Isometry3::translation(0.0, 0.0, 40.0 * i.min(2) as f32);
                map.integrate(&DepthView { depth: &depth, intrinsics, world_from_camera, time: 0.0 });
            }
            assert!(map.surfels().all(|s| s.position.iter().all(|v| v.is_finite())));
        }
    }
}

#[test]
fn frames_handed_over_at_once_give_the_same_map() {
    // Frames 3 and 7 cannot be used, and the resolution has two pixels a sample.
    let depth: Vec<_> = (0..11).map(|i| render(&corner(), &pose(i))).collect();
    let nothing = vec![0.0; depth[0].len()];
    let views: Vec<_> = (0..11)
        .map(|i| match i {
            3 => view(&nothing, pose(i), i),
            7 => view(&depth[i][1..], pose(i), i),
            _ => view(&depth[i], pose(i), i),
        })
        .collect();
    let all = |map: &Map| -> Vec<_> {
        map.surfels().map(|s| (s.position, s.normal, s.radius, s.confidence, s.segment)).collect()
    };
    for noise in [Profile::Ideal, Profile::TofPhone].map(NoiseModel::of) {
        let params = Params { noise, max_samples: 3000, ..ideal() };
        let mut one = Map::new(params.clone()).unwrap();
        let want: Vec<_> = views.iter().map(|v| one.integrate(v)).collect();
        assert_eq!(want.iter().filter(|r| r.skipped.is_some()).count(), 2);
        for threads in 1..=4 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut map = Map::new(params.clone()).unwrap();
            // Several calls, one of a single frame.
            let reports: Vec<_> = pool.install(|| {
                [&views[..6], &views[6..7], &views[7..]].iter().flat_map(|v| map.integrate_all(v)).collect()
            });
            assert_eq!(reports, want, "{threads} threads");
            assert_eq!(all(&map), all(&one), "{threads} threads");
            assert_eq!(map.frame_segments(), one.frame_segments(), "{threads} threads");
        }
    }
}

#[test]
fn a_full_map_refuses_and_counts() {
    let params = Params { max_surfels: 500, max_bricks: 20, ..ideal() };
    let mut map = Map::new(params).unwrap();
    let depth = render(&corner(), &pose(0));
    let report = map.integrate(&view(&depth, pose(0), 0));
    assert!(report.counts.refused > 0 && report.counts.surfels <= 500);
}

#[test]
fn invalid_cameras_and_parameters_are_refused() {
    assert!(Intrinsics::new(0.0, 1.0, 0.0, 0.0, 4, 4).is_err());
    assert!(Intrinsics::new(1.0, f32::NAN, 0.0, 0.0, 4, 4).is_err());
    assert!(Intrinsics::new(1.0, 1.0, f32::INFINITY, 0.0, 4, 4).is_err());
    assert!(Intrinsics::new(1.0, 1.0, 0.0, 0.0, 0, 4).is_err());
    assert!(Params { min_depth: 6.0, ..Params::default() }.validate().is_err());
    assert!(Params { gate_sigmas: f32::NAN, ..Params::default() }.validate().is_err());
    assert!(Map::new(Params { max_pixels: 0, ..Params::default() }).is_err());
}
