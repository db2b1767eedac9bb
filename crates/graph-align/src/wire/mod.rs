//! The frames in which observations travel: integers in columns of bits, strict to decode.
//!
//! `docs/wire.md` is the normative layout. Lengths travel in centimetres, times in tenths of a
//! second, probabilities in 1/127.
//!
//! [`encode`] writes a whole observation; [`encode_delta`] what changed since one that the receiver has.

mod bits;
mod cells;
mod delta;
mod edges;
mod entries;
mod nodes;
mod snapshot;

use crate::graph::{SCORE_STEPS, quantise_score};
use crate::{Error, Footprint, Key, Looked, Node, Observation, SceneGraph, Vocabulary};
use bits::{Column, Reader, Writer};
pub use delta::{decode_delta, encode_delta, revision_of};
pub use entries::{Kind, MAX_KEYS, decode_gone, decode_retraction, encode_gone, encode_retraction, kind};
pub use snapshot::{decode_snapshot, encode_snapshot};

/// First bytes of every frame.
pub const MAGIC: &[u8; 4] = b"MSG5";
const EVIDENCE: u8 = 1;
const LOOKED: u8 = 2;
const FOOTPRINTS: u8 = 4;
const DELTA: u8 = 8;
const LOOKED_AS_BEFORE: u8 = 16;
/// Alone: a retraction, or entries that no longer count.
const RETRACTION: u8 = 32;
const GONE: u8 = 64;
/// Most nodes of a frame.
pub const MAX_NODES: usize = 1 << 16;
/// Most edges of a frame.
pub const MAX_EDGES: usize = 1 << 18;
/// Bytes of magic, flags and vocabulary.
const HEAD: usize = 9;
/// Shortest frame per node, footprint and edge, bytes: an eighth at least of the memory that they take.
const NODE_BYTES: usize = 10;
const FOOTPRINT_BYTES: usize = 5;
const EDGE_BYTES: usize = 2;
const _: () = assert!(SceneGraph::NODE_MEMORY + 2 <= 8 * NODE_BYTES);
const _: () = assert!(size_of::<Footprint>() <= 8 * FOOTPRINT_BYTES);
const _: () = assert!(SceneGraph::EDGE_MEMORY <= 8 * EDGE_BYTES);

/// Most nodes and edges of a graph.
struct Limits {
    nodes: usize,
    edges: usize,
}

const FRAME: Limits = Limits { nodes: MAX_NODES, edges: MAX_EDGES };

/// What a whole frame says.
struct Content<'a> {
    key: Key,
    end_ds: u32,
    frame: u32,
    graph: &'a SceneGraph,
    looked: Option<&'a Looked>,
}

impl<'a> Content<'a> {
    fn of(o: &'a Observation) -> Self {
        let Observation { key, end_ds, frame, ref graph, ref looked } = *o;
        Self { key, end_ds, frame, graph, looked: looked.as_ref() }
    }

    fn put(&self, w: &mut Writer<'_>, vocabulary: &Vocabulary) {
        let graph = self.graph;
        let looked = if self.looked.is_some() { LOOKED } else { 0 };
        head(w, flags_of(graph.nodes()) | looked, vocabulary);
        put_name(w, &self.key, self.end_ds, self.frame);
        w.number(graph.len() as u64);
        w.number(graph.edges().len() as u64);
        nodes::put(w, graph.nodes(), self.end_ds);
        edges::put(w, graph, graph.edges());
        if let Some(looked) = self.looked {
            cells::put(w, looked);
        }
        pad(w, graph.nodes(), graph.edges().len(), self.looked);
    }
}

/// An observation as bytes. Decoding gives [`SceneGraph::quantised`] of its graph.
///
/// # Errors
/// More nodes or edges than a frame may hold.
pub fn encode(o: &Observation, vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    encode_within(&Content::of(o), vocabulary, &FRAME)
}

fn encode_within(content: &Content<'_>, vocabulary: &Vocabulary, limits: &Limits) -> Result<Vec<u8>, Error> {
    check_size(content.graph, limits)?;
    let mut w = Writer::default();
    content.put(&mut w, vocabulary);
    Ok(w.finish())
}

