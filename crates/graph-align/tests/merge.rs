//! What merging keeps, drops, joins and moves, and what folds of many observations agree on.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test")]

mod common;
#[path = "common/rooms.rs"]
mod rooms;

use graph_align::{
    Box3, Edge, Footprint, Key, LabelId, Looked, Node, NodeId, Observation, Outcome, Params, PredicateId,
    Query, Replica, SceneGraph, Verdict, align, update,
};
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;
use rooms::{Dice, any_pose, building, changed, looked_around, moved, noisy, part, room, yaw_shift};

fn observation(agent: u16, seq: u32, frame: u32, graph: &SceneGraph, looked: Option<Looked>) -> Observation {
    let start_ds = seq * 100 + u32::from(agent);
    // Ids of different visits differ, as they do between robots.
    let mut own = SceneGraph::default();
    let id = |n: NodeId| NodeId(u64::from(agent) << 48 | u64::from(seq) << 24 | n.0);
    graph.nodes().for_each(|n| own.insert_node(Node { id: id(n.id), ..n.clone() }));
    graph.edges().for_each(|e| own.insert_edge(Edge { s: id(e.s), t: id(e.t), ..e }).unwrap());
    let key = Key { start_ds, agent, epoch: 0, seq };
    Observation { key, end_ds: start_ds + 50, frame, graph: own.quantised(), looked }
}

fn fold(observations: &[Observation]) -> graph_align::Folded {
    let mut r = Replica::default();
    observations.iter().for_each(|o| assert!(r.apply(o.clone()).unwrap()));
    r.fold(&Params::default())
}

/// Scores below `sure`, so that one sighting is one.
fn unsure(g: &SceneGraph) -> SceneGraph {
    changed(g, |n| n.score = 0.7)
}

/// The box of the node that came with an id, whoever brought it.
fn place_of(g: &SceneGraph, id: u64) -> Box3 {
    g.nodes().find(|n| n.id.0 & 0xff_ffff == id).unwrap().bounds
}

fn place(g: &SceneGraph, id: u64) -> Point3<f32> {
    g.node(NodeId(id)).unwrap().bounds.centroid()
}

/// The cells without those in which some nodes stand.
fn but_for(looked: &Looked, g: &SceneGraph, ids: &[u64]) -> Looked {
    let hidden: Vec<[i32; 3]> =
        ids.iter().map(|&id| [0, 1, 2].map(|k| (place(g, id)[k] / 0.5).floor() as i32)).collect();
    let cells: Vec<[i32; 3]> = looked.cells().filter(|c| !hidden.contains(c)).collect();
    Looked::new(0.5, [0.0; 3], &cells).unwrap()
}

/// A node that was seen once goes when a visit looks at its place and does not see it; one that was seen
/// twice stays after one such visit and goes after the second; without a look nothing goes.
#[test]
fn misses_outweigh_sightings_when_somebody_looked() {
    let whole = unsure(&room(&mut Dice(5), 14, 0));
    let without = part(&whole, |id| id != 4);
    let look = || Some(looked_around(Point3::origin(), 6.0));
    let count = |views: &[(&SceneGraph, Option<Looked>)]| {
        let all: Vec<_> =
            views.iter().enumerate().map(|(k, (g, l))| observation(0, k as u32, 0, g, l.clone())).collect();
        fold(&all).main_graph().len()
    };
    assert_eq!(count(&[(&whole, look()), (&without, None)]), 14);
    assert_eq!(count(&[(&whole, look()), (&without, look())]), 13);
    assert_eq!(count(&[(&whole, look()), (&whole, look()), (&without, look())]), 14);
    assert_eq!(count(&[(&whole, look()), (&whole, look()), (&without, look()), (&without, look())]), 13);
    // Seen again in between: the misses start anew.
    let between =
        [(&whole, look()), (&whole, look()), (&without, look()), (&whole, look()), (&without, look())];
    assert_eq!(count(&between), 14);
}

