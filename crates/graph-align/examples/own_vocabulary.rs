//! Classes of a warehouse, with racks as structure: `cargo run -p graph-align --example own_vocabulary`.

#![allow(clippy::print_stdout, reason = "an example")]

use graph_align::{
    Box3, Error, Node, NodeId, Outcome, Params, Query, RobustParams, SceneGraph, Vocabulary, align,
};

fn main() -> Result<(), Error> {
    let names =
        Vocabulary::new(["rack", "pallet", "forklift", "charger", "bin"], ["stands on", "stands in"])?;
    let label = |name: &str| names.find_label(name).unwrap_or_default();
    let objects = [
        ("rack", 0.0, 0.0, 8.0),
        ("pallet", 1.0, 2.0, 1.2),
        ("pallet", 3.5, 2.4, 1.2),
        ("forklift", 5.0, 4.0, 2.0),
        ("charger", -1.0, 3.0, 0.5),
        ("bin", 2.2, 4.6, 0.8),
        ("bin", 4.1, 0.9, 0.8),
    ];
    let mut map = SceneGraph::default();
    let mut seen = SceneGraph::default();
    for (k, (name, x, y, size)) in objects.into_iter().enumerate() {
        let node = |at: [f32; 3]| -> Result<Node, Error> {
            let bounds = Box3::new(at, [size, size, 1.0])?;
            Ok(Node { score: 0.9, ..Node::new(NodeId(k as u64), label(name), bounds) })
        };
        map.insert_node(node([x, y, 0.5])?);
        // The other robot stands a quarter turn round and far off.
        seen.insert_node(node([100.0 - y, 30.0 + x, 0.5])?);
    }
    // How much of a rack was seen decides where its centroid is: it shall not vote.
    let robust = RobustParams { structure: vec![label("rack")], ..RobustParams::default() };
    match align(&map, &Query::new(&seen), &Params { robust, ..Params::default() }) {
        Outcome::Match(m) => {
            let turn = m.reference_from_query.rotation.euler_angles().2.to_degrees();
            println!("turned by {turn:.1} degrees, {} pairs, evidence {:.1}", m.pairs.len(), m.score);
        }
        other => println!("{other:?}"),
    }
    Ok(())
}
