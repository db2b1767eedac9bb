//! A place at two times, before noise and frames: what the reference saw, and what the query saw.

use crate::building::{self, Dice, Object, Plan};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeSet;

/// A room that the query's robot walked through.
pub(super) struct Visit {
    pub room_from_domain: Isometry3<f64>,
    pub half: [f64; 2],
    pub views: Vec<Point3<f64>>,
    pub range: f64,
    /// Points of the room on the positive side are not looked at.
    pub cut: (Vector3<f64>, f64),
}

impl Visit {
    pub(super) fn sees(&self, p: &Point3<f64>) -> bool {
        let q = self.room_from_domain * p;
        q.x.abs() < self.half[0] + 0.35
            && q.y.abs() < self.half[1] + 0.35
            && (-0.3..3.0).contains(&q.z)
            && self.views.iter().any(|v| (v - q).norm() < self.range)
            && self.cut.0.dot(&q.coords) < self.cut.1
    }
}

/// Both times of a place, before noise and frames.
pub(super) struct Draft {
    pub kind: &'static str,
    /// Object `i` when the reference was made, and when the query was.
    pub before: Vec<Option<Object>>,
    pub after: Vec<Option<Object>>,
    pub visits: Vec<Visit>,
    pub sigma: f64,
    pub extent_noise: f64,
    pub label_noise: f64,
    pub tilted: bool,
    pub frame_tilt: f64,
    pub drift: bool,
    pub mirror: bool,
    pub outcome: &'static str,
    /// `domain_from_domain` of every equally good place.
    pub alternatives: Vec<Isometry3<f64>>,
    pub edges: bool,
    pub fragments: f64,
    pub relabelled: BTreeSet<usize>,
}

impl Draft {
    pub(super) fn new(kind: &'static str, objects: Vec<Object>, visits: Vec<Visit>) -> Self {
        Self {
            kind,
            before: objects.iter().cloned().map(Some).collect(),
            after: objects.into_iter().map(Some).collect(),
            visits,
            sigma: 0.05,
            extent_noise: 0.1,
            label_noise: 0.0,
            tilted: false,
            frame_tilt: 0.0,
            drift: false,
            mirror: false,
            outcome: "match",
            alternatives: Vec::new(),
            edges: true,
            fragments: 0.0,
            relabelled: BTreeSet::new(),
        }
    }

    pub(super) fn sees(&self, p: &Point3<f64>) -> bool {
        self.visits.iter().any(|v| v.sees(p))
    }
}

pub(super) struct Room {
    pub plan: Plan,
    pub at: Isometry3<f64>,
}

pub(super) fn rooms(dice: &mut Dice, n: usize) -> (Vec<Room>, Vec<Object>) {
    let mut list = Vec::new();
    let mut objects = Vec::new();
    for k in 0..n {
        let plan = Plan::any(dice);
        let furnished = building::room(dice, &plan, k, 1.0);
        let at = building::site(dice, k, n);
        building::place(&mut objects, furnished, &at, k);
        list.push(Room { plan, at });
    }
    (list, objects)
}

pub(super) fn visit(dice: &mut Dice, plan: &Plan, at: &Isometry3<f64>, whole: bool) -> Visit {
    let half = [plan.size[0] / 2.0, plan.size[1] / 2.0];
    let n = 2 + dice.below(2);
    let mut view =
        || Point3::new(dice.within(-half[0], half[0]) * 0.8, dice.within(-half[1], half[1]) * 0.8, 1.5);
    let views = (0..n).map(|_| view()).collect();
    let angle = dice.within(0.0, std::f64::consts::TAU);
    let normal = Vector3::new(angle.cos(), angle.sin(), 0.0);
    let reach = half[0] * normal.x.abs() + half[1] * normal.y.abs();
    let cut = (normal, if whole { 100.0 } else { reach * dice.within(0.45, 1.1) });
    let range = if whole { 20.0 } else { dice.within(4.0, 6.5) };
    Visit { room_from_domain: at.inverse(), half, views, range, cut }
}
