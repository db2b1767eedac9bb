//! How precise found frames are, from the frames of a bench run in shared frames:
//! `cargo run -r -p benches --bin found_frames -- FILE.bin…`, files under `wire/` of `ma3dsg bench --connect`.
//!
//! Every agent's visits are turned and shifted by a transform of its own, without what they looked through, and
//! folded as if the frames were unknown. Printed per file: how far the visits' yaws, and the middles of their nodes, lie
//! from where they should (quartiles and maximum, degrees and metres); in the end the same of all, and how many agents are
//! in the largest components.

#![allow(clippy::print_stdout, reason = "a program speaks")]

use benches::visits::{middle, names, read};
use graph_align::{Folded, Observation, Params, Replica, RobustParams, SceneGraph, append};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// As `ma3dsg` has it.
const NAMED: f32 = 0.45;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let names = names();
    let mut robust = RobustParams::for_vocabulary(&names);
    robust.named = NAMED;
    let params = Params { robust, ..Params::default() };
    let (mut yaws, mut shifts, mut found, mut all) = (Vec::new(), Vec::new(), 0, 0);
    for path in std::env::args().skip(1) {
        let visits = read(&path, &names)?;
        let agents: BTreeSet<u16> = visits.iter().map(|o| o.key.agent).collect();
        let own: BTreeMap<u16, Isometry3<f32>> =
            agents.iter().enumerate().map(|(k, a)| (*a, frame(k))).collect();
        let mut replica = Replica::default();
        for o in &visits {
            let t = own.get(&o.key.agent).copied().unwrap_or_else(Isometry3::identity);
            let graph = append(&SceneGraph::default(), &o.graph, &t);
            replica.apply(Observation { frame: u32::from(o.key.agent), graph, looked: None, ..o.clone() })?;
        }
        let folded = replica.fold(&params);
        let errors = errors(&folded, &visits, &own);
        let (mut y, mut s): (Vec<f32>, Vec<f32>) = errors.iter().copied().unzip();
        println!("{path}: yaw {} shift {}", quartiles(&mut y.clone()), quartiles(&mut s.clone()));
        found += folded.components.iter().map(|c| c.frames.len()).max().unwrap_or(0);
        all += agents.len();
        yaws.append(&mut y);
        shifts.append(&mut s);
    }
    println!(
        "{found} of {all} agents; visits: yaw {} shift {}",
        quartiles(&mut yaws),
        quartiles(&mut shifts)
    );
    Ok(())
}

fn frame(k: usize) -> Isometry3<f32> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.9 * k as f32 + 0.3);
    Isometry3::from_parts(Translation3::new(30.0 * k as f32, -17.0 * k as f32, 0.2 * k as f32), turn)
}

/// Of every visit of the largest component but those of its root: degrees, and metres at its nodes' middle.
fn errors(folded: &Folded, visits: &[Observation], own: &BTreeMap<u16, Isometry3<f32>>) -> Vec<(f32, f32)> {
    let Some(c) = folded.components.iter().max_by_key(|c| c.frames.len()) else { return Vec::new() };
    let root = own.get(&(c.root as u16)).copied().unwrap_or_else(Isometry3::identity);
    let mut out = Vec::new();
    for o in visits.iter().filter(|o| o.key.agent != (c.root as u16)) {
        let (Some(t), Some(f)) = (c.frames.get(&(u32::from(o.key.agent))), own.get(&o.key.agent)) else {
            continue;
        };
        let off = root.inverse() * t * f;
        let at = middle(&o.graph);
        out.push((off.rotation.angle().to_degrees(), (off * at - at).norm()));
    }
    out
}

fn quartiles(v: &mut [f32]) -> String {
    v.sort_by(f32::total_cmp);
    let at = |q: usize| v.get((v.len() * q / 4).min(v.len().saturating_sub(1))).copied().unwrap_or(0.0);
    format!("{:.2} {:.2} {:.2} max {:.2}", at(1), at(2), at(3), at(4))
}
