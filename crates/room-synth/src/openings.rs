//! Doors and windows: holes in walls, and what hangs in and before them.

use crate::builder::{Builder, FLOOR};
use crate::layout::fixed;
use crate::relations::Contact;
use crate::room::{Geometry, Support};
use crate::shapes::Family;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Free stretch of the wall at both sides of a hole, metres.
const MARGIN: f32 = 0.12;

/// A stretch of some wall where a hole of that width and height range is free.
fn cut(b: &mut Builder, width: f32, low: f32, high: f32) -> Option<()> {
    for _ in 0..12 {
        let k = b.draw.below(b.plan.walls.len());
        let room = b.plan.walls[k].length() - width - 2.0 * MARGIN;
        if b.plan.walls[k].open || room < 0.0 {
            continue;
        }
        let from = MARGIN + room * b.draw.unit();
        let hole = [from, from + width, low, high];
        if b.plan.walls[k].holes.iter().all(|h| hole[1] + MARGIN < h[0] || h[1] + MARGIN < hole[0]) {
            b.plan.walls[k].holes.push(hole);
            return Some(());
        }
    }
    None
}

fn count(b: &mut Builder, mean: f32) -> usize {
    b.draw.poisson(mean).min(4)
}

/// Holes for doors; a person must be able to stand before them.
pub(crate) fn doors(b: &mut Builder, mean: f32) {
    for _ in 0..count(b, mean) {
        let [w, _, h] = b.fresh(Family::Door, [0.84, 0.1, 1.98], 0.2).size;
        let w = if b.draw.chance(0.12) { 1.6 * w } else { w };
        let h = (h * 0.97).clamp(1.4, b.plan.height - 0.08);
        if cut(b, w, 0.0, h).is_some()
            && let Some((pose, line_thick)) = last_hole(b, w)
        {
            let front = pose * Translation3::new(0.0, 0.35 + line_thick / 2.0, 1.0);
            b.keep_free(&front, [w / 2.0, 0.35, 0.95]);
        }
    }
}

/// The pose of the middle of the newest hole of that width, on the floor.
fn last_hole(b: &Builder, w: f32) -> Option<(Isometry3<f32>, f32)> {
    let line =
        b.plan.walls.iter().rev().find(|l| l.holes.last().is_some_and(|h| (h[1] - h[0] - w).abs() < 1e-4))?;
    let h = line.holes.last()?;
    Some((line.pose((h[0] + h[1]) / 2.0, -line.thickness / 2.0, 0.0, 0.0), line.thickness))
}

/// Holes for windows.
pub(crate) fn windows(b: &mut Builder, mean: f32) {
    for _ in 0..count(b, mean) {
        let [w, _, h] = b.fresh(Family::Window, [1.1, 0.1, 1.15], 0.34).size;
        // Some reach the floor.
        let (low, h) =
            if b.draw.chance(0.2) { (b.draw.range(0.02, 0.3), 2.1) } else { (b.draw.range(0.7, 1.15), h) };
        let high = (low + h).min(b.plan.height - b.draw.range(0.05, 0.3));
        cut(b, w, low, high);
    }
}

/// Doors and windows into the holes, and sills, curtains, blinds and heaters before them.
pub(crate) fn fill(b: &mut Builder) {
    for k in 0..b.plan.walls.len() {
        for hole in b.plan.walls[k].holes.clone() {
            if hole[2] == 0.0 {
                door(b, k, hole);
            } else {
                window(b, k, hole);
            }
        }
    }
}

fn door(b: &mut Builder, k: usize, [from, to, _, high]: [f32; 4]) {
    let (line, wall) = (b.plan.walls[k].clone(), b.wall_ids[k]);
    let middle = (from + to) / 2.0;
    let mut parent = Support {
        parent: wall,
        contact: if b.draw.chance(0.75) { Contact::HangingOn } else { Contact::AttachedTo },
    };
    let mut bar = 0.0;
    if b.draw.chance(0.45) {
        let depth = line.thickness + 0.03;
        let mut shape = b.fresh(Family::DoorFrame, [to - from, depth, high], 0.0);
        shape.size = [to - from, depth, high];
        bar = 0.06;
        let pose = line.pose(middle, -line.thickness + 0.005, depth, 0.0);
        let supports = vec![
            Support { parent: FLOOR, contact: Contact::StandingOn },
            Support { parent: wall, contact: Contact::AttachedTo },
        ];
        let id = b.add("doorframe", Geometry::Shape(shape), pose, supports, 0.7);
        if b.draw.chance(0.8) {
            let contact = if b.draw.chance(0.8) { Contact::BelongingTo } else { Contact::AttachedTo };
            parent = Support { parent: id, contact };
        }
    }
    if !b.draw.chance(0.94) {
        return; // A passage.
    }
    let mut shape = b.fresh(Family::Door, [1.0, 0.06, 1.0], 0.3);
    let size = [to - from - 2.0 * bar - 0.01, shape.size[1], high - bar - 0.01];
    shape.size = size;
    let closed = line.pose(middle, -0.06, size[1], 0.005);
    let pose = if b.draw.chance(0.45) { swing(b, &closed, size[0]) } else { closed };
    b.add("door", Geometry::Shape(shape), pose, vec![parent], 0.7);
}

/// A door turned about its hinge, out of the room.
pub(crate) fn swing(b: &mut Builder, closed: &Isometry3<f32>, width: f32) -> Isometry3<f32> {
    let angle = b.draw.range(0.25, 1.4);
    swung(closed, width, angle, b.draw.chance(0.5))
}