/// Classes are means over sightings; a class that one view took for second wins when the sum says so.
#[test]
fn classes_add_up() {
    let g = room(&mut Dice(6), 12, 0);
    let view = |label: u16, score: f32, other: u16, second: f32| {
        changed(&g, |n| {
            if n.id == NodeId(3) {
                (n.label, n.score) = (LabelId(label), score);
                n.others = [(LabelId(other), second)].into_iter().collect();
            }
        })
    };
    let all = [
        observation(0, 0, 0, &view(1, 0.6, 2, 0.3), None),
        observation(1, 1, 0, &view(2, 0.8, 1, 0.1), None),
        observation(0, 2, 0, &view(2, 0.5, 1, 0.4), None),
    ];
    let merged = fold(&all).main_graph();
    assert_eq!(merged.len(), 12);
    let n = merged.nodes().find(|n| n.id.0 & 0xff_ffff == 3).unwrap();
    assert_eq!((n.label, n.sightings), (LabelId(2), 3));
    assert!((n.score - (0.3 + 0.8 + 0.5) / 3.0).abs() < 0.01, "{}", n.score);
}

/// Relations between nodes that were both seen again are the last view's; those of others stay; what moved
/// keeps none of its old ones.
#[test]
fn relations_follow_what_was_seen() {
    let reference = room(&mut Dice(8), 14, 0);
    let mut query = part(&reference, |id| id != 9);
    let lamp = query.node(NodeId(2)).unwrap().clone();
    let away = lamp.bounds.centroid() + Vector3::new(1.3, -0.9, 0.0);
    let bounds = Box3::new(away.coords.into(), lamp.bounds.extent().into()).unwrap();
    let mut fresh = SceneGraph::default();
    query.nodes().for_each(|n| fresh.insert_node(n.clone()));
    fresh.insert_node(Node { bounds, ..lamp });
    fresh.insert_edge(Edge { s: NodeId(1), t: NodeId(0), p: PredicateId(2), score: 0.8 }).unwrap();
    query = fresh;
    let looked = looked_around(Point3::origin(), 6.0);
    // Two is looked at, nine is not known to be.
    let looked = but_for(&looked, &reference, &[9]);
    let ask = Query { looked: Some(&looked), ..Query::new(&query) };
    let out = align(&reference, &ask, &Params::default());
    let Outcome::Match(m) = &out else { panic!("{out:?}") };
    assert_eq!(m.verdicts[&NodeId(2)], Verdict::Moved(NodeId(2)));
    let merged = update(&reference, &ask, &out, &Params::default());
    let between = |s: u64| merged.outgoing(NodeId(s)).map(|e| (e.t.0, e.p.0)).collect::<Vec<_>>();
    assert_eq!(between(1), [(0, 2)], "seen again: replaced");
    assert_eq!(between(9), [(0, 0)], "not seen again: kept");
    assert_eq!(between(2), [], "moved: dropped");
    assert!((merged.node(NodeId(2)).unwrap().bounds.centroid() - away).norm() < 1e-3);
}

