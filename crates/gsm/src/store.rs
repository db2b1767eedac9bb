//! What persists between frames, and the context that one frame's stages share.

use crate::Params;
use crate::associate::Pose;
use crate::bricks::Bricks;
use crate::frame::Frame;
use crate::project::bits;
use crate::samples::Samples;
use crate::segments::Segments;
use crate::surfels::Surfels;

/// Surfels, the bricks that own them and the segments that list them.
#[derive(Debug)]
pub(crate) struct Store {
    pub(crate) surfels: Surfels,
    pub(crate) bricks: Bricks,
    pub(crate) segments: Segments,
}

/// The current frame: maps, pose, parameters, running number.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step<'a> {
    pub(crate) frame: &'a Frame,
    pub(crate) samples: &'a Samples,
    pub(crate) pose: &'a Pose,
    pub(crate) params: &'a Params,
    pub(crate) now: u32,
}

impl Store {
    /// Removes the surfels of a brick that are worn out, or unstable and not seen for long; returns their number.
    pub(crate) fn weed(&mut self, brick: usize, step: Step<'_>) -> u32 {
        let mut blocks = std::mem::take(&mut self.bricks.list[brick].blocks);
        let mut removed = 0;
        let mut empty = false;
        for block in &mut blocks {
            let suspects = block.used & self.surfels.suspects(block.first);
            for k in bits(suspects.into()) {
                let id = block.first + k as u32;
                if self.surfels.confidence(id) < 0.0 || self.surfels.timed_out(id, step) {
                    block.used &= !(1 << k);
                    self.segments.relabel(&mut self.surfels, id, 0);
                    self.surfels.remove(id);
                    removed += 1;
                }
            }
            empty |= block.used == 0;
        }
        if empty {
            self.surfels.recycle(&mut blocks);
        }
        self.bricks.list[brick].blocks = blocks;
        removed
    }
}
