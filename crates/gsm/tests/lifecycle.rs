//! What happens to a map besides integrating frames: corrections, eviction, threads, noise measured, budget.

#![allow(clippy::unwrap_used, reason = "a failed test may panic")]

use gsm::{DepthView, Evicted, Intrinsics, Map, NoiseMeter, NoiseModel, Params, Profile, SegmentEvent};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

fn camera(width: u32, height: u32) -> Intrinsics {
    let (w, h) = (width as f32, height as f32);
    Intrinsics::new(0.91 * w, 0.91 * w, 0.5 * w - 0.5, 0.5 * h - 0.5, width, height).unwrap()
}

fn ideal() -> Params {
    Params { noise: NoiseModel::of(Profile::Ideal), ..Params::default() }
}

/// Depth of a room's back wall, floor and a box, as seen from a pose; noise by a seeded sum of uniforms.
fn render(k: &Intrinsics, pose: &Isometry3<f32>, sigma: impl Fn(f32) -> f32, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2) | 1;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let planes = [(Vector3::z(), 2.5), (Vector3::y(), 0.6), (Vector3::new(-0.8, 0.0, 0.6), 2.0)];
    let mut depth = Vec::new();
    for y in 0..k.height() {
        for x in 0..k.width() {
            let ray = Vector3::new((x as f32 - k.cx()) / k.fx(), (y as f32 - k.cy()) / k.fy(), 1.0);
            let d = pose.rotation * ray;
            let z = planes
                .iter()
                .map(|(n, o)| (o - n.dot(&pose.translation.vector)) / n.dot(&d))
                .filter(|t| *t > 0.0)
                .fold(f32::INFINITY, f32::min);
            let normal: f32 = (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
            let z = z + sigma(z) * normal;
            depth.push(if z < 9.0 { (z * 1000.0).round() / 1000.0 } else { 0.0 });
        }
    }
    depth
}

fn pose(i: usize) -> Isometry3<f32> {
    let t = i as f32;
    Isometry3::from_parts(
        Translation3::new(0.01 * t, 0.004 * t, -0.006 * t),
        UnitQuaternion::from_euler_angles(0.003 * t, -0.01 * t, 0.002 * t),
    )
}

fn add(map: &mut Map, k: Intrinsics, depth: &[f32], pose: Isometry3<f32>, i: usize) -> Vec<SegmentEvent> {
    let view = DepthView { depth, intrinsics: k, world_from_camera: pose, time: i as f64 };
    let report = map.integrate(&view);
    assert_eq!(report.skipped, None);
    report.events
}

fn moments_equal_members(map: &Map) {
    for s in map.segments() {
        let points: Vec<_> = map
            .surfels()
            .filter(|f| f.stable && f.segment == Some(s.id()))
            .map(|f| f.position.coords)
            .collect();
        assert_eq!(points.len(), s.surfels() as usize, "{}", s.id());
        if points.len() > 50 {
            let mean = points.iter().sum::<Vector3<f32>>() / points.len() as f32;
            assert!((mean - s.centroid().coords).norm() < 0.002);
        }
    }
}

/// Bits of everything a map says.
fn fingerprint(map: &Map) -> Vec<u32> {
    let mut bits = Vec::new();
    for s in map.surfels() {
        bits.extend(s.position.iter().chain(s.normal.iter()).map(|v| v.to_bits()));
        bits.extend([
            s.radius.to_bits(),
            s.confidence.to_bits(),
            s.segment.map_or(0, |s| s.0),
            s.stable.into(),
        ]);
    }
    for s in map.segments() {
        bits.extend([s.id().0, s.surfels(), s.plane().rms.to_bits()]);
    }
    bits.extend(map.visibility().cells().iter().map(|c| u32::from(c.through) << 8 | u32::from(c.surface)));
    bits
}

