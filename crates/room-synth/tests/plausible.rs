//! Nothing floats, nothing stands in something else, and people do not walk through furniture.

#![allow(clippy::unwrap_used, reason = "a test")]

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d::math::{Pose, Rotation, Vector};
use parry3d::query::{Ray, RayCast as _, intersection_test};
use parry3d::shape::{Cuboid, TriMesh};
use room_synth::{Contact, Instance, OrientedBox, Split, World, WorldParams};

fn pose(p: &Isometry3<f32>) -> Pose {
    let (t, q) = (p.translation.vector, p.rotation.coords);
    Pose::from_parts(Vector::new(t.x, t.y, t.z), Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}

/// Whether two boxes enter each other by more than `tolerance` metres on every axis.
fn enters(a: &OrientedBox, b: &OrientedBox, tolerance: f32) -> bool {
    let shrunk = |o: &OrientedBox| {
        Cuboid::new(Vector::new(
            (o.half[0] - tolerance).max(0.001),
            (o.half[1] - tolerance).max(0.001),
            (o.half[2] - tolerance).max(0.001),
        ))
    };
    intersection_test(&pose(&a.pose), &shrunk(a), &pose(&b.pose), &shrunk(b)).is_ok_and(|i| i.intersecting)
}

fn building(i: &Instance) -> bool {
    matches!(i.label, "wall" | "floor" | "ceiling" | "door" | "doorframe" | "window")
}

/// What may share the box of another: things on it, in it, or pushed under it.
fn may_share(a: &Instance, b: &Instance) -> bool {
    let linked = |x: &Instance, y: &Instance| x.supports.iter().any(|s| s.parent == y.id);
    let seat = |l: &str| matches!(l, "chair" | "dining chair" | "stool" | "bench");
    let host = |l: &str| matches!(l, "table" | "dining table" | "desk" | "counter" | "kitchen counter");
    linked(a, b) || linked(b, a) || (seat(a.label) && host(b.label)) || (seat(b.label) && host(a.label))
        // An oven is in a cabinet and under its counter; a sink in a counter reaches into the cabinet.
        || matches!((a.label, b.label), ("oven" | "sink", _) | (_, "oven" | "sink"))
}

#[test]
fn solid_things_do_not_enter_each_other() {
    let world = World::new(Split::Train, 21, 60, &WorldParams { rescans: false, ..WorldParams::default() });
    let (mut pairs, mut bad) = (0, Vec::new());
    for room in world.generated() {
        let things: Vec<&Instance> = room.scans[0].instances.iter().filter(|i| !building(i)).collect();
        for (k, a) in things.iter().enumerate() {
            for b in &things[k + 1..] {
                pairs += 1;
                if !may_share(a, b) && enters(&a.oriented_box(), &b.oriented_box(), 0.015) {
                    bad.push((a.label, b.label));
                }
            }
        }
    }
    assert!(pairs > 5000);
    assert!(bad.len() * 2000 < pairs, "{} of {pairs}: {bad:?}", bad.len());
}

#[test]
fn what_stands_or_lies_rests_on_its_support() {
    let world = World::new(Split::Train, 22, 60, &WorldParams::default());
    let (mut checked, mut floating) = (0, Vec::new());
    for scan in world.generated().iter().flat_map(|r| &r.scans) {
        for i in &scan.instances {
            let Some(s) =
                i.supports.first().filter(|s| matches!(s.contact, Contact::StandingOn | Contact::LyingOn))
            else {
                continue;
            };
            let Some(parent) = scan.instance(s.parent) else { continue };
            let mesh = parent.mesh();
            let points = mesh.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
            let host = TriMesh::new(points, mesh.triangles.clone()).unwrap();
            let base: Point3<f32> =
                parent.room_from_object.inverse() * (i.room_from_object * Point3::new(0.0, 0.0, 0.06));
            let down: Vector3<f32> = -Vector3::z();
            let hit = host.cast_local_ray(
                &Ray::new(Vector::new(base.x, base.y, base.z), Vector::new(down.x, down.y, down.z)),
                0.2,
                false,
            );
            checked += 1;
            if hit.is_none_or(|t| (t - 0.06).abs() > 0.05) {
                floating.push((i.label, parent.label, hit));
            }
        }
    }
    assert!(checked > 1000, "{checked}");
    assert!(
        floating.len() * 40 < checked,
        "{} of {checked}: {:?}",
        floating.len(),
        &floating[..floating.len().min(40)]
    );
}

#[test]
fn the_camera_keeps_off_furniture_and_stays_in_the_room() {
    let world = World::new(Split::Train, 23, 12, &WorldParams::default());
    let (mut frames, mut inside) = (0, 0);
    for room in world.generated() {
        let scan = &room.scans[0];
        let boxes: Vec<OrientedBox> =
            scan.instances.iter().filter(|i| !building(i)).map(|i| scan.oriented_box(i)).collect();
        let floor = scan.oriented_box(&scan.instances[0]);
        for (frame, _) in world.labelled_frames(&scan.id, 0).unwrap().step_by(15) {
            let Some(p) = frame.world_from_camera else { continue };
            frames += 1;
            let at = |b: &OrientedBox| b.pose.inverse() * Point3::from(p.translation.vector);
            inside += usize::from(boxes.iter().any(|b| (0..3).all(|k| at(b)[k].abs() < b.half[k])));
            let f = at(&floor);
            assert!(
                f.x.abs() < floor.half[0] && f.y.abs() < floor.half[1] && (1.2..1.8).contains(&f.z),
                "{f}"
            );
        }
    }
    assert!(frames > 100 && inside * 50 < frames, "{inside} of {frames}");
}
