//! What is kept of the past once nothing can change it.

use super::fold::{Component, Folded};
use super::{Key, Replica, VersionVector, digest};
use crate::{Error, Params, SceneGraph};
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// The outcome of everything before a time, and which entries it is made of. Equal sets give equal
/// snapshots. It travels by `wire::encode_snapshot`.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    pub(crate) window_ds: u32,
    pub(crate) cut_ds: u32,
    pub(crate) vector: VersionVector,
    pub(crate) chain: digest::Hash,
    pub(crate) parts: Vec<Part>,
}

/// A connected part.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    pub root: u32,
    pub frames: BTreeMap<u32, Isometry3<f32>>,
    pub graph: SceneGraph,
}

impl Snapshot {
    /// The time before which everything is in it, tenths of a second; the end of a window.
    #[must_use]
    pub fn cut_ds(&self) -> u32 {
        self.cut_ds
    }

    /// Which entries it is made of.
    #[must_use]
    pub fn vector(&self) -> &VersionVector {
        &self.vector
    }

    /// The graphs, each with the frame in which it stands.
    pub fn graphs(&self) -> impl Iterator<Item = (u32, &SceneGraph)> {
        self.parts.iter().map(|p| (p.root, &p.graph))
    }

    pub(super) fn folded(&self, params: &Params) -> Folded {
        let part = |p: &Part| Component::settled(p.root, p.frames.clone(), &p.graph, params);
        Folded { components: self.parts.iter().map(part).collect() }
    }
}

impl Replica {
    /// What is kept of the past, if [`Self::compact`] was called or the replica started from one.
    #[must_use]
    pub fn snapshot(&self) -> Option<&Snapshot> {
        self.base.as_deref()
    }

    /// The time before which nothing new can come, tenths of a second: the earliest among the members' last
    /// entries that all of them have. `acknowledged` holds the vector of each member. Starts within a
    /// log have to rise with the numbers.
    #[must_use]
    pub fn settled_ds(&self, acknowledged: &BTreeMap<u16, VersionVector>) -> u32 {
        let last = |agent: u16| {
            let (_, epoch) = self.vector.logs().filter(|l| l.0 == agent).last()?;
            let all = acknowledged.values().map(|v| v.contiguous(agent, epoch)).min()?;
            let all = all.min(self.vector.contiguous(agent, epoch));
            let seq = u32::try_from(all.checked_sub(1)?).ok()?;
            self.known.get(&(agent, epoch, seq)).copied()
        };
        acknowledged.keys().map(|&agent| last(agent).unwrap_or(0)).min().unwrap_or(0)
    }

    /// Keeps of everything before the last end of a window up to `settled_ds` its outcome alone. Entries that
    /// come later and belong before it are refused, so every member has to have everything of before
    /// ([`Self::settled_ds`]). True if something was folded. [`Self::fold`] gives what it gave.
    ///
    /// # Errors
    /// A replica without windows: nothing is final there.
    pub fn compact(&mut self, settled_ds: u32, params: &Params) -> Result<bool, Error> {
        let Some(whole) = settled_ds.checked_div(self.window_ds) else {
            return Err(Error::value(
                "window_ds",
                "0: nothing is ever final; make it by Replica::with_window",
            ));
        };
        let cut_ds = whole * self.window_ds;
        if cut_ds <= self.cut_ds() {
            return Ok(false);
        }
        let (folded, chain) = self.fold_before(Some(cut_ds), params);
        let mut vector = self.base.as_ref().map(|b| b.vector.clone()).unwrap_or_default();
        for (&(agent, epoch, seq), &start_ds) in self.known.iter().filter(|k| *k.1 < cut_ds) {
            vector.insert(&Key { start_ds, agent, epoch, seq });
        }
        let part = |c: Component| Part { root: c.root, frames: c.frames, graph: c.graph };
        let parts = folded.components.into_iter().map(part).collect();
        let base = Snapshot { window_ds: self.window_ds, cut_ds, vector, chain, parts };
        self.rebase(&base)?;
        Ok(true)
    }

    /// Puts a later snapshot in the place of what lies before its cut.
    pub(super) fn rebase(&mut self, base: &Snapshot) -> Result<(), Error> {
        for (&(agent, epoch, seq), &start_ds) in self.known.iter().filter(|k| *k.1 < base.cut_ds) {
            if !base.vector.contains(&Key { start_ds, agent, epoch, seq }) {
                return Err(Error::Late { agent, epoch, seq, cut_ds: base.cut_ds });
            }
        }
        let first = Key { start_ds: base.cut_ds, agent: 0, epoch: 0, seq: 0 };
        self.observations = self.observations.split_off(&first);
        self.retractions = self.retractions.split_off(&first);
        self.known.retain(|_, start_ds| *start_ds >= base.cut_ds);
        self.vector.merge(&base.vector);
        self.base = Some(Box::new(base.clone()));
        Ok(())
    }
}
