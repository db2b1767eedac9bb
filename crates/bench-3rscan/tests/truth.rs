//! Truth of a hand-made room: a reference scan and rescans, one case per object.

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use bench_3rscan::layout::{Placement, place};
use bench_3rscan::scenario::Scenario;
use bench_3rscan::truth::{Reading, SeenScans, Truth, TruthNode, build, states};
use bench_3rscan::{Seen, Surface};
use common::{Tiny, block, rescan, room};
use graph_align::{Box3, PredicateId, Vocabulary};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use scan3r::{
    Annotation, Dataset as _, Frame, Intrinsics, LabelSet, Relation, RigidList, RigidMove, Transform16,
};
use std::collections::BTreeSet;

/// id, raw label, points in the scan's frame, depth samples that fall on it.
type Thing = (u32, &'static str, Vec<Point3<f32>>, usize);

/// Ends a scan: annotation and relations of the data set, and what a visit saw of it.
struct Scan {
    annotation: Annotation,
    relations: Vec<Relation>,
    samples: Vec<Point3<f32>>,
}

fn scan(things: Vec<Thing>, relations: &[(u32, u32, &str)]) -> Scan {
    let mut annotation = Annotation::default();
    let mut samples = Vec::new();
    for (id, raw, points, n) in things {
        annotation.labels.insert(id, raw.to_owned());
        annotation.instances.extend(vec![id; points.len()]);
        // Every vertex is hit again and again, until the samples are used up.
        samples.extend(points.iter().cycle().take(n).copied());
        annotation.points.extend(points);
    }
    let relations = relations
        .iter()
        .map(|&(subject, object, p)| Relation { subject, object, predicate: p.to_owned() })
        .collect();
    Scan { annotation, relations, samples }
}

/// Depth images of one pixel each: a camera 1 m in front of every sample.
fn look(s: &Scan) -> Seen {
    let surface = Surface::new(s.annotation.clone());
    let mut seen = Seen::new(&surface);
    let intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0, 1, 1).unwrap();
    for p in &s.samples {
        let pose = Isometry3::translation(p.x, p.y, p.z - 1.0);
        let frame =
            Frame { index: 0, time: 0.0, depth: vec![1.0], intrinsics, world_from_camera: Some(pose) };
        seen.observe(&surface, &frame);
    }
    seen.finish(&surface);
    seen
}

struct Room {
    data: Tiny,
    seen: SeenScans,
    placements: Vec<Placement>,
}

impl Room {
    fn new(reference: Scan, rescans: Vec<(scan3r::ScanEntry, Scan)>) -> Self {
        let mut data = Tiny::default();
        let mut seen = SeenScans::new();
        let (entries, scans): (Vec<_>, Vec<_>) = rescans.into_iter().unzip();
        let ids = std::iter::once("ref".to_owned()).chain(entries.iter().map(|e| e.id.clone()));
        for (id, s) in ids.zip(std::iter::once(reference).chain(scans)) {
            seen.insert(id.clone(), look(&s));
            data.scans.insert(id, (s.annotation, s.relations, 1));
        }
        data.rooms.push(room("ref", entries));
        let placements = place(&data, 1, 3.0, 1).unwrap();
        // A yaw far from a multiple of 90 degrees, so that frames cannot be mixed up unseen.
        let yaw = placements[0].domain_from_reference.rotation.euler_angles().2.abs().to_degrees() % 90.0;
        assert!((10.0..80.0).contains(&yaw), "{yaw}");
        Self { data, seen, placements }
    }

    fn truth(&self, scenario: Scenario) -> Truth {
        self.with(scenario, LabelSet::L20).0
    }

    fn with(&self, scenario: Scenario, labels: LabelSet) -> (Truth, Vocabulary) {
        let v =
            Vocabulary::new(labels.classes().iter().copied(), labels.predicates().iter().copied()).unwrap();
        (
            build(&self.data, &self.placements, &self.seen, scenario, Reading::Accumulated, labels, &v)
                .unwrap(),
            v,
        )
    }

