//! Alignment cases with truth, in the format `align-case/2`: what a solver may see and what a scorer
//! needs. They imitate the kinds of the public set from seeds of their own, for tuning and benches.

use crate::building::{self, Dice, LABELS, Object, PREDICATES, Plan, Support, yaw_shift};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

const CELL: f64 = 0.5;

/// Kinds in the order in which they are written.
pub const KINDS: [&str; 19] = [
    "static",
    "tilted",
    "label_noise",
    "moved",
    "rescan",
    "no_overlap",
    "tiny_overlap",
    "ambiguous_twin",
    "twin_distinguishable",
    "ambiguous_symmetric",
    "symmetric_broken",
    "ambiguous_grid",
    "mirrored",
    "duplicates",
    "hub",
    "clique",
    "collinear",
    "shared_frame_drift",
    "empty",
];

/// A case and its truth.
pub struct Case {
    /// Name.
    pub id: String,
    /// `cases/<id>.json`.
    pub case: Value,
    /// `truth/<id>.json`.
    pub truth: Value,
}

/// A room that the query's robot walked through.
struct Visit {
    room_from_domain: Isometry3<f64>,
    half: [f64; 2],
    views: Vec<Point3<f64>>,
    range: f64,
    /// Points of the room on the positive side are not looked at.
    cut: (Vector3<f64>, f64),
}

impl Visit {
    fn sees(&self, p: &Point3<f64>) -> bool {
        let q = self.room_from_domain * p;
        q.x.abs() < self.half[0] + 0.35
            && q.y.abs() < self.half[1] + 0.35
            && (-0.3..3.0).contains(&q.z)
            && self.views.iter().any(|v| (v - q).norm() < self.range)
            && self.cut.0.dot(&q.coords) < self.cut.1
    }
}

/// Both times of a place, before noise and frames.
struct Draft {
    kind: &'static str,
    /// Object `i` when the reference was made, and when the query was.
    before: Vec<Option<Object>>,
    after: Vec<Option<Object>>,
    visits: Vec<Visit>,
    sigma: f64,
    extent_noise: f64,
    label_noise: f64,
    tilted: bool,
    frame_tilt: f64,
    drift: bool,
    mirror: bool,
    outcome: &'static str,
    /// `domain_from_domain` of every equally good place.
    alternatives: Vec<Isometry3<f64>>,
    edges: bool,
    fragments: f64,
    relabelled: BTreeSet<usize>,
}

impl Draft {
    fn new(kind: &'static str, objects: Vec<Object>, visits: Vec<Visit>) -> Self {
        Self {
            kind,
            before: objects.iter().cloned().map(Some).collect(),
            after: objects.into_iter().map(Some).collect(),
            visits,
            sigma: 0.05,
            extent_noise: 0.1,
            label_noise: 0.0,
            tilted: false,
            frame_tilt: 0.0,
            drift: false,
            mirror: false,
            outcome: "match",
            alternatives: Vec::new(),
            edges: true,
            fragments: 0.0,
            relabelled: BTreeSet::new(),
        }
    }

    fn sees(&self, p: &Point3<f64>) -> bool {
        self.visits.iter().any(|v| v.sees(p))
    }
}

struct Room {
    plan: Plan,
    at: Isometry3<f64>,
}

fn rooms(dice: &mut Dice, n: usize) -> (Vec<Room>, Vec<Object>) {
    let mut list = Vec::new();
    let mut objects = Vec::new();
    for k in 0..n {
        let plan = Plan::any(dice);
        let furnished = building::room(dice, &plan, k, 1.0);
        let at = building::site(dice, k, n);
        building::place(&mut objects, furnished, &at, k);
        list.push(Room { plan, at });
    }
    (list, objects)
}

fn visit(dice: &mut Dice, plan: &Plan, at: &Isometry3<f64>, whole: bool) -> Visit {
    let half = [plan.size[0] / 2.0, plan.size[1] / 2.0];
    let n = 2 + dice.below(2);
    let mut view =
        || Point3::new(dice.within(-half[0], half[0]) * 0.8, dice.within(-half[1], half[1]) * 0.8, 1.5);
    let views = (0..n).map(|_| view()).collect();
    let angle = dice.within(0.0, std::f64::consts::TAU);
    let normal = Vector3::new(angle.cos(), angle.sin(), 0.0);
    let reach = half[0] * normal.x.abs() + half[1] * normal.y.abs();
    let cut = (normal, if whole { 100.0 } else { reach * dice.within(0.45, 1.1) });
    let range = if whole { 20.0 } else { dice.within(4.0, 6.5) };
    Visit { room_from_domain: at.inverse(), half, views, range, cut }
}

