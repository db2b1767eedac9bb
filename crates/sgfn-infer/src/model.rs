//! Weights and the whole forward pass.

use crate::encode::{Head, PointNet};
use crate::fan::{Fan, FanTrace, Names, Widths, softmax};
use crate::{Descriptor, Error, Matrix, Segment, Store};
use rayon::prelude::*;

/// Numbers of the descriptor part of a node feature.
const SPATIAL: usize = 8;
/// Layers of attention.
const LAYERS: usize = 2;
/// Largest number of segments or of edges of one graph.
const MAX_GRAPH: usize = 1 << 20;

/// Which code the weights come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// ShunChengWu/3DSSG, branch `main` (2023): edge descriptor d_j - d_i, temperature sqrt(d_e / H).
    Main,
    /// Branch `cvpr21`, also SceneGraphFusion's ONNX models: edge descriptor d_i - d_j, temperature 1.
    Sgf21,
}

/// What a set of weights computes, read from its tensors and metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Code variant.
    pub variant: Variant,
    /// Width D of a node feature.
    pub node_dim: usize,
    /// Width d_e of an edge feature.
    pub edge_dim: usize,
    /// Width d_a of a message.
    pub att_dim: usize,
    /// Attention heads H.
    pub heads: usize,
    /// Numbers per point.
    pub channels: usize,
    /// Class outputs.
    pub classes: usize,
    /// Predicate outputs.
    pub predicates: usize,
    /// What edge outputs mean.
    pub edge_scores: EdgeScores,
    /// Names in output order, empty where the file does not say (metadata `class_names`, one a line).
    pub class_names: Vec<String>,
    /// Names in output order, empty where the file does not say (metadata `predicate_names`).
    pub predicate_names: Vec<String>,
}

/// Meaning of the edge head's outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeScores {
    /// One predicate per pair: softmax.
    Single,
    /// Any number of predicates per pair: sigmoid.
    Multi,
}

/// Segments and directed edges `[i, j]`: i is the subject and receiver, j the object and sender.
#[derive(Clone, Copy, Debug)]
pub struct Graph<'a> {
    /// Nodes.
    pub segments: &'a [Segment],
    /// Indices into `segments`.
    pub edges: &'a [[usize; 2]],
}

/// Node features after the encoder, and the descriptors that the edge encoder needs. They depend
/// on nothing but the node, so a caller may keep them while a segment does not change.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    /// N x D.
    pub nodes: Matrix,
    /// N descriptors.
    pub descriptors: Vec<Descriptor>,
}

/// Scores before softmax or sigmoid.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// N x classes.
    pub class_logits: Matrix,
    /// E x predicates; no rows for a graph without edges.
    pub predicate_logits: Matrix,
    edge_scores: EdgeScores,
}

impl Output {
    /// softmax of the class logits.
    #[must_use]
    pub fn class_probabilities(&self) -> Matrix {
        softmax_rows(&self.class_logits)
    }

    /// softmax, or for multi-label weights sigmoid, of the predicate logits.
    #[must_use]
    pub fn predicate_probabilities(&self) -> Matrix {
        match self.edge_scores {
            EdgeScores::Single => softmax_rows(&self.predicate_logits),
            EdgeScores::Multi => {
                let mut m = self.predicate_logits.clone();
                m.as_mut_slice().iter_mut().for_each(|v| *v = 1.0 / (1.0 + (-*v).exp()));
                m
            }
        }
    }
}

fn softmax_rows(m: &Matrix) -> Matrix {
    let mut m = m.clone();
    let cols = m.cols();
    m.as_mut_slice().chunks_exact_mut(cols).for_each(|r| softmax(r, 1.0));
    m
}

/// The network.
#[derive(Clone, Debug)]
pub struct Model {
    config: Config,
    node_encoder: PointNet,
    edge_encoder: PointNet,
    layers: Vec<Fan>,
    node_head: Head,
    edge_head: Head,
}

/// Intermediates, in the order in which they arise.
#[derive(Default)]
pub(crate) struct Trace {
    pub(crate) edge_descriptor: Matrix,
    pub(crate) edges: Matrix,
    pub(crate) layers: Vec<(FanTrace, Matrix, Matrix)>,
}