/// What stands on a table that moved, and is seen nowhere, goes along with its relation; what stands
/// beside it, and what is seen to have stayed, does not.
#[test]
fn what_stands_on_a_moved_node_goes_along() {
    let mut reference = room(&mut Dice(8), 14, 0);
    let table = reference.node(NodeId(2)).unwrap().bounds.centroid();
    let top = Box3::new(table.coords.into(), [1.4, 0.8, 0.8]).unwrap();
    reference.insert_node(Node { bounds: top, ..reference.node(NodeId(2)).unwrap().clone() });
    let put = |g: &mut SceneGraph, id: u64, off: [f32; 3]| {
        let at = table + Vector3::from(off);
        let small = Box3::new(at.coords.into(), [0.15, 0.15, 0.2]).unwrap();
        g.insert_node(Node::new(NodeId(id), LabelId(30 + id as u16 % 3), small));
        g.insert_edge(Edge { s: NodeId(id), t: NodeId(2), p: PredicateId(0), score: 0.9 }).unwrap();
    };
    put(&mut reference, 60, [0.3, 0.1, 0.5]);
    put(&mut reference, 61, [-0.4, 0.2, 0.5]);
    put(&mut reference, 62, [1.5, 0.0, 0.5]);
    let shift = Vector3::new(1.3, -0.9, 0.0);
    // 61 is seen where it was, 60 and 62 are not seen.
    let mut query = part(&reference, |id| id != 60 && id != 62);
    let moved = Box3::new((table + shift).coords.into(), top.extent().into()).unwrap();
    query.insert_node(Node { bounds: moved, ..reference.node(NodeId(2)).unwrap().clone() });
    let looked = looked_around(Point3::origin(), 9.0);
    let looked = but_for(&looked, &reference, &[60, 62]);
    let ask = Query { looked: Some(&looked), ..Query::new(&query) };
    let out = align(&reference, &ask, &Params::default());
    let Outcome::Match(m) = &out else { panic!("{out:?}") };
    assert_eq!(m.verdicts[&NodeId(2)], Verdict::Moved(NodeId(2)));
    let merged = update(&reference, &ask, &out, &Params::default());
    let went = |id: u64| place(&merged, id) - place(&reference, id);
    assert!((went(60) - shift).norm() < 0.02, "stood on the table: {:?}", went(60));
    assert!(merged.outgoing(NodeId(60)).any(|e| e.t == NodeId(2)), "and still does");
    assert!(went(61).norm() < 0.02, "was seen where it was");
    assert!(went(62).norm() < 1e-6, "stood beside it");
}

/// The box follows an object that is seen whole again a little farther on; seen in part, it keeps what was known.
#[test]
fn a_small_move_moves_the_box_and_does_not_stretch_it() {
    let lies = |b: Box3| {
        let footprint = Footprint::rectangle([b.extent().x, b.extent().y], 0.0);
        b.with_footprint(footprint).unwrap()
    };
    let whole = changed(&unsure(&room(&mut Dice(7), 14, 0)), |n| n.bounds = lies(n.bounds));
    let of = |g: &SceneGraph| place_of(g, 5);
    let size = of(&whole).extent();
    let seen = |to: [f32; 3], extent: [f32; 3]| {
        let view = changed(&whole, |n| {
            if n.id == NodeId(5) {
                n.bounds = lies(Box3::new(to, extent).unwrap());
            }
        });
        let all = [observation(0, 0, 0, &whole, None), observation(1, 1, 0, &view, None)];
        let merged = fold(&all).main_graph();
        assert_eq!(merged.len(), 14);
        let b = of(&merged);
        let [l, w] = b.footprint().unwrap().sides();
        assert!((l - size.x).abs() < 0.03 && (w - size.y).abs() < 0.03, "{l} {w}");
        b
    };
    let at = of(&whole).centroid();
    let moved = seen([at.x + 0.2, at.y, at.z], size.into());
    assert!((moved.centroid().x - at.x - 0.2).abs() < 0.011 && (moved.extent() - size).norm() < 0.03);
    // A tenth of it was hidden on one side.
    let partly = seen([at.x + 0.05 * size.x, at.y, at.z], [0.9 * size.x, size.y, size.z]);
    assert!((partly.centroid() - at).norm() < 0.02 && (partly.extent() - size).norm() < 0.03);
}

