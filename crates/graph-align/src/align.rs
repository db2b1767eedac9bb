//! The question and its answer.

use crate::paper::{self, PaperParams};
use crate::robust::{self, Index, RobustParams};
use crate::{Looked, NodeId, SceneGraph};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// A graph to be found in a reference, and what is known about it beside its nodes.
#[derive(Clone, Copy, Debug)]
pub struct Query<'a> {
    /// The graph, in a frame of its own.
    pub graph: &'a SceneGraph,
    /// Where its robot looked, in the query's frame.
    pub looked: Option<&'a Looked>,
    /// Query points to the reference frame as far as somebody knows. It narrows the search and says
    /// nothing about whether the place is known at all.
    pub prior: Option<Isometry3<f32>>,
    /// Whether z is up in both frames, so that they differ by yaw and shift alone.
    pub gravity_aligned: bool,
}

impl<'a> Query<'a> {
    /// A gravity-aligned graph about which nothing else is known.
    #[must_use]
    pub fn new(graph: &'a SceneGraph) -> Self {
        Self { graph, looked: None, prior: None, gravity_aligned: true }
    }
}

/// How graphs are aligned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Algorithm {
    /// Search, verification, margin, refusal; see [`robust`](crate::robust).
    #[default]
    Robust,
    /// Algorithm 1 of the MA3DSG paper with its update rules; see [`paper`](crate::paper).
    Paper,
    /// No alignment: every query node is new. The floor that every alignment has to beat.
    Append,
}

/// Parameters of [`align`] and [`update`](crate::update).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Params {
    /// Which algorithm.
    pub algorithm: Algorithm,
    /// Thresholds of the robust algorithm.
    pub robust: RobustParams,
    /// Thresholds and readings of the paper's algorithm.
    pub paper: PaperParams,
    /// Seed of the paper's anchors; the robust algorithm draws nothing.
    pub seed: u64,
    /// All frames are one up to drift, of at most so many radians, and metres at any object: frames that a
    /// [`Replica::fold`](crate::Replica::fold) finds farther off are refused, and those in which nothing common was
    /// found are laid together as they are.
    pub near: Option<[f32; 2]>,
}

/// What became of one query node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The same object at the same place as this reference node.
    Same(NodeId),
    /// The same place, another class.
    Relabelled(NodeId),
    /// The same object at another place.
    Moved(NodeId),
    /// Not in the reference.
    New,
}

/// A place was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Match {
    /// Query points to the reference frame.
    pub reference_from_query: Isometry3<f32>,
    /// Nodes that correspond (query, reference), sorted, one-to-one.
    pub pairs: Vec<(NodeId, NodeId)>,
    /// What this alignment is worth; for the paper's algorithm the number of mapped nodes.
    pub score: f32,
    /// By how much `score` exceeds that of the best distinct alternative; `None` where the algorithm
    /// looks for none.
    pub margin: Option<f32>,
    /// What became of every query node.
    pub verdicts: BTreeMap<NodeId, Verdict>,
    /// Reference nodes that are gone: the query's robot looked through their place.
    pub removed: Vec<NodeId>,
    /// Structure without a counterpart at places that the query's robot looked at: walls do not vanish,
    /// but a node that nobody sees again may never have been one.
    pub unmet: Vec<NodeId>,
}

/// Why no place was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Why {
    /// The query has too few nodes to be searched for.
    SmallQuery,
    /// One of the graphs is empty.
    Empty,
    /// No candidate had enough support.
    NoSupport,
    /// The work budget ran out before a candidate had enough support.
    Budget,
    /// The query's mirror image fits better than the query.
    Mirrored,
    /// What both graphs hold leaves the place open: it can slide or turn and fits as well.
    Loose,
    /// The algorithm does not search.
    NotSearched,
}

impl Why {
    /// One word for files and tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::SmallQuery => "small-query",
            Self::Empty => "empty",
            Self::NoSupport => "no-support",
            Self::Budget => "budget",
            Self::Mirrored => "mirrored",
            Self::Loose => "loose",
            Self::NotSearched => "not-searched",
        }
    }
}

/// The answer of [`align`].
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// One place.
    Match(Match),
    /// Several places are equally good.
    Ambiguous {
        /// Every one of them.
        candidates: Vec<Match>,
    },
    /// No place.
    NoMatch {
        /// The reason.
        why: Why,
    },
}

/// Finds where `query` lies in `reference`. Pure: equal arguments give equal answers, whatever the
/// ids and the order of nodes and edges.
#[must_use]
pub fn align(reference: &SceneGraph, query: &Query<'_>, params: &Params) -> Outcome {
    let index = match params.algorithm {
        Algorithm::Robust if !query.graph.is_empty() => Index::of(reference, &params.robust),
        _ => Index::default(),
    };
    align_indexed(reference, &index, query, params)
}

/// As [`align`], with an [`Index`] of the reference that was made before or kept beside it; the
/// other algorithms do not look at it.
#[must_use]
pub fn align_indexed(reference: &SceneGraph, index: &Index, query: &Query<'_>, params: &Params) -> Outcome {
    if reference.is_empty() || query.graph.is_empty() {
        return Outcome::NoMatch { why: Why::Empty };
    }
    match params.algorithm {
        Algorithm::Robust => robust::align(index, query, &params.robust),
        Algorithm::Paper => paper::align(reference, query, &params.paper, params.seed),
        Algorithm::Append => Outcome::NoMatch { why: Why::NotSearched },
    }
}
