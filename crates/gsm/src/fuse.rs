//! Surfels seen again are averaged with the frame; pixels without one get a new surfel.

use crate::Params;
use crate::associate::{Association, Pose};
use crate::bricks::Bricks;
use crate::event::Counts;
use crate::frame::{Frame, dot, sub};
use crate::segments::Segments;
use crate::surfels::{Cold, Hot, Surfels};
use crate::vote::Votes;

const CONFIDENCE_MAX: f32 = 40.0;
const LABEL_CONFIDENCE_MAX: i16 = 12;

/// Averages position along the normal, the normal, and the label of every match.
#[allow(clippy::too_many_arguments)]
pub(crate) fn fuse(
    frame: &Frame,
    pose: &Pose,
    association: &Association,
    votes: &Votes,
    surfels: &mut Surfels,
    segments: &mut Segments,
    params: &Params,
    now: u32,
) {
    for m in &association.matches {
        let i = m.pixel as usize;
        let (x, y) = (i % frame.width, i / frame.width);
        let n = frame.normal[i];
        let p = frame.point(x, y);
        let cos = -dot(n, p) / dot(p, p).sqrt();
        if cos < params.min_incidence_cos {
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
        let scale = 1.0 / dot(hot.normal, hot.normal).max(1e-12).sqrt();
        hot.normal = hot.normal.map(|v| v * scale);
        hot.radius = hot.radius.min(radius(frame, p[2], cos));
        cold.confidence = (cold.confidence + 1.0).min(CONFIDENCE_MAX);
        cold.seen = now;
        let ripe = !cold.stable && cold.confidence >= params.stable_sightings as f32;
        cold.stable |= ripe;
        if ripe {
            segments.ripen(surfels, m.surfel);
        } else {
            segments.follow(surfels, m.surfel);
        }
        label(frame, votes, surfels, segments, m.surfel, i);
    }
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
#[allow(clippy::too_many_arguments)]
pub(crate) fn create(
    frame: &Frame,
    pose: &Pose,
    association: &Association,
    votes: &Votes,
    bricks: &mut Bricks,
    surfels: &mut Surfels,
    segments: &mut Segments,
    params: &Params,
    now: u32,
    counts: &mut Counts,
) {
    for y in 0..frame.height {
        for x in 0..frame.width {
            let i = y * frame.width + x;
            let n = frame.normal[i];
            if n == [0.0; 3] {
                continue;
            }
            let p = frame.point(x, y);
            let cos = -dot(n, p) / dot(p, p).sqrt();
            if cos < params.min_incidence_cos {
                continue;
            }
            let position = pose.place(p);
            let ray = sub(position, pose.centre);
            let spacing = 0.75 * (frame.spacing * p[2]).max(params.min_spacing);
            if covered(frame, association, surfels, (x, y), position, ray, spacing) {
                continue;
            }
            let brick = bricks.key(position).and_then(|key| bricks.find_or_make(key));
            let hot = Hot { position, radius: radius(frame, p[2], cos), normal: pose.turn(n), segment: 0 };
            let cold = Cold { confidence: 1.0, seen: now, ..Cold::default() };
            let Some((brick, id)) =
                brick.and_then(|b| surfels.insert(hot, cold, params.max_surfels).map(|id| (b, id)))
            else {
                counts.refused += 1;
                continue;
            };
            bricks.list[brick].surfels.push(id);
            counts.created += 1;
            let segment = votes.segment_of[frame.label[i] as usize];
            if segment != 0 {
                segments.relabel(surfels, id, segment);
            }
        }
    }
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
