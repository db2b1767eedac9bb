//! A z-buffer for a few thousand triangles.

use crate::mesh::normal;
use crate::room::Scan;
use nalgebra::{Isometry3, Point3, Vector3};
use scan3r::Intrinsics;

/// Nothing nearer than this is drawn, metres.
const NEAR: f32 = 0.05;

/// The triangles of one scan in its own frame, ready to be drawn from anywhere.
pub(crate) struct Scene {
    objects: Vec<Object>,
    points: Vec<Point3<f32>>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<Vector3<f32>>,
    /// Index into `objects` per triangle.
    owner: Vec<u16>,
}

struct Object {
    id: u32,
    albedo: f32,
    centre: Point3<f32>,
    radius: f32,
    points: std::ops::Range<usize>,
    triangles: std::ops::Range<usize>,
}

/// What a clean camera sees: 1/depth and triangle per pixel.
pub(crate) struct Image {
    /// 1 / depth, 0 where nothing is.
    pub(crate) inverse: Vec<f32>,
    /// Triangle, `u32::MAX` where nothing is.
    pub(crate) triangle: Vec<u32>,
    /// Unit normals of drawn triangles in the camera frame.
    pub(crate) normals: Vec<Vector3<f32>>,
    camera: Vec<Point3<f32>>,
}

impl Scene {
    pub(crate) fn new(scan: &Scan) -> Self {
        let mut s =
            Self { objects: vec![], points: vec![], triangles: vec![], normals: vec![], owner: vec![] };
        for i in &scan.instances {
            let mesh = scan.mesh(i);
            let b = scan.oriented_box(i);
            let (p0, t0) = (s.points.len(), s.triangles.len());
            s.points.extend_from_slice(&mesh.points);
            for &t in &mesh.triangles {
                let n = normal(&mesh.corners(t));
                if n.norm_squared() > 0.5 {
                    s.triangles.push(t.map(|k| k + p0 as u32));
                    s.normals.push(n);
                    s.owner.push(s.objects.len() as u16);
                }
            }
            s.objects.push(Object {
                id: i.id,
                albedo: i.albedo,
                centre: Point3::from(b.pose.translation.vector),
                radius: Vector3::from(b.half).norm() + 0.25,
                points: p0..s.points.len(),
                triangles: t0..s.triangles.len(),
            });
        }
        s
    }

    /// Instance id and albedo of a triangle.
    pub(crate) fn surface(&self, triangle: u32) -> (u32, f32) {
        let o = &self.objects[usize::from(self.owner[triangle as usize])];
        (o.id, o.albedo)
    }

    pub(crate) fn image(&self, intrinsics: &Intrinsics) -> Image {
        Image {
            inverse: vec![0.0; intrinsics.len()],
            triangle: vec![u32::MAX; intrinsics.len()],
            normals: vec![Vector3::zeros(); self.triangles.len()],
            camera: vec![Point3::origin(); self.points.len()],
        }
    }

    /// Draws the scene from a pose (camera to scan) into an image made by [`Scene::image`].
    pub(crate) fn draw(&self, scan_from_camera: &Isometry3<f32>, k: &Intrinsics, out: &mut Image) {
        out.inverse.fill(0.0);
        out.triangle.fill(u32::MAX);
        let camera_from_scan = scan_from_camera.inverse();
        let rotation = camera_from_scan.rotation.to_rotation_matrix().into_inner();
        let eye = scan_from_camera.translation.vector;
        let planes = frustum(k);
        for o in &self.objects {
            let c = rotation * (o.centre.coords - eye);
            if c.z < -o.radius || planes.iter().any(|n| n.dot(&c) < -o.radius) {
                continue;
            }
            for (p, q) in self.points[o.points.clone()].iter().zip(&mut out.camera[o.points.clone()]) {
                *q = Point3::from(rotation * (p.coords - eye));
            }
            for t in o.triangles.clone() {
                let c = self.triangles[t].map(|i| out.camera[i as usize]);
                let n = rotation * self.normals[t];
                let d = n.dot(&c[0].coords);
                // Seen from behind, or edge on.
                if d > -1e-5 {
                    continue;
                }
                out.normals[t] = n;
                let plane = Plane {
                    x: n.x / (d * k.fx),
                    y: n.y / (d * k.fy),
                    c: (n.z - n.x * k.cx / k.fx - n.y * k.cy / k.fy) / d,
                };
                fill(&c, &plane, k, t as u32, out);
            }
        }
    }
}

/// 1/depth over the image: `x u + y v + c`.
struct Plane {
    x: f32,
    y: f32,
    c: f32,
}

/// Inward normals of the four sides of the view.
fn frustum(k: &Intrinsics) -> [Vector3<f32>; 4] {
    let (w, h) = (k.width as f32, k.height as f32);
    [
        Vector3::new(k.fx, 0.0, k.cx + 0.5).normalize(),
        Vector3::new(-k.fx, 0.0, w - 0.5 - k.cx).normalize(),
        Vector3::new(0.0, k.fy, k.cy + 0.5).normalize(),
        Vector3::new(0.0, -k.fy, h - 0.5 - k.cy).normalize(),
    ]
}

/// Draws one triangle given in the camera frame: clipped at the near plane, then row by row.
fn fill(c: &[Point3<f32>; 3], plane: &Plane, k: &Intrinsics, id: u32, out: &mut Image) {
    let mut poly = [[0.0_f32; 2]; 4];
    let mut n = 0;
    let project = |p: &Point3<f32>| [p.x / p.z * k.fx + k.cx, p.y / p.z * k.fy + k.cy];
    for i in 0..3 {
        let (a, b) = (&c[i], &c[(i + 1) % 3]);
        if a.z >= NEAR {
            poly[n] = project(a);
            n += 1;
        }
        if (a.z >= NEAR) != (b.z >= NEAR) {
            let s = (NEAR - a.z) / (b.z - a.z);
            poly[n] = project(&(a + (b - a) * s));
            n += 1;
        }
    }
    if n < 3 {
        return;
    }
    let poly = &poly[..n];
    let (mut top, mut bottom) = (f32::INFINITY, f32::NEG_INFINITY);
    for p in poly {
        top = top.min(p[1]);
        bottom = bottom.max(p[1]);
    }
    let first = top.ceil().max(0.0);
    let last = bottom.ceil().min(k.height as f32);
    let mut v = first;
    while v < last {
        let (mut l, mut r) = (f32::INFINITY, f32::NEG_INFINITY);
        for i in 0..n {
            let (a, b) = (poly[i], poly[(i + 1) % n]);
            // Half-open in v, so that neighbours share no row twice.
            if (a[1] <= v) != (b[1] <= v) {
                let x = a[0] + (v - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                l = l.min(x);
                r = r.max(x);
            }
        }
        let (from, to) = (l.ceil().max(0.0) as usize, r.ceil().clamp(0.0, k.width as f32) as usize);
        if from < to {
            let row = v as usize * k.width as usize;
            let base = plane.y * v + plane.c;
            let depths = &mut out.inverse[row + from..row + to];
            let ids = &mut out.triangle[row + from..row + to];
            for (i, (z, t)) in depths.iter_mut().zip(ids).enumerate() {
                let inverse = base + plane.x * (from + i) as f32;
                if inverse > *z {
                    *z = inverse;
                    *t = id;
                }
            }
        }
        v += 1.0;
    }
}
