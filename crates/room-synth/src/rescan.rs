//! What happens to a room between two scans, and what `3RScan.json` says about it.

use crate::builder::{Builder, FLOOR};
use crate::catalogue;
use crate::layout::Layout;
use crate::openings::swung;
use crate::relations::Contact;
use crate::rng::Draw;
use crate::room::{Geometry, Instance, Scan};
use crate::shapes::Family;
use crate::split::Split;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use scan3r::rooms::AmbiguousPair;
use scan3r::{RigidList, RigidMove, ScanEntry, Transform16};
use std::collections::{BTreeMap, BTreeSet};

/// Labels of which new ones turn up in rescans, by weight.
const NEWCOMERS: &[(&str, f32)] = &[
    ("box", 3.0),
    ("pillow", 1.5),
    ("item", 2.0),
    ("bag", 1.5),
    ("object", 1.2),
    ("chair", 1.6),
    ("clothes", 1.2),
    ("towel", 0.7),
    ("plant", 0.6),
    ("backpack", 0.5),
    ("basket", 0.5),
    ("stool", 0.4),
    ("blanket", 0.4),
    ("bottle", 0.4),
    ("lamp", 0.3),
    ("trash can", 0.3),
    ("shoes", 0.4),
    ("table", 0.2),
];

/// The frame of the reference scan: its own origin and yaw.
pub(crate) fn reference_from_room(draw: &mut Draw) -> Isometry3<f64> {
    let yaw = f64::from(draw.range(-std::f32::consts::PI, std::f32::consts::PI));
    let t = Translation3::new(
        f64::from(draw.range(-1.5, 1.5)),
        f64::from(draw.range(-1.5, 1.5)),
        f64::from(draw.range(-0.1, 0.1)),
    );
    Isometry3::from_parts(t, UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw))
}

/// Rescan to reference: yaw anywhere, a metre off, a little tilted.
pub(crate) fn reference_from_rescan(draw: &mut Draw) -> Isometry3<f64> {
    let yaw = std::f32::consts::PI * draw.unit().powf(1.65) * if draw.chance(0.5) { 1.0 } else { -1.0 };
    let tilt = (0.73 * (0.85 * draw.normal()).exp()).min(8.0).to_radians();
    let about = draw.range(0.0, std::f32::consts::TAU);
    let far = (1.0 * (0.98 * draw.normal()).exp()).min(7.0);
    let way = draw.range(0.0, std::f32::consts::TAU);
    let t = Vector3::new(far * way.cos(), far * way.sin(), 0.12 * draw.normal());
    let axis =
        nalgebra::Unit::new_normalize(Vector3::new(f64::from(about.cos()), f64::from(about.sin()), 0.0));
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(yaw))
        * UnitQuaternion::from_axis_angle(&axis, f64::from(tilt));
    Isometry3::from_parts(Translation3::from(t.cast::<f64>()), rotation)
}

/// A rescan and its entry.
pub(crate) struct Rescan {
    pub(crate) scan: Scan,
    pub(crate) entry: ScanEntry,
}

/// Changes a room. `next_id` goes on over the rescans of a room.
pub(crate) fn rescan(
    layout: &Layout,
    reference: &Scan,
    id: String,
    split: Split,
    mut draw: Draw,
    next_id: &mut u32,
) -> Rescan {
    let frame = reference_from_rescan(&mut draw);
    let mut b = Builder::resume(draw, split, layout, *next_id);
    let removed = remove(&mut b);
    let mut before: BTreeMap<u32, Isometry3<f32>> =
        b.out.iter().map(|i| (i.id, i.room_from_object)).collect();
    shift_all(&mut b);
    let moved: BTreeMap<u32, Isometry3<f32>> = b.out.iter().map(|i| (i.id, i.room_from_object)).collect();
    let nonrigid = deform(&mut b);
    newcomers(&mut b);
    overlook(&mut b, &before);
    *next_id = b.next_id;
    let scan_from_room = frame.inverse() * reference.scan_from_room;
    let room_from_reference = reference.scan_from_room.inverse();
    let mut moves = Vec::new();
    for i in &b.out {
        let (Some(old), Some(new)) = (before.remove(&i.id), moved.get(&i.id)) else { continue };
        if old == *new {
            continue;
        }
        let motion = new.cast::<f64>() * old.cast::<f64>().inverse();
        moves.push(RigidMove {
            instance_reference: i.id,
            instance_rescan: i.id,
            symmetry: i.symmetry,
            transform: Transform16::from_isometry(&(scan_from_room * motion * room_from_reference)),
        });
    }
    let entry = ScanEntry {
        id: id.clone(),
        transform: Some(Transform16::from_isometry(&frame)),
        rigid: RigidList::Moves(moves),
        removed: Some(removed),
        nonrigid: Some(nonrigid),
    };
    Rescan { scan: Scan { id, scan_from_room, instances: b.out }, entry }
}

