//! Which segment each region of the frame is: votes of the surfels that its pixels see again.

use crate::Params;
use crate::associate::Association;
use crate::event::SegmentEvent;
use crate::frame::{DOWN, RIGHT};
use crate::samples::Samples;
use crate::segments::Segments;
use crate::store::{Step, Store};

/// A pair of neighbouring pixels on two segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Contact {
    /// Slots, the lower first.
    pub(crate) pair: (u32, u32),
    /// Whether the frame has them in one region.
    pub(crate) joined: bool,
}

/// Least votes for a segment's id.
const VOTES: u32 = 4;
/// Least votes per core pixel of the region that holds most of the segment in view, and of another one: a region
/// that merely touches a segment does not inherit its id.
const MAIN_SHARE: f32 = 0.1;
const OWN_SHARE: f32 = 0.4;

/// What a sample says: the segment of its surfel (slot plus one) and its region, 0 = none.
#[derive(Debug, Clone, Copy)]
struct Key {
    segment: u32,
    region: u32,
}

impl PartialEq for Key {
    #[inline(always)]
    fn eq(&self, other: &Self) -> bool {
        (self.segment == other.segment) & (self.region == other.region)
    }
}

impl Key {
    #[inline(always)]
    fn is_bare(self) -> bool {
        (self.segment == 0) | (self.region == 0)
    }
}

/// Workspace and result.
#[derive(Debug, Default)]
pub(crate) struct Votes {
    /// Slot plus one of every region, 0 = none.
    pub(crate) segment_of: Vec<u32>,
    /// Pixel contacts between segments.
    pub(crate) contacts: Vec<Contact>,
    /// Touching pixels of two regions that are one segment, as sorted pairs of regions.
    pub(crate) seams: Vec<(u32, u32)>,
    /// Per sample.
    keys: Vec<Key>,
    /// Samples per segment (slot plus one).
    tally: Vec<u32>,
    /// Slots seen in this frame and the pixels of each.
    pub(crate) seen: Vec<u32>,
    pub(crate) pixels: Vec<u32>,
    /// Per slot its column in the table, valid where `stamp` is the current frame.
    column: Vec<u32>,
    stamp: Vec<u32>,
    /// Votes of every region (rows) for every segment seen (columns).
    table: Vec<u32>,
    /// Pixels per region that are no edges: only they vote, as surfels near a crease stray over it.
    cores: Vec<u32>,
    /// Per column the most votes that a region has for it, and the first such region.
    claims: Vec<(u32, u32)>,
}

impl Votes {
    /// Counts votes, resolves regions to segments (opening new ones at first sight) and gathers contacts.
    pub(crate) fn run(
        &mut self,
        step: Step<'_>,
        association: &Association,
        store: &mut Store,
        events: &mut Vec<SegmentEvent>,
    ) {
        let Step { samples, params, now, .. } = step;
        let segments = &mut store.segments;
        self.see(samples, association, segments, now);
        let columns = self.seen.len();
        let regions = samples.region_size.len();
        self.table.clear();
        self.table.resize(regions * columns, 0);
        self.cores.clear();
        self.cores.resize(regions, 0);
        // Half of the samples have no surfel, as chance has it: what they add is nothing, without a branch.
        for (sample, key) in samples.list.iter().zip(&self.keys) {
            self.cores[key.region as usize] += u32::from(!sample.is_edge());
        }
        if columns != 0 {
            for (sample, key) in samples.list.iter().zip(&self.keys) {
                let votes = !sample.is_edge() & !key.is_bare();
                let column = self.column[key.segment.saturating_sub(1) as usize];
                let place = key.region as usize * columns + column as usize;
                self.table[if votes { place } else { 0 }] += u32::from(votes);
            }
        }
        self.resolve(segments, params, now, events);
        self.touch(samples);
    }

    fn see(&mut self, samples: &Samples, association: &Association, segments: &Segments, now: u32) {
        self.seen.clear();
        self.pixels.clear();
        self.column.resize(segments.slots.len(), 0);
        self.stamp.resize(segments.slots.len(), 0);
        self.keys.clear();
        let keys = association.hits.iter().zip(&samples.list);
        self.keys.extend(keys.map(|(h, s)| Key { segment: h.segment, region: s.region() as u32 }));
        self.tally.clear();
        self.tally.resize(segments.slots.len() + 1, 0);
        self.keys.iter().for_each(|k| self.tally[k.segment as usize] += 1);
        for (slot, &n) in self.tally[1..].iter().enumerate().filter(|(_, n)| **n != 0) {
            self.stamp[slot] = now;
            self.column[slot] = self.seen.len() as u32;
            self.seen.push(slot as u32);
            self.pixels.push(n);
        }
    }

