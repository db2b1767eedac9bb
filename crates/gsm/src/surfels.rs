//! Storage of surfels: a hot array for projection and a cold one for bookkeeping, in blocks of neighbours.
//!
//! A block holds surfels of one brick only, so that visiting a brick streams through memory.

use crate::correct::Whole;
use crate::store::Step;

/// What projection and association read of one surfel: 32 bytes, world frame, metres.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Hot {
    pub(crate) position: [f32; 3],
    /// Radius of the disc, 0 = free entry, negative = to be removed at the next visit.
    pub(crate) radius: f32,
    pub(crate) normal: [f32; 3],
    /// Slot of the segment plus one, 0 = none.
    pub(crate) segment: u32,
}

/// The same of a block, field by field, so that it is projected as a whole.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(crate) struct HotBlock {
    pub(crate) position: [[f32; BLOCK]; 3],
    pub(crate) normal: [[f32; BLOCK]; 3],
    pub(crate) radius: [f32; BLOCK],
    pub(crate) segment: [u32; BLOCK],
    /// Sightings less contradictions.
    pub(crate) confidence: [f32; BLOCK],
    pub(crate) label_confidence: [i16; BLOCK],
    /// In use and not stable, a bit each.
    pub(crate) unstable: u16,
    /// Of a part that may be split off (its [tag](Cold::tag) is not 0).
    pub(crate) tagged: u16,
    /// The brick that owns the block.
    pub(crate) brick: u32,
}

impl HotBlock {
    #[inline]
    fn get(&self, k: usize) -> Hot {
        let ([px, py, pz], [nx, ny, nz]) = (&self.position, &self.normal);
        Hot {
            position: [px[k], py[k], pz[k]],
            radius: self.radius[k],
            normal: [nx[k], ny[k], nz[k]],
            segment: self.segment[k],
        }
    }

    #[inline]
    fn set(&mut self, k: usize, hot: &Hot) {
        for a in 0..3 {
            (self.position[a][k], self.normal[a][k]) = (hot.position[a], hot.normal[a]);
        }
        (self.radius[k], self.segment[k]) = (hot.radius, hot.segment);
    }
}

/// The rest: 28 bytes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cold {
    /// Frame of the last sighting as long as it was unstable.
    pub(crate) seen: u32,
    /// Position as counted in the segment's moments, 0.1 mm about the map's origin.
    pub(crate) counted: [i32; 3],
    /// Place in the segment's member list.
    pub(crate) place: u32,
    /// Tag of a part that may be split off, 0 = none.
    pub(crate) tag: u32,
    /// Number of the frame that made it.
    pub(crate) made: u32,
}

impl Cold {
    /// Not seen for long; of unstable ones only.
    #[inline]
    pub(crate) fn timed_out(&self, step: Step<'_>) -> bool {
        step.now.saturating_sub(self.seen) > step.params.unstable_frames
    }
}

/// Entries per block.
pub(crate) const BLOCK: usize = 16;
/// A number for each of them.
pub(crate) type Column = [f32; BLOCK];

/// A block of a brick: its first entry and a bit per entry in use.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    pub(crate) first: u32,
    pub(crate) used: u16,
}

#[derive(Debug, Default)]
pub(crate) struct Surfels {
    /// Of 16 surfels each.
    pub(crate) hot: Vec<HotBlock>,
    pub(crate) cold: Vec<Cold>,
    free_blocks: Vec<u32>,
    live: usize,
}

impl Surfels {
    /// Number of live surfels.
    pub(crate) fn len(&self) -> usize {
        self.live
    }

    /// Stores a new, unstable surfel in a free entry of a brick's blocks, adding a block when they are full and there is room for
    /// one below `limit` entries.
    pub(crate) fn insert(
        &mut self,
        brick: u32,
        blocks: &mut Vec<Block>,
        hot: Hot,
        now: u32,
        limit: u32,
    ) -> Option<u32> {
        let place = match blocks.iter().rposition(|b| b.used != u16::MAX) {
            Some(place) => place,
            None => {
                let first = self.new_block(limit)?;
                self.hot[first as usize / BLOCK].brick = brick;
                blocks.push(Block { first, used: 0 });
                blocks.len() - 1
            }
        };
        let block = &mut blocks[place];
        let bit = block.used.trailing_ones();
        block.used |= 1 << bit;
        let id = block.first + bit;
        self.set_hot(id, &hot);
        self.cold[id as usize] = Cold { seen: now, made: now, ..Cold::default() };
        let (block, k) = self.place(id);
        block.unstable |= 1 << k;
        (block.confidence[k], block.label_confidence[k]) = (1.0, 0);
        self.live += 1;
        Some(id)
    }

