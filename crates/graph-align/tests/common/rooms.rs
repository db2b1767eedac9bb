//! Random furnished rooms of upright cylinders: their boxes are the same in every yaw, so that a
//! graph can be moved exactly.

use graph_align::{Box3, Edge, LabelId, Looked, Node, NodeId, PredicateId, SceneGraph};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Numbers from a seed (splitmix64).
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub(crate) fn within(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * (self.next() >> 40) as f32 / (1_u64 << 24) as f32
    }

    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

pub(crate) fn yaw_shift(yaw: f32, shift: [f32; 3]) -> Isometry3<f32> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::from(shift), turn)
}

/// Any yaw, within some tens of metres.
pub(crate) fn any_pose(dice: &mut Dice) -> Isometry3<f32> {
    let shift = [dice.within(-30.0, 30.0), dice.within(-30.0, 30.0), dice.within(-1.0, 1.0)];
    yaw_shift(dice.within(-3.1, 3.1), shift)
}

fn cylinder(id: u64, label: u16, at: [f32; 3], wide: f32, high: f32, score: f32) -> Node {
    Node {
        score,
        ..Node::new(NodeId(id), LabelId(label), Box3::new(at, [wide, wide, high]).expect("finite"))
    }
}

/// `n` objects of eight classes, at least 0.45 m apart, in a room of 7 x 6 m about the origin; the
/// first is the floor on which most stand.
pub(crate) fn room(dice: &mut Dice, n: usize, first_id: u64) -> SceneGraph {
    let mut g = SceneGraph::default();
    let mut places: Vec<[f32; 3]> = Vec::new();
    while places.len() < n {
        let p = [dice.within(-3.5, 3.5), dice.within(-3.0, 3.0), dice.within(0.2, 1.6)];
        if places.iter().all(|q| (p[0] - q[0]).hypot(p[1] - q[1]) > 0.45) {
            places.push(p);
        }
    }
    for (k, p) in places.into_iter().enumerate() {
        let (label, wide, high) = (dice.below(8) as u16, dice.within(0.2, 1.0), dice.within(0.2, 1.2));
        g.insert_node(cylinder(first_id + k as u64, label, p, wide, high, dice.within(0.6, 0.95)));
    }
    for k in 1..n as u64 {
        let e = Edge { s: NodeId(first_id + k), t: NodeId(first_id), p: PredicateId(0), score: 0.9 };
        g.insert_edge(e).expect("living ends");
    }
    g
}

/// Rooms 10 m apart in a row, ids from 1000 per room.
pub(crate) fn building(dice: &mut Dice, rooms: usize, n: usize) -> SceneGraph {
    let mut out = SceneGraph::default();
    for k in 0..rooms {
        join(
            &mut out,
            &moved(&room(dice, n, 1000 * (k as u64 + 1)), &yaw_shift(0.0, [10.0 * k as f32, 0.0, 0.0])),
        );
    }
    out
}

pub(crate) fn join(into: &mut SceneGraph, other: &SceneGraph) {
    other.nodes().for_each(|n| into.insert_node(n.clone()));
    other.edges().for_each(|e| into.insert_edge(e).expect("living ends"));
}

/// The nodes of a range of ids, and the edges between them.
pub(crate) fn part(g: &SceneGraph, keep: impl Fn(u64) -> bool) -> SceneGraph {
    let mut out = SceneGraph::default();
    g.nodes().filter(|n| keep(n.id.0)).for_each(|n| out.insert_node(n.clone()));
    for e in g.edges() {
        let _ = out.insert_edge(e);
    }
    out
}

/// A graph of cylinders after a motion that keeps them upright.
pub(crate) fn moved(g: &SceneGraph, t: &Isometry3<f32>) -> SceneGraph {
    changed(g, |n| {
        let c = t * n.bounds.centroid();
        n.bounds = Box3::new(c.coords.into(), n.bounds.extent().into()).expect("finite");
    })
}

/// Every node changed in place; edges stay.
pub(crate) fn changed(g: &SceneGraph, mut f: impl FnMut(&mut Node)) -> SceneGraph {
    let mut out = SceneGraph::default();
    for n in g.nodes() {
        let mut n = n.clone();
        f(&mut n);
        out.insert_node(n);
    }
    g.edges().for_each(|e| out.insert_edge(e).expect("living ends"));
    out
}

/// Centroids off by up to `by` per axis, as another view would have them.
pub(crate) fn noisy(g: &SceneGraph, dice: &mut Dice, by: f32) -> SceneGraph {
    changed(g, |n| {
        let c = n.bounds.centroid()
            + Vector3::new(dice.within(-by, by), dice.within(-by, by), dice.within(-by, by));
        n.bounds = Box3::new(c.coords.into(), n.bounds.extent().into()).expect("finite");
    })
}

/// Every cell within `reach` of a point, seen.
pub(crate) fn looked_around(p: Point3<f32>, reach: f32) -> Looked {
    let r = (reach / 0.5).ceil() as i32;
    let home = [p.x, p.y, p.z].map(|v| (v / 0.5).floor() as i32);
    let mut cells = Vec::new();
    for i in -r..=r {
        for j in -r..=r {
            cells.extend((-r..=r).map(|k| [home[0] + i, home[1] + j, home[2] + k]));
        }
    }
    Looked::new(0.5, [0.0; 3], &cells).expect("small")
}
