//! A draft as the two robots see it: nodes with noise, relations, and the cells that were looked at.

use super::draft::Draft;
use crate::building::{Dice, LABELS, Object, PREDICATES, Support};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use std::collections::BTreeSet;

pub(super) const CELL: f64 = 0.5;

/// A node as it is written.
pub(super) struct Seen {
    pub object: usize,
    pub id: u64,
    pub label: &'static str,
    pub centroid: Point3<f64>,
    pub extent: Vector3<f64>,
    pub score: f64,
    pub loose: bool,
}

fn aabb(pose: &Isometry3<f64>, size: &Vector3<f64>) -> (Point3<f64>, Vector3<f64>) {
    let extent = pose.rotation.to_rotation_matrix().matrix().abs() * size;
    (pose.translation.vector.into(), extent)
}

/// The part of a wall or floor that satisfies a test, as a smaller box; `None` without one.
fn part(o: &Object, sees: impl Fn(&Point3<f64>) -> bool) -> Option<Object> {
    let (mut lo, mut hi) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
    let steps = |s: f64| (s / 0.25).ceil().max(1.0) as usize;
    for i in 0..steps(o.size.x) {
        for j in 0..steps(o.size.y) {
            for k in 0..steps(o.size.z) {
                let f = |n: usize, s: f64| ((n as f64 + 0.5) / steps(s) as f64 - 0.5) * s;
                let p = Vector3::new(f(i, o.size.x), f(j, o.size.y), f(k, o.size.z));
                if sees(&(o.pose * Point3::from(p))) {
                    let half = o.size.zip_map(&Vector3::repeat(0.25), f64::min) / 2.0;
                    (lo, hi) = (lo.inf(&(p - half)), hi.sup(&(p + half)));
                }
            }
        }
    }
    (lo.x < hi.x).then(|| {
        let pose =
            o.pose * Isometry3::translation((lo.x + hi.x) / 2.0, (lo.y + hi.y) / 2.0, (lo.z + hi.z) / 2.0);
        Object { pose, size: hi - lo, ..o.clone() }
    })
}

pub(super) fn centre(nodes: &[Seen]) -> Point3<f64> {
    let sum = nodes.iter().fold(Vector3::zeros(), |s, n| s + n.centroid.coords);
    Point3::from(sum / nodes.len().max(1) as f64)
}

fn node(
    dice: &mut Dice,
    d: &Draft,
    object: usize,
    o: &Object,
    frame: &Isometry3<f64>,
    id: u64,
    wrong: f64,
) -> Seen {
    let (c, e) = aabb(&(frame * o.pose), &o.size);
    let mut noisy = |s: f64| Vector3::new(dice.normal(s), dice.normal(s), dice.normal(s));
    let centroid = c + noisy(d.sigma);
    let extent = e.component_mul(&noisy(d.extent_noise).map(|v| (1.0 + v).max(0.3)));
    let misread = !o.is_structure() && dice.chance(wrong);
    let label = if misread { LABELS[2 + dice.below(18)] } else { o.label };
    let score = if misread { dice.within(0.3, 0.7) } else { dice.within(0.6, 0.98) };
    Seen { object, id, label, centroid, extent, score, loose: false }
}

/// The reference's nodes; ids are taken off the end of a list.
pub(super) fn reference_nodes(
    dice: &mut Dice,
    d: &Draft,
    reference_from_domain: &Isometry3<f64>,
    ids: &mut Vec<u64>,
) -> Vec<Seen> {
    let there = d.before.iter().enumerate().filter_map(|(i, o)| Some((i, o.as_ref()?)));
    there.map(|(i, o)| node(dice, d, i, o, reference_from_domain, ids.pop().unwrap_or(0), 0.0)).collect()
}

