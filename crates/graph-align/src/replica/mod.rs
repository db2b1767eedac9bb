//! A pure fold over a set of observations.
//!
//! A [`Replica`] is the set of everything that was heard; the merged graph is a function of that set alone
//! ([`Replica::fold`]). Arrival order, duplicates and delays do not matter: the same set gives the same
//! bytes, and [`Replica::state_hash`] tells whether two sets are the same.
//!
//! - *Entries.* Each agent numbers what it says: observations, and [`Retraction`]s of observations. A
//!   [`VersionVector`] says which entries somebody has.
//! - *Revisions.* Of the observations of one visit (same agent, epoch and start) the last counts.
//! - *Tombstones.* A retraction outlives what it withdraws, so that a late copy does not come back. It goes,
//!   with what it withdrew, when every member has it ([`Replica::collect`]).
//! - *Snapshots.* Time is cut into windows; at the end of each the graph and the frames found so far are final,
//!   for every replica alike. So what lies before a window that nothing can enter any more may be kept as its
//!   outcome alone ([`Replica::compact`]), from which a late robot starts ([`Replica::from_snapshot`]).
//!
//! Version vectors with exceptions and removals that name what they remove are those of the optimised
//! observed-remove set (Bieniusa et al. 2012) and of dotted version vectors (Preguiça et al. 2010).

mod digest;
mod fold;
mod snapshot;
mod vector;

pub use fold::{Component, Folded};
#[cfg(feature = "wire")]
pub(crate) use snapshot::Part;
pub use snapshot::Snapshot;
pub use vector::VersionVector;

use crate::{Error, Looked, Params, SceneGraph};
use std::collections::BTreeMap;

/// Which entry, and where it sorts: by the start of its visit, then agent, epoch and sequence number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key {
    /// Start of the visit on the simulated clock, tenths of a second; of a retraction when it was made.
    pub start_ds: u32,
    /// Who said it.
    pub agent: u16,
    /// Which run of that agent.
    pub epoch: u16,
    /// Its number within the run.
    pub seq: u32,
}

/// The entry that a key names, whatever its time.
type Dot = (u16, u16, u32);
/// A visit: start, agent, epoch.
type Visit = (u32, u16, u16);

impl Key {
    fn dot(&self) -> Dot {
        (self.agent, self.epoch, self.seq)
    }

    fn visit(&self) -> Visit {
        (self.start_ds, self.agent, self.epoch)
    }
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
    /// Where the visit looked, in the same frame.
    pub looked: Option<Looked>,
}

/// Observations that are withdrawn: of a broken sensor, say, or of a robot that nobody trusts any more. Who may
/// withdraw what is for those to say who check signatures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Retraction {
    /// Name; its number is one of the same log as those of observations.
    pub key: Key,
    /// Each of these and the earlier revisions of its visit. Those of a window before the retraction's own are
    /// final and stay.
    pub of: Vec<Key>,
}

/// An observation and its fingerprint.
#[derive(Clone, Debug, PartialEq)]
struct Held {
    observation: Observation,
    digest: digest::Hash,
}

/// What a peer lacks ([`Replica::beyond`]).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beyond<'a> {
    /// Observations, in the order of the fold.
    pub observations: Vec<&'a Observation>,
    /// Retractions, in the order of their keys.
    pub retractions: Vec<&'a Retraction>,
    /// Entries that no longer count: earlier revisions, and what was collected. [`Replica::pass_over`] takes them.
    pub gone: Vec<Key>,
}

/// Observations of any number of agents, and what was withdrawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replica {
    window_ds: u32,
    /// Everything before its cut.
    base: Option<Box<Snapshot>>,
    observations: BTreeMap<Key, Held>,
    retractions: BTreeMap<Key, Retraction>,
    /// Start by entry, of all entries since the cut, also of those that are gone.
    known: BTreeMap<Dot, u32>,
    vector: VersionVector,
}

