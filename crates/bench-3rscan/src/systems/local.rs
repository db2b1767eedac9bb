//! One visit: frames in, local graphs out. Computed once and charged to every system that makes
//! this visit.

use super::rules::{majority_scores, rule_scores};
use crate::samples::{Kind, Teacher};
use crate::scenario::{FramesMode, Visit};
use crate::surface::Seen;
use crate::systems::AgentFrames;
use crate::{Error, Surface};
use agent::{GraphParams, NodeSet, Objects, Robot, RobotParams, Scores, build_graph};
use graph_align::{Edge, Node, NodeId, SceneGraph, Vocabulary};
use nalgebra::Isometry3;
use scan3r::{Dataset, LabelSet};
use sgfn_infer::{EdgeScores, Graph, Model};
use std::collections::BTreeMap;

/// Who labelled the nodes of a local graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variant {
    /// The network.
    Network,
    /// The network, with what it has no name for: landmarks for alignment.
    Full,
    /// Plane and height rules.
    Rules,
    /// The commonest answer.
    Majority,
    /// The truth, on our segments.
    OracleLabels,
    /// The network, on true segments.
    OracleSegments,
}

/// How visits are computed.
pub struct LocalParams<'a> {
    /// The robot.
    pub robot: RobotParams,
    /// Weights.
    pub model: &'a Model,
    /// Label set.
    pub labels: LabelSet,
    /// Names of classes and predicates; fixed.
    pub vocabulary: &'a Vocabulary,
    /// Which graphs are wanted; the network's is always made.
    pub variants: Vec<Variant>,
    /// Seconds between two revisions of a visit; none: it is published once, at its end.
    pub publish_s: Option<f64>,
    /// Clocks.
    pub clocks: Clocks,
}

/// Clocks are handed in: the binary owns them.
#[derive(Clone, Copy)]
pub struct Clocks {
    /// CPU seconds of the calling thread.
    pub cpu: fn() -> f64,
    /// Wall-clock seconds since any moment.
    pub wall: fn() -> f64,
}

/// A visit as it is published: once or more often, the last time whole.
#[derive(Clone, Debug)]
pub struct Revision {
    /// Seconds since the visit's start.
    pub at_s: f64,
    /// The graphs that agents exchange. Where there are several revisions, a node is named after its largest
    /// segment, so that it keeps its name from one to the next.
    pub graphs: BTreeMap<Variant, SceneGraph>,
    /// Where the visit had looked.
    pub looked: graph_align::Looked,
}

/// What a visit gave. Node ids start at 0, times at the visit's start.
#[derive(Clone, Debug)]
pub struct Local {
    /// In the visit's frame, quantised as it travels.
    pub graphs: BTreeMap<Variant, SceneGraph>,
    /// Where the visit looked, in its frame.
    pub looked: graph_align::Looked,
    /// The instance that each node of the network's graph mostly shows; 0 = none.
    pub instances: BTreeMap<NodeId, u32>,
    /// What its depth samples fell on.
    pub seen: Seen,
    /// As it is published; empty where that is at its end alone.
    pub revisions: Vec<Revision>,
    /// CPU seconds that revisions took, beside `cpu_s`.
    pub revisions_cpu_s: f64,
    /// CPU seconds of segmentation, inference and graph.
    pub cpu_s: f64,
    /// CPU seconds of rendering or decoding.
    pub world_s: f64,
    /// Wall-clock seconds of all of it.
    pub wall_s: f64,
    /// Frames.
    pub frames: u32,
}

