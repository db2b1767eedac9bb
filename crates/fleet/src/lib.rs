//! How observations travel between robots: broadcast, loss, delay, and repair by version vectors.
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
//! assert_eq!(net.replica(2).observations().len(), 0); // lost
//! net.finish(20)?;
//! assert_eq!(net.replica(2).observations().len(), 1); // repaired
//! # Ok::<(), graph_align::Error>(())
//! ```

mod vector;

pub use vector::VersionVector;

use graph_align::{Error, Observation, Replica, Vocabulary, wire};
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
    vectors: Vec<VersionVector>,
    traffic: Vec<Traffic>,
    in_flight: InFlight,
    sent: Vec<Vec<u8>>,
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
            vectors: vec![VersionVector::default(); agents],
            traffic: vec![Traffic::default(); agents],
            in_flight: InFlight::new(),
            sent: Vec::new(),
        }
    }

    /// The agent that the key names takes its own observation in and broadcasts it.
    ///
    /// # Errors
    /// Observations too large for a frame, or a second one under the same key.
    pub fn publish(&mut self, now_ds: u32, o: Observation) -> Result<(), Error> {
        self.deliver_until(now_ds)?;
        let agent = usize::from(o.key.agent);
        let bytes = wire::encode(&o, &self.vocabulary)?;
        // Also the sender keeps what its frame says, so that all replicas hold the same numbers.
        self.receive(agent, &bytes)?;
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
            let request = self.vectors[agent].encode();
            self.count(agent, request.len(), 1);
            let missing: Vec<Vec<u8>> = self.replicas[peer]
                .observations()
                .filter(|o| !self.vectors[agent].contains(&o.key))
                .map(|o| wire::encode(o, &self.vocabulary))
                .collect::<Result<_, _>>()?;
            for bytes in missing {
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

    /// Every frame that holds observations, in the order of sending.
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
        let o = wire::decode(bytes, &self.vocabulary)?;
        self.vectors[agent].insert(&o.key);
        self.replicas[agent].apply(o)?;
        Ok(())
    }
}
