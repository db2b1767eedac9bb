//! `graph-align`: `wire` decodes an input as it is, or reads observations off it, writes them whole and as deltas and
//! reads them back; `align` reads two graphs off it, aligns and merges them.

use crate::{Reader, Shown, log};
use graph_align::robust::align_counted;
use graph_align::{
    Box3, Edge, Error, Footprint, Index, Key, LabelId, Looked, Node, NodeId, Observation, Outcome, Params,
    PredicateId, Query, SceneGraph, Vocabulary, update, wire as frames,
};
use std::collections::{BTreeMap, BTreeSet};

fn names() -> Result<Vocabulary, Error> {
    let labels = ["wall", "floor", "chair", "table", "lamp", "none"];
    Vocabulary::new(labels, ["standing on", "attached to", "close by"])
}

impl Reader<'_> {
    /// Mostly steps of a grid, so that centres and sizes repeat; sometimes far away.
    fn metres(&mut self) -> f32 {
        match self.byte() {
            255 => 9.9e5 - f32::from(self.byte()),
            b => f32::from(b) * 0.05 - 6.0,
        }
    }

    fn graph(&mut self) -> SceneGraph {
        let mut g = SceneGraph::default();
        let n = self.byte() % 48;
        for k in 0..u64::from(n) {
            let centroid = [self.metres(), self.metres(), self.metres() / 4.0];
            let extent = [0; 3].map(|_| f32::from(self.byte()) * 0.02);
            let Ok(mut b) = Box3::new(centroid, extent) else { continue };
            let turn = self.byte();
            if turn > 127 {
                let f = Footprint::rectangle([extent[0], extent[1]], f32::from(turn - 128) / 81.0);
                b = b.with_footprint(f).unwrap_or(b);
            }
            let mut node = Node::new(NodeId(k * 3), LabelId(u16::from(self.byte() % 6)), b);
            node.score = f32::from(self.byte() % 128) / 127.0;
            node.sightings = u32::from(self.byte() % 4);
            if self.byte() > 127 {
                node.others = [(LabelId(u16::from(self.byte() % 6)), 0.25)].into_iter().collect();
            }
            g.insert_node(node);
        }
        for _ in 0..self.byte() % 64 {
            let mut end = || NodeId(u64::from(self.byte()) % u64::from(n.max(1)) * 3);
            let (s, t) = (end(), end());
            // Ends that are not there make no edge.
            let _ = g.insert_edge(Edge { s, t, p: PredicateId(u16::from(self.byte() % 3)), score: 0.5 });
        }
        g
    }

    fn looked(&mut self) -> Option<Looked> {
        let n = self.byte() % 32;
        let cells: Vec<[i32; 3]> = (0..n).map(|_| [0; 3].map(|_| i32::from(self.byte()) / 16 - 8)).collect();
        Looked::new(0.5, [self.metres(), 0.0, 0.0], &cells).ok().filter(|_| n > 0)
    }

    fn observation(&mut self) -> Observation {
        let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: u32::from(self.byte()) };
        Observation {
            key,
            end_ds: 9,
            frame: 0,
            graph: self.graph().quantised(),
            looked: self.looked().map(|l| l.quantised()),
        }
    }
}

/// Frames: what decodes encodes to the same bytes. A frame is an input that starts with the magic;
/// other inputs are read as observations, written, read back, and kept as frames.
pub(crate) fn wire(input: &[u8]) -> Result<Shown, String> {
    let say = |e: Error| e.to_string();
    let names = &names().map_err(say)?;
    let mut seen = BTreeSet::new();
    if !input.starts_with(frames::MAGIC) {
        let mut r = Reader(input);
        let (base, o) = (r.observation(), r.observation());
        let whole = frames::encode(&o, names).map_err(say)?;
        if frames::decode(&whole, names).map_err(say)? != o {
            return Err("a frame that reads back as something else".into());
        }
        let delta = frames::encode_delta(&base, &o, names).map_err(say)?;
        if frames::decode_delta(&delta, &base, names).map_err(say)? != o {
            return Err("a delta that reads back as something else".into());
        }
        seen.insert(1000 + log(whole.len() as u64) * 40 + log(delta.len() as u64));
        return Ok(Shown { behaviours: seen, found: Some(whole) });
    }
    match frames::decode(input, names) {
        Ok(o) => {
            if frames::encode(&o, names).map_err(say)? != input {
                return Err("two frames of one observation".into());
            }
            seen.insert(2000 + log(o.graph.len() as u64) * 40 + log(o.graph.edges().len() as u64));
        }
        // Which complaint, without its numbers.
        Err(e) => {
            let words = e.to_string();
            let hash = words.bytes().filter(u8::is_ascii_alphabetic);
            seen.insert(hash.fold(5, |h: u64, b| h.wrapping_mul(31).wrapping_add(u64::from(b))));
        }
    }
    Ok(Shown { behaviours: seen, found: None })
}

/// Alignment and merge: finite, one-to-one, within the budget, edges alive.
pub(crate) fn align(input: &[u8]) -> Result<Shown, String> {
    let mut r = Reader(input);
    let mut params = Params::default();
    params.robust.structure = vec![LabelId(0), LabelId(1)];
    params.robust.unnamed = Some(LabelId(5));
    params.robust.budget = [20_000_000, 100_000, 50][usize::from(r.byte()) % 3];
    let (reference, graph, looked) = (r.graph(), r.graph(), r.looked());
    let query = Query { looked: looked.as_ref(), ..Query::new(&graph) };
    let index = Index::of(&reference, &params.robust);
    let (outcome, work) = align_counted(&index, &query, &params.robust);
    if work > params.robust.budget {
        return Err(format!("work {work} of {}", params.robust.budget));
    }
    let answer = match &outcome {
        Outcome::Match(m) => {
            let partners: BTreeMap<_, _> = m.pairs.iter().map(|&(q, r)| (r, q)).collect();
            let t = m.reference_from_query.translation.vector;
            if partners.len() != m.pairs.len() || !m.score.is_finite() || !t.iter().all(|v| v.is_finite()) {
                return Err(format!("a match that is none: {m:?}"));
            }
            log(m.pairs.len() as u64) * 8 + log(m.removed.len() as u64)
        }
        Outcome::Ambiguous { candidates } => 100 + log(candidates.len() as u64),
        Outcome::NoMatch { why } => 200 + why.word().len() as u64,
    };
    let merged = update(&reference, &query, &outcome, &params);
    if merged.edges().any(|e| merged.node(e.s).is_none() || merged.node(e.t).is_none()) {
        return Err("an edge without an end".into());
    }
    let behaviours = BTreeSet::from([
        answer,
        300 + log(work),
        400 + log(merged.len() as u64),
        500 + log(merged.edges().len() as u64),
    ]);
    Ok(Shown { behaviours, found: None })
}
