//! The frames in which observations travel: integers in columns of bits, strict to decode.
//!
//! `docs/wire.md` is the normative layout. Lengths travel in centimetres, times in tenths of a
//! second, probabilities in 1/127.
//!
//! [`encode`] writes a whole observation; [`encode_delta`] what changed since one that the receiver has.

mod bits;
mod cells;
mod delta;
mod entries;
mod snapshot;

use crate::graph::{SCORE_STEPS, YAW_STEPS, quantise_score, yaw_of};
use crate::{
    Box3, Edge, Error, Footprint, Key, LabelId, Looked, Node, NodeId, Observation, PredicateId, SceneGraph,
    Vocabulary,
};
use bits::{Reader, Writer};
pub use delta::{decode_delta, encode_delta, revision_of};
pub use entries::{Kind, MAX_KEYS, decode_gone, decode_retraction, encode_gone, encode_retraction, kind};
pub use snapshot::{decode_snapshot, encode_snapshot};

/// First bytes of every frame.
pub const MAGIC: &[u8; 4] = b"MSG3";
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
/// Shortest frame per node and per edge, bytes: what bounds the memory that a short frame can ask for.
const NODE_BYTES: usize = 8;
const EDGE_BYTES: usize = 2;

/// An observation as bytes. Decoding gives [`SceneGraph::quantised`] of its graph.
///
/// # Errors
/// More nodes or edges than a frame may hold.
pub fn encode(o: &Observation, vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    let (n, m) = (o.graph.len(), o.graph.edges().len());
    check_size(&o.graph)?;
    let nodes: Vec<&Node> = o.graph.nodes().collect();
    let looked = if o.looked.is_some() { LOOKED } else { 0 };
    let mut w = head(flags_of(&nodes) | looked, vocabulary);
    put_name(&mut w, o);
    w.number(n as u64);
    w.number(m as u64);
    put_nodes(&mut w, &nodes, o.end_ds);
    put_edges(&mut w, &o.graph, &o.graph.edges().collect::<Vec<_>>());
    if let Some(looked) = &o.looked {
        cells::put(&mut w, looked);
    }
    Ok(padded(w, n, m, o.looked.as_ref()))
}