#[test]
fn one_two_and_four_threads_give_the_same_bits() {
    for (profile, width, height, max_pixels) in [
        (Profile::Structured, 640, 480, 40_000),
        (Profile::Structured, 640, 480, 400_000),
        (Profile::TofPhone, 224, 172, 40_000),
        (Profile::TofPhone, 448, 344, 400_000),
    ] {
        let k = camera(width, height);
        let noise = NoiseModel::of(profile);
        let frames: Vec<_> = (0..6).map(|i| render(&k, &pose(3 * i), |z| noise.sigma(z), i as u64)).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut map = Map::new(Params { noise, max_pixels, ..Params::default() }).unwrap();
                let events: Vec<_> =
                    (0..6).flat_map(|i| add(&mut map, k, &frames[i], pose(3 * i), i)).collect();
                (fingerprint(&map), events)
            })
        };
        let one = run(1);
        assert!(one.0.len() > 50_000);
        assert!(run(2) == one, "{profile:?} {width} two");
        assert!(run(4) == one, "{profile:?} {width} four");
    }
}

#[test]
fn a_corrected_stretch_equals_one_with_right_poses() {
    let k = camera(WIDTH, HEIGHT);
    // Frames 6 to 11 look elsewhere, so that their surfels are their own; their poses are off by a drift.
    let turned = |i: usize| pose(i) * Isometry3::rotation(Vector3::y() * if i < 6 { 0.0 } else { 1.2 });
    let drift = Isometry3::new(Vector3::new(0.3, -0.2, 0.1), Vector3::new(0.02, 0.3, -0.05));
    let (mut right, mut wrong) = (Map::new(ideal()).unwrap(), Map::new(ideal()).unwrap());
    for i in 0..12 {
        let depth = render(&k, &turned(i), |_| 0.0, 1);
        add(&mut right, k, &depth, turned(i), i);
        let believed = if i < 6 { turned(i) } else { drift * turned(i) };
        add(&mut wrong, k, &depth, believed, i);
    }
    let before = wrong.surfels().count();
    let done = wrong.apply_correction(6.0, 11.0, &drift.inverse());
    assert!(done.moved > 3000 && done.lost == 0, "{done:?}");
    assert_eq!(wrong.surfels().count(), before);
    moments_equal_members(&wrong);
    // Every surfel of the corrected map lies on a surface of the room, as those of the right map do.
    let off =
        |p: &Point3<f32>| (p.z - 2.5).abs().min((p.y - 0.6).abs()).min((-0.8 * p.x + 0.6 * p.z - 2.0).abs());
    let share = |m: &Map| {
        let all: Vec<_> = m.surfels().filter(|s| s.stable).collect();
        all.iter().filter(|s| off(&s.position) < 0.01).count() as f32 / all.len() as f32
    };
    assert!(share(&right) > 0.97 && share(&wrong) > 0.97, "{} {}", share(&right), share(&wrong));
    assert_eq!(wrong.apply_correction(100.0, 200.0, &drift).moved, 0);
    assert_eq!(wrong.apply_correction(f64::NAN, f64::NAN, &drift).moved, 0);
}

