//! How the two times differ, kind by kind.

use super::draft::{Draft, rooms, visit};
use crate::building::{self, Dice, LABELS, Object, Plan, Support, yaw_shift};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::collections::BTreeSet;

pub(super) fn draft(kind: &'static str, k: usize, dice: &mut Dice) -> Draft {
    match kind {
        "static" => overlapping(
            dice,
            kind,
            [1, 5, 15, 1, 5, 47][k % 6],
            [0.3, 0.5, 0.8][(k / 2) % 3],
            [0.05, 0.03, 0.15][k % 3],
        ),
        "tilted" => Draft { tilted: true, ..overlapping(dice, kind, 3, 0.7, 0.05) },
        "label_noise" => {
            Draft { label_noise: [0.1, 0.2, 0.4][k % 3], ..overlapping(dice, kind, 3, 0.8, 0.05) }
        }
        "moved" => changed(dice, kind, 3 + k % 4, [0.15, 0.3, 0.45][k % 3], false),
        "rescan" => {
            let mut d = changed(dice, kind, [5, 15][k % 2], 0.12, true);
            (d.label_noise, d.frame_tilt) = (0.08, dice.within(0.1, 1.5_f64).to_radians());
            d
        }
        "no_overlap" => foreign(dice, kind, k, 0),
        "tiny_overlap" => foreign(dice, kind, k, 1 + k % 2),
        "ambiguous_twin" => twins(dice, kind, k, 0),
        "twin_distinguishable" => twins(dice, kind, k, 3 + k % 3),
        "ambiguous_symmetric" => symmetric(dice, kind, [2, 4][k % 2], 0),
        "symmetric_broken" => symmetric(dice, kind, 2, 3),
        "ambiguous_grid" => grid(dice, kind),
        "mirrored" => {
            let mut d = overlapping(dice, kind, 3, 1.0, 0.02);
            (d.mirror, d.outcome, d.extent_noise) = (true, "no_match", 0.04);
            d
        }
        "duplicates" => {
            let mut d = overlapping(dice, kind, 2, 1.0, 0.04);
            d.fragments = 0.3;
            d
        }
        "hub" => {
            let plan = Plan { kind: dice.below(5), size: [9.0, 8.0] };
            let mut objects = building::room(dice, &plan, 0, 3.0);
            objects.iter_mut().skip(1).for_each(|o| o.support = Support::On(0));
            let v = visit(dice, &plan, &Isometry3::identity(), false);
            Draft { sigma: 0.04, ..Draft::new(kind, objects, vec![v]) }
        }
        "clique" | "collinear" => formation(dice, kind),
        "shared_frame_drift" => Draft { drift: true, ..overlapping(dice, kind, 5, 0.9, 0.03) },
        _ => {
            let mut d = overlapping(dice, "empty", 1, 0.8, 0.05);
            d.outcome = "no_match";
            if k.is_multiple_of(2) {
                d.before.iter_mut().for_each(|o| *o = None);
            } else {
                let keep = 6.min(d.after.len() - 1);
                d.after.iter_mut().enumerate().filter(|(i, _)| *i != keep).for_each(|(_, o)| *o = None);
            }
            d
        }
    }
}

/// The query shows one to three rooms; the reference lacks some of their objects.
fn overlapping(dice: &mut Dice, kind: &'static str, n: usize, overlap: f64, sigma: f64) -> Draft {
    let (list, objects) = rooms(dice, n);
    let first = dice.below(n);
    let visited = if n == 1 || dice.chance(0.6) { vec![first] } else { vec![first, (first + 1) % n] };
    let visits = visited.iter().map(|&r| visit(dice, &list[r].plan, &list[r].at, false)).collect();
    let mut d = Draft::new(kind, objects, visits);
    d.sigma = sigma;
    for i in 0..d.before.len() {
        let there = d.before[i].as_ref().is_some_and(|o| visited.contains(&o.room) && !o.is_structure());
        if there && !dice.chance(overlap) {
            d.before[i] = None;
        }
    }
    d
}