impl Model {
    /// Reads weights under the authors' tensor names; the variant follows from the names.
    ///
    /// # Errors
    /// Whatever is wrong with the file, naming the tensor.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self, Error> {
        Self::from_store(&Store::read(bytes)?)
    }

    /// As [`Self::from_safetensors`], from tensors that are already read.
    ///
    /// # Errors
    /// Missing tensors and shapes that do not fit together, naming the tensor.
    pub fn from_store(store: &Store) -> Result<Self, Error> {
        let variant =
            if store.has("obj_encoder.model.conv1.weight") { Variant::Main } else { Variant::Sgf21 };
        let (node_prefix, edge_prefix) = match variant {
            Variant::Main => ("obj_encoder.model", "rel_encoder.encoder"),
            Variant::Sgf21 => ("obj_encoder", "rel_encoder"),
        };
        let node_encoder = PointNet::load(store, node_prefix)?;
        let edge_encoder = PointNet::load(store, edge_prefix)?;
        if edge_encoder.inputs() != 11 {
            return Err(Error::tensor(
                &format!("{edge_prefix}.conv1.weight"),
                format!("takes {} inputs, want the 11 of a descriptor", edge_encoder.inputs()),
            ));
        }
        let widths = widths(store, variant, node_encoder.outputs() + SPATIAL, edge_encoder.outputs())?;
        let layers = (0..LAYERS)
            .map(|l| Fan::load(store, &names(variant, l), widths, variant == Variant::Main))
            .collect::<Result<Vec<_>, _>>()?;
        let node_head = Head::load(store, "obj_predictor", widths.node)?;
        let edge_head = Head::load(store, "rel_predictor", widths.edge)?;
        let multi = store.metadata("multi_label") == Some("true");
        let config = Config {
            variant,
            node_dim: widths.node,
            edge_dim: widths.edge,
            att_dim: widths.att,
            heads: widths.heads,
            channels: node_encoder.inputs(),
            classes: node_head.outputs(),
            predicates: edge_head.outputs(),
            edge_scores: if multi { EdgeScores::Multi } else { EdgeScores::Single },
            class_names: name_list(store, "class_names", node_head.outputs())?,
            predicate_names: name_list(store, "predicate_names", edge_head.outputs())?,
        };
        Ok(Self { config, node_encoder, edge_encoder, layers, node_head, edge_head })
    }

    /// What these weights compute.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The encoder's feature of one segment: [PointNet (D - 8), std, extent, ln volume, ln longest].
    ///
    /// # Errors
    /// A segment with another number of channels.
    pub fn encode_segment(&self, segment: &Segment) -> Result<Vec<f32>, Error> {
        if segment.channels != self.config.channels {
            return Err(Error::input(
                "segments",
                format!("{} channels a point, these weights take {}", segment.channels, self.config.channels),
            ));
        }
        let mut row = vec![0.0; self.config.node_dim];
        let (net, spatial) = row.split_at_mut(self.config.node_dim - SPATIAL);
        self.node_encoder.pool(&segment.points, net);
        spatial.copy_from_slice(&segment.descriptor.spatial());
        Ok(row)
    }

    /// Features of all segments.
    ///
    /// # Errors
    /// A segment with another number of channels.
    pub fn encode(&self, segments: &[Segment]) -> Result<Features, Error> {
        let rows = segments.par_iter().map(|s| self.encode_segment(s)).collect::<Result<Vec<_>, _>>()?;
        Ok(Features {
            nodes: Matrix::from_rows(rows.concat(), self.config.node_dim),
            descriptors: segments.iter().map(|s| s.descriptor).collect(),
        })
    }

    /// Scores of a whole graph.
    ///
    /// # Errors
    /// Segments with another number of channels, edges to nodes that are not there.
    pub fn infer(&self, graph: &Graph<'_>) -> Result<Output, Error> {
        self.infer_features(&self.encode(graph.segments)?, graph.edges)
    }

    /// Scores from encoded segments. Without edges the attention layers are skipped and the class
    /// head sees the encoder's feature, as in the authors' code.
    ///
    /// # Errors
    /// Edges to nodes that are not there.
    pub fn infer_features(&self, features: &Features, edges: &[[usize; 2]]) -> Result<Output, Error> {
        self.run(features, edges, None)
    }

    pub(crate) fn run(
        &self,
        features: &Features,
        index: &[[usize; 2]],
        mut trace: Option<&mut Trace>,
    ) -> Result<Output, Error> {
        let n = features.nodes.rows();
        if n > MAX_GRAPH || index.len() > MAX_GRAPH {
            return Err(Error::input("graph", format!("{n} segments, {} edges: too large", index.len())));
        }
        if let Some(e) = index.iter().find(|e| e[0] >= n || e[1] >= n) {
            return Err(Error::input("edges", format!("edge {e:?}, but there are {n} segments")));
        }
        let mut nodes = features.nodes.clone();
        let mut edges = Matrix::zeros(0, self.config.edge_dim);
        if !index.is_empty() {
            let relative = self.edge_descriptors(&features.descriptors, index);
            edges = self.edge_encoder.rows(&relative);
            if let Some(t) = trace.as_deref_mut() {
                t.edge_descriptor = relative;
                t.edges = edges.clone();
            }
            for (l, layer) in self.layers.iter().enumerate() {
                let mut inner = trace.is_some().then(FanTrace::default);
                let (v, e) = layer.apply(&nodes, &edges, index, inner.as_mut());
                if let (Some(t), Some(inner)) = (trace.as_deref_mut(), inner) {
                    t.layers.push((inner, v.clone(), e.clone()));
                }
                let last = l + 1 == self.layers.len();
                (nodes, edges) = if last { (v, e) } else { (v.relu(), e.relu()) };
            }
        }
        Ok(Output {
            class_logits: self.node_head.apply(&nodes),
            predicate_logits: self.edge_head.apply(&edges),
            edge_scores: self.config.edge_scores,
        })
    }

    fn edge_descriptors(&self, d: &[Descriptor], index: &[[usize; 2]]) -> Matrix {
        let rows = index.iter().flat_map(|&[i, j]| match self.config.variant {
            Variant::Main => Descriptor::relative(&d[j], &d[i]),
            Variant::Sgf21 => Descriptor::relative(&d[i], &d[j]),
        });
        Matrix::from_rows(rows.collect(), 11)
    }
}

