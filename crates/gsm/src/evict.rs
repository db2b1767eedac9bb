//! Bounded memory: what lies outside a box is taken out of the map, and put back when it is needed again.

use crate::Map;
use crate::bricks::Bricks;
use crate::correct::Whole;
use crate::event::SegmentId;
use nalgebra::Point3;

/// What was taken out of a map: surfels with their segments, and what was looked at. It belongs to that map alone.
#[derive(Debug, Clone, Default)]
pub struct Evicted {
    pub(crate) bricks: Vec<Part>,
}

/// One brick.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) key: [i32; 3],
    pub(crate) through: u8,
    pub(crate) surface: u8,
    /// With the id of the segment, 0 = none.
    pub(crate) surfels: Vec<(Whole, u32)>,
}

impl Evicted {
    /// Number of surfels.
    pub fn surfels(&self) -> usize {
        self.bricks.iter().map(|b| b.surfels.len()).sum()
    }

    /// Whether nothing was taken out.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }
}

impl Map {
    /// Takes out every brick that lies wholly outside the box (world frame, metres). Segments that lose all their
    /// surfels close without an event, as nothing was seen to vanish; [`restore`](Self::restore) opens them again
    /// under their ids.
    pub fn evict_outside(&mut self, low: Point3<f32>, high: Point3<f32>) -> Evicted {
        let side = self.store.bricks.side;
        let outside = |key: [i32; 3]| {
            (0..3).any(|a| (key[a] + 1) as f32 * side < low[a] || key[a] as f32 * side > high[a])
        };
        let mut out = Evicted::default();
        for n in 0..self.store.bricks.list.len() {
            let brick = &self.store.bricks.list[n];
            if !outside(brick.key) {
                continue;
            }
            let (key, through, surface) = (brick.key, brick.through, brick.surface);
            let mut part = Part { key, through, surface, surfels: Vec::new() };
            for id in self.store.members(n) {
                let segment = self.store.surfels.segment(id);
                let name = if segment == 0 { 0 } else { self.store.segments.id(segment - 1).0 };
                let live = self.store.surfels.is_live(id);
                let whole = self.store.take_out(id);
                if live {
                    part.surfels.push((whole, name));
                }
            }
            out.bricks.push(part);
        }
        self.store.segments.close_empty();
        self.merges.forget_closed(&self.store.segments);
        self.keep_bricks(|key| !outside(key));
        out
    }

    /// Puts back what [`evict_outside`](Self::evict_outside) took out; returns the number of surfels that found no
    /// room. What was seen of the place since is newer and stays. A segment that was merged away in the meantime
    /// lives on in the one that took it.
    pub fn restore(&mut self, evicted: Evicted) -> u32 {
        let mut lost = 0;
        for part in &evicted.bricks {
            let known = self.store.bricks.find(part.key).is_some();
            if let Some(n) = self.store.bricks.find_or_make(part.key).filter(|_| !known) {
                let brick = &mut self.store.bricks.list[n];
                (brick.through, brick.surface) = (part.through, part.surface);
            }
        }
        for part in evicted.bricks {
            for (mut whole, name) in part.surfels {
                whole.hot.segment =
                    if name == 0 { 0 } else { self.store.segments.reopen(SegmentId(name), self.now) + 1 };
                lost += u32::from(!self.store.put_in(&whole, self.params.max_surfels));
            }
        }
        self.store.segments.close_empty();
        lost
    }

    /// Drops the bricks that are not kept; they hold no surfels.
    fn keep_bricks(&mut self, keep: impl Fn([i32; 3]) -> bool) {
        let params = &self.params;
        let old = std::mem::replace(&mut self.store.bricks, Bricks::new(params.brick, params.max_bricks));
        for brick in old.list.into_iter().filter(|b| keep(b.key)) {
            if let Some(n) = self.store.bricks.find_or_make(brick.key) {
                self.store.surfels.adopt(&brick.blocks, n as u32);
                self.store.bricks.list[n] = brick;
            }
        }
        self.visible.clear();
        self.sweep = 0;
    }
}
