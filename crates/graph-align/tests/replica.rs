//! Replicas over their whole life: entries in any order and any number of times, revisions, retractions and
//! their collection, windows, snapshots, late robots. All end with the same bytes.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, reason = "a test")]

mod common;
#[path = "common/rooms.rs"]
mod rooms;

use graph_align::{
    Box3, Edge, Error, Folded, Key, LabelId, Node, NodeId, Observation, Params, PredicateId, Replica,
    Retraction, SceneGraph, VersionVector, Vocabulary, wire,
};
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;
use rooms::{Dice, any_pose, building, looked_around, moved, noisy, part, room};
use std::collections::BTreeMap;

const AGENTS: u16 = 3;
const WINDOW_DS: u32 = 400;

#[derive(Clone, Debug)]
enum Entry {
    Seen(Observation),
    Withdrawn(Retraction),
}

impl Entry {
    fn key(&self) -> Key {
        match self {
            Self::Seen(o) => o.key,
            Self::Withdrawn(r) => r.key,
        }
    }

    fn give(&self, to: &mut Replica) -> Result<bool, Error> {
        match self {
            Self::Seen(o) => to.apply(o.clone()),
            Self::Withdrawn(r) => to.retract(r.clone()),
        }
    }
}

/// What stories and lives were made of.
#[derive(Clone, Copy, Debug, Default)]
struct Stats {
    agents: usize,
    observations: usize,
    revisions: usize,
    moves: usize,
    removals: usize,
    retractions: usize,
    joins: usize,
    duplicates: usize,
    collected: usize,
    snapshots: usize,
    late_robots: usize,
    merges: usize,
}

