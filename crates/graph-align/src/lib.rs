//! Training-free alignment and merge of 3D semantic scene graphs.
//!
//! A *scene graph* has objects as nodes (class, centroid, box) and directed predicates as edges.
//! [`align`] finds where a *query* graph lies in a *reference* graph and says what became of each
//! query node; [`update`] applies that answer; [`Replica`] folds the observations of many robots so
//! that every robot ends with the same graph, in whatever order they arrive.
//!
//! ```
//! use graph_align::{align, update, Box3, Node, NodeId, Outcome, Params, Query, SceneGraph, Vocabulary};
//!
//! let mut vocabulary = Vocabulary::default();
//! let chair = vocabulary.label("chair")?;
//! let mut map = SceneGraph::default();
//! map.insert_node(Node::new(NodeId(7), chair, Box3::new([1.0, 2.0, 0.4], [0.5, 0.5, 0.9])?));
//! let seen = map.clone();
//!
//! let outcome = align(&map, &Query::new(&seen), &Params::default());
//! let merged = update(&map, &Query::new(&seen), &outcome, &Params::default());
//! // One chair is too little to be sure of the place: it is appended.
//! assert!(matches!(outcome, Outcome::NoMatch { .. }));
//! assert_eq!(merged.nodes().count(), 2);
//! # Ok::<(), graph_align::Error>(())
//! ```
//!
//! The crate does no I/O, reads no clock and starts no thread. Lengths are metres, times seconds,
//! frames right-handed with z up.

mod align;
mod box3;
mod error;
mod fit;
mod footprint;
mod graph;
mod joint;
#[cfg(feature = "json")]
pub mod json;
mod looked;
pub mod paper;
mod replica;
pub mod robust;
mod seen;
mod sightings;
mod update;
mod vocabulary;
#[cfg(feature = "wire")]
pub mod wire;

pub use align::{Algorithm, Match, Outcome, Params, Query, Verdict, Why, align, align_indexed};
pub use box3::Box3;
pub use error::Error;
pub use footprint::Footprint;
pub use graph::{Edge, Node, NodeId, Others, SceneGraph};
pub use looked::Looked;
pub use paper::PaperParams;
pub use replica::{
    Beyond, Component, Folded, Key, Observation, Replica, Retraction, Snapshot, VersionVector,
};
pub use robust::{Index, RobustParams};
pub use update::{append, update};
pub use vocabulary::{LabelId, PredicateId, Vocabulary};
