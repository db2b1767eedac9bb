//! The frame loop of one robot.

use crate::fusion::Memory;
use crate::{Error, GraphParams, NodeParams, NodeSet, Objects, Scores, build_graph};
use graph_align::{Looked, SceneGraph, Vocabulary};
use gsm::{DepthView, FrameReport, Map, SegmentEvent, SegmentId};
use nalgebra::{UnitQuaternion, Vector3};
use scan3r::Frame;
use sgfn_infer::{Descriptor, EdgeScores, Features, Graph, Matrix, Model};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// Parameters of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotParams {
    /// Segmentation.
    pub segmentation: gsm::Params,
    /// Nodes.
    pub nodes: NodeParams,
    /// Graph.
    pub graph: GraphParams,
    /// Frames between two inferences; 0 = only when asked.
    pub infer_every: u32,
    /// A segment is encoded anew when its size changed by this share.
    pub refresh: f32,
}

impl Default for RobotParams {
    fn default() -> Self {
        Self {
            segmentation: gsm::Params::default(),
            nodes: NodeParams::default(),
            graph: GraphParams::default(),
            infer_every: 25,
            refresh: 0.1,
        }
    }
}

/// Integrates a frame into a map; one without a valid pose is skipped, and the report says so.
pub fn integrate(map: &mut Map, frame: &Frame) -> FrameReport {
    let skipped = |skip| FrameReport { skipped: Some(skip), ..FrameReport::default() };
    let Some(world_from_camera) = frame.world_from_camera else {
        return skipped(gsm::Skip::InvalidPose);
    };
    let k = frame.intrinsics;
    let Ok(intrinsics) = gsm::Intrinsics::new(k.fx, k.fy, k.cx, k.cy, k.width, k.height) else {
        return skipped(gsm::Skip::WrongSize);
    };
    map.integrate(&DepthView { depth: &frame.depth, intrinsics, world_from_camera, time: frame.time })
}

/// Walls that turn by more than this, radians, want everything encoded anew: descriptors of one graph must be of one
/// frame.
const ASTRAY: f32 = 0.05;

/// A segment's encoded feature, and its size then.
struct Encoded {
    surfels: u32,
    feature: Vec<f32>,
    descriptor: Descriptor,
}

/// One robot in one visit. Poses and graph are in one frame, whose z should point up.
pub struct Robot<'m> {
    map: Map,
    model: &'m Model,
    params: RobotParams,
    encoded: BTreeMap<SegmentId, Encoded>,
    /// [`NodeSet::to_walls`] for what is encoded.
    to_walls: f32,
    memory: Memory,
    frames: u32,
    time: f64,
    turn: UnitQuaternion<f32>,
    /// Sum of the image's upward direction over frames, map frame.
    camera_up: Vector3<f32>,
}

impl<'m> Robot<'m> {
    /// A robot with an empty map.
    ///
    /// # Errors
    /// Parameters out of range, weights without names of their outputs or of unknown channels.
    pub fn new(model: &'m Model, params: RobotParams) -> Result<Self, Error> {
        let c = model.config();
        if c.class_names.is_empty() || c.predicate_names.is_empty() {
            return Err(Error::Weights("no metadata class_names and predicate_names".into()));
        }
        if !matches!(c.channels, 3 | 6 | 9) {
            return Err(Error::Weights(format!("{} channels a point, want 3, 6 or 9", c.channels)));
        }
        Ok(Self {
            map: Map::new(params.segmentation.clone())?,
            model,
            params,
            encoded: BTreeMap::new(),
            to_walls: 0.0,
            memory: Memory::default(),
            frames: 0,
            time: 0.0,
            turn: UnitQuaternion::identity(),
            camera_up: Vector3::zeros(),
        })
    }

