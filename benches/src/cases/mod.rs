//! Alignment cases with truth, in the format `align-case/2`: what a solver may see and what a scorer
//! needs. They imitate the kinds of the public set from seeds of their own, for tuning and benches.

mod draft;
mod kinds;
mod truth;
mod view;

use crate::building::{Dice, yaw_shift};
use draft::Draft;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use view::{CELL, cells, centre, edges, nodes, query_nodes, reference_nodes};

/// Kinds in the order in which they are written.
pub const KINDS: [&str; 19] = [
    "static",
    "tilted",
    "label_noise",
    "moved",
    "rescan",
    "no_overlap",
    "tiny_overlap",
    "ambiguous_twin",
    "twin_distinguishable",
    "ambiguous_symmetric",
    "symmetric_broken",
    "ambiguous_grid",
    "mirrored",
    "duplicates",
    "hub",
    "clique",
    "collinear",
    "shared_frame_drift",
    "empty",
];

/// A case and its truth.
pub struct Case {
    /// Name.
    pub id: String,
    /// `cases/<id>.json`.
    pub case: Value,
    /// `truth/<id>.json`.
    pub truth: Value,
}

/// Cases of a kind; `k` counts within the kind and picks its parameters.
#[must_use]
pub fn make(kind: &'static str, seed: u64, k: usize) -> Case {
    let number = KINDS.iter().position(|n| *n == kind).unwrap_or(0) as u64;
    let mut dice = Dice::new(seed << 20 | number << 12 | k as u64);
    let d = kinds::draft(kind, k, &mut dice);
    finish(&mut dice, d, format!("{seed:x}-{number:02}-{k:03}"))
}

/// Where both graphs' frames lie in the domain.
struct Frames {
    reference_from_domain: Isometry3<f64>,
    query_from_domain: Isometry3<f64>,
}

impl Frames {
    fn any(dice: &mut Dice, d: &Draft) -> Self {
        let tau = std::f64::consts::TAU;
        let mut any = |tilt: bool, quarter: bool| {
            let yaw = if quarter { dice.below(4) as f64 * tau / 4.0 } else { dice.within(0.0, tau) };
            let shift = [dice.within(-20.0, 20.0), dice.within(-20.0, 20.0), dice.within(-1.0, 1.0)];
            let f = yaw_shift(yaw, shift);
            if !tilt {
                return f;
            }
            let axis = Vector3::new(dice.normal(1.0), dice.normal(1.0), dice.normal(1.0));
            f * UnitQuaternion::new(axis.normalize() * dice.within(0.6, 3.0))
        };
        let (quarter, other) = (any(false, true), any(false, false));
        let query = any(d.tilted, false);
        let reference_from_domain = if dice.chance(0.5) { quarter } else { other };
        let tilt = Vector3::new(dice.normal(1.0), dice.normal(1.0), 0.0).normalize() * d.frame_tilt;
        Self { reference_from_domain, query_from_domain: query * UnitQuaternion::new(tilt) }
    }

    fn reference_from_query(&self) -> Isometry3<f64> {
        self.reference_from_domain * self.query_from_domain.inverse()
    }
}

fn finish(dice: &mut Dice, d: Draft, id: String) -> Case {
    let frames = Frames::any(dice, &d);
    let cells = cells(&d, &frames.query_from_domain);
    let mut ids: Vec<u64> =
        (0..4 * (d.before.len() as u64 + d.after.len() as u64) + 8).map(|v| v + 100).collect();
    dice.shuffle(&mut ids);
    let mut reference = reference_nodes(dice, &d, &frames.reference_from_domain, &mut ids);
    let mut query = query_nodes(dice, &d, &frames.query_from_domain, &cells, &mut ids);
    let truth = truth::truth(&d, &query, &reference, &cells, &frames);
    let edges_q = edges(dice, &d, &d.after, &query);
    let edges_r = edges(dice, &d, &d.before, &reference);
    dice.shuffle(&mut query);
    dice.shuffle(&mut reference);
    let mut case = json!({
        "schema": "align-case/2", "id": id, "gravity_aligned": !d.tilted,
        "query": {"nodes": nodes(&query), "edges": edges_q},
        "reference": {"nodes": nodes(&reference), "edges": edges_r},
        "seen_query": {"cell": CELL, "origin": [0.0, 0.0, 0.0], "cells": cells.iter().collect::<Vec<_>>()},
    });
    if d.drift {
        let at = Translation3::from(centre(&query).coords);
        let yaw = dice.within(-5.0, 5.0_f64).to_radians();
        let error = yaw_shift(yaw, [dice.normal(0.3), dice.normal(0.3), dice.normal(0.05)]);
        let prior = frames.reference_from_query() * (at * error * at.inverse());
        case["T_ref_query_prior"] = json!(row_major(&prior));
    }
    let truth = json!({
        "id": id, "kind": d.kind, "tolerance": {"rot_deg": 5.0, "trans_m": 0.3}, "truth": truth,
    });
    Case { id, case, truth }
}

fn row_major(t: &Isometry3<f64>) -> Vec<f64> {
    t.to_homogeneous().transpose().as_slice().to_vec()
}