impl Stats {
    fn list(&self) -> [(&'static str, usize); 12] {
        [
            ("agents", self.agents),
            ("observations", self.observations),
            ("revisions", self.revisions),
            ("moves", self.moves),
            ("removals", self.removals),
            ("retractions", self.retractions),
            ("joins", self.joins),
            ("duplicates", self.duplicates),
            ("collected", self.collected),
            ("snapshots", self.snapshots),
            ("late robots", self.late_robots),
            ("merges", self.merges),
        ]
    }

    fn add(&mut self, o: &Self) {
        self.agents = self.agents.max(o.agents);
        self.observations += o.observations;
        self.revisions += o.revisions;
        self.moves += o.moves;
        self.removals += o.removals;
        self.retractions += o.retractions;
        self.joins += o.joins;
        self.duplicates += o.duplicates;
        self.collected += o.collected;
        self.snapshots += o.snapshots;
        self.late_robots += o.late_robots;
        self.merges += o.merges;
    }
}

fn observation(key: Key, end_ds: u32, frame: u32, seen: &SceneGraph, middle: Point3<f32>) -> Observation {
    // Ids of different visits differ, as they do between robots.
    let mut graph = SceneGraph::default();
    let id = |n: NodeId| NodeId(u64::from(key.agent) << 48 | u64::from(key.seq) << 24 | n.0);
    seen.nodes().for_each(|n| {
        graph.insert_node(Node { id: id(n.id), last_seen: f64::from(end_ds) / 10.0, ..n.clone() })
    });
    seen.edges().for_each(|e| graph.insert_edge(Edge { s: id(e.s), t: id(e.t), ..e }).unwrap());
    Observation {
        key,
        end_ds,
        frame,
        graph: graph.quantised(),
        looked: Some(looked_around(middle, 4.0).quantised()),
    }
}

/// Fifteen visits of three agents to two rooms whose objects move, vanish and appear; some in two revisions, some
/// withdrawn. In the order in which they are published.
fn story(seed: u64, stats: &mut Stats) -> Vec<Entry> {
    let mut dice = Dice(seed);
    let mut world = building(&mut dice, 2, 12);
    let frames: [Isometry3<f32>; 3] = [Isometry3::identity(), any_pose(&mut dice), Isometry3::identity()];
    let (mut out, mut next) = (Vec::new(), [0_u32; AGENTS as usize]);
    let mut spoke = [false; AGENTS as usize];
    for visit in 0..15_u32 {
        let r = 1 + dice.below(2) as u64;
        let id = |dice: &mut Dice| NodeId(1000 * r + 1 + dice.below(11) as u64);
        let (gone, went) = (id(&mut dice), id(&mut dice));
        if visit > 2 && dice.below(2) == 0 {
            stats.removals += usize::from(world.remove_node(gone).is_some());
        }
        if let Some(n) = world.node(went).filter(|_| visit > 2) {
            let c = n.bounds.centroid() + Vector3::new(0.8, 0.5, 0.0);
            let bounds = Box3::new(c.coords.into(), n.bounds.extent().into()).unwrap();
            world.insert_node(Node { bounds, ..n });
            stats.moves += 1;
        }
        // The first three visits are those of three agents, so that all of them have a log.
        let agent = if visit < 3 { visit as usize } else { dice.below(3) };
        spoke[agent] = true;
        let pose = frames[agent];
        let start_ds = 100 * visit;
        let key = |next: &mut [u32; 3], start_ds| {
            next[agent] += 1;
            Key { start_ds, agent: agent as u16, epoch: 0, seq: next[agent] - 1 }
        };
        let middle = pose * Point3::new(10.0 * (r as f32 - 1.0), 0.0, 1.0);
        let mut see = |next: &mut [u32; 3], share: u64| {
            let seen = noisy(&part(&world, |id| id / 1000 == r && id % 16 < share), &mut dice, 0.04);
            let at = key(next, start_ds);
            observation(at, start_ds + 80, u32::from(agent == 1), &moved(&seen, &pose), middle)
        };
        if visit % 3 == 1 {
            out.push(Entry::Seen(see(&mut next, 7)));
            stats.revisions += 1;
        }
        out.push(Entry::Seen(see(&mut next, 16)));
        stats.observations += 1;
        if visit % 4 == 2 {
            // Of its own window, of the one before (which is final), or of something that nobody saw.
            let of = match dice.below(4) {
                0 => vec![Key { start_ds, agent: agent as u16, epoch: 7, seq: 3 }],
                1 => out.iter().map(Entry::key).filter(|k| k.start_ds + 500 < start_ds).take(1).collect(),
                _ => vec![out[out.len() - 1 - dice.below(2)].key()],
            };
            let by = dice.below(3);
            next[by] += 1;
            // Said between two visits, so that starts in every log rise.
            let at = Key { start_ds: start_ds + 90, agent: by as u16, epoch: 0, seq: next[by] - 1 };
            out.push(Entry::Withdrawn(Retraction { key: at, of }));
            stats.retractions += 1;
        }
    }
    stats.agents = spoke.iter().filter(|s| **s).count();
    out
}

fn vocabulary() -> Vocabulary {
    let names: Vec<String> = (0..40).map(|k| format!("label{k}")).collect();
    Vocabulary::new(names.iter().map(String::as_str), ["on", "at", "by"]).unwrap()
}

fn bytes(f: &Folded) -> Vec<u8> {
    let v = vocabulary();
    let mut out = Vec::new();
    for c in &f.components {
        let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: 0 };
        let o = Observation { key, end_ds: 0, frame: c.root, graph: c.graph.clone(), looked: None };
        out.extend(wire::encode(&o, &v).unwrap());
        for (frame, t) in &c.frames {
            out.extend(frame.to_le_bytes());
            out.extend(t.to_homogeneous().iter().flat_map(|v| v.to_le_bytes()));
        }
    }
    out
}

fn acknowledged(replicas: &[Replica]) -> BTreeMap<u16, VersionVector> {
    (0..AGENTS).zip(replicas.iter().map(|r| r.vector().clone())).collect()
}

/// Everything that a peer lacks, by what [`Replica::beyond`] says.
fn sync(from: &Replica, to: &mut Replica) {
    let lacks = from.beyond(to.vector());
    lacks.observations.iter().for_each(|o| assert!(to.apply((*o).clone()).unwrap()));
    let v = vocabulary();
    for r in lacks.retractions {
        let frame = wire::encode_retraction(r, &v).unwrap();
        assert_eq!(wire::kind(&frame, &v), Ok(wire::Kind::Retraction));
        assert!(to.retract(wire::decode_retraction(&frame, &v).unwrap()).unwrap());
        assert!(wire::decode_retraction(&[frame, vec![0]].concat(), &v).is_err());
    }
    let gone = wire::encode_gone(&lacks.gone, &v).unwrap();
    assert!(wire::decode(&gone, &v).is_err() && wire::decode_retraction(&gone, &v).is_err());
    to.pass_over(wire::decode_gone(&gone, &v).unwrap()).unwrap();
}

