//! Pieces of one wall or floor: what stands before a wall cuts it into pieces that lie in one plane.

use crate::Box3;
use nalgebra::{Point3, Vector3};

/// Structure no thicker than this is a plane, metres: a wall with its reveals, a floor with its noise.
const THICK: f32 = 0.4;
/// By how much a piece may stand out of the plane of the other, metres.
const STEP: f32 = 0.1;
/// A wall that meets a plane ends at most this far from it, metres.
const MEETS: f32 = 0.3;
/// A wall between two pieces is this much thicker than their gap at most, on either side, metres.
const BEYOND: f32 = 0.1;

/// A box with a footprint that is thin in one direction.
#[derive(Clone, Copy)]
struct Plane {
    centre: Point3<f32>,
    /// Two directions within the plane, and the one across.
    axes: [Vector3<f32>; 3],
    /// Half of the extents along them.
    half: [f32; 3],
}

impl Plane {
    fn of(b: &Box3) -> Option<Self> {
        let f = b.footprint()?;
        let (sin, cos) = f.yaw.sin_cos();
        let sides = [Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0), Vector3::z()];
        let [l, w] = f.sides();
        let long = [l, w, b.extent().z];
        let across = (0..3).min_by(|&i, &k| long[i].total_cmp(&long[k]))?;
        let order = [(across + 1) % 3, (across + 2) % 3, across];
        let half = order.map(|k| long[k] / 2.0);
        let thin = 2.0 * half[2] <= THICK && 2.0 * half[2] < half[0].max(half[1]);
        thin.then_some(Self { centre: b.middle(), axes: order.map(|k| sides[k]), half })
    }

    fn area(&self) -> f32 {
        self.half[0] * self.half[1]
    }

    /// What a box takes up along the axes, from the centre.
    fn span(&self, b: &Box3) -> [[f32; 2]; 3] {
        let e = b.extent() / 2.0;
        let (yaw, [l, w]) = b.footprint().map_or((0.0, [e.x, e.y]), |f| (f.yaw, f.sides().map(|s| s / 2.0)));
        let (sin, cos) = yaw.sin_cos();
        let d = b.middle() - self.centre;
        self.axes.map(|a| {
            let reach =
                (a.x * cos + a.y * sin).abs() * l + (a.y * cos - a.x * sin).abs() * w + a.z.abs() * e.z;
            [d.dot(&a) - reach, d.dot(&a) + reach]
        })
    }
}

/// What lies between two pieces of a plane.
pub(super) struct Gap {
    plane: Plane,
    /// Along the axes within the plane: where there is no gap, what both take up.
    between: [[f32; 2]; 2],
    apart: [f32; 2],
}

/// The gap between two boxes of which the smaller lies in the plane of the larger; none where it does not.
pub(super) fn gap(a: &Box3, b: &Box3) -> Option<Gap> {
    let (plane, other) = match (Plane::of(a), Plane::of(b)) {
        (Some(p), Some(q)) if q.area() > p.area() => (q, a),
        (Some(p), _) => (p, b),
        (None, Some(q)) => (q, a),
        (None, None) => return None,
    };
    let [along, up, across] = plane.span(other);
    if across[0] < -plane.half[2] - STEP || across[1] > plane.half[2] + STEP {
        return None;
    }
    let inner = [along, up].map(|s| s[0]);
    let outer = [along, up].map(|s| s[1]);
    let between = [0, 1].map(|k| {
        let (low, high) = (inner[k].max(-plane.half[k]), outer[k].min(plane.half[k]));
        [low.min(high), low.max(high)]
    });
    let apart = [0, 1].map(|k| (inner[k] - plane.half[k]).max(-plane.half[k] - outer[k]).max(0.0));
    Some(Gap { plane, between, apart })
}

impl Gap {
    /// How far apart the pieces are, metres.
    pub(super) fn width(&self) -> f32 {
        self.apart[0].hypot(self.apart[1])
    }