/// The observation of a frame, in at most eight times the frame's memory (and the text of an error), whatever the
/// bytes: columns are read where they lie, and what an encoder would write is compared as it would be written.
///
/// # Errors
/// Anything but a frame that [`encode`] could have written with the same vocabulary: other
/// vocabulary, counts beyond the limits or the frame's length, numbers out of range, edges twice or
/// out of order, bytes left over, a longer way of writing where a shorter one would do.
pub fn decode(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Observation, Error> {
    decode_within(bytes, vocabulary, &FRAME)
}

fn decode_within(bytes: &[u8], vocabulary: &Vocabulary, limits: &Limits) -> Result<Observation, Error> {
    let (flags, mut r) = open(bytes, vocabulary)?;
    if flags & !(EVIDENCE | LOOKED | FOOTPRINTS) != 0 {
        return Err(r.bad(format!("flags {flags:#x} of no whole observation")));
    }
    let (key, end_ds, frame) = read_name(&mut r)?;
    let (n, m) = read_counts(&mut r, bytes.len(), limits)?;
    let mut nodes = nodes::Columns::read(&mut r, n, flags, end_ds, vocabulary)?;
    let edges = edges::Columns::read(&mut r, m, n, vocabulary)?;
    let rest = rest(&r, bytes, least_bytes(n, nodes.footprints(), m))?;
    let mut graph = SceneGraph::rising(n, nodes.footprints(), || nodes.node())?;
    graph.fill(edges.edges());
    let looked = if flags & LOOKED != 0 { Some(cells::read(&mut r, rest)?) } else { None };
    let o = Observation { key, end_ds, frame, graph, looked };
    let mut again = Writer::against(bytes);
    Content::of(&o).put(&mut again, vocabulary);
    again.same()?;
    Ok(o)
}

/// Numbers of nodes and edges, which bound the memory that a short frame can ask for.
fn read_counts(r: &mut Reader<'_>, bytes: usize, limits: &Limits) -> Result<(usize, usize), Error> {
    Ok((r.count(limits.nodes, bytes / NODE_BYTES)?, r.count(limits.edges, bytes / EDGE_BYTES)?))
}

/// Shortest frame of so many nodes, of which some have a footprint, and edges, bytes.
fn least_bytes(nodes: usize, footprints: impl Iterator<Item = bool>, edges: usize) -> usize {
    HEAD + nodes * NODE_BYTES + footprints.filter(|f| *f).count() * FOOTPRINT_BYTES + edges * EDGE_BYTES
}

/// What is left of a frame besides.
fn rest(r: &Reader<'_>, bytes: &[u8], least: usize) -> Result<usize, Error> {
    let rest = bytes.len().checked_sub(least);
    rest.ok_or_else(|| r.bad(format!("{} bytes, where its nodes and edges take {least}", bytes.len())))
}

/// The frames of a file: one alone, or several each behind its length as u32, little-endian.
///
/// # Errors
/// A length beyond what is left.
pub fn split(bytes: &[u8]) -> Result<Vec<&[u8]>, Error> {
    if bytes.starts_with(MAGIC) {
        return Ok(vec![bytes]);
    }
    let (mut out, mut rest) = (Vec::new(), bytes);
    while !rest.is_empty() {
        let at = bytes.len() - rest.len();
        let bad = |problem: String| Error::format(format!("byte {at}"), problem);
        let (length, tail) =
            rest.split_first_chunk::<4>().ok_or_else(|| bad("the last length ends early".into()))?;
        let n = u32::from_le_bytes(*length) as usize;
        if n > tail.len() {
            return Err(bad(format!("a frame of {n} bytes where {} are left", tail.len())));
        }
        out.push(&tail[..n]);
        rest = &tail[n..];
    }
    Ok(out)
}

fn check_size(g: &SceneGraph, limits: &Limits) -> Result<(), Error> {
    let (n, m) = (g.len(), g.edges().len());
    if n > limits.nodes || m > limits.edges {
        let problem = format!(
            "{n} nodes and {m} edges, want at most {} and {}: send it in parts",
            limits.nodes, limits.edges
        );
        return Err(Error::value("graph", problem));
    }
    Ok(())
}

/// There is one way to write things.
fn only_way(written: &[u8], bytes: &[u8]) -> Result<(), Error> {
    match (0..bytes.len().max(written.len())).find(|&k| written.get(k) != bytes.get(k)) {
        None => Ok(()),
        Some(at) => Err(Error::format(format!("byte {at}"), "not as an encoder writes it")),
    }
}

fn head(w: &mut Writer<'_>, flags: u8, vocabulary: &Vocabulary) {
    MAGIC.iter().chain([&flags]).for_each(|&b| w.bits(u64::from(b), 8));
    w.bits(u64::from(vocabulary.fingerprint()), 32);
}

/// The flags of a frame of this vocabulary, and a reader behind the head.
fn open<'a>(bytes: &'a [u8], vocabulary: &Vocabulary) -> Result<(u8, Reader<'a>), Error> {
    let r = Reader::new(bytes, 0);
    let Some((head, _)) = bytes.split_first_chunk::<HEAD>() else {
        return Err(r.bad("the frame ends early"));
    };
    let [m, s, g, v, flags, fingerprint @ ..] = *head;
    if [m, s, g, v] != *MAGIC {
        return Err(r.bad("no MSG5 frame"));
    }
    if u32::from_le_bytes(fingerprint) != vocabulary.fingerprint() {
        return Err(r.bad("written with another vocabulary"));
    }
    Ok((flags, Reader::new(bytes, HEAD)))
}

