//! Candidate poses where gravity is unknown: a pair fixes all but the turn about itself, and the
//! other objects vote for that turn.

use super::index::{BIN, Index, Item};
use super::{RobustParams, Work, vote};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

/// Shortest base pair, metres: a short one fixes its direction badly.
const SHORTEST: f32 = 1.0;
/// Largest difference of distances, metres.
const GATE: f32 = 0.3;
/// Objects nearer than this to the axis say nothing about the turn, metres.
const LEVER: f32 = 0.5;
/// Bins of the turn about the axis.
const TURNS: usize = 24;
/// Objects of the query of which base pairs are made.
const MOST_OBJECTS: usize = 600;
/// Base pairs of the reference that are tried.
const MOST_BASES: usize = 3000;

struct Candidate {
    score: f32,
    pose: Isometry3<f32>,
}

/// Poses by falling support, no two of them alike, at most `params.peaks`.
pub(super) fn poses(
    index: &Index,
    query: &[Item],
    params: &RobustParams,
    work: &mut Work,
) -> Vec<Isometry3<f32>> {
    let mut found = Vec::new();
    let mut bases = 0;
    for (_, [i, j]) in base_pairs(index, query, params) {
        let (a, b) = (&query[i], &query[j]);
        for (ra, rb) in matching_pairs(index, a, b, params, work) {
            bases += 1;
            if let Some(c) = best_turn(index, query, [i, j], &ra, &rb, params, work) {
                found.push(c);
            }
            if work.exhausted || bases >= MOST_BASES {
                return distinct(found, query, params.peaks);
            }
        }
    }
    distinct(found, query, params.peaks)
}

fn distinct(mut found: Vec<Candidate>, query: &[Item], count: usize) -> Vec<Isometry3<f32>> {
    found.sort_by(|a, b| {
        let key = |c: &Candidate| c.pose.translation.vector;
        let (p, q) = (key(a), key(b));
        let places = (0..3).map(|k| p[k].total_cmp(&q[k])).find(|o| o.is_ne());
        b.score.total_cmp(&a.score).then(places.unwrap_or(std::cmp::Ordering::Equal))
    });
    let centre = vote::centre(query);
    let mut out: Vec<Isometry3<f32>> = Vec::new();
    for c in found {
        if out.len() == count {
            break;
        }
        let known = |o: &Isometry3<f32>| {
            (o * centre - c.pose * centre).norm() < 0.6 && o.rotation.angle_to(&c.pose.rotation) < 0.3
        };
        if !out.iter().any(known) {
            out.push(c.pose);
        }
    }
    out
}

/// Query pairs, those of rare labels first.
fn base_pairs(index: &Index, query: &[Item], params: &RobustParams) -> Vec<(f32, [usize; 2])> {
    let mut out = Vec::new();
    let query = &query[..query.len().min(MOST_OBJECTS)];
    for i in 0..query.len() {
        for j in i + 1..query.len() {
            if (SHORTEST..params.pair_range).contains(&(query[i].p - query[j].p).norm()) {
                out.push((index.share(query[i].label) * index.share(query[j].label), [i, j]));
            }
        }
    }
    out.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    out
}

fn alike(a: &Item, b: &Item) -> bool {
    a.label == b.label && (a.size.all - b.size.all).abs() < 0.8
}

/// Reference pairs with the labels and the distance of a query pair, in the order of their content.
fn matching_pairs(
    index: &Index,
    a: &Item,
    b: &Item,
    params: &RobustParams,
    work: &mut Work,
) -> Vec<(Item, Item)> {
    let d = (b.p - a.p).norm();
    let (first, second) = if a.label <= b.label { (a, b) } else { (b, a) };
    let mut out = Vec::new();
    let reach = ((d + GATE) / BIN) as i32 + 1;
    for x in 0..=reach.min((params.pair_range / BIN) as i32) {
        for z in -reach..=reach {
            // The bin's nearest and farthest corner.
            let (zl, zh) = (z as f32 * BIN, (z + 1) as f32 * BIN);
            let nearest = (x as f32 * BIN).hypot(if z >= 0 { zl } else { zh });
            let farthest = ((x + 1) as f32 * BIN).hypot(if z >= 0 { zh } else { zl });
            if nearest > d + GATE || farthest < d - GATE {
                continue;
            }
            let list = index.pairs([first.label, second.label], x, z);
            if !work.spend(1 + list.len() as u64) {
                return out;
            }
            for &[ra, rb] in list {
                let (Some(ra), Some(rb)) = (index.item(ra), index.item(rb)) else { continue };
                let (ra, rb) = if a.label <= b.label { (ra, rb) } else { (rb, ra) };
                if ((rb.p - ra.p).norm() - d).abs() < GATE && alike(a, ra) && alike(b, rb) {
                    out.push((*ra, *rb));
                }
            }
        }
    }
    out.sort_by(|p, q| p.0.order(&q.0).then(p.1.order(&q.1)));
    out
}