/// Three replicas through a story: entries come late, twice and in no order; replicas join, collect and compact
/// whenever they may; a late robot starts from a snapshot. Beside them one that got everything in order and kept it.
fn life(seed: u64, window_ds: u32) -> Stats {
    let params = Params::default();
    let mut stats = Stats::default();
    let entries = story(seed, &mut stats);
    let mut whole = Replica::with_window(window_ds);
    entries.iter().for_each(|e| assert!(e.give(&mut whole).unwrap()));
    let mut dice = Dice(!seed);
    let mut replicas = vec![Replica::with_window(window_ds); AGENTS as usize];
    for (k, e) in entries.iter().enumerate() {
        assert!(e.give(&mut replicas[usize::from(e.key().agent)]).unwrap());
        for _ in 0..4 {
            // Anything that was said reaches anybody, once more or for the first time.
            let back = dice.below(10).min(k);
            let to = dice.below(3);
            stats.duplicates += usize::from(!entries[k - back].give(&mut replicas[to]).unwrap());
        }
        let (a, b) = (dice.below(3), dice.below(3));
        if a != b && dice.below(3) > 0 {
            let other = replicas[b].clone();
            if dice.below(2) == 0 {
                replicas[a].join(&other).unwrap();
            } else if other.snapshot().is_none_or(|s| replicas[a].vector().covers(s.vector())) {
                sync(&other, &mut replicas[a]);
            }
            stats.joins += 1;
        }
        let known = acknowledged(&replicas);
        let all = known.values().cloned().reduce(|a, b| a.common(&b)).unwrap();
        let who = dice.below(3);
        if dice.below(3) == 0 {
            let before = bytes(&replicas[who].fold(&params));
            stats.collected += replicas[who].collect(&all);
            assert_eq!(bytes(&replicas[who].fold(&params)), before, "collection changes nothing");
        }
        if window_ds > 0 && dice.below(3) == 0 {
            let settled = replicas[who].settled_ds(&known);
            let (before, hash) = (bytes(&replicas[who].fold(&params)), replicas[who].state_hash());
            stats.snapshots += usize::from(replicas[who].compact(settled, &params).unwrap());
            assert_eq!(bytes(&replicas[who].fold(&params)), before, "compaction changes nothing");
            assert_eq!(replicas[who].state_hash(), hash);
        }
    }
    if let Some(from) = replicas.iter().find(|r| r.snapshot().is_some()).cloned() {
        // It travels, and is the same.
        let (v, sent) = (vocabulary(), from.snapshot().unwrap());
        let frame = wire::encode_snapshot(sent, &v).unwrap();
        let arrived = wire::decode_snapshot(&frame, &v).unwrap();
        assert_eq!(&arrived, sent);
        let broken = dice.below(frame.len());
        assert!(wire::decode_snapshot(&frame[..broken], &v).is_err());
        let mut late = Replica::from_snapshot(arrived);
        // What others still hold of before its cut is known to it.
        entries.iter().rev().for_each(|e| {
            let _ = e.give(&mut late).unwrap();
        });
        sync(&from, &mut late);
        replicas.push(late);
        stats.late_robots += 1;
    }
    // A tree of joins in any shape, and back down.
    let mut tree = replicas.clone();
    while tree.len() > 1 {
        let a = tree.swap_remove(dice.below(tree.len()));
        let k = dice.below(tree.len());
        tree[k].join(&a).unwrap();
        stats.joins += 1;
    }
    let reference = whole.fold(&params);
    stats.merges += whole.observations().map(|o| o.graph.len()).sum::<usize>()
        - reference.components.iter().map(|c| c.graph.len()).sum::<usize>();
    for mut r in replicas.into_iter().chain(tree.clone()) {
        r.join(&tree[0]).unwrap();
        assert_eq!(r.state_hash(), whole.state_hash());
        let folded = r.fold(&params);
        assert!(folded == reference, "not the same graph");
        assert_eq!(bytes(&folded), bytes(&reference));
    }
    stats
}

