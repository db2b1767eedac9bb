//! MA3DSG-Bench: scenarios, metrics and reports over 3RScan and generated rooms.
//!
//! The flow: [`scenario`] deals rooms to agents, [`layout`] places rooms in one domain frame, the
//! visits' frames are counted on the annotated [`surface`]s, [`truth`] says what the merged graph
//! should be, [`correspond`] and [`rates`] measure a graph against it, [`report`] and [`render`]
//! write the result. With the feature `systems` (default) the crate also runs the compared
//! [`systems`]; without it, it is the scenario builder and the metrics alone.
//!
//! ```
//! use bench_3rscan::{rates::Counts, scenario::shared_rooms};
//! // 47 rooms, five agents, a fifth of the visits to rooms that two of them see.
//! assert_eq!(shared_rooms(47, 5, 0.2), 5);
//! let r = Counts { tp: 3, fp: 1, fn_: 3 }.rates();
//! assert_eq!((r.r, r.p, r.f1), (Some(50.0), Some(75.0), Some(60.0)));
//! ```

pub mod changes;
pub mod correspond;
mod error;
pub mod flush;
pub mod layout;
pub mod parts;
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
