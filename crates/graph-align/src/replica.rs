//! A pure fold over a set of observations.
//!
//! A [`Replica`] is the set of everything that was heard; the merged graph is a function of that
//! set alone ([`Replica::fold`]). Arrival order, duplicates and delays do not matter: the same set
//! gives the same bytes.

use crate::{Error, Match, Outcome, Params, Query, SceneGraph, align, append, paper, update};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// Which observation, and where it sorts: by the start of its visit, then agent, epoch and
/// sequence number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key {
    /// Start of the visit on the simulated clock, tenths of a second.
    pub start_ds: u32,
    /// Who saw it.
    pub agent: u16,
    /// Which run of that agent.
    pub epoch: u16,
    /// Its number within the run.
    pub seq: u32,
}

/// What one visit saw, quantised when it was made ([`SceneGraph::quantised`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Name and place in the order.
    pub key: Key,
    /// End of the visit, tenths of a second.
    pub end_ds: u32,
    /// The frame in which `graph` stands; observations of one frame need no search to be laid
    /// together.
    pub frame: u32,
    /// The visit's graph.
    pub graph: SceneGraph,
}

/// Observations of any number of agents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replica {
    observations: BTreeMap<Key, Observation>,
}

/// A part of the merged graph whose frames are connected.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// In the frame of its oldest observation.
    pub graph: SceneGraph,
    /// `component_from_frame` of every frame in it.
    pub frames: BTreeMap<u32, Isometry3<f32>>,
}

/// The merged graph, in connected parts, oldest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Folded {
    /// Parts in the order of their oldest observation.
    pub components: Vec<Component>,
}

impl Replica {
    /// Takes in an observation. True if it is new.
    ///
    /// # Errors
    /// [`Error::Equivocation`]: another observation of the same agent, epoch and number is there.
    pub fn apply(&mut self, o: Observation) -> Result<bool, Error> {
        let Key { agent, epoch, seq, .. } = o.key;
        let same = |k: &Key| (k.agent, k.epoch, k.seq) == (agent, epoch, seq);
        if let Some(known) = self.observations.iter().find(|(k, _)| same(k)).map(|(_, v)| v) {
            return if *known == o { Ok(false) } else { Err(Error::Equivocation { agent, epoch, seq }) };
        }
        self.observations.insert(o.key, o);
        Ok(true)
    }

    /// Everything that `other` holds joins this replica.
    ///
    /// # Errors
    /// As [`Self::apply`].
    pub fn join(&mut self, other: &Self) -> Result<(), Error> {
        other.observations.values().try_for_each(|o| self.apply(o.clone()).map(|_| ()))
    }

    /// Observations in the order of the fold.
    pub fn observations(&self) -> impl ExactSizeIterator<Item = &Observation> {
        self.observations.values()
    }

    /// Aligns and merges all observations in their order.
    #[must_use]
    pub fn fold(&self, params: &Params) -> Folded {
        let mut folded = Folded::default();
        for o in self.observations.values() {
            folded.push(o, params);
        }
        folded
    }
}

impl Folded {
    /// One step of the fold.
    pub fn push(&mut self, o: &Observation, params: &Params) {
        if let Some(k) = self.components.iter().position(|c| c.frames.contains_key(&o.frame)) {
            self.push_known(k, o, params);
            return;
        }
        for k in 0..self.components.len() {
            let query = Query::new(&o.graph);
            let outcome = align(&self.components[k].graph, &query, params);
            if let Outcome::Match(m) = &outcome {
                let c = &mut self.components[k];
                c.frames.insert(o.frame, m.reference_from_query);
                c.graph = update(&c.graph, &query, &outcome, params);
                return;
            }
        }
        self.components.push(Component {
            graph: append(&SceneGraph::default(), &o.graph, &Isometry3::identity()),
            frames: BTreeMap::from([(o.frame, Isometry3::identity())]),
        });
    }

    /// The observation's frame is known: it joins its component, and may link others to it.
    fn push_known(&mut self, k: usize, o: &Observation, params: &Params) {
        let prior = self.components[k].frames.get(&o.frame).copied();
        let query = Query { prior, ..Query::new(&o.graph) };
        let outcome = align(&self.components[k].graph, &query, params);
        let t = prior.unwrap_or_else(Isometry3::identity);
        let c = &mut self.components[k];
        c.graph = update(&c.graph, &query, &outcome, params);
        for other in (0..self.components.len()).rev().filter(|&other| other != k) {
            if let Outcome::Match(m) = align(&self.components[other].graph, &Query::new(&o.graph), params) {
                self.link(k, other, &(t * m.reference_from_query.inverse()), params);
                return;
            }
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
        let m = Match {
            reference_from_query: t,
            pairs: Vec::new(),
            score: 0.0,
            margin: None,
            verdicts: paper::verdicts(&c.graph, &gone.graph, &t, &params.paper),
            removed: Vec::new(),
        };
        c.graph = update(&c.graph, &Query::new(&gone.graph), &Outcome::Match(m), params);
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
