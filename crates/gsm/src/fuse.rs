//! Surfels seen again get the label of their region; samples without one get a new surfel.

use crate::associate::Association;
use crate::event::Counts;
use crate::frame::{dot, sub};
use crate::project::bits;
use crate::samples::{Sample, Samples};
use crate::segments::Segments;
use crate::sight::CONFIDENCE_MAX;
use crate::store::{Step, Store};
use crate::surfels::{BLOCK, Hot, HotBlock, Surfels};
use crate::vote::Votes;

const LABEL_CONFIDENCE_MAX: i16 = 12;

/// What a sample has to say of a label: slot of its region's segment plus one, 0 = nothing, and in the highest bit
/// whether it is an edge; [`MUTE`] where it is seen too obliquely.
#[derive(Debug, Default)]
pub(crate) struct Verdicts(Vec<u32>);

const EDGE: u32 = 1 << 31;
const MUTE: u32 = u32::MAX;

/// Gives every surfel seen its label, and takes those that another one makes redundant out.
pub(crate) fn label(
    step: Step<'_>,
    association: &Association,
    votes: &Votes,
    store: &mut Store,
    verdicts: &mut Verdicts,
) {
    let Step { samples, params, .. } = step;
    let Store { surfels, segments, .. } = store;
    let verdict = |s: &Sample| {
        let edge = if s.is_edge() { EDGE } else { 0 };
        if s.cos < params.min_incidence_cos { MUTE } else { votes.segment_of[s.region()] | edge }
    };
    verdicts.0.clear();
    verdicts.0.extend(samples.list.iter().map(verdict));
    for matches in &association.matches {
        let mut verdict = [MUTE; BLOCK];
        let mut best = [0; BLOCK];
        for k in bits(matches.seen) {
            let sample = matches.sample[k] as usize;
            (verdict[k], best[k]) = (verdicts.0[sample], association.hits[sample].surfel);
        }
        let block = &mut surfels.hot[matches.first as usize / BLOCK];
        let rest = agree(block, matches.first, &verdict, &best);
        for m in matches.each(matches.seen & rest) {
            let k = (m.surfel - matches.first) as usize;
            if best[k] != m.surfel + 1 && redundant(surfels, m.surfel, best[k] - 1) {
                // Out of its segment at once, out of the brick at its next visit.
                segments.relabel(surfels, m.surfel, 0);
                surfels.doom(m.surfel);
            } else if verdict[k] & !EDGE != 0 {
                vote(surfels, segments, m.surfel, verdict[k] & !EDGE, verdict[k] & EDGE != 0);
            }
        }
    }
}

/// Confirms the labels of a block's surfels that are nearest to their sample and agree with it, as most do; returns
/// the others that are to be looked at, a bit each.
#[inline]
fn agree(block: &mut HotBlock, first: u32, verdict: &[u32; BLOCK], best: &[u32; BLOCK]) -> u32 {
    let (segment, mut confidence) = (block.segment, block.label_confidence);
    let mut rest = [0u32; BLOCK];
    for k in 0..BLOCK {
        let heard = verdict[k] != MUTE;
        let nearest = best[k] == first + k as u32 + 1;
        let agrees = heard & nearest & (segment[k] != 0) & (verdict[k] & !EDGE == segment[k]);
        let more = (confidence[k] + 1).min(LABEL_CONFIDENCE_MAX);
        confidence[k] = if agrees { more } else { confidence[k] };
        rest[k] = u32::from(heard & !agrees) << k;
    }
    block.label_confidence = confidence;
    rest.iter().fold(0, |all, r| all | r)
}