    fn resolve(
        &mut self,
        segments: &mut Segments,
        params: &Params,
        now: u32,
        events: &mut Vec<SegmentEvent>,
    ) {
        let columns = self.seen.len();
        self.claim(columns);
        self.segment_of.clear();
        self.segment_of.push(0);
        for region in 1..self.cores.len() {
            let row = &self.table[region * columns..(region + 1) * columns];
            let voters: u32 = row.iter().sum();
            let best = row
                .iter()
                .zip(&self.seen)
                .map(|(&n, &slot)| (n, std::cmp::Reverse(segments.slots[slot as usize].id), slot))
                .max();
            let size = self.cores[region];
            let taken = best.filter(|&(n, _, slot)| {
                let main = self.claims[self.column[slot as usize] as usize].1 == region as u32;
                let share = if main { MAIN_SHARE } else { OWN_SHARE };
                n as f32 >= params.take_share * voters as f32 && n >= VOTES && n as f32 >= share * size as f32
            });
            let segment = match taken {
                Some((_, _, slot)) => slot + 1,
                None if size >= params.min_region_pixels => {
                    segments.open(now, events).map_or(0, |slot| slot + 1)
                }
                None => 0,
            };
            self.segment_of.push(segment);
        }
    }

    /// Finds the region that holds most of each segment seen.
    fn claim(&mut self, columns: usize) {
        self.claims.clear();
        self.claims.resize(columns, (0, 0));
        for region in 1..self.cores.len() {
            let row = &self.table[region * columns..(region + 1) * columns];
            for (claim, &n) in self.claims.iter_mut().zip(row) {
                if n > claim.0 {
                    *claim = (n, region as u32);
                }
            }
        }
    }

    fn touch(&mut self, samples: &Samples) {
        self.contacts.clear();
        self.seams.clear();
        let (w, n) = (samples.width, self.keys.len());
        let keys = std::mem::take(&mut self.keys);
        for first in (0..n).step_by(w) {
            let row = &keys[first..first + w];
            self.meet(samples, RIGHT, first, row, &row[1..]);
            self.meet(samples, DOWN, first, row, &keys[(first + w).min(n)..]);
        }
        self.keys = keys;
        self.contacts.sort_unstable();
        self.seams.sort_unstable();
    }

    /// Notes what the samples from `first` on and their neighbours in direction `bit` say of their segments.
    fn meet(&mut self, samples: &Samples, bit: u8, first: usize, keys: &[Key], others: &[Key]) {
        for (i, (p, q)) in keys.iter().zip(others).enumerate() {
            if (p == q) | p.is_bare() | q.is_bare() {
                continue;
            }
            let ((a, la), (b, lb)) = ((p.segment, p.region), (q.segment, q.region));
            if a != b {
                let joined = la == lb && samples.links[first + i] & bit != 0;
                self.contacts.push(Contact { pair: (a.min(b) - 1, a.max(b) - 1), joined });
            } else if self.segment_of[la as usize] == a && self.segment_of[lb as usize] == a {
                self.seams.push((la.min(lb), la.max(lb)));
            }
        }
    }

    /// How far two slots seen in frame `now` are in one region: the sum over regions of the smaller of the shares of
    /// the two that lie in it, 0 to 1.
    pub(crate) fn together(&self, a: u32, b: u32, now: u32) -> f32 {
        let (na, nb) = (self.pixels_of(a, now), self.pixels_of(b, now));
        if na == 0 || nb == 0 {
            return 0.0;
        }
        let (a, b) = (self.column[a as usize] as usize, self.column[b as usize] as usize);
        let share = |row: &[u32]| (row[a] as f32 / na as f32).min(row[b] as f32 / nb as f32);
        self.table.chunks_exact(self.seen.len()).skip(1).map(share).sum()
    }

    /// Pixels of a slot seen in frame `now`.
    pub(crate) fn pixels_of(&self, slot: u32, now: u32) -> u32 {
        let slot = slot as usize;
        if self.stamp.get(slot) == Some(&now) { self.pixels[self.column[slot] as usize] } else { 0 }
    }
}
