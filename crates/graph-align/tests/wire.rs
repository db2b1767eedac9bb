//! Frames: what is written is read back, what is damaged is refused, and they are as short as promised.

#![cfg(feature = "wire")]
#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

#[path = "common/building.rs"]
mod building;
mod common;

use building::{building, frame, with_evidence, with_footprints};
use common::{graph, looked, vocabulary};
use graph_align::{
    Box3, Edge, Footprint, Key, LabelId, Looked, Node, NodeId, Observation, PredicateId, SceneGraph,
    Vocabulary, wire,
};
use proptest::prelude::*;

proptest! {
    #![proptest_config(common::cases(256))]

    #[test]
    fn frames_carry_the_quantised_graph(g in graph(30), looked in looked(), seq in any::<u32>()) {
        let v = vocabulary();
        let o = Observation { key: Key { start_ds: 100, agent: 3, epoch: 1, seq }, end_ds: 900, frame: 2, graph: g, looked: Some(looked) };
        let bytes = wire::encode(&o, &v).expect("small");
        let back = wire::decode(&bytes, &v).expect("own frame");
        prop_assert_eq!(&back.graph, &o.graph.quantised());
        prop_assert_eq!(&back.looked, &o.looked);
        prop_assert_eq!(wire::encode(&back, &v).expect("small"), bytes);
    }

    #[test]
    fn broken_frames_are_refused_or_canonical(g in graph(12), looked in looked(), at in any::<prop::sample::Index>(), flip in 1..=255_u8, cut in any::<prop::sample::Index>()) {
        let v = vocabulary();
        let o = Observation { key: Key { start_ds: 1, agent: 0, epoch: 0, seq: 0 }, end_ds: 2, frame: 0, graph: g, looked: Some(looked) };
        let bytes = wire::encode(&o, &v).expect("small");
        prop_assert!(wire::decode(&bytes[..cut.index(bytes.len())], &v).is_err());
        let mut flipped = bytes.clone();
        let at = at.index(flipped.len());
        flipped[at] ^= flip;
        if let Ok(read) = wire::decode(&flipped, &v) {
            prop_assert_eq!(wire::encode(&read, &v).expect("small"), flipped);
        }
        let mut longer = bytes;
        longer.push(0);
        prop_assert!(wire::decode(&longer, &v).is_err());
    }

    /// A delta on its base is the observation, and on another base, or damaged, an error or what an
    /// encoder would have written.
    #[test]
    fn deltas_carry_the_difference(
        old in graph(20), new in graph(20), share in any::<bool>(), old_looked in looked(),
        new_looked in prop::option::of(looked()), at in any::<prop::sample::Index>(), flip in 1..=255_u8,
    ) {
        let v = vocabulary();
        let observation = |graph, looked| Observation {
            key: Key { start_ds: 100, agent: 3, epoch: 1, seq: 5 }, end_ds: 900, frame: 2, graph, looked,
        };
        // A base that shares half of its nodes with the new graph.
        let mut base = SceneGraph::default();
        for (k, n) in old.nodes().enumerate() {
            let same = new.node(n.id).filter(|_| k % 2 == 0);
            base.insert_node(same.unwrap_or(n).clone());
        }
        old.edges().chain(new.edges()).for_each(|e| { let _ = base.insert_edge(e); });
        let base = observation(base, Some(old_looked.clone()));
        let o = observation(new, if share { Some(old_looked) } else { new_looked });
        let bytes = wire::encode_delta(&base, &o, &v).expect("small");
        let back = wire::decode_delta(&bytes, &base, &v).expect("own delta");
        prop_assert_eq!(&back.graph, &o.graph.quantised());
        prop_assert_eq!(&back.looked, &o.looked);
        prop_assert_eq!((back.key, back.end_ds, back.frame), (o.key, o.end_ds, o.frame));
        prop_assert!(wire::decode(&bytes, &v).is_err());
        let mut other = base.clone();
        other.end_ds += 1;
        prop_assert!(wire::decode_delta(&bytes, &other, &v).is_err());
        let mut flipped = bytes.clone();
        let at = at.index(flipped.len());
        flipped[at] ^= flip;
        if let Ok(read) = wire::decode_delta(&flipped, &base, &v) {
            prop_assert_eq!(wire::encode_delta(&base, &read, &v).expect("small"), flipped);
        }
        prop_assert!(wire::decode_delta(&bytes[..at], &base, &v).is_err());
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Two frames byte for byte, as `extras/wire_frames.py` writes them, an encoder that knows `docs/wire.md` alone.
#[test]
fn frames_are_those_of_the_document() {
    let v = Vocabulary::new(["wall", "chair", "lamp"], ["on", "near"]).expect("names differ");
    let mut g = SceneGraph::default();
    let cm = |c: [i32; 3]| c.map(|c| (f64::from(c) / 100.0) as f32);
    let mut put = |id, label, at, extent, score: u8, sightings, seen, others: &[(u16, u8)], misses| {
        let mut n = Node::new(NodeId(id), LabelId(label), Box3::new(cm(at), cm(extent)).expect("finite"));
        if id == 5 {
            let reach = [210, 150, 7, 139, 190, 137, 5, 140].map(|c| (f64::from(c) / 100.0) as f32);
            let f = Footprint { yaw: 341.0 / 1023.0 * std::f32::consts::FRAC_PI_2, reach };
            n.bounds = n.bounds.with_footprint(f).expect("sides of a box");
        }
        n.score = f32::from(score) / 127.0;
        n.others = others.iter().map(|&(l, s)| (LabelId(l), f32::from(s) / 127.0)).collect();
        (n.sightings, n.misses, n.last_seen) = (sightings, misses, seen);
        g.insert_node(n);
    };
    put(5, 0, [120, -400, 130], [400, 20, 260], 127, 1, 90.0, &[], 0);
    put(6, 1, [-35, 10, 45], [50, 55, 90], 64, 4, 87.5, &[(2, 30), (0, 2)], 0);
    put(900, 2, [250, 12, -1], [20, 21, 30], 3, 1, 10.1, &[(1, 60)], 3);
    let e = |s, t, p, score: u8| Edge {
        s: NodeId(s),
        t: NodeId(t),
        p: PredicateId(p),
        score: f32::from(score) / 127.0,
    };
    g.insert_edge(e(6, 5, 0, 100)).expect("both there");
    g.insert_edge(e(900, 6, 1, 127)).expect("both there");
    let hidden = [[2, 1, 2], [2, 1, 3], [-1, 2, 3]];
    let cells: Vec<[i32; 3]> =
        (0..24).map(|k| [k % 4 - 1, k / 4 % 3, k / 12 + 2]).filter(|c| !hidden.contains(c)).collect();
    let o = Observation {
        key: Key { start_ds: 100, agent: 3, epoch: 1, seq: 7 },
        end_ds: 900,
        frame: 2,
        graph: g,
        looked: Some(Looked::new(0.5, cm([10, -20, 0]), &cells).expect("small")),
    };
    let want = "\
    4d534735070549952e07030fc91c547050b04001a06f02e9f8030729f0d4a463cac73413504230d5960687ca29067557\
    0b0cb1ee07db1b81324c46104955096405453041c2004104133082c4f0049e000b2e48a083fc2fcba076b421a281530e\
    10b700";
    assert_eq!(hex(&wire::encode(&o, &v).expect("small")), want);

    // Rows that are alike: guessed from the row before, which the first of a layer does not have.
    let rows: Vec<[i32; 3]> = (0..48)
        .filter(|k| [true, true, false, true, false, true][*k % 6])
        .map(|k| [k % 6, k / 6 % 4, k / 24].map(|c| c as i32))
        .collect();
    let o = Observation {
        key: Key { start_ds: 0, agent: 0, epoch: 0, seq: 1 },
        end_ds: 10,
        frame: 0,
        graph: SceneGraph::default(),
        looked: Some(Looked::new(0.5, [0.0; 3], &rows).expect("small")),
    };
    let want = "\
    4d534735020549952e010103011501010165010106534f1030";
    assert_eq!(hex(&wire::encode(&o, &v).expect("small")), want);
}

#[test]
fn frames_are_short() {
    for (rooms, nodes, edges, names) in
        [(1, 30, 100, (20, 8)), (47, 766, 2_600, (20, 8)), (47, 1_588, 5_546, (160, 26))]
    {
        let (g, v) = building(rooms, nodes, edges, names, 5);
        let plain = wire::encode(&frame(g.clone(), None), &v).expect("small").len() as u64;
        let budget = 14 * nodes + 4 * edges + 64;
        assert!(plain <= budget, "{plain} bytes for {nodes} nodes, want {budget}");
        let (full, looked) = with_evidence(&g, rooms, 6);
        let size =
            |g: SceneGraph, l: Option<Looked>| wire::encode(&frame(g, l), &v).expect("small").len() as u64;
        let all = size(with_footprints(&full, 7), Some(looked.clone()));
        let full = size(full, Some(looked));
        println!(
            "{nodes} nodes, {edges} edges: {plain} bytes of {budget}, with evidence {full}, footprints {all}"
        );
        assert!(full <= plain + 8 * nodes, "{full} bytes with evidence, {plain} without, {nodes} nodes");
        assert!(all <= full + 6 * nodes, "{all} bytes with footprints, {full} without, {nodes} nodes");
    }
}

/// Six nodes change their class and place, get relations, and one leaves.
#[test]
fn deltas_are_short() {
    let (g, v) = building(1, 34, 120, (20, 8), 9);
    let (g, looked) = with_evidence(&g, 1, 10);
    let base = frame(g.clone(), Some(looked));
    let mut new = g.clone();
    new.remove_node(NodeId(33));
    for k in [2, 7, 8, 15, 20, 31] {
        let n = g.node(NodeId(k)).expect("there");
        let moved = Box3::new([k as f32 / 10.0, 1.0, 0.5], n.bounds.extent().into()).expect("finite");
        new.insert_node(Node { label: LabelId(k as u16 % 20), bounds: moved, ..n.clone() });
        new.insert_edge(Edge { s: NodeId(k), t: NodeId(0), p: PredicateId(3), score: 0.5 })
            .expect("both there");
    }
    let mut o = frame(new, base.looked.clone());
    o.key.seq += 1;
    let bytes = wire::encode_delta(&base, &o, &v).expect("small");
    assert!(bytes.len() <= 170, "{} bytes", bytes.len());
    assert_eq!(wire::decode_delta(&bytes, &base, &v).expect("own delta").graph, o.graph);
}

/// A short frame cannot ask for much memory: counts and grids are bounded by its length.
#[test]
fn bombs_are_refused() {
    let v = vocabulary();
    let mut same = SceneGraph::default();
    for k in 0..2_000 {
        same.insert_node(Node::new(NodeId(k), LabelId(0), Box3::new([0.0; 3], [1.0; 3]).expect("finite")));
    }
    let far: Vec<[i32; 3]> = vec![[0, 0, 0], [199, 199, 199]];
    let far = Looked::new(0.5, [0.0; 3], &far).expect("8 million cells");
    for o in [frame(same, None), frame(SceneGraph::default(), Some(far))] {
        let bytes = wire::encode(&o, &v).expect("within limits");
        assert_eq!(wire::decode(&bytes, &v).expect("own frame"), o);
        let held = o.graph.len() * 128 + o.looked.as_ref().map_or(0, |l| l.bits().len());
        assert!(held <= 32 * bytes.len(), "{} bytes ask for {held}", bytes.len());
        // The zeros at the end are what makes it long enough.
        let end = bytes.iter().rposition(|&b| b != 0).expect("not all zero");
        assert!(wire::decode(&bytes[..=end], &v).is_err());
    }
}