/// Whether `id` lies closer to the surfel that its pixel sees best than their radius, and is the less certain. What lies
/// elsewhere in memory is asked last.
fn redundant(surfels: &Surfels, id: u32, best: u32) -> bool {
    let own = surfels.confidence(id);
    if own >= CONFIDENCE_MAX && id < best {
        return false;
    }
    let certain = |confidence: f32, id: u32| (confidence, std::cmp::Reverse(id));
    if certain(own, id) >= certain(surfels.confidence(best), best) {
        return false;
    }
    let off = sub(surfels.position(id), surfels.position(best));
    let r = surfels.radius(id).min(surfels.radius(best));
    dot(off, off) < r * r
}

/// Moves the label towards that of the sample's region: agreement strengthens it, disagreement wears it down.
/// Samples that got their region by growth only confirm or fill.
fn vote(surfels: &mut Surfels, segments: &mut Segments, id: u32, segment: u32, edge: bool) {
    let own = surfels.segment(id);
    let confidence = surfels.label_confidence(id);
    if own == segment {
        *confidence = (*confidence + 1).min(LABEL_CONFIDENCE_MAX);
    } else if own == 0 {
        *confidence = 0;
        segments.relabel(surfels, id, segment);
    } else if !edge {
        *confidence -= 1;
        if *confidence < 0 {
            *confidence = 0;
            segments.relabel(surfels, id, segment);
        }
    }
}

/// Radius of the disc that covers a sample's footprint: `2 r² = spacing² z² / cos`.
#[inline(always)]
pub(crate) fn radius(spacing: f32, z: f32, cos: f32) -> f32 {
    spacing * z / (2.0 * cos).sqrt()
}

/// Makes surfels at samples that no matched surfel of the 3×3 neighbourhood covers.
pub(crate) fn create(
    step: Step<'_>,
    association: &Association,
    votes: &Votes,
    store: &mut Store,
    counts: &mut Counts,
) {
    let Step { samples, pose, params, now, .. } = step;
    for (y, row) in samples.list.chunks_exact(samples.width).enumerate() {
        for (x, s) in row.iter().enumerate() {
            let bare = association.hits[y * samples.width + x].is_bare();
            if !bare || s.smooth == 0.0 || s.cos < params.min_incidence_cos {
                continue;
            }
            let p = samples.point(x, y);
            let position = pose.place(p);
            let ray = sub(position, pose.centre);
            let spacing = 0.75 * (samples.spacing * p[2]).max(params.min_spacing);
            if covered(samples, association, &store.surfels, (x, y), position, ray, spacing) {
                continue;
            }
            let radius = radius(samples.spacing, p[2], s.cos);
            let hot = Hot { position, radius, normal: pose.turn(s.normal), segment: 0 };
            let Some(id) = insert(store, hot, now, params.max_surfels) else {
                counts.refused += 1;
                continue;
            };
            counts.created += 1;
            let segment = votes.segment_of[s.region()];
            if segment != 0 {
                store.segments.relabel(&mut store.surfels, id, segment);
            }
        }
    }
}

fn insert(store: &mut Store, hot: Hot, now: u32, limit: u32) -> Option<u32> {
    let key = store.bricks.key(hot.position)?;
    let brick = store.bricks.find_or_make(key)?;
    store.surfels.insert(brick as u32, &mut store.bricks.list[brick].blocks, hot, now, limit)
}

/// Whether a surfel seen in the 3×3 samples lies within `reach` of the ray through `position`.
fn covered(
    samples: &Samples,
    association: &Association,
    surfels: &Surfels,
    (x, y): (usize, usize),
    position: [f32; 3],
    ray: [f32; 3],
    reach: f32,
) -> bool {
    let own = y * samples.width + x;
    let near = |i: usize| {
        let hit = association.hits[i].surfel;
        hit != 0 && {
            let off = sub(surfels.position(hit - 1), position);
            let along = dot(off, ray);
            dot(off, off) - along * along / dot(ray, ray) < reach * reach
        }
    };
    if near(own) {
        return true;
    }
    (y.saturating_sub(1)..(y + 2).min(samples.height)).any(|row| {
        (x.saturating_sub(1)..(x + 2).min(samples.width)).any(|column| near(row * samples.width + column))
    })
}