/// Runs one visit. `domain_from_scan` is layout x `T_reference_scan`.
///
/// # Errors
/// What the data set or the pipeline refuses.
pub fn run_visit(
    data: &dyn Dataset,
    visit: &Visit,
    surface: &Surface,
    domain_from_scan: &Isometry3<f32>,
    frames: &AgentFrames,
    p: &LocalParams<'_>,
) -> Result<Local, Error> {
    let pipeline = |e: agent::Error| Error::Pipeline(format!("scan {}: {e}", visit.scan));
    let frame_from_scan = frames.frame_from_domain(visit) * domain_from_scan;
    let mut walk = frames.walk(visit);
    let wall = (p.clocks.wall)();
    let mut params = p.robot.clone();
    if frames.mode() == FramesMode::Drift {
        // Inertia tells a robot what is up.
        params.segmentation.tracking = gsm::Tracking::Upright([0.0, 0.0, 1.0]);
    }
    let mut robot = Robot::new(p.model, params).map_err(pipeline)?;
    let mut seen = Seen::new(surface);
    let (mut cpu_s, mut world_s, mut count) = (0.0, 0.0, 0);
    let mut stream = data.frames(&visit.scan, visit.pass)?;
    let (mut position, mut inferred) = (0, false);
    let (mut revisions, mut revisions_cpu_s) = (Vec::new(), 0.0);
    let mut due = Due { every_s: p.publish_s, next_s: p.publish_s.unwrap_or(f64::MAX) };
    loop {
        let start = (p.clocks.cpu)();
        let Some(frame) = stream.next() else { break };
        let mut frame = frame?;
        position += 1;
        if position <= visit.frames.start {
            continue;
        }
        if position > visit.frames.end {
            break;
        }
        seen.observe(surface, &frame);
        frame.world_from_camera = frame.world_from_camera.map(|pose| {
            let pose = frame_from_scan * pose;
            walk.as_mut().map_or(pose, |w| w.believed(pose))
        });
        let ready = (p.clocks.cpu)();
        world_s += ready - start;
        robot.segment(&frame);
        if robot.inference_is_due() {
            robot.infer().map_err(pipeline)?;
            inferred = true;
        }
        let segmented = (p.clocks.cpu)();
        cpu_s += segmented - ready;
        count += 1;
        let at_s = f64::from(count) / scan3r::sequence::FRAMES_PER_SECOND;
        // Before the first inference there is nothing to say; the end is published anyway.
        if due.is_now(at_s) && inferred && count < visit.len() {
            revisions.push(revision(&robot, at_s, p)?);
            revisions_cpu_s += (p.clocks.cpu)() - segmented;
        }
    }
    seen.finish(surface);
    let start = (p.clocks.cpu)();
    robot.infer().map_err(pipeline)?;
    let set = robot.nodes().map_err(pipeline)?;
    let objects = robot.objects(&set).map_err(pipeline)?;
    let own = Names::of_network(p);
    let (network, node_of) = graph_of(&objects, &own, p, false)?;
    cpu_s += (p.clocks.cpu)() - start;
    let scan_from_frame = frame_from_scan.inverse();
    let teacher = Teacher::new(data, &visit.scan, surface, p.labels)?;
    let in_scan = moved(&set, &scan_from_frame);
    let taught = teacher.teach(Kind::End, in_scan);
    let mut graphs = BTreeMap::from([(Variant::Network, network.quantised())]);
    let truth = Names::of_truth(p);
    for &v in p.variants.iter().filter(|v| **v != Variant::Network) {
        let graph = match v {
            Variant::Network => continue,
            Variant::Full => graph_of(&objects, &own, p, true)?.0,
            Variant::Rules => graph_by(&set, &rule_scores(&set, p.labels), &truth, p)?,
            Variant::Majority => graph_by(&set, &majority_scores(&set, p.labels), &truth, p)?,
            Variant::OracleLabels => graph_by(&set, &taught_scores(&taught, p.labels), &truth, p)?,
            Variant::OracleSegments => true_segments(&robot, &teacher, &frame_from_scan, p)?,
        };
        graphs.insert(v, graph.quantised());
    }
    let looked = robot.looked().map_err(pipeline)?.quantised();
    if p.publish_s.is_some() {
        let at_s = f64::from(count) / scan3r::sequence::FRAMES_PER_SECOND;
        revisions.push(revision(&robot, at_s, p)?);
    }
    let instances = instances_of(&network, &set, &node_of, &taught.instances);
    let wall_s = (p.clocks.wall)() - wall;
    Ok(Local {
        graphs,
        looked,
        instances,
        seen,
        revisions,
        revisions_cpu_s,
        cpu_s,
        world_s,
        wall_s,
        frames: count,
    })
}

/// When to publish next.
struct Due {
    every_s: Option<f64>,
    next_s: f64,
}

impl Due {
    fn is_now(&mut self, at_s: f64) -> bool {
        let now = at_s + 1e-6 >= self.next_s;
        while let Some(every) = self.every_s.filter(|_| at_s + 1e-6 >= self.next_s) {
            self.next_s += every;
        }
        now
    }
}

/// The visit so far. Nothing is inferred for it, so that the visit ends as it would without.
fn revision(robot: &Robot<'_>, at_s: f64, p: &LocalParams<'_>) -> Result<Revision, Error> {
    let pipeline = |e: agent::Error| Error::Pipeline(e.to_string());
    let set = robot.nodes().map_err(pipeline)?;
    let objects = robot.objects(&set).map_err(pipeline)?;
    let mut graphs = BTreeMap::new();
    for (variant, unnamed) in [(Variant::Network, false), (Variant::Full, true)] {
        if variant == Variant::Network || p.variants.contains(&variant) {
            let (graph, node_of) = graph_of(&objects, &Names::of_network(p), p, unnamed)?;
            graphs.insert(variant, named_by_segments(&graph, &set, &node_of).quantised());
        }
    }
    let looked = robot.looked().map_err(pipeline)?.quantised();
    Ok(Revision { at_s, graphs, looked })
}

/// Each node under the number of its largest segment, the smallest of equals.
fn named_by_segments(graph: &SceneGraph, set: &NodeSet, node_of: &[Option<NodeId>]) -> SceneGraph {
    let mut largest: BTreeMap<NodeId, (u32, u32)> = BTreeMap::new();
    for (n, id) in set.nodes.iter().zip(node_of) {
        let Some(id) = id else { continue };
        let l = largest.entry(*id).or_insert((0, u32::MAX));
        if n.surfels > l.0 || n.surfels == l.0 && n.id.0 < l.1 {
            *l = (n.surfels, n.id.0);
        }
    }
    let name = |id: NodeId| largest.get(&id).map_or(id, |l| NodeId(u64::from(l.1)));
    let mut out = SceneGraph::default();
    graph.nodes().for_each(|n| out.insert_node(Node { id: name(n.id), ..n.clone() }));
    for e in graph.edges() {
        // Segments are parts of one object each, so names differ and both ends are there.
        let _ = out.insert_edge(Edge { s: name(e.s), t: name(e.t), ..e });
    }
    out
}

