//! The world as a data set: determinism, transforms, relations.

#![allow(clippy::unwrap_used, reason = "a test")]

use nalgebra::{Isometry3, Point3};
use proptest::prelude::*;
use room_synth::{Geometry, Split, World, WorldParams, stats};
use scan3r::{Dataset as _, Relation, Transform16};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

fn world(split: Split, seed: u64, rooms: usize) -> World {
    World::new(split, seed, rooms, &WorldParams::default())
}

fn isometry(t: &Transform16) -> Isometry3<f64> {
    t.isometry(Path::new("generated"), "transform").unwrap()
}

#[test]
fn bytes_do_not_depend_on_threads_and_small_worlds_are_prefixes() {
    let make = |threads: usize, rooms: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let w = world(Split::Test, 5, rooms);
            let scan = w.generated()[2].scans[1].id.clone();
            let frames: Vec<_> = w.frames(&scan, 1).unwrap().take(12).map(|f| f.unwrap()).collect();
            let depth: Vec<u32> = frames.iter().flat_map(|f| f.depth.iter().map(|d| d.to_bits())).collect();
            let poses: Vec<_> = frames.iter().map(|f| f.world_from_camera).collect();
            (w.rooms()[..3].to_vec(), w.annotation(&scan).unwrap(), w.relations(&scan).unwrap(), depth, poses)
        })
    };
    let (a, b) = (make(1, 3), make(3, 6));
    assert!(a == b);
    assert_ne!(world(Split::Test, 6, 1).rooms(), world(Split::Test, 5, 1).rooms());
    assert_ne!(world(Split::Train, 5, 1).rooms()[0].reference, a.0[0].reference);
}

#[test]
fn visits_differ_but_the_world_stays() {
    let w = world(Split::Train, 5, 1);
    let id = &w.rooms()[0].reference;
    let pose = |visit| w.frames(id, visit).unwrap().nth(5).unwrap().unwrap().world_from_camera;
    assert_ne!(pose(0), pose(1));
    assert_eq!(pose(1), pose(1));
    assert!(w.frames("no such scan", 0).is_err());
}

#[test]
fn scan_ids_are_uuids_and_unique() {
    let w = world(Split::Validation, 1, 30);
    let mut seen = BTreeSet::new();
    for room in w.rooms() {
        assert_eq!(room.split, "validation");
        for id in std::iter::once(&room.reference).chain(room.scans.iter().map(|s| &s.id)) {
            assert!(seen.insert(id.clone()), "{id}");
            assert_eq!(id.split('-').map(str::len).collect::<Vec<_>>(), [8, 4, 4, 4, 12]);
            assert!(id.chars().all(|c| c == '-' || c.is_ascii_hexdigit()));
        }
    }
}

#[test]
fn shape_parameters_belong_to_their_split() {
    for split in [Split::Train, Split::Validation, Split::Test] {
        for room in world(split, 2, 20).generated() {
            for i in room.scans.iter().flat_map(|s| &s.instances) {
                if let Geometry::Shape(s) = &i.geometry {
                    assert!(s.style.iter().all(|&p| Split::owner(p) == split), "{} {:?}", i.label, s.style);
                }
            }
        }
    }
}

#[test]
fn transforms_carry_what_stayed_onto_itself_and_moves_to_their_place() {
    let w = world(Split::Train, 9, 30);
    let (mut stayed, mut moved) = (0, 0);
    for room in w.generated() {
        for (entry, scan) in room.entry.scans.iter().zip(&room.scans[1..]) {
            let reference_from_rescan = isometry(entry.transform.as_ref().unwrap());
            let moves: BTreeMap<u32, Isometry3<f64>> =
                entry.rigid.moves().iter().map(|m| (m.instance_reference, isometry(&m.transform))).collect();
            let changed = entry.nonrigid.as_ref().unwrap();
            for i in &scan.instances {
                let Some(old) = room.scans[0].instance(i.id) else { continue };
                if changed.contains(&i.id) {
                    continue;
                }
                let before = room.scans[0].oriented_box(old).pose.cast::<f64>();
                let after = scan.oriented_box(i).pose.cast::<f64>();
                let expected = match moves.get(&i.id) {
                    Some(rigid) => rigid * before,
                    None => reference_from_rescan.inverse() * before,
                };
                assert!(
                    (expected.translation.vector - after.translation.vector).norm() < 2e-4,
                    "{}",
                    i.label
                );
                assert!(expected.rotation.angle_to(&after.rotation) < 2e-3, "{}", i.label);
                if moves.contains_key(&i.id) { moved += 1 } else { stayed += 1 }
            }
            for id in entry.removed.as_ref().unwrap() {
                assert!(room.scans[0].instance(*id).is_some() && scan.instance(*id).is_none());
            }
        }
    }
    assert!(stayed > 500 && moved > 60, "{stayed} {moved}");
}