/// The observation of a frame.
///
/// # Errors
/// Anything but a frame that [`encode`] could have written with the same vocabulary: other
/// vocabulary, counts beyond the limits or the frame's length, numbers out of range, edges twice or
/// out of order, bytes left over, a longer way of writing where a shorter one would do.
pub fn decode(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Observation, Error> {
    let (flags, mut r) = open(bytes, vocabulary)?;
    if flags & !(EVIDENCE | LOOKED | FOOTPRINTS) != 0 {
        return Err(r.bad(format!("flags {flags:#x} of no whole observation")));
    }
    let (key, end_ds, frame) = read_name(&mut r)?;
    let (n, m) =
        (r.count(MAX_NODES, bytes.len() / NODE_BYTES)?, r.count(MAX_EDGES, bytes.len() / EDGE_BYTES)?);
    let nodes = read_nodes(&mut r, n, flags, end_ds, vocabulary)?;
    let mut graph = SceneGraph::default();
    nodes.into_iter().for_each(|n| graph.insert_node(n));
    for e in read_edges(&mut r, m, &graph, vocabulary)? {
        graph.insert_edge(e).map_err(|e| r.bad(e.to_string()))?;
    }
    let looked = if flags & LOOKED != 0 { Some(cells::read(&mut r, bytes.len())?) } else { None };
    let o = Observation { key, end_ds, frame, graph, looked };
    only_way(&encode(&o, vocabulary)?, bytes)?;
    Ok(o)
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

fn check_size(g: &SceneGraph) -> Result<(), Error> {
    if g.len() > MAX_NODES || g.edges().len() > MAX_EDGES {
        let problem =
            format!("{} nodes, {} edges, want at most {MAX_NODES} and {MAX_EDGES}", g.len(), g.edges().len());
        return Err(Error::value("graph", problem));
    }
    Ok(())
}

/// There is one way to write an observation.
fn only_way(written: &[u8], bytes: &[u8]) -> Result<(), Error> {
    match (0..bytes.len().max(written.len())).find(|&k| written.get(k) != bytes.get(k)) {
        None => Ok(()),
        Some(at) => Err(Error::format(format!("byte {at}"), "not as an encoder writes it")),
    }
}

fn head(flags: u8, vocabulary: &Vocabulary) -> Writer {
    let mut bytes = MAGIC.to_vec();
    bytes.push(flags);
    bytes.extend(vocabulary.fingerprint().to_le_bytes());
    Writer::new(bytes)
}

/// The flags of a frame of this vocabulary, and a reader behind the head.
fn open<'a>(bytes: &'a [u8], vocabulary: &Vocabulary) -> Result<(u8, Reader<'a>), Error> {
    let r = Reader::new(bytes, 0);
    let Some((head, _)) = bytes.split_first_chunk::<HEAD>() else {
        return Err(r.bad("the frame ends early"));
    };
    let [m, s, g, v, flags, fingerprint @ ..] = *head;
    if [m, s, g, v] != *MAGIC {
        return Err(r.bad("no MSG3 frame"));
    }
    if u32::from_le_bytes(fingerprint) != vocabulary.fingerprint() {
        return Err(r.bad("written with another vocabulary"));
    }
    Ok((flags, Reader::new(bytes, HEAD)))
}

/// The bytes, with zeros to the length that the counts need.
fn padded(w: Writer, nodes: usize, edges: usize, looked: Option<&Looked>) -> Vec<u8> {
    let mut bytes = w.finish();
    // A grid that is too large for memory cannot exist.
    let cells = looked.map_or(0, |l| cells::least_bytes(l.span().1)) as usize;
    let least = nodes * NODE_BYTES + edges * EDGE_BYTES + cells;
    if bytes.len() < least {
        bytes.resize(least, 0);
    }
    bytes
}

fn put_key(w: &mut Writer, key: &Key) {
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

fn put_name(w: &mut Writer, o: &Observation) {
    put_key(w, &o.key);
    w.number(u64::from(o.end_ds.saturating_sub(o.key.start_ds)));
    w.number(u64::from(o.frame));
}

fn read_name(r: &mut Reader<'_>) -> Result<(Key, u32, u32), Error> {
    let key = read_key(r)?;
    let (duration, frame) = (r.u32()?, r.u32()?);
    let end_ds = key.start_ds.checked_add(duration).ok_or_else(|| r.bad("end beyond the clock"))?;
    Ok((key, end_ds, frame))
}

fn flags_of(nodes: &[&Node]) -> u8 {
    let evidence = nodes.iter().any(|n| !n.others.is_empty() || n.misses > 0);
    let footprints = nodes.iter().any(|n| n.bounds.footprint().is_some());
    (u8::from(evidence) * EVIDENCE) | (u8::from(footprints) * FOOTPRINTS)
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

/// Nodes in the order of their ids, with the columns that their flags call for.
fn put_nodes(w: &mut Writer, nodes: &[&Node], end_ds: u32) {
    let of = |f: &dyn Fn(&Node) -> u64| nodes.iter().map(|n| f(n)).collect::<Vec<u64>>();
    let signed = |f: &dyn Fn(&Node) -> i64| nodes.iter().map(|n| f(n)).collect::<Vec<i64>>();
    if let Some(first) = nodes.first() {
        w.number(first.id.0);
    }
    w.column(&nodes.windows(2).map(|p| p[1].id.0 - p[0].id.0 - 1).collect::<Vec<_>>());
    w.column(&of(&|n| u64::from(n.label.0)));
    w.column(&of(&|n| to_score(n.score)));
    for axis in 0..3 {
        w.signed(&signed(&|n| to_cm(n.bounds.centroid()[axis])));
    }
    for axis in 0..3 {
        w.column(&of(&|n| to_cm(n.bounds.extent()[axis]).unsigned_abs()));
    }
    w.column(&of(&|n| u64::from(n.sightings)));
    w.signed(&signed(&|n| i64::from(end_ds) - (n.last_seen * 10.0).round() as i64));
    let flags = flags_of(nodes);
    if flags & FOOTPRINTS != 0 {
        put_footprints(w, nodes);
    }
    if flags & EVIDENCE != 0 {
        put_evidence(w, nodes);
    }
}

fn put_footprints(w: &mut Writer, nodes: &[&Node]) {
    w.column(&nodes.iter().map(|n| u64::from(n.bounds.footprint().is_some())).collect::<Vec<_>>());
    let there: Vec<Footprint> = nodes.iter().filter_map(|n| n.bounds.footprint()).collect();
    for side in 0..2 {
        w.column(&there.iter().map(|f| to_cm(f.sides[side]).unsigned_abs()).collect::<Vec<_>>());
    }
    w.column(&there.iter().map(|f| step_of(f.yaw)).collect::<Vec<_>>());
}

fn step_of(yaw: f32) -> u64 {
    (yaw / std::f32::consts::FRAC_PI_2 * YAW_STEPS).round() as u64
}

fn put_evidence(w: &mut Writer, nodes: &[&Node]) {
    let others = |n: &Node| n.others.len().min(Node::MAX_OTHERS);
    w.column(&nodes.iter().map(|n| others(n) as u64).collect::<Vec<_>>());
    let all: Vec<(LabelId, f32)> = nodes.iter().flat_map(|n| n.others[..others(n)].to_vec()).collect();
    w.column(&all.iter().map(|o| u64::from(o.0.0)).collect::<Vec<_>>());
    w.column(&all.iter().map(|o| to_score(o.1)).collect::<Vec<_>>());
    w.column(&nodes.iter().map(|n| u64::from(n.misses)).collect::<Vec<_>>());
}

/// Edges in the order (subject, object, predicate), their ends as places in the graph's list of nodes.
fn put_edges(w: &mut Writer, graph: &SceneGraph, edges: &[Edge]) {
    let ids: Vec<NodeId> = graph.nodes().map(|n| n.id).collect();
    // An edge's ends are nodes of the graph, so the search always finds them.
    let index = |id: NodeId| ids.binary_search(&id).unwrap_or(0);
    let mut last = 0;
    let steps = edges.iter().map(|e| {
        let s = index(e.s);
        (s - std::mem::replace(&mut last, s)) as u64
    });
    w.column(&steps.collect::<Vec<_>>());
    w.signed(&edges.iter().map(|e| index(e.t) as i64 - index(e.s) as i64).collect::<Vec<_>>());
    w.column(&edges.iter().map(|e| u64::from(e.p.0)).collect::<Vec<_>>());
    w.column(&edges.iter().map(|e| to_score(e.score)).collect::<Vec<_>>());
}

impl Reader<'_> {
    fn count(&mut self, max: usize, fit: usize) -> Result<usize, Error> {
        let v = self.number()?;
        let n = usize::try_from(v).ok().filter(|&n| n <= max && n <= fit);
        n.ok_or_else(|| self.bad(format!("{v} records, but at most {} fit", fit.min(max))))
    }

    fn labels(&mut self, n: usize, vocabulary: &Vocabulary) -> Result<Vec<LabelId>, Error> {
        let most = vocabulary.len().0.min(1 << 16);
        if n > 0 && most == 0 {
            return Err(self.bad("a label, but the vocabulary has none"));
        }
        let column = self.column(n, most.saturating_sub(1) as u64)?;
        Ok(column.into_iter().map(|l| LabelId(l as u16)).collect())
    }

    fn scores(&mut self, n: usize) -> Result<Vec<f32>, Error> {
        Ok(self.column(n, SCORE_STEPS as u64)?.into_iter().map(of_score).collect())
    }

    fn lengths(&mut self, n: usize) -> Result<Vec<f32>, Error> {
        Ok(self.column(n, 100_000_000)?.into_iter().map(|v| of_cm(v as i64)).collect())
    }

    fn u32s(&mut self, n: usize) -> Result<Vec<u32>, Error> {
        Ok(self.column(n, u64::from(u32::MAX))?.into_iter().map(|v| v as u32).collect())
    }

    fn ids(&mut self, n: usize) -> Result<Vec<NodeId>, Error> {
        if n == 0 {
            return Ok(Vec::new());
        }
        let mut ids = vec![NodeId(self.number()?)];
        let mut last = ids[0].0;
        for step in self.column(n - 1, u64::MAX)? {
            last = step
                .checked_add(1)
                .and_then(|s| last.checked_add(s))
                .ok_or_else(|| self.bad("an id beyond 64 bits"))?;
            ids.push(NodeId(last));
        }
        Ok(ids)
    }
}

fn read_nodes(
    r: &mut Reader<'_>,
    n: usize,
    flags: u8,
    end_ds: u32,
    vocabulary: &Vocabulary,
) -> Result<Vec<Node>, Error> {
    let ids = r.ids(n)?;
    let label = r.labels(n, vocabulary)?;
    let score = r.scores(n)?;
    let centroid = [r.signed(n)?, r.signed(n)?, r.signed(n)?];
    let extent = [r.lengths(n)?, r.lengths(n)?, r.lengths(n)?];
    let sightings = r.u32s(n)?;
    let ago = r.signed(n)?;
    let mut nodes = Vec::with_capacity(n);
    for k in 0..n {
        let seen = i64::from(end_ds).checked_sub(ago[k]).filter(|s| s.unsigned_abs() < 1 << 40);
        let bounds = Box3::new([0, 1, 2].map(|a| of_cm(centroid[a][k])), [0, 1, 2].map(|a| extent[a][k]));
        nodes.push(Node {
            id: ids[k],
            label: label[k],
            score: score[k],
            bounds: bounds.map_err(|e| r.bad(e.to_string()))?,
            others: Vec::new(),
            sightings: sightings[k],
            misses: 0,
            last_seen: seen.ok_or_else(|| r.bad("last_seen out of range"))? as f64 / 10.0,
        });
    }
    if flags & FOOTPRINTS != 0 {
        read_footprints(r, &mut nodes)?;
    }
    if flags & EVIDENCE != 0 {
        read_evidence(r, &mut nodes, vocabulary)?;
    }
    Ok(nodes)
}

fn read_footprints(r: &mut Reader<'_>, nodes: &mut [Node]) -> Result<(), Error> {
    let there = r.column(nodes.len(), 1)?;
    let n = there.iter().filter(|&&t| t == 1).count();
    let sides = [r.lengths(n)?, r.lengths(n)?];
    let yaw = r.column(n, YAW_STEPS as u64)?;
    let with = nodes.iter_mut().zip(&there).filter(|(_, t)| **t == 1).map(|(n, _)| n);
    for (k, node) in with.enumerate() {
        let f = Footprint { sides: [sides[0][k], sides[1][k]], yaw: yaw_of(yaw[k] as u16) };
        node.bounds = node.bounds.with_footprint(f).map_err(|e| r.bad(e.to_string()))?;
    }
    Ok(())
}

fn read_evidence(r: &mut Reader<'_>, nodes: &mut [Node], vocabulary: &Vocabulary) -> Result<(), Error> {
    let counts = r.column(nodes.len(), Node::MAX_OTHERS as u64)?;
    let all = counts.iter().sum::<u64>() as usize;
    let (labels, scores) = (r.labels(all, vocabulary)?, r.scores(all)?);
    let misses = r.u32s(nodes.len())?;
    let mut others = labels.into_iter().zip(scores);
    for (k, node) in nodes.iter_mut().enumerate() {
        node.others = others.by_ref().take(counts[k] as usize).collect();
        node.misses = misses[k];
    }
    Ok(())
}

/// Edges between nodes of a graph.
fn read_edges(
    r: &mut Reader<'_>,
    m: usize,
    graph: &SceneGraph,
    vocabulary: &Vocabulary,
) -> Result<Vec<Edge>, Error> {
    let ids: Vec<NodeId> = graph.nodes().map(|n| n.id).collect();
    let steps = r.column(m, MAX_NODES as u64)?;
    let to = r.signed(m)?;
    let p = r.column(m, (vocabulary.len().1.min(1 << 16)).saturating_sub(1) as u64)?;
    if m > 0 && vocabulary.len().1 == 0 {
        return Err(r.bad("a predicate, but the vocabulary has none"));
    }
    let scores = r.scores(m)?;
    let mut edges: Vec<Edge> = Vec::with_capacity(m);
    let mut s = 0_usize;
    for k in 0..m {
        s += steps[k] as usize;
        let t =
            i64::try_from(s).ok().and_then(|s| s.checked_add(to[k])).and_then(|t| usize::try_from(t).ok());
        let id = |k: Option<usize>| {
            let of = k.and_then(|k| ids.get(k)).copied();
            of.ok_or_else(|| r.bad(format!("an edge to node {k:?} of {}", ids.len())))
        };
        edges.push(Edge { s: id(Some(s))?, t: id(t)?, p: PredicateId(p[k] as u16), score: scores[k] });
        let rising = |w: &[Edge]| (w[0].s, w[0].t, w[0].p) < (w[1].s, w[1].t, w[1].p);
        if !edges[k.saturating_sub(1)..].windows(2).all(rising) {
            return Err(r.bad("edges not rising"));
        }
    }
    Ok(edges)
}
