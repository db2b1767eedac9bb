//! What a merge made of objects that moved, went and came, visit by visit (BENCH.md section 3, Change).

use crate::correspond::{Limit, correspond};
use crate::truth::State;
use graph_align::{Node, NodeId, SceneGraph};
use nalgebra::Point3;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// An object whose pose differs by more than this moved: metres at its middle, radians.
const MOVED: (f32, f32) = (0.05, 0.0175);
/// A node whose middle went farther than this from that of its object was moved by the merge, metres.
const CARRIED: f32 = 0.5;

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
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Changes {
    /// Of objects whose pose changed: their node lies nearer to the new place.
    pub moved: Tally,
    /// Of all objects whose pose changed: those that the visit's own graph does not show.
    pub moved_not_shown: usize,
    /// Of objects that are gone: so is their node, at once or later.
    pub removed: Tally,
    /// Of objects that were not there: they have a node that was not there. Wrong: a second node of one that was.
    pub added: Tally,
    /// Nodes that were removed from places at which the visit did not look.
    pub false_removed_unseen: usize,
    /// Nodes that were removed although the visit saw their object.
    pub false_removed_seen: usize,
    /// Nodes whose object is gone and that are still there.
    #[serde(skip)]
    pub ghosts: BTreeSet<NodeId>,
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
    /// What a node from before it has become: itself, or the node of which it was found to be a part.
    pub heir: &'a dyn Fn(NodeId) -> NodeId,
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
        self.count_ghosts(s);
        let ghosts = self.ghosts.clone();
        for n in s.before.nodes().filter(|n| !ghosts.contains(&n.id)) {
            let (object, looked) = (before.get(&n.id).copied(), (s.looked)(&n.bounds.centroid()));
            let heir = (s.heir)(n.id);
            let lives = s.all_after.contains(&heir);
            self.false_removed_unseen += usize::from(!looked && !lives);
            match object {
                Some(o) if s.is.there.contains(&o) => {
                    self.count_moved(s, &n, o, shown.contains(&o));
                    self.removed.fp += usize::from(looked && !lives);
                    self.false_removed_seen += usize::from(looked && !lives && shown.contains(&o));
                }
                Some(_) if looked => {
                    self.removed.is(!lives);
                    if lives {
                        self.ghosts.insert(heir);
                    }
                }
                _ => {}
            }
        }
        let heirs: BTreeSet<NodeId> = s.all_before.iter().map(|n| (s.heir)(*n)).collect();
        let new: BTreeSet<u64> = after.iter().filter(|(n, _)| !heirs.contains(n)).map(|(_, o)| *o).collect();
        for object in s.is.objects.keys().filter(|o| !s.was.there.contains(o) && shown.contains(o)) {
            self.added.is(new.contains(object));
        }
        let known: BTreeSet<u64> = before.into_values().collect();
        self.added.fp += new.iter().filter(|o| known.contains(o)).count();
    }

    /// What became of nodes whose object was gone before this visit.
    fn count_ghosts(&mut self, s: &Step<'_>) {
        for node in std::mem::take(&mut self.ghosts) {
            let heir = (s.heir)(node);
            if !s.all_before.contains(&node) || s.all_after.contains(&heir) {
                self.ghosts.insert(heir);
            } else {
                self.removed.missed -= 1;
                self.removed.tp += 1;
            }
        }
    }

    /// Whether the node of an object went where the object went.
    fn count_moved(&mut self, s: &Step<'_>, node: &Node, object: u64, shown: bool) {
        let off = |state: &State, p: &Point3<f32>| {
            let t = state.truth.nodes.iter().find(|t| t.id == object);
            t.map_or(f32::MAX, |t| (t.bounds.centroid() - p).norm())
        };
        let at = node.bounds.centroid();
        let now = s.after.node((s.heir)(node.id)).map(|n| n.bounds.centroid());
        if (s.looked)(&at) && s.moved(object) {
            self.moved.is(now.is_some_and(|p| off(s.is, &p) < off(s.was, &p)));
            self.moved_not_shown += usize::from(!shown);
        } else if now.is_some_and(|p| off(s.is, &p) > off(s.is, &at) + CARRIED) {
            self.moved.fp += 1;
        }
    }
}
