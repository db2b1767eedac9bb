//! `semseg.v2.json`: the instances of a scan with their raw labels.

use serde::{Deserialize, Serialize};

/// The file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Semseg {
    /// Scan id.
    pub scan_id: String,
    /// One entry per instance.
    #[serde(rename = "segGroups")]
    pub groups: Vec<SegGroup>,
}

/// One instance. It may have no vertex in the mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SegGroup {
    /// Instance id.
    #[serde(rename = "objectId")]
    pub object_id: u32,
    /// The same number.
    #[serde(default)]
    pub id: u32,
    /// Raw label, one of 528.
    pub label: String,
    /// Ids of the over-segmentation that belong to it.
    #[serde(default)]
    pub segments: Vec<u32>,
    /// Oriented box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obb: Option<Obb>,
}

/// Oriented box: axis k = `normalized_axes[3k..3k + 3]`, full side lengths, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Obb {
    /// Centre.
    pub centroid: [f64; 3],
    /// Full side lengths.
    #[serde(rename = "axesLengths")]
    pub axes_lengths: [f64; 3],
    /// Three unit vectors.
    #[serde(rename = "normalizedAxes")]
    pub normalized_axes: [f64; 9],
}
