//! `_info.txt`: the calibration of a 3RScan sequence.

use crate::{Error, Intrinsics};
use std::path::Path;

/// What a sequence says about itself.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceInfo {
    /// Depth camera.
    pub depth: Intrinsics,
    /// Samples per metre (`m_depthShift`).
    pub per_metre: f32,
    /// `m_frames.size`, where the file has it.
    pub frames: Option<u32>,
}

impl SequenceInfo {
    /// Reads the text.
    ///
    /// # Errors
    /// A missing or malformed field, named.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let field = |name: &str| {
            text.lines()
                .filter_map(|l| l.split_once('='))
                .find(|(k, _)| k.trim() == name)
                .map(|(_, v)| v.trim())
                .ok_or_else(|| Error::format(path, name, "is missing"))
        };
        let bad = |name: &str, v: &str| Error::format(path, name, format!("{v:?} is no number in range"));
        let int = |name: &str| field(name).and_then(|v| v.parse::<u32>().map_err(|_| bad(name, v)));
        let shift = field("m_depthShift")?;
        let per_metre = shift
            .parse::<f32>()
            .ok()
            .filter(|s| s.is_finite() && *s > 0.0)
            .ok_or_else(|| bad("m_depthShift", shift))?;
        let name = "m_calibrationDepthIntrinsic";
        let text = field(name)?;
        let k: Vec<f32> = text.split_whitespace().filter_map(|t| t.parse().ok()).collect();
        if k.len() != 16 {
            return Err(Error::format(
                path,
                name,
                format!("{} numbers, want the 16 of a 4x4 matrix", k.len()),
            ));
        }
        let depth = Intrinsics::new(k[0], k[5], k[2], k[6], int("m_depthWidth")?, int("m_depthHeight")?)
            .map_err(|e| Error::format(path, name, e.to_string()))?;
        let frames = field("m_frames.size").ok().and_then(|v| v.parse().ok());
        Ok(Self { depth, per_metre, frames })
    }

    /// The text of a depth-only sequence; colour fields repeat 3RScan's usual calibration size.
    #[must_use]
    pub fn text(&self) -> String {
        let d = &self.depth;
        let matrix =
            |fx: f32, fy: f32, cx: f32, cy: f32| format!("{fx} 0 {cx} 0 0 {fy} {cy} 0 0 0 1 0 0 0 0 1");
        let identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
        let (sx, sy) = (960.0 / d.width as f32, 540.0 / d.height as f32);
        format!(
            "m_versionNumber = 4\nm_sensorName = generated\nm_colorWidth = 960\nm_colorHeight = 540\n\
             m_depthWidth = {}\nm_depthHeight = {}\nm_depthShift = {}\n\
             m_calibrationColorIntrinsic = {}\nm_calibrationColorExtrinsic = {identity}\n\
             m_calibrationDepthIntrinsic = {}\nm_calibrationDepthExtrinsic = {identity}\n\
             m_frames.size = {}\n",
            d.width,
            d.height,
            self.per_metre,
            matrix(d.fx * sx, d.fy * sy, d.cx * sx, d.cy * sy),
            matrix(d.fx, d.fy, d.cx, d.cy),
            self.frames.unwrap_or(0)
        )
    }
}
