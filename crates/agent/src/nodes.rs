//! Segments of a map as nodes: points, boxes, neighbours.

use crate::Error;
use graph_align::{Box3, Footprint};
use gsm::{Map, SegmentId};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::f64::consts::PI as PI_64;

/// Which segments become nodes, and what the network sees of them.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeParams {
    /// Points per node.
    pub points: usize,
    /// Surfels from which boxes are measured, at most.
    pub box_points: usize,
    /// Smallest segment that becomes a node, square metres of surfels.
    pub min_area: f32,
    /// Fewest stable surfels of a node.
    pub min_surfels: u32,
    /// Neighbours have boxes at most this far apart on every axis, metres.
    pub gap: f32,
}

impl Default for NodeParams {
    fn default() -> Self {
        Self { points: 256, box_points: 1024, min_area: 0.015, min_surfels: 48, gap: 0.35 }
    }
}

/// One segment.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeInput {
    /// Its segment.
    pub id: SegmentId,
    /// Stable surfels.
    pub surfels: u32,
    /// Square metres.
    pub area: f32,
    /// Box between the 0.5 % and 99.5 % quantiles of its surfels, in the node set's frame.
    pub bounds: Box3,
    /// Evenly sampled surfels (position, unit normal), at most [`NodeParams::points`].
    pub points: Vec<(Point3<f32>, Vector3<f32>)>,
}

/// Nodes in the order of their segments, and neighbours in both directions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeSet {
    /// Nodes.
    pub nodes: Vec<NodeInput>,
    /// Directed pairs of indices into `nodes`, sorted.
    pub edges: Vec<[usize; 2]>,
    /// Yaw that turns the set's frame into the network's, along whose axes most upright surface faces: what the
    /// network says, and who is whose neighbour, shall not depend on how a robot's frame happens to lie.
    pub to_walls: f32,
}

impl NodeSet {
    /// The nodes of a map, turned into another frame (the identity where the map's z is up).
    ///
    /// # Errors
    /// Surfels whose coordinates are no box (not finite).
    pub fn of_map(map: &Map, turn: &UnitQuaternion<f32>, p: &NodeParams) -> Result<Self, Error> {
        let mut nodes = Vec::new();
        for s in map.segments().filter(|s| s.surfels() >= p.min_surfels) {
            let area = s.area();
            if area < p.min_area {
                continue;
            }
            let dense: Vec<_> =
                s.sample(p.box_points).into_iter().map(|(x, n)| (turn * x, turn * n)).collect();
            nodes.push(NodeInput::new(s.id(), s.surfels(), area, &dense, p.points)?);
        }
        Ok(Self::new(nodes, p.gap))
    }

    /// Nodes with the neighbours that follow from their boxes, turned along the walls.
    #[must_use]
    pub fn new(nodes: Vec<NodeInput>, gap: f32) -> Self {
        let to_walls = to_walls(&nodes);
        let turn = Isometry3::rotation(Vector3::z() * to_walls);
        let boxes: Vec<Box3> = nodes.iter().map(|n| n.bounds.transformed(&turn)).collect();
        let mut edges = Vec::new();
        for (i, a) in boxes.iter().enumerate() {
            for (j, b) in boxes.iter().enumerate() {
                if i != j && gap_between(a, b) <= gap {
                    edges.push([i, j]);
                }
            }
        }
        Self { nodes, edges, to_walls }
    }

    /// The network's input for every node ([`NodeInput::segment`]).
    ///
    /// # Errors
    /// A number of channels other than 3, 6 or 9.
    pub fn segments(&self, channels: usize) -> Result<Vec<sgfn_infer::Segment>, Error> {
        self.nodes.iter().map(|n| n.segment(channels, self.to_walls)).collect()
    }
}

/// Normals at most this steep are those of upright surface.
pub(crate) const UPRIGHT: f32 = 0.3;

