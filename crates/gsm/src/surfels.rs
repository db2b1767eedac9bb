//! Storage of surfels: a hot array for projection, a cold one for bookkeeping, and a free list.

/// What projection and association read: 32 bytes, world frame, metres.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Hot {
    pub(crate) position: [f32; 3],
    pub(crate) radius: f32,
    pub(crate) normal: [f32; 3],
    /// Slot of the segment plus one, 0 = none.
    pub(crate) segment: u32,
}

/// The rest: 32 bytes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cold {
    /// Sightings less contradictions; negative = free entry.
    pub(crate) confidence: f32,
    /// Frame of the last sighting.
    pub(crate) seen: u32,
    /// Position as counted in the segment's moments, 0.1 mm about the map's origin.
    pub(crate) counted: [i32; 3],
    /// Place in the segment's member list.
    pub(crate) place: u32,
    /// Tag of a part that may be split off, 0 = none.
    pub(crate) tag: u32,
    pub(crate) label_confidence: i16,
    pub(crate) stable: bool,
}

#[derive(Debug, Default)]
pub(crate) struct Surfels {
    pub(crate) hot: Vec<Hot>,
    pub(crate) cold: Vec<Cold>,
    free: Vec<u32>,
}

impl Surfels {
    /// Number of live surfels.
    pub(crate) fn len(&self) -> usize {
        self.hot.len() - self.free.len()
    }

    /// Stores a surfel in a free entry, or at the end while there are fewer than `limit`.
    pub(crate) fn insert(&mut self, hot: Hot, cold: Cold, limit: u32) -> Option<u32> {
        if let Some(id) = self.free.pop() {
            self.hot[id as usize] = hot;
            self.cold[id as usize] = cold;
            return Some(id);
        }
        if self.hot.len() >= limit as usize {
            return None;
        }
        if self.hot.len() == self.hot.capacity() {
            // A quarter more instead of doubling keeps the slack, and with it the bytes per surfel, small.
            let more = (self.hot.len() / 4).max(4096);
            self.hot.reserve_exact(more);
            self.cold.reserve_exact(more);
        }
        self.hot.push(hot);
        self.cold.push(cold);
        Some(self.hot.len() as u32 - 1)
    }

    pub(crate) fn remove(&mut self, id: u32) {
        self.cold[id as usize].confidence = -1.0;
        self.cold[id as usize].stable = false;
        self.hot[id as usize].segment = 0;
        self.free.push(id);
    }

    pub(crate) fn is_live(&self, id: usize) -> bool {
        self.cold[id].confidence >= 0.0
    }

    /// Bytes held, slack included.
    pub(crate) fn bytes(&self) -> usize {
        self.hot.capacity() * size_of::<Hot>()
            + self.cold.capacity() * size_of::<Cold>()
            + self.free.capacity() * 4
    }
}
