//! What counts as moved, removed and added, on hand-made rooms.

#![allow(clippy::unwrap_used, reason = "a test")]

use bench_3rscan::changes::{Changes, Step, Tally};
use bench_3rscan::truth::{State, Truth, TruthCounts, TruthNode};
use graph_align::{Box3, LabelId, Node, NodeId, SceneGraph};
use nalgebra::{Isometry3, Point3};
use std::collections::{BTreeMap, BTreeSet};

/// (id, x, motion along x since the reference).
fn state(objects: &[(u64, f32, f32)]) -> State {
    let mut truth = Truth { nodes: Vec::new(), edges: Vec::new(), counts: TruthCounts::default() };
    let mut map = BTreeMap::new();
    for &(id, x, moved) in objects {
        let bounds = Box3::new([x, 0.0, 0.5], [0.6; 3]).unwrap();
        let label = Some(LabelId(id as u16));
        truth.nodes.push(TruthNode { id, room: 0, label, raw: "chair".to_owned(), bounds, ignore: false });
        map.insert(id, (bounds.centroid(), Isometry3::translation(moved, 0.0, 0.0)));
    }
    let there = map.keys().copied().collect();
    State { truth, objects: map, there }
}

/// (id, class, x).
fn graph(nodes: &[(u64, u16, f32)]) -> SceneGraph {
    let mut g = SceneGraph::default();
    for &(id, label, x) in nodes {
        let bounds = Box3::new([x, 0.0, 0.5], [0.6; 3]).unwrap();
        g.insert_node(Node::new(NodeId(id), LabelId(label), bounds));
    }
    g
}

fn count(
    was: &[(u64, f32, f32)],
    is: &[(u64, f32, f32)],
    before: &[(u64, u16, f32)],
    after: &[(u64, u16, f32)],
    visit: &[(u64, u16, f32)],
    looked: fn(&Point3<f32>) -> bool,
) -> Changes {
    let mut out = Changes::default();
    add(&mut out, [&state(was), &state(is)], [before, after, visit], looked, &[]);
    out
}

/// `heirs`: (which node, what it has become).
fn add(
    out: &mut Changes,
    [was, is]: [&State; 2],
    graphs: [&[(u64, u16, f32)]; 3],
    looked: fn(&Point3<f32>) -> bool,
    heirs: &[(u64, u64)],
) {
    let [before, after, visit] = graphs.map(graph);
    let ids = |g: &SceneGraph| g.nodes().map(|n| n.id).collect::<BTreeSet<_>>();
    out.count(&Step {
        before: &before,
        all_before: &ids(&before),
        after: &after,
        all_after: &ids(&after),
        heir: &|n| heirs.iter().find(|h| h.0 == n.0).map_or(n, |h| NodeId(h.1)),
        visit: &visit,
        looked: &looked,
        was,
        is,
    });
}

fn tally(tp: usize, fp: usize, missed: usize) -> Tally {
    Tally { tp, fp, missed }
}

/// 1 stays, 2 moves by 2 m, 3 goes, 4 comes.
const WAS: [(u64, f32, f32); 3] = [(1, 0.0, 0.0), (2, 3.0, 0.0), (3, 8.0, 0.0)];
const IS: [(u64, f32, f32); 3] = [(1, 0.0, 0.0), (2, 5.0, 2.0), (4, 11.0, 0.0)];
const BEFORE: [(u64, u16, f32); 3] = [(1, 1, 0.0), (2, 2, 3.0), (3, 3, 8.0)];
const SHOWN: [(u64, u16, f32); 3] = [(71, 1, 0.0), (72, 2, 5.0), (74, 4, 11.0)];

#[test]
fn a_merge_that_is_right_has_no_wrong_counts() {
    let after = [(1, 1, 0.0), (2, 2, 5.0), (4, 4, 11.0)];
    let c = count(&WAS, &IS, &BEFORE, &after, &SHOWN, |_| true);
    let right = Changes {
        moved: tally(1, 0, 0),
        removed: tally(1, 0, 0),
        added: tally(1, 0, 0),
        ..Changes::default()
    };
    assert_eq!(c, right);
}

