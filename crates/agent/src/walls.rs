//! Pieces of one wall. What stands before a wall, and doors in it, cut its surface into pieces that are no neighbours,
//! so that no pair of segments says `same part`; that they lie in one plane does. Folds of `graph-align` have the same rule,
//! but boxes alone: those are thicker than the plane where a reveal or a curtain is part of the piece.

use crate::NodeInput;
use crate::nodes::UPRIGHT;
use nalgebra::Vector2;
use std::f32::consts::TAU;

/// Class of which it speaks.
const WALL: &str = "wall";
/// Directions in which the face of a wall is sought, and how far its normals may be from it, radians.
const DIRECTIONS: usize = 72;
const AROUND: f32 = 0.2;
/// Thickness of the sheet that holds a face, metres; the share of a wall's points without which it has none.
const SHEET: f32 = 0.08;
const SHARE: f32 = 0.35;
/// Two faces are in one plane if their normals are within this angle, radians, and the smaller one's middle is this
/// near to the plane of the larger, metres.
const TURNED: f32 = 0.17;
const STEP: f32 = 0.12;
/// Pieces are this far apart at most, metres.
const GAP: f32 = 1.5;
/// A wall that meets the plane ends this near to it, metres; between two pieces it is this much thicker than their gap
/// at most, on either side.
const MEETS: f32 = 0.3;
const BEYOND: f32 = 0.15;

/// The sheet that holds most of a wall.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// Unit normal in plan, towards the room.
    normal: Vector2<f32>,
    middle: Vector2<f32>,
    /// What it takes up along the wall from the middle, and in height.
    along: [f32; 2],
    height: [f32; 2],
}

/// Representative (smallest index) of the pieces of each wall.
pub(crate) fn groups(nodes: &[NodeInput], classes: &[Vec<f32>], names: &[String]) -> Vec<usize> {
    let mut group: Vec<usize> = (0..nodes.len()).collect();
    let Some(wall) = names.iter().position(|n| n == WALL) else { return group };
    let is_wall = |k: &usize| classes[*k].iter().all(|p| *p <= classes[*k][wall]);
    let faces: Vec<(usize, Face)> =
        (0..nodes.len()).filter(is_wall).filter_map(|k| Some((k, Face::of(&nodes[k])?))).collect();
    for (n, (i, a)) in faces.iter().enumerate() {
        for (j, b) in &faces[..n] {
            let Some(gap) = a.gap(b) else { continue };
            if group[*i] != group[*j] && !faces.iter().any(|(_, w)| gap.holds(w)) {
                let (keep, gone) = (group[*i].min(group[*j]), group[*i].max(group[*j]));
                group.iter_mut().filter(|g| **g == gone).for_each(|g| *g = keep);
            }
        }
    }
    group
}

fn tangent(normal: &Vector2<f32>) -> Vector2<f32> {
    Vector2::new(-normal.y, normal.x)
}

/// All but a fiftieth of numbers on either side.
fn span(values: impl Iterator<Item = f32>) -> [f32; 2] {
    let mut sorted: Vec<f32> = values.collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let cut = sorted.len() / 50;
    [sorted[cut], sorted[sorted.len() - 1 - cut]]
}

impl Face {
    fn of(node: &NodeInput) -> Option<Self> {
        let upright: Vec<(Vector2<f32>, Vector2<f32>, f32)> = node
            .points
            .iter()
            .filter(|(_, n)| n.z.abs() < UPRIGHT)
            .map(|(p, n)| (p.coords.xy(), n.xy().normalize(), p.z))
            .collect();
        let least = (SHARE * node.points.len() as f32).max(8.0) as usize;
        let normal = main_normal(&upright.iter().map(|p| p.1).collect::<Vec<_>>())?;
        let facing = upright.iter().filter(|p| p.1.dot(&normal) > AROUND.cos());
        let mut by_offset: Vec<(f32, Vector2<f32>, f32)> =
            facing.map(|(p, _, z)| (p.dot(&normal), *p, *z)).collect();
        by_offset.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let sheet = densest(&by_offset);
        if sheet.len() < least {
            return None;
        }
        let middle = sheet.iter().map(|s| s.1).sum::<Vector2<f32>>() / sheet.len() as f32;
        let along = tangent(&normal);
        Some(Self {
            normal,
            middle,
            along: span(sheet.iter().map(|s| (s.1 - middle).dot(&along))),
            height: span(sheet.iter().map(|s| s.2)),
        })
    }