    /// The box of points of the reference frame, in the domain.
    fn box_of(&self, points: &[Point3<f32>]) -> Box3 {
        let t = self.placements[0].domain_from_reference;
        let all = bench_3rscan::layout::bounds(points.iter().map(|p| t * p)).unwrap();
        Box3::new(nalgebra::center(&all.0, &all.1).coords.into(), (all.1 - all.0).into()).unwrap()
    }
}

fn node(t: &Truth, id: u64) -> Option<&TruthNode> {
    t.nodes.iter().find(|n| n.id == id)
}

fn close(a: &Box3, b: &Box3) -> bool {
    (a.centroid() - b.centroid()).norm() < 1e-3 && (a.extent() - b.extent()).norm() < 1e-3
}

fn moved(points: &[Point3<f32>], t: &Isometry3<f32>) -> Vec<Point3<f32>> {
    points.iter().map(|p| t * p).collect()
}

const FLOOR: u32 = 1;
const TABLE: u32 = 2;
const CHAIR: u32 = 3;
const SOFA: u32 = 4;
const BED: u32 = 5;
const DESK: u32 = 6;
const PILLOW: u32 = 7;
const SINK: u32 = 8;

fn floor() -> Thing {
    (FLOOR, "floor", block([2.0, 2.0, 0.0], [4.0, 3.0, 0.0]), 60_000)
}

fn table() -> Vec<Point3<f32>> {
    block([1.0, 1.0, 0.5], [1.2, 0.3, 0.0])
}

fn chair() -> Vec<Point3<f32>> {
    block([3.0, 1.0, 0.5], [0.5, 0.4, 0.0])
}

/// Reference: floor, table, chair, sofa, bed, pillow, and a sink that 60 samples hit. The rescan
/// stands 90 degrees turned in a frame of its own: the chair moved, the sofa is listed as removed,
/// the bed is not annotated but not removed either, a desk is new.
fn two_scans() -> (Room, Isometry3<f32>, Isometry3<f32>) {
    let sofa = (SOFA, "sofa", block([2.0, 3.0, 0.4], [1.0, 0.5, 0.0]), 5_000);
    let bed = (BED, "bed", block([1.0, 2.5, 0.4], [0.9, 0.6, 0.0]), 5_000);
    let pillow = (PILLOW, "pillow", block([1.0, 2.5, 0.7], [0.3, 0.3, 0.0]), 2_000);
    let sink = (SINK, "sink", block([3.5, 3.0, 0.8], [0.3, 0.3, 0.0]), 60);
    let things = vec![
        floor(),
        (TABLE, "table", table(), 5_000),
        (CHAIR, "chair", chair(), 5_000),
        sofa,
        bed,
        pillow,
        sink,
    ];
    let reference = scan(
        things,
        &[
            (CHAIR, FLOOR, "standing on"),
            (CHAIR, FLOOR, "supported by"),
            (CHAIR, FLOOR, "close by"),
            (TABLE, FLOOR, "standing on"),
            (TABLE, CHAIR, "left"),
            (SOFA, FLOOR, "standing on"),
            (BED, FLOOR, "standing on"),
            (PILLOW, BED, "lying on"),
            (SINK, FLOOR, "attached to"),
        ],
    );
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f32::consts::FRAC_PI_2);
    let reference_from_rescan = Isometry3::from_parts(Translation3::new(1.0, -2.0, 0.25), quarter);
    let rescan_from_reference = reference_from_rescan.inverse();
    // In the reference frame the chair goes 1 m along y and turns by 45 degrees.
    let centre = Vector3::new(3.0, 1.0, 0.5);
    let eighth = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f32::consts::FRAC_PI_4);
    let motion = Isometry3::from_parts(Translation3::from(centre + Vector3::y()), eighth)
        * Isometry3::from_parts(Translation3::from(-centre), UnitQuaternion::identity());
    let there = |p: &[Point3<f32>]| moved(p, &rescan_from_reference);
    let (id, raw, points, n) = floor();
    let things = vec![
        (id, raw, there(&points), n),
        (TABLE, "table", there(&table()), 5_000),
        (CHAIR, "chair", there(&moved(&chair(), &motion)), 5_000),
        (DESK, "desk", there(&block([1.0, 3.0, 0.6], [0.6, 0.4, 0.0])), 5_000),
    ];
    let relations = [(CHAIR, FLOOR, "supported by"), (TABLE, FLOOR, "part of"), (DESK, FLOOR, "standing on")];
    let entry = scan3r::ScanEntry {
        transform: Some(Transform16::from_isometry(&reference_from_rescan.cast())),
        rigid: RigidList::Moves(vec![RigidMove {
            instance_reference: CHAIR,
            instance_rescan: CHAIR,
            symmetry: 0,
            transform: Transform16::from_isometry(&(rescan_from_reference * motion).cast()),
        }]),
        removed: Some(vec![SOFA]),
        ..rescan("again")
    };
    (Room::new(reference, vec![(entry, scan(things, &relations))]), motion, reference_from_rescan)
}