/// Lays the query pair onto the reference pair and turns it to where most other objects meet one of
/// their label.
fn best_turn(
    index: &Index,
    query: &[Item],
    [i, j]: [usize; 2],
    ra: &Item,
    rb: &Item,
    params: &RobustParams,
    work: &mut Work,
) -> Option<Candidate> {
    let (a, b) = (query[i].p, query[j].p);
    let axis = Unit::try_new(rb.p - ra.p, 1e-6)?;
    let onto = UnitQuaternion::rotation_between(&(b - a), &axis).or_else(|| {
        // Opposite directions: half a turn about anything perpendicular.
        let across = Unit::try_new(axis.cross(&Vector3::x()), 1e-3)
            .or_else(|| Unit::try_new(axis.cross(&Vector3::y()), 1e-3))?;
        Some(UnitQuaternion::from_axis_angle(&across, std::f32::consts::PI))
    })?;
    let (from, to) = (nalgebra::center(&a, &b), nalgebra::center(&ra.p, &rb.p));
    let split = |v: &Vector3<f32>| {
        let along = v.dot(&axis);
        (along, v - axis.into_inner() * along)
    };
    // (label, distance along the axis, vector from it) of the reference's surroundings.
    let mut there = Vec::new();
    index.near(&Point3::from(to.coords), params.pair_range, |_, r| {
        if r.id != ra.id && r.id != rb.id {
            let (along, away) = split(&(r.p - to));
            if away.norm() > LEVER {
                there.push((*r, along, away));
            }
        }
    });
    there.sort_by(|x, y| x.0.order(&y.0));
    let mut votes = [0.0_f32; TURNS];
    for (k, q) in query.iter().enumerate().filter(|(k, _)| *k != i && *k != j) {
        let (along, away) = split(&(onto * (q.p - from)));
        let reach = away.norm();
        if reach < LEVER || (q.p - from).norm() > params.pair_range {
            continue;
        }
        if !work.spend(there.len() as u64 / 4 + 1) {
            return None;
        }
        let weight = -index.share(query[k].label).ln();
        let mut hit = [false; TURNS];
        for (r, r_along, r_away) in &there {
            if alike(q, r) && (along - r_along).abs() < GATE && (reach - r_away.norm()).abs() < GATE {
                let turn = axis.dot(&away.cross(r_away)).atan2(away.dot(r_away));
                let t = (turn / std::f32::consts::TAU * TURNS as f32).rem_euclid(TURNS as f32) as usize;
                hit[t.min(TURNS - 1)] = true;
            }
        }
        (0..TURNS).filter(|&t| hit[t]).for_each(|t| votes[t] += weight);
    }
    let around = |t: usize| votes[(t + TURNS - 1) % TURNS] + votes[t] + votes[(t + 1) % TURNS];
    let best = (0..TURNS).max_by(|&x, &y| around(x).total_cmp(&around(y)).then(y.cmp(&x)))?;
    let score = around(best);
    // The mean turn of the three bins.
    let lean = if score > 0.0 {
        (votes[(best + 1) % TURNS] - votes[(best + TURNS - 1) % TURNS]) / score
    } else {
        0.0
    };
    let turn = (best as f32 + 0.5 + lean) / TURNS as f32 * std::f32::consts::TAU;
    let rotation = UnitQuaternion::from_axis_angle(&axis, turn) * onto;
    let pose = Isometry3::from_parts(Translation3::from(to.coords - rotation * from.coords), rotation);
    (score > 0.0).then_some(Candidate { score, pose })
}