/// What many frames brought together is more than one frame may hold, and travels all the same.
#[test]
fn a_snapshot_may_hold_more_than_a_frame() {
    let (v, params) = (vocabulary(), Params::default());
    let far_apart = |from: u64, n: u64| {
        let mut g = SceneGraph::default();
        for k in from..from + n {
            let at = [(k % 300) as f32 * 10.0, (k / 300) as f32 * 10.0, 0.5];
            g.insert_node(Node::new(NodeId(k), LabelId((k % 3) as u16), Box3::new(at, [1.0; 3]).unwrap()));
            if k > from {
                g.insert_edge(Edge { s: NodeId(k), t: NodeId(k - 1), p: PredicateId(0), score: 1.0 })
                    .unwrap();
            }
        }
        g
    };
    let mut replica = Replica::with_window(100);
    for seq in 0..2 {
        let graph = far_apart(u64::from(seq) * 40_000, 40_000);
        let key = Key { start_ds: seq * 10, agent: 0, epoch: 0, seq };
        assert!(replica.apply(Observation { key, end_ds: 50, frame: 0, graph, looked: None }).unwrap());
    }
    assert!(replica.compact(100, &params).unwrap());
    let sent = replica.snapshot().unwrap();
    assert_eq!(sent.graphs().map(|(_, g)| g.len()).collect::<Vec<_>>(), [80_000]);
    let frame = wire::encode_snapshot(sent, &v).unwrap();
    assert_eq!(&wire::decode_snapshot(&frame, &v).unwrap(), sent);
    // One observation is one frame; the error says what to do.
    let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: 9 };
    let whole = Observation { key, end_ds: 50, frame: 0, graph: far_apart(0, 65_537), looked: None };
    let error = wire::encode(&whole, &v).unwrap_err().to_string();
    assert!(error.contains("65537 nodes") && error.contains("in parts"), "{error}");
}

proptest! {
    #![proptest_config(common::cases(16))]

    #[test]
    fn lives_end_with_the_same_bytes(seed in any::<u64>(), windows in any::<bool>()) {
        life(seed, if windows { WINDOW_DS } else { 0 });
    }

    /// Changed bytes of a snapshot are refused or are another snapshot, and never a panic.
    #[test]
    fn hostile_snapshots_are_refused_or_their_own(at in any::<prop::sample::Index>(), to in any::<u8>()) {
        let (v, g) = (vocabulary(), room(&mut Dice(4), 9, 0));
        let mut r = Replica::with_window(100);
        r.apply(seen(0, 0, 0, &g)).unwrap();
        r.compact(100, &Params::default()).unwrap();
        let mut frame = wire::encode_snapshot(r.snapshot().unwrap(), &v).unwrap();
        let k = at.index(frame.len());
        frame[k] = to;
        if let Ok(s) = wire::decode_snapshot(&frame, &v) {
            prop_assert_eq!(wire::encode_snapshot(&s, &v).unwrap(), frame);
            let _ = Replica::from_snapshot(s).fold(&Params::default());
        }
    }

    #[test]
    fn vectors_travel(keys in prop::collection::vec((0_u16..3, 0_u16..2, 0_u32..30), 0..60), cut in 0_usize..40) {
        let mut v = VersionVector::default();
        keys.iter().for_each(|&(agent, epoch, seq)| v.insert(&Key { start_ds: 0, agent, epoch, seq }));
        let bytes = v.encode();
        prop_assert_eq!(VersionVector::decode(&bytes).unwrap(), v.clone());
        prop_assert!(cut >= bytes.len() || VersionVector::decode(&bytes[..cut]).is_err());
        // Two halves are the whole.
        let (mut a, mut b) = (VersionVector::default(), VersionVector::default());
        for (k, &(agent, epoch, seq)) in keys.iter().enumerate() {
            let half = if k % 2 == 0 { &mut a } else { &mut b };
            half.insert(&Key { start_ds: 0, agent, epoch, seq });
        }
        prop_assert!(v.covers(&a) && v.covers(&b));
        prop_assert!(!a.covers(&v) || a == v);
        a.merge(&b);
        prop_assert_eq!(a, v);
    }

    #[test]
    fn hostile_vectors_are_refused_or_their_own(bytes in prop::collection::vec(any::<u8>(), 0..30)) {
        if let Ok(v) = VersionVector::decode(&bytes) {
            prop_assert_eq!(v.encode(), bytes);
        }
    }
}

/// What the lives hold, so that none of it is missing unseen.
#[test]
fn lives_are_full() {
    let mut sum = Stats::default();
    (0..12).for_each(|seed| sum.add(&life(seed, WINDOW_DS)));
    eprintln!("12 lives: {:?}", sum.list());
    for (what, n) in sum.list() {
        assert!(n > 0, "no {what}");
    }
}