/// Objects moved, left and came between reference and query.
fn changed(dice: &mut Dice, kind: &'static str, n: usize, rate: f64, gentle: bool) -> Draft {
    let (list, objects) = rooms(dice, n);
    let visited: Vec<usize> = (0..3.min(n)).collect();
    let visits = visited.iter().map(|&r| visit(dice, &list[r].plan, &list[r].at, false)).collect();
    let mut d = Draft::new(kind, objects, visits);
    d.sigma = 0.04;
    for i in 0..d.before.len() {
        let Some(o) = d.before[i].clone() else { continue };
        if !visited.contains(&o.room) || o.is_structure() || matches!(o.label, "window" | "door") {
            continue;
        }
        let removed = if gentle { 0.06 } else { 0.18 };
        if dice.chance(removed) {
            d.after[i] = None;
        } else if dice.chance(rate) {
            let room = &list[o.room];
            let mut local = room.at.inverse() * o.pose;
            let angle = dice.within(0.0, std::f64::consts::TAU);
            let far = if gentle { (dice.normal(1.1) - 2.3).exp().min(2.0) } else { dice.within(0.3, 1.8) };
            let half = room.plan.size.map(|s| s / 2.0);
            let v = &mut local.translation.vector;
            v.x = (v.x + far * angle.cos()).clamp(-half[0], half[0]);
            v.y = (v.y + far * angle.sin()).clamp(-half[1], half[1]);
            let turn = dice.normal(if gentle { 0.3 } else { 0.6 });
            local.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn) * local.rotation;
            d.after[i] = Some(Object { pose: room.at * local, ..o });
        } else if dice.chance(0.05) {
            // What was seen as one class is seen as another now.
            d.relabelled.insert(i);
        } else if dice.chance(0.07) {
            d.before[i] = None;
        }
    }
    d
}

/// The query shows rooms that the reference does not hold, but for `shared` objects.
fn foreign(dice: &mut Dice, kind: &'static str, k: usize, shared: usize) -> Draft {
    let n = [1, 5, 15, 3][k % 4];
    let (list, objects) = rooms(dice, n);
    let mut d = Draft::new(kind, objects, Vec::new());
    d.after.iter_mut().for_each(|o| *o = None);
    let visited = 1 + k % 2;
    for v in 0..visited {
        let mut plan = if k.is_multiple_of(3) { list[0].plan } else { Plan::any(dice) };
        plan.size = plan.size.map(|s| s * dice.within(0.98, 1.02));
        let at = list[v % n].at;
        let mut more = Vec::new();
        let furnished = building::room(dice, &plan, v, 1.0);
        building::place(&mut more, furnished, &at, v);
        d.visits.push(visit(dice, &plan, &at, false));
        let base = d.after.len();
        for mut o in more {
            o.support = match o.support {
                Support::On(s) => Support::On(s + base),
                Support::At(s) => Support::At(s + base),
                Support::None => Support::None,
            };
            d.after.push(Some(o));
            d.before.push(None);
        }
    }
    let mut left = shared;
    for i in 0..d.before.len() {
        let seen = d.before[i]
            .as_ref()
            .is_some_and(|o| !o.is_structure() && d.sees(&o.pose.translation.vector.into()));
        if left > 0 && seen {
            d.after[i] = d.before[i].clone();
            left -= 1;
        }
    }
    d.outcome = "no_match";
    d.tilted = k % 5 == 4;
    d.drift = k % 5 == 3;
    d
}

