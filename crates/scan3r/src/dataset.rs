//! The interface that recorded and generated data share.

use crate::{Error, Frame, RoomEntry};
use nalgebra::Point3;
use std::collections::BTreeMap;

/// Frames of one pass through a scan, in order of their index.
pub type FrameStream<'a> = Box<dyn Iterator<Item = Result<Frame, Error>> + Send + 'a>;

/// The annotated surface of one scan: labelled points in the scan's own frame (z up, metres).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Annotation {
    /// Vertices of the annotated mesh.
    pub points: Vec<Point3<f32>>,
    /// Instance id per vertex; 0 = not annotated.
    pub instances: Vec<u32>,
    /// Raw 3RScan label per instance id. An instance may be listed without any vertex.
    pub labels: BTreeMap<u32, String>,
}

/// A directed relation between two instances of one scan.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Relation {
    /// Instance that the sentence is about: "`subject` standing on `object`".
    pub subject: u32,
    /// Instance that it relates to.
    pub object: u32,
    /// One of the 26 predicate names of the 3DSSG subset.
    pub predicate: String,
}

/// Rooms, each with a reference scan and rescans, that can be visited.
///
/// A visit is one pass through one scan. Generated data has a camera path for every `visit`
/// number; recorded data holds one sequence per scan and ignores the number.
pub trait Dataset: Sync {
    /// `generated` or `3rscan`: what every printed result has to say.
    fn kind(&self) -> &'static str;

    /// True where every visit number has its own camera path.
    fn has_own_path_per_visit(&self) -> bool;

    /// The rooms, in the order of `3RScan.json`.
    fn rooms(&self) -> &[RoomEntry];

    /// The annotated surface of a scan, in the scan's own frame.
    ///
    /// # Errors
    /// Unknown scans and unreadable files.
    fn annotation(&self, scan: &str) -> Result<Annotation, Error>;

    /// All annotated relations of a scan.
    ///
    /// # Errors
    /// Unknown scans and unreadable files.
    fn relations(&self, scan: &str) -> Result<Vec<Relation>, Error>;

    /// How many frames a visit has, without reading or rendering them.
    ///
    /// # Errors
    /// Unknown scans and unreadable files.
    fn frame_count(&self, scan: &str, visit: u64) -> Result<u32, Error>;

    /// The frames of a visit, poses in the scan's own frame.
    ///
    /// # Errors
    /// Unknown scans and unreadable files; later errors come from the stream.
    fn frames(&self, scan: &str, visit: u64) -> Result<FrameStream<'_>, Error>;
}
