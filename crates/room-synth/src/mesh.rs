//! Triangle meshes and the few solids that furniture is made of.

use nalgebra::{Isometry3, Point3, Vector3};

/// A triangle mesh, metres. Triangles wind counter-clockwise seen from outside; a sheet that can
/// be seen from both sides holds its triangles twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertices.
    pub points: Vec<Point3<f32>>,
    /// Indices into `points`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Smallest and largest coordinate per axis; `None` for an empty mesh.
    #[must_use]
    pub fn bounds(&self) -> Option<(Point3<f32>, Point3<f32>)> {
        let first = *self.points.first()?;
        Some(self.points.iter().fold((first, first), |(lo, hi), p| (lo.inf(p), hi.sup(p))))
    }

    /// The corners of a triangle.
    #[must_use]
    pub fn corners(&self, triangle: [u32; 3]) -> [Point3<f32>; 3] {
        triangle.map(|i| self.points[i as usize])
    }

    fn vertex(&mut self, x: f32, y: f32, z: f32) -> u32 {
        self.points.push(Point3::new(x, y, z));
        self.points.len() as u32 - 1
    }

    /// Four corners, counter-clockwise seen from the front.
    pub(crate) fn quad(&mut self, c: [[f32; 3]; 4]) {
        let i = c.map(|[x, y, z]| self.vertex(x, y, z));
        self.triangles.extend([[i[0], i[1], i[2]], [i[0], i[2], i[3]]]);
    }

    /// A box between two corners. Faces are double triangles, twelve in all.
    pub(crate) fn cuboid(&mut self, lo: [f32; 3], hi: [f32; 3]) {
        let [a, b, c] = lo;
        let [x, y, z] = hi;
        let v: Vec<u32> =
            [[a, b, c], [x, b, c], [x, y, c], [a, y, c], [a, b, z], [x, b, z], [x, y, z], [a, y, z]]
                .iter()
                .map(|p| self.vertex(p[0], p[1], p[2]))
                .collect();
        for f in [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6], [1, 2, 6, 5], [3, 0, 4, 7]] {
            self.triangles.extend([[v[f[0]], v[f[1]], v[f[2]]], [v[f[0]], v[f[2]], v[f[3]]]]);
        }
    }

    /// A box by its centre in x and y, its floor, and its full size.
    pub(crate) fn block(&mut self, x: f32, y: f32, z: f32, size: [f32; 3]) {
        let [w, d, h] = size;
        self.cuboid([x - w / 2.0, y - d / 2.0, z], [x + w / 2.0, y + d / 2.0, z + h]);
    }

    /// A body of revolution about the vertical through (x, y): (radius, height) from bottom to
    /// top, closed at both ends where the radius is not zero.
    pub(crate) fn lathe(&mut self, x: f32, y: f32, profile: &[(f32, f32)], sides: u32) {
        let base = self.points.len() as u32;
        for &(r, z) in profile {
            for k in 0..sides {
                let (s, c) = (std::f32::consts::TAU * k as f32 / sides as f32).sin_cos();
                self.vertex(x + r * c, y + r * s, z);
            }
        }
        for ring in 0..profile.len().saturating_sub(1) as u32 {
            for k in 0..sides {
                let next = (k + 1) % sides;
                let (a, b) = (base + ring * sides, base + (ring + 1) * sides);
                self.triangles.extend([[a + k, a + next, b + next], [a + k, b + next, b + k]]);
            }
        }
        let last = base + (profile.len() as u32 - 1) * sides;
        for k in 1..sides - 1 {
            self.triangles.extend([[base, base + k + 1, base + k], [last, last + k, last + k + 1]]);
        }
    }

    /// A rounded cushion: `power` 2 is an ellipsoid, larger is boxier.
    pub(crate) fn cushion(&mut self, centre: [f32; 3], radii: [f32; 3], power: f32, detail: u32) {
        let base = self.points.len() as u32;
        let (rows, cols) = (detail, 2 * detail);
        let curve = |v: f32| v.signum() * v.abs().powf(2.0 / power);
        for r in 0..=rows {
            let (sv, cv) = (std::f32::consts::PI * (r as f32 / rows as f32 - 0.5)).sin_cos();
            for c in 0..cols {
                let (su, cu) = (std::f32::consts::TAU * c as f32 / cols as f32).sin_cos();
                self.vertex(
                    centre[0] + radii[0] * curve(cv) * curve(cu),
                    centre[1] + radii[1] * curve(cv) * curve(su),
                    centre[2] + radii[2] * curve(sv),
                );
            }
        }
        for r in 0..rows {
            for c in 0..cols {
                let next = (c + 1) % cols;
                let (a, b) = (base + r * cols, base + (r + 1) * cols);
                if r > 0 {
                    self.triangles.push([a + c, a + next, b + next]);
                }
                if r + 1 < rows {
                    self.triangles.push([a + c, b + next, b + c]);
                }
            }
        }
    }

    /// A sheet of `columns` x `rows` cells over [0, 1] x [0, 1], visible from both sides.
    pub(crate) fn sheet(&mut self, columns: u32, rows: u32, at: impl Fn(f32, f32) -> [f32; 3]) {
        let base = self.points.len() as u32;
        for r in 0..=rows {
            for c in 0..=columns {
                let [x, y, z] = at(c as f32 / columns as f32, r as f32 / rows as f32);
                self.vertex(x, y, z);
            }
        }
        for r in 0..rows {
            for c in 0..columns {
                let a = base + r * (columns + 1) + c;
                let (b, d, e) = (a + 1, a + columns + 1, a + columns + 2);
                self.triangles.extend([[a, b, e], [a, e, d], [a, e, b], [a, d, e]]);
            }
        }
    }

    /// Stretches the mesh to fill the box of that size whose base is centred on the origin.
    pub(crate) fn fit(mut self, size: [f32; 3]) -> Self {
        let Some((lo, hi)) = self.bounds() else { return self };
        let target = [-size[0] / 2.0, -size[1] / 2.0, 0.0];
        for p in &mut self.points {
            for k in 0..3 {
                let span = (hi[k] - lo[k]).max(1e-6);
                p[k] = target[k] + (p[k] - lo[k]) / span * size[k];
            }
        }
        self
    }

    pub(crate) fn transformed(mut self, pose: &Isometry3<f32>) -> Self {
        for p in &mut self.points {
            *p = pose * *p;
        }
        self
    }

    pub(crate) fn append(&mut self, other: &Self) {
        let base = self.points.len() as u32;
        self.points.extend_from_slice(&other.points);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }
}