/// The mean direction of upright surface, each node by its area: that of the fourfold angle of its normals, which is
/// the same for both sides of a wall and for the walls beside it. 0 where nothing is upright.
fn to_walls(nodes: &[NodeInput]) -> f32 {
    let all = nodes.iter().flat_map(|node| {
        let share = f64::from(node.area) / node.points.len().max(1) as f64;
        upright(&node.points).map(move |angle| (angle, share))
    });
    (-Fourfold::of(all).angle() / 4.0) as f32
}

/// Four times the angles of upright normals.
fn upright(points: &[(Point3<f32>, Vector3<f32>)]) -> impl Iterator<Item = f64> {
    let faces = points.iter().filter(|(_, n)| n.z.abs() < UPRIGHT);
    faces.map(|(_, n)| 4.0 * f64::from(n.y).atan2(f64::from(n.x)))
}

/// A weighted sum of directions, each by four times its angle: quarter turns are the same.
struct Fourfold {
    sin: f64,
    cos: f64,
    weight: f64,
}

impl Fourfold {
    fn of(angles: impl Iterator<Item = (f64, f64)>) -> Self {
        angles.fold(Self { sin: 0.0, cos: 0.0, weight: 0.0 }, |sum, (angle, w)| Self {
            sin: sum.sin + w * angle.sin(),
            cos: sum.cos + w * angle.cos(),
            weight: sum.weight + w,
        })
    }

    fn angle(&self) -> f64 {
        self.sin.atan2(self.cos)
    }
}

impl NodeInput {
    /// A node from surfels: its box from all of them, its points evenly from the list.
    ///
    /// # Errors
    /// Coordinates that are no box.
    pub fn new(
        id: SegmentId,
        surfels: u32,
        area: f32,
        dense: &[(Point3<f32>, Vector3<f32>)],
        points: usize,
    ) -> Result<Self, Error> {
        let n = points.min(dense.len());
        let points = (0..n).map(|k| dense[k * dense.len() / n]).collect();
        Ok(Self { id, surfels, area, bounds: quantile_box(dense)?, points })
    }

    /// The network's input, turned about z by `yaw`: xyz, then for 6 channels the normal, for 9 a grey colour
    /// before it.
    ///
    /// # Errors
    /// A number of channels other than 3, 6 or 9.
    pub fn segment(&self, channels: usize, yaw: f32) -> Result<sgfn_infer::Segment, Error> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let mut flat = Vec::with_capacity(self.points.len() * channels);
        for (p, n) in &self.points {
            let (p, n) = (turn * p.coords, turn * n);
            flat.extend(p.iter());
            match channels {
                3 => {}
                6 => flat.extend(n.iter()),
                9 => flat.extend([0.0; 3].iter().chain(n.iter())),
                _ => {
                    return Err(Error::Weights(format!("{channels} channels a point, want 3, 6 or 9")));
                }
            }
        }
        Ok(sgfn_infer::Segment::new(&flat, channels)?)
    }
}

/// Largest gap of two boxes over the axes; negative where they overlap on all.
#[must_use]
pub(crate) fn gap_between(a: &Box3, b: &Box3) -> f32 {
    let (la, ha, lb, hb) = (a.min(), a.max(), b.min(), b.max());
    (0..3).map(|k| (la[k] - hb[k]).max(lb[k] - ha[k])).fold(f32::NEG_INFINITY, f32::max)
}

fn quantile_box(dense: &[(Point3<f32>, Vector3<f32>)]) -> Result<Box3, Error> {
    if dense.is_empty() {
        return Ok(Box3::new([0.0; 3], [0.0; 3])?);
    }
    let mut scratch = Vec::with_capacity(dense.len());
    let [x, y, z] = [0, 1, 2].map(|k| span(&mut scratch, dense.iter().map(|(p, _)| p[k]), dense.len() / 200));
    let centre = [x, y, z].map(|[low, high]| (low + high) / 2.0);
    let bounds = Box3::new(centre, [x, y, z].map(|[low, high]| high - low))?;
    Ok(bounds.with_footprint(octagon(dense, centre, &mut scratch))?)
}

