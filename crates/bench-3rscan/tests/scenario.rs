//! Who visits what, when; where rooms stand (BENCH.md section 1).

#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use bench_3rscan::layout::{nearest_room, place};
use bench_3rscan::scenario::{Plan, PlanParams, Replay, Scenario, plan, shared_rooms};
use common::{Tiny, placements};
use nalgebra::Point3;
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

fn params(rooms: usize, agents: usize, overlap: f64, scenario: Scenario, seed: u64) -> PlanParams {
    PlanParams { rooms, agents, overlap, scenario, connect: false, replay: Replay::Halves, seed }
}

/// Agents per room of the first round.
fn owners(p: &Plan) -> BTreeMap<usize, Vec<usize>> {
    let mut out: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for v in p.visits.iter().filter(|v| v.round == 0) {
        out.entry(v.room).or_default().push(v.agent);
    }
    out
}

/// Number of groups of busy agents that share rooms, by repeated merging of sets.
fn components(p: &Plan) -> usize {
    let mut groups: Vec<BTreeSet<usize>> = Vec::new();
    for o in owners(p).values() {
        let mut new: BTreeSet<usize> = o.iter().copied().collect();
        let (hit, rest): (Vec<_>, Vec<_>) = groups.into_iter().partition(|g| !g.is_disjoint(&new));
        new.extend(hit.into_iter().flatten());
        groups = rest;
        groups.push(new);
    }
    groups.len()
}

#[test]
fn the_papers_domains_share_1_2_3_5_rooms() {
    let got = [5, 15, 25, 47].map(|n| shared_rooms(n, 5, 0.2));
    assert_eq!(got, [1, 2, 3, 5]);
    assert_eq!(shared_rooms(47, 1, 0.2), 0);
    assert_eq!(shared_rooms(47, 5, 0.0), 0);
    assert_eq!(shared_rooms(2, 2, 0.01), 1);
    assert_eq!(shared_rooms(1, 2, 0.2), 0);
    assert_eq!(shared_rooms(9, 2, 1.0), 9);
}

#[test]
fn impossible_plans_name_the_flag() {
    let data = Tiny::boxes(3, 0);
    let scp = Scenario::Scp;
    let bad = [
        ("--domain", params(0, 2, 0.2, scp, 1)),
        ("--domain", params(4, 2, 0.2, scp, 1)),
        ("--agents", params(3, 0, 0.2, scp, 1)),
        ("--overlap", params(3, 2, -0.1, scp, 1)),
        ("--overlap", params(3, 2, 1.1, scp, 1)),
        ("--overlap", params(3, 2, f64::NAN, scp, 1)),
    ];
    for (flag, p) in bad {
        let e = plan(&data, &p).unwrap_err().to_string();
        assert!(e.starts_with(flag), "{e}");
    }
}

