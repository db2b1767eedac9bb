//! Three robots, a radio that loses and delays, one graph:
//! `cargo run -p fleet --example three_robots`

#![allow(clippy::print_stdout, reason = "an example prints")]

use fleet::{LinkParams, Network};
use graph_align::{Box3, Error, Key, Node, NodeId, Observation, Params, SceneGraph, Vocabulary};

/// What a robot made of one visit: a chair and a table, at a place that depends on who and when.
fn visit(agent: u16, seq: u32, start_ds: u32, vocabulary: &mut Vocabulary) -> Result<Observation, Error> {
    let (chair, table) = (vocabulary.label("chair")?, vocabulary.label("table")?);
    let x = f32::from(agent) * 5.0 + seq as f32;
    let mut graph = SceneGraph::default();
    graph.insert_node(Node::new(NodeId(0), chair, Box3::new([x, 0.0, 0.45], [0.5, 0.5, 0.9])?));
    graph.insert_node(Node::new(NodeId(1), table, Box3::new([x, 1.0, 0.36], [1.2, 0.8, 0.72])?));
    let key = Key { start_ds, agent, epoch: 0, seq };
    // Frame 0 for all: the robots share one frame, so nothing has to be searched for.
    Ok(Observation { key, end_ds: start_ds + 100, frame: 0, graph, looked: None })
}

fn main() -> Result<(), Error> {
    let mut vocabulary = Vocabulary::new(["chair", "table"], [])?;
    // Half of all copies are lost; the others take three seconds.
    let link = LinkParams { loss: 0.5, delay_ds: 30 };
    let mut net = Network::new(3, vocabulary.clone(), link, 7);
    let mut now = 0;
    for seq in 0..4 {
        for agent in 0..3 {
            // A visit is published at its end, ten seconds after its start.
            let o = visit(agent, seq, now, &mut vocabulary)?;
            now += 100;
            net.publish(now, o)?;
        }
    }
    let held = |net: &Network| [0, 1, 2].map(|a| net.replica(a).len());
    println!("12 visits published; the robots hold {:?} of them", held(&net));

    // Every robot asks every other for what it lacks.
    net.finish(now)?;
    println!("after the last sync they hold {:?}", held(&net));

    let params = Params::default();
    let graphs = [0, 1, 2].map(|a| net.replica(a).fold(&params));
    println!(
        "merged graph: {} objects, equal on all robots: {}",
        graphs[0].main_graph().len(),
        graphs.iter().all(|g| *g == graphs[0])
    );
    for a in 0..3 {
        let t = net.traffic(a);
        println!("robot {a} sent {} bytes, {} with every receiver's copy", t.sent, t.copies);
    }
    Ok(())
}