/// Cases of a kind; `k` counts within the kind and picks its parameters.
#[must_use]
pub fn make(kind: &'static str, seed: u64, k: usize) -> Case {
    let number = KINDS.iter().position(|n| *n == kind).unwrap_or(0) as u64;
    let mut dice = Dice::new(seed << 20 | number << 12 | k as u64);
    let d = draft(kind, k, &mut dice);
    finish(&mut dice, d, format!("{seed:x}-{number:02}-{k:03}"))
}

fn draft(kind: &'static str, k: usize, dice: &mut Dice) -> Draft {
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

/// A node as it is written.
struct Seen {
    object: usize,
    id: u64,
    label: &'static str,
    centroid: Point3<f64>,
    extent: Vector3<f64>,
    score: f64,
    loose: bool,
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

fn finish(dice: &mut Dice, d: Draft, id: String) -> Case {
    let tau = std::f64::consts::TAU;
    let mut any = |tilt: bool, quarter: bool| {
        let yaw = if quarter { dice.below(4) as f64 * tau / 4.0 } else { dice.within(0.0, tau) };
        let f = yaw_shift(yaw, [dice.within(-20.0, 20.0), dice.within(-20.0, 20.0), dice.within(-1.0, 1.0)]);
        if !tilt {
            return f;
        }
        let axis = Vector3::new(dice.normal(1.0), dice.normal(1.0), dice.normal(1.0));
        f * UnitQuaternion::new(axis.normalize() * dice.within(0.6, 3.0))
    };
    let quarter = any(false, true);
    let other = any(false, false);
    let mut query_from_domain = any(d.tilted, false);
    let reference_from_domain = if dice.chance(0.5) { quarter } else { other };
    let tilt = Vector3::new(dice.normal(1.0), dice.normal(1.0), 0.0).normalize() * d.frame_tilt;
    query_from_domain *= UnitQuaternion::new(tilt);

    let cells = cells(&d, &query_from_domain);
    let cell_of = |p: &Point3<f64>| [p.x, p.y, p.z].map(|v| (v / CELL).floor() as i32);
    let seen_domain = |p: &Point3<f64>| cells.contains(&cell_of(&(query_from_domain * p)));

    let mut ids: Vec<u64> =
        (0..4 * (d.before.len() as u64 + d.after.len() as u64) + 8).map(|v| v + 100).collect();
    dice.shuffle(&mut ids);
    let mut next = || ids.pop().unwrap_or(0);
    let mut reference = Vec::new();
    for (i, o) in d.before.iter().enumerate() {
        if let Some(o) = o {
            let n = node(dice, &d, i, o, &reference_from_domain, next(), 0.0);
            reference.push(n);
        }
    }
    let mut query = Vec::new();
    for (i, o) in d.after.iter().enumerate() {
        let Some(o) = o else { continue };
        let shown = if o.is_structure() && d.kind != "hub" {
            part(o, seen_domain)
        } else {
            seen_domain(&o.pose.translation.vector.into()).then(|| o.clone())
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
                o.pose *= nalgebra::Translation3::new(shift, 0.0, 0.0);
                o.size.x *= 0.56;
            }
            let mut n = node(dice, &d, i, &o, &query_from_domain, next(), d.label_noise);
            if d.relabelled.contains(&i) {
                n.label = LABELS[2 + dice.below(18)];
            }
            n.loose = o.is_structure();
            query.push(n);
        }
    }
    let reference_from_query = reference_from_domain * query_from_domain.inverse();
    let truth = truth(
        &d,
        &query,
        &reference,
        &cells,
        &reference_from_query,
        &reference_from_domain,
        &query_from_domain,
    );
    let edges_q = edges(dice, &d, &d.after, &query);
    let edges_r = edges(dice, &d, &d.before, &reference);
    dice.shuffle(&mut query);
    dice.shuffle(&mut reference);
    let mut case = json!({
        "schema": "align-case/2", "id": id, "gravity_aligned": !d.tilted,
        "query": {"nodes": nodes(&query), "edges": edges_q},
        "reference": {"nodes": nodes(&reference), "edges": edges_r},
        "seen_query": {"cell": CELL, "origin": [0.0, 0.0, 0.0], "cells": cells.iter().collect::<Vec<_>>()},
    });
    if d.drift {
        let at = centre(&query);
        let error = nalgebra::Translation3::from(at.coords)
            * yaw_shift(
                dice.within(-5.0, 5.0_f64).to_radians(),
                [dice.normal(0.3), dice.normal(0.3), dice.normal(0.05)],
            )
            * nalgebra::Translation3::from(-at.coords);
        case["T_ref_query_prior"] = json!(row_major(&(reference_from_query * error)));
    }
    let kind = d.kind;
    Case {
        truth: json!({"id": id, "kind": kind, "tolerance": {"rot_deg": 5.0, "trans_m": 0.3}, "truth": truth}),
        id,
        case,
    }
}

fn centre(nodes: &[Seen]) -> Point3<f64> {
    let sum = nodes.iter().fold(Vector3::zeros(), |s, n| s + n.centroid.coords);
    Point3::from(sum / nodes.len().max(1) as f64)
}

fn row_major(t: &Isometry3<f64>) -> Vec<f64> {
    t.to_homogeneous().transpose().as_slice().to_vec()
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

fn nodes(list: &[Seen]) -> Vec<Value> {
    let round = |v: f64| (v * 1e4).round() / 1e4;
    let three = |v: &[f64]| v.iter().map(|x| round(*x)).collect::<Vec<_>>();
    list.iter()
        .map(|n| {
            json!({"id": n.id, "label": n.label, "score": round(n.score),
                "centroid": three(n.centroid.coords.as_slice()), "extent": three(n.extent.as_slice())})
        })
        .collect()
}

fn edges(dice: &mut Dice, d: &Draft, objects: &[Option<Object>], list: &[Seen]) -> Vec<Value> {
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
fn cells(d: &Draft, query_from_domain: &Isometry3<f64>) -> BTreeSet<[i32; 3]> {
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

fn truth(
    d: &Draft,
    query: &[Seen],
    reference: &[Seen],
    cells: &BTreeSet<[i32; 3]>,
    reference_from_query: &Isometry3<f64>,
    reference_from_domain: &Isometry3<f64>,
    query_from_domain: &Isometry3<f64>,
) -> Value {
    let back = reference_from_query.inverse();
    let cell = |p: &Point3<f64>| [p.x, p.y, p.z].map(|v| (v / CELL).floor() as i32);
    // (seen, clearly so or clearly not)
    let looked = |r: &Seen| {
        let c = cell(&(back * r.centroid));
        let own = cells.contains(&c);
        let even = (0..3).all(|k| {
            [-1, 1].iter().all(|s| {
                let mut n = c;
                n[k] += s;
                cells.contains(&n) == own
            })
        });
        (own, even)
    };
    let mut by_object: BTreeMap<usize, Vec<&Seen>> = BTreeMap::new();
    query.iter().for_each(|q| by_object.entry(q.object).or_default().push(q));
    let (mut matches, mut moved, mut optional, mut loose) = (vec![], vec![], vec![], vec![]);
    let (mut removed, mut unseen, mut borderline) = (vec![], vec![], vec![]);
    let nothing = d.outcome == "no_match";
    for r in reference {
        let counterparts: &[&Seen] =
            if nothing { &[] } else { by_object.get(&r.object).map_or(&[], Vec::as_slice) };
        let place = |list: &[Option<Object>]| list[r.object].as_ref().map(|o| o.pose.translation.vector);
        let shift = match (place(&d.before), place(&d.after)) {
            (Some(a), Some(b)) => (a - b).norm(),
            _ => 0.0,
        };
        let (own, even) = looked(r);
        for q in counterparts {
            let pair = json!([q.id, r.id]);
            if shift < 0.1 {
                matches.push(pair.clone());
                if q.loose {
                    loose.push(pair);
                }
            } else if shift < 0.3 || !(own && even) {
                optional.push(pair);
            } else {
                moved.push(pair);
            }
        }
        if counterparts.is_empty() {
            let structure = d.before[r.object].as_ref().is_some_and(Object::is_structure);
            if nothing {
                unseen.push(r.id);
            } else if structure || !even {
                borderline.push(r.id);
            } else if own {
                removed.push(r.id);
            } else {
                unseen.push(r.id);
            }
        }
    }
    let known: BTreeSet<usize> = reference.iter().map(|r| r.object).collect();
    let added: Vec<u64> =
        query.iter().filter(|q| nothing || !known.contains(&q.object)).map(|q| q.id).collect();
    let alternatives: Vec<Value> = d
        .alternatives
        .iter()
        .map(|a| {
            let t = reference_from_domain * a * query_from_domain.inverse();
            json!({"T_ref_query": row_major(&t), "matches": []})
        })
        .collect();
    json!({
        "outcome": d.outcome,
        "T_ref_query": if nothing { Value::Null } else { json!(row_major(reference_from_query)) },
        "matches": matches, "moved": moved, "moved_optional": optional, "removed": removed,
        "unseen": unseen, "borderline": borderline, "added": added, "relabelled": [], "loose": loose,
        "alternatives": alternatives, "same_object_pairs": [],
    })
}