fn widths(store: &Store, variant: Variant, node: usize, edge: usize) -> Result<Widths, Error> {
    let names = names(variant, 0);
    let att = store.linear_from(&names.v, node)?.outputs();
    let per_head = store.linear(&names.att[0])?.inputs();
    let heads = (node + edge) / per_head;
    let divides = heads > 0 && [node, edge, att].iter().all(|d| d % heads == 0);
    if !divides || heads * per_head != node + edge {
        return Err(Error::tensor(
            &format!("{}.weight", names.att[0]),
            format!(
                "takes {per_head} inputs, want (D + d_e) / H with H a divisor of D = {node}, d_e = {edge}, d_a = {att}"
            ),
        ));
    }
    Ok(Widths { node, edge, att, heads })
}

fn names(variant: Variant, layer: usize) -> Names {
    match variant {
        Variant::Main => {
            let n = |s: &str| format!("gnn.gconvs.{layer}.{s}");
            Names {
                q: n("proj_q.0"),
                k: n("proj_k.0"),
                v: n("proj_v.0"),
                att: [n("nn_att.0"), n("nn_att.2")],
                edge: [n("nn_edge.0"), n("nn_edge.2")],
                node: [n("update_node.0"), n("update_node.2")],
            }
        }
        Variant::Sgf21 => {
            let n = |s: &str| format!("gcn.gconvs.{layer}.{s}");
            Names {
                q: n("edgeatten.proj_query.0"),
                k: n("edgeatten.proj_edge.0"),
                v: n("edgeatten.proj_value.0"),
                att: [n("edgeatten.nn.0"), n("edgeatten.nn.3")],
                edge: [n("edgeatten.nn_edge.0"), n("edgeatten.nn_edge.2")],
                node: [n("prop.0"), n("prop.2")],
            }
        }
    }
}

fn name_list(store: &Store, key: &str, len: usize) -> Result<Vec<String>, Error> {
    let Some(text) = store.metadata(key) else { return Ok(Vec::new()) };
    let names: Vec<String> = text.lines().map(str::to_owned).collect();
    if names.len() != len {
        return Err(Error::File(format!("metadata {key} has {} lines, want {len}", names.len())));
    }
    Ok(names)
}