/// In known frames windows only round what they hand on: a centimetre decides about few objects.
#[test]
fn windows_change_little_in_known_frames() {
    let (mut nodes, mut other, mut far) = (0, 0, 0.0_f32);
    for seed in 0..60 {
        let mut all = [Replica::default(), Replica::with_window(WINDOW_DS)];
        for e in story(seed, &mut Stats::default()) {
            if let Entry::Seen(o) = e
                && o.frame == 0
            {
                all.iter_mut().for_each(|r| assert!(r.apply(o.clone()).unwrap()));
            }
        }
        let [one, cut] = all.map(|r| r.fold(&Params::default()).main_graph());
        nodes += one.len();
        other += one.nodes().filter(|n| !cut.has_node(n.id)).count();
        other += cut.nodes().filter(|n| !one.has_node(n.id)).count();
        for (a, b) in one.nodes().filter_map(|n| Some((cut.node(n.id)?, n))) {
            far = far.max((a.bounds.centroid() - b.bounds.centroid()).norm());
        }
    }
    eprintln!("{nodes} nodes, {other} in one of the two graphs alone, the others up to {far} m apart");
    assert!(other * 100 <= nodes && far < 0.1);
}

fn seen(agent: u16, seq: u32, start_ds: u32, g: &SceneGraph) -> Observation {
    let key = Key { start_ds, agent, epoch: 0, seq };
    observation(key, start_ds + 50, 0, g, Point3::origin())
}

/// A retraction that comes first waits for what it withdraws; one of another visit withdraws nothing; an observation
/// that was made after is not withdrawn.
#[test]
fn tombstones_outlive_what_they_withdraw() {
    let (a, b) = (room(&mut Dice(1), 10, 0), room(&mut Dice(2), 11, 100));
    let (first, again) = (seen(0, 0, 0, &a), seen(0, 1, 500, &b));
    let gone = Retraction { key: Key { start_ds: 90, agent: 1, epoch: 0, seq: 0 }, of: vec![first.key] };
    let mut r = Replica::default();
    assert!(r.retract(gone.clone()).unwrap());
    assert!(r.apply(first.clone()).unwrap());
    assert_eq!((r.len(), r.fold(&Params::default()).components.len()), (0, 0));
    assert!(r.apply(again).unwrap());
    assert_eq!(r.fold(&Params::default()).main_graph().len(), 11);
    // Collected: nothing is left of either, and a late copy stays out.
    assert_eq!(r.collect(&VersionVector::default()), 0, "not everybody has it");
    let all = r.vector().clone();
    assert_eq!(r.collect(&all), 1);
    assert_eq!(r.retractions().count(), 0);
    let hash = r.state_hash();
    assert!(!r.apply(first.clone()).unwrap() && !r.retract(gone.clone()).unwrap());
    assert_eq!((r.len(), r.state_hash()), (1, hash));
    // One that never heard of the retraction learns of it by joining.
    let mut other = Replica::default();
    other.apply(first).unwrap();
    other.join(&r).unwrap();
    assert_eq!((other.len(), other.state_hash()), (1, hash));
}

/// Without a liar its retractions are void, too.
#[test]
fn without_an_agent_its_retractions_are_void() {
    let a = room(&mut Dice(1), 10, 0);
    let first = seen(0, 0, 0, &a);
    let mut r = Replica::default();
    r.apply(first.clone()).unwrap();
    let own = r.state_hash();
    r.retract(Retraction { key: Key { start_ds: 90, agent: 9, epoch: 0, seq: 0 }, of: vec![first.key] })
        .unwrap();
    assert!(r.is_empty());
    let rest = r.without(9).unwrap();
    assert_eq!((rest.len(), rest.state_hash()), (1, own));
}

/// The last revision of a visit counts, whichever came last.
#[test]
fn the_last_revision_counts() {
    let g = room(&mut Dice(4), 12, 0);
    let early = seen(0, 0, 0, &part(&g, |id| id < 5));
    let full = seen(0, 1, 0, &g);
    for order in [[&early, &full], [&full, &early]] {
        let mut r = Replica::default();
        order.iter().for_each(|o| assert!(r.apply((*o).clone()).unwrap()));
        let folded = r.fold(&Params::default()).main_graph();
        assert_eq!((r.len(), folded.len()), (1, 12));
        assert!(folded.nodes().all(|n| n.sightings == 1));
    }
}