    fn new_block(&mut self, limit: u32) -> Option<u32> {
        if let Some(first) = self.free_blocks.pop() {
            return Some(first);
        }
        let first = self.cold.len();
        if first + BLOCK > limit as usize {
            return None;
        }
        if self.hot.len() == self.hot.capacity() {
            // A quarter more instead of doubling keeps the slack, and with it the bytes per surfel, small.
            let more = (self.hot.len() / 4).max(256);
            self.hot.reserve_exact(more);
            self.cold.reserve_exact(more * BLOCK);
        }
        self.hot.push(HotBlock::default());
        self.cold.resize(first + BLOCK, Cold::default());
        Some(first as u32)
    }

    /// Frees the entry; the caller clears its bit, and hands empty blocks to [`recycle`](Self::recycle).
    pub(crate) fn remove(&mut self, id: u32) {
        self.set_hot(id, &Hot::default());
        self.cold[id as usize] = Cold::default();
        let (block, k) = self.place(id);
        block.unstable &= !(1 << k);
        block.tagged &= !(1 << k);
        self.live -= 1;
    }

    /// Block and entry of a surfel.
    #[inline]
    fn place(&mut self, id: u32) -> (&mut HotBlock, usize) {
        (&mut self.hot[id as usize / BLOCK], id as usize % BLOCK)
    }

    #[inline]
    pub(crate) fn is_tagged(&self, id: u32) -> bool {
        self.hot[id as usize / BLOCK].tagged >> (id as usize % BLOCK) & 1 == 1
    }

    /// The tagged entries of the block that starts at an entry.
    pub(crate) fn tagged(&self, first: u32) -> u16 {
        self.hot[first as usize / BLOCK].tagged
    }

    /// Sets the tag of a part that may be split off, 0 = none.
    pub(crate) fn set_tag(&mut self, id: u32, tag: u32) {
        self.cold[id as usize].tag = tag;
        let (block, k) = self.place(id);
        block.tagged = block.tagged & !(1 << k) | u16::from(tag != 0) << k;
    }

    /// Seen often enough to count; of live surfels only.
    #[inline]
    pub(crate) fn is_stable(&self, id: u32) -> bool {
        self.hot[id as usize / BLOCK].unstable >> (id as usize % BLOCK) & 1 == 0
    }

    #[inline]
    pub(crate) fn confidence(&self, id: u32) -> f32 {
        self.hot[id as usize / BLOCK].confidence[id as usize % BLOCK]
    }

    #[inline]
    pub(crate) fn label_confidence(&mut self, id: u32) -> &mut i16 {
        let (block, k) = self.place(id);
        &mut block.label_confidence[k]
    }

    /// Unstable or worn out entries of the block that starts at an entry.
    pub(crate) fn suspects(&self, first: u32) -> u16 {
        let block = &self.hot[first as usize / BLOCK];
        let worn = (0..BLOCK).fold(0, |m, k| m | u16::from(block.confidence[k] < 0.0) << k);
        block.unstable | worn
    }

    /// Brick of a surfel.
    pub(crate) fn brick(&self, id: u32) -> u32 {
        self.hot[id as usize / BLOCK].brick
    }

    /// Gives blocks to another brick.
    pub(crate) fn adopt(&mut self, blocks: &[Block], brick: u32) {
        blocks.iter().for_each(|b| self.hot[b.first as usize / BLOCK].brick = brick);
    }

    /// All that is known of a surfel.
    pub(crate) fn whole(&self, id: u32) -> Whole {
        let label_confidence = self.hot[id as usize / BLOCK].label_confidence[id as usize % BLOCK];
        Whole {
            hot: self.hot(id),
            cold: self.cold[id as usize],
            confidence: self.confidence(id),
            label_confidence,
            stable: self.is_stable(id),
        }
    }

