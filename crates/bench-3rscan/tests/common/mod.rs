//! A hand-made data set and random graphs for the tests of this crate.

#![allow(dead_code, reason = "every test binary uses its own part")]

use bench_3rscan::layout::Placement;
use bench_3rscan::truth::{Truth, TruthCounts, TruthNode};
use graph_align::{Box3, Edge, LabelId, Node, NodeId, PredicateId, SceneGraph};
use nalgebra::{Isometry3, Point3};
use proptest::prelude::*;
use scan3r::{
    Annotation, Dataset, Error, FrameStream, Relation, RigidList, RoomEntry, ScanEntry, Transform16,
};
use std::collections::BTreeMap;

/// Everything in memory; nothing is rendered.
#[derive(Default)]
pub(crate) struct Tiny {
    pub(crate) rooms: Vec<RoomEntry>,
    pub(crate) scans: BTreeMap<String, (Annotation, Vec<Relation>, u32)>,
    pub(crate) own_paths: bool,
}

impl Tiny {
    /// `rooms` boxes of vertices with `rescans` rescans each; sides and frame counts differ.
    pub(crate) fn boxes(rooms: usize, rescans: usize) -> Self {
        let mut tiny = Self::default();
        for k in 0..rooms {
            let (x, y) = (3.0 + (k % 5) as f32, 2.0 + (k % 7) as f32);
            let corners =
                [[0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, y, 0.0], [x, y, 2.5], [x / 3.0, y / 2.0, 1.0]];
            let points: Vec<Point3<f32>> = corners.iter().map(|c| Point3::from(*c)).collect();
            let annotation = Annotation {
                instances: vec![1; points.len()],
                points,
                labels: [(1, "wall".to_owned())].into(),
            };
            let ids: Vec<String> = (0..=rescans).map(|r| format!("room{k}-scan{r}")).collect();
            for (r, id) in ids.iter().enumerate() {
                let frames = 11 + ((k * 31 + r * 17) % 23) as u32;
                tiny.scans.insert(id.clone(), (annotation.clone(), Vec::new(), frames));
            }
            tiny.rooms.push(room(&ids[0], ids[1..].iter().map(|id| rescan(id)).collect()));
        }
        tiny
    }

    fn of(&self, scan: &str) -> Result<&(Annotation, Vec<Relation>, u32), Error> {
        let problem = format!("no scan {scan}");
        self.scans.get(scan).ok_or(Error::Value { field: "scan", problem })
    }
}

impl Dataset for Tiny {
    fn kind(&self) -> &'static str {
        "generated"
    }
    fn has_own_path_per_visit(&self) -> bool {
        self.own_paths
    }
    fn rooms(&self) -> &[RoomEntry] {
        &self.rooms
    }
    fn annotation(&self, scan: &str) -> Result<Annotation, Error> {
        Ok(self.of(scan)?.0.clone())
    }
    fn relations(&self, scan: &str) -> Result<Vec<Relation>, Error> {
        Ok(self.of(scan)?.1.clone())
    }
    fn frame_count(&self, scan: &str, _visit: u64) -> Result<u32, Error> {
        Ok(self.of(scan)?.2)
    }
    fn frames(&self, _scan: &str, _visit: u64) -> Result<FrameStream<'_>, Error> {
        Ok(Box::new(std::iter::empty()))
    }
}

pub(crate) fn room(reference: &str, scans: Vec<ScanEntry>) -> RoomEntry {
    RoomEntry { reference: reference.to_owned(), split: "train".to_owned(), ambiguity: Vec::new(), scans }
}

/// A rescan in the reference frame in which nothing changed.
pub(crate) fn rescan(id: &str) -> ScanEntry {
    ScanEntry {
        id: id.to_owned(),
        transform: Some(Transform16::from_isometry(&Isometry3::identity())),
        rigid: RigidList::default(),
        removed: None,
        nonrigid: None,
    }
}

/// Places without a data set: boxes of `size` along x with 3 m between them.
pub(crate) fn placements(rooms: usize, size: f32) -> Vec<Placement> {
    (0..rooms)
        .map(|k| {
            let x = k as f32 * (size + 3.0) + size / 2.0;
            Placement {
                domain_from_reference: Isometry3::translation(x - size / 2.0, 0.0, 0.0),
                bounds: Box3::new([x, size / 2.0, size / 2.0], [size; 3]).unwrap(),
            }
        })
        .collect()
}

