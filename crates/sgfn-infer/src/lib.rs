//! CPU inference of the SGFN scene graph network (SceneGraphFusion).
//!
//! Points per segment and pairs of neighbouring segments go in; class scores per segment and
//! predicate scores per pair come out. Both published code variants are computed exactly
//! ([`Variant`]), from weights in safetensors under the authors' tensor names. Products run on
//! [faer](https://docs.rs/faer); results do not depend on the number of threads.
//!
//! ```no_run
//! # fn main() -> Result<(), sgfn_infer::Error> {
//! use sgfn_infer::{Graph, Model, Segment};
//! let bytes = std::fs::read("weights.safetensors").expect("weights");
//! let model = Model::from_safetensors(&bytes)?;
//! let points = vec![0.0_f32; 256 * model.config().channels]; // xyz [+ rgb] [+ normal], metres
//! let a = Segment::new(&points, model.config().channels)?;
//! let b = a.clone();
//! let out = model.infer(&Graph { segments: &[a, b], edges: &[[0, 1], [1, 0]] })?;
//! println!("{:?}", out.class_probabilities().row(0));
//! # Ok(()) }
//! ```
//!
//! Modules in data-flow order: [`segment`] turns points into network input, `encode` holds the two
//! encoders, `fan` the attention layers, `model` loads the weights and runs all of it, [`golden`]
//! compares every intermediate with stored vectors.
//!
//! Source of the equations: Wu et al., "SceneGraphFusion", CVPR 2021, and the authors' code, which
//! binds where the two differ.

mod encode;
mod error;
mod fan;
pub mod golden;
mod linear;
mod model;
pub mod segment;
mod tensors;

pub use error::Error;
pub use linear::Matrix;
pub use model::{Config, EdgeScores, Features, Graph, Model, Output, Variant};
pub use segment::{Descriptor, MIN_EXTENT, Segment};
pub use tensors::Store;