    /// Gives a new surfel the history of another one; label and position are left alone.
    pub(crate) fn recall(&mut self, id: u32, whole: &Whole) {
        let cold = &mut self.cold[id as usize];
        (cold.seen, cold.made) = (whole.cold.seen, whole.cold.made);
        let (block, k) = self.place(id);
        (block.confidence[k], block.label_confidence[k]) = (whole.confidence, whole.label_confidence);
        if whole.stable {
            block.unstable &= !(1 << k);
        }
    }

    /// Unstable and not seen for long.
    pub(crate) fn timed_out(&self, id: u32, step: Step<'_>) -> bool {
        !self.is_stable(id) && self.cold[id as usize].timed_out(step)
    }

    /// Takes the empty blocks out of a brick.
    pub(crate) fn recycle(&mut self, blocks: &mut Vec<Block>) {
        blocks.retain(|b| {
            if b.used == 0 {
                self.free_blocks.push(b.first);
            }
            b.used != 0
        });
    }

    pub(crate) fn is_live(&self, id: u32) -> bool {
        self.radius(id) > 0.0
    }

    #[inline]
    pub(crate) fn hot(&self, id: u32) -> Hot {
        self.hot[id as usize / BLOCK].get(id as usize % BLOCK)
    }

    #[inline]
    pub(crate) fn set_hot(&mut self, id: u32, hot: &Hot) {
        self.hot[id as usize / BLOCK].set(id as usize % BLOCK, hot);
    }

    #[inline]
    pub(crate) fn position(&self, id: u32) -> [f32; 3] {
        self.hot[id as usize / BLOCK].position.each_ref().map(|v| v[id as usize % BLOCK])
    }

    #[inline]
    pub(crate) fn radius(&self, id: u32) -> f32 {
        self.hot[id as usize / BLOCK].radius[id as usize % BLOCK]
    }

    #[inline]
    pub(crate) fn segment(&self, id: u32) -> u32 {
        self.hot[id as usize / BLOCK].segment[id as usize % BLOCK]
    }

    #[inline]
    pub(crate) fn segment_mut(&mut self, id: u32) -> &mut u32 {
        &mut self.hot[id as usize / BLOCK].segment[id as usize % BLOCK]
    }

    /// Marks a surfel for removal at the next visit of its brick.
    pub(crate) fn doom(&mut self, id: u32) {
        let (block, k) = self.place(id);
        block.confidence[k] = -1.0;
        block.radius[k] *= -1.0;
    }

    /// Entries, in use or not.
    pub(crate) fn entries(&self) -> u32 {
        self.cold.len() as u32
    }

    /// Bytes held, slack included.
    pub(crate) fn bytes(&self) -> usize {
        self.hot.capacity() * size_of::<HotBlock>()
            + self.cold.capacity() * size_of::<Cold>()
            + self.free_blocks.capacity() * 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::project::bits;

    #[test]
    fn blocks_are_filled_emptied_and_used_again() {
        let (mut s, mut blocks) = (Surfels::default(), Vec::new());
        let hot = Hot { radius: 0.01, ..Hot::default() };
        let ids: Vec<u32> = (0..40).map(|_| s.insert(7, &mut blocks, hot, 1, 48).unwrap()).collect();
        assert_eq!((s.len(), blocks.len()), (40, 3));
        for _ in 0..8 {
            assert!(s.insert(7, &mut blocks, hot, 1, 48).is_some());
        }
        assert_eq!(s.insert(7, &mut blocks, hot, 1, 48), None);
        assert_eq!(
            blocks
                .iter()
                .flat_map(|b| bits(b.used.into()).map(|k| b.first + k as u32))
                .take(40)
                .collect::<Vec<_>>(),
            ids
        );
        for b in &mut blocks {
            bits(b.used.into()).for_each(|k| s.remove(b.first + k as u32));
            b.used = 0;
        }
        s.recycle(&mut blocks);
        assert!(blocks.is_empty() && s.len() == 0 && !s.is_live(0));
        assert!(s.insert(7, &mut blocks, hot, 1, 48).is_some());
    }
}
