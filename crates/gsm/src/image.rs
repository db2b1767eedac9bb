//! What one depth image says by itself, before any map is asked.

use crate::event::Skip;
use crate::frame::Frame;
use crate::samples::Samples;
use crate::{DepthView, Params, Stage};

/// Workspace of the image side of a frame: a function of the image and the parameters, unless the map's prediction
/// steadies it in between.
#[derive(Debug, Default)]
pub(crate) struct Image {
    pub(crate) frame: Frame,
    pub(crate) samples: Samples,
}

impl Image {
    /// Depth at working resolution; why the image cannot be used, if so.
    pub(crate) fn read(&mut self, view: &DepthView<'_>, params: &Params) -> Option<Skip> {
        let refused = unusable(view);
        if refused.is_some() {
            return refused;
        }
        self.frame.shrink(view, params);
        if let Some(camera) = &self.frame.camera {
            self.samples.fit(camera, params);
        }
        (self.frame.valid < 10).then_some(Skip::NoDepth)
    }

    /// One region per smooth surface, and what the map learns of them.
    pub(crate) fn segment(&mut self, params: &Params, done: &mut impl FnMut(Stage)) {
        self.frame.segment(params, self.samples.pitch, done);
        self.samples.take(&self.frame, params);
        done(Stage::Samples);
    }
}

/// Why a frame cannot be used, if so.
fn unusable(view: &DepthView<'_>) -> Option<Skip> {
    let pixels = view.intrinsics.width() as usize * view.intrinsics.height() as usize;
    if view.depth.len() != pixels {
        return Some(Skip::WrongSize);
    }
    let q = view.world_from_camera.rotation.coords;
    let t = view.world_from_camera.translation.vector;
    let rotation = (q.norm() - 1.0).abs() < 1e-2;
    let near = t.iter().all(|v| v.abs() < 1e5);
    (!(rotation && near)).then_some(Skip::InvalidPose)
}
