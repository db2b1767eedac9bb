//! The annotated surface: points on what can be seen of each object.

use crate::mesh::{Mesh, normal};
use crate::rng::Draw;
use crate::room::{Room, Scan};
use crate::space::Obstacles;
use nalgebra::{Isometry3, Point3};
use scan3r::Annotation;

/// Mean distance between neighbouring points, metres.
pub const SPACING: f32 = 0.028;
/// A surface with something this close before it cannot be seen, metres.
const HIDDEN: f32 = 0.035;

/// Points on the annotated instances of a scan, in its own frame.
pub(crate) fn annotate(room: &Room, scan: &Scan) -> Annotation {
    let seed = room.seed;
    let room_from_scan: Isometry3<f32> = scan.scan_from_room.inverse().cast();
    let outside = |p: &Point3<f32>| beyond(&room.floor, &(room_from_scan * p));
    let meshes: Vec<Mesh> = scan.instances.iter().map(|i| scan.mesh(i)).collect();
    let mut all = Mesh::default();
    for m in &meshes {
        all.append(m);
    }
    let obstacles = Obstacles::new(&all);
    let mut out = Annotation::default();
    for (i, mesh) in scan.instances.iter().zip(&meshes) {
        if !i.annotated {
            continue;
        }
        out.labels.insert(i.id, i.label.to_owned());
        let mut draw = Draw::new(seed, "surface", &[u64::from(i.id)]);
        let from = out.points.len();
        sample(mesh, &mut draw, &obstacles, &outside, &mut out.points);
        out.instances.resize(out.points.len(), i.id);
        debug_assert!(out.points.len() >= from);
    }
    out
}

/// Points on the triangles of a mesh that are not hidden by what stands before them.
fn sample(
    mesh: &Mesh,
    draw: &mut Draw,
    obstacles: &Obstacles,
    outside: &dyn Fn(&Point3<f32>) -> f32,
    out: &mut Vec<Point3<f32>>,
) {
    for &t in &mesh.triangles {
        let c = mesh.corners(t);
        let n = normal(&c);
        let area = (c[1] - c[0]).cross(&(c[2] - c[0])).norm() / 2.0;
        // Nobody films the underside of what is low.
        if n.norm_squared() < 0.5 || (n.z < -0.8 && c[0].z < 0.9) {
            continue;
        }
        let wanted = area / (SPACING * SPACING);
        let count = wanted as usize + usize::from(draw.chance(wanted.fract()));
        for _ in 0..count {
            let (mut a, mut b) = (draw.unit(), draw.unit());
            if a + b > 1.0 {
                (a, b) = (1.0 - a, 1.0 - b);
            }
            let p = c[0] + (c[1] - c[0]) * a + (c[2] - c[0]) * b;
            // Seen from the room, what faces away from it behind a wall is hidden.
            let away = outside(&p) > 0.0 && outside(&(p + n * 0.05)) > outside(&p) + 0.03;
            if !away && obstacles.cast(&(p + n * 0.002), &n, HIDDEN).is_none() {
                out.push(p);
            }
        }
    }
}

/// How far a point is outside the floor plan, metres; 0 inside.
fn beyond(floor: &[[f32; 4]], p: &Point3<f32>) -> f32 {
    let to = |r: &[f32; 4]| {
        let (x, y) = ((r[0] - p.x).max(p.x - r[2]).max(0.0), (r[1] - p.y).max(p.y - r[3]).max(0.0));
        x.hypot(y)
    };
    floor.iter().map(to).fold(f32::INFINITY, f32::min)
}
