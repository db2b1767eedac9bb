//! How observations travel between robots: broadcast, loss, delay, and repair by version vectors.
//!
//! A later revision of a visit travels as what changed since the one that was sent before it; who lacks
//! that one gets the whole by the next sync.
//!
//! [`Network`] is a seeded simulator in one process. Time is handed in; nothing here reads a clock
//! or opens a socket, so the same calls give the same bytes. Every replica ends with the same set
//! once [`Network::finish`] has run, whatever was lost on the way.
//!
//! ```
//! use fleet::{LinkParams, Network};
//! use graph_align::{Key, Observation, SceneGraph, Vocabulary};
//!
//! let mut net = Network::new(3, Vocabulary::default(), LinkParams { loss: 1.0, delay_ds: 0 }, 7);
//! let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: 0 };
//! net.publish(10, Observation { key, end_ds: 10, frame: 0, graph: SceneGraph::default(), looked: None })?;
//! assert_eq!(net.replica(2).len(), 0); // lost
//! net.finish(20)?;
//! assert_eq!(net.replica(2).len(), 1); // repaired
//! # Ok::<(), graph_align::Error>(())
//! ```

pub use graph_align::VersionVector;

use graph_align::{Error, Key, Observation, Replica, Retraction, Vocabulary, wire};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;

/// What a link does to frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkParams {
    /// Probability that a receiver misses a broadcast frame, 0 to 1.
    pub loss: f64,
    /// Time from sending to arrival, tenths of a second.
    pub delay_ds: u32,
}

/// Bytes that one agent sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Every frame once, however many heard it.
    pub sent: u64,
    /// Every receiver's copy.
    pub copies: u64,
}

/// Frames on their way, by (arrival, order of sending): receiver and bytes.
type InFlight = BTreeMap<(u32, u64), (usize, Vec<u8>)>;

/// Agents, their replicas, and what is between them.
#[derive(Debug)]
pub struct Network {
    vocabulary: Vocabulary,
    link: LinkParams,
    rng: ChaCha8Rng,
    replicas: Vec<Replica>,
    traffic: Vec<Traffic>,
    in_flight: InFlight,
    sent: Vec<Vec<u8>>,
    /// Of each agent the observation that it sent last.
    last: Vec<Option<Observation>>,
    deltas: Deltas,
}

/// What became of revisions that travelled as what changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Deltas {
    /// Sent.
    pub sent: u64,
    /// Arrived where the revision before was missing, and left to the next sync.
    pub without_base: u64,
}

impl Network {
    /// Agents 0 to `agents - 1` with empty replicas.
    #[must_use]
    pub fn new(agents: usize, vocabulary: Vocabulary, link: LinkParams, seed: u64) -> Self {
        Self {
            vocabulary,
            link,
            rng: ChaCha8Rng::seed_from_u64(seed),
            replicas: vec![Replica::default(); agents],
            traffic: vec![Traffic::default(); agents],
            in_flight: InFlight::new(),
            sent: Vec::new(),
            last: vec![None; agents],
            deltas: Deltas::default(),
        }
    }

    /// The agent that the key names takes its own observation in and broadcasts it; a later revision of the
    /// visit that it sent last as what changed, if that is shorter.
    ///
    /// # Errors
    /// Observations too large for a frame, or a second one under the same key.
    pub fn publish(&mut self, now_ds: u32, o: Observation) -> Result<(), Error> {
        self.deliver_until(now_ds)?;
        let agent = usize::from(o.key.agent);
        let mut bytes = wire::encode(&o, &self.vocabulary)?;
        // Also the sender keeps what its frame says, so that all replicas hold the same numbers.
        let o = wire::decode(&bytes, &self.vocabulary)?;
        if let Some(last) = self.last[agent].as_ref().filter(|l| is_revision(&l.key, &o.key)) {
            let delta = wire::encode_delta(last, &o, &self.vocabulary)?;
            if delta.len() < bytes.len() {
                bytes = delta;
                self.deltas.sent += 1;
            }
        }
        self.replicas[agent].apply(o.clone())?;
        self.last[agent] = Some(o);
        self.broadcast(now_ds, agent, bytes)
    }

    /// An agent withdraws observations, and says so to all.
    ///
    /// # Errors
    /// As [`Self::publish`].
    pub fn retract(&mut self, now_ds: u32, r: Retraction) -> Result<(), Error> {
        self.deliver_until(now_ds)?;
        let agent = usize::from(r.key.agent);
        let bytes = wire::encode_retraction(&r, &self.vocabulary)?;
        self.replicas[agent].retract(r)?;
        self.broadcast(now_ds, agent, bytes)
    }

