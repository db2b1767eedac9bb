//! Splits: a part of a segment that the frames keep setting apart becomes a segment of its own.
//!
//! Where two touching regions of a frame are one segment, the surfels of the smaller are tagged. A tag that comes
//! back with the same surfels gains, one whose surfels lie in one region with the rest of the segment loses; a tag
//! with enough gain is split off.

use crate::associate::{Association, Match};
use crate::event::SegmentEvent;
use crate::project::bits;
use crate::samples::Samples;
use crate::store::{Step, Store};
use crate::surfels::Surfels;
use crate::vote::Votes;
use std::collections::BTreeMap;

/// Net sightings of a tag before its surfels are split off.
const SCORE: i32 = 6;
/// Tags kept at a time.
const TAGS: usize = 4096;
/// Least pixels of a region that may be split off.
const PIXELS: u32 = 40;
/// Part of the square root of a region's pixels that its border must have.
pub(crate) const BORDER: f32 = 0.35;
/// Label confidence of split surfels.
const CONFIDENCE: i16 = 4;
/// Tags that were not confirmed for so many frames are forgotten.
const FORGET: u32 = 150;

#[derive(Debug, Clone, Copy)]
struct Tag {
    score: i32,
    last: u32,
}

/// Tags and workspace.
#[derive(Debug, Default)]
pub(crate) struct Splits {
    tags: BTreeMap<u32, Tag>,
    issued: u32,
    /// Pixels per region whose surfel has the segment of the region.
    region_pixels: Vec<u32>,
    /// (region, tag) of those with a tag.
    cells: Vec<(u32, u32)>,
    /// (region, tag, pixels), sorted.
    counts: Vec<(u32, u32, u32)>,
}

impl Splits {
    /// Follows the tags through a frame; splits off what is ripe and gives its region the new segment.
    pub(crate) fn run(
        &mut self,
        step: Step<'_>,
        association: &Association,
        votes: &mut Votes,
        store: &mut Store,
        events: &mut Vec<SegmentEvent>,
    ) {
        let Step { samples, now, .. } = step;
        let candidates = candidates(samples, votes);
        if candidates.is_empty() && self.tags.is_empty() {
            return;
        }
        self.count(association, votes, &store.surfels);
        let mut given = vec![0u32; votes.segment_of.len()];
        for &region in &candidates {
            given[region as usize] = self.confirm(region, now);
        }
        self.contradict(&given);
        self.paint(association, votes, &mut store.surfels, &given);
        for &region in &candidates {
            let tag = given[region as usize];
            if self.tags.get(&tag).is_some_and(|t| t.score >= SCORE) {
                self.tags.remove(&tag);
                split(votes, store, region, tag, now, events);
            }
        }
        if now.is_multiple_of(FORGET) {
            self.tags.retain(|_, t| now - t.last <= FORGET);
        }
    }

    fn count(&mut self, association: &Association, votes: &Votes, surfels: &Surfels) {
        self.cells.clear();
        self.region_pixels.clear();
        self.region_pixels.extend((0..votes.segment_of.len()).map(|r| votes.own_pixels(r)));
        for m in &association.tagged {
            let (hit, region) = (&association.hits[m.sample as usize], votes.keys[m.sample as usize].region);
            let segment = votes.segment_of[region as usize];
            if hit.surfel == m.surfel + 1 && segment != 0 && hit.segment == segment {
                self.cells.push((region, surfels.cold[m.surfel as usize].tag));
            }
        }
        self.cells.sort_unstable();
        self.counts.clear();
        let runs = self.cells.chunk_by(|a, b| a == b).map(|run| (run[0].0, run[0].1, run.len() as u32));
        self.counts.extend(runs);
    }

    /// Pixels of a tag in all regions.
    fn tag_pixels(&self, tag: u32) -> u32 {
        self.counts.iter().filter(|c| c.1 == tag).map(|c| c.2).sum()
    }