/// What is final stays: an entry from before the cut that nobody had is refused by name, and so is a removal of an
/// agent that is part of the snapshot.
#[test]
fn the_past_is_closed() {
    let g = room(&mut Dice(4), 12, 0);
    let mut r = Replica::with_window(100);
    r.apply(seen(0, 0, 0, &g)).unwrap();
    r.apply(seen(1, 0, 40, &g)).unwrap();
    r.apply(seen(0, 1, 210, &g)).unwrap();
    let both = BTreeMap::from([(0, r.vector().clone()), (1, r.vector().clone())]);
    assert_eq!(r.settled_ds(&both), 40, "agent 1 may still come from 40 ds on");
    assert!(!r.compact(40, &Params::default()).unwrap());
    assert!(r.compact(230, &Params::default()).unwrap());
    assert_eq!(r.snapshot().unwrap().cut_ds(), 200);
    assert_eq!(r.apply(seen(1, 1, 150, &g)), Err(Error::Late { agent: 1, epoch: 0, seq: 1, cut_ds: 200 }));
    assert!(r.without(1).is_err() && r.without(5).is_ok());
    // A forged copy of what is only known by its number cannot be told from it; another time can.
    assert!(r.apply(Observation { end_ds: 1, ..seen(0, 1, 210, &g) }).is_err());
    assert!(Replica::default().compact(100, &Params::default()).is_err());
    assert!(r.join(&Replica::default()).is_err(), "other windows");
}

/// Robots whose frames are one up to drift: what both saw brings them together, what only one saw is laid where it
/// believes to be, and a place that lies farther off than drift goes is a twin, not the same.
#[test]
fn drifting_frames_are_fitted_and_never_searched_far_away() {
    let seen = |agent: u16, start_ds: u32, graph: &SceneGraph, t: Isometry3<f32>| {
        let key = Key { start_ds, agent, epoch: 0, seq: start_ds };
        observation(key, start_ds + 100, u32::from(agent) + 1, &moved(graph, &t), t * Point3::origin())
    };
    let params = Params { near: Some([0.2, 10.0]), ..Params::default() };
    let mut far_apart = 0;
    for seed in 0..20 {
        let mut dice = Dice(seed);
        let (shared, own) = (room(&mut dice, 14, 0), room(&mut dice, 12, 100));
        let at = |x: f32, y: f32| rooms::yaw_shift(0.0, [x, y, 0.0]);
        let drift = rooms::yaw_shift(dice.within(-0.06, 0.06), [dice.within(-0.4, 0.4), 0.3, 0.05]);
        let story = [
            seen(0, 0, &shared, at(30.0, 5.0)),
            seen(1, 200, &own, drift * at(12.0, -6.0)),
            seen(1, 400, &shared, drift * at(30.0, 5.0)),
            // Another robot, nothing in common.
            seen(2, 600, &room(&mut dice, 12, 200), at(-20.0, 4.0)),
        ];
        let mut replica = Replica::default();
        story.iter().for_each(|o| assert!(replica.apply(o.clone()).unwrap()));
        let folded = replica.fold(&params);
        assert_eq!(folded.components.len(), 1, "seed {seed}");
        let c = &folded.components[0];
        let middle = drift * Point3::new(12.0, -6.0, 1.0);
        let off = (c.frames[&2] * middle - Point3::new(12.0, -6.0, 1.0)).norm();
        assert!(off < 0.05, "{off} m, seed {seed}");
        assert_eq!(c.frames[&3], Isometry3::identity());
        assert_eq!(c.graph.len(), 14 + 12 + 12, "seed {seed}");

        // The same room fifty metres on: a twin.
        let mut twins = Replica::default();
        assert!(twins.apply(seen(0, 0, &shared, at(30.0, 5.0))).unwrap());
        assert!(twins.apply(seen(1, 200, &shared, at(-20.0, 5.0))).unwrap());
        far_apart += twins.fold(&params).components[0].graph.len();
        let anywhere = Params::default();
        assert_eq!(twins.fold(&anywhere).components[0].graph.len(), 14);
    }
    assert_eq!(far_apart, 20 * 28);
}
