//! Who visits which room, and what two hand-made graphs are worth:
//! `cargo run -p bench-3rscan --example plan_and_score`

#![allow(clippy::print_stdout, reason = "an example prints")]

use bench_3rscan::layout::Placement;
use bench_3rscan::rates::{Counts, measure};
use bench_3rscan::scenario::{PlanParams, Replay, Scenario, plan};
use bench_3rscan::truth::{Truth, TruthCounts, TruthNode};
use graph_align::{Box3, Edge, Node, NodeId, SceneGraph, Vocabulary};
use nalgebra::Isometry3;
use room_synth::{Split, World, WorldParams};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    visits()?;
    scores()
}

/// Five generated rooms, three agents. Nothing is rendered: a plan needs frame counts alone.
fn visits() -> Result<()> {
    let world = World::new(Split::Test, 1, 5, &WorldParams { rescans: false, ..WorldParams::default() });
    let plan = plan(
        &world,
        &PlanParams {
            rooms: 5,
            agents: 3,
            overlap: 0.2,
            scenario: Scenario::Scp,
            connect: false,
            replay: Replay::Halves,
            seed: 1,
        },
    )?;
    println!("{} visits, measured overlap {:.2}", plan.visits.len(), plan.overlap_measured);
    for v in &plan.visits {
        println!(
            "  agent {} in room {} (pass {}): {} frames, {:.1} s to {:.1} s",
            v.agent,
            v.room,
            v.pass,
            v.len(),
            v.start,
            v.end()
        );
    }
    Ok(())
}

/// A chair on a floor, against a graph that has it right and one that doubles the chair and takes
/// the floor for a table.
fn scores() -> Result<()> {
    let v = Vocabulary::new(["chair", "floor", "table"], ["standing on"])?;
    let label = |name: &str| v.find_label(name).ok_or("no such class");
    let on = v.find_predicate("standing on").ok_or("no such predicate")?;
    let chair = Box3::new([1.0, 1.0, 0.45], [0.5, 0.5, 0.9])?;
    let floor = Box3::new([2.0, 1.5, 0.0], [4.0, 3.0, 0.02])?;

    let node = |id, name: &str, bounds| -> Result<TruthNode> {
        Ok(TruthNode { id, room: 0, label: Some(label(name)?), raw: name.to_owned(), bounds, ignore: false })
    };
    let truth = Truth {
        nodes: vec![node(1, "chair", chair)?, node(2, "floor", floor)?],
        edges: vec![(1, 2, on)],
        counts: TruthCounts { nodes: 2, edges: 1, unchanged: 2, ..TruthCounts::default() },
    };
    let room = Placement {
        domain_from_reference: Isometry3::identity(),
        bounds: Box3::new([2.0, 1.5, 1.25], [4.0, 3.0, 2.5])?,
    };

    let mut right = SceneGraph::default();
    right.insert_node(Node::new(NodeId(10), label("chair")?, chair));
    right.insert_node(Node::new(NodeId(11), label("floor")?, floor));
    right.insert_edge(Edge { s: NodeId(10), t: NodeId(11), p: on, score: 1.0 })?;

    let mut wrong = right.clone();
    wrong.insert_node(Node::new(NodeId(11), label("table")?, floor));
    wrong.insert_node(Node::new(NodeId(12), label("chair")?, Box3::new([1.1, 1.0, 0.45], [0.5, 0.5, 0.9])?));

    for (name, graph) in [("right", &right), ("wrong", &wrong)] {
        let m = measure(&truth, graph, std::slice::from_ref(&room)).main;
        println!("{name}:");
        line("object", &m.object);
        // A predicate needs both ends at their place, a triplet their classes too.
        line("predicate", &m.predicate);
        line("triplet", &m.triplet);
    }
    Ok(())
}

fn line(name: &str, c: &Counts) {
    let r = c.rates();
    let percent = |v: Option<f64>| v.map_or("none".to_owned(), |v| format!("{v:.1} %"));
    println!(
        "  {name}: tp {}, fp {}, fn {}; R {}, P {}, F1 {}",
        r.tp,
        r.fp,
        r.fn_,
        percent(r.r),
        percent(r.p),
        percent(r.f1)
    );
}
