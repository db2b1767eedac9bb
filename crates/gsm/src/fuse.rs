//! Surfels seen again are averaged with the frame; pixels without one get a new surfel.

use crate::associate::Association;
use crate::event::Counts;
use crate::frame::{Frame, dot, sub};
use crate::segments::Segments;
use crate::store::{Step, Store};
use crate::surfels::{Cold, Hot, Surfels};
use crate::vote::Votes;

const CONFIDENCE_MAX: f32 = 40.0;
const LABEL_CONFIDENCE_MAX: i16 = 12;

/// Averages position along the normal, the normal, and the label of every match.
pub(crate) fn fuse(step: Step<'_>, association: &Association, votes: &Votes, store: &mut Store) {
    let Step { frame, pose, params, now } = step;
    let Store { surfels, segments, .. } = store;
    for m in &association.matches {
        let i = m.pixel as usize;
        let n = frame.normal(i);
        let cos = frame.cos[i];
        if cos < params.min_incidence_cos {
            continue;
        }
        if association.hit[i] != m.surfel + 1 && redundant(surfels, m.surfel, association.hit[i] - 1) {
            // Out of its segment at once, out of the brick at its next visit.
            segments.relabel(surfels, m.surfel, 0);
            surfels.cold[m.surfel as usize].confidence = -1.0;
            surfels.hot[m.surfel as usize].radius *= -1.0;
            continue;
        }
        let hot = &mut surfels.hot[m.surfel as usize];
        let cold = &mut surfels.cold[m.surfel as usize];
        let gain = cos / (cold.confidence + cos);
        let n = pose.turn(n);
        for ((p, own), n) in hot.position.iter_mut().zip(&mut hot.normal).zip(n) {
            *p -= n * m.ahead * gain;
            *own += (n - *own) * gain;
        }
        // One Newton step towards unit length: the length is within 10 % of it and gains at every sighting.
        let scale = 1.5 - 0.5 * dot(hot.normal, hot.normal);
        hot.normal = hot.normal.map(|v| v * scale);
        hot.radius = hot.radius.min(radius(frame, frame.smooth[i], cos));
        cold.confidence = (cold.confidence + 1.0).min(CONFIDENCE_MAX);
        let ripe = !cold.stable && cold.confidence >= params.stable_sightings as f32;
        if ripe {
            surfels.set_stable(m.surfel);
            segments.ripen(surfels, m.surfel);
        } else if (m.ahead * gain).abs() > 2.5e-4 || (now + m.surfel).is_multiple_of(8) {
            segments.follow(surfels, m.surfel);
        }
        label(frame, votes, surfels, segments, m.surfel, i);
    }
}

/// Whether `id` lies closer to the surfel that its pixel sees best than their radius, and is the less certain.
fn redundant(surfels: &Surfels, id: u32, best: u32) -> bool {
    let (a, b) = (&surfels.hot[id as usize], &surfels.hot[best as usize]);
    let off = sub(a.position, b.position);
    let r = a.radius.min(b.radius);
    let certain = |id: u32| (surfels.cold[id as usize].confidence, std::cmp::Reverse(id));
    dot(off, off) < r * r && certain(id) < certain(best)
}

/// Moves the label towards that of the pixel's region: agreement strengthens it, disagreement wears it down.
/// Pixels that got their region by growth only confirm or fill.
fn label(
    frame: &Frame,
    votes: &Votes,
    surfels: &mut Surfels,
    segments: &mut Segments,
    id: u32,
    pixel: usize,
) {
    let segment = votes.segment_of[frame.label[pixel] as usize];
    if segment == 0 {
        return;
    }
    let own = surfels.hot[id as usize].segment;
    let cold = &mut surfels.cold[id as usize];
    if own == segment {
        cold.label_confidence = (cold.label_confidence + 1).min(LABEL_CONFIDENCE_MAX);
    } else if own == 0 {
        cold.label_confidence = 0;
        segments.relabel(surfels, id, segment);
    } else if frame.edge[pixel] == 0 {
        cold.label_confidence -= 1;
        if cold.label_confidence < 0 {
            cold.label_confidence = 0;
            segments.relabel(surfels, id, segment);
        }
    }
}

/// Radius of the disc that covers a pixel's footprint: `2 r² = spacing² z² / cos`.
fn radius(frame: &Frame, z: f32, cos: f32) -> f32 {
    frame.spacing * z / (2.0 * cos).sqrt()
}

/// Makes surfels at pixels that no matched surfel of the 3×3 neighbourhood covers.
pub(crate) fn create(
    step: Step<'_>,
    association: &Association,
    votes: &Votes,
    store: &mut Store,
    counts: &mut Counts,
) {
    let Step { frame, pose, params, now } = step;
    for y in 0..frame.height {
        for x in 0..frame.width {
            let i = y * frame.width + x;
            let (n, cos) = (frame.normal(i), frame.cos[i]);
            if n == [0.0; 3] || cos < params.min_incidence_cos || !association.is_bare(i) {
                continue;
            }
            let p = frame.point(x, y);
            let position = pose.place(p);
            let ray = sub(position, pose.centre);
            let spacing = 0.75 * (frame.spacing * p[2]).max(params.min_spacing);
            if covered(frame, association, &store.surfels, (x, y), position, ray, spacing) {
                continue;
            }
            let hot = Hot { position, radius: radius(frame, p[2], cos), normal: pose.turn(n), segment: 0 };
            let Some(id) = insert(store, hot, now, params.max_surfels) else {
                counts.refused += 1;
                continue;
            };
            counts.created += 1;
            let segment = votes.segment_of[frame.label[i] as usize];
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

/// Whether a surfel seen in the 3×3 pixels lies within `reach` of the ray through `position`.
fn covered(
    frame: &Frame,
    association: &Association,
    surfels: &Surfels,
    (x, y): (usize, usize),
    position: [f32; 3],
    ray: [f32; 3],
    reach: f32,
) -> bool {
    let own = y * frame.width + x;
    let near = |i: usize| {
        let hit = association.hit[i];
        hit != 0 && {
            let off = sub(surfels.hot[hit as usize - 1].position, position);
            let along = dot(off, ray);
            dot(off, off) - along * along / dot(ray, ray) < reach * reach
        }
    };
    if near(own) {
        return true;
    }
    (y.saturating_sub(1)..(y + 2).min(frame.height)).any(|row| {
        (x.saturating_sub(1)..(x + 2).min(frame.width)).any(|column| near(row * frame.width + column))
    })
}
