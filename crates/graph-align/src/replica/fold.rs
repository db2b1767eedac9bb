//! The merged graph as a function of a set of observations.

use super::Observation;
use crate::robust::{self, Index};
use crate::sightings::Sightings;
use crate::{
    Algorithm, Match, NodeId, Outcome, Params, Query, SceneGraph, Verdict, Why, align_indexed, append, paper,
    update,
};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// A part of the merged graph whose frames are connected.
#[derive(Clone, Debug)]
pub struct Component {
    /// In the frame of its oldest observation.
    pub graph: SceneGraph,
    /// The frame of its oldest observation, in which the graph stands.
    pub root: u32,
    /// `component_from_frame` of every frame in it.
    pub frames: BTreeMap<u32, Isometry3<f32>>,
    /// Of `graph`, for the robust algorithm.
    index: Index,
    /// Where each object was seen, in the frames of those who saw it.
    sightings: Sightings,
    /// Frames that are final.
    held: BTreeSet<u32>,
    /// Nodes that became another one, or a part of it.
    became: BTreeMap<NodeId, NodeId>,
}

impl PartialEq for Component {
    /// The index follows from the graph.
    fn eq(&self, other: &Self) -> bool {
        self.graph == other.graph && self.root == other.root && self.frames == other.frames
    }
}

/// How much farther than [`RobustParams::prior_range`](crate::RobustParams) a visit may lie from where a frame that was
/// found puts it.
const FARTHER: f32 = 3.0;

/// The merged graph, in connected parts, oldest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Folded {
    /// Parts in the order of their oldest observation.
    pub components: Vec<Component>,
}

impl Component {
    fn new(o: &Observation, params: &Params) -> Self {
        let graph = append(&SceneGraph::default(), &o.graph, &Isometry3::identity());
        let index = index_of(&graph, params);
        let sightings = Sightings::of(o);
        let frames = BTreeMap::from([(o.frame, Isometry3::identity())]);
        let (held, became) = Default::default();
        let mut new = Self { graph, root: o.frame, frames, index, sightings, held, became };
        if params.algorithm == Algorithm::Robust {
            let all = new.graph.nodes().map(|n| n.id).collect();
            let joined = robust::parts::join(&mut new.graph, &mut new.index, &all, &all, &params.robust);
            new.sightings.join(&joined);
            new.became.extend(joined);
        }
        new
    }

    /// What a node has become since it came: itself, also where it was removed, or the node of which it was
    /// found to be a part. Forgotten where a window ends.
    #[must_use]
    pub fn heir(&self, id: NodeId) -> NodeId {
        let mut heir = id;
        // A node that is part of another is gone, so that no chain comes back to where it was; ids that are
        // used again could make one.
        for _ in 0..=self.became.len() {
            match self.became.get(&heir).filter(|_| !self.graph.has_node(heir)) {
                Some(&next) => heir = next,
                None => break,
            }
        }
        heir
    }

    /// The part with everything final, from nothing but its root, its frames and its graph: what was seen from
    /// where is no longer known beyond the place of each node.
    pub(super) fn settled(
        root: u32,
        frames: BTreeMap<u32, Isometry3<f32>>,
        graph: &SceneGraph,
        params: &Params,
    ) -> Self {
        let graph = graph.quantised();
        let index = index_of(&graph, params);
        let sightings = Sightings::in_frame(root, &graph);
        let held = frames.keys().copied().collect();
        Self { graph, root, frames, index, sightings, held, became: BTreeMap::new() }
    }

    fn align(&self, query: &Query<'_>, params: &Params) -> Outcome {
        match params.algorithm {
            Algorithm::Robust if self.graph.is_empty() || query.graph.is_empty() => {
                Outcome::NoMatch { why: Why::Empty }
            }
            Algorithm::Robust => robust::align_first(&self.index, query, &params.robust),
            Algorithm::Paper | Algorithm::Append => align_indexed(&self.graph, &self.index, query, params),
        }
    }