/// `closed` turned outwards by an angle about its left or right edge.
pub(crate) fn swung(closed: &Isometry3<f32>, width: f32, angle: f32, left: bool) -> Isometry3<f32> {
    let x = if left { -width / 2.0 } else { width / 2.0 };
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), if left { -angle } else { angle });
    closed * Translation3::new(x, 0.0, 0.0) * turn * Translation3::new(-x, 0.0, 0.0)
}

fn window(b: &mut Builder, k: usize, [from, to, low, high]: [f32; 4]) {
    let (line, wall) = (b.plan.walls[k].clone(), b.wall_at(k, (low + high) / 2.0));
    let middle = (from + to) / 2.0;
    let (w, h) = (to - from, high - low);
    let mut shape = b.fresh(Family::Window, [w, 0.08, h], 0.0);
    shape.size = [w, line.thickness.min(b.draw.range(0.04, 0.16)), h];
    let depth = shape.size[1];
    let contact = if b.draw.chance(0.85) { Contact::AttachedTo } else { Contact::SupportedBy };
    let back = line.thickness.min(depth + b.draw.range(0.0, 0.08));
    let pose = line.pose(middle, -back, depth, low);
    let id = b.add("window", Geometry::Shape(shape), pose, vec![Support { parent: wall, contact }], 0.35);
    if low > 0.5 && b.draw.chance(0.36) {
        let mut sill = b.fresh(Family::Sill, [w + 0.1, 0.24, 0.04], 0.2);
        sill.size[0] = w + 0.1;
        let d = sill.size[1];
        let pose = line.pose(middle, 0.002, d, (low - sill.size[2]).max(0.1));
        fixed(
            b,
            "windowsill",
            Geometry::Shape(sill),
            pose,
            vec![Support { parent: wall, contact: Contact::AttachedTo }],
            0.8,
            &[],
        );
    }
    cover(b, k, id, [from, to, low, high]);
    if low > 0.5 && b.draw.chance(0.42) {
        heater(b, k, middle, low);
    }
}

fn heater(b: &mut Builder, k: usize, u: f32, below: f32) {
    let (line, wall) = (b.plan.walls[k].clone(), b.wall_ids[k]);
    let label = if b.draw.chance(0.65) { "heater" } else { "radiator" };
    let Some(kind) = crate::catalogue::find(label) else { return };
    let (mut shape, _) = b.shape(kind, None);
    shape.size[2] = shape.size[2].min(below - 0.2);
    let d = shape.size[1];
    if b.draw.chance(0.65) {
        let pose = line.pose(u, 0.02, d, 0.12);
        fixed(
            b,
            label,
            Geometry::Shape(shape),
            pose,
            vec![Support { parent: wall, contact: Contact::ConnectedTo }],
            0.85,
            &[],
        );
    } else {
        let pose = line.pose(u, 0.02, d, 0.0);
        fixed(
            b,
            label,
            Geometry::Shape(shape),
            pose,
            vec![Support { parent: FLOOR, contact: Contact::StandingOn }],
            0.85,
            &[],
        );
    }
}

/// Curtains or blinds. What is quite hidden is not annotated.
fn cover(b: &mut Builder, k: usize, window: u32, [from, to, low, high]: [f32; 4]) {
    let (line, wall) = (b.plan.walls[k].clone(), b.wall_at(k, high));
    let w = to - from;
    let hang = vec![Support { parent: wall, contact: Contact::HangingOn }];
    match b.draw.weighted([0.36, 0.14, 0.16, 0.34].into_iter()) {
        0 => {
            let top = (high + b.draw.range(0.05, 0.25)).min(b.plan.height - 0.02);
            let bottom = if b.draw.chance(0.6) { b.draw.range(0.02, 0.12) } else { low - 0.1 };
            let cover = b.draw.range(0.25, 0.5);
            for side in [-1.0, 1.0] {
                let [cw, d, _] = b.fresh(Family::Curtain, [w * cover, 0.12, 1.0], 0.15).size;
                let mut shape = b.fresh(Family::Curtain, [cw, d, top - bottom], 0.0);
                shape.size = [cw, d, top - bottom];
                let u = (from + to) / 2.0 + side * (w / 2.0 + 0.1 - cw / 2.0);
                let pose =
                    line.pose(u.clamp(cw / 2.0, (line.length() - cw / 2.0).max(cw / 2.0)), 0.14, d, bottom);
                fixed(b, "curtain", Geometry::Shape(shape), pose, hang.clone(), 0.6, &[]);
            }
        }
        1 => {
            let mut shape = b.fresh(Family::Curtain, [w + 0.2, 0.12, high - low + 0.3], 0.1);
            shape.size[2] = shape.size[2].min(b.plan.height - low);
            shape.size[0] = shape.size[0].min(line.length());
            let [cw, d, ch] = shape.size;
            let pose = line.pose(
                ((from + to) / 2.0).clamp(cw / 2.0, (line.length() - cw / 2.0).max(cw / 2.0)),
                0.1,
                d,
                (high + 0.1).min(b.plan.height) - ch,
            );
            if fixed(b, "curtain", Geometry::Shape(shape), pose, hang, 0.6, &[]).is_some()
                && let Some(i) = b.out.iter_mut().find(|i| i.id == window)
            {
                i.annotated = false;
            }
        }
        2 => {
            let part = b.draw.range(0.3, 1.0);
            let mut shape = b.fresh(Family::Blinds, [w, 0.06, (high - low) * part], 0.0);
            shape.size = [w * 0.98, 0.05, (high - low) * part];
            let pose = line.pose((from + to) / 2.0, 0.005, 0.05, high - shape.size[2]);
            let supports = if b.draw.chance(0.75) {
                hang
            } else {
                vec![Support { parent: window, contact: Contact::Cover }]
            };
            fixed(b, "blinds", Geometry::Shape(shape), pose, supports, 0.7, &[]);
        }
        _ => {}
    }
}
