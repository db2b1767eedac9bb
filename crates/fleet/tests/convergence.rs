//! Replicas converge, whatever is lost or late.

#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

use fleet::{LinkParams, Network, VersionVector};
use graph_align::{Box3, Key, LabelId, Node, NodeId, Observation, SceneGraph, Vocabulary};
use proptest::prelude::*;
use std::collections::BTreeSet;

fn observation(agent: u16, seq: u32, start_ds: u32) -> Observation {
    let mut graph = SceneGraph::default();
    let bounds = Box3::new([f32::from(agent), seq as f32, 0.123_456], [0.5; 3]).expect("finite");
    graph.insert_node(Node::new(NodeId(u64::from(agent) << 32 | u64::from(seq)), LabelId(0), bounds));
    Observation {
        key: Key { start_ds, agent, epoch: 0, seq },
        end_ds: start_ds + 5,
        frame: 0,
        graph,
        looked: None,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_replica_ends_with_the_whole_set(
        visits in prop::collection::vec((0_u16..4, 0_u32..40, any::<bool>()), 1..40),
        loss in 0.0_f64..1.0,
        delay_ds in 0_u32..60,
        seed in any::<u64>(),
    ) {
        let v = Vocabulary::new(["chair"], []).expect("names");
        let mut net = Network::new(4, v, LinkParams { loss, delay_ds }, seed);
        let (mut now, mut seq) = (0, [0_u32; 4]);
        let mut starts = BTreeSet::new();
        for (agent, wait, sync) in visits {
            now += wait;
            let a = usize::from(agent);
            // Two at one time are revisions of one visit.
            starts.insert((agent, now));
            net.publish(now, observation(agent, seq[a], now)).expect("published");
            seq[a] += 1;
            if sync {
                net.sync(now, a).expect("synced");
            }
        }
        net.finish(now).expect("finished");
        for agent in 0..4 {
            prop_assert_eq!(net.replica(agent).len(), starts.len());
            prop_assert_eq!(net.replica(agent).state_hash(), net.replica(0).state_hash());
            prop_assert!(net.replica(agent).observations().eq(net.replica(0).observations()));
        }
    }

    #[test]
    fn a_version_vector_is_a_set(keys in prop::collection::vec((0_u16..3, 0_u32..30), 0..60)) {
        let (mut v, mut set) = (VersionVector::default(), BTreeSet::new());
        for (agent, seq) in keys {
            v.insert(&Key { start_ds: 0, agent, epoch: 0, seq });
            set.insert((agent, seq));
        }
        for agent in 0..3 {
            for seq in 0..31 {
                let key = Key { start_ds: 9, agent, epoch: 0, seq };
                prop_assert_eq!(v.contains(&key), set.contains(&(agent, seq)));
            }
        }
    }
}

#[test]
fn traffic_counts_a_broadcast_once_and_every_copy() {
    let v = Vocabulary::new(["chair"], []).expect("names");
    let mut net = Network::new(5, v.clone(), LinkParams::default(), 1);
    let o = observation(2, 0, 7);
    let bytes = graph_align::wire::encode(&o, &v).expect("frame").len() as u64;
    net.publish(12, o).expect("published");
    assert_eq!((net.traffic(2).sent, net.traffic(2).copies), (bytes, 4 * bytes));
    assert_eq!(net.frames().len(), 1);
    assert!((0..5).all(|a| net.replica(a).len() == 1));
}
