//! Depth samples on annotated surfaces, against the nearest vertex by brute force.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use bench_3rscan::{Seen, Surface};
use common::block;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use scan3r::{Annotation, Frame, Intrinsics};
use std::collections::BTreeMap;

/// Three blocks of vertices more than a metre apart, one of them background.
fn scene() -> Annotation {
    let mut a = Annotation::default();
    for (id, x) in [(7, 0.0), (0, 2.0), (9, 4.0)] {
        let points = block([x, 0.5, 1.0], [0.8, 0.6, 0.0]);
        a.instances.extend(vec![id; points.len()]);
        a.points.extend(points);
    }
    a.labels = [(7, "chair".to_owned()), (9, "table".to_owned())].into();
    a
}

fn nearest(a: &Annotation, p: &Point3<f32>) -> (f32, u32) {
    let d = a.points.iter().map(|v| (v - p).norm()).zip(a.instances.iter().copied());
    d.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// A sample belongs to the nearest vertex within a few centimetres; between 4 cm (sure to
    /// count) and 18 cm (sure not to) the grid may decide either way.
    #[test]
    fn samples_fall_on_the_nearest_vertex(
        pixels in prop::collection::vec((-0.6_f32..4.6, 0.1_f32..0.9, -0.03_f32..0.03, 0_u8..8), 64),
        yaw in -3.0_f32..3.0,
        tilt in -0.3_f32..0.3,
    ) {
        let a = scene();
        let surface = Surface::new(a.clone());
        let mut seen = Seen::new(&surface);
        let k = Intrinsics::new(1.0, 1.0, 0.0, 0.0, 1, 1).unwrap();
        let rotation = UnitQuaternion::from_euler_angles(tilt, 0.1, yaw);
        let (mut least, mut most) = (BTreeMap::new(), BTreeMap::new());
        for (x, y, dz, kind) in pixels {
            // One in eight samples is far off every surface, one has no depth.
            let p = Point3::new(x, y, if kind == 0 { 1.6 } else { 1.0 + dz });
            let depth = if kind == 1 { 0.0 } else { 1.5 };
            // The camera looks along its own z at the point.
            let from = p - rotation * Vector3::new(0.0, 0.0, 1.5);
            let pose = Isometry3::from_parts(Translation3::from(from.coords), rotation);
            seen.observe(&surface, &Frame {
                index: 0, time: 0.0, depth: vec![depth], intrinsics: k, world_from_camera: Some(pose),
            });
            let (d, id) = nearest(&a, &p);
            if depth > 0.0 && id != 0 {
                *least.entry(id).or_insert(0_u64) += u64::from(d < 0.039);
                *most.entry(id).or_insert(0_u64) += u64::from(d < 0.18);
            }
        }
        for id in [7, 9] {
            let n = seen.samples(id);
            let (lo, hi) = (least.get(&id).copied().unwrap_or(0), most.get(&id).copied().unwrap_or(0));
            prop_assert!((lo..=hi).contains(&n), "instance {}: {} samples, want {} to {}", id, n, lo, hi);
        }
        prop_assert_eq!(seen.samples(0), 0);
    }
}

/// A whole image of a wall: every pixel is counted, runs of equal instances or not.
#[test]
fn every_pixel_of_an_image_counts_once() {
    let mut a = Annotation::default();
    // Stripes 0.2 m wide, instances 1 to 5 in turn.
    for k in 0..20_u32 {
        let points = block([k as f32 * 0.2 + 0.085, 1.0, 2.0], [0.17, 2.0, 0.0]);
        a.instances.extend(vec![1 + k % 5; points.len()]);
        a.points.extend(points);
    }
    let surface = Surface::new(a);
    let k = Intrinsics::new(40.0, 40.0, 40.0, 20.0, 80, 40).unwrap();
    let frame = Frame {
        index: 0,
        time: 0.0,
        depth: vec![2.0; 80 * 40],
        intrinsics: k,
        world_from_camera: Some(Isometry3::translation(2.0, 1.0, 0.0)),
    };
    let mut seen = Seen::new(&surface);
    seen.observe(&surface, &frame);
    let on_surface = (0..40).flat_map(|v| (0..80).map(move |u| (u, v))).filter(|&(u, v)| {
        let p = k.unproject(u as f32, v as f32, 2.0) + Vector3::new(2.0, 1.0, 0.0);
        surface.vertex_near(&p).is_some()
    });
    let expected = on_surface.count() as u64;
    let total: u64 = (1..=5).map(|i| seen.samples(i)).sum();
    assert_eq!(total, expected);
    assert!(expected > 3000, "{expected} of 3200 pixels fall on the wall");
    // Two visits of the same scan are the sum of both.
    let once = seen.clone();
    seen.add(&once);
    assert!((1..=5).all(|i| seen.samples(i) == 2 * once.samples(i)));
}

#[test]
fn one_sample_does_not_make_a_vertex_seen_and_no_pose_counts_nothing() {
    let a =
        Annotation { points: vec![Point3::new(0.0, 0.0, 1.0)], instances: vec![3], labels: BTreeMap::new() };
    let surface = Surface::new(a.clone());
    let mut seen = Seen::new(&surface);
    let mut frame = Frame {
        index: 0,
        time: 0.0,
        depth: vec![1.0],
        intrinsics: Intrinsics::new(1.0, 1.0, 0.0, 0.0, 1, 1).unwrap(),
        world_from_camera: None,
    };
    seen.observe(&surface, &frame);
    assert_eq!(seen, Seen::new(&surface));
    frame.world_from_camera = Some(Isometry3::identity());
    seen.observe(&surface, &frame);
    assert!(seen.seen_points(&a).is_empty(), "a flying pixel is no surface");
    seen.observe(&surface, &frame);
    assert_eq!(seen.seen_points(&a), BTreeMap::from([(3, vec![a.points[0]])]));
    assert_eq!(seen.samples(3), 2);
}