/// What the places of scores mean.
struct Names {
    classes: Vec<String>,
    predicates: Vec<String>,
}

impl Names {
    /// Of what the network says.
    fn of_network(p: &LocalParams<'_>) -> Self {
        let c = p.model.config();
        Self { classes: c.class_names.clone(), predicates: c.predicate_names.clone() }
    }

    /// Of what the truth and the rules say.
    fn of_truth(p: &LocalParams<'_>) -> Self {
        let (classes, predicates) = crate::samples::output_names(p.labels);
        Self { classes, predicates }
    }
}

/// The graph of scores other than the robot's own.
fn graph_by(set: &NodeSet, scores: &Scores, names: &Names, p: &LocalParams<'_>) -> Result<SceneGraph, Error> {
    let RobotParams { graph, nodes, .. } = &p.robot;
    let objects = Objects::join(set, scores, &names.predicates, graph.min_same_part, nodes.gap)
        .map_err(|e| Error::Pipeline(e.to_string()))?;
    Ok(graph_of(&objects, names, p, false)?.0)
}

fn graph_of(
    objects: &Objects,
    names: &Names,
    p: &LocalParams<'_>,
    unnamed: bool,
) -> Result<(SceneGraph, Vec<Option<NodeId>>), Error> {
    let g = GraphParams {
        multi: p.model.config().edge_scores == EdgeScores::Multi,
        unnamed,
        first_id: 0,
        time: 0.0,
        ..p.robot.graph.clone()
    };
    let mut vocabulary = p.vocabulary.clone();
    build_graph(objects, &names.classes, &names.predicates, &mut vocabulary, &g)
        .map_err(|e| Error::Pipeline(e.to_string()))
}

/// The node set with its points in another frame; boxes stay.
fn moved(set: &NodeSet, t: &Isometry3<f32>) -> NodeSet {
    let mut out = set.clone();
    for (p, n) in out.nodes.iter_mut().flat_map(|n| &mut n.points) {
        (*p, *n) = (t * *p, t.rotation * *n);
    }
    out.to_walls -= t.rotation.euler_angles().2;
    out
}

/// One-hot scores of the truth; what has none becomes `none`.
fn taught_scores(s: &crate::samples::Sample, labels: LabelSet) -> Scores {
    let (classes, predicates) = crate::samples::output_names(labels);
    let hot = |k: i64, n: usize| {
        let mut v = vec![0.0; n];
        v[usize::try_from(k).unwrap_or(n - 1)] = 1.0;
        v
    };
    Scores {
        classes: s.classes.iter().map(|&k| hot(k, classes.len())).collect(),
        predicates: s.predicates.iter().map(|&k| hot(k, predicates.len())).collect(),
    }
}

/// The network on the true instances' surfels.
fn true_segments(
    robot: &Robot<'_>,
    teacher: &Teacher<'_>,
    frame_from_scan: &Isometry3<f32>,
    p: &LocalParams<'_>,
) -> Result<SceneGraph, Error> {
    let pipeline = |e: agent::Error| Error::Pipeline(e.to_string());
    let scan_from_frame = frame_from_scan.inverse();
    let set = teacher.instances_of_map(robot.map(), &scan_from_frame, &p.robot.nodes)?;
    let channels = p.model.config().channels;
    let segments = set.segments(channels).map_err(pipeline)?;
    let out = p
        .model
        .infer(&Graph { segments: &segments, edges: &set.edges })
        .map_err(|e| Error::Pipeline(e.to_string()))?;
    let (c, q) = (out.class_probabilities(), out.predicate_probabilities());
    let scores = Scores {
        classes: (0..c.rows()).map(|k| c.row(k).to_vec()).collect(),
        predicates: (0..q.rows()).map(|k| q.row(k).to_vec()).collect(),
    };
    graph_by(&set, &scores, &Names::of_network(p), p)
}

/// The instance of a node is that of its largest segment.
fn instances_of(
    graph: &SceneGraph,
    set: &NodeSet,
    node_of: &[Option<NodeId>],
    instances: &[u32],
) -> BTreeMap<NodeId, u32> {
    let mut best: BTreeMap<NodeId, (u32, u32)> = graph.nodes().map(|n| (n.id, (0, 0))).collect();
    for ((n, id), &instance) in set.nodes.iter().zip(node_of).zip(instances) {
        if let Some(b) = id.as_ref().and_then(|id| best.get_mut(id))
            && n.surfels > b.0
        {
            *b = (n.surfels, instance);
        }
    }
    best.into_iter().map(|(id, (_, i))| (id, i)).collect()
}
