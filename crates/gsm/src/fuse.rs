//! Surfels seen again are averaged with the frame; pixels without one get a new surfel.

use crate::associate::Association;
use crate::event::Counts;
use crate::frame::{dot, sub};
use crate::samples::{Sample, Samples};
use crate::segments::Segments;
use crate::store::{Step, Store};
use crate::surfels::{Cold, Hot, Surfels};
use crate::vote::Votes;

const CONFIDENCE_MAX: f32 = 40.0;
const LABEL_CONFIDENCE_MAX: i16 = 12;

/// Averages position along the normal, the normal, and the label of every match.
pub(crate) fn fuse(step: Step<'_>, association: &Association, votes: &Votes, store: &mut Store) {
    let Step { samples, pose, params, now, .. } = step;
    let Store { surfels, segments, .. } = store;
    for m in &association.matches {
        let sample = &samples.list[m.sample as usize];
        let cos = sample.cos;
        if cos < params.min_incidence_cos {
            continue;
        }
        let best = association.hits[m.sample as usize].surfel;
        if best != m.surfel + 1 && redundant(surfels, m.surfel, best - 1) {
            // Out of its segment at once, out of the brick at its next visit.
            segments.relabel(surfels, m.surfel, 0);
            surfels.doom(m.surfel);
            continue;
        }
        let mut hot = surfels.hot(m.surfel);
        let cold = &mut surfels.cold[m.surfel as usize];
        let gain = cos / (cold.confidence + cos);
        let n = pose.turn(sample.normal);
        for ((p, own), n) in hot.position.iter_mut().zip(&mut hot.normal).zip(n) {
            *p -= n * m.ahead * gain;
            *own += (n - *own) * gain;
        }
        // One Newton step towards unit length: the length is within 10 % of it and gains at every sighting.
        let scale = 1.5 - 0.5 * dot(hot.normal, hot.normal);
        hot.normal = hot.normal.map(|v| v * scale);
        hot.radius = hot.radius.min(radius(samples.spacing, sample.smooth, cos));
        cold.confidence = (cold.confidence + 1.0).min(CONFIDENCE_MAX);
        let ripe = !cold.stable && cold.confidence >= params.stable_sightings as f32;
        surfels.set_hot(m.surfel, &hot);
        if ripe {
            surfels.set_stable(m.surfel);
            segments.ripen(surfels, m.surfel);
        } else if (m.ahead * gain).abs() > 2.5e-4 || (now + m.surfel).is_multiple_of(8) {
            segments.follow(surfels, m.surfel);
        }
        label(sample, votes, surfels, segments, m.surfel);
    }
}

/// Whether `id` lies closer to the surfel that its pixel sees best than their radius, and is the less certain.
fn redundant(surfels: &Surfels, id: u32, best: u32) -> bool {
    let off = sub(surfels.position(id), surfels.position(best));
    let r = surfels.radius(id).min(surfels.radius(best));
    let certain = |id: u32| (surfels.cold[id as usize].confidence, std::cmp::Reverse(id));
    dot(off, off) < r * r && certain(id) < certain(best)
}

/// Moves the label towards that of the pixel's region: agreement strengthens it, disagreement wears it down.
/// Samples that got their region by growth only confirm or fill.
fn label(sample: &Sample, votes: &Votes, surfels: &mut Surfels, segments: &mut Segments, id: u32) {
    let segment = votes.segment_of[sample.region()];
    if segment == 0 {
        return;
    }
    let own = surfels.segment(id);
    let cold = &mut surfels.cold[id as usize];
    if own == segment {
        cold.label_confidence = (cold.label_confidence + 1).min(LABEL_CONFIDENCE_MAX);
    } else if own == 0 {
        cold.label_confidence = 0;
        segments.relabel(surfels, id, segment);
    } else if !sample.is_edge() {
        cold.label_confidence -= 1;
        if cold.label_confidence < 0 {
            cold.label_confidence = 0;
            segments.relabel(surfels, id, segment);
        }
    }
}

/// Radius of the disc that covers a sample's footprint: `2 r² = spacing² z² / cos`.
fn radius(spacing: f32, z: f32, cos: f32) -> f32 {
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
    let cold = Cold { confidence: 1.0, seen: now, ..Cold::default() };
    store.surfels.insert(&mut store.bricks.list[brick].blocks, hot, cold, limit)
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