    fn area(&self) -> f32 {
        (self.along[1] - self.along[0]) * (self.height[1] - self.height[0])
    }

    /// What another face takes up along the wall and across it, from the middle.
    fn spans(&self, other: &Self) -> [[f32; 2]; 2] {
        [tangent(&self.normal), self.normal].map(|axis| {
            let ends =
                other.along.map(|s| (other.middle + tangent(&other.normal) * s - self.middle).dot(&axis));
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        })
    }

    /// The gap between two faces of one plane; none where they are of two, or too far apart.
    fn gap(&self, other: &Self) -> Option<Gap> {
        let (a, b) = if self.area() >= other.area() { (self, other) } else { (other, self) };
        if a.normal.dot(&b.normal) < TURNED.cos() || (b.middle - a.middle).dot(&a.normal).abs() > STEP {
            return None;
        }
        let [along, _] = a.spans(b);
        let between = |p: [f32; 2], q: [f32; 2]| {
            let (low, high) = (p[1].min(q[1]), p[0].max(q[0]));
            [low.min(high), low.max(high), (high - low).max(0.0)]
        };
        let [low, high, apart] = between(a.along, along);
        let [bottom, top, above] = between(a.height, b.height);
        let height = if above > 0.0 {
            [bottom, top]
        } else {
            [a.height[0].max(b.height[0]), a.height[1].min(b.height[1])]
        };
        (apart.hypot(above) <= GAP).then_some(Gap { plane: *a, along: [low, high], apart, height })
    }
}

/// The direction that most normals are near to.
fn main_normal(normals: &[Vector2<f32>]) -> Option<Vector2<f32>> {
    let mut count = [0_u32; DIRECTIONS];
    for n in normals {
        let turn = n.y.atan2(n.x).rem_euclid(TAU) / TAU;
        count[(turn * DIRECTIONS as f32) as usize % DIRECTIONS] += 1;
    }
    let near = |k: usize| (0..3).map(|d| count[(k + DIRECTIONS - 1 + d) % DIRECTIONS]).sum::<u32>();
    let best = (0..DIRECTIONS).rev().max_by_key(|&k| near(k)).filter(|&k| near(k) > 0)?;
    let (sin, cos) = ((best as f32 + 0.5) / DIRECTIONS as f32 * TAU).sin_cos();
    let about = Vector2::new(cos, sin);
    normals.iter().filter(|n| n.dot(&about) > AROUND.cos()).sum::<Vector2<f32>>().try_normalize(1e-6)
}

/// The most points, sorted by offset, that one sheet holds.
fn densest(sorted: &[(f32, Vector2<f32>, f32)]) -> &[(f32, Vector2<f32>, f32)] {
    let mut best = 0..0;
    let mut first = 0;
    for last in 0..sorted.len() {
        while sorted[last].0 - sorted[first].0 > SHEET {
            first += 1;
        }
        if last + 1 - first > best.len() {
            best = first..last + 1;
        }
    }
    &sorted[best]
}

/// What lies between two pieces of a wall.
struct Gap {
    plane: Face,
    /// Along the wall from the plane's middle: where the pieces are `apart`, what is between them.
    along: [f32; 2],
    apart: f32,
    height: [f32; 2],
}

