//! An observation as what changed since another one.

use super::bits::{Reader, Writer};
use super::{
    DELTA, FRAME, LOOKED, LOOKED_AS_BEFORE, cells, check_size, edges, encode, flags_of, head, least_bytes,
    nodes, open, pad, put_name, read_counts, read_key, read_name, rest,
};
use crate::{Edge, Error, Key, Node, NodeId, Observation, SceneGraph, Vocabulary};

/// What `o` changes of `base`, an observation that the receiver has, as bytes. Worth it where few
/// nodes changed: those that did travel whole.
///
/// # Errors
/// As [`encode`].
pub fn encode_delta(base: &Observation, o: &Observation, vocabulary: &Vocabulary) -> Result<Vec<u8>, Error> {
    check_size(&o.graph, &FRAME)?;
    let mut w = Writer::default();
    put(&mut w, base, o, vocabulary)?;
    Ok(w.finish())
}

fn put(
    w: &mut Writer<'_>,
    base: &Observation,
    o: &Observation,
    vocabulary: &Vocabulary,
) -> Result<(), Error> {
    let (old, new) = (base.graph.quantised(), o.graph.quantised());
    let nodes: Vec<Node> = new.nodes().filter(|n| old.node(n.id).as_ref() != Some(n)).collect();
    let edges: Vec<Edge> = new.edges().filter(|e| !has(&old, e)).collect();
    let looked = o.looked.as_ref().filter(|l| base.looked.as_ref() != Some(l));
    let looked_flag = match (&o.looked, looked) {
        (_, Some(_)) => LOOKED,
        (Some(_), None) => LOOKED_AS_BEFORE,
        (None, None) => 0,
    };
    head(w, flags_of(nodes.iter().cloned()) | DELTA | looked_flag, vocabulary);
    w.bits(u64::from(fingerprint(&encode(base, vocabulary)?)), 32);
    put_name(w, &o.key, o.end_ds, o.frame);
    put_places(w, old.nodes().map(|n| !new.has_node(n.id)));
    put_places(w, survivors(&old, &new).map(|e| new.edge(e.s, e.t, e.p).is_none()));
    w.number(nodes.len() as u64);
    w.number(edges.len() as u64);
    nodes::put(w, nodes.iter().cloned(), o.end_ds);
    edges::put(w, &new, edges.iter().copied());
    if let Some(looked) = looked {
        cells::put(w, looked);
    }
    pad(w, nodes.into_iter(), edges.len(), looked);
    Ok(())
}

/// The observation of which `bytes` say what it changes of `base`.
///
/// # Errors
/// As [`super::decode`]; another base than the one that the frame was made with.
pub fn decode_delta(bytes: &[u8], base: &Observation, vocabulary: &Vocabulary) -> Result<Observation, Error> {
    let (flags, mut r) = open(bytes, vocabulary)?;
    let known = super::EVIDENCE | super::FOOTPRINTS | DELTA | LOOKED | LOOKED_AS_BEFORE;
    if flags & DELTA == 0 || flags & !known != 0 || flags & LOOKED != 0 && flags & LOOKED_AS_BEFORE != 0 {
        return Err(r.bad(format!("flags {flags:#x} of no delta")));
    }
    if r.bits(32)? != u64::from(fingerprint(&encode(base, vocabulary)?)) {
        return Err(r.bad("made for another base"));
    }
    let (key, end_ds, frame) = read_name(&mut r)?;
    let mut graph = base.graph.quantised();
    let old: Vec<_> = graph.nodes().map(|n| n.id).collect();
    for k in read_places(&mut r, old.len())? {
        graph.remove_node(old[k]);
    }
    let old: Vec<Edge> = graph.edges().collect();
    for k in read_places(&mut r, old.len())? {
        graph.remove_edge(&old[k]);
    }
    let (n, m) = read_counts(&mut r, bytes.len(), &FRAME)?;
    let mut nodes = nodes::Columns::read(&mut r, n, flags, end_ds, vocabulary)?;
    let rest = rest(&r, bytes, least_bytes(n, nodes.footprints(), m))?;
    for _ in 0..n {
        graph.insert_node(nodes.node()?);
    }
    let ids: Vec<NodeId> = graph.nodes().map(|n| n.id).collect();
    for ([s, t], p, score) in edges::Columns::read(&mut r, m, ids.len(), vocabulary)?.edges() {
        let e = Edge { s: ids[s], t: ids[t], p, score };
        graph.remove_edge(&e);
        graph.insert_edge(e).map_err(|e| r.bad(e.to_string()))?;
    }
    let looked = match (flags & LOOKED != 0, flags & LOOKED_AS_BEFORE != 0) {
        (true, _) => Some(cells::read(&mut r, rest)?),
        (false, true) => base.looked.clone(),
        (false, false) => None,
    };
    let o = Observation { key, end_ds, frame, graph, looked };
    check_size(&o.graph, &FRAME)?;
    let mut again = Writer::against(bytes);
    put(&mut again, base, &o, vocabulary)?;
    again.same()?;
    Ok(o)
}

/// The name of the observation that a delta makes: where it is a later revision of a visit, the base is an
/// earlier one of the same agent, epoch and start.
///
/// # Errors
/// No delta of this vocabulary.
pub fn revision_of(bytes: &[u8], vocabulary: &Vocabulary) -> Result<Key, Error> {
    let (flags, mut r) = open(bytes, vocabulary)?;
    if flags & DELTA == 0 {
        return Err(r.bad(format!("flags {flags:#x} of no delta")));
    }
    r.bits(32)?;
    read_key(&mut r)
}

fn has(graph: &SceneGraph, e: &Edge) -> bool {
    graph.edge(e.s, e.t, e.p) == Some(e.score)
}

/// Edges of `old` whose ends are still there.
fn survivors<'a>(old: &'a SceneGraph, new: &'a SceneGraph) -> impl Iterator<Item = Edge> + Clone + 'a {
    old.edges().filter(|e| new.has_node(e.s) && new.has_node(e.t))
}

/// Which of a list: how many, and the distance of each to the one before.
fn put_places(w: &mut Writer<'_>, list: impl Iterator<Item = bool> + Clone) {
    w.number(list.clone().filter(|l| *l).count() as u64);
    let mut next = 0;
    let of = move |(k, _): (usize, bool)| (k - std::mem::replace(&mut next, k + 1)) as u64;
    w.column(list.enumerate().filter(|l| l.1).map(of));
}

fn read_places(r: &mut Reader<'_>, of: usize) -> Result<Vec<usize>, Error> {
    let n = r.count(of, of)?;
    let mut next = 0;
    let mut out = Vec::with_capacity(n);
    for gap in r.column(n, of as u64)? {
        let k = next + gap as usize;
        if k >= of {
            return Err(r.bad(format!("place {k} in a list of {of}")));
        }
        out.push(k);
        next = k + 1;
    }
    Ok(out)
}

/// FNV-1a, 32 bits.
fn fingerprint(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0x811c_9dc5, |h, &b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193))
}
