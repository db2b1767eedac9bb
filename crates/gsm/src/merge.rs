//! Merges: two segments become one when the frames keep joining them along a substantial common border.

use crate::Params;
use crate::event::SegmentEvent;
use crate::segments::Segments;
use crate::store::{Step, Store};
use crate::surfels::Surfels;
use crate::vote::Votes;
use std::collections::BTreeMap;

/// Border pixels of a pair, summed over frames with decay.
#[derive(Debug, Clone, Copy, Default)]
struct Evidence {
    joined: f32,
    apart: f32,
    /// Border that would be substantial, summed alike.
    wanted: f32,
    frames: u32,
    last: u32,
}

/// Evidence of all pairs that touched lately.
#[derive(Debug, Default)]
pub(crate) struct Merges {
    pairs: BTreeMap<(u32, u32), Evidence>,
    ripe: Vec<(u32, u32)>,
}

/// Kept of the evidence from one contact frame to the next.
const DECAY: f32 = 0.96;
/// Pairs that did not touch for so many frames are forgotten.
const FORGET: u32 = 100;
/// Contact frames before a merge.
const PATIENCE: u32 = 8;

impl Merges {
    /// Adds the contacts of a frame, then merges every pair whose evidence suffices.
    pub(crate) fn run(
        &mut self,
        step: Step<'_>,
        votes: &Votes,
        store: &mut Store,
        events: &mut Vec<SegmentEvent>,
    ) {
        let now = step.now;
        let Store { surfels, segments, .. } = store;
        self.gather(votes, step.params, now);
        let mut ripe = std::mem::take(&mut self.ripe);
        for &(a, b) in &ripe {
            if segments.is_open(a) && segments.is_open(b) {
                self.merge(surfels, segments, a, b, events);
            }
        }
        ripe.clear();
        self.ripe = ripe;
        if now.is_multiple_of(FORGET) {
            self.pairs.retain(|_, e| now - e.last <= FORGET);
        }
    }

    fn gather(&mut self, votes: &Votes, params: &Params, now: u32) {
        for run in votes.contacts.chunk_by(|a, b| a.pair == b.pair) {
            let pair = run[0].pair;
            let joined = run.iter().filter(|c| c.joined).count() as f32;
            // A border that lies beside the frame's own one joins pixels, but not segments.
            let joined = joined * votes.together(pair.0, pair.1);
            let apart = run.len() as f32 - joined;
            let smaller = votes.pixels_of(pair.0).min(votes.pixels_of(pair.1));
            let e = self.pairs.entry(pair).or_default();
            e.joined = e.joined * DECAY + joined;
            e.apart = e.apart * DECAY + apart;
            e.wanted = e.wanted * DECAY + 0.35 * (smaller as f32).sqrt();
            e.frames += 1;
            e.last = now;
            let share = e.joined / (e.joined + e.apart);
            if e.frames >= PATIENCE
                && e.joined >= params.merge_border
                && e.joined >= e.wanted
                && share >= params.merge_share
            {
                self.ripe.push(pair);
            }
        }
    }

    /// The one with more members lives on, the older one at a tie.
    fn merge(
        &mut self,
        surfels: &mut Surfels,
        segments: &mut Segments,
        a: u32,
        b: u32,
        events: &mut Vec<SegmentEvent>,
    ) {
        let rank = |s: u32| {
            let r = &segments.slots[s as usize];
            (r.members.len(), std::cmp::Reverse(r.id))
        };
        let (into, from) = if rank(a) >= rank(b) { (a, b) } else { (b, a) };
        events.push(SegmentEvent::Merged { from: segments.id(from), into: segments.id(into) });
        segments.absorb(surfels, from, into);
        self.pairs.retain(|p, _| p.0 != from && p.1 != from);
    }

    /// Drops what is known of slots that closed in this frame.
    pub(crate) fn forget_closed(&mut self, segments: &Segments) {
        self.pairs.retain(|p, _| segments.is_open(p.0) && segments.is_open(p.1));
    }
}
