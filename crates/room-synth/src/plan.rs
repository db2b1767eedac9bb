//! The bare room: floor plan, walls, where walls have holes.

use crate::mesh::Mesh;
use crate::rng::Draw;
use nalgebra::{Isometry3, Point2, Translation3, UnitQuaternion, Vector2, Vector3};

/// A stretch of wall seen from the room: `a` to `b` with the room on the side of `inward`.
#[derive(Clone, Debug)]
pub(crate) struct WallLine {
    pub(crate) a: Point2<f32>,
    pub(crate) b: Point2<f32>,
    pub(crate) inward: Vector2<f32>,
    /// Holes as (from, to, low, high): metres along the wall from `a`, heights.
    pub(crate) holes: Vec<[f32; 4]>,
    /// No wall stands here: the room goes on.
    pub(crate) open: bool,
    pub(crate) thickness: f32,
    /// Height at which one piece of the wall ends and another begins.
    pub(crate) cut: Option<f32>,
}

impl WallLine {
    pub(crate) fn length(&self) -> f32 {
        (self.b - self.a).norm()
    }

    pub(crate) fn along(&self) -> Vector2<f32> {
        (self.b - self.a).normalize()
    }

    /// The pose of something whose back is `gap` off the wall, `u` metres along it, base at `z`,
    /// `depth` deep.
    pub(crate) fn pose(&self, u: f32, gap: f32, depth: f32, z: f32) -> Isometry3<f32> {
        let p = self.a + self.along() * u + self.inward * (gap + depth / 2.0);
        facing(p, self.inward, z)
    }

    /// The wall between two heights as a mesh about its middle, front at +y, `bottom` at 0.
    pub(crate) fn mesh(&self, bottom: f32, top: f32) -> Mesh {
        let mut m = Mesh::default();
        let (l, y, back) = (self.length(), self.thickness / 2.0, -self.thickness / 2.0);
        // Seen from the room, x grows to the left: local x = inward turned by -90 degrees.
        let flip =
            if self.along().x * self.inward.y - self.along().y * self.inward.x > 0.0 { 1.0 } else { -1.0 };
        let x = |u: f32| flip * (u - l / 2.0);
        let mut face = |u0: f32, u1: f32, z0: f32, z1: f32| {
            if u1 - u0 > 1e-3 && z1 - z0 > 1e-3 {
                let (p, q) = (x(u0).min(x(u1)), x(u0).max(x(u1)));
                m.quad([[p, y, z0], [p, y, z1], [q, y, z1], [q, y, z0]]);
            }
        };
        let mut holes = self.holes.clone();
        holes.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut at = 0.0;
        for h in &holes {
            face(at, h[0], bottom, top);
            face(h[0], h[1], bottom, h[2].min(top));
            face(h[0], h[1], h[3].max(bottom), top);
            at = h[1];
        }
        face(at, l, bottom, top);
        for h in holes.iter().filter(|h| h[2] < top && h[3] > bottom) {
            let h = [h[0], h[1], h[2].max(bottom), h[3].min(top)];
            let (p, q) = (x(h[0]).min(x(h[1])), x(h[0]).max(x(h[1])));
            m.quad([[p, y, h[2]], [p, y, h[3]], [p, back, h[3]], [p, back, h[2]]]);
            m.quad([[q, back, h[2]], [q, back, h[3]], [q, y, h[3]], [q, y, h[2]]]);
            if h[3] < top {
                m.quad([[p, y, h[3]], [q, y, h[3]], [q, back, h[3]], [p, back, h[3]]]);
            }
            if h[2] > bottom {
                m.quad([[p, back, h[2]], [q, back, h[2]], [q, y, h[2]], [p, y, h[2]]]);
            }
        }
        for p in &mut m.points {
            p.z -= bottom;
        }
        m
    }
}

/// Base centre at `p`, front towards `front`.
pub(crate) fn facing(p: Point2<f32>, front: Vector2<f32>, z: f32) -> Isometry3<f32> {
    let yaw = (-front.x).atan2(front.y);
    Isometry3::from_parts(
        Translation3::new(p.x, p.y, z),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw),
    )
}