impl Replica {
    /// An empty replica in which what was seen becomes final at the ends of windows of this length, tenths of a
    /// second since zero of the clock. 0, as in `default()`: nothing is ever final, and there are no
    /// snapshots. All replicas of a fleet need the same.
    #[must_use]
    pub fn with_window(window_ds: u32) -> Self {
        Self { window_ds, ..Self::default() }
    }

    /// A replica that starts from what others have folded and hears of everything later.
    #[must_use]
    pub fn from_snapshot(snapshot: Snapshot) -> Self {
        let vector = snapshot.vector.clone();
        Self { window_ds: snapshot.window_ds, base: Some(Box::new(snapshot)), vector, ..Self::default() }
    }

    /// Length of a window, tenths of a second; 0: one window without end.
    #[must_use]
    pub fn window_ds(&self) -> u32 {
        self.window_ds
    }

    /// Takes in an observation. True if it is new.
    ///
    /// # Errors
    /// [`Error::Equivocation`]: another observation of the same agent, epoch and number is there.
    /// [`Error::Late`]: it lies before a cut that was made without it.
    pub fn apply(&mut self, o: Observation) -> Result<bool, Error> {
        if !self.is_new(&o.key)? {
            let same = |h: &Held| h.observation == o;
            let gone = || self.known.get(&o.key.dot()).is_none_or(|start| *start == o.key.start_ds);
            let agrees = match self.observations.get(&o.key) {
                Some(h) => same(h),
                None => gone() && !self.retractions.contains_key(&o.key),
            };
            return if agrees { Ok(false) } else { Err(equivocation(&o.key)) };
        }
        self.note(&o.key);
        let visit = |seq| Key { seq, ..o.key };
        if self.observations.range(visit(o.key.seq)..=visit(u32::MAX)).next().is_some() {
            // A later revision is there.
            return Ok(true);
        }
        let earlier: Vec<Key> = self.observations.range(visit(0)..visit(o.key.seq)).map(|e| *e.0).collect();
        earlier.iter().for_each(|k| drop(self.observations.remove(k)));
        let digest = digest::of(&o);
        self.observations.insert(o.key, Held { observation: o, digest });
        Ok(true)
    }

    /// Takes in a retraction. True if it is new.
    ///
    /// # Errors
    /// As [`Self::apply`].
    pub fn retract(&mut self, r: Retraction) -> Result<bool, Error> {
        if !self.is_new(&r.key)? {
            let agrees = match self.retractions.get(&r.key) {
                Some(known) => *known == r,
                None => {
                    !self.observations.contains_key(&r.key)
                        && self.known.get(&r.key.dot()).is_none_or(|start| *start == r.key.start_ds)
                }
            };
            return if agrees { Ok(false) } else { Err(equivocation(&r.key)) };
        }
        self.note(&r.key);
        self.retractions.insert(r.key, r);
        Ok(true)
    }

    /// Marks entries as known that no longer count, as a peer has them in [`Beyond::gone`].
    ///
    /// # Errors
    /// [`Error::Late`] as for [`Self::apply`].
    pub fn pass_over(&mut self, gone: impl IntoIterator<Item = Key>) -> Result<(), Error> {
        for key in gone {
            if self.is_new(&key)? {
                self.note(&key);
            }
        }
        Ok(())
    }

