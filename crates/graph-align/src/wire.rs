//! The frames in which observations travel: integers in columns, strict to decode.
//!
//! Layout (little-endian; `v` = LEB128 varint without padding, `z` = zigzag varint):
//! magic `MSG2`, u8 flags (1: classes and misses, 2: looked, 4: footprints), u32 vocabulary fingerprint, u16 agent, u16 epoch, v seq, v start (0.1 s),
//! v duration (0.1 s), v frame, v nodes, v edges; node columns: id (first v, then v of the
//! difference to the one before, at least 1), label v, score u8 (1/255), centroid x, y, z as z of
//! the difference to the node before (cm), extent x, y, z as v (cm), sightings v, last_seen z
//! relative to the end (0.1 s); with flag 4 also 0, or 1 plus the
//! first side and the second as v (cm) and the yaw u8 (1/255 of a quarter turn), node by node; with
//! flag 1 the number of other classes u8, their labels v and
//! scores u8 node by node, misses v; edge columns: subject's index as v of the difference to the one
//! before, object's index v, predicate v, score u8; with flag 2 what was looked at: side of a
//! cell v (cm), origin x, y, z as z (cm), smallest cell z each, size in cells v each, then one bit
//! per cell, x fastest, lowest bit first, zeros to the end of the byte. `docs/wire.md` is normative.

use crate::graph::{YAW_STEPS, quantise_score, yaw_of};
use crate::{
    Box3, Edge, Error, Footprint, Key, LabelId, Looked, Node, NodeId, Observation, PredicateId, SceneGraph,
    Vocabulary,
};

/// First bytes of every frame.
pub const MAGIC: &[u8; 4] = b"MSG2";
const EVIDENCE: u8 = 1;
const LOOKED: u8 = 2;
const FOOTPRINTS: u8 = 4;
/// Most nodes of a frame.
pub const MAX_NODES: usize = 1 << 16;
/// Most edges of a frame.
pub const MAX_EDGES: usize = 1 << 18;

/// An observation as bytes. Decoding gives [`SceneGraph::quantised`] of its graph.
///
/// # Errors
/// More nodes or edges than a frame may hold.
pub fn encode(o: &Observation, vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    let g = &o.graph;
    if g.len() > MAX_NODES || g.edges().len() > MAX_EDGES {
        return Err(Error::value(
            "graph",
            format!("{} nodes, {} edges, want at most {MAX_NODES} and {MAX_EDGES}", g.len(), g.edges().len()),
        ));
    }
    let evidence = g.nodes().any(|n| !n.others.is_empty() || n.misses > 0);
    let mut w = MAGIC.to_vec();
    let footprints = g.nodes().any(|n| n.bounds.footprint().is_some());
    let flag = |is: bool, bit: u8| if is { bit } else { 0 };
    w.push(flag(evidence, EVIDENCE) | flag(o.looked.is_some(), LOOKED) | flag(footprints, FOOTPRINTS));
    w.extend(vocabulary.fingerprint().to_le_bytes());
    w.extend(o.key.agent.to_le_bytes());
    w.extend(o.key.epoch.to_le_bytes());
    for v in [o.key.seq, o.key.start_ds, o.end_ds.saturating_sub(o.key.start_ds), o.frame] {
        put(&mut w, u64::from(v));
    }
    put(&mut w, g.len() as u64);
    put(&mut w, g.edges().len() as u64);
    put_nodes(&mut w, g, o.end_ds);
    if footprints {
        put_footprints(&mut w, g);
    }
    if evidence {
        put_evidence(&mut w, g);
    }
    put_edges(&mut w, g);
    if let Some(looked) = &o.looked {
        put_looked(&mut w, looked);
    }
    Ok(w)
}

fn put_nodes(w: &mut Vec<u8>, g: &SceneGraph, end_ds: u32) {
    let mut last = 0;
    for (k, n) in g.nodes().enumerate() {
        put(w, if k == 0 { n.id.0 } else { n.id.0 - last });
        last = n.id.0;
    }
    g.nodes().for_each(|n| put(w, u64::from(n.label.0)));
    w.extend(g.nodes().map(|n| (n.score.clamp(0.0, 1.0) * 255.0).round() as u8));
    for axis in 0..3 {
        let mut last = 0;
        for n in g.nodes() {
            let c = to_cm(n.bounds.centroid()[axis]);
            put_signed(w, c - last);
            last = c;
        }
    }
    for axis in 0..3 {
        g.nodes().for_each(|n| put(w, to_cm(n.bounds.extent()[axis]).unsigned_abs()));
    }
    g.nodes().for_each(|n| put(w, u64::from(n.sightings)));
    g.nodes().for_each(|n| put_signed(w, i64::from(end_ds) - (n.last_seen * 10.0).round() as i64));
}

