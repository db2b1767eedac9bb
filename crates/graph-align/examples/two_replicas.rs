//! Two robots hear each other's observations in different orders and end with the same graph:
//! `cargo run -p graph-align --example two_replicas`.

#![allow(clippy::print_stdout, reason = "an example")]

use graph_align::{
    Box3, Error, Key, Node, NodeId, Observation, Params, Replica, RobustParams, SceneGraph, Vocabulary,
};

/// What a robot saw of a row of objects, from a frame that is `shift` metres off.
fn seen(
    agent: u16,
    labels: &[(&str, f32, f32)],
    shift: f32,
    names: &mut Vocabulary,
) -> Result<Observation, Error> {
    let mut graph = SceneGraph::default();
    for (k, (label, x, y)) in labels.iter().enumerate() {
        let id = NodeId(u64::from(agent) << 32 | k as u64);
        let bounds = Box3::new([x + shift, *y, 0.5], [0.6, 0.6, 1.0])?;
        graph.insert_node(Node { score: 0.9, ..Node::new(id, names.label(label)?, bounds) });
    }
    let key = Key { start_ds: u32::from(agent) * 100, agent, epoch: 0, seq: 0 };
    let frame = u32::from(agent);
    Ok(Observation { key, end_ds: key.start_ds + 90, frame, graph: graph.quantised(), looked: None })
}

fn main() -> Result<(), Error> {
    let mut names = Vocabulary::default();
    let room = [
        ("sofa", 0.0, 0.0),
        ("table", 1.6, 0.4),
        ("chair", 2.5, 1.4),
        ("lamp", -0.4, 2.2),
        ("shelf", 3.1, -1.2),
        ("plant", 1.1, 3.0),
        ("bin", -1.5, 1.0),
    ];
    let first = seen(0, &room[..6], 0.0, &mut names)?;
    let second = seen(1, &room, 40.0, &mut names)?;

    let (mut a, mut b) = (Replica::default(), Replica::default());
    a.apply(first.clone())?;
    a.apply(second.clone())?;
    b.apply(second)?;
    b.apply(first.clone())?;
    b.apply(first)?; // heard twice

    let params = Params { robust: RobustParams::for_vocabulary(&names), ..Params::default() };
    let folded = a.fold(&params);
    assert_eq!(folded, b.fold(&params));
    for c in &folded.components {
        println!("{} objects in the frames {:?}", c.graph.len(), c.frames.keys().collect::<Vec<_>>());
        for n in c.graph.nodes() {
            println!("  {} seen {} times", names.label_name(n.label), n.sightings);
        }
    }
    Ok(())
}
