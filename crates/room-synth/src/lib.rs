//! Generated furnished rooms, rescans, camera paths and depth frames in 3RScan's form.
//!
//! A [`World`] is a [`scan3r::Dataset`] that exists in memory: rooms are furnished when it is made,
//! depth images are rendered when they are asked for. Equal seeds give equal bytes, whatever the
//! number of threads.
//!
//! ```
//! use room_synth::{Split, World, WorldParams};
//! use scan3r::Dataset;
//!
//! let world = World::new(Split::Train, 7, 2, &WorldParams::default());
//! let room = &world.rooms()[0];
//! let annotation = world.annotation(&room.reference)?;
//! assert!(annotation.labels.values().any(|l| l == "floor"));
//! let frame = world.frames(&room.reference, 0)?.next().expect("a visit has frames")?;
//! assert_eq!(frame.depth.len(), 224 * 172);
//! # Ok::<(), scan3r::Error>(())
//! ```
//!
//! In the order of the data: `plan` and `openings` are the bare room, [`shapes`] and `catalogue`
//! what can stand in it, `recipes`, `builder` and `layout` the furnished room, `rescan` what
//! changes, `relations` and `surface` the annotation, `path`, `render` and `sensor` the frames.

mod builder;
mod catalogue;
mod layout;
mod mesh;
mod openings;
mod path;
mod plan;
mod real;
mod recipes;
mod relations;
mod render;
mod rescan;
mod rng;
mod room;
mod sensor;
pub mod shapes;
mod space;
mod split;
pub mod stats;
mod surface;
pub mod tree;
mod world;

pub use mesh::Mesh;
pub use relations::Contact;
pub use room::{Geometry, Instance, OrientedBox, Room, Scan, Support};
pub use sensor::SensorParams;
pub use split::{SLOTS, Split};
pub use surface::SPACING;
pub use world::{LabelledFrames, PHONE, World, WorldParams};