#[test]
fn appending_misses_everything_and_doubles_what_was_there() {
    let after = [(1, 1, 0.0), (2, 2, 3.0), (3, 3, 8.0), (11, 1, 0.01), (12, 2, 5.0), (14, 4, 11.0)];
    let c = count(&WAS, &IS, &BEFORE, &after, &SHOWN, |_| true);
    assert_eq!((c.moved, c.removed), (tally(0, 0, 1), tally(0, 0, 1)));
    // The stay-at-home's twin loses to its own node; the moved one's is a second node of it.
    assert_eq!(c.added, tally(1, 1, 0));
}

#[test]
fn false_removals_are_told_apart_by_what_was_looked_at() {
    let still = [(1, 0.0, 0.0), (2, 3.0, 0.0), (3, 8.0, 0.0)];
    let c = count(&WAS, &still, &BEFORE, &[], &[(71, 1, 0.0)], |p| p.x < 5.0);
    assert_eq!(c.removed, tally(0, 2, 0));
    assert_eq!((c.false_removed_seen, c.false_removed_unseen), (1, 1));
}

/// However little of the whole a part is: the boxes of nodes 1 and 9 hardly overlap.
#[test]
fn a_node_that_became_part_of_another_was_not_removed_and_the_other_is_not_new() {
    let still = state(&WAS);
    let after = [(9, 1, 0.45), (2, 2, 3.0), (3, 3, 8.0)];
    let mut out = Changes::default();
    add(&mut out, [&still, &still], [&BEFORE, &after, &[]], |_| true, &[(1, 9)]);
    assert_eq!(out, Changes::default());
    // Without that the node is gone, and node 9 a second one of its object.
    let mut out = Changes::default();
    add(&mut out, [&still, &still], [&BEFORE, &after, &[]], |_| true, &[]);
    assert_eq!((out.removed, out.added), (tally(0, 1, 0), tally(0, 1, 0)));
}

#[test]
fn a_node_that_comes_nearer_to_its_object_was_not_carried_away() {
    let before = [(1, 1, 0.4), (2, 2, 3.0), (3, 3, 8.0)];
    let after = [(1, 1, -0.2), (2, 2, 3.0), (3, 3, 8.0)];
    let c = count(&WAS, &WAS, &before, &after, &[], |_| true);
    assert_eq!(c, Changes::default());
    // Nor one that was carried to where its object went, from a place that nobody looked at.
    let c = count(&WAS, &IS, &BEFORE, &[(1, 1, 0.0), (2, 2, 5.0), (3, 3, 8.0)], &[], |p| p.x > 9.0);
    assert_eq!(c, Changes::default());
}

#[test]
fn what_was_there_and_hardly_seen_is_not_added() {
    let mut was = state(&WAS);
    was.there.insert(4);
    let after = [(1, 1, 0.0), (2, 2, 5.0), (4, 4, 11.0)];
    let mut out = Changes::default();
    add(&mut out, [&was, &state(&IS)], [&BEFORE, &after, &SHOWN], |_| true, &[]);
    assert_eq!(out.added, Tally::default());
}

/// A node that takes two misses to go is missed once, and found when it goes.
#[test]
fn a_removal_may_come_late() {
    let kept = [(1, 1, 0.0), (2, 2, 5.0), (3, 3, 8.0), (4, 4, 11.0)];
    let mut out = count(&WAS, &IS, &BEFORE, &kept, &SHOWN, |_| true);
    assert_eq!(out.removed, tally(0, 0, 1));
    let is = state(&IS);
    add(&mut out, [&is, &is], [&kept, &[(1, 1, 0.0), (2, 2, 5.0), (4, 4, 11.0)], &SHOWN], |_| true, &[]);
    assert_eq!(out.removed, tally(1, 0, 0));
}

#[test]
fn what_was_not_looked_at_is_no_change_missed() {
    let c = count(&WAS, &IS, &BEFORE, &BEFORE, &[], |_| false);
    assert_eq!(c, Changes::default());
}

#[test]
fn an_object_that_stays_and_whose_node_is_carried_away_is_moved_wrongly() {
    let c = count(&WAS, &WAS, &BEFORE, &[(1, 1, 0.0), (2, 2, 4.0), (3, 3, 8.0)], &[], |_| true);
    assert_eq!(c.moved, tally(0, 1, 0));
}