#[test]
fn static_truth_is_the_reference_scan() {
    let (room, ..) = two_scans();
    let t = room.truth(Scenario::Scp);
    let ids: Vec<u64> = t.nodes.iter().filter(|n| !n.ignore).map(|n| n.id).collect();
    assert_eq!(ids, [FLOOR, TABLE, CHAIR, SOFA, BED].map(u64::from));
    // Clutter and what 60 samples hit stay as nodes that do not count.
    assert!(node(&t, PILLOW.into()).unwrap().ignore && node(&t, PILLOW.into()).unwrap().label.is_none());
    assert!(node(&t, SINK.into()).unwrap().ignore && node(&t, SINK.into()).unwrap().label.is_some());
    let c = &t.counts;
    assert_eq!((c.nodes, c.left_out), (5, 1));
    assert_eq!((c.unchanged, c.moved, c.removed, c.changed, c.added), (5, 0, 0, 0, 0));
    assert!(close(&node(&t, TABLE.into()).unwrap().bounds, &room.box_of(&table())));
}

#[test]
fn dynamic_truth_is_each_object_as_last_annotated() {
    let (room, motion, _) = two_scans();
    let t = room.truth(Scenario::Ldcp);
    let ids: Vec<u64> = t.nodes.iter().filter(|n| !n.ignore).map(|n| n.id).collect();
    assert_eq!(ids, [FLOOR, TABLE, CHAIR, BED, DESK].map(u64::from));
    let c = &t.counts;
    assert_eq!((c.unchanged, c.moved, c.removed, c.changed, c.added), (3, 1, 1, 0, 1), "{c:?}");
    let b = |id: u32| node(&t, id.into()).unwrap().bounds;
    assert!(close(&b(CHAIR), &room.box_of(&moved(&chair(), &motion))), "{:?}", b(CHAIR));
    assert!(close(&b(TABLE), &room.box_of(&table())));
    assert!(
        close(&b(BED), &room.box_of(&block([1.0, 2.5, 0.4], [0.9, 0.6, 0.0]))),
        "absence is no removal: {:?} {:?}",
        b(BED),
        room.box_of(&block([1.0, 2.5, 0.4], [0.9, 0.6, 0.0]))
    );
}