/// The query's nodes: objects whose centre was seen, and the seen part of walls and floors.
pub(super) fn query_nodes(
    dice: &mut Dice,
    d: &Draft,
    query_from_domain: &Isometry3<f64>,
    cells: &BTreeSet<[i32; 3]>,
    ids: &mut Vec<u64>,
) -> Vec<Seen> {
    let seen = |p: &Point3<f64>| cells.contains(&cell_of(&(query_from_domain * p)));
    let mut out = Vec::new();
    for (i, o) in d.after.iter().enumerate() {
        let Some(o) = o else { continue };
        let shown = if o.is_structure() && d.kind != "hub" {
            part(o, seen)
        } else {
            seen(&o.pose.translation.vector.into()).then(|| o.clone())
        };
        let Some(mut shown) = shown else { continue };
        if d.mirror {
            shown.pose.translation.vector.x = -shown.pose.translation.vector.x;
            let yaw = shown.pose.rotation.euler_angles().2;
            shown.pose.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw);
        }
        let pieces = if !shown.is_structure() && dice.chance(d.fragments) { 2 } else { 1 };
        for piece in 0..pieces {
            let mut o = shown.clone();
            if pieces == 2 {
                let shift = o.size.x * (0.22 - 0.44 * f64::from(piece));
                o.pose *= Translation3::new(shift, 0.0, 0.0);
                o.size.x *= 0.56;
            }
            let id = ids.pop().unwrap_or(0);
            let mut n = node(dice, d, i, &o, query_from_domain, id, d.label_noise);
            if d.relabelled.contains(&i) {
                n.label = LABELS[2 + dice.below(18)];
            }
            n.loose = o.is_structure();
            out.push(n);
        }
    }
    out
}

/// The cell that holds a point.
pub(super) fn cell_of(p: &Point3<f64>) -> [i32; 3] {
    [p.x, p.y, p.z].map(|v| (v / CELL).floor() as i32)
}

pub(super) fn nodes(list: &[Seen]) -> Vec<Value> {
    let round = |v: f64| (v * 1e4).round() / 1e4;
    let three = |v: &[f64]| v.iter().map(|x| round(*x)).collect::<Vec<_>>();
    list.iter()
        .map(|n| {
            json!({"id": n.id, "label": n.label, "score": round(n.score),
                "centroid": three(n.centroid.coords.as_slice()), "extent": three(n.extent.as_slice())})
        })
        .collect()
}

pub(super) fn edges(dice: &mut Dice, d: &Draft, objects: &[Option<Object>], list: &[Seen]) -> Vec<Value> {
    let (drop, wrong, spurious) = if d.edges { (0.25, 0.08, 0.05) } else { (1.0, 0.0, 0.0) };
    let of = |object: usize| list.iter().find(|n| n.object == object).map(|n| n.id);
    let mut out = Vec::new();
    for n in list {
        let Some(Some(o)) = objects.get(n.object) else { continue };
        let (k, p) = match o.support {
            Support::None => continue,
            Support::On(k) => (k, if dice.chance(0.7) { 0 } else { 1 }),
            Support::At(k) => (k, 2 + dice.below(2)),
        };
        let Some(t) = of(k).filter(|t| *t != n.id) else { continue };
        let p = if dice.chance(wrong) { dice.below(7) } else { p };
        if !dice.chance(drop) {
            out.push(json!({"s": n.id, "t": t, "p": PREDICATES[p]}));
        }
        let other = &list[dice.below(list.len())];
        if dice.chance(spurious) && other.id != n.id && other.id != t {
            out.push(json!({"s": n.id, "t": other.id, "p": PREDICATES[dice.below(7)]}));
        }
    }
    dice.shuffle(&mut out);
    out
}

/// Cells of the query frame whose middle was seen.
pub(super) fn cells(d: &Draft, query_from_domain: &Isometry3<f64>) -> BTreeSet<[i32; 3]> {
    let back = query_from_domain.inverse();
    let mut out = BTreeSet::new();
    for v in &d.visits {
        let domain_from_room = v.room_from_domain.inverse();
        let reach = v.half[0].hypot(v.half[1]) + 1.5;
        let middle = query_from_domain * (domain_from_room * Point3::new(0.0, 0.0, 1.3));
        let span = |c: f64| ((c - reach) / CELL).floor() as i32..=((c + reach) / CELL).ceil() as i32;
        for i in span(middle.x) {
            for j in span(middle.y) {
                for k in span(middle.z) {
                    let p =
                        Point3::new(f64::from(i), f64::from(j), f64::from(k)).coords.add_scalar(0.5) * CELL;
                    if d.sees(&(back * Point3::from(p))) {
                        out.insert([i, j, k]);
                    }
                }
            }
        }
    }
    out
}
