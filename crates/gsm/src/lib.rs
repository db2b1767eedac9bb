//! Incremental geometric segmentation of posed depth frames into surfels and segments.
//!
//! ```
//! use gsm::{DepthView, Intrinsics, Map, Params};
//! use nalgebra::Isometry3;
//!
//! # fn main() -> Result<(), gsm::Error> {
//! let mut map = Map::new(Params::default())?;
//! let intrinsics = Intrinsics::new(146.0, 146.0, 80.0, 60.0, 160, 120)?;
//! let wall = vec![2.0; 160 * 120]; // metres
//! for frame in 0..5 {
//!     let report = map.integrate(&DepthView {
//!         depth: &wall,
//!         intrinsics,
//!         world_from_camera: Isometry3::translation(0.01 * frame as f32, 0.0, 0.0),
//!         time: 0.2 * f64::from(frame),
//!     });
//!     assert_eq!(report.skipped, None);
//! }
//! let segment = map.segments().next().expect("the wall");
//! assert!(segment.surfels() > 10_000 && segment.plane().rms < 1e-3);
//! # Ok(()) }
//! ```
//!
//! The crate does no I/O, reads no clock and is deterministic: the same frames give the same map, bit for bit.

mod associate;
mod batch;
mod bricks;
mod budget;
mod camera;
mod components;
mod correct;
mod edges;
mod error;
mod event;
mod evict;
mod evict_bytes;
mod frame;
mod fuse;
mod gravity;
mod grow;
mod image;
mod lanes;
mod links;
mod map;
mod measure;
mod merge;
mod moments;
mod noise;
mod normals;
mod params;
mod predict;
mod project;
mod samples;
mod segment;
mod segments;
mod shrink;
mod sight;
mod split;
mod store;
mod surfels;
mod track;
mod visibility;
mod vote;

pub use budget::Budget;
pub use camera::{DepthView, Intrinsics, MAX_SIDE};
pub use correct::Corrected;
pub use error::Error;
pub use event::{Counts, FrameReport, SegmentEvent, SegmentId, Skip};
pub use evict::Evicted;
pub use gravity::{estimate_up, estimate_up_near};
pub use map::{Map, Stage};
pub use measure::{Measured, NoiseMeter};
pub use moments::{Moments, UNIT};
pub use noise::{NoiseModel, Profile};
pub use params::Params;
pub use segment::{Aabb, Plane, Segment, Surfel, UprightBox};
pub use track::Tracking;
pub use visibility::{Cell, Looked, Tally, Visibility};