/// Zeros to the length that the counts need.
fn pad(
    w: &mut Writer<'_>,
    nodes: impl ExactSizeIterator<Item = Node>,
    edges: usize,
    looked: Option<&Looked>,
) {
    // A grid that is too large for memory cannot exist.
    let cells = looked.map_or(0, |l| cells::least_bytes(l.span().1)) as usize;
    let n = nodes.len();
    w.fill(least_bytes(n, nodes.map(|n| n.bounds.footprint().is_some()), edges) + cells);
}

fn put_key(w: &mut Writer<'_>, key: &Key) {
    for v in [u32::from(key.agent), u32::from(key.epoch), key.seq, key.start_ds] {
        w.number(u64::from(v));
    }
}

fn read_key(r: &mut Reader<'_>) -> Result<Key, Error> {
    let short = |r: &mut Reader<'_>| u16::try_from(r.number()?).map_err(|_| r.bad("a number beyond 16 bits"));
    let (agent, epoch) = (short(r)?, short(r)?);
    let (seq, start_ds) = (r.u32()?, r.u32()?);
    Ok(Key { start_ds, agent, epoch, seq })
}

fn put_name(w: &mut Writer<'_>, key: &Key, end_ds: u32, frame: u32) {
    put_key(w, key);
    w.number(u64::from(end_ds.saturating_sub(key.start_ds)));
    w.number(u64::from(frame));
}

fn read_name(r: &mut Reader<'_>) -> Result<(Key, u32, u32), Error> {
    let key = read_key(r)?;
    let (duration, frame) = (r.u32()?, r.u32()?);
    let end_ds = key.start_ds.checked_add(duration).ok_or_else(|| r.bad("end beyond the clock"))?;
    Ok((key, end_ds, frame))
}

fn flags_of(nodes: impl Iterator<Item = Node>) -> u8 {
    nodes.fold(0, |flags, n| {
        let evidence = !n.others.is_empty() || n.misses > 0;
        flags | (u8::from(evidence) * EVIDENCE) | (u8::from(n.bounds.footprint().is_some()) * FOOTPRINTS)
    })
}

fn to_cm(v: f32) -> i64 {
    (f64::from(v) * 100.0).round() as i64
}

fn of_cm(v: i64) -> f32 {
    (v as f64 / 100.0) as f32
}

fn to_score(s: f32) -> u64 {
    (s.clamp(0.0, 1.0) * SCORE_STEPS).round() as u64
}

fn of_score(s: u64) -> f32 {
    quantise_score(s as f32 / SCORE_STEPS)
}

impl<'a> Reader<'a> {
    fn count(&mut self, max: usize, fit: usize) -> Result<usize, Error> {
        let v = self.number()?;
        let n = usize::try_from(v).ok().filter(|&n| n <= max && n <= fit);
        n.ok_or_else(|| self.bad(format!("{v} records, but at most {} fit", fit.min(max))))
    }

    /// Numbers of names, of which there are so many.
    fn names(&mut self, n: usize, there: usize, what: &str) -> Result<Column<'a>, Error> {
        let most = there.min(1 << 16);
        if n > 0 && most == 0 {
            return Err(self.bad(format!("a {what}, but the vocabulary has none")));
        }
        self.column(n, most.saturating_sub(1) as u64)
    }
}