    /// Merges a query whose frame is known; beside it what its nodes became (robust alone). The robust
    /// algorithm associates at the known pose where its search refuses: the frames are a matter of fact, the
    /// objects need not be many.
    fn merge(
        &mut self,
        query: &Query<'_>,
        outcome: Outcome,
        pose: &Isometry3<f32>,
        seen: &Sightings,
        params: &Params,
    ) -> BTreeMap<NodeId, NodeId> {
        if params.algorithm != Algorithm::Robust {
            self.graph = update(&self.graph, query, &outcome, params);
            return BTreeMap::new();
        }
        let m = match outcome {
            Outcome::Match(m) => m,
            Outcome::Ambiguous { .. } | Outcome::NoMatch { .. } => {
                robust::associate(&self.index, query, pose, &params.robust)
            }
        };
        let (graph, index) = (&mut self.graph, &mut self.index);
        let merged = robust::merge::merge(graph, Some(index), query.graph, &m, &params.robust);
        for verdict in m.verdicts.values() {
            if let Verdict::Moved(r) = verdict {
                self.sightings.forget(*r);
            }
        }
        merged.carried.iter().for_each(|&child| self.sightings.forget(child));
        self.sightings.add(seen, &merged.image);
        let together = merged.image.values().copied().collect();
        let joined = robust::parts::join(graph, index, &merged.touched, &together, &params.robust);
        self.sightings.join(&joined);
        self.became.extend(joined);
        merged.image
    }

    /// Whether a frame was found and may still be found better.
    fn is_open(&self, frame: u32) -> bool {
        frame != self.root && !self.held.contains(&frame)
    }

    /// The frames fitted to all that was seen from more than one of them; the root's stays.
    fn refined(&self, params: &Params) -> BTreeMap<u32, Isometry3<f32>> {
        let objects =
            |id: NodeId| self.graph.node(id).is_some_and(|n| !params.robust.structure.contains(&n.label));
        self.sightings.fit(self.root, &self.frames, &self.held, objects)
    }
}

fn query_of(o: &Observation) -> Query<'_> {
    Query { looked: o.looked.as_ref(), ..Query::new(&o.graph) }
}

/// Whether a graph that is laid there stays as near as drift allows ([`Params::near`]).
fn is_near(graph: &SceneGraph, t: &Isometry3<f32>, params: &Params) -> bool {
    let Some([turn, shift]) = params.near else { return true };
    let sum = graph.nodes().fold(Vector3::zeros(), |s, n| s + n.bounds.centroid().coords);
    let middle = Point3::from(sum / graph.len().max(1) as f32);
    t.rotation.angle() <= turn && (t * middle - middle).norm() <= shift
}

fn index_of(graph: &SceneGraph, params: &Params) -> Index {
    match params.algorithm {
        Algorithm::Robust => Index::of(graph, &params.robust),
        Algorithm::Paper | Algorithm::Append => Index::default(),
    }
}

impl Folded {
    /// Folds more observations, in their order.
    ///
    /// Where frames had to be found, they are folded twice: the first run finds who saw which object, all
    /// frames that are not final are then fitted to all of that at once ([`Self::frames`]), and the second run
    /// merges in those frames.
    pub(super) fn with(self, list: &[&Observation], params: &Params) -> Self {
        let first = self.clone().pushed(list, &BTreeMap::new(), params);
        let open = |c: &Component| c.frames.keys().any(|f| c.is_open(*f));
        let apart = params.near.is_some() && first.components.len() > 1;
        let found = apart || first.components.iter().any(open);
        if found && params.algorithm == Algorithm::Robust {
            self.pushed(list, &first.frames(params), params)
        } else {
            first
        }
    }

    fn pushed(
        mut self,
        list: &[&Observation],
        frames: &BTreeMap<u32, (u32, Isometry3<f32>)>,
        params: &Params,
    ) -> Self {
        self.bring_together(frames, params);
        for o in list {
            let known = frames.get(&o.frame);
            let home =
                known.and_then(|(root, _)| self.components.iter().position(|c| c.frames.contains_key(root)));
            if let (Some(k), Some((_, t))) = (home, known) {
                self.components[k].frames.entry(o.frame).or_insert(*t);
            }
            self.push(o, params);
        }
        self
    }

    /// Parts whose roots are known to lie in one frame are laid together.
    fn bring_together(&mut self, frames: &BTreeMap<u32, (u32, Isometry3<f32>)>, params: &Params) {
        let mut k = 1;
        while let Some(c) = self.components.get(k) {
            let known = frames.get(&c.root).filter(|(root, _)| *root != c.root);
            let home = known.and_then(|(root, t)| {
                let at = self.components[..k].iter().position(|c| c.frames.contains_key(root))?;
                Some((at, *t))
            });
            match home {
                Some((at, t)) => self.link(at, k, &t, params),
                None => k += 1,
            }
        }
    }

    /// Everything so far becomes final ([`Component::settled`]).
    pub(super) fn settled(self, params: &Params) -> Self {
        let settle = |c: Component| Component::settled(c.root, c.frames, &c.graph, params);
        Self { components: self.components.into_iter().map(settle).collect() }
    }

