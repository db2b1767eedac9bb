//! Frames against rays that parry casts at the same meshes.

#![allow(clippy::unwrap_used, reason = "a test")]

use nalgebra::{Point3, Vector3};
use parry3d::math::Vector;
use parry3d::query::{Ray, RayCast as _};
use parry3d::shape::TriMesh;
use room_synth::{Mesh, Scan, SensorParams, Split, World, WorldParams};
use scan3r::Dataset as _;

fn trimesh(mesh: &Mesh) -> TriMesh {
    let points = mesh.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    TriMesh::new(points, mesh.triangles.clone()).unwrap()
}

/// Nearest hit along a ray from outside: distance and instance. Hits from behind do not count, as
/// walls are seen from the room alone.
fn nearest(
    scan: &Scan,
    meshes: &[(u32, TriMesh)],
    eye: &Point3<f32>,
    along: &Vector3<f32>,
) -> Option<(f32, u32)> {
    assert!(!scan.instances.is_empty());
    let ray = Ray::new(Vector::new(eye.x, eye.y, eye.z), Vector::new(along.x, along.y, along.z));
    let hits = meshes.iter().filter_map(|(id, m)| {
        let hit = m.cast_local_ray_and_get_normal(&ray, 30.0, false)?;
        Some((hit.time_of_impact, *id))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

#[test]
fn clean_frames_agree_with_ray_casts() {
    let params = WorldParams { sensor: SensorParams::clean(), ..WorldParams::default() };
    let world = World::new(Split::Train, 11, 4, &params);
    let (mut checked, mut wrong) = (0, 0);
    for room in world.generated() {
        let scan = &room.scans[0];
        let meshes: Vec<(u32, TriMesh)> =
            scan.instances.iter().map(|i| (i.id, trimesh(&scan.mesh(i)))).collect();
        for (frame, ids) in world.labelled_frames(&scan.id, 0).unwrap().step_by(40) {
            let pose = frame.world_from_camera.unwrap();
            for at in (0..ids.len()).step_by(997) {
                let (u, v) = ((at % 224) as f32, (at / 224) as f32);
                let ray = pose * frame.intrinsics.unproject(u, v, 1.0).coords;
                let hit = nearest(scan, &meshes, &Point3::from(pose.translation.vector), &ray);
                let depth = frame.depth[at];
                checked += 1;
                // A ray of depth 1 per unit: time of impact is depth.
                let same = match hit {
                    None => depth == 0.0,
                    Some((t, id)) => (t - depth).abs() < 2e-3 * t.max(1.0) && ids[at] == id,
                };
                wrong += usize::from(!same);
            }
        }
    }
    assert!(checked > 500, "{checked}");
    // Silhouettes fall to either side, and parry also sees backs.
    assert!(wrong * 50 < checked, "{wrong} of {checked}");
}

#[test]
fn measured_depth_is_whole_millimetres_close_to_the_truth() {
    let noisy = World::new(Split::Train, 11, 1, &WorldParams::default());
    let clean = World::new(
        Split::Train,
        11,
        1,
        &WorldParams { sensor: SensorParams::clean(), ..WorldParams::default() },
    );
    let id = &noisy.rooms()[0].reference;
    let (mut errors, mut pixels, mut lost) = (Vec::new(), 0_usize, 0_usize);
    for (a, b) in noisy.frames(id, 3).unwrap().zip(clean.frames(id, 3).unwrap()).step_by(20) {
        let (a, b) = (a.unwrap(), b.unwrap());
        if let (Some(p), Some(q)) = (a.world_from_camera, b.world_from_camera) {
            assert!((p.translation.vector - q.translation.vector).norm() < 0.05);
            assert!(p.rotation.angle_to(&q.rotation) < 0.03);
        }
        for (d, truth) in a.depth.iter().zip(&b.depth) {
            let mm = (d * 1000.0).round();
            assert_eq!(*d, mm / 1000.0);
            pixels += 1;
            lost += usize::from(*d == 0.0);
            if *d > 0.0 && *truth < 3.0 {
                errors.push((d - truth).abs() / truth);
            }
        }
    }
    errors.sort_by(f32::total_cmp);
    let median = errors[errors.len() / 2];
    assert!((0.001..0.01).contains(&median), "median relative error {median}");
    let share = lost as f64 / pixels as f64;
    assert!((0.01..0.6).contains(&share), "{share}");
}