    /// Whether a wall ends in the gap: then the pieces are those of different rooms.
    pub(super) fn holds(&self, wall: &Box3) -> bool {
        let Some(w) = Plane::of(wall) else { return false };
        let s = self.plane.span(wall);
        let meets = s[2][0] < self.plane.half[2] + MEETS && s[2][1] > -self.plane.half[2] - MEETS;
        let parts = |k: usize| self.apart[k] > 0.0 && self.plane.axes[k].z.abs() < 0.5;
        let fits = |k: usize| {
            let [low, high] = self.between[k];
            if parts(k) {
                s[k][0] > low - BEYOND && s[k][1] < high + BEYOND
            } else {
                s[k][0] < high && s[k][1] > low
            }
        };
        meets
            && w.axes[2].dot(&self.plane.axes[2]).abs() < 0.5
            && (parts(0) || parts(1))
            && fits(0)
            && fits(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Footprint;
    use nalgebra::{Isometry3, Vector3};

    /// A box of these sides, turned by a yaw about the origin.
    fn piece(middle: [f32; 3], sides: [f32; 3], yaw: f32) -> Box3 {
        let flat = Footprint::rectangle([sides[0], sides[1]], 0.0);
        let b = Box3::new(middle, sides).unwrap().with_footprint(flat).unwrap();
        b.transformed(&Isometry3::new(Vector3::zeros(), Vector3::z() * yaw))
    }

    #[test]
    fn gaps_are_those_of_the_plane_in_any_yaw() {
        for yaw in [0.0, 0.3, 1.0, 1.6, 3.0] {
            let at = |middle, sides| piece(middle, sides, yaw);
            let wall = at([0.0, 5.0, 1.2], [4.0, 0.1, 2.4]);
            let beside = at([3.5, 5.03, 1.0], [1.0, 0.02, 2.0]);
            for (a, b) in [(&wall, &beside), (&beside, &wall)] {
                let g = gap(a, b).unwrap();
                assert!((g.width() - 1.0).abs() < 1e-3, "{yaw}: {}", g.width());
            }
            assert!(gap(&wall, &at([3.5, 5.3, 1.0], [1.0, 0.02, 2.0])).is_none(), "another plane");
            assert!(gap(&wall, &at([2.5, 4.0, 1.2], [0.1, 2.0, 2.4])).is_none(), "another direction");
            let above = at([0.0, 5.0, 3.0], [1.0, 0.1, 0.4]);
            assert!((gap(&wall, &above).unwrap().width() - 0.4).abs() < 1e-3);
            let floor = at([0.0, 0.0, 0.0], [4.0, 3.0, 0.05]);
            let strip = at([2.3, 1.0, 0.02], [0.2, 0.5, 0.03]);
            assert!((gap(&floor, &strip).unwrap().width() - 0.2).abs() < 1e-3);
            assert!(gap(&floor, &at([2.3, 1.0, 0.4], [0.2, 0.5, 0.03])).is_none(), "a step higher");
        }
    }

    #[test]
    fn a_wall_that_ends_between_two_pieces_parts_them() {
        for yaw in [0.0, 0.4, 2.0] {
            let at = |middle, sides| piece(middle, sides, yaw);
            let g =
                gap(&at([0.0, 5.0, 1.2], [4.0, 0.1, 2.4]), &at([3.5, 5.0, 1.2], [2.5, 0.1, 2.4])).unwrap();
            assert!((g.width() - 0.25).abs() < 1e-3);
            assert!(g.holds(&at([2.12, 3.0, 1.2], [0.2, 3.9, 2.4])), "comes up to the plane in the gap");
            assert!(!g.holds(&at([0.0, 3.0, 1.2], [0.2, 3.9, 2.4])), "beside the gap");
            assert!(!g.holds(&at([2.12, 2.0, 1.2], [0.2, 3.0, 2.4])), "ends far from the plane");
            assert!(!g.holds(&at([2.12, 5.0, 1.2], [0.2, 0.1, 2.4])), "a piece of the plane itself");
            let rooms =
                gap(&at([0.0, 0.0, 0.0], [4.0, 3.0, 0.1]), &at([4.2, 0.0, 0.0], [4.0, 3.0, 0.1])).unwrap();
            assert!(rooms.holds(&at([2.1, 0.0, 1.2], [0.2, 3.0, 2.4])), "floors of two rooms");
        }
    }
}