    /// One step of the fold.
    pub fn push(&mut self, o: &Observation, params: &Params) {
        let query = query_of(o);
        // The other algorithms take nearness for sameness.
        let same = params.near.is_some() && params.algorithm != Algorithm::Robust;
        if let Some(c) = self.components.first_mut().filter(|_| same) {
            c.frames.entry(o.frame).or_insert_with(Isometry3::identity);
        }
        if let Some(k) = self.components.iter().position(|c| c.frames.contains_key(&o.frame)) {
            self.push_known(k, o, params);
        } else if let Some((k, m)) = self.best_match(o, None, params) {
            let (c, t) = (&mut self.components[k], m.reference_from_query);
            c.frames.insert(o.frame, t);
            c.merge(&query, Outcome::Match(m), &t, &Sightings::of(o), params);
        } else {
            self.components.push(Component::new(o, params));
        }
    }

    /// The component in which the query is found with the highest score, the oldest of equals.
    fn best_match(&self, o: &Observation, but: Option<usize>, params: &Params) -> Option<(usize, Match)> {
        let query = query_of(o);
        let mut best: Option<(usize, Match)> = None;
        for (k, c) in self.components.iter().enumerate().filter(|(k, _)| Some(*k) != but) {
            if let Outcome::Match(m) = c.align(&query, params)
                && is_near(&o.graph, &m.reference_from_query, params)
                && best.as_ref().is_none_or(|(_, b)| m.score > b.score)
            {
                best = Some((k, m));
            }
        }
        best
    }

    /// The observation's frame is known: it joins its component, and may link another to it.
    fn push_known(&mut self, k: usize, o: &Observation, params: &Params) {
        let pose = self.components[k].frames.get(&o.frame).copied().unwrap_or_else(Isometry3::identity);
        let at = Query { prior: Some(pose), ..query_of(o) };
        let c = &self.components[k];
        let outcome = match c.align(&at, params) {
            // What is a degree off where it was found is metres off at the other end of a building.
            Outcome::NoMatch { .. } if c.is_open(o.frame) => {
                let mut wide = params.clone();
                wide.robust.prior_range *= FARTHER;
                c.align(&at, &wide)
            }
            outcome => outcome,
        };
        self.components[k].merge(&at, outcome, &pose, &Sightings::of(o), params);
        if let Some((other, m)) = self.best_match(o, Some(k), params) {
            self.link(k, other, &(pose * m.reference_from_query.inverse()), params);
        }
    }

    /// Lays component `b` into `a`; the older of the two keeps its frame.
    fn link(&mut self, a: usize, b: usize, a_from_b: &Isometry3<f32>, params: &Params) {
        let (keep, gone, t) = if a < b { (a, b, *a_from_b) } else { (b, a, a_from_b.inverse()) };
        let gone = self.components.remove(gone);
        let c = &mut self.components[keep];
        for (frame, from_frame) in gone.frames {
            c.frames.insert(frame, t * from_frame);
        }
        c.held.extend(gone.held);
        let query = Query::new(&gone.graph);
        let m = match params.algorithm {
            Algorithm::Robust => robust::associate(&c.index, &query, &t, &params.robust),
            Algorithm::Paper | Algorithm::Append => Match {
                reference_from_query: t,
                pairs: Vec::new(),
                score: 0.0,
                margin: None,
                verdicts: paper::verdicts(&c.graph, &gone.graph, &t, &params.paper),
                removed: Vec::new(),
                unmet: Vec::new(),
            },
        };
        c.became.extend(gone.became);
        let image = c.merge(&query, Outcome::Match(m), &t, &gone.sightings, params);
        c.became.extend(image.into_iter().filter(|(from, to)| from != to));
    }

    /// Every frame by the root of its component, fitted to all that was seen from more than one frame. Frames that
    /// are one up to drift have the oldest root of all.
    #[must_use]
    pub fn frames(&self, params: &Params) -> BTreeMap<u32, (u32, Isometry3<f32>)> {
        let mut out = BTreeMap::new();
        let oldest = self.components.first().filter(|_| params.near.is_some()).map(|c| c.root);
        for c in &self.components {
            let root = oldest.unwrap_or(c.root);
            out.extend(c.refined(params).into_iter().map(|(f, t)| (f, (root, t))));
        }
        out
    }

    /// The largest part, the older one of equals; empty before the first observation.
    #[must_use]
    pub fn main_graph(&self) -> SceneGraph {
        let largest = self.components.iter().map(|c| c.graph.len()).max();
        self.components
            .iter()
            .find(|c| Some(c.graph.len()) == largest)
            .map(|c| c.graph.clone())
            .unwrap_or_default()
    }
}