fn rates(i: &Instance) -> [f32; 3] {
    match i.label {
        "door" => [0.088, 0.0, 0.0],
        "curtain" => [0.0, 0.0, 0.3],
        "shower curtain" => [0.0, 0.0, 0.35],
        "blinds" => [0.0, 0.0, 0.18],
        label => catalogue::find(label).map_or([0.0; 3], |k| k.change),
    }
}

fn remove(b: &mut Builder) -> Vec<u32> {
    let parents: BTreeSet<u32> = b.out.iter().flat_map(|i| i.supports.iter().map(|s| s.parent)).collect();
    // Now and then somebody tidies up.
    let mood = [0.45, 0.9, 5.5][b.draw.weighted([0.6, 0.32, 0.08].into_iter())];
    let gone: Vec<u32> = b
        .out
        .iter()
        .map(|i| (i.id, rates(i)[1]))
        .collect::<Vec<_>>()
        .into_iter()
        .filter(|(id, rate)| b.draw.chance(rate * mood * REMOVE_SCALE) && !parents.contains(id))
        .map(|(id, _)| id)
        .collect();
    b.out.retain(|i| !gone.contains(&i.id));
    for id in &gone {
        b.vacate(*id);
    }
    gone
}

/// Removal only takes what carries nothing, so the rate of the others is a little higher.
const REMOVE_SCALE: f32 = 1.5;
/// Some moves find no free place.
const MOVE_SCALE: f32 = 1.08;

fn shift_all(b: &mut Builder) {
    let mood = [0.4, 0.9, 1.25, 1.9][b.draw.weighted([0.12, 0.4, 0.33, 0.15].into_iter())];
    for id in b.out.iter().map(|i| i.id).collect::<Vec<_>>() {
        let Some(i) = b.out.iter().find(|i| i.id == id).cloned() else { continue };
        if b.draw.chance((rates(&i)[0] * mood * MOVE_SCALE).min(0.95)) {
            shift(b, &i);
        }
    }
}

/// A turn in radians, by the quantiles of real moves.
fn turn(draw: &mut Draw) -> f32 {
    let edges =
        [[0.0, 5.0], [5.0, 15.0], [15.0, 30.0], [30.0, 60.0], [60.0, 90.0], [90.0, 135.0], [135.0, 180.0]];
    let [low, high] = edges[draw.weighted([0.25, 0.235, 0.125, 0.13, 0.085, 0.08, 0.095].into_iter())];
    let angle = draw.range(low, high).to_radians();
    if draw.chance(0.5) { angle } else { -angle }
}

/// Turns and shifts one object to where it fits, and takes along what would fall off.
fn shift(b: &mut Builder, i: &Instance) {
    let old = i.room_from_object;
    let children = descendants(&b.out, i.id);
    let mut ignore: Vec<u32> = children.clone();
    ignore.push(i.id);
    ignore.extend(i.supports.iter().map(|s| s.parent));
    ignore.extend(b.overlapping(i.id));
    let mut angle = turn(&mut b.draw);
    for attempt in 0..24 {
        if i.label == "door" {
            let left = b.draw.chance(0.5);
            let angle = b.draw.range(0.05, 1.3);
            let pose = swung(&old, i.size()[0], angle, left);
            apply(b, i, &children, pose);
            return;
        }
        if attempt % 6 == 5 {
            angle *= 0.5;
        }
        let wide = if angle.abs() < 0.0873 { 1.0 } else { 2.2 };
        let far =
            (0.112 * wide * (0.95 * b.draw.normal()).exp()).min(2.5) * if attempt > 12 { 0.5 } else { 1.0 };
        let way = b.draw.range(0.0, std::f32::consts::TAU);
        let t = old.translation.vector + Vector3::new(far * way.cos(), far * way.sin(), 0.0);
        let pose = Isometry3::from_parts(
            t.into(),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle) * old.rotation,
        );
        if stays_supported(b, i, &pose) && b.fits(&pose, i.size(), &ignore, -0.01).is_some() {
            apply(b, i, &children, pose);
            return;
        }
    }
}

/// Whether the base is still over what carries it.
fn stays_supported(b: &Builder, i: &Instance, pose: &Isometry3<f32>) -> bool {
    let Some(support) = i.supports.first() else { return false };
    if support.parent == FLOOR {
        return true;
    }
    let Some(p) = b.out.iter().find(|p| p.id == support.parent) else { return false };
    if !(support.contact.carries() || matches!(support.contact, Contact::StandingIn | Contact::LyingIn)) {
        return false;
    }
    let [w, d, _] = p.size();
    let at = p.room_from_object.inverse() * Point3::from(pose.translation.vector);
    at.x.abs() < w * 0.45 && at.y.abs() < d * 0.45
}