/// The other readings, on the same scans: the last scan's instances; the reference's, less what was removed, where
/// they stood.
#[test]
fn other_readings_of_the_truth() {
    let (room, _, _) = two_scans();
    let labels = LabelSet::L20;
    let v = Vocabulary::new(labels.classes().iter().copied(), labels.predicates().iter().copied()).unwrap();
    let with = |r| build(&room.data, &room.placements, &room.seen, Scenario::Ldcp, r, labels, &v).unwrap();
    let ids = |t: &Truth| t.nodes.iter().filter(|n| !n.ignore).map(|n| n.id as u32).collect::<BTreeSet<_>>();
    let (all, last, reference) =
        (with(Reading::Accumulated), with(Reading::LastScan), with(Reading::ReferenceMinusRemoved));
    assert_eq!(ids(&all), BTreeSet::from([FLOOR, TABLE, CHAIR, BED, DESK]));
    assert_eq!(ids(&last), BTreeSet::from([FLOOR, TABLE, CHAIR, DESK]));
    assert_eq!(ids(&reference), BTreeSet::from([FLOOR, TABLE, CHAIR, BED]));
    let scp = room.truth(Scenario::Scp);
    for n in reference.nodes.iter().filter(|n| !n.ignore) {
        assert!(close(&n.bounds, &node(&scp, n.id).unwrap().bounds), "where it stood in the reference");
    }
}

/// The room round by round: who is there, and how each object has moved since the reference.
#[test]
fn states_follow_the_rounds() {
    let (room, motion, _) = two_scans();
    let labels = LabelSet::L20;
    let v = Vocabulary::new(labels.classes().iter().copied(), labels.predicates().iter().copied()).unwrap();
    let states = states(&room.data, &room.placements, &room.seen, labels, &v).unwrap();
    let ids = |k: usize| states[0][k].objects.keys().map(|id| *id as u32).collect::<BTreeSet<_>>();
    assert_eq!((states.len(), states[0].len()), (1, 2));
    assert_eq!(ids(0), BTreeSet::from([FLOOR, TABLE, CHAIR, SOFA, BED]));
    assert_eq!(ids(1), BTreeSet::from([FLOOR, TABLE, CHAIR, BED, DESK]));
    let t = room.placements[0].domain_from_reference;
    let (was, before) = states[0][0].objects[&u64::from(CHAIR)];
    let (is, after) = states[0][1].objects[&u64::from(CHAIR)];
    assert!(before.translation.vector.norm() < 1e-5 && before.rotation.angle() < 1e-5);
    assert!((after * was - is).norm() < 0.02, "the chair's middle goes where its motion carries it");
    assert!((after.rotation.angle() - motion.rotation.angle()).abs() < 1e-4);
    assert!(((t.inverse() * is) - (t.inverse() * was) - Vector3::y()).norm() < 0.02);
    let (_, table) = states[0][1].objects[&u64::from(TABLE)];
    assert!(table.translation.vector.norm() < 1e-4 && table.rotation.angle() < 1e-4);
}

#[test]
fn l20_counts_one_predicate_per_ordered_pair_the_first_of_the_list() {
    let (room, ..) = two_scans();
    let (t, v) = room.with(Scenario::Scp, LabelSet::L20);
    let p = |name: &str| v.find_predicate(name).unwrap();
    let edge = |s: u32, name: &str| (u64::from(s), u64::from(FLOOR), p(name));
    // Of "standing on" and "supported by" the list has the former first; "close by" and "left" are
    // not scored, and the sink and the pillow are no counted ends.
    let want = [
        edge(TABLE, "standing on"),
        edge(CHAIR, "standing on"),
        edge(SOFA, "standing on"),
        edge(BED, "standing on"),
    ];
    assert_eq!(t.edges, want);
    assert_eq!(t.counts.edges, 4);

    let (t, v) = room.with(Scenario::Scp, LabelSet::L160);
    let of_chair: Vec<PredicateId> =
        t.edges.iter().filter(|e| e.0 == u64::from(CHAIR) && e.1 == u64::from(FLOOR)).map(|e| e.2).collect();
    let mut want = ["close by", "standing on", "supported by"].map(|n| v.find_predicate(n).unwrap());
    want.sort_unstable();
    assert_eq!(of_chair, want);
}

#[test]
fn edges_are_the_latest_annotated_between_survivors() {
    let (room, ..) = two_scans();
    let (t, v) = room.with(Scenario::Ldcp, LabelSet::L20);
    let got: Vec<(u64, &str)> = t.edges.iter().map(|e| (e.0, v.predicate_name(e.2))).collect();
    assert!(t.edges.iter().all(|e| e.1 == u64::from(FLOOR)));
    let want = [(TABLE, "part of"), (CHAIR, "supported by"), (BED, "standing on"), (DESK, "standing on")];
    assert_eq!(got, want.map(|(id, p)| (u64::from(id), p)));
}

