//! How often two visits of one room are aligned, and visits of different rooms are not, from the frames of a
//! bench run in shared frames: `cargo run -r -p benches --bin visit_pairs -- FILE.bin`.
//!
//! Every visit is turned and shifted, then aligned with every other one of its room, and with one in 23 of the
//! other rooms'. Rooms are told apart by where their nodes lie, so the frames must be shared.

#![allow(clippy::print_stdout, reason = "a program speaks")]

use graph_align::{
    Observation, Outcome, Params, Query, RobustParams, SceneGraph, Vocabulary, align, append, wire,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use scan3r::LabelSet;

/// Visits whose nodes' means are nearer than this are of one room, metres.
const ONE_ROOM: f32 = 2.5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("want FILE.bin")?;
    let set = LabelSet::L20;
    let names =
        Vocabulary::new(set.classes().iter().copied().chain(["none"]), set.predicates().iter().copied())?;
    let file = std::fs::read(path)?;
    let visits =
        wire::split(&file)?.into_iter().map(|f| wire::decode(f, &names)).collect::<Result<Vec<_>, _>>()?;
    let params = Params { robust: RobustParams::for_vocabulary(&names), ..Params::default() };
    let (mut own, mut other) = ([0; 4], [0; 3]);
    for (i, a) in visits.iter().enumerate() {
        for (j, b) in visits.iter().enumerate().filter(|(j, _)| *j != i) {
            let at = middle(a);
            let same = (at - middle(b)).xy().norm() < ONE_ROOM;
            if !same && (i * 7 + j * 13) % 23 != 0 {
                continue;
            }
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7 * (i * 31 + j) as f32);
            let t = Isometry3::from_parts(Translation3::new(3.0, -7.0, 0.3), turn);
            let query = append(&SceneGraph::default(), &a.graph, &t);
            match (align(&b.graph, &Query::new(&query), &params), same) {
                (Outcome::Match(m), true) => {
                    let back = m.reference_from_query * t;
                    let right = (back * at - at).norm() < 0.5 && back.rotation.angle().to_degrees() < 10.0;
                    own[usize::from(!right)] += 1;
                }
                (Outcome::Ambiguous { .. }, true) => own[2] += 1,
                (Outcome::NoMatch { .. }, true) => own[3] += 1,
                (Outcome::Match(_), false) => other[0] += 1,
                (Outcome::Ambiguous { .. }, false) => other[1] += 1,
                (Outcome::NoMatch { .. }, false) => other[2] += 1,
            }
        }
    }
    println!("{} visits", visits.len());
    println!("one room: {} found, {} wrong, {} ambiguous, {} refused", own[0], own[1], own[2], own[3]);
    println!("different rooms: {} matched, {} ambiguous, {} refused", other[0], other[1], other[2]);
    Ok(())
}

fn middle(o: &Observation) -> Point3<f32> {
    let n = o.graph.len().max(1) as f32;
    Point3::from(o.graph.nodes().fold(Vector3::zeros(), |s, x| s + x.bounds.centroid().coords / n))
}