/// A piece inside a larger node of its class becomes part of it in a fold, and of no other class.
#[test]
fn folds_join_pieces_of_one_object() {
    let mut g = room(&mut Dice(9), 10, 0);
    let put = |g: &mut SceneGraph, id: u64, label: u16, at: [f32; 3], side: [f32; 3]| {
        g.insert_node(Node {
            score: 0.7,
            ..Node::new(NodeId(id), LabelId(label), Box3::new(at, side).unwrap())
        });
    };
    put(&mut g, 50, 20, [20.0, 0.0, 0.5], [2.0, 1.0, 1.0]);
    put(&mut g, 51, 20, [20.6, 0.1, 0.5], [0.6, 0.6, 0.6]);
    put(&mut g, 52, 21, [20.6, 0.1, 0.5], [0.5, 0.5, 0.5]);
    g.insert_edge(Edge { s: NodeId(51), t: NodeId(52), p: PredicateId(1), score: 0.5 }).unwrap();
    // Whole and piece disagree about 0 and about 1; the surer relation is the one that stays.
    for (s, t, p, score) in [(50, 0, 0, 0.6), (51, 0, 1, 0.7), (50, 1, 0, 0.7), (51, 1, 1, 0.6)] {
        g.insert_edge(Edge { s: NodeId(s), t: NodeId(t), p: PredicateId(p), score }).unwrap();
    }
    let folded = fold(&[observation(0, 0, 0, &g, None)]);
    let heirs = [50, 51, 52].map(|id| folded.components[0].heir(NodeId(id)).0);
    assert_eq!(heirs, [50, 50, 52]);
    let merged = folded.main_graph();
    let ids: Vec<u64> = merged.nodes().map(|n| n.id.0).filter(|id| *id >= 50).collect();
    assert_eq!(ids, [50, 52]);
    assert!(merged.outgoing(NodeId(50)).any(|e| e.t == NodeId(52)), "the piece's relation is the whole's");
    let to =
        |t: u64| merged.outgoing(NodeId(50)).filter(|e| e.t == NodeId(t)).map(|e| e.p.0).collect::<Vec<_>>();
    assert_eq!((to(0), to(1)), (vec![1], vec![0]), "one relation per neighbour");
}

/// A wall behind furniture is seen in pieces: those of one visit, in one plane, with no other wall between
/// them, become one, whatever the yaw.
#[test]
fn folds_join_pieces_of_one_wall() {
    let mut params = Params::default();
    params.robust.structure = vec![LabelId(30)];
    let fold = |list: &[Observation]| {
        let mut r = Replica::default();
        list.iter().for_each(|o| assert!(r.apply(o.clone()).unwrap()));
        let graph = r.fold(&params).main_graph();
        let mut lengths: Vec<f32> = graph
            .nodes()
            .filter(|n| n.label == LabelId(30))
            .map(|n| {
                let [l, w] = n.bounds.footprint().unwrap().sides();
                l.max(w)
            })
            .collect();
        lengths.sort_by(f32::total_cmp);
        (lengths, graph)
    };
    let near =
        |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.03);
    for turn in [0.0, 0.5, 2.0] {
        let t = yaw_shift(turn, [3.0, -1.0, 0.0]);
        let wall = |g: &mut SceneGraph, id: u64, at: [f32; 3], sides: [f32; 3]| {
            let b = Box3::new(at, sides).unwrap();
            let b = b.with_footprint(Footprint::rectangle([sides[0], sides[1]], 0.0)).unwrap();
            g.insert_node(Node { score: 0.7, ..Node::new(NodeId(id), LabelId(30), b.transformed(&t)) });
        };
        let (left, right) = ([4.0, 0.1, 2.4], [2.0, 0.1, 2.4]);
        let mut one = SceneGraph::default();
        wall(&mut one, 1, [0.0, 5.0, 1.2], left);
        wall(&mut one, 2, [4.0, 5.02, 1.2], right);
        one.insert_edge(Edge { s: NodeId(2), t: NodeId(1), p: PredicateId(0), score: 0.5 }).unwrap();
        let (lengths, graph) = fold(&[observation(0, 0, 0, &one, None)]);
        assert!(near(&lengths, &[7.0]), "a metre apart: {lengths:?}");
        assert_eq!(graph.edges().count(), 0, "pieces of one node have no relation");

        let mut more = one.clone();
        wall(&mut more, 3, [2.5, 3.0, 1.2], [0.2, 3.9, 2.4]);
        let (lengths, _) = fold(&[observation(0, 0, 0, &more, None)]);
        assert!(near(&lengths, &[2.0, 3.9, 4.0]), "a wall ends between them: {lengths:?}");

        let mut step = SceneGraph::default();
        wall(&mut step, 1, [0.0, 5.0, 1.2], left);
        wall(&mut step, 2, [4.0, 5.3, 1.2], right);
        assert!(near(&fold(&[observation(0, 0, 0, &step, None)]).0, &[2.0, 4.0]), "in two planes");

        let mut far = SceneGraph::default();
        wall(&mut far, 1, [0.0, 5.0, 1.2], left);
        wall(&mut far, 2, [5.0, 5.0, 1.2], right);
        assert!(near(&fold(&[observation(0, 0, 0, &far, None)]).0, &[2.0, 4.0]), "two metres apart");

        let visits = [1, 2].map(|id| part(&one, |n| n == id));
        let visits = [(0, &visits[0]), (1, &visits[1])].map(|(agent, g)| observation(agent, 0, 0, g, None));
        assert!(near(&fold(&visits).0, &[2.0, 4.0]), "nobody saw both");
    }
}