/// The reference holds the visited room two or three times; `distinct` objects only in the true one.
fn twins(dice: &mut Dice, kind: &'static str, k: usize, distinct: usize) -> Draft {
    let copies = if distinct > 0 { 2 } else { 2 + k % 2 };
    let (_, mut objects) = rooms(dice, 3);
    let plan = Plan::any(dice);
    let twin = building::room(dice, &plan, 3, 1.0);
    let sites: Vec<_> = (0..copies).map(|c| building::site(dice, 8 + c, 16)).collect();
    let mut marks: Vec<usize> = (0..twin.len()).filter(|&i| !twin[i].is_structure()).collect();
    dice.shuffle(&mut marks);
    let v = visit(dice, &plan, &sites[0], false);
    // Only what the query sees tells the copies apart.
    marks.retain(|&i| v.sees(&(sites[0] * twin[i].pose).translation.vector.into()));
    let marks: BTreeSet<usize> = marks.into_iter().take(distinct).collect();
    let (mut base, mut kept) = (0, Vec::new());
    for (c, at) in sites.iter().enumerate() {
        let from = objects.len();
        building::place(&mut objects, twin.clone(), at, 3 + c);
        if c == 0 {
            base = from;
        } else {
            kept.extend(marks.iter().map(|m| from + m));
        }
    }
    let n = twin.len();
    let mut d = Draft::new(kind, objects, vec![v]);
    kept.iter().for_each(|&i| d.before[i] = None);
    for i in 0..d.after.len() {
        let own = (base..base + n).contains(&i);
        if !own {
            d.after[i] = None;
        }
    }
    // Things that no copy of the reference has.
    for i in (base..base + n).filter(|i| i % 4 == 3) {
        let o = d.before[i].clone();
        if o.is_some_and(|o| !o.is_structure()) && !marks.contains(&(i - base)) {
            for c in 0..copies {
                d.before[base + c * n + (i - base)] = None;
            }
        }
    }
    d.sigma = 0.03;
    if distinct == 0 {
        d.outcome = "ambiguous";
        d.alternatives = sites.iter().map(|s| s * sites[0].inverse()).collect();
    }
    d
}

/// A room that looks the same after a part of a turn, but for `breakers` objects.
fn symmetric(dice: &mut Dice, kind: &'static str, fold: usize, breakers: usize) -> Draft {
    let (_, mut objects) = rooms(dice, 2);
    let plan = Plan { kind: dice.below(5), size: [6.0, 6.0] };
    let whole = building::room(dice, &plan, 2, 1.3);
    let at = building::site(dice, 5, 16);
    let step = std::f64::consts::TAU / fold as f64;
    let (shell, furniture): (Vec<Object>, Vec<Object>) = whole.into_iter().partition(Object::is_structure);
    let mut room = shell;
    let wanted = 24 / fold;
    for o in furniture.into_iter().filter(|o| o.pose.translation.vector.xy().norm() > 0.6).take(wanted) {
        for f in 0..fold {
            let pose = yaw_shift(step * f as f64, [0.0; 3]) * o.pose;
            room.push(Object { pose, support: Support::On(0), ..o.clone() });
        }
    }
    let orbits = (room.len() - 5) / fold;
    for _ in 0..breakers {
        let p = [dice.within(-2.0, 2.0), dice.within(-2.0, 2.0), 0.4];
        let label = LABELS[2 + dice.below(18)];
        let size = Vector3::new(dice.within(0.3, 0.8), dice.within(0.3, 0.8), 0.8);
        room.push(Object { label, pose: yaw_shift(0.0, p), size, support: Support::On(0), room: 2 });
    }
    let v = visit(dice, &plan, &at, true);
    building::place(&mut objects, room, &at, 2);
    let mut d = Draft::new(kind, objects, vec![v]);
    (d.sigma, d.extent_noise) = (0.02, 0.04);
    if breakers == 0 {
        d.outcome = "ambiguous";
        let turn = |f: usize| at * yaw_shift(step * f as f64, [0.0; 3]) * at.inverse();
        d.alternatives = (0..fold).map(turn).collect();
        // Whole orbits are new to the reference, so that the symmetry stays.
        let first = d.before.len() - orbits * fold;
        for i in (first..d.before.len()).filter(|i| ((i - first) / fold).is_multiple_of(3)) {
            d.before[i] = None;
        }
    }
    d
}