    /// Integrates a frame. A frame without a valid pose or depth is skipped; the report says so.
    pub fn segment(&mut self, frame: &Frame) -> FrameReport {
        self.frames += 1;
        self.time = frame.time;
        let report = integrate(&mut self.map, frame);
        if let (Some(pose), None) = (&frame.world_from_camera, report.skipped) {
            self.camera_up -= pose.rotation * Vector3::y();
        }
        for event in &report.events {
            match *event {
                SegmentEvent::Merged { from, into } => {
                    self.memory.merge(from, into);
                    self.encoded.remove(&from);
                }
                SegmentEvent::Removed(id) => {
                    self.memory.forget(id);
                    self.encoded.remove(&id);
                }
                _ => {}
            }
        }
        report
    }

    /// Whether it is time for an inference.
    #[must_use]
    pub fn inference_is_due(&self) -> bool {
        self.params.infer_every > 0 && self.frames.is_multiple_of(self.params.infer_every)
    }

    /// Encodes what changed, scores the whole graph, and fuses the scores.
    ///
    /// # Errors
    /// Whatever the network refuses.
    pub fn infer(&mut self) -> Result<(), Error> {
        let set = self.nodes()?;
        let features = self.encode(&set)?;
        let out = self.model.infer_features(&features, &set.edges)?;
        let (classes, predicates) = (out.class_probabilities(), out.predicate_probabilities());
        for (k, n) in set.nodes.iter().enumerate() {
            self.memory.add_node(n.id, classes.row(k));
        }
        for (k, &[i, j]) in set.edges.iter().enumerate() {
            self.memory.add_pair((set.nodes[i].id, set.nodes[j].id), predicates.row(k));
        }
        Ok(())
    }

    fn encode(&mut self, set: &NodeSet) -> Result<Features, Error> {
        let (channels, refresh) = (self.model.config().channels, self.params.refresh);
        let stale = |e: Option<&Encoded>, now: u32| {
            e.is_none_or(|e| (now as f32 - e.surfels as f32).abs() >= refresh * e.surfels as f32)
        };
        // Within an eighth of a turn: walls look the same a quarter on.
        let off = (set.to_walls - self.to_walls + FRAC_PI_4).rem_euclid(FRAC_PI_2) - FRAC_PI_4;
        if off.abs() > ASTRAY {
            self.encoded.clear();
            self.to_walls = set.to_walls;
        }
        for n in set.nodes.iter() {
            if stale(self.encoded.get(&n.id), n.surfels) {
                let segment = n.segment(channels, self.to_walls)?;
                let e = Encoded {
                    surfels: n.surfels,
                    feature: self.model.encode_segment(&segment)?,
                    descriptor: segment.descriptor,
                };
                self.encoded.insert(n.id, e);
            }
        }
        let known = set.nodes.iter().filter_map(|n| self.encoded.get(&n.id));
        Ok(Features {
            nodes: Matrix::from_rows(
                known.clone().flat_map(|e| &e.feature).copied().collect(),
                self.model.config().node_dim,
            ),
            descriptors: known.map(|e| e.descriptor).collect(),
        })
    }

    /// The nodes as they are now.
    ///
    /// # Errors
    /// Surfels without finite coordinates.
    pub fn nodes(&self) -> Result<NodeSet, Error> {
        NodeSet::of_map(&self.map, &self.turn, &self.params.nodes)
    }

    /// Fused scores of a node set; nodes and pairs that were never scored are uniform.
    #[must_use]
    pub fn scores(&self, set: &NodeSet) -> Scores {
        let c = self.model.config();
        let uniform = |n: usize| vec![1.0 / n as f32; n];
        let class = |id| self.memory.node(id).map_or_else(|| uniform(c.classes), |f| f.p.clone());
        let pair = |ids| self.memory.pair(ids).map_or_else(|| uniform(c.predicates), |f| f.p.clone());
        Scores {
            classes: set.nodes.iter().map(|n| class(n.id)).collect(),
            predicates: set.edges.iter().map(|&[i, j]| pair((set.nodes[i].id, set.nodes[j].id))).collect(),
        }
    }

