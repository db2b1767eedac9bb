//! How often two visits of one room are aligned, and visits of different rooms are not, from the frames of a
//! bench run in shared frames: `cargo run -r -p benches --bin visit_pairs -- FILE.bin`.
//!
//! Every visit is turned and shifted, then aligned with every other one of its room, and with one in 23 of the
//! other rooms'. Rooms are told apart by where their nodes lie, so the frames must be shared.

#![allow(clippy::print_stdout, reason = "a program speaks")]

use benches::visits::{middle, names, read};
use graph_align::{Outcome, Params, Query, RobustParams, SceneGraph, align, append};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Visits whose nodes' means are nearer than this are of one room, metres.
const ONE_ROOM: f32 = 2.5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("want FILE.bin")?;
    let names = names();
    let visits = read(&path, &names)?;
    let params = Params { robust: RobustParams::for_vocabulary(&names), ..Params::default() };
    let (mut own, mut other) = ([0; 4], [0; 3]);
    for (i, a) in visits.iter().enumerate() {
        for (j, b) in visits.iter().enumerate().filter(|(j, _)| *j != i) {
            let at = middle(&a.graph);
            let same = (at - middle(&b.graph)).xy().norm() < ONE_ROOM;
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
