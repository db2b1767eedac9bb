//! Graph files (`ma3dsg-graph/1`) and alignment cases (`align-case/2`), text to types and back.

use crate::{
    Box3, Edge, Error, Footprint, LabelId, Looked, Match, Node, NodeId, Outcome, SceneGraph, Verdict,
    Vocabulary,
};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// The schema name of graph files.
pub const GRAPH_SCHEMA: &str = "ma3dsg-graph/1";

/// A graph file. Names stand for classes and predicates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraphFile {
    /// [`GRAPH_SCHEMA`]; absent in the graphs of alignment cases.
    #[serde(default)]
    pub schema: Option<String>,
    /// Unit vector against gravity, in this file's frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Whether z is up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gravity_aligned: Option<bool>,
    /// 4x4 row-major: points of the recording's own frame to this file's frame.
    #[serde(default)]
    pub world_from_recording: Option<Vec<f64>>,
    /// Objects.
    pub nodes: Vec<NodeRecord>,
    /// Relations.
    pub edges: Vec<EdgeRecord>,
    /// Objects without a name: they serve alignment and are no part of the graph. Their ids are unique
    /// among nodes and landmarks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub landmarks: Vec<NodeRecord>,
    /// Where the graph comes from: data, weights, command.
    #[serde(default, skip_serializing_if = "Value::is_null")]
    pub provenance: Value,
}

/// How an object lies on the ground, see [`Footprint`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FootprintRecord {
    /// Angle from x to the first side, radians, 0 to a quarter turn.
    pub yaw: f32,
    /// Distances from the centroid to the lines whose outward normals are at `yaw` plus multiples of 45 degrees, metres.
    pub reach: [f32; 8],
}

/// One object in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// Unique in the file.
    pub id: u64,
    /// Class name.
    pub label: String,
    /// Probability of the class.
    #[serde(default = "one")]
    pub score: f32,
    /// Metres.
    pub centroid: [f32; 3],
    /// Full side lengths, metres.
    pub extent: [f32; 3],
    /// The footprint, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub footprint: Option<FootprintRecord>,
    /// The next best classes and their probabilities.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<(String, f32)>,
    /// Number of observations.
    #[serde(default = "once")]
    pub sightings: u32,
    /// Number of visits that looked at its place and did not observe it.
    #[serde(default, skip_serializing_if = "none")]
    pub misses: u32,
    /// Seconds.
    #[serde(default)]
    pub last_seen: f64,
}

/// One relation in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeRecord {
    /// Subject.
    pub s: u64,
    /// Object.
    pub t: u64,
    /// Predicate name.
    pub p: String,
    /// Probability.
    #[serde(default = "one")]
    pub score: f32,
}

fn one() -> f32 {
    1.0
}

fn none(n: &u32) -> bool {
    *n == 0
}

fn once() -> u32 {
    1
}

impl NodeRecord {
    fn of(n: &Node, vocabulary: &Vocabulary) -> Self {
        Self {
            id: n.id.0,
            label: vocabulary.label_name(n.label).to_owned(),
            score: n.score,
            centroid: n.bounds.centroid().coords.into(),
            extent: n.bounds.extent().into(),
            footprint: n.bounds.footprint().map(|f| FootprintRecord { yaw: f.yaw, reach: f.reach }),
            others: n.others.iter().map(|(l, p)| (vocabulary.label_name(l).to_owned(), p)).collect(),
            sightings: n.sightings,
            misses: n.misses,
            last_seen: n.last_seen,
        }
    }
}