proptest! {
    #![proptest_config(common::cases(24))]

    /// A turned rectangle's box is that of its turned corners.
    #[test]
    fn footprints_turn_without_growing(l in 0.1_f32..4.0, w in 0.05_f32..2.0, yaw in 0.0_f32..1.57, turn in -7.0_f32..7.0) {
        let corners = |angle: f32| {
            let (sin, cos) = angle.sin_cos();
            [(l * cos.abs() + w * sin.abs()), (l * sin.abs() + w * cos.abs())]
        };
        let [x, y] = corners(yaw);
        let b = Box3::new([3.0, -2.0, 1.0], [x, y, 0.7]).unwrap();
        let b = b.with_footprint(Footprint::rectangle([l, w], yaw)).unwrap();
        let t = yaw_shift(turn, [1.0, 2.0, 0.5]);
        let turned = b.transformed(&t);
        let [x, y] = corners(yaw + turn);
        prop_assert!((turned.extent() - Vector3::new(x, y, 0.7)).norm() < 1e-3, "{:?}", turned);
        // Back again: nothing has grown.
        let back = turned.transformed(&t.inverse());
        prop_assert!((back.extent() - b.extent()).norm() < 2e-3);
        prop_assert!((back.centroid() - b.centroid()).norm() < 1e-4);
    }

    /// Robots whose frames are unknown: the fold brings them together, by all rooms that they share.
    #[test]
    fn frames_are_found_from_everything_shared(seed in any::<u64>()) {
        let mut dice = Dice(seed);
        // Nothing so large that it could be a part of its neighbour.
        let all = changed(&building(&mut dice, 5, 14), |n| {
            let e = n.bounds.extent().map(|s| 0.2 + 0.2 * s);
            n.bounds = Box3::new(n.bounds.centroid().coords.into(), e.into()).unwrap();
        });
        let rooms = |of: &[u64]| part(&all, |id| of.contains(&(id / 1000)));
        let b_from_domain = any_pose(&mut dice);
        let views: [(u16, &[u64]); 4] = [(0, &[1, 2]), (1, &[2, 3]), (0, &[5]), (1, &[5, 4])];
        let mut list = Vec::new();
        for (k, (agent, of)) in views.into_iter().enumerate() {
            let seen = noisy(&rooms(of), &mut dice, 0.06);
            let seen = if agent == 1 { moved(&seen, &b_from_domain) } else { seen };
            list.push(observation(agent, k as u32, u32::from(agent), &seen, None));
        }
        let folded = fold(&list);
        prop_assert_eq!(folded.components.len(), 1);
        let estimate = folded.components[0].frames[&1] * b_from_domain;
        // The five rooms are 50 m long; two of them are shared, 30 m apart.
        for x in [0.0, 50.0] {
            let p = Point3::new(x, 0.0, 1.0);
            prop_assert!((estimate * p - p).norm() < 0.12, "{} m off at {} m", (estimate * p - p).norm(), x);
        }
        prop_assert_eq!(folded.main_graph().len(), all.len());
    }

    /// A room in which a frame was found tells its yaw within degrees: what lies at the other end of the building is
    /// looked for farther from where that puts it, and then tells the yaw better.
    #[test]
    fn far_rooms_are_met_although_the_frame_is_off(seed in any::<u64>(), turn in 1.8_f32..4.0) {
        let mut dice = Dice(seed);
        let small = |g: &SceneGraph| changed(g, |n| {
            let e = n.bounds.extent().map(|s| 0.2 + 0.2 * s);
            n.bounds = Box3::new(n.bounds.centroid().coords.into(), e.into()).unwrap();
        });
        let (near, far) = (small(&room(&mut dice, 12, 0)), small(&room(&mut dice, 14, 100)));
        let far = moved(&far, &yaw_shift(0.0, [45.0, 0.0, 0.0]));
        let b_from_a = any_pose(&mut dice);
        // Agent 1 saw the near room a few degrees turned.
        let off = b_from_a * yaw_shift(turn.to_radians(), [0.0; 3]);
        let views = [
            (0, near.clone()),
            (0, far.clone()),
            (1, moved(&near, &off)),
            (1, moved(&far, &b_from_a)),
        ];
        let list: Vec<_> = views
            .into_iter()
            .enumerate()
            .map(|(k, (agent, g))| observation(agent, k as u32, u32::from(agent), &g, None))
            .collect();
        let folded = fold(&list);
        prop_assert_eq!(folded.components.len(), 1);
        let p = Point3::new(45.0, 0.0, 1.0);
        let there = folded.components[0].frames[&1] * b_from_a * p;
        prop_assert!((there - p).norm() < 0.3, "{} m off", (there - p).norm());
        prop_assert_eq!(folded.main_graph().len(), near.len() + far.len());
    }

    /// Centroids of one small room leave the yaw open by degrees; the sides of its walls do not.
    #[test]
    fn walls_tell_the_yaw_of_a_found_frame(seed in any::<u64>()) {
        let mut dice = Dice(seed);
        let mut own = room(&mut dice, 9, 0);
        let wall = LabelId(30);
        for (k, (at, l, yaw)) in
            [([0.0, -3.0, 1.2], 6.0, 0.3_f32), ([3.3, 0.0, 1.2], 5.0, 0.3), ([0.0, 3.0, 1.2], 6.0, 0.3)].into_iter().enumerate()
        {
            let sides = if k == 1 { [0.1, l] } else { [l, 0.1] };
            let (sin, cos) = yaw.sin_cos();
            let extent = [sides[0] * cos + sides[1] * sin, sides[0] * sin + sides[1] * cos, 2.4];
            let b = Box3::new(at, extent).unwrap().with_footprint(Footprint::rectangle(sides, yaw)).unwrap();
            own.insert_node(Node::new(NodeId(60 + k as u64), wall, b));
        }
        let b_from_a = any_pose(&mut dice);
        let turned = |g: &SceneGraph| {
            changed(&moved(g, &b_from_a), |n| {
                if n.label == wall {
                    n.bounds = own.node(n.id).unwrap().bounds.transformed(&b_from_a);
                }
            })
        };
        let shift = |n: &mut Node, dice: &mut Dice| {
            if n.label != wall {
                let c = n.bounds.centroid() + Vector3::new(dice.within(-0.12, 0.12), dice.within(-0.12, 0.12), 0.0);
                n.bounds = Box3::new(c.coords.into(), n.bounds.extent().into()).unwrap();
            }
        };
        let view = changed(&own, |n| shift(n, &mut dice));
        let list = [observation(0, 0, 0, &own, None), observation(1, 1, 1, &turned(&view), None)];
        let mut r = Replica::default();
        list.iter().for_each(|o| assert!(r.apply(o.clone()).unwrap()));
        let mut params = Params::default();
        params.robust.structure = vec![wall];
        let folded = r.fold(&params);
        if let [c] = &folded.components[..] {
            let off = (c.frames[&1] * b_from_a).rotation.angle().to_degrees();
            prop_assert!(off < 0.5, "{} degrees off", off);
        }
    }

    /// Any order of arrival, any duplication and any tree of joins give the same graph, in known and in
    /// unknown frames, while objects move, vanish and appear.
    #[test]
    fn replicas_converge(seed in any::<u64>(), order in any::<u64>()) {
        let (list, counts) = history(seed);
        prop_assert!(counts.iter().all(|c| *c > 0));
        let reference = fold(&list);
        let merges = list.iter().map(|o| o.graph.len()).sum::<usize>()
            - reference.components.iter().map(|c| c.graph.len()).sum::<usize>();
        prop_assert!(merges > 0);
        let mut dice = Dice(order);
        let mut parts: Vec<Replica> = vec![Replica::default(); 4];
        for _ in 0..3 {
            for o in &list {
                if dice.below(2) == 0 {
                    let k = dice.below(4);
                    parts[k].apply(o.clone()).unwrap();
                }
            }
        }
        for o in list.iter().rev() {
            parts[dice.below(4)].apply(o.clone()).unwrap();
        }
        // A tree of joins in any shape.
        while parts.len() > 1 {
            let a = parts.swap_remove(dice.below(parts.len()));
            let k = dice.below(parts.len());
            parts[k].join(&a).unwrap();
        }
        prop_assert_eq!(&parts[0].fold(&Params::default()), &reference);
        // Without an agent it is as if that agent had never been.
        let own: Vec<_> = list.iter().filter(|o| o.key.agent != 1).cloned().collect();
        prop_assert_eq!(parts[0].without(1).unwrap().fold(&Params::default()), fold(&own));
    }
}

