//! One robot: depth frames to a local 3D semantic scene graph.
//!
//! The only crate that knows segmentation, inference and graphs at once. The flow of a visit:
//! [`Robot::segment`] integrates frames, [`Robot::infer`] scores what changed, [`Robot::objects`]
//! joins segments to objects, looks at them again and joins pieces of walls, [`Robot::graph`] writes the scene
//! graph.
//! [`NodeSet`] is what lies between: one node per segment with its points and box, and the pairs of
//! neighbours; the trainer stores the same thing.
//!
//! ```no_run
//! use agent::{Robot, RobotParams};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let model = sgfn_infer::Model::from_safetensors(&std::fs::read("weights.safetensors")?)?;
//! let mut robot = Robot::new(&model, RobotParams::default())?;
//! for frame in scan3r::Recording::open("kitchen".as_ref(), None)?.into_frames() {
//!     robot.segment(&frame?);
//! }
//! robot.infer()?;
//! let (graph, _instances) = robot.graph(&mut graph_align::Vocabulary::default())?;
//! # let _ = graph;
//! # Ok(()) }
//! ```

mod fusion;
mod graph;
mod looked;
mod nodes;
mod objects;
mod parts;
mod robot;
mod walls;

pub use fusion::{Fused, Scores};
pub use graph::{GraphParams, build_graph};
pub use nodes::{NodeInput, NodeParams, NodeSet};
pub use objects::Objects;
pub use robot::{Robot, RobotParams, integrate};

/// Class output that means "outside the label set".
pub const NONE: &str = "none";
/// Predicate output that joins segments of one object.
pub const SAME_PART: &str = "same part";

/// What can go wrong for a robot.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Segmentation parameters out of range.
    #[error(transparent)]
    Segmentation(#[from] gsm::Error),
    /// Weights or network inputs that do not fit.
    #[error(transparent)]
    Inference(#[from] sgfn_infer::Error),
    /// Graphs that do not fit.
    #[error(transparent)]
    Graph(#[from] graph_align::Error),
    /// Weights that do not say what their outputs mean.
    #[error("weights: {0}")]
    Weights(String),
}