/// What numbers take up but for the `cut` lowest and highest.
fn span(scratch: &mut Vec<f32>, values: impl Iterator<Item = f32>, cut: usize) -> [f32; 2] {
    scratch.clear();
    scratch.extend(values);
    let last = scratch.len() - 1 - cut;
    let (_, low, above) = scratch.select_nth_unstable_by(cut, f32::total_cmp);
    let low = *low;
    let high = match last.checked_sub(cut + 1) {
        Some(k) => *above.select_nth_unstable_by(k, f32::total_cmp).1,
        None => low,
    };
    [low, high]
}

/// The octagon along the object's directions that holds all but a two-hundredth of the points on each side.
fn octagon(dense: &[(Point3<f32>, Vector3<f32>)], centre: [f32; 3], scratch: &mut Vec<f32>) -> Footprint {
    let yaw = faces(dense).unwrap_or_else(|| direction(dense, centre, scratch));
    let mut reach = [0.0; 8];
    for k in 0..4 {
        let (sin, cos) = (yaw + k as f32 * FRAC_PI_4).sin_cos();
        let along = dense.iter().map(|(p, _)| (p.x - centre[0]) * cos + (p.y - centre[1]) * sin);
        let [low, high] = span(scratch, along, dense.len() / 200);
        (reach[k], reach[k + 4]) = (high, -low);
    }
    Footprint { yaw, reach }
}

/// Upright surfels, as a share of all, from which they tell the direction; and how well they must agree: length of their
/// mean fourfold direction, of single ones that is 1. Those farther off than `AROUND`, radians, are left out then.
const FACES: f64 = 0.25;
const AGREE: f64 = 0.6;
const AROUND: f64 = 0.25;

/// The direction that upright surface faces, up to quarter turns: that of a wall whatever hangs on it, and of a cupboard
/// of which two sides were seen in part. None for what is round or flat.
fn faces(dense: &[(Point3<f32>, Vector3<f32>)]) -> Option<f32> {
    let all = Fourfold::of(upright(dense).map(|angle| (angle, 1.0)));
    if all.weight < FACES * dense.len() as f64 || all.sin.hypot(all.cos) < AGREE * all.weight {
        return None;
    }
    let about = all.angle();
    let off = |angle: f64| (angle - about + PI_64).rem_euclid(2.0 * PI_64) - PI_64;
    let near = upright(dense).filter(|angle| off(*angle).abs() < 4.0 * AROUND);
    let angle = Fourfold::of(near.map(|angle| (angle, 1.0))).angle();
    Some(((angle / 4.0) as f32).rem_euclid(FRAC_PI_2))
}

/// Shorter over longer side below which a footprint is thin, and how far its axis may be from the
/// rectangle's side, radians.
const THIN: f32 = 0.3;
const STRAY: f32 = 0.05;

/// Yaw of the smallest rectangle that holds all but a hundredth of the points on each side, over yaws in steps of
/// five degrees, then of half a degree round the best.
fn direction(dense: &[(Point3<f32>, Vector3<f32>)], centre: [f32; 3], scratch: &mut Vec<f32>) -> f32 {
    let stride = dense.len().div_ceil(256).max(1);
    let points: Vec<[f32; 2]> =
        dense.iter().step_by(stride).map(|(p, _)| [p.x - centre[0], p.y - centre[1]]).collect();
    let mut best = (f32::MAX, [0.0; 2], 0.0);
    let mut look = |half_degrees: i32| {
        let yaw = (half_degrees.rem_euclid(180) as f32 / 2.0).to_radians();
        let (sin, cos) = yaw.sin_cos();
        let cut = points.len() / 200;
        let across = [
            span(scratch, points.iter().map(|[x, y]| x * cos + y * sin), cut),
            span(scratch, points.iter().map(|[x, y]| y * cos - x * sin), cut),
        ];
        let sides = across.map(|[low, high]| high - low);
        // A wall seen from one side has no area: its thickness must not decide alone.
        let area = (sides[0] + 0.02) * (sides[1] + 0.02);
        if area < best.0 {
            best = (area, sides, yaw);
        }
        best.2
    };
    let mut coarse = 0.0;
    for step in 0..18 {
        coarse = look(step * 10);
    }
    let middle = (coarse.to_degrees() * 2.0).round() as i32;
    (middle - 9..=middle + 9).for_each(|k| {
        look(k);
    });
    along(&points, best.1, best.2)
}

