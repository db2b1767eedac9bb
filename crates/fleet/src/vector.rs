//! What a replica holds, in a few bytes.

use graph_align::Key;
use std::collections::BTreeMap;

/// Per (agent, epoch) the numbers below which everything is there, and those beyond.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VersionVector {
    runs: BTreeMap<(u16, u16), (u32, Vec<u32>)>,
}

impl VersionVector {
    /// Adds an observation's key.
    pub fn insert(&mut self, key: &Key) {
        let (next, beyond) = self.runs.entry((key.agent, key.epoch)).or_default();
        if key.seq < *next || beyond.contains(&key.seq) {
            return;
        }
        beyond.push(key.seq);
        beyond.sort_unstable();
        while beyond.first() == Some(next) {
            beyond.remove(0);
            *next += 1;
        }
    }

    /// Whether an observation is there.
    #[must_use]
    pub fn contains(&self, key: &Key) -> bool {
        self.runs
            .get(&(key.agent, key.epoch))
            .is_some_and(|(next, beyond)| key.seq < *next || beyond.contains(&key.seq))
    }

    /// The bytes that a sync request costs: varints of agent, epoch, next number, and the numbers
    /// beyond it.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut w = Vec::new();
        let mut put = |mut v: u32| {
            while v >= 0x80 {
                w.push(v as u8 | 0x80);
                v >>= 7;
            }
            w.push(v as u8);
        };
        put(self.runs.len() as u32);
        for (&(agent, epoch), (next, beyond)) in &self.runs {
            put(u32::from(agent));
            put(u32::from(epoch));
            put(*next);
            put(beyond.len() as u32);
            beyond.iter().for_each(|&b| put(b - next));
        }
        w
    }
}
