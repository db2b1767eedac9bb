//! Which entries of which logs somebody has, in a few bytes.

use super::Key;
use crate::Error;
use std::collections::BTreeMap;

/// Per log, that is (agent, epoch), the number below which every entry is there, and single ones beyond it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VersionVector {
    runs: BTreeMap<(u16, u16), Run>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Run {
    /// All entries below; 2^32 where the log is full.
    next: u64,
    /// Rising, all above `next`.
    beyond: Vec<u32>,
}

impl Run {
    fn insert(&mut self, seq: u32) {
        if u64::from(seq) < self.next {
            return;
        }
        if let Err(at) = self.beyond.binary_search(&seq) {
            self.beyond.insert(at, seq);
        }
        self.close();
    }

    /// Takes what has become contiguous into `next`.
    fn close(&mut self) {
        let mut n = 0;
        while self.beyond.get(n).is_some_and(|&b| u64::from(b) <= self.next) {
            self.next = self.next.max(u64::from(self.beyond[n]) + 1);
            n += 1;
        }
        self.beyond.drain(..n);
    }

    fn contains(&self, seq: u32) -> bool {
        u64::from(seq) < self.next || self.beyond.binary_search(&seq).is_ok()
    }
}

impl VersionVector {
    /// Adds the entry of a key.
    pub fn insert(&mut self, key: &Key) {
        self.runs.entry((key.agent, key.epoch)).or_default().insert(key.seq);
    }

    /// Whether the entry of a key is there.
    #[must_use]
    pub fn contains(&self, key: &Key) -> bool {
        self.runs.get(&(key.agent, key.epoch)).is_some_and(|r| r.contains(key.seq))
    }

    /// The number below which every entry of a log is there.
    #[must_use]
    pub fn contiguous(&self, agent: u16, epoch: u16) -> u64 {
        self.runs.get(&(agent, epoch)).map_or(0, |r| r.next)
    }

    /// Whether everything of `other` is here.
    #[must_use]
    pub fn covers(&self, other: &Self) -> bool {
        other.runs.iter().all(|(log, theirs)| {
            let (agent, epoch) = *log;
            theirs.next <= self.contiguous(agent, epoch)
                && theirs.beyond.iter().all(|&seq| self.contains(&Key { start_ds: 0, agent, epoch, seq }))
        })
    }

    /// Everything of `other` joins what is here.
    pub fn merge(&mut self, other: &Self) {
        for (log, theirs) in &other.runs {
            let own = self.runs.entry(*log).or_default();
            own.next = own.next.max(theirs.next);
            own.beyond.extend(&theirs.beyond);
            own.beyond.sort_unstable();
            own.beyond.dedup();
            own.close();
        }
    }

    /// What is contiguous in both.
    #[must_use]
    pub fn common(&self, other: &Self) -> Self {
        let both = |(log, run): (&(u16, u16), &Run)| {
            let next = run.next.min(other.contiguous(log.0, log.1));
            (next > 0).then_some((*log, Run { next, beyond: Vec::new() }))
        };
        Self { runs: self.runs.iter().filter_map(both).collect() }
    }

    /// Logs of which something is there, as (agent, epoch), rising.
    pub fn logs(&self) -> impl Iterator<Item = (u16, u16)> + '_ {
        self.runs.keys().copied()
    }

    /// As it travels: LEB128 numbers; how many logs, then per log agent, epoch, the contiguous number, how
    /// many beyond it, and the distance of each of those to the one before, less one.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut w = Vec::new();
        put(&mut w, self.runs.len() as u64);
        for (&(agent, epoch), run) in &self.runs {
            put(&mut w, u64::from(agent));
            put(&mut w, u64::from(epoch));
            put(&mut w, run.next);
            put(&mut w, run.beyond.len() as u64);
            let mut last = run.next;
            for &b in &run.beyond {
                put(&mut w, u64::from(b) - last - 1);
                last = u64::from(b);
            }
        }
        w
    }

    /// Reads [`Self::encode`].
    ///
    /// # Errors
    /// Bytes that it would not write: numbers out of range, logs out of order, bytes left over.
    pub fn decode(bytes: &[u8]) -> Result<Self, Error> {
        let mut r = Bytes { bytes, at: 0 };
        let mut out = Self::default();
        for _ in 0..r.number()? {
            let log = (r.short()?, r.short()?);
            let mut run = Run { next: r.number()?, beyond: Vec::new() };
            let mut last = run.next;
            for _ in 0..r.number()? {
                last = last.checked_add(r.number()?).and_then(|v| v.checked_add(1)).unwrap_or(u64::MAX);
                run.beyond.push(u32::try_from(last).map_err(|_| r.bad())?);
            }
            if run.next > 1 << 32 || out.runs.last_key_value().is_some_and(|(l, _)| *l >= log) {
                return Err(r.bad());
            }
            out.runs.insert(log, run);
        }
        // A number written longer than it need be would be another way to write the same.
        if out.encode() == bytes { Ok(out) } else { Err(r.bad()) }
    }
}

fn put(w: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        w.push(v as u8 | 0x80);
        v >>= 7;
    }
    w.push(v as u8);
}

struct Bytes<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bytes<'_> {
    fn bad(&self) -> Error {
        Error::value("version vector", format!("byte {}: not as an encoder writes it", self.at))
    }

    fn number(&mut self) -> Result<u64, Error> {
        let mut v = 0;
        for shift in (0..63).step_by(7) {
            let b = *self.bytes.get(self.at).ok_or_else(|| self.bad())?;
            self.at += 1;
            v |= u64::from(b & 0x7f) << shift;
            if b < 0x80 {
                return Ok(v);
            }
        }
        Err(self.bad())
    }

    fn short(&mut self) -> Result<u16, Error> {
        let v = self.number()?;
        u16::try_from(v).map_err(|_| self.bad())
    }
}