/// The yaw of a thin rectangle, turned to the principal axis of its points: a line through all of them, where a
/// rectangle hangs on the outermost.
fn along(points: &[[f32; 2]], sides: [f32; 2], yaw: f32) -> f32 {
    let first = sides[0] > sides[1];
    let (long, short) = if first { (sides[0], sides[1]) } else { (sides[1], sides[0]) };
    if short > THIN * long || points.len() < 16 {
        return yaw;
    }
    let n = points.len() as f64;
    let mean = [0, 1].map(|k| points.iter().map(|p| f64::from(p[k])).sum::<f64>() / n);
    let moment = |a: usize, b: usize| {
        points.iter().map(|p| (f64::from(p[a]) - mean[a]) * (f64::from(p[b]) - mean[b])).sum::<f64>()
    };
    let axis = f64::atan2(2.0 * moment(0, 1), moment(0, 0) - moment(1, 1)) / 2.0;
    let side = if first { yaw } else { yaw + FRAC_PI_2 };
    // Axes are the same after half a turn.
    let off = (axis as f32 - side + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2;
    let turned = yaw + off;
    if off.abs() > STRAY || !(0.0..=FRAC_PI_2).contains(&turned) { yaw } else { turned }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test")]

    use super::*;

    /// A wall, its neighbour round the corner, and a shelf at 0.6 radians to both, turned by a yaw.
    fn corner(yaw: f32) -> NodeSet {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let sheet = |id: u32, at: [f32; 3], along: f32, length: f32| {
            let (sin, cos) = along.sin_cos();
            let mut dense = Vec::new();
            for i in 0..40 {
                for k in 0..20 {
                    let s = length * (i as f32 / 39.0 - 0.5);
                    let p = Point3::new(at[0] + s * cos, at[1] + s * sin, at[2] + k as f32 * 0.1);
                    dense.push((turn * p, turn * Vector3::new(-sin, cos, 0.0)));
                }
            }
            NodeInput::new(SegmentId(id), 800, 2.0 * length, &dense, 256).unwrap()
        };
        let nodes = vec![
            sheet(0, [2.0, 0.0, 0.0], 0.0, 4.0),
            sheet(1, [0.0, 2.0, 0.0], FRAC_PI_2, 3.6),
            sheet(2, [3.0, 2.2, 0.0], 0.6, 0.8),
        ];
        NodeSet::new(nodes, 0.35)
    }

    /// Points of an upright face, facing along its normal: from one end to the other in rows of 0.1 m.
    fn face(out: &mut Vec<(Point3<f32>, Vector3<f32>)>, from: [f32; 2], to: [f32; 2], n: usize) {
        let along = Vector3::new(to[0] - from[0], to[1] - from[1], 0.0);
        let normal = Vector3::new(-along.y, along.x, 0.0).normalize();
        for k in 0..n {
            let s = k as f32 / (n - 1) as f32;
            let p = Point3::new(from[0], from[1], (k % 20) as f32 * 0.1) + along * s;
            out.push((p, normal));
        }
    }

    fn turned(points: &[(Point3<f32>, Vector3<f32>)], yaw: f32) -> Vec<(Point3<f32>, Vector3<f32>)> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        points.iter().map(|(p, n)| (turn * p, turn * n)).collect()
    }

    /// Difference of two directions that are the same after a quarter turn.
    fn apart(a: f32, b: f32) -> f32 {
        let off = (a - b).rem_euclid(FRAC_PI_2);
        off.min(FRAC_PI_2 - off)
    }

    #[test]
    fn a_wall_lies_along_its_face_whatever_stands_out_of_it() {
        let mut wall = Vec::new();
        face(&mut wall, [0.0, 0.0], [4.0, 0.0], 600);
        // A curtain at one end that is gathered at 40 degrees to it: the smallest rectangle leans after it.
        face(&mut wall, [4.0, 0.0], [4.3, 0.25], 60);
        for yaw in [0.0, 0.3, 0.9, 1.4, 2.7] {
            let bounds = quantile_box(&turned(&wall, yaw)).unwrap();
            let f = bounds.footprint().unwrap();
            assert!(apart(f.yaw, yaw) < 0.002, "yaw {yaw}: {f:?}");
        }
    }

    #[test]
    fn what_is_round_or_flat_has_no_face() {
        let round: Vec<_> = (0..400)
            .map(|k| {
                let (sin, cos) = (k as f32 * 0.7).sin_cos();
                (Point3::new(cos, sin, k as f32 * 0.002), Vector3::new(cos, sin, 0.0))
            })
            .collect();
        assert_eq!(faces(&round), None);
        // A table top: its rectangle tells.
        let top: Vec<_> = (0..800)
            .map(|k| (Point3::new((k % 40) as f32 * 0.04, (k / 40) as f32 * 0.04, 0.7), Vector3::z()))
            .collect();
        assert_eq!(faces(&top), None);
        let f = quantile_box(&turned(&top, 0.4)).unwrap().footprint().unwrap();
        assert!(apart(f.yaw, 0.4) < 0.01, "{f:?}");
        let [l, w] = f.sides();
        assert!((l.max(w) - 1.56).abs() < 0.05 && (l.min(w) - 0.76).abs() < 0.05, "{l} {w}");
    }

    #[test]
    fn an_octagon_holds_nearly_all_of_its_points_and_each_line_meets_them() {
        let mut corner = Vec::new();
        face(&mut corner, [0.0, 0.0], [2.0, 0.0], 500);
        face(&mut corner, [2.0, 0.0], [2.0, 1.0], 300);
        let points = turned(&corner, 0.5);
        let bounds = quantile_box(&points).unwrap();
        let (f, c) = (bounds.footprint().unwrap(), bounds.centroid());
        for (k, reach) in f.reach.iter().enumerate() {
            let (sin, cos) = (f.yaw + k as f32 * FRAC_PI_4).sin_cos();
            let beyond = points.iter().filter(|(p, _)| (p.x - c.x) * cos + (p.y - c.y) * sin > reach + 1e-5);
            assert!(beyond.count() <= points.len() / 200, "line {k}");
            let meets = |p: &Point3<f32>| ((p.x - c.x) * cos + (p.y - c.y) * sin - reach).abs() < 1e-5;
            assert!(points.iter().any(|(p, _)| meets(p)), "line {k}");
        }
    }

    #[test]
    fn neither_neighbours_nor_network_input_depend_on_the_frame() {
        let straight = corner(0.0);
        // The shelf weighs a ninth of the walls.
        assert!(straight.to_walls.abs() < 0.03, "{}", straight.to_walls);
        assert_eq!(straight.edges, [[0, 1], [1, 0]]);
        for yaw in [0.2, 0.7, 1.3, 2.9, -1.9] {
            let turned = corner(yaw);
            assert_eq!(turned.edges, straight.edges, "yaw {yaw}");
            let off = (turned.to_walls + yaw - straight.to_walls).rem_euclid(FRAC_PI_2);
            assert!(off.min(FRAC_PI_2 - off) < 1e-3, "yaw {yaw}: {}", turned.to_walls);
            // Up to a quarter turn the sizes that the network sees are the same.
            for (a, b) in straight.segments(6).unwrap().iter().zip(turned.segments(6).unwrap()) {
                let sizes = |d: &sgfn_infer::Descriptor| {
                    [d.0[6].min(d.0[7]), d.0[6].max(d.0[7]), d.0[8], d.0[9], d.0[10]]
                };
                let (a, b) = (sizes(&a.descriptor), sizes(&b.descriptor));
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3), "yaw {yaw}: {a:?} {b:?}");
            }
        }
    }
}
