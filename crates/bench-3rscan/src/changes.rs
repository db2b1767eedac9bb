//! What a merge made of objects that moved, went and came, visit by visit (BENCH.md section 3, Change).

use crate::correspond::{Limit, correspond};
use crate::truth::State;
use graph_align::{NodeId, SceneGraph};
use nalgebra::Point3;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// An object whose pose differs by more than this moved: metres at its middle, radians.
const MOVED: (f32, f32) = (0.05, 0.0175);
/// A node whose middle went farther than this was moved by the merge, metres.
const CARRIED: f32 = 0.5;
/// A node that went while one of its class overlaps it by this much became a part of that one.
const ABSORBED: f32 = 0.3;

/// Right, wrong and missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    /// Said and so.
    pub tp: usize,
    /// Said and not so.
    pub fp: usize,
    /// So and not said.
    #[serde(rename = "fn")]
    pub missed: usize,
}

impl Tally {
    fn is(&mut self, said: bool) {
        *(if said { &mut self.tp } else { &mut self.missed }) += 1;
    }
}

/// Over objects that the merged graph held before a visit and whose place the visit looked at; added ones: that
/// the visit's own graph shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Changes {
    /// Of objects whose pose changed: their node lies nearer to the new place.
    pub moved: Tally,
    /// Of objects that are gone: so is their node.
    pub removed: Tally,
    /// Of objects that were not there: they have a node that was not there. Wrong: a second node of one that was.
    pub added: Tally,
    /// Nodes that were removed from places at which the visit did not look.
    pub false_removed_unseen: usize,
    /// Nodes that were removed although the visit saw their object.
    pub false_removed_seen: usize,
}

/// One step of a fold, all in the domain frame.
pub struct Step<'a> {
    /// Merged graph before the visit, named nodes.
    pub before: &'a SceneGraph,
    /// Every node before it.
    pub all_before: &'a BTreeSet<NodeId>,
    /// Merged graph after it, named nodes.
    pub after: &'a SceneGraph,
    /// Every node after it.
    pub all_after: &'a BTreeSet<NodeId>,
    /// The visit's own graph.
    pub visit: &'a SceneGraph,
    /// Whether the visit looked at a place.
    pub looked: &'a dyn Fn(&Point3<f32>) -> bool,
    /// The room when it was visited last.
    pub was: &'a State,
    /// The room during the visit.
    pub is: &'a State,
}

impl Step<'_> {
    fn moved(&self, object: u64) -> bool {
        let (Some((was, a)), Some((_, b))) = (self.was.objects.get(&object), self.is.objects.get(&object))
        else {
            return false;
        };
        let by = b * a.inverse();
        (by * was - was).norm() > MOVED.0 || by.rotation.angle() > MOVED.1
    }

    fn is_absorbed(&self, id: NodeId) -> bool {
        let Some(n) = self.before.node(id) else { return false };
        self.after.nodes().any(|a| a.label == n.label && a.bounds.iou(&n.bounds) > ABSORBED)
    }
}

fn objects(state: &State, graph: &SceneGraph) -> BTreeMap<NodeId, u64> {
    let of = correspond(&state.truth, graph, Limit::Iou(0.0));
    of.into_iter().map(|(node, k)| (node, state.truth.nodes[k].id)).collect()
}

impl Changes {
    /// Adds one step.
    pub fn count(&mut self, s: &Step<'_>) {
        let (before, after) = (objects(s.was, s.before), objects(s.is, s.after));
        let shown: BTreeSet<u64> = objects(s.is, s.visit).into_values().collect();
        let known: BTreeSet<u64> = before.values().copied().collect();
        for n in s.before.nodes() {
            let (object, at) = (before.get(&n.id).copied(), n.bounds.centroid());
            let there = object.filter(|o| s.is.objects.contains_key(o));
            let looked = (s.looked)(&at);
            let now = s.after.node(n.id);
            if looked && let (Some(_), None) = (object, there) {
                self.removed.is(!s.all_after.contains(&n.id));
            }
            if looked && let Some(o) = there.filter(|o| s.moved(*o)) {
                let near = |state: &State, p: &Point3<f32>| {
                    let t = state.truth.nodes.iter().find(|t| t.id == o);
                    t.map_or(f32::MAX, |t| (t.bounds.centroid() - p).norm())
                };
                let place = now.map(|n| n.bounds.centroid());
                self.moved.is(place.is_some_and(|p| near(s.is, &p) < near(s.was, &p)));
            } else if there.is_some() && now.is_some_and(|m| (m.bounds.centroid() - at).norm() > CARRIED) {
                self.moved.fp += 1;
            }
            if s.all_after.contains(&n.id)
                || s.is_absorbed(n.id)
                || (looked && object.is_some() && there.is_none())
            {
                continue;
            }
            self.removed.fp += usize::from(looked && there.is_some());
            self.false_removed_unseen += usize::from(!looked);
            self.false_removed_seen += usize::from(looked && there.is_some_and(|o| shown.contains(&o)));
        }
        let new: BTreeSet<u64> =
            after.iter().filter(|(n, _)| !s.all_before.contains(n)).map(|(_, o)| *o).collect();
        for object in s.is.objects.keys() {
            if !s.was.objects.contains_key(object) && shown.contains(object) {
                self.added.is(new.contains(object));
            }
        }
        self.added.fp += new.iter().filter(|o| s.was.objects.contains_key(o) && known.contains(o)).count();
    }
}
