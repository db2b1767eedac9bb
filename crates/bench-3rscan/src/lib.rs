//! MA3DSG-Bench: scenarios, metrics and reports over 3RScan and generated rooms.
//!
//! The flow: [`scenario`] deals rooms to agents, [`layout`] places rooms in one domain frame, the
//! visits' frames are counted on the annotated [`surface`]s, [`truth`] says what the merged graph
//! should be, [`correspond`] and [`rates`] measure a graph against it, [`report`] and [`render`]
//! write the result. With the feature `systems` (default) the crate also runs the compared
//! [`systems`]; without it, it is the scenario builder and the metrics alone.

pub mod correspond;
mod error;
pub mod layout;
pub mod rates;
#[cfg(feature = "systems")]
pub mod render;
#[cfg(feature = "systems")]
pub mod report;
#[cfg(feature = "systems")]
pub mod run;
#[cfg(feature = "systems")]
pub mod samples;
pub mod scenario;
pub mod seeds;
pub mod surface;
#[cfg(feature = "systems")]
pub mod systems;
pub mod truth;

pub use error::Error;
pub use surface::{Seen, Surface};