/// Floor rectangles, walls and height of a room.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// (x0, y0, x1, y1); they may share borders but do not overlap.
    pub(crate) rects: Vec<[f32; 4]>,
    pub(crate) walls: Vec<WallLine>,
    pub(crate) height: f32,
}

impl Plan {
    /// A rectangle or an L, some walls cut into pieces, some left out.
    pub(crate) fn draw(draw: &mut Draw, mut w: f32, mut l: f32, richness: f32) -> Self {
        if draw.chance(0.5) {
            std::mem::swap(&mut w, &mut l);
        }
        let (x, y) = (w / 2.0, l / 2.0);
        let height = draw.range(2.25, 2.75);
        let corner = w.min(l) > 2.4 && draw.chance(0.2 * richness.min(1.6));
        let (rects, corners) = if corner {
            let (nx, ny) = (w * draw.range(0.25, 0.45), l * draw.range(0.25, 0.45));
            let (cx, cy) = (x - nx, y - ny);
            (
                vec![[-x, -y, cx, y], [cx, -y, x, cy]],
                vec![[-x, -y], [x, -y], [x, cy], [cx, cy], [cx, y], [-x, y]],
            )
        } else {
            (vec![[-x, -y, x, y]], vec![[-x, -y], [x, -y], [x, y], [-x, y]])
        };
        let mut walls = Vec::new();
        for (k, c) in corners.iter().enumerate() {
            let d = corners[(k + 1) % corners.len()];
            let (a, b) = (Point2::new(c[0], c[1]), Point2::new(d[0], d[1]));
            let along = (b - a).normalize();
            let inward = Vector2::new(-along.y, along.x);
            let thickness = 0.05 + 0.3 * draw.unit() * draw.unit();
            let cut = draw
                .chance(0.27)
                .then(|| if draw.chance(0.5) { draw.range(0.8, 1.5) } else { draw.range(1.5, 2.1) });
            let line = |a, b| WallLine { a, b, inward, holes: Vec::new(), open: false, thickness, cut };
            let length = (b - a).norm();
            if length > 1.8 && draw.chance((0.1 * richness).min(0.5)) {
                let cut = a + along * (length * draw.range(0.12, 0.88));
                walls.extend([line(a, cut), line(cut, b)]);
            } else {
                walls.push(line(a, b));
            }
        }
        let open = draw.weighted([0.22, 0.36, 0.42].into_iter());
        for _ in 0..open {
            let k = draw.below(walls.len());
            walls[k].open = true;
        }
        Self { rects, walls, height }
    }

    /// Whether a point is at least `margin` inside the floor.
    pub(crate) fn contains(&self, p: &Point2<f32>, margin: f32) -> bool {
        // A margin at a border shared by two rectangles must not count: test the point's own cross.
        let inside = |q: Point2<f32>| {
            self.rects.iter().any(|r| q.x >= r[0] && q.x <= r[2] && q.y >= r[1] && q.y <= r[3])
        };
        [(0.0, 0.0), (margin, 0.0), (-margin, 0.0), (0.0, margin), (0.0, -margin)]
            .iter()
            .all(|&(dx, dy)| inside(Point2::new(p.x + dx, p.y + dy)))
    }

    /// Floor (upwards) or ceiling (downwards) as a mesh at height 0, and the size of its box.
    pub(crate) fn slab(&self, up: bool) -> (Mesh, [f32; 3]) {
        let mut m = Mesh::default();
        for r in &self.rects {
            let mut c = [[r[0], r[1], 0.0], [r[2], r[1], 0.0], [r[2], r[3], 0.0], [r[0], r[3], 0.0]];
            if !up {
                c.reverse();
            }
            m.quad(c);
        }
        let x = self.rects.iter().fold((0.0_f32, 0.0_f32), |a, r| (a.0.min(r[0]), a.1.max(r[2])));
        let y = self.rects.iter().fold((0.0_f32, 0.0_f32), |a, r| (a.0.min(r[1]), a.1.max(r[3])));
        (m, [x.1 - x.0, y.1 - y.0, 0.02])
    }
}