    fn broadcast(&mut self, now_ds: u32, agent: usize, bytes: Vec<u8>) -> Result<(), Error> {
        self.count(agent, bytes.len(), self.replicas.len().saturating_sub(1));
        for to in (0..self.replicas.len()).filter(|&to| to != agent) {
            let lost = ((self.rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64) < self.link.loss;
            if !lost {
                let key =
                    (now_ds.saturating_add(self.link.delay_ds), self.sent.len() as u64 * 1024 + to as u64);
                self.in_flight.insert(key, (to, bytes.clone()));
            }
        }
        self.sent.push(bytes);
        self.deliver_until(now_ds)
    }

    /// An agent tells every other in turn what it has, and gets what it lacks.
    ///
    /// # Errors
    /// As [`Self::publish`].
    pub fn sync(&mut self, now_ds: u32, agent: usize) -> Result<(), Error> {
        self.deliver_until(now_ds)?;
        for peer in (0..self.replicas.len()).filter(|&p| p != agent) {
            let request = self.replicas[agent].vector().encode();
            self.count(agent, request.len(), 1);
            let (v, lacks) = (&self.vocabulary, self.replicas[peer].beyond(self.replicas[agent].vector()));
            let mut frames: Vec<Vec<u8>> =
                lacks.observations.iter().map(|o| wire::encode(o, v)).collect::<Result<_, _>>()?;
            for r in &lacks.retractions {
                frames.push(wire::encode_retraction(r, v)?);
            }
            // What was replaced is named once what replaced it is there.
            if !lacks.gone.is_empty() {
                frames.push(wire::encode_gone(&lacks.gone, v)?);
            }
            for bytes in frames {
                self.count(peer, bytes.len(), 1);
                self.receive(agent, &bytes)?;
                self.sent.push(bytes);
            }
        }
        Ok(())
    }

    /// Delivers everything on its way, then lets every agent sync: afterwards all replicas are equal.
    ///
    /// # Errors
    /// As [`Self::publish`].
    pub fn finish(&mut self, now_ds: u32) -> Result<(), Error> {
        self.deliver_until(u32::MAX)?;
        (0..self.replicas.len()).try_for_each(|agent| self.sync(now_ds, agent))
    }

    /// An agent's replica.
    #[must_use]
    pub fn replica(&self, agent: usize) -> &Replica {
        &self.replicas[agent]
    }

    /// What an agent has sent.
    #[must_use]
    pub fn traffic(&self, agent: usize) -> Traffic {
        self.traffic[agent]
    }

    /// How revisions fared.
    #[must_use]
    pub fn deltas(&self) -> Deltas {
        self.deltas
    }

    /// Every frame but requests, in the order of sending.
    #[must_use]
    pub fn frames(&self) -> &[Vec<u8>] {
        &self.sent
    }

    fn count(&mut self, agent: usize, bytes: usize, receivers: usize) {
        self.traffic[agent].sent += bytes as u64;
        self.traffic[agent].copies += (bytes * receivers) as u64;
    }

    fn deliver_until(&mut self, now_ds: u32) -> Result<(), Error> {
        while let Some(entry) = self.in_flight.first_entry().filter(|e| e.key().0 <= now_ds) {
            let (to, bytes) = entry.remove();
            self.receive(to, &bytes)?;
        }
        Ok(())
    }

    fn receive(&mut self, agent: usize, bytes: &[u8]) -> Result<(), Error> {
        let (replica, v) = (&mut self.replicas[agent], &self.vocabulary);
        match wire::kind(bytes, v)? {
            wire::Kind::Retraction => {
                replica.retract(wire::decode_retraction(bytes, v)?)?;
            }
            wire::Kind::Gone => replica.pass_over(wire::decode_gone(bytes, v)?)?,
            wire::Kind::Delta => {
                let key = wire::revision_of(bytes, v)?;
                let base = replica.revision_before(&key);
                match base.map(|base| wire::decode_delta(bytes, base, v)) {
                    Some(Ok(o)) => {
                        replica.apply(o)?;
                    }
                    // Another revision than the one it was made for, or none: the next sync brings the whole.
                    Some(Err(_)) | None => {
                        self.deltas.without_base += u64::from(!replica.vector().contains(&key))
                    }
                }
            }
            _ => {
                replica.apply(wire::decode(bytes, v)?)?;
            }
        }
        Ok(())
    }
}

/// Whether `next` names a later revision of the visit of `last`.
fn is_revision(last: &Key, next: &Key) -> bool {
    (last.agent, last.epoch, last.start_ds) == (next.agent, next.epoch, next.start_ds) && last.seq < next.seq
}
