//! What persists between frames, and the context that one frame's stages share.

use crate::Params;
use crate::associate::Pose;
use crate::bricks::Bricks;
use crate::correct::Whole;
use crate::frame::Frame;
use crate::project::bits;
use crate::samples::Samples;
use crate::segments::Segments;
use crate::surfels::{BLOCK, Hot, Surfels};

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
    /// The surfels of a brick.
    pub(crate) fn members(&self, brick: usize) -> Vec<u32> {
        let blocks = &self.bricks.list[brick].blocks;
        blocks.iter().flat_map(|b| bits(b.used.into()).map(|k| b.first + k as u32)).collect()
    }

    /// Removes a surfel and returns all that is known of it; its segment stays open, if empty.
    pub(crate) fn take_out(&mut self, id: u32) -> Whole {
        let whole = self.surfels.whole(id);
        let brick = self.surfels.brick(id) as usize;
        self.segments.relabel(&mut self.surfels, id, 0);
        self.surfels.remove(id);
        let blocks = &mut self.bricks.list[brick].blocks;
        if let Some(block) = blocks.iter_mut().find(|b| b.first == id & !(BLOCK as u32 - 1)) {
            block.used &= !(1 << (id - block.first));
        }
        self.surfels.recycle(blocks);
        whole
    }

    /// Stores a surfel with its history, in the segment (slot plus one) that it names; false when there is no room.
    pub(crate) fn put_in(&mut self, whole: &Whole, limit: u32) -> bool {
        let Some(brick) = self.bricks.key(whole.hot.position).and_then(|k| self.bricks.find_or_make(k))
        else {
            return false;
        };
        let blocks = &mut self.bricks.list[brick].blocks;
        let hot = Hot { segment: 0, ..whole.hot };
        let Some(id) = self.surfels.insert(brick as u32, blocks, hot, whole.cold.seen, limit) else {
            return false;
        };
        self.surfels.recall(id, whole);
        self.segments.relabel(&mut self.surfels, id, whole.hot.segment);
        true
    }

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
