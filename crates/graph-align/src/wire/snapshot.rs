//! Snapshots as bytes.

use super::{Content, Limits, decode_within, encode_within, only_way};
use crate::replica::{Part, Snapshot};
use crate::{Error, Key, VersionVector, Vocabulary};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::collections::BTreeMap;

const MAGIC: &[u8; 4] = b"MSS1";
/// Most nodes and edges of a part.
const PART: Limits = Limits { nodes: 1 << 22, edges: 1 << 24 };
/// Most metres of a frame's shift.
const FAR: f32 = 1e7;
/// Bytes of a frame's number and pose.
const POSE_BYTES: usize = 32;
/// Most bytes that parts begin with; the least of a part.
const PART_BYTES: usize = 12;

/// A snapshot as bytes: its graphs as frames, the poses of frames bit by bit.
///
/// # Errors
/// A part of more than 2^22 nodes or 2^24 edges, or of more than 4 GB.
pub fn encode_snapshot(s: &Snapshot, vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    let mut w = MAGIC.to_vec();
    let vector = s.vector.encode();
    for v in [vocabulary.fingerprint(), s.window_ds, s.cut_ds] {
        w.extend(v.to_le_bytes());
    }
    w.extend(s.chain);
    put_block(&mut w, &vector)?;
    w.extend((s.parts.len() as u32).to_le_bytes());
    for p in &s.parts {
        w.extend(p.root.to_le_bytes());
        w.extend((p.frames.len() as u32).to_le_bytes());
        for (frame, t) in &p.frames {
            w.extend(frame.to_le_bytes());
            let (v, q) = (t.translation.vector, t.rotation.coords);
            v.iter().chain(q.iter()).for_each(|v| w.extend(v.to_le_bytes()));
        }
        let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: 0 };
        let part = Content { key, end_ds: 0, frame: p.root, graph: &p.graph, looked: None };
        put_block(&mut w, &encode_within(&part, vocabulary, &PART)?)?;
    }
    Ok(w)
}

/// Reads [`encode_snapshot`].
///
/// # Errors
/// Anything that it would not write: another vocabulary, poses that are none, cuts within a window, bytes
/// left over.
pub fn decode_snapshot(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Snapshot, Error> {
    let mut r = Bytes { rest: bytes, all: bytes.len() };
    if r.array()? != *MAGIC {
        return Err(r.bad("no MSS1 snapshot"));
    }
    if r.u32()? != vocabulary.fingerprint() {
        return Err(r.bad("written with another vocabulary"));
    }
    let (window_ds, cut_ds) = (r.u32()?, r.u32()?);
    if cut_ds.checked_rem(window_ds) != Some(0) || cut_ds == 0 {
        return Err(r.bad(format!("cut {cut_ds} ds is no end of a window of {window_ds} ds")));
    }
    let chain = r.array()?;
    let vector = VersionVector::decode(r.block()?)?;
    let n = r.count(PART_BYTES)?;
    let mut parts = Vec::with_capacity(n);
    for _ in 0..n {
        let root = r.u32()?;
        let mut frames = BTreeMap::new();
        for _ in 0..r.count(POSE_BYTES)? {
            let frame = r.u32()?;
            frames.insert(frame, r.pose()?);
        }
        if !frames.contains_key(&root) {
            return Err(r.bad(format!("a part without the pose of its own frame {root}")));
        }
        let o = decode_within(r.block()?, vocabulary, &PART)?;
        parts.push(Part { root, frames, graph: o.graph });
    }
    let s = Snapshot { window_ds, cut_ds, vector, chain, parts };
    only_way(&encode_snapshot(&s, vocabulary)?, bytes)?;
    Ok(s)
}

/// Bytes behind their length.
fn put_block(w: &mut Vec<u8>, block: &[u8]) -> Result<(), Error> {
    let bytes = u32::try_from(block.len());
    let bytes =
        bytes.map_err(|_| Error::value("part", format!("{} bytes, want at most 2^32", block.len())))?;
    w.extend(bytes.to_le_bytes());
    w.extend(block);
    Ok(())
}

struct Bytes<'a> {
    rest: &'a [u8],
    all: usize,
}

impl<'a> Bytes<'a> {
    fn bad(&self, problem: impl Into<String>) -> Error {
        Error::format(format!("byte {}", self.all - self.rest.len()), problem)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let (head, rest) =
            self.rest.split_first_chunk::<N>().ok_or_else(|| self.bad("the snapshot ends early"))?;
        self.rest = rest;
        Ok(*head)
    }

    fn u32(&mut self) -> Result<u32, Error> {
        self.array().map(u32::from_le_bytes)
    }

    /// A number of records that take at least some bytes each.
    fn count(&mut self, least: usize) -> Result<usize, Error> {
        let n = self.u32()? as usize;
        if n > self.rest.len() / least {
            return Err(self.bad(format!("{n} records in {} bytes", self.rest.len())));
        }
        Ok(n)
    }

    fn block(&mut self) -> Result<&'a [u8], Error> {
        let n = self.u32()? as usize;
        let (block, rest) = self
            .rest
            .split_at_checked(n)
            .ok_or_else(|| self.bad(format!("{n} bytes where fewer are left")))?;
        self.rest = rest;
        Ok(block)
    }

    fn pose(&mut self) -> Result<Isometry3<f32>, Error> {
        let mut v = [0.0; 7];
        for v in &mut v {
            *v = f32::from_le_bytes(self.array()?);
        }
        let [x, y, z, i, j, k, w] = v;
        let q = Quaternion::new(w, i, j, k);
        if !(v[..3].iter().all(|c| c.abs() < FAR) && (q.norm() - 1.0).abs() < 1e-3) {
            return Err(self.bad(format!("{v:?} is no pose")));
        }
        // As it was, to the last bit: normalised anew it could differ.
        Ok(Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_unchecked(q)))
    }
}