#[test]
fn annotated_points_of_a_moved_object_move_with_it() {
    let w = world(Split::Train, 9, 6);
    let mut checked = 0;
    for room in w.generated() {
        let before = w.annotation(&room.scans[0].id).unwrap();
        for (entry, scan) in room.entry.scans.iter().zip(&room.scans[1..]) {
            for m in entry.rigid.moves() {
                let Some(i) = scan.instance(m.instance_rescan) else { continue };
                let b = scan.oriented_box(i);
                let rigid: Isometry3<f32> = isometry(&m.transform).cast();
                let points = before.points.iter().zip(&before.instances).filter(|(_, k)| **k == i.id);
                for (p, _) in points.step_by(17) {
                    let q: Point3<f32> = b.pose.inverse() * (rigid * p);
                    let inside = (0..3).all(|k| q[k].abs() < b.half[k] + 0.02);
                    assert!(inside || entry.nonrigid.as_ref().unwrap().contains(&i.id), "{} {q}", i.label);
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 300, "{checked}");
}

fn relations_hold(relations: &[Relation], ids: &BTreeSet<u32>) {
    let set: BTreeSet<&Relation> = relations.iter().collect();
    assert_eq!(set.len(), relations.len(), "no relation twice");
    let has = |subject, object, predicate: &str| {
        set.contains(&Relation { subject, object, predicate: predicate.to_owned() })
    };
    let inverse = [
        ("left", "right"),
        ("right", "left"),
        ("front", "behind"),
        ("behind", "front"),
        ("higher than", "lower than"),
        ("lower than", "higher than"),
        ("bigger than", "smaller than"),
        ("smaller than", "bigger than"),
        ("same as", "same as"),
        ("close by", "close by"),
        ("same symmetry as", "same symmetry as"),
    ];
    for r in relations {
        assert!(ids.contains(&r.subject) && ids.contains(&r.object) && r.subject != r.object, "{r:?}");
        assert!(scan3r::LabelSet::L160.predicates().contains(&r.predicate.as_str()), "{r:?}");
        match inverse.iter().find(|(p, _)| *p == r.predicate) {
            Some((_, q)) => assert!(has(r.object, r.subject, q), "{r:?} without its inverse"),
            None => assert!(!has(r.object, r.subject, &r.predicate), "{r:?} goes one way"),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn any_seed_gives_sound_rooms(seed in any::<u64>(), split in prop::sample::select(vec![Split::Train, Split::Validation, Split::Test])) {
        let w = world(split, seed, 2);
        for room in w.generated() {
            for scan in &room.scans {
                let ids: BTreeSet<u32> = scan.instances.iter().filter(|i| i.annotated).map(|i| i.id).collect();
                prop_assert!(scan.instances.windows(2).all(|p| p[0].id < p[1].id), "ids ascend");
                relations_hold(&w.relations(&scan.id).unwrap(), &ids);
                for i in &scan.instances {
                    prop_assert!(i.size().iter().all(|s| s.is_finite() && *s > 0.0));
                    prop_assert!(i.supports.iter().all(|s| s.parent != i.id && s.parent > 0), "{} {:?}", i.label, i.supports);
                }
            }
            let a = w.annotation(&room.entry.reference).unwrap();
            prop_assert_eq!(a.points.len(), a.instances.len());
            prop_assert!(a.points.len() > 2000);
        }
    }
}

#[test]
fn the_statistics_are_those_of_real_rooms() {
    let w = world(Split::Train, 1, 200);
    let figures = stats::stats(&w, 6).unwrap();
    assert!(figures.misses().is_empty(), "{figures}");
}