/// Equal work places on a grid; the query shows some of them.
fn grid(dice: &mut Dice, kind: &'static str) -> Draft {
    let (nx, ny, step) = (5_usize, 4_usize, [2.0, 2.4]);
    let plan = Plan { kind: 4, size: [nx as f64 * step[0], ny as f64 * step[1]] };
    let mut objects = building::shell(plan.size[0], plan.size[1], 2.6, 0);
    objects.truncate(1);
    let corner = [-plan.size[0] / 2.0 + 1.0, -plan.size[1] / 2.0 + 1.2];
    for i in 0..nx {
        for j in 0..ny {
            let (x, y) = (corner[0] + step[0] * i as f64, corner[1] + step[1] * j as f64);
            for (label, dx, dy, z, size) in [
                ("desk", 0.0, 0.0, 0.37, [1.4, 0.7, 0.74]),
                ("chair", 0.1, 0.7, 0.45, [0.5, 0.5, 0.9]),
                ("otherfurniture", -0.3, -0.1, 0.9, [0.4, 0.2, 0.3]),
            ] {
                let pose = yaw_shift(0.0, [x + dx, y + dy, z]);
                objects.push(Object {
                    label,
                    pose,
                    size: Vector3::from(size),
                    support: Support::On(0),
                    room: 0,
                });
            }
        }
    }
    let v = visit(dice, &plan, &Isometry3::identity(), true);
    let mut d = Draft::new(kind, objects, vec![v]);
    (d.sigma, d.extent_noise, d.outcome) = (0.02, 0.05, "ambiguous");
    let (at_x, at_y) = (dice.below(nx - 1), dice.below(ny - 1));
    for i in 1..d.after.len() {
        let (x, y) = ((i - 1) / 3 / ny, (i - 1) / 3 % ny);
        if !((at_x..at_x + 2).contains(&x) && (at_y..at_y + 2).contains(&y)) {
            d.after[i] = None;
        }
    }
    // The robot saw its own work places and nothing else.
    let middle = Point3::new(
        corner[0] + step[0] * (at_x as f64 + 0.5),
        corner[1] + step[1] * (at_y as f64 + 0.5),
        0.8,
    );
    d.visits[0].views = vec![middle];
    d.visits[0].range = 1.9;
    let shift = |x: usize, y: usize| {
        yaw_shift(0.0, [step[0] * (x as f64 - at_x as f64), step[1] * (y as f64 - at_y as f64), 0.0])
    };
    d.alternatives = vec![Isometry3::identity()];
    for x in 0..nx - 1 {
        d.alternatives.extend((0..ny - 1).filter(|&y| (x, y) != (at_x, at_y)).map(|y| shift(x, y)));
    }
    d
}

/// Objects of one class: scattered, or on a line.
fn formation(dice: &mut Dice, kind: &'static str) -> Draft {
    let line = kind == "collinear";
    let n = if line { 10 } else { 14 };
    let mut x = -2.5;
    let mut objects = Vec::new();
    for _ in 0..n {
        x += dice.within(0.3, 1.0);
        let p = if line { [x, 0.0, 0.5] } else { [dice.within(-2.5, 2.5), dice.within(-2.0, 2.0), 0.5] };
        let label = if line { LABELS[2 + dice.below(18)] } else { "chair" };
        let size = Vector3::new(0.5, 0.5, 0.9);
        objects.push(Object { label, pose: yaw_shift(0.0, p), size, support: Support::None, room: 0 });
    }
    let plan = Plan { kind: 4, size: [12.0, 12.0] };
    let v = visit(dice, &plan, &Isometry3::identity(), true);
    let mut d = Draft::new(kind, objects, vec![v]);
    (d.sigma, d.extent_noise, d.edges) = (if line { 0.03 } else { 0.01 }, 0.05, false);
    let dropped = if line { 3 } else { 2 };
    d.after.iter_mut().take(dropped).for_each(|o| *o = None);
    d
}