impl GraphFile {
    /// Reads a graph file.
    ///
    /// # Errors
    /// Text that is no JSON of this shape, naming line and column.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let file: Self = serde_json::from_str(text).map_err(|e| Error::format("JSON", e.to_string()))?;
        match file.schema.as_deref() {
            None | Some(GRAPH_SCHEMA) => Ok(file),
            Some(other) => Err(Error::format("schema", format!("{other:?}, want {GRAPH_SCHEMA:?}"))),
        }
    }

    /// A file of a graph, z up, without provenance.
    #[must_use]
    pub fn of_graph(graph: &SceneGraph, vocabulary: &Vocabulary) -> Self {
        Self {
            schema: Some(GRAPH_SCHEMA.to_owned()),
            up: Some([0.0, 0.0, 1.0]),
            gravity_aligned: Some(true),
            world_from_recording: None,
            nodes: graph.nodes().map(|n| NodeRecord::of(&n, vocabulary)).collect(),
            edges: graph
                .edges()
                .map(|e| EdgeRecord {
                    s: e.s.0,
                    t: e.t.0,
                    p: vocabulary.predicate_name(e.p).to_owned(),
                    score: e.score,
                })
                .collect(),
            landmarks: Vec::new(),
            provenance: Value::Null,
        }
    }

    /// A file of the named part of a graph ([`SceneGraph::named`]); the other nodes are its landmarks.
    #[must_use]
    pub fn with_landmarks(
        graph: &SceneGraph,
        vocabulary: &Vocabulary,
        unnamed: Option<LabelId>,
        least: f32,
    ) -> Self {
        let named = graph.named(unnamed, least);
        let rest = graph.nodes().filter(|n| !named.has_node(n.id));
        let landmarks = rest.map(|n| NodeRecord::of(&n, vocabulary)).collect();
        Self { landmarks, ..Self::of_graph(&named, vocabulary) }
    }

    /// As [`Self::to_graph`], with the landmarks as nodes among the others.
    ///
    /// # Errors
    /// As [`Self::to_graph`].
    pub fn to_graph_with_landmarks(&self, vocabulary: &mut Vocabulary) -> Result<SceneGraph, Error> {
        let mut all = self.clone();
        all.nodes.append(&mut all.landmarks);
        all.to_graph(vocabulary)
    }

    /// The graph of a file; names that the vocabulary lacks are added to it.
    ///
    /// # Errors
    /// Ids that occur twice, numbers out of range, edges to nodes that are not there.
    pub fn to_graph(&self, vocabulary: &mut Vocabulary) -> Result<SceneGraph, Error> {
        let mut graph = SceneGraph::default();
        let mut ids = BTreeSet::new();
        for (k, n) in self.nodes.iter().enumerate() {
            let at = |e: Error| Error::format(format!("nodes[{k}] (id {})", n.id), e.to_string());
            if !ids.insert(n.id) {
                return Err(Error::format(format!("nodes[{k}]"), format!("id {} occurs twice", n.id)));
            }
            let finite = n.score.is_finite() && n.last_seen.is_finite();
            if !finite || n.others.iter().any(|o| !o.1.is_finite()) {
                return Err(at(Error::value("score, others, last_seen", "not finite")));
            }
            if n.others.len() > Node::MAX_OTHERS {
                return Err(at(Error::value(
                    "others",
                    format!("{}, want at most {}", n.others.len(), Node::MAX_OTHERS),
                )));
            }
            let bounds = Box3::new(n.centroid, n.extent).and_then(|b| match n.footprint {
                Some(FootprintRecord { yaw, reach }) => b.with_footprint(Footprint { yaw, reach }),
                None => Ok(b),
            });
            let mut other =
                |(name, p): &(String, f32)| Ok((vocabulary.label(name).map_err(at)?, p.clamp(0.0, 1.0)));
            let others = n.others.iter().map(&mut other).collect::<Result<_, Error>>()?;
            graph.insert_node(Node {
                id: NodeId(n.id),
                label: vocabulary.label(&n.label).map_err(at)?,
                score: n.score.clamp(0.0, 1.0),
                bounds: bounds.map_err(at)?,
                others,
                sightings: n.sightings,
                misses: n.misses,
                last_seen: n.last_seen,
            });
        }
        for (k, e) in self.edges.iter().enumerate() {
            let at = |err: Error| Error::format(format!("edges[{k}]"), err.to_string());
            if !e.score.is_finite() {
                return Err(at(Error::value("score", "not finite")));
            }
            let p = vocabulary.predicate(&e.p).map_err(at)?;
            let edge = Edge { s: NodeId(e.s), t: NodeId(e.t), p, score: e.score.clamp(0.0, 1.0) };
            graph.insert_edge(edge).map_err(at)?;
        }
        Ok(graph)
    }
}

/// An alignment case: two graphs, and where the query's robot looked.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Name.
    pub id: String,
    /// Whether z is up in both frames.
    pub gravity_aligned: bool,
    /// The graph to be found.
    pub query: SceneGraph,
    /// The graph to find it in.
    pub reference: SceneGraph,
    /// Where the query's robot looked, in the query's frame.
    pub looked: Option<Looked>,
    /// Query points to the reference frame, up to drift.
    pub prior: Option<Isometry3<f32>>,
}

#[derive(Deserialize)]
struct CaseFile {
    id: String,
    #[serde(default = "yes")]
    gravity_aligned: bool,
    query: GraphFile,
    reference: GraphFile,
    seen_query: Option<SeenFile>,
    #[serde(rename = "T_ref_query_prior")]
    prior: Option<Value>,
}

#[derive(Deserialize)]
struct SeenFile {
    cell: f32,
    origin: [f32; 3],
    cells: Vec<[i32; 3]>,
}

fn yes() -> bool {
    true
}

impl Case {
    /// Reads a case.
    ///
    /// # Errors
    /// Text that is no JSON of this shape, and what [`GraphFile::to_graph`] refuses.
    pub fn parse(text: &str, vocabulary: &mut Vocabulary) -> Result<Self, Error> {
        let c: CaseFile = serde_json::from_str(text).map_err(|e| Error::format("JSON", e.to_string()))?;
        let within = |field: &'static str| move |e: Error| Error::format(field, e.to_string());
        Ok(Self {
            query: c.query.to_graph(vocabulary).map_err(within("query"))?,
            reference: c.reference.to_graph(vocabulary).map_err(within("reference"))?,
            looked: c.seen_query.map(|s| Looked::new(s.cell, s.origin, &s.cells)).transpose()?,
            prior: c.prior.map(|v| isometry(&numbers(&v)?)).transpose()?,
            id: c.id,
            gravity_aligned: c.gravity_aligned,
        })
    }

