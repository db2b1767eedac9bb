//! The MA3DSG paper's Algorithm 1 and its update rules.
//!
//! The pseudo-code leaves much open (it never sets the anchor's image, its map is not injective and
//! not reset, labels alone are compared, it knows no transform). Every gap is a field of
//! [`PaperParams`]: the defaults read it as its text intends, [`PaperParams::literal`] as printed,
//! and any other reading can be measured.

mod rules;
mod search;

use crate::{Match, Outcome, Query, SceneGraph, Verdict, Why, fit};
use nalgebra::Isometry3;

pub use rules::verdicts;

/// Thresholds and readings. The thresholds' defaults are the paper's.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperParams {
    /// Largest distance of centroids of one object, metres (theta_dis).
    pub theta_dis: f32,
    /// A map of more than this many nodes means aligned (theta_len).
    pub theta_len: usize,
    /// Smallest IoU of the boxes of one object, exclusive (theta_bbox).
    pub theta_bbox: f32,
    /// Queries of at most this many nodes are appended without a search.
    pub small_query: usize,
    /// A neighbour pair extends the map only when predicate and direction agree too.
    pub compare_predicates: bool,
    /// A reference node is used once.
    pub injective: bool,
    /// Each candidate of each anchor starts with an empty map and an empty visit set.
    pub reset: bool,
    /// A query node keeps the first image that fits; otherwise it is overwritten by every later one,
    /// as printed, while its descendants stem from the first.
    pub first_image: bool,
    /// The visit set is copied for every call instead of shared: exponential, bounded by `budget`.
    pub visit_per_call: bool,
    /// How the transform arises, of which the paper says nothing.
    pub transform: TransformReading,
    /// What a query node is that is near a reference node with too little overlap.
    pub near_low_iou: NearReading,
    /// Pairs of neighbours that may be looked at before the search gives up.
    pub budget: u64,
}

/// How the paper's algorithm gets a transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransformReading {
    /// The frames are one (or related by the prior): what the update's distances presuppose.
    Shared,
    /// A least-squares fit on the mapped nodes: yaw and shift where gravity is known.
    FitMap,
}

/// What to do with a node that is near (distance below theta_dis) but overlaps too little: the rule
/// that the paper does not state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NearReading {
    /// A new object.
    New,
    /// The same object, if the label agrees.
    Same,
}

impl Default for PaperParams {
    fn default() -> Self {
        Self {
            theta_dis: 1.5,
            theta_len: 3,
            theta_bbox: 0.4,
            small_query: 6,
            compare_predicates: true,
            injective: true,
            reset: true,
            first_image: true,
            visit_per_call: false,
            transform: TransformReading::Shared,
            near_low_iou: NearReading::New,
            budget: 5_000_000,
        }
    }
}

impl PaperParams {
    /// The pseudo-code as printed: labels alone, maps that pile up and overwrite.
    #[must_use]
    pub fn literal() -> Self {
        Self {
            compare_predicates: false,
            injective: false,
            reset: false,
            first_image: false,
            ..Self::default()
        }
    }

    /// A reading by name: `default`, `literal`, `labels` (predicates ignored), `per-call` (visit set
    /// copied), `fit` (transform fitted on the map), `near-same`.
    #[must_use]
    pub fn reading(name: &str) -> Option<Self> {
        let d = Self::default();
        Some(match name {
            "default" => d,
            "literal" => Self::literal(),
            "labels" => Self { compare_predicates: false, ..d },
            "per-call" => Self { visit_per_call: true, ..d },
            "fit" => Self { transform: TransformReading::FitMap, ..d },
            "near-same" => Self { near_low_iou: NearReading::Same, ..d },
            _ => return None,
        })
    }

    /// The names that [`Self::reading`] knows.
    pub const READINGS: [&'static str; 6] = ["default", "literal", "labels", "per-call", "fit", "near-same"];
}

/// SCENEGRAPHUPDATE without its side effects: the gate, then the rules for every query node.
pub(crate) fn align(reference: &SceneGraph, query: &Query<'_>, params: &PaperParams, seed: u64) -> Outcome {
    if query.graph.len() <= params.small_query {
        return Outcome::NoMatch { why: Why::SmallQuery };
    }
    let found = search::search(reference, query.graph, params, seed);
    if found.map.len() <= params.theta_len {
        let why = if found.out_of_budget { Why::Budget } else { Why::NoSupport };
        return Outcome::NoMatch { why };
    }
    let t = match params.transform {
        TransformReading::Shared => query.prior.unwrap_or_else(Isometry3::identity),
        TransformReading::FitMap => fit_map(reference, query, &found.map),
    };
    let verdicts = verdicts(reference, query.graph, &t, params);
    let pairs = verdicts
        .iter()
        .filter_map(|(&q, v)| match *v {
            Verdict::Same(r) | Verdict::Relabelled(r) | Verdict::Moved(r) => Some((q, r)),
            Verdict::New => None,
        })
        .collect();
    Outcome::Match(Match {
        reference_from_query: t,
        pairs,
        score: found.map.len() as f32,
        margin: None,
        verdicts,
        removed: Vec::new(),
        unmet: Vec::new(),
    })
}

/// Least squares on the centroids of mapped nodes.
fn fit_map(reference: &SceneGraph, query: &Query<'_>, map: &search::NodeMap) -> Isometry3<f32> {
    let points: Vec<_> = map
        .iter()
        .filter_map(|(&q, &r)| {
            let (q, r) = (query.graph.node(q)?, reference.node(r)?);
            Some((q.bounds.centroid(), r.bounds.centroid(), 1.0))
        })
        .collect();
    fit::rigid(&points, query.gravity_aligned)
}