#[test]
fn damaged_bytes_are_refused_or_harmless() {
    let k = camera(WIDTH, HEIGHT);
    let mut map = Map::new(ideal()).unwrap();
    add(&mut map, k, &render(&k, &pose(0), |_| 0.0, 1), pose(0), 0);
    let nothing = Point3::new(100.0, 100.0, 100.0);
    let bytes = map.evict_outside(nothing, nothing).to_bytes();
    assert!(bytes.len() > 50_000);
    for cut in (0..bytes.len()).step_by(997).chain(0..64) {
        assert!(matches!(Evicted::from_bytes(&bytes[..cut]), Err(gsm::Error::Evicted { .. })), "{cut}");
    }
    let longer = [&bytes[..], &[0]].concat();
    assert!(Evicted::from_bytes(&longer).is_err());
    let mut refused = 0;
    for n in 0..400 {
        let mut hurt = bytes.clone();
        hurt[(n * 7919) % bytes.len()] ^= 1 << (n % 8);
        match Evicted::from_bytes(&hurt) {
            // What is read is put back and worked with like any other part.
            Ok(part) if n % 40 == 0 => {
                let mut fresh = Map::new(ideal()).unwrap();
                fresh.restore(part);
                add(&mut fresh, k, &render(&k, &pose(1), |_| 0.0, 1), pose(1), 1);
            }
            Ok(_) => {}
            Err(e) => {
                refused += 1;
                assert!(e.to_string().contains("byte"), "{e}");
            }
        }
    }
    assert!(refused > 5, "{refused}");
    // A number that promises gigabytes takes none.
    let mut huge = bytes[..26].to_vec();
    huge[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(Evicted::from_bytes(&huge).is_err());
}

#[test]
fn what_is_evicted_comes_back_as_it_was() {
    let k = camera(WIDTH, HEIGHT);
    let mut map = Map::new(ideal()).unwrap();
    let frames: Vec<_> = (0..10).map(|i| render(&k, &pose(i), |_| 0.0, 1)).collect();
    for (i, depth) in frames.iter().take(8).enumerate() {
        add(&mut map, k, depth, pose(i), i);
    }
    let whole = |m: &Map| {
        let mut all: Vec<_> = m
            .surfels()
            .map(|s| {
                (s.position.coords.data.0[0].map(f32::to_bits), s.segment, s.stable, s.confidence.to_bits())
            })
            .collect();
        all.sort_unstable();
        // Moments may lag a millimetre behind the positions, and do not after a reload.
        let segments: Vec<_> = m.segments().map(|s| (s.id(), s.surfels())).collect();
        (all, segments, m.visibility().cells())
    };
    let before = whole(&map);
    let (low, high) = (Point3::new(-0.4, -5.0, -5.0), Point3::new(0.3, 5.0, 5.0));
    let evicted = map.evict_outside(low, high);
    assert!(evicted.surfels() > 1000 && map.surfels().count() > 1000);
    assert_eq!(evicted.surfels() + map.surfels().count(), before.0.len());
    let side = map.visibility().side();
    assert!(map.surfels().all(|s| (low.x - side..high.x + side).contains(&s.position.x)));
    moments_equal_members(&map);
    let held = map.bytes();
    assert_eq!(map.restore(evicted), 0);
    assert!(whole(&map) == before && map.bytes() >= held);
    // All out and in again: every segment closes silently and comes back under its id.
    let nothing = Point3::new(100.0, 100.0, 100.0);
    let evicted = map.evict_outside(nothing, nothing);
    assert_eq!((map.surfels().count(), map.segments().count()), (0, 0));
    assert_eq!(map.restore(evicted), 0);
    assert!(whole(&map) == before);
    moments_equal_members(&map);
    // By way of bytes.
    let evicted = map.evict_outside(low, high);
    let n = evicted.surfels();
    let bytes = evicted.to_bytes();
    let read = Evicted::from_bytes(&bytes).unwrap();
    assert_eq!((read.surfels(), read.to_bytes() == bytes), (n, true));
    assert_eq!(map.restore(read), 0);
    assert!(whole(&map) == before);
    moments_equal_members(&map);
    // The map goes on as if nothing had happened.
    let events = add(&mut map, k, &frames[8], pose(8), 8);
    assert!(
        !events.iter().any(|e| matches!(e, SegmentEvent::Added(_) | SegmentEvent::Removed(_))),
        "{events:?}"
    );
}

#[test]
fn the_meter_tells_the_sensors_apart() {
    let k = camera(320, 240);
    let measure = |image: &dyn Fn(&[f32]) -> Vec<f32>, noise: &dyn Fn(f32) -> f32| {
        let mut meter = NoiseMeter::default();
        for i in 0..5 {
            let depth = image(&render(&k, &pose(4 * i), noise, i as u64));
            meter.add(&DepthView { depth: &depth, intrinsics: k, world_from_camera: pose(i), time: 0.0 });
        }
        meter.measured().unwrap()
    };
    let plain = |d: &[f32]| d.to_vec();
    assert_eq!(measure(&plain, &|_| 0.0).model.profile, Profile::Ideal);
    for scale in [0.7, 1.0, 1.6] {
        let model = NoiseModel { profile: Profile::TofPhone, scale };
        let found = measure(&plain, &|z| model.sigma(z));
        assert_eq!(found.model.profile, Profile::TofPhone);
        assert!((found.model.scale / scale - 1.0).abs() < 0.2, "{found:?} {scale}");
    }
    // Disparities in eighths of a pixel of a camera with 585 pixels focal length and 75 mm base.
    let disparity = |d: &[f32]| d.iter().map(|z| 351.0 / (351.0 / z).round()).collect();
    assert_eq!(measure(&disparity, &|_| 0.0).model.profile, Profile::Structured);
    assert!(NoiseMeter::default().measured().is_none());
}

/// A map that learns a sample per block of 4×4 pixels holds about as many surfels as one of the small image, and
/// they lie on the surfaces.
#[test]
fn samples_bound_the_surfels_of_large_images() {
    let run = |width: u32, height: u32, params: Params| {
        let k = camera(width, height);
        let mut map = Map::new(params).unwrap();
        for i in 0..6 {
            add(&mut map, k, &render(&k, &pose(i), |_| 0.0, 1), pose(i), i);
        }
        map
    };
    let small = run(160, 120, ideal());
    let large = run(640, 480, Params { max_pixels: 400_000, ..ideal() });
    let (a, b) = (small.surfels().count(), large.surfels().count());
    assert!(a.abs_diff(b) * 10 < a, "{a} {b}");
    let off =
        |p: &Point3<f32>| (p.z - 2.5).abs().min((p.y - 0.6).abs()).min((-0.8 * p.x + 0.6 * p.z - 2.0).abs());
    let on = large.surfels().filter(|s| s.stable && off(&s.position) < 0.004).count();
    let stable = large.surfels().filter(|s| s.stable).count();
    assert!(on * 100 > stable * 98, "{on} of {stable}");
    let sizes = |m: &Map| m.segments().filter(|s| s.surfels() > 500).count();
    assert_eq!(sizes(&small), sizes(&large));
}

/// Turning the world about up turns the boxes and leaves their sides; they hold the segment and stand on its normal.
#[test]
fn upright_boxes_turn_with_the_world() {
    let (k, up) = (camera(WIDTH, HEIGHT), -Vector3::y());
    let boxes = |world: &Isometry3<f32>| {
        let mut map = Map::new(ideal()).unwrap();
        for i in 0..8 {
            add(&mut map, k, &render(&k, &pose(i), |_| 0.0, 1), world * pose(i), i);
        }
        let mut all: Vec<_> = map
            .segments()
            .filter(|s| s.surfels() > 1000)
            .map(|s| {
                let b = s.upright_box(&(up * 3.0)).unwrap();
                let inside = map.surfels().filter(|f| f.stable && f.segment == Some(s.id())).filter(|f| {
                    let off = f.position - b.centre;
                    b.axes.iter().zip(b.half).all(|(a, h)| a.dot(&off).abs() <= h + 0.02)
                });
                assert!(inside.count() as f32 > 0.97 * s.surfels() as f32);
                assert!((b.axes[2] - up).norm() < 1e-5 && (b.axes[0].cross(&b.axes[1]) - up).norm() < 1e-4);
                assert!(s.upright_box(&Vector3::zeros()).is_none());
                (s.plane().normal.dot(&up).abs() < 0.1, b)
            })
            .collect();
        all.sort_by(|a, b| b.1.half[2].total_cmp(&a.1.half[2]));
        all
    };
    let (a, b) =
        (boxes(&Isometry3::identity()), boxes(&Isometry3::new(Vector3::new(1.0, 2.0, 3.0), up * 0.7)));
    assert!(a.len() >= 2 && a.len() == b.len());
    for ((upright, a), (_, b)) in a.iter().zip(&b) {
        let sides = |b: &gsm::UprightBox| {
            let mut h = b.half;
            h[..2].sort_by(f32::total_cmp);
            h
        };
        assert!(sides(a).iter().zip(sides(b)).all(|(a, b)| (a - b).abs() < 0.05), "{a:?} {b:?}");
        if *upright {
            assert!(sides(a)[0] < 0.06, "a wall is thin: {a:?}");
        }
    }
}

#[test]
fn the_working_scale_can_change_between_frames() {
    let k = camera(320, 240);
    let mut map = Map::new(ideal()).unwrap();
    for (i, pixels) in [40_000, 10_000, 80_000, 80_000, 3_000, 40_000].into_iter().enumerate() {
        map.set_max_pixels(pixels);
        add(&mut map, k, &render(&k, &pose(i), |_| 0.0, 1), pose(i), i);
        let (width, labels) = map.frame_segments();
        assert!(labels.len() as u32 <= pixels && width * width <= 2 * labels.len());
    }
    moments_equal_members(&map);
    assert!(map.segments().filter(|s| s.surfels() > 500).count() >= 2);
}
