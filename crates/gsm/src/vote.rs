//! Which segment each region of the frame is: votes of the surfels that its pixels see again.

use crate::Params;
use crate::associate::Association;
use crate::event::SegmentEvent;
use crate::frame::{DOWN, RIGHT};
use crate::lanes::LANES;
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
pub(crate) struct Key {
    segment: u32,
    pub(crate) region: u32,
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

    /// Whether the two differ and neither is bare.
    #[inline(always)]
    fn meets(self, other: Self) -> bool {
        !((self == other) | self.is_bare() | other.is_bare())
    }
}

/// Whether any of a few pairs meet.
#[inline]
fn differ(keys: &[Key], others: &[Key]) -> bool {
    let (Some(p), Some(q)) = (keys.first_chunk::<LANES>(), others.first_chunk::<LANES>()) else {
        return true;
    };
    (0..LANES).fold(false, |any, k| any | p[k].meets(q[k]))
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
    pub(crate) keys: Vec<Key>,
    /// Segments (slot plus one) seen in this frame: those of the table's rows, 0 first.
    seen: Vec<u32>,
    /// Row of every segment, [`UNSEEN`] for those not seen.
    row: Vec<u32>,
    /// Samples of the segments seen (rows) in every region.
    table: Vec<Tally>,
    /// Samples per region that are no edges: only they vote, as surfels near a crease stray over it.
    cores: Vec<u32>,
    /// Per row the most votes that a region has for it, and the first such region.
    claims: Vec<(u32, u32)>,
}

const UNSEEN: u32 = u32::MAX;

/// Samples that are no edges, and those that are.
#[derive(Debug, Clone, Copy, Default)]
struct Tally([u32; 2]);

impl Tally {
    fn votes(self) -> u32 {
        self.0[0]
    }

    fn all(self) -> u32 {
        self.0[0] + self.0[1]
    }
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
        self.see(samples, association, segments.slots.len());
        self.resolve(segments, params, now, events);
        self.touch(samples);
    }

    /// Counts the samples by segment and region.
    fn see(&mut self, samples: &Samples, association: &Association, slots: usize) {
        let regions = samples.region_size.len();
        self.row.clear();
        self.row.resize(slots + 1, UNSEEN);
        self.row[0] = 0;
        self.seen.clear();
        self.seen.push(0);
        self.table.clear();
        self.table.resize(regions, Tally::default());
        self.keys.clear();
        self.keys.reserve(samples.list.len());
        for (hit, sample) in association.hits.iter().zip(&samples.list) {
            let (segment, region) = (hit.segment, sample.region());
            let mut row = self.row[segment as usize];
            if row == UNSEEN {
                row = self.seen.len() as u32;
                self.row[segment as usize] = row;
                self.seen.push(segment);
                self.table.resize(self.table.len() + regions, Tally::default());
            }
            self.table[row as usize * regions + region].0[usize::from(sample.is_edge())] += 1;
            self.keys.push(Key { segment, region: region as u32 });
        }
        self.cores.clear();
        self.cores.resize(regions, 0);
        for row in self.table.chunks_exact(regions) {
            self.cores.iter_mut().zip(row).for_each(|(n, t)| *n += t.votes());
        }
    }

    /// The table's row of a segment (slot plus one); that of no segment where it was not seen.
    fn row_of(&self, segment: u32) -> &[Tally] {
        let row = self.row.get(segment as usize).copied().filter(|r| *r != UNSEEN).unwrap_or(0) as usize;
        &self.table[row * self.cores.len()..(row + 1) * self.cores.len()]
    }

    /// Samples of a region whose surfel has the region's segment.
    pub(crate) fn own_pixels(&self, region: usize) -> u32 {
        let segment = self.segment_of[region];
        if self.sees(segment) { self.row_of(segment)[region].all() } else { 0 }
    }

    /// Whether there is such a segment (slot plus one), and it was seen in this frame.
    fn sees(&self, segment: u32) -> bool {
        segment != 0 && self.row.get(segment as usize).is_some_and(|r| *r != UNSEEN)
    }

    fn resolve(
        &mut self,
        segments: &mut Segments,
        params: &Params,
        now: u32,
        events: &mut Vec<SegmentEvent>,
    ) {
        self.claim();
        self.segment_of.clear();
        self.segment_of.push(0);
        let regions = self.cores.len();
        for region in 1..regions {
            let votes = |row: usize| self.table[row * regions + region].votes();
            let voters: u32 = (1..self.seen.len()).map(votes).sum();
            let best = (1..self.seen.len())
                .map(|row| {
                    let slot = self.seen[row] - 1;
                    (votes(row), std::cmp::Reverse(segments.slots[slot as usize].id), slot, row)
                })
                .max();
            let size = self.cores[region];
            let taken = best.filter(|&(n, _, _, row)| {
                let main = self.claims[row].1 == region as u32;
                let share = if main { MAIN_SHARE } else { OWN_SHARE };
                n as f32 >= params.take_share * voters as f32 && n >= VOTES && n as f32 >= share * size as f32
            });
            let segment = match taken {
                Some((_, _, slot, _)) => slot + 1,
                None if size >= params.min_region_pixels => {
                    segments.open(now, events).map_or(0, |slot| slot + 1)
                }
                None => 0,
            };
            self.segment_of.push(segment);
        }
    }

    /// Finds the region that holds most of each segment seen.
    fn claim(&mut self) {
        self.claims.clear();
        for row in self.table.chunks_exact(self.cores.len()) {
            let mut claim = (0, 0);
            for (region, n) in row.iter().map(|t| t.votes()).enumerate().skip(1) {
                if n > claim.0 {
                    claim = (n, region as u32);
                }
            }
            self.claims.push(claim);
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
        let n = keys.len().min(others.len());
        for at in (0..n).step_by(LANES) {
            let part = at..(at + LANES).min(n);
            let (keys, others) = (&keys[part.clone()], &others[part]);
            if differ(keys, others) {
                self.meet_some(samples, bit, first + at, keys, others);
            }
        }
    }

    fn meet_some(&mut self, samples: &Samples, bit: u8, first: usize, keys: &[Key], others: &[Key]) {
        for (i, (p, q)) in keys.iter().zip(others).enumerate() {
            if !p.meets(*q) {
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

    /// How far two slots seen in this frame are in one region: the sum over regions of the smaller of the shares of the
    /// two that lie in it, 0 to 1.
    pub(crate) fn together(&self, a: u32, b: u32) -> f32 {
        let (na, nb) = (self.pixels_of(a), self.pixels_of(b));
        if na == 0 || nb == 0 {
            return 0.0;
        }
        let share = |t: &Tally, n: u32| t.votes() as f32 / n as f32;
        let rows = self.row_of(a + 1).iter().zip(self.row_of(b + 1)).skip(1);
        rows.map(|(a, b)| share(a, na).min(share(b, nb))).sum()
    }

    /// Samples of a slot in this frame.
    pub(crate) fn pixels_of(&self, slot: u32) -> u32 {
        if self.sees(slot + 1) { self.row_of(slot + 1).iter().map(|t| t.all()).sum() } else { 0 }
    }
}