#[test]
fn a_relation_outlives_scans_that_show_one_end_alone() {
    // Round 0 shows both; round 1 the table without the chair; round 2 the chair without the table.
    let with = |ids: &[u32]| {
        let mut things = vec![floor()];
        things.extend(ids.iter().map(|&i| match i {
            TABLE => (TABLE, "table", table(), 3_000),
            _ => (CHAIR, "chair", chair(), 3_000),
        }));
        things
    };
    let room = Room::new(
        scan(with(&[TABLE, CHAIR]), &[(CHAIR, TABLE, "attached to")]),
        vec![(rescan("1"), scan(with(&[TABLE]), &[])), (rescan("2"), scan(with(&[CHAIR]), &[]))],
    );
    let t = room.truth(Scenario::Ldcp);
    assert_eq!(t.edges.len(), 1, "no later scan shows both ends");
    assert_eq!(t.counts.unchanged, 3, "{:?}", t.counts);
    // A scan that shows both without the relation ends it.
    let room = Room::new(
        scan(with(&[TABLE, CHAIR]), &[(CHAIR, TABLE, "attached to")]),
        vec![(rescan("1"), scan(with(&[TABLE, CHAIR]), &[]))],
    );
    assert!(room.truth(Scenario::Ldcp).edges.is_empty());
}

#[test]
fn an_object_that_comes_back_is_there_and_one_that_changes_is_counted_as_changed() {
    let gone = scan3r::ScanEntry { removed: Some(vec![CHAIR]), ..rescan("1") };
    let chair = || (CHAIR, "chair", chair(), 3_000);
    let room = Room::new(
        scan(vec![floor(), chair(), (TABLE, "table", table(), 3_000)], &[]),
        vec![
            (gone, scan(vec![floor(), (TABLE, "table", table(), 3_000)], &[])),
            // Back where it was; the table is 1.8 m long now instead of 1.2 m.
            (
                rescan("2"),
                scan(
                    vec![floor(), chair(), (TABLE, "table", block([1.0, 1.0, 0.5], [1.8, 0.3, 0.0]), 3_000)],
                    &[],
                ),
            ),
        ],
    );
    let t = room.truth(Scenario::Ldcp);
    let c = &t.counts;
    assert!(node(&t, CHAIR.into()).is_some());
    assert_eq!((c.nodes, c.unchanged, c.changed, c.removed), (3, 2, 1, 0), "{c:?}");
}

#[test]
fn changed_compares_annotated_extents_not_what_was_seen_of_them() {
    // The second visit sees a third of the table.
    let mut second = scan(vec![floor(), (TABLE, "table", table(), 0)], &[]);
    let left: Vec<_> = table().into_iter().filter(|p| p.x < 0.8).collect();
    second.samples.extend(left.iter().cycle().take(3_000));
    let room =
        Room::new(scan(vec![floor(), (TABLE, "table", table(), 3_000)], &[]), vec![(rescan("1"), second)]);
    let c = room.truth(Scenario::Ldcp).counts;
    assert_eq!((c.unchanged, c.changed), (2, 0), "{c:?}");
}

#[test]
fn a_rescan_without_transform_is_refused_by_name() {
    let entry = scan3r::ScanEntry { transform: None, ..rescan("hidden-7") };
    let room = Room::new(scan(vec![floor()], &[]), vec![(entry, scan(vec![floor()], &[]))]);
    let v = Vocabulary::default();
    let e = build(
        &room.data,
        &room.placements,
        &room.seen,
        Scenario::Ldcp,
        Reading::Accumulated,
        LabelSet::L20,
        &v,
    )
    .unwrap_err();
    assert!(e.to_string().contains("hidden-7"), "{e}");
    assert_eq!(room.data.rooms().len(), 1);
}