fn put_evidence(w: &mut Vec<u8>, g: &SceneGraph) {
    let others = |n: &Node| n.others.len().min(Node::MAX_OTHERS);
    w.extend(g.nodes().map(|n| others(n) as u8));
    for n in g.nodes() {
        n.others[..others(n)].iter().for_each(|o| put(w, u64::from(o.0.0)));
        w.extend(n.others[..others(n)].iter().map(|o| (o.1.clamp(0.0, 1.0) * 255.0).round() as u8));
    }
    g.nodes().for_each(|n| put(w, u64::from(n.misses)));
}

/// Of each node 0, or 1 and the sides, then the step of its yaw.
fn put_footprints(w: &mut Vec<u8>, g: &SceneGraph) {
    for n in g.nodes() {
        let Some(f) = n.bounds.footprint() else {
            w.push(0);
            continue;
        };
        put(w, 1 + to_cm(f.sides[0]).unsigned_abs());
        put(w, to_cm(f.sides[1]).unsigned_abs());
        w.push((f.yaw / std::f32::consts::FRAC_PI_2 * YAW_STEPS).round() as u8);
    }
}

fn put_looked(w: &mut Vec<u8>, l: &Looked) {
    put(w, to_cm(l.cell()).max(1) as u64);
    (0..3).for_each(|k| put_signed(w, to_cm(l.origin()[k])));
    let (first, size) = l.span();
    first.iter().for_each(|&c| put_signed(w, i64::from(c)));
    size.iter().for_each(|&s| put(w, u64::from(s)));
    w.extend(l.bits());
}

fn put_edges(w: &mut Vec<u8>, g: &SceneGraph) {
    let ids: Vec<NodeId> = g.nodes().map(|n| n.id).collect();
    // An edge's ends are nodes of the graph, so the search always finds them.
    let index = |id: NodeId| ids.binary_search(&id).unwrap_or(0) as u64;
    let mut last = 0;
    for e in g.edges() {
        let s = index(e.s);
        put(w, s - last);
        last = s;
    }
    g.edges().for_each(|e| put(w, index(e.t)));
    g.edges().for_each(|e| put(w, u64::from(e.p.0)));
    w.extend(g.edges().map(|e| (e.score.clamp(0.0, 1.0) * 255.0).round() as u8));
}

/// The observation of a frame.
///
/// # Errors
/// Anything but a frame that [`encode`] could have written with the same vocabulary: other
/// vocabulary, counts beyond the limits or the frame's length, padded varints, numbers out of
/// range, edges twice or out of order, bytes left over.
pub fn decode(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Observation, Error> {
    let mut r = Reader { bytes, at: 0 };
    if r.take(4)? != MAGIC {
        return Err(r.bad("no MSG2 frame"));
    }
    let [flags] = r.array()?;
    if flags & !(EVIDENCE | LOOKED | FOOTPRINTS) != 0 {
        return Err(r.bad(format!("flags {flags:#x}, want at most 7")));
    }
    let fingerprint = u32::from_le_bytes(r.array()?);
    if fingerprint != vocabulary.fingerprint() {
        return Err(r.bad("written with another vocabulary"));
    }
    let agent = u16::from_le_bytes(r.array()?);
    let epoch = u16::from_le_bytes(r.array()?);
    let (seq, start_ds, duration, frame) = (r.u32()?, r.u32()?, r.u32()?, r.u32()?);
    let end_ds = start_ds.checked_add(duration).ok_or_else(|| r.bad("end beyond the clock"))?;
    let (n, m) = (r.count(MAX_NODES, 11)?, r.count(MAX_EDGES, 4)?);
    let (labels, predicates) = vocabulary.len();
    let mut graph = SceneGraph::default();
    let ids = r.nodes(n, labels, end_ds, &mut graph)?;
    if flags & FOOTPRINTS != 0 {
        r.footprints(&ids, &mut graph)?;
    }
    if flags & EVIDENCE != 0 {
        r.evidence(&ids, labels, &mut graph)?;
    }
    r.edges(m, predicates, &ids, &mut graph)?;
    let looked = if flags & LOOKED != 0 { Some(r.looked()?) } else { None };
    if r.at != bytes.len() {
        return Err(r.bad("bytes left over"));
    }
    Ok(Observation { key: Key { start_ds, agent, epoch, seq }, end_ds, frame, graph, looked })
}

fn to_cm(v: f32) -> i64 {
    (f64::from(v) * 100.0).round() as i64
}

fn of_cm(v: i64) -> f32 {
    (v as f64 / 100.0) as f32
}

fn put(w: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        w.push(v as u8 | 0x80);
        v >>= 7;
    }
    w.push(v as u8);
}

