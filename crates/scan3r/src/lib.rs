//! Reader and writer of 3RScan / 3DSSG, 7-Scenes and TUM RGB-D recordings.
//!
//! Everything that a file format twists (millimetres, column-major matrices, big-endian samples,
//! invalid poses, ids stored as text) is straightened here, once: what leaves this crate is in
//! metres, right-handed, with poses that map camera points into the world, or it is an [`Error`]
//! that names the file and the field.
//!
//! ```no_run
//! # fn main() -> Result<(), scan3r::Error> {
//! use scan3r::Recording;
//! let recording = Recording::open("kitchen".as_ref(), None)?;
//! for frame in recording.into_frames() {
//!     let frame = frame?;
//!     println!("{} {:?}", frame.index, frame.world_from_camera);
//! }
//! # Ok(()) }
//! ```
//!
//! [`Recording`] is one sequence of any format; [`Folder`] is a whole 3RScan data set behind the
//! [`Dataset`] interface, which generated rooms implement too. The other modules hold one file
//! format each.

pub mod dataset;
pub mod depth_image;
mod error;
mod files;
pub mod folder;
pub mod frame;
pub mod info;
pub mod labels;
pub mod ply;
pub mod pose;
pub mod recording;
pub mod relationships;
pub mod rooms;
pub mod semseg;
pub mod sequence;

pub use dataset::{Annotation, Dataset, FrameStream, Relation};
pub use error::Error;
pub use folder::{Folder, write_dataset};
pub use frame::{Frame, Intrinsics};
pub use labels::LabelSet;
pub use recording::{Format, Recording};
pub use rooms::{RigidList, RigidMove, RoomEntry, ScanEntry, Transform16};