impl Gap {
    /// Whether a wall ends in the gap: then the pieces are those of different rooms.
    fn holds(&self, wall: &Face) -> bool {
        let [along, across] = self.plane.spans(wall);
        self.apart > 0.0
            && wall.normal.dot(&self.plane.normal).abs() < 0.5
            && across[0] < MEETS
            && across[1] > -MEETS
            && along[0] > self.along[0] - BEYOND
            && along[1] < self.along[1] + BEYOND
            && wall.height[0] < self.height[1]
            && wall.height[1] > self.height[0]
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test")]

    use super::*;
    use gsm::SegmentId;
    use nalgebra::{Point3, UnitQuaternion, Vector3};

    /// A sheet from one point in plan to another, facing left of its way, 2 m high; turned by a yaw.
    fn sheet(id: u32, from: [f32; 2], to: [f32; 2], yaw: f32) -> NodeInput {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let way = Vector2::new(to[0] - from[0], to[1] - from[1]);
        let n = tangent(&way.normalize());
        let mut points = Vec::new();
        for k in 0..200 {
            let s = (k % 20) as f32 / 19.0;
            let p = Point3::new(from[0] + s * way.x, from[1] + s * way.y, (k / 20) as f32 * 0.2);
            points.push((turn * p, turn * Vector3::new(n.x, n.y, 0.0)));
        }
        NodeInput::new(SegmentId(id), 200, 1.0, &points, 256).unwrap()
    }

    fn of(sheets: &[[[f32; 2]; 2]], yaw: f32) -> Vec<usize> {
        let nodes: Vec<_> = sheets.iter().zip(1..).map(|([a, b], id)| sheet(id, *a, *b, yaw)).collect();
        let classes = vec![vec![0.1, 0.9]; nodes.len()];
        groups(&nodes, &classes, &["chair".to_owned(), WALL.to_owned()])
    }

    #[test]
    fn pieces_of_one_plane_are_one_wall() {
        let piece = |x: [f32; 2], y: f32| [[x[0], y], [x[1], y]];
        for yaw in [0.0, 0.4, 1.7, 3.0, -2.0] {
            assert_eq!(of(&[piece([0.0, 2.0], 0.0), piece([3.0, 4.0], 0.05)], yaw), [0, 0], "a door apart");
            assert_eq!(of(&[piece([0.0, 2.0], 0.0), piece([4.0, 5.0], 0.0)], yaw), [0, 1], "too far");
            assert_eq!(of(&[piece([0.0, 2.0], 0.0), piece([3.0, 4.0], 0.2)], yaw), [0, 1], "another plane");
            assert_eq!(of(&[piece([0.0, 2.0], 0.0), piece([4.0, 3.0], 0.0)], yaw), [0, 1], "another side");
            assert_eq!(
                of(&[piece([0.0, 2.0], 0.0), [[2.1, 0.0], [2.1, 2.0]]], yaw),
                [0, 1],
                "round the corner"
            );
            let three = [piece([6.0, 7.0], 0.0), piece([0.0, 2.0], 0.0), piece([3.0, 5.0], 0.0)];
            assert_eq!(of(&three, yaw), [0, 0, 0], "one by one");
        }
    }

    #[test]
    fn a_wall_that_ends_between_two_pieces_parts_them() {
        for yaw in [0.0, 0.9, 2.6] {
            let pieces = |x: f32, y: [f32; 2]| {
                of(&[[[0.0, 0.0], [2.0, 0.0]], [[2.2, 0.0], [4.0, 0.0]], [[x, y[0]], [x, y[1]]]], yaw)
            };
            assert_eq!(pieces(2.1, [0.05, 2.0]), [0, 1, 2], "comes up to the plane");
            assert_eq!(pieces(2.1, [0.6, 2.0]), [0, 0, 2], "ends before it");
            assert_eq!(pieces(1.0, [0.05, 2.0]), [0, 0, 2], "beside the gap");
        }
    }

    #[test]
    fn what_is_no_wall_stays_apart_and_clutter_does_not_hide_the_face() {
        let nodes = [sheet(1, [0.0, 0.0], [2.0, 0.0], 0.0), sheet(2, [2.5, 0.0], [3.5, 0.0], 0.0)];
        let names = ["chair".to_owned(), WALL.to_owned()];
        assert_eq!(groups(&nodes, &[vec![0.1, 0.9], vec![0.6, 0.4]], &names), [0, 1]);
        assert_eq!(groups(&nodes, &[vec![0.1, 0.9], vec![0.1, 0.9]], &names[..1]), [0, 1]);
        // A shelf on it, seen from the front: as many points again, 0.3 m before the plane.
        let mut cluttered = nodes.clone();
        let shelf: Vec<_> = cluttered[0].points.iter().map(|(p, n)| (p + n * 0.3, *n)).take(150).collect();
        cluttered[0].points.extend(shelf);
        assert_eq!(groups(&cluttered, &[vec![0.1, 0.9], vec![0.1, 0.9]], &names), [0, 0]);
    }
}