    /// The tag that the region confirms, or a new one; 0 when the table is full.
    fn confirm(&mut self, region: u32, now: u32) -> u32 {
        let all = self.region_pixels[region as usize];
        let best = self
            .counts
            .iter()
            .filter(|c| c.0 == region && self.tags.contains_key(&c.1))
            .max_by_key(|c| (c.2, std::cmp::Reverse(c.1)));
        if let Some(&(_, tag, n)) = best
            && 2 * n >= all
            && 2 * n >= self.tag_pixels(tag)
        {
            if let Some(t) = self.tags.get_mut(&tag) {
                t.score += 1;
                t.last = now;
            }
            return tag;
        }
        if self.tags.len() >= TAGS {
            return 0;
        }
        self.issued += 1;
        self.tags.insert(self.issued, Tag { score: 1, last: now });
        self.issued
    }

    /// Tags whose visible surfels mostly share a region with as many others lose.
    fn contradict(&mut self, given: &[u32]) {
        for &(region, tag, n) in &self.counts {
            if given[region as usize] == tag || n < PIXELS / 2 || 2 * n < self.tag_pixels(tag) {
                continue;
            }
            if 10 * n > 7 * self.region_pixels[region as usize] {
                continue;
            }
            if let Some(t) = self.tags.get_mut(&tag) {
                t.score -= 1;
                if t.score < 0 {
                    self.tags.remove(&tag);
                }
            }
        }
    }

    fn paint(&self, association: &Association, votes: &Votes, surfels: &mut Surfels, given: &[u32]) {
        if given.iter().all(|&tag| tag == 0) {
            association.tagged.iter().for_each(|m| self.paint_one(*m, votes, surfels, given));
        } else {
            for matches in &association.matches {
                let tagged = surfels.tagged(matches.first);
                for k in bits(matches.seen) {
                    let region = votes.keys[matches.sample[k] as usize].region as usize;
                    if given[region] != 0 || tagged >> k & 1 != 0 {
                        let m = Match { surfel: matches.first + k as u32, sample: matches.sample[k] };
                        self.paint_one(m, votes, surfels, given);
                    }
                }
            }
        }
    }

    fn paint_one(&self, m: Match, votes: &Votes, surfels: &mut Surfels, given: &[u32]) {
        let region = votes.keys[m.sample as usize].region as usize;
        let tag = given[region];
        if region == 0 || tag == 0 && !surfels.is_tagged(m.surfel) {
            return;
        }
        let own = surfels.segment(m.surfel);
        if own == 0 || own != votes.segment_of[region] {
            return;
        }
        if tag != 0 || !self.tags.contains_key(&surfels.cold[m.surfel as usize].tag) {
            surfels.set_tag(m.surfel, tag);
        }
    }
}

/// The smaller of every two touching regions that are one segment and share a substantial border.
fn candidates(samples: &Samples, votes: &Votes) -> Vec<u32> {
    let mut found = Vec::new();
    for run in votes.seams.chunk_by(|a, b| a == b) {
        let (a, b) = run[0];
        let size = |r: u32| samples.region_size[r as usize];
        let smaller = if (size(a), b) <= (size(b), a) { a } else { b };
        let wanted = BORDER * (size(smaller) as f32).sqrt();
        if size(smaller) >= PIXELS && run.len() as f32 >= wanted {
            found.push(smaller);
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}

fn split(
    votes: &mut Votes,
    store: &mut Store,
    region: u32,
    tag: u32,
    now: u32,
    events: &mut Vec<SegmentEvent>,
) {
    let Store { surfels, segments, .. } = store;
    let old = votes.segment_of[region as usize];
    let parts: Vec<u32> = segments.slots[old as usize - 1]
        .members
        .iter()
        .copied()
        .filter(|&id| surfels.cold[id as usize].tag == tag)
        .collect();
    let Some(slot) = segments.open(now, events) else { return };
    events.push(SegmentEvent::Split { from: segments.id(old - 1), into: segments.id(slot) });
    for id in parts {
        segments.relabel(surfels, id, slot + 1);
        *surfels.label_confidence(id) = CONFIDENCE;
        surfels.set_tag(id, 0);
    }
    votes.segment_of[region as usize] = slot + 1;
}