fn apply(b: &mut Builder, i: &Instance, children: &[u32], pose: Isometry3<f32>) {
    let motion = pose * i.room_from_object.inverse();
    b.set_pose(i.id, pose);
    for &c in children {
        let Some(child) = b.out.iter().find(|k| k.id == c).cloned() else { continue };
        let direct = child.parent() == Some(i.id);
        let Some(parent) = b.out.iter().find(|k| Some(k.id) == child.parent()).cloned() else { continue };
        let [w, d, _] = parent.size();
        let at = parent.room_from_object.inverse() * Point3::from(child.room_from_object.translation.vector);
        let safe = at.x.abs() < w * 0.38 && at.y.abs() < d * 0.38;
        let inside = child
            .supports
            .iter()
            .any(|s| matches!(s.contact, Contact::StandingIn | Contact::LyingIn | Contact::BuiltIn));
        if !(direct && safe && !inside) {
            b.set_pose(c, motion * child.room_from_object);
        }
    }
}

fn descendants(all: &[Instance], id: u32) -> Vec<u32> {
    let mut out = vec![];
    let mut front = vec![id];
    while let Some(p) = front.pop() {
        for i in all.iter().filter(|i| i.parent() == Some(p)) {
            out.push(i.id);
            front.push(i.id);
        }
    }
    out
}

/// Cloth and leaves take another form where they are.
fn deform(b: &mut Builder) -> Vec<u32> {
    let mut out = Vec::new();
    for k in 0..b.out.len() {
        let rate = rates(&b.out[k])[2];
        if rate > 0.0 && b.draw.chance((1.45 * rate).min(0.7)) {
            let detail = b.draw.word();
            let narrower = b.draw.range(0.6, 1.0);
            let i = &mut b.out[k];
            if let Geometry::Shape(s) = &mut i.geometry {
                s.detail = detail;
                // A curtain is drawn, a blind pulled up.
                match s.family {
                    Family::Curtain => s.size[0] *= narrower,
                    Family::Blinds => {
                        let low = s.size[2] * (1.0 - narrower);
                        s.size[2] *= narrower;
                        i.room_from_object.translation.z += low;
                    }
                    _ => {}
                }
                out.push(i.id);
            }
        }
    }
    out
}

fn newcomers(b: &mut Builder) {
    let mean = [0.7, 3.2, 7.5][b.draw.weighted([0.55, 0.37, 0.08].into_iter())];
    for _ in 0..b.draw.poisson(mean) {
        let label = NEWCOMERS[b.draw.weighted(NEWCOMERS.iter().map(|n| n.1))].0;
        b.place(label);
    }
}

/// A rescan covers less: one side of the room is not annotated, though it is there.
fn overlook(b: &mut Builder, known: &BTreeMap<u32, Isometry3<f32>>) {
    let share = 0.8 * b.draw.unit().powf(2.3);
    let way = b.draw.range(0.0, std::f32::consts::TAU);
    let mut order: Vec<(f32, usize)> = (0..b.out.len())
        .filter(|&k| b.out[k].id != FLOOR && known.contains_key(&b.out[k].id))
        .map(|k| {
            let t = b.out[k].oriented_box().pose.translation;
            (t.x * way.cos() + t.y * way.sin() + 0.8 * b.draw.normal(), k)
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let n = (share * order.len() as f32) as usize;
    for &(_, k) in order.iter().take(n) {
        b.out[k].annotated = false;
    }
}

/// Groups of copies of one model, as pairs from the first of each group.
pub(crate) fn ambiguity(reference: &Scan) -> Vec<Vec<AmbiguousPair>> {
    let mut groups: BTreeMap<u64, Vec<&Instance>> = BTreeMap::new();
    for i in reference.instances.iter().filter(|i| i.annotated) {
        groups.entry(i.model).or_default().push(i);
    }
    let frame = reference.scan_from_room;
    groups
        .values()
        .filter(|g| g.len() > 1 && g[0].size()[2] > 0.35 && g[0].model % 8 < 6)
        .map(|g| {
            let source = g[0];
            g[1..]
                .iter()
                .map(|target| {
                    let motion = target.room_from_object.cast::<f64>()
                        * source.room_from_object.cast::<f64>().inverse();
                    AmbiguousPair {
                        instance_source: source.id,
                        instance_target: target.id,
                        transform: Transform16::from_isometry(&(frame * motion * frame.inverse())),
                    }
                })
                .collect()
        })
        .collect()
}
