//! Fingerprints of what a replica holds, over bytes that are written by hand.

use super::Observation;
use crate::{Box3, Node};
use sha2::{Digest, Sha256};

/// A SHA-256.
pub(super) type Hash = [u8; 32];

/// Feeds numbers, little-endian, to a hash. Minus zero is zero, as it is for `==`.
struct Feed(Sha256);

impl Feed {
    fn int(&mut self, v: u64) {
        self.0.update(v.to_le_bytes());
    }

    fn float(&mut self, v: f32) {
        self.0.update((v + 0.0).to_le_bytes());
    }

    fn bounds(&mut self, b: &Box3) {
        b.centroid().iter().chain(b.extent().iter()).for_each(|&v| self.float(v));
        self.int(u64::from(b.footprint().is_some()));
        if let Some(f) = b.footprint() {
            std::iter::once(f.yaw).chain(f.reach).for_each(|v| self.float(v));
        }
    }

    fn node(&mut self, n: &Node) {
        self.int(n.id.0);
        self.int(u64::from(n.label.0));
        self.float(n.score);
        self.bounds(&n.bounds);
        self.int(n.others.len() as u64);
        for (label, score) in n.others.iter() {
            self.int(u64::from(label.0));
            self.float(score);
        }
        self.int(u64::from(n.sightings));
        self.int(u64::from(n.misses));
        self.0.update((n.last_seen + 0.0).to_le_bytes());
    }
}

/// Of an observation, all of it.
pub(super) fn of(o: &Observation) -> Hash {
    let mut f = Feed(Sha256::new());
    let k = o.key;
    [k.start_ds, k.agent.into(), k.epoch.into(), k.seq, o.end_ds, o.frame]
        .iter()
        .for_each(|&v| f.int(v.into()));
    f.int(o.graph.len() as u64);
    o.graph.nodes().for_each(|n| f.node(&n));
    f.int(o.graph.edges().len() as u64);
    for e in o.graph.edges() {
        [e.s.0, e.t.0, e.p.0.into()].into_iter().for_each(|v| f.int(v));
        f.float(e.score);
    }
    f.int(u64::from(o.looked.is_some()));
    if let Some(l) = &o.looked {
        f.float(l.cell());
        l.origin().iter().for_each(|&v| f.float(v));
        let (first, size) = l.span();
        first.into_iter().for_each(|v| f.int(v as u32 as u64));
        size.into_iter().for_each(|v| f.int(v.into()));
        f.0.update(l.bits());
    }
    f.0.finalize().into()
}

/// Of a list that is one longer.
pub(super) fn next(chain: &Hash, of: &Hash) -> Hash {
    Sha256::new().chain_update(chain).chain_update(of).finalize().into()
}

/// Of a list and what else is to be told apart.
pub(super) fn with(chain: &Hash, window_ds: u32, vector: &[u8]) -> Hash {
    let state = Sha256::new().chain_update(b"replica/1").chain_update(chain);
    state.chain_update(window_ds.to_le_bytes()).chain_update(vector).finalize().into()
}