    /// The answer as the scorer reads it.
    #[must_use]
    pub fn answer(&self, outcome: &Outcome, ms: f64) -> Value {
        let base = |word: &str| json!({"id": self.id, "outcome": word, "T_ref_query": null, "matches": [], "moved": [], "removed": [], "added": [], "alternatives": [], "ms": ms});
        match outcome {
            Outcome::Match(m) => {
                let mut v = base("match");
                let of = |kind: fn(&Verdict) -> Option<NodeId>| -> Vec<[u64; 2]> {
                    m.verdicts.iter().filter_map(|(q, v)| Some([q.0, kind(v)?.0])).collect()
                };
                v["T_ref_query"] = json!(row_major(&m.reference_from_query));
                v["matches"] = json!(of(|v| match *v {
                    Verdict::Same(r) | Verdict::Relabelled(r) => Some(r),
                    _ => None,
                }));
                v["moved"] = json!(of(|v| match *v {
                    Verdict::Moved(r) => Some(r),
                    _ => None,
                }));
                v["removed"] = json!(m.removed.iter().map(|r| r.0).collect::<Vec<_>>());
                v["added"] = json!(
                    m.verdicts
                        .iter()
                        .filter(|(_, v)| **v == Verdict::New)
                        .map(|(q, _)| q.0)
                        .collect::<Vec<_>>()
                );
                v["score"] = json!(m.score);
                v["margin"] = json!(m.margin);
                v
            }
            Outcome::Ambiguous { candidates } => {
                let mut v = base("ambiguous");
                v["alternatives"] = candidates
                    .iter()
                    .map(|m| {
                        let pairs: Vec<[u64; 2]> = m.pairs.iter().map(|(q, r)| [q.0, r.0]).collect();
                        json!({"T_ref_query": row_major(&m.reference_from_query), "matches": pairs})
                    })
                    .collect();
                v
            }
            Outcome::NoMatch { why } => {
                let mut v = base("no_match");
                v["why"] = json!(why.word());
                v
            }
        }
    }
}

/// The 16 numbers of a transform, row-major.
#[must_use]
pub fn row_major(t: &Isometry3<f32>) -> Vec<f64> {
    t.cast::<f64>().to_homogeneous().transpose().as_slice().to_vec()
}

/// The rigid transform of 16 row-major numbers.
///
/// # Errors
/// Another count, numbers that are not finite, or an upper block that is no rotation (within 1 %).
pub fn isometry(v: &[f64]) -> Result<Isometry3<f32>, Error> {
    let bad = |why: &str| Error::format("transform", format!("{why}, want a rigid 4x4 row-major matrix"));
    if v.len() != 16 || v.iter().any(|x| !x.is_finite()) {
        return Err(bad("not 16 finite numbers"));
    }
    let m = Matrix3::new(v[0], v[1], v[2], v[4], v[5], v[6], v[8], v[9], v[10]);
    if (m.transpose() * m - Matrix3::identity()).amax() > 1e-2 || m.determinant() < 0.0 {
        return Err(bad("the upper 3x3 block is no rotation"));
    }
    let r = Rotation3::from_matrix_eps(&m, 1e-12, 100, Rotation3::identity());
    let t = Translation3::new(v[3], v[7], v[11]);
    Ok(Isometry3::from_parts(t, UnitQuaternion::from_rotation_matrix(&r)).cast())
}

/// 16 numbers, flat or in four rows.
fn numbers(v: &Value) -> Result<Vec<f64>, Error> {
    let bad = || Error::format("T_ref_query_prior", "want 16 numbers or four rows of four");
    let list = v.as_array().ok_or_else(bad)?;
    list.iter()
        .flat_map(|x| x.as_array().map_or_else(|| vec![x], |row| row.iter().collect()))
        .map(|x| x.as_f64().ok_or_else(bad))
        .collect()
}

/// Names of the labels of a graph, for messages.
#[must_use]
pub fn label_names(graph: &SceneGraph, vocabulary: &Vocabulary) -> Vec<String> {
    let ids: BTreeSet<LabelId> = graph.nodes().map(|n| n.label).collect();
    ids.into_iter().map(|l| vocabulary.label_name(l).to_owned()).collect()
}

/// A match in one line: the pairs as `query-reference`.
#[must_use]
pub fn pairs_line(m: &Match) -> String {
    m.pairs.iter().map(|(q, r)| format!("{}-{}", q.0, r.0)).collect::<Vec<_>>().join(" ")
}
