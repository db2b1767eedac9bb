//! The columns of edges.

use super::bits::{Column, Reader, Signed, Writer};
use super::{of_score, to_score};
use crate::graph::SCORE_STEPS;
use crate::{Edge, Error, PredicateId, SceneGraph, Vocabulary};

/// Edges in the order (subject, object, predicate), their ends as places in the graph's list of nodes.
pub(super) fn put(w: &mut Writer<'_>, graph: &SceneGraph, edges: impl Iterator<Item = Edge> + Clone) {
    let place = graph.places();
    // An edge's ends are nodes of the graph, so they always have a place.
    let place = |id| place(id).unwrap_or(0);
    let mut last = 0;
    let place = &place;
    w.column(edges.clone().map(move |e| {
        let s = place(e.s);
        (s - std::mem::replace(&mut last, s)) as u64
    }));
    w.signed(edges.clone().map(|e| place(e.t) as i64 - place(e.s) as i64));
    w.column(edges.clone().map(|e| u64::from(e.p.0)));
    w.column(edges.map(|e| to_score(e.score)));
}

/// Columns that were looked through, read side by side.
pub(super) struct Columns<'a> {
    steps: Column<'a>,
    to: Signed<'a>,
    p: Column<'a>,
    score: Column<'a>,
}

impl<'a> Columns<'a> {
    /// Edges between `n` nodes, in their order, each once.
    pub(super) fn read(r: &mut Reader<'a>, m: usize, n: usize, v: &Vocabulary) -> Result<Self, Error> {
        let (steps, to) = (r.column(m, n as u64)?, r.signed(m)?);
        let (p, score) = (r.names(m, v.len().1, "predicate")?, r.column(m, SCORE_STEPS as u64)?);
        let columns = Self { steps, to, p, score };
        let mut last = None;
        for ([s, t], p, _) in columns.edges() {
            if s.max(t) >= n {
                return Err(r.bad(format!("an edge between places {s} and {t} of {n}")));
            }
            if s == t {
                return Err(r.bad(format!("an edge from place {s} to itself")));
            }
            if last.replace((s, t, p)).is_some_and(|l| l >= (s, t, p)) {
                return Err(r.bad("edges not rising"));
            }
        }
        Ok(columns)
    }

    /// Places of subject and object, predicate and score. A place before the first is a very large one.
    pub(super) fn edges(&self) -> impl Iterator<Item = ([usize; 2], PredicateId, f32)> + Clone + use<'a> {
        let mut s = 0;
        let columns = self.steps.clone().zip(self.to.clone()).zip(self.p.clone().zip(self.score.clone()));
        columns.map(move |((step, to), (p, score))| {
            s += step as usize;
            let t = (s as i64).checked_add(to).and_then(|t| usize::try_from(t).ok());
            ([s, t.unwrap_or(usize::MAX)], PredicateId(p as u16), of_score(score))
        })
    }
}