    /// The graph of the visit so far, and the instance of each segment.
    ///
    /// # Errors
    /// As [`build_graph`].
    pub fn graph(
        &self,
        vocabulary: &mut Vocabulary,
    ) -> Result<(SceneGraph, BTreeMap<SegmentId, u64>), Error> {
        self.graph_by(self.params.graph.clone(), vocabulary)
    }

    fn graph_by(
        &self,
        params: GraphParams,
        vocabulary: &mut Vocabulary,
    ) -> Result<(SceneGraph, BTreeMap<SegmentId, u64>), Error> {
        let set = self.nodes()?;
        let c = self.model.config();
        let p = GraphParams { multi: c.edge_scores == EdgeScores::Multi, time: self.time, ..params };
        let objects = self.objects(&set)?;
        let (graph, of) = build_graph(&objects, &c.class_names, &c.predicate_names, vocabulary, &p)?;
        let instance = set.nodes.iter().zip(of).filter_map(|(n, id)| Some((n.id, id?.0)));
        Ok((graph, instance.collect()))
    }

    /// The objects that the segments of a node set are parts of. Segments were scored one by one; the
    /// network has a second look at the objects that they make up, and what is a piece of one wall then is joined.
    ///
    /// # Errors
    /// Whatever the network refuses.
    pub fn objects(&self, set: &NodeSet) -> Result<Objects, Error> {
        let (c, p) = (self.model.config(), &self.params);
        let mut objects =
            Objects::join(set, &self.scores(set), &c.predicate_names, p.graph.min_same_part, p.nodes.gap)?;
        if p.graph.second_look > 0.0 {
            let segments = objects.set.segments(c.channels)?;
            let out = self.model.infer(&Graph { segments: &segments, edges: &objects.set.edges })?;
            let rows = |m: Matrix| (0..m.rows()).map(|k| m.row(k).to_vec()).collect();
            let second = Scores {
                classes: rows(out.class_probabilities()),
                predicates: rows(out.predicate_probabilities()),
            };
            objects.look_again(&second, p.graph.second_look);
        }
        objects.join_walls(&c.class_names, p.nodes.gap);
        Ok(objects)
    }

    /// The graph of the visit so far with what has no name ([`GraphParams::unnamed`]).
    ///
    /// # Errors
    /// As [`build_graph`].
    pub fn graph_with_landmarks(&self, vocabulary: &mut Vocabulary) -> Result<SceneGraph, Error> {
        let graph = GraphParams { unnamed: true, ..self.params.graph.clone() };
        Ok(self.graph_by(graph, vocabulary)?.0)
    }

    /// Up in the map's frame from the planes seen, for a camera held upright; `None` with too few
    /// planes.
    #[must_use]
    pub fn estimate_up(&self) -> Option<Vector3<f32>> {
        gsm::estimate_up_near(&self.map, &self.camera_up)
    }

    /// Turns nodes and graph from the map's frame into one whose z is up. Encodings and scores made
    /// in the old frame are dropped.
    pub fn set_up(&mut self, turn: UnitQuaternion<f32>) {
        self.turn = turn;
        self.encoded.clear();
        self.memory = Memory::default();
    }

    /// Where the robot has looked so far, in cells of 0.5 m of the graph's frame: cells of whose
    /// volume at least a quarter was seen, as free space or as a surface.
    ///
    /// # Errors
    /// A map that spans more than 2^26 cells.
    pub fn looked(&self) -> Result<Looked, Error> {
        crate::looked::looked(&self.map, &self.turn)
    }

    /// Most pixels of the working resolution.
    pub fn max_pixels(&self) -> u32 {
        self.map.params().max_pixels
    }

    /// Changes the working resolution from the next frame on.
    pub fn set_max_pixels(&mut self, pixels: u32) {
        self.map.set_max_pixels(pixels);
    }

    /// The surfel map.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// Frames given to [`Self::segment`].
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.frames
    }
}