pub(crate) const LABELS: u16 = 3;
pub(crate) const PREDICATES: u16 = 2;

/// Boxes on a coarse raster, so that equal overlaps, equal distances and equal boxes are common.
pub(crate) fn boxes(n: usize) -> impl Strategy<Value = Vec<(Box3, u16)>> {
    let one =
        (prop::array::uniform3(0_u8..12), prop::array::uniform3(0_u8..6), 0..LABELS).prop_map(|(c, e, l)| {
            let f = |v: u8| f32::from(v) * 0.25;
            (Box3::new(c.map(f), e.map(f)).unwrap(), l)
        });
    prop::collection::vec(one, 0..n)
}

fn pairs(n: usize) -> impl Strategy<Value = Vec<(usize, usize, u16)>> {
    prop::collection::vec((0..n.max(1), 0..n.max(1), 0..PREDICATES), 0..3 * n)
}

/// A truth over two rooms, with clutter and unseen objects among its nodes.
pub(crate) fn truth(n: usize) -> impl Strategy<Value = Truth> {
    (boxes(n), pairs(n), prop::collection::vec(0_u8..6, n)).prop_map(|(nodes, edges, kinds)| {
        let nodes: Vec<TruthNode> = nodes
            .into_iter()
            .zip(kinds)
            .enumerate()
            .map(|(k, ((bounds, label), kind))| TruthNode {
                id: k as u64 * 3 + 1,
                room: k % 2,
                label: (kind != 0).then_some(LabelId(label)),
                raw: String::new(),
                bounds,
                ignore: kind < 2,
            })
            .collect();
        let counted = |k: usize| nodes.get(k).filter(|n| !n.ignore).map(|n| n.id);
        let mut edges: Vec<_> = edges
            .into_iter()
            .filter(|(s, t, _)| s != t)
            .filter_map(|(s, t, p)| Some((counted(s)?, counted(t)?, PredicateId(p))))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let counts = TruthCounts {
            nodes: nodes.iter().filter(|n| !n.ignore).count(),
            edges: edges.len(),
            ..TruthCounts::default()
        };
        Truth { nodes, edges, counts }
    })
}

/// A predicted graph.
pub(crate) fn graph(n: usize) -> impl Strategy<Value = SceneGraph> {
    (boxes(n), pairs(n)).prop_map(|(nodes, edges)| {
        let mut g = SceneGraph::default();
        for (k, (bounds, label)) in nodes.iter().enumerate() {
            g.insert_node(Node::new(NodeId(k as u64 * 5 + 2), LabelId(*label), *bounds));
        }
        for (s, t, p) in edges.into_iter().filter(|(s, t, _)| s != t && *s.max(t) < nodes.len()) {
            let id = |k: usize| NodeId(k as u64 * 5 + 2);
            g.insert_edge(Edge { s: id(s), t: id(t), p: PredicateId(p), score: 1.0 }).unwrap();
        }
        g
    })
}

/// The graph that says exactly what the truth counts; `id` names its nodes.
pub(crate) fn copy_of(truth: &Truth, id: impl Fn(u64) -> u64) -> SceneGraph {
    let mut g = SceneGraph::default();
    for n in truth.nodes.iter().filter(|n| !n.ignore) {
        g.insert_node(Node::new(NodeId(id(n.id)), n.label.unwrap(), n.bounds));
    }
    for &(s, t, p) in &truth.edges {
        g.insert_edge(Edge { s: NodeId(id(s)), t: NodeId(id(t)), p, score: 1.0 }).unwrap();
    }
    g
}

/// `n` points on a raster of 3 cm that fills a box.
pub(crate) fn block(centre: [f32; 3], extent: [f32; 3]) -> Vec<Point3<f32>> {
    let steps = extent.map(|e| (e / 0.03).ceil().max(1.0) as usize);
    let mut out = Vec::new();
    for i in 0..=steps[0] {
        for j in 0..=steps[1] {
            for k in 0..=steps[2] {
                let at = |s: usize, a: usize| centre[a] + extent[a] * (s as f32 / steps[a] as f32 - 0.5);
                out.push(Point3::new(at(i, 0), at(j, 1), at(k, 2)));
            }
        }
    }
    out
}