fn put_signed(w: &mut Vec<u8>, v: i64) {
    put(w, (v.wrapping_shl(1) ^ (v >> 63)) as u64);
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn bad(&self, problem: impl Into<String>) -> Error {
        Error::format(format!("byte {}", self.at), problem)
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Error> {
        let end = self.at.checked_add(n);
        let part = end
            .and_then(|end| self.bytes.get(self.at..end))
            .ok_or_else(|| self.bad("the frame ends early"))?;
        self.at += n;
        Ok(part)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        self.take(N)?.try_into().map_err(|_| self.bad("the frame ends early"))
    }

    fn varint(&mut self) -> Result<u64, Error> {
        let mut v = 0_u64;
        for shift in (0..64).step_by(7) {
            let [b] = self.array()?;
            let bits = u64::from(b & 0x7f);
            if bits << shift >> shift != bits {
                break;
            }
            v |= bits << shift;
            if b < 0x80 {
                return if b == 0 && shift > 0 { Err(self.bad("a padded varint")) } else { Ok(v) };
            }
        }
        Err(self.bad("a varint beyond 64 bits"))
    }

    fn signed(&mut self) -> Result<i64, Error> {
        let v = self.varint()?;
        Ok((v >> 1) as i64 ^ -((v & 1) as i64))
    }

    fn u32(&mut self) -> Result<u32, Error> {
        let v = self.varint()?;
        u32::try_from(v).map_err(|_| self.bad(format!("{v}, want at most 72 bits")))
    }

    /// A number of records of which each takes at least `size` bytes.
    fn count(&mut self, max: usize, size: usize) -> Result<usize, Error> {
        let v = self.varint()?;
        let room = (self.bytes.len() - self.at) / size;
        usize::try_from(v)
            .ok()
            .filter(|&n| n <= max && n <= room)
            .ok_or_else(|| self.bad(format!("{v} records, but at most {} fit", room.min(max))))
    }

    fn id_column(&mut self, n: usize) -> Result<Vec<NodeId>, Error> {
        let mut ids: Vec<NodeId> = Vec::with_capacity(n);
        for _ in 0..n {
            let v = self.varint()?;
            let id = match ids.last() {
                None => v,
                Some(last) => {
                    last.0.checked_add(v).filter(|_| v > 0).ok_or_else(|| self.bad("ids not rising"))?
                }
            };
            ids.push(NodeId(id));
        }
        Ok(ids)
    }

    fn nodes(
        &mut self,
        n: usize,
        labels: usize,
        end_ds: u32,
        graph: &mut SceneGraph,
    ) -> Result<Vec<NodeId>, Error> {
        let ids = self.id_column(n)?;
        let label = (0..n).map(|_| self.label(labels)).collect::<Result<Vec<_>, _>>()?;
        let score = self.take(n)?;
        let mut centroid = vec![[0_i64; 3]; n];
        for axis in 0..3 {
            let mut last = 0_i64;
            for c in &mut centroid {
                last = last.checked_add(self.signed()?).ok_or_else(|| self.bad("centroid out of range"))?;
                c[axis] = last;
            }
        }
        let mut extent = vec![[0_i64; 3]; n];
        for axis in 0..3 {
            for e in &mut extent {
                e[axis] = i64::from(self.u32()?);
            }
        }
        let sightings = (0..n).map(|_| self.u32()).collect::<Result<Vec<_>, _>>()?;
        for k in 0..n {
            let ago = self.signed()?;
            let seen = i64::from(end_ds).checked_sub(ago).filter(|s| s.unsigned_abs() < 1 << 40);
            let seen = seen.ok_or_else(|| self.bad("last_seen out of range"))?;
            graph.insert_node(Node {
                id: ids[k],
                label: label[k],
                score: quantise_score(f32::from(score[k]) / 255.0),
                bounds: Box3::new(centroid[k].map(of_cm), extent[k].map(of_cm))
                    .map_err(|e| self.bad(e.to_string()))?,
                others: Vec::new(),
                sightings: sightings[k],
                misses: 0,
                last_seen: seen as f64 / 10.0,
            });
        }
        Ok(ids)
    }

    fn label(&mut self, labels: usize) -> Result<LabelId, Error> {
        let v = self.varint()?;
        let id = u16::try_from(v).ok().filter(|&l| usize::from(l) < labels);
        id.map(LabelId).ok_or_else(|| self.bad(format!("label {v}, the vocabulary has {labels}")))
    }

    fn footprints(&mut self, ids: &[NodeId], graph: &mut SceneGraph) -> Result<(), Error> {
        let mut any = false;
        for id in ids {
            let first = self.varint()?;
            if first == 0 {
                continue;
            }
            any = true;
            let second = self.u32()?;
            let [step] = self.array()?;
            let first = u32::try_from(first - 1).map_err(|_| self.bad("a side beyond 32 bits"))?;
            let sides = [first, second].map(|s| of_cm(i64::from(s)));
            if let Some(n) = graph.node_mut(*id) {
                let f = Footprint { sides, yaw: yaw_of(step) };
                n.bounds = n.bounds.with_footprint(f).map_err(|e| self.bad(e.to_string()))?;
            }
        }
        if any { Ok(()) } else { Err(self.bad("footprints without one")) }
    }

    fn evidence(&mut self, ids: &[NodeId], labels: usize, graph: &mut SceneGraph) -> Result<(), Error> {
        let counts = self.take(ids.len())?;
        let mut any = false;
        for (id, &count) in ids.iter().zip(counts) {
            if usize::from(count) > Node::MAX_OTHERS {
                return Err(self.bad(format!("{count} other classes, want at most {}", Node::MAX_OTHERS)));
            }
            any |= count > 0;
            let names = (0..count).map(|_| self.label(labels)).collect::<Result<Vec<_>, _>>()?;
            let scores = self.take(usize::from(count))?;
            if let Some(n) = graph.node_mut(*id) {
                let of = |s: &u8| quantise_score(f32::from(*s) / 255.0);
                n.others = names.into_iter().zip(scores.iter().map(of)).collect();
            }
        }
        for id in ids {
            let misses = self.u32()?;
            any |= misses > 0;
            if let Some(n) = graph.node_mut(*id) {
                n.misses = misses;
            }
        }
        if any { Ok(()) } else { Err(self.bad("evidence that says nothing")) }
    }

    fn looked(&mut self) -> Result<Looked, Error> {
        let cell = of_cm(i64::from(self.u32()?));
        let mut three =
            || -> Result<[i64; 3], Error> { Ok([self.signed()?, self.signed()?, self.signed()?]) };
        let (origin, first) = (three()?, three()?);
        let size = [self.u32()?, self.u32()?, self.u32()?];
        let mut low = [0_i32; 3];
        for k in 0..3 {
            low[k] = i32::try_from(first[k]).map_err(|_| self.bad("a cell beyond 32 bits"))?;
            if origin[k].unsigned_abs() > 100_000_000 {
                return Err(self.bad("origin beyond 1e6 m"));
            }
        }
        let all = size.iter().try_fold(1_u64, |a, &s| a.checked_mul(u64::from(s))).unwrap_or(u64::MAX);
        let bytes = usize::try_from(all.div_ceil(8)).map_err(|_| self.bad("too many cells"))?;
        let bits = self.take(bytes)?;
        Looked::from_bits(cell, origin.map(of_cm), low, size, bits).map_err(|e| self.bad(e.to_string()))
    }

    fn edges(
        &mut self,
        m: usize,
        predicates: usize,
        ids: &[NodeId],
        graph: &mut SceneGraph,
    ) -> Result<(), Error> {
        let index = |r: &Self, v: u64| {
            usize::try_from(v)
                .ok()
                .and_then(|k| ids.get(k).copied())
                .ok_or_else(|| r.bad(format!("node index {v}, the frame has {}", ids.len())))
        };
        let mut s = Vec::with_capacity(m);
        let mut last = 0_u64;
        for _ in 0..m {
            last = last.checked_add(self.varint()?).ok_or_else(|| self.bad("node index out of range"))?;
            s.push(index(self, last)?);
        }
        let mut t = Vec::with_capacity(m);
        for _ in 0..m {
            let v = self.varint()?;
            t.push(index(self, v)?);
        }
        let mut p = Vec::with_capacity(m);
        for _ in 0..m {
            let v = self.varint()?;
            let id = u16::try_from(v).ok().filter(|&p| usize::from(p) < predicates);
            p.push(PredicateId(
                id.ok_or_else(|| self.bad(format!("predicate {v}, the vocabulary has {predicates}")))?,
            ));
        }
        let score = self.take(m)?;
        let mut before = None;
        for k in 0..m {
            let key = (s[k], t[k], p[k]);
            if before.is_some_and(|b| b >= key) {
                return Err(self.bad("edges not rising"));
            }
            before = Some(key);
            let score = quantise_score(f32::from(score[k]) / 255.0);
            graph
                .insert_edge(Edge { s: s[k], t: t[k], p: p[k], score })
                .map_err(|e| self.bad(e.to_string()))?;
        }
        Ok(())
    }
}