    /// Everything that `other` holds joins this replica; of two snapshots the later one stays.
    ///
    /// # Errors
    /// As [`Self::apply`]; other windows.
    pub fn join(&mut self, other: &Self) -> Result<(), Error> {
        if self.window_ds != other.window_ds {
            let problem =
                format!("{} and {} ds, want the same in all replicas", self.window_ds, other.window_ds);
            return Err(Error::value("window_ds", problem));
        }
        if let Some(base) = other.base.as_ref().filter(|b| b.cut_ds > self.cut_ds()) {
            self.rebase(base)?;
        }
        let cut = self.cut_ds();
        for h in other.observations.values() {
            self.apply(h.observation.clone())?;
        }
        for r in other.retractions.values() {
            self.retract(r.clone())?;
        }
        for (&(agent, epoch, seq), &start_ds) in &other.known {
            let key = Key { start_ds, agent, epoch, seq };
            self.pass_over([key])?;
            if start_ds >= cut
                && !other.observations.contains_key(&key)
                && !other.retractions.contains_key(&key)
            {
                // Collected there, so it is withdrawn or replaced for everybody.
                self.observations.remove(&key);
                self.retractions.remove(&key);
            }
        }
        Ok(())
    }

    /// What somebody with this vector lacks. If it lacks entries before [`Self::snapshot`]'s cut, it has to
    /// take the snapshot first.
    #[must_use]
    pub fn beyond(&self, vector: &VersionVector) -> Beyond<'_> {
        let mut out = Beyond::default();
        for (&(agent, epoch, seq), &start_ds) in &self.known {
            let key = Key { start_ds, agent, epoch, seq };
            if vector.contains(&key) {
                continue;
            }
            match (self.observations.get(&key), self.retractions.get(&key)) {
                (Some(h), _) => out.observations.push(&h.observation),
                (None, Some(r)) => out.retractions.push(r),
                (None, None) => out.gone.push(key),
            }
        }
        out.observations.sort_by_key(|o| o.key);
        out.retractions.sort_by_key(|r| r.key);
        out
    }

    /// The revision of a key's visit that is held and comes before it: what a delta is made against.
    #[must_use]
    pub fn revision_before(&self, key: &Key) -> Option<&Observation> {
        let held = self.observations.range(Key { seq: 0, ..*key }..*key).next_back();
        held.map(|(_, h)| &h.observation)
    }

    /// Which entries were heard.
    #[must_use]
    pub fn vector(&self) -> &VersionVector {
        &self.vector
    }

    /// Observations that count and that no snapshot holds, in the order of the fold.
    pub fn observations(&self) -> impl Iterator<Item = &Observation> {
        self.live().map(|h| &h.observation)
    }

    /// Number of [`Self::observations`].
    #[must_use]
    pub fn len(&self) -> usize {
        self.live().count()
    }

    /// True where nothing was heard that counts.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.base.is_none() && self.live().next().is_none()
    }

    /// Retractions that were not collected.
    pub fn retractions(&self) -> impl Iterator<Item = &Retraction> {
        self.retractions.values()
    }

    /// The replica as if an agent had never been, its retractions with it.
    ///
    /// # Errors
    /// Something of that agent is part of the snapshot or was collected: ask a peer that still has everything.
    pub fn without(&self, agent: u16) -> Result<Self, Error> {
        let folded = self.base.as_ref().is_some_and(|b| b.vector.logs().any(|l| l.0 == agent));
        if folded {
            let problem =
                format!("agent {agent} is part of a snapshot; ask a peer that has its observations");
            return Err(Error::value("without", problem));
        }
        let mut out = Self { window_ds: self.window_ds, base: self.base.clone(), ..Self::default() };
        if let Some(b) = &self.base {
            out.vector = b.vector.clone();
        }
        for h in self.observations.values().filter(|h| h.observation.key.agent != agent) {
            out.apply(h.observation.clone())?;
        }
        for r in self.retractions.values().filter(|r| r.key.agent != agent) {
            out.retract(r.clone())?;
        }
        let rest = self.known.iter().filter(|(dot, _)| dot.0 != agent);
        out.pass_over(rest.map(|(&(agent, epoch, seq), &start_ds)| Key { start_ds, agent, epoch, seq }))?;
        Ok(out)
    }

    /// Drops retractions that every member has, with all that they withdraw; how many. `acknowledged` is what
    /// every member is known to hold. Whoever does not count as a member any more comes back by a snapshot and
    /// in a new epoch.
    pub fn collect(&mut self, acknowledged: &VersionVector) -> usize {
        let below = |k: &Key| acknowledged.contiguous(k.agent, k.epoch) > u64::from(k.seq);
        let done: Vec<Key> = self
            .retractions
            .values()
            .filter(|r| below(&r.key) && r.of.iter().all(below))
            .map(|r| r.key)
            .collect();
        let withdrawn: Vec<Key> = self
            .observations
            .keys()
            .filter(|k| self.withdraws(k, |r| done.contains(&r.key)))
            .copied()
            .collect();
        withdrawn.iter().for_each(|k| drop(self.observations.remove(k)));
        done.iter().for_each(|k| drop(self.retractions.remove(k)));
        done.len()
    }

    /// A fingerprint of what the graph follows from: equal for replicas that heard of the same entries, whether
    /// they hold them, have collected them, or started from a snapshot.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let start = self.base.as_ref().map_or([0; 32], |b| b.chain);
        let chain = self.live().fold(start, |chain, h| digest::next(&chain, &h.digest));
        digest::with(&chain, self.window_ds, &self.vector.encode())
    }

    /// Aligns and merges all observations in their order, window by window.
    #[must_use]
    pub fn fold(&self, params: &Params) -> Folded {
        self.fold_before(None, params).0
    }

    /// The graph and the chain of digests of everything before a time.
    fn fold_before(&self, end_ds: Option<u32>, params: &Params) -> (Folded, digest::Hash) {
        let base = self.base.as_ref();
        let mut state = base.map(|b| b.folded(params)).unwrap_or_default();
        let mut chain = base.map_or([0; 32], |b| b.chain);
        let before = |h: &&Held| end_ds.is_none_or(|end| h.observation.key.start_ds < end);
        let live: Vec<&Held> = self.live().take_while(before).collect();
        for window in live.chunk_by(|a, b| self.window(&a.observation.key) == self.window(&b.observation.key))
        {
            let list: Vec<&Observation> = window.iter().map(|h| &h.observation).collect();
            state = state.with(&list, params);
            if self.window_ds > 0 {
                state = state.settled(params);
            }
            chain = window.iter().fold(chain, |chain, h| digest::next(&chain, &h.digest));
        }
        (state, chain)
    }

    fn window(&self, key: &Key) -> u32 {
        key.start_ds.checked_div(self.window_ds).unwrap_or(0)
    }

    fn cut_ds(&self) -> u32 {
        self.base.as_ref().map_or(0, |b| b.cut_ds)
    }

    /// Whether an entry was not heard of yet.
    fn is_new(&self, key: &Key) -> Result<bool, Error> {
        if self.vector.contains(key) {
            return Ok(false);
        }
        let cut_ds = self.cut_ds();
        if key.start_ds < cut_ds {
            let Key { agent, epoch, seq, .. } = *key;
            return Err(Error::Late { agent, epoch, seq, cut_ds });
        }
        Ok(true)
    }

    fn note(&mut self, key: &Key) {
        self.vector.insert(key);
        self.known.insert(key.dot(), key.start_ds);
    }

    fn live(&self) -> impl Iterator<Item = &Held> {
        let withdrawn = |k: &Key| self.withdraws(k, |_| true);
        self.observations.iter().filter(move |(k, _)| !withdrawn(k)).map(|e| e.1)
    }

    /// Whether one of some retractions withdraws an observation.
    fn withdraws(&self, key: &Key, some: impl Fn(&Retraction) -> bool) -> bool {
        let names = |k: &Key| k.visit() == key.visit() && k.seq >= key.seq;
        self.retractions
            .values()
            .any(|r| self.window(key) >= self.window(&r.key) && some(r) && r.of.iter().any(names))
    }
}

fn equivocation(key: &Key) -> Error {
    Error::Equivocation { agent: key.agent, epoch: key.epoch, seq: key.seq }
}
