//! Parts that no geometry tells apart: a wall that the annotation cuts in two is one plane to the camera.

use nalgebra::{Matrix3, Point3, Vector3};
use scan3r::Annotation;
use std::collections::BTreeMap;

/// Vertices belong to the plane of their part within this, metres.
const OFF: f32 = 0.02;
/// Share of a part's vertices that lie on the plane of a flat part.
const FLAT: f32 = 0.6;
/// Two parts touch when their boxes come so close, metres.
const TOUCH: f32 = 0.05;

/// A part's plane `normal · x = offset`, if it is flat, and its box.
struct Part {
    label: String,
    plane: Option<(Vector3<f32>, f32)>,
    low: Point3<f32>,
    high: Point3<f32>,
}

/// The instances that have vertices, each with the lowest instance that it is one surface with: of the same label, in
/// one plane (within 2 cm), touching (boxes within 5 cm), directly or over others.
#[must_use]
pub fn surfaces(a: &Annotation) -> BTreeMap<u32, u32> {
    let mut points: BTreeMap<u32, Vec<Point3<f32>>> = BTreeMap::new();
    for (p, &id) in a.points.iter().zip(&a.instances).filter(|(_, id)| **id != 0) {
        points.entry(id).or_default().push(*p);
    }
    let parts: BTreeMap<u32, Part> = points
        .iter()
        .filter_map(|(&id, p)| Some((id, Part::new(a.labels.get(&id).cloned().unwrap_or_default(), p)?)))
        .collect();
    let mut of: BTreeMap<u32, u32> = parts.keys().map(|&id| (id, id)).collect();
    for (&i, p) in &parts {
        for (&j, q) in parts.range(i + 1..) {
            if p.one_with(q, &points[&j]) && q.one_with(p, &points[&i]) {
                let (low, high) = (of[&i].min(of[&j]), of[&i].max(of[&j]));
                of.values_mut().filter(|v| **v == high).for_each(|v| *v = low);
            }
        }
    }
    of
}

impl Part {
    fn new(label: String, points: &[Point3<f32>]) -> Option<Self> {
        let first = *points.first()?;
        let (low, high) = points.iter().fold((first, first), |(l, h), p| (l.inf(p), h.sup(p)));
        Some(Self { label, plane: plane(points), low, high })
    }

    fn one_with(&self, other: &Self, points: &[Point3<f32>]) -> bool {
        let near =
            (0..3).all(|k| self.low[k] - TOUCH <= other.high[k] && other.low[k] - TOUCH <= self.high[k]);
        self.label == other.label && near && self.plane.is_some_and(|p| share(p, points) >= FLAT)
    }
}

/// Share of the points on a plane.
fn share((normal, offset): (Vector3<f32>, f32), points: &[Point3<f32>]) -> f32 {
    let on = points.iter().filter(|p| (normal.dot(&p.coords) - offset).abs() <= OFF).count();
    on as f32 / points.len().max(1) as f32
}

/// The plane that most of the points lie on: fitted to all, then to those near the last fit; `None` when there is none.
fn plane(points: &[Point3<f32>]) -> Option<(Vector3<f32>, f32)> {
    let mut fit = least_squares(points)?;
    for reach in [0.3, 0.1, 0.04, OFF, OFF] {
        let near: Vec<_> =
            points.iter().filter(|p| (fit.0.dot(&p.coords) - fit.1).abs() <= reach).copied().collect();
        fit = least_squares(&near)?;
    }
    (share(fit, points) >= FLAT).then_some(fit)
}

fn least_squares(points: &[Point3<f32>]) -> Option<(Vector3<f32>, f32)> {
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let mean = points.iter().map(|p| p.coords.cast::<f64>()).sum::<Vector3<f64>>() / n;
    let spread: Matrix3<f64> =
        points.iter().map(|p| p.coords.cast::<f64>() - mean).map(|d| d * d.transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).normalize();
    Some((normal.cast(), normal.dot(&mean) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Adds a rectangle in the plane y = `y` or, turned, x = `y`.
    fn rectangle(
        a: &mut Annotation,
        id: u32,
        label: &str,
        from: [f32; 2],
        to: [f32; 2],
        y: f32,
        turned: bool,
    ) {
        for i in 0..20 {
            for j in 0..20 {
                let (s, t) = (i as f32 / 19.0, j as f32 / 19.0);
                let (u, z) = (from[0] + s * (to[0] - from[0]), from[1] + t * (to[1] - from[1]));
                a.points.push(if turned { Point3::new(y, u, z) } else { Point3::new(u, y, z) });
                a.instances.push(id);
            }
        }
        a.labels.insert(id, label.to_owned());
    }

    #[test]
    fn pieces_of_a_wall_are_one_and_nothing_else_is() {
        let mut a = Annotation { points: vec![], instances: vec![], labels: BTreeMap::new() };
        rectangle(&mut a, 2, "wall", [0.0, 0.0], [3.0, 1.2], 0.0, false);
        rectangle(&mut a, 3, "wall", [0.0, 0.0], [4.0, 2.4], 3.0, true); // a corner
        rectangle(&mut a, 5, "wall", [0.0, 1.2], [3.0, 2.4], 0.0, false); // above 2
        rectangle(&mut a, 6, "wall", [-2.0, 0.0], [-0.01, 2.4], 0.0, false); // beside both
        rectangle(&mut a, 7, "wall", [-5.0, 0.0], [-3.0, 2.4], 0.0, false); // in the plane, apart
        rectangle(&mut a, 8, "door", [0.5, 0.0], [1.5, 2.0], 0.0, false); // flush, but a door
        rectangle(&mut a, 9, "wall", [0.0, 0.0], [3.0, 2.4], 0.3, false); // parallel
        let of = surfaces(&a);
        assert_eq!(of, BTreeMap::from([(2, 2), (3, 3), (5, 2), (6, 2), (7, 7), (8, 8), (9, 9)]));
    }
}