#[test]
fn two_visitors_of_a_recording_get_the_first_and_the_last_60_percent() {
    let mut data = Tiny::boxes(4, 0);
    for (own, replay) in
        [(false, Replay::Halves), (false, Replay::Same), (true, Replay::Halves), (true, Replay::Same)]
    {
        data.own_paths = own;
        let p = plan(&data, &PlanParams { replay, ..params(4, 2, 1.0, Scenario::Scp, 3) }).unwrap();
        assert_eq!(p.visits.len(), 8);
        for v in &p.visits {
            let n = data.scans[&v.scan].2;
            let part = (0.6 * f64::from(n)).ceil() as u32;
            let want = match (own, replay, v.pass) {
                (false, Replay::Halves, 0) => 0..part,
                (false, Replay::Halves, _) => n - part..n,
                _ => 0..n,
            };
            assert_eq!(v.frames, want);
        }
        let passes: BTreeSet<_> = p.visits.iter().map(|v| (v.room, v.pass)).collect();
        assert_eq!(passes.len(), 8, "each visitor has a pass of its own");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn round_zero(rooms in 1_usize..20, agents in 1_usize..25, overlap in 0.0_f64..=1.0, seed in any::<u64>()) {
        let data = Tiny::boxes(20, 0);
        let p = plan(&data, &params(rooms, agents, overlap, Scenario::Scp, seed)).unwrap();
        let owners = owners(&p);
        prop_assert!(owners.keys().copied().eq(0..rooms), "every room is visited");
        prop_assert!(owners.values().all(|o| o.len() <= 2 && (o.len() < 2 || o[0] != o[1])));
        let formula = (overlap * rooms as f64 / (2.0 - overlap)).round() as usize;
        let least = usize::from(agents >= 2 && rooms >= 2 && overlap > 0.0);
        let wanted = if agents == 1 { 0 } else { formula.max(least).min(rooms) };
        let shared = owners.values().filter(|o| o.len() == 2).count();
        prop_assert_eq!(shared, wanted);
        prop_assert_eq!(p.visits.len(), rooms + shared);
        prop_assert!((p.overlap_measured - 2.0 * shared as f64 / (rooms + shared) as f64).abs() < 1e-12);
        prop_assert_eq!(p.agents, agents);
        // Nobody waits, nobody is in two places.
        for agent in 0..agents {
            let mine: Vec<_> = p.visits.iter().filter(|v| v.agent == agent).collect();
            let mut clock = 0.0;
            for (k, v) in mine.iter().enumerate() {
                prop_assert_eq!(v.seq as usize, k);
                prop_assert!((v.start - clock).abs() < 1e-9);
                prop_assert!((v.end() - v.start - f64::from(v.len()) / 5.0).abs() < 1e-9);
                clock = v.end();
            }
        }
        // Dealing to the least loaded leaves nobody idle while there are rooms.
        let busy = p.visits.iter().map(|v| v.agent).collect::<BTreeSet<_>>().len();
        prop_assert!(busy >= agents.min(rooms));
        prop_assert_eq!(&plan(&data, &params(rooms, agents, overlap, Scenario::Scp, seed)).unwrap(), &p);
    }

    #[test]
    fn connect_leaves_one_component(rooms in 1_usize..20, agents in 2_usize..8, seed in any::<u64>()) {
        let data = Tiny::boxes(20, 0);
        let p = PlanParams { connect: true, ..params(rooms, agents, 0.1, Scenario::Scp, seed) };
        prop_assert_eq!(components(&plan(&data, &p).unwrap()), 1);
    }

    #[test]
    fn rescans(rooms in 1_usize..12, agents in 1_usize..15, rescans in 0_usize..5, overlap in 0.0_f64..=1.0, seed in any::<u64>()) {
        let mut data = Tiny::boxes(12, rescans);
        // Rooms have different numbers of rescans.
        for (k, room) in data.rooms.iter_mut().enumerate() {
            room.scans.truncate(k % (rescans + 1));
        }
        let scp = plan(&data, &params(rooms, agents, overlap, Scenario::Scp, seed)).unwrap();
        let p = plan(&data, &params(rooms, agents, overlap, Scenario::Ldcp, seed)).unwrap();
        let there: usize = data.rooms[..rooms].iter().map(|r| r.scans.len()).sum();
        prop_assert_eq!(p.visits.len(), scp.visits.len() + there);
        let zero: Vec<_> = p.visits.iter().filter(|v| v.round == 0).cloned().collect();
        prop_assert_eq!(zero, scp.visits);
        for (k, entry) in data.rooms[..rooms].iter().enumerate() {
            let mine: Vec<_> = p.visits.iter().filter(|v| v.room == k).collect();
            let seen: Vec<_> = mine.iter().filter(|v| v.round > 0).map(|v| v.scan.clone()).collect();
            let want: Vec<_> = entry.scans.iter().map(|s| s.id.clone()).collect();
            prop_assert_eq!(seen, want, "each rescan once, in the order of the file");
            for v in mine.iter().filter(|v| v.round > 0) {
                let before: Vec<_> = mine.iter().filter(|b| b.round < v.round).collect();
                prop_assert!(before.iter().all(|b| b.end() <= v.start + 1e-9));
                let last = before.iter().map(|b| b.end()).fold(0.0, f64::max);
                let by: BTreeSet<_> = before.iter().filter(|b| b.end() >= last - 1e-9).map(|b| b.agent).collect();
                // Two first visitors may end at the same moment: then either counts as the last.
                prop_assert!(agents == 1 || by.len() > 1 || !by.contains(&v.agent));
                prop_assert_eq!(v.frames.clone(), 0..data.scans[&v.scan].2);
            }
        }
        for agent in 0..agents {
            let mine: Vec<_> = p.visits.iter().filter(|v| v.agent == agent).collect();
            prop_assert!(mine.iter().enumerate().all(|(k, v)| v.seq as usize == k));
            prop_assert!(mine.windows(2).all(|w| w[0].end() <= w[1].start + 1e-9));
        }
    }

    #[test]
    fn rooms_stand_apart(rooms in 1_usize..40, gap in 0.0_f32..5.0, seed in any::<u64>()) {
        let data = Tiny::boxes(40, 0);
        let all = place(&data, 40, gap, seed).unwrap();
        prop_assert_eq!(&all[..rooms], &place(&data, rooms, gap, seed).unwrap()[..]);
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                let apart = (0..3)
                    .map(|k| (a.bounds.min()[k] - b.bounds.max()[k]).max(b.bounds.min()[k] - a.bounds.max()[k]))
                    .fold(f32::MIN, f32::max);
                prop_assert!(apart >= gap - 1e-3, "{} m between rooms", apart);
            }
            // The box holds the room, upright and on the floor, and is no larger than it.
            let points = &data.scans[&data.rooms[i].reference].0.points;
            let (mut lo, mut hi) = (Point3::new(f32::MAX, f32::MAX, f32::MAX), Point3::new(f32::MIN, f32::MIN, f32::MIN));
            for p in points {
                let q = a.domain_from_reference * p;
                (lo, hi) = (lo.inf(&q), hi.sup(&q));
            }
            prop_assert!((lo - a.bounds.min()).amax() < 1e-3 && (hi - a.bounds.max()).amax() < 1e-3);
            prop_assert!(lo.z.abs() < 1e-4);
            let up = a.domain_from_reference * nalgebra::Vector3::z();
            prop_assert!((up - nalgebra::Vector3::z()).norm() < 1e-5);
        }
    }

    #[test]
    fn the_nearest_room_is_nearest(p in prop::array::uniform3(-20.0_f32..40.0)) {
        let rooms = placements(4, 3.0);
        let p = Point3::from(p);
        // Distance to a box by walking to its closest point.
        let distance = |k: usize| {
            let (lo, hi) = (rooms[k].bounds.min(), rooms[k].bounds.max());
            let q = Point3::new(p.x.clamp(lo.x, hi.x), p.y.clamp(lo.y, hi.y), p.z.clamp(lo.z, hi.z));
            (p - q).norm()
        };
        let got = distance(nearest_room(&rooms, &p));
        prop_assert!((0..4).all(|k| got <= distance(k) + 1e-4));
    }
}

#[test]
fn yaws_differ_between_rooms_and_seeds() {
    let data = Tiny::boxes(6, 0);
    let yaws = |seed| {
        place(&data, 6, 3.0, seed)
            .unwrap()
            .iter()
            .map(|p| (p.domain_from_reference.rotation.euler_angles().2 * 1e3).round() as i32)
            .collect::<BTreeSet<_>>()
    };
    assert_eq!(yaws(1).len(), 6);
    assert!(yaws(1).is_disjoint(&yaws(2)));
}
