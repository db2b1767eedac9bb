//! Reader and writer of 3RScan / 3DSSG, 7-Scenes and TUM RGB-D recordings.
//!
//! Everything that a file format twists (millimetres, column-major matrices, big-endian samples,
//! invalid poses, ids stored as text) is straightened here, once: what leaves this crate is in
//! metres, right-handed, with poses that map camera points into the world, or it is an [`Error`]
//! that names the file and the field.
//!
//! The modules follow the data: [`frame`] is one depth image with its pose, [`rooms`] is
//! `3RScan.json`, [`dataset`] is the interface that recorded and generated data share, [`labels`]
//! maps raw labels to label sets.

pub mod dataset;
mod error;
pub mod frame;
pub mod labels;
pub mod rooms;

pub use dataset::{Annotation, Dataset, FrameStream, Relation};
pub use error::Error;
pub use frame::{Frame, Intrinsics};
pub use labels::LabelSet;
pub use rooms::{RigidList, RigidMove, RoomEntry, ScanEntry, Transform16};