/// Unit normal of a triangle; zero where it has no area.
pub(crate) fn normal(c: &[Point3<f32>; 3]) -> Vector3<f32> {
    (c[1] - c[0]).cross(&(c[2] - c[0])).try_normalize(1e-12).unwrap_or_else(Vector3::zeros)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signed volume by the divergence theorem: positive where triangles face outward.
    fn volume(m: &Mesh) -> f32 {
        m.triangles
            .iter()
            .map(|&t| m.corners(t))
            .map(|[a, b, c]| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0)
            .sum()
    }

    #[test]
    fn solids_face_outward_and_have_their_volume() {
        let mut m = Mesh::default();
        m.block(1.0, 2.0, 3.0, [0.5, 0.4, 0.3]);
        assert!((volume(&m) - 0.06).abs() < 1e-4);
        let mut m = Mesh::default();
        m.lathe(0.0, 0.0, &[(1.0, 0.0), (1.0, 2.0)], 64);
        assert!((volume(&m) - 2.0 * std::f32::consts::PI).abs() < 0.02);
        let mut m = Mesh::default();
        m.cushion([0.0; 3], [1.0; 3], 2.0, 24);
        assert!((volume(&m) - 4.0 / 3.0 * std::f32::consts::PI).abs() < 0.06);
    }
}