/// Visits of three agents to three rooms over four rounds. Beside them how many observations, moves, removals
/// and arrivals there are.
fn history(seed: u64) -> (Vec<Observation>, [usize; 4]) {
    let mut dice = Dice(seed);
    let mut world = building(&mut dice, 3, 13);
    let frames: [Isometry3<f32>; 3] = [Isometry3::identity(), any_pose(&mut dice), Isometry3::identity()];
    let (mut list, mut counts) = (Vec::new(), [0; 4]);
    for round in 0..4_u32 {
        for r in 1..=3_u64 {
            if round > 0 {
                let id = |dice: &mut Dice| NodeId(1000 * r + 1 + dice.below(12) as u64);
                let (gone, went) = (id(&mut dice), id(&mut dice));
                counts[2] += usize::from(world.remove_node(gone).is_some());
                if let Some(n) = world.node(went) {
                    let c = n.bounds.centroid() + Vector3::new(0.8, 0.5, 0.0);
                    let bounds = Box3::new(c.coords.into(), n.bounds.extent().into()).unwrap();
                    world.insert_node(Node { bounds, ..n });
                    counts[1] += 1;
                }
                let at = [10.0 * (r as f32 - 1.0) + dice.within(-3.0, 3.0), dice.within(-2.5, 2.5), 0.4];
                let bounds = Box3::new(at, [0.4, 0.4, 0.6]).unwrap();
                world.insert_node(Node::new(NodeId(1000 * r + 100 + u64::from(round)), LabelId(7), bounds));
                counts[3] += 1;
            }
            let agent = dice.below(3);
            let seen = noisy(&part(&world, |id| id / 1000 == r), &mut dice, 0.04);
            let frame_from_domain = frames[agent];
            let middle = frame_from_domain * Point3::new(10.0 * (r as f32 - 1.0), 0.0, 1.0);
            let graph = moved(&seen, &frame_from_domain);
            let looked = Some(looked_around(middle, 4.0));
            // Agents 0 and 2 share a frame, agent 1 has its own.
            let frame = u32::from(agent == 1);
            list.push(observation(agent as u16, round * 3 + r as u32, frame, &graph, looked));
            counts[0] += 1;
        }
    }
    (list, counts)
}

/// What the histories of [`replicas_converge`] hold.
#[test]
fn histories_are_not_empty() {
    let mut sum = [0; 4];
    for seed in 0..40 {
        history(seed).1.iter().zip(&mut sum).for_each(|(c, s)| *s += c);
    }
    eprintln!(
        "40 histories: {} observations, {} moves, {} removals, {} arrivals",
        sum[0], sum[1], sum[2], sum[3]
    );
    assert!(sum.iter().all(|s| *s >= 40));
}
