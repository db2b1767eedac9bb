//! `3RScan.json`: which scans show the same room, and what moved between them.

use crate::Error;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Translations beyond this are taken for millimetres and refused, metres.
pub const MAX_TRANSLATION: f64 = 50.0;

/// 16 numbers of a rigid transform as the file stores them: column-major, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Transform16(pub [f64; 16]);

impl Transform16 {
    /// The transform that these numbers say.
    ///
    /// # Errors
    /// Numbers that are not finite, a translation of more than [`MAX_TRANSLATION`] metres, or a
    /// matrix that is no proper rotation (within 1 %).
    pub fn isometry(&self, path: &Path, field: &str) -> Result<Isometry3<f64>, Error> {
        let a = &self.0;
        if a.iter().any(|v| !v.is_finite()) {
            return Err(Error::format(path, field, "a number is not finite"));
        }
        if a[12..15].iter().any(|t| t.abs() > MAX_TRANSLATION) {
            return Err(Error::format(
                path,
                field,
                format!("translation {:?}, want metres below {MAX_TRANSLATION}", &a[12..15]),
            ));
        }
        let m = Matrix3::new(a[0], a[4], a[8], a[1], a[5], a[9], a[2], a[6], a[10]);
        if (m.transpose() * m - Matrix3::identity()).amax() > 1e-2 || m.determinant() < 0.0 {
            return Err(Error::format(path, field, "the upper 3x3 block is no rotation"));
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_eps(
            &m,
            1e-12,
            100,
            Rotation3::identity(),
        ));
        Ok(Isometry3::from_parts(Translation3::new(a[12], a[13], a[14]), rotation))
    }

    /// The 16 numbers of a transform.
    #[must_use]
    pub fn from_isometry(t: &Isometry3<f64>) -> Self {
        let m = t.to_homogeneous();
        let mut a = [0.0; 16];
        a.copy_from_slice(m.as_slice());
        Self(a)
    }
}

/// One room: its reference scan and its rescans.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomEntry {
    /// Id of the reference scan.
    pub reference: String,
    /// `train`, `validation` or `test`.
    #[serde(rename = "type")]
    pub split: String,
    /// Groups of interchangeable instances.
    #[serde(default)]
    pub ambiguity: Vec<Vec<AmbiguousPair>>,
    /// Rescans in the order of the file.
    #[serde(default)]
    pub scans: Vec<ScanEntry>,
}

/// One pair of a group of interchangeable instances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AmbiguousPair {
    /// Instance in the reference scan.
    pub instance_source: u32,
    /// Another that looks the same.
    pub instance_target: u32,
    /// Source to target, in the reference frame.
    pub transform: Transform16,
}

/// One rescan of a room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScanEntry {
    /// Id of this scan (the file calls it `reference`).
    #[serde(rename = "reference")]
    pub id: String,
    /// Rescan points to the frame of the reference scan; absent for hidden test rooms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transform: Option<Transform16>,
    /// What moved as a rigid body.
    #[serde(default)]
    pub rigid: RigidList,
    /// Instances of the reference that are gone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub removed: Option<Vec<u32>>,
    /// Instances that changed shape.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nonrigid: Option<Vec<u32>>,
}

/// `rigid` holds full moves, or ids alone for hidden test rooms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RigidList {
    /// With transforms.
    Moves(Vec<RigidMove>),
    /// Ids alone.
    Ids(Vec<u32>),
}

impl Default for RigidList {
    fn default() -> Self {
        Self::Moves(Vec::new())
    }
}

impl RigidList {
    /// The moves, empty where only ids are known.
    #[must_use]
    pub fn moves(&self) -> &[RigidMove] {
        match self {
            Self::Moves(m) => m,
            Self::Ids(_) => &[],
        }
    }
}

/// A rigid motion of one instance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RigidMove {
    /// Id in the reference scan.
    pub instance_reference: u32,
    /// Id in the rescan (always the same number).
    pub instance_rescan: u32,
    /// 0 none, 1 two-fold, 2 four-fold, 3 rotational, about the upright axis.
    pub symmetry: u8,
    /// The object in the reference scan to the object in the rescan's own frame.
    pub transform: Transform16,
}
