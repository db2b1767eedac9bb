//! The columns of nodes.

use super::bits::{Column, Reader, Signed, Writer, unzigzag, zigzag};
use super::{EVIDENCE, FOOTPRINTS, flags_of, of_cm, of_score, to_cm, to_score};
use crate::footprint::{Grid, YAW_STEPS};
use crate::graph::SCORE_STEPS;
use crate::{Box3, Error, LabelId, Node, NodeId, Vocabulary};

/// Most centimetres of a length.
const FAR: u64 = 100_000_000;

/// Nodes in the order of their ids, with the columns that their flags call for.
pub(super) fn put(w: &mut Writer<'_>, nodes: impl Iterator<Item = Node> + Clone, end_ds: u32) {
    if let Some(first) = nodes.clone().next() {
        w.number(first.id.0);
    }
    w.column(nodes.clone().zip(nodes.clone().skip(1)).map(|(a, b)| b.id.0 - a.id.0 - 1));
    w.column(nodes.clone().map(|n| u64::from(n.label.0)));
    w.column(nodes.clone().map(|n| to_score(n.score)));
    for axis in 0..3 {
        w.signed(nodes.clone().map(|n| to_cm(n.bounds.centroid()[axis])));
    }
    for axis in 0..3 {
        w.column(nodes.clone().map(|n| to_cm(n.bounds.extent()[axis]).unsigned_abs()));
    }
    w.column(nodes.clone().map(|n| u64::from(n.sightings)));
    w.signed(nodes.clone().map(|n| i64::from(end_ds) - (n.last_seen * 10.0).round() as i64));
    let flags = flags_of(nodes.clone());
    if flags & FOOTPRINTS != 0 {
        put_footprints(w, nodes.clone());
    }
    if flags & EVIDENCE != 0 {
        put_evidence(w, nodes);
    }
}

fn put_footprints(w: &mut Writer<'_>, nodes: impl Iterator<Item = Node> + Clone) {
    w.column(nodes.clone().map(|n| u64::from(n.bounds.footprint().is_some())));
    let there = nodes.filter_map(|n| n.bounds.footprint()).map(|f| Grid::of(&f));
    w.column(there.clone().map(|f| f.yaw));
    for k in 0..2 {
        w.column(there.clone().map(|f| f.sides[k]));
        w.column(there.clone().map(|f| zigzag(f.off[k])));
    }
    for k in 0..4 {
        w.column(there.clone().map(|f| f.cuts[k]));
    }
}

fn put_evidence(w: &mut Writer<'_>, nodes: impl Iterator<Item = Node> + Clone) {
    w.column(nodes.clone().map(|n| n.others.len() as u64));
    let all = nodes.clone().flat_map(|n| n.others.iter());
    w.column(all.clone().map(|o| u64::from(o.0.0)));
    w.column(all.map(|o| to_score(o.1)));
    w.column(nodes.map(|n| u64::from(n.misses)));
}

/// Columns that were looked through, read side by side.
pub(super) struct Columns<'a> {
    end: Reader<'a>,
    end_ds: u32,
    id: u64,
    /// Differences less 1; none for the first.
    ids: Column<'a>,
    is_first: bool,
    label: Column<'a>,
    score: Column<'a>,
    centroid: [Signed<'a>; 3],
    extent: [Column<'a>; 3],
    sightings: Column<'a>,
    ago: Signed<'a>,
    footprints: Option<Footprints<'a>>,
    evidence: Option<Evidence<'a>>,
}

struct Footprints<'a> {
    there: Column<'a>,
    yaw: Column<'a>,
    /// Length of a side, and the zigzagged number beside it.
    sides: [[Column<'a>; 2]; 2],
    cuts: [Column<'a>; 4],
}

impl<'a> Footprints<'a> {
    fn read(r: &mut Reader<'a>, n: usize) -> Result<Self, Error> {
        let there = r.column(n, 1)?;
        let f = there.clone().filter(|&t| t == 1).count();
        let yaw = r.column(f, YAW_STEPS as u64)?;
        let mut far = || r.column(f, FAR);
        let sides = [[far()?, far()?], [far()?, far()?]];
        Ok(Self { there, yaw, sides, cuts: [far()?, far()?, far()?, far()?] })
    }

    /// Of the next node that has one; none where a column ends.
    fn next(&mut self) -> Option<Grid> {
        let mut grid = Grid { yaw: self.yaw.next()?, sides: [0; 2], off: [0; 2], cuts: [0; 4] };
        for (k, [side, off]) in self.sides.iter_mut().enumerate() {
            (grid.sides[k], grid.off[k]) = (side.next()?, unzigzag(off.next()?));
        }
        for (cut, column) in grid.cuts.iter_mut().zip(&mut self.cuts) {
            *cut = column.next()?;
        }
        Some(grid)
    }
}

struct Evidence<'a> {
    counts: Column<'a>,
    labels: Column<'a>,
    scores: Column<'a>,
    misses: Column<'a>,
}

impl<'a> Columns<'a> {
    pub(super) fn read(
        r: &mut Reader<'a>,
        n: usize,
        flags: u8,
        end_ds: u32,
        vocabulary: &Vocabulary,
    ) -> Result<Self, Error> {
        let labels = vocabulary.len().0;
        let id = if n > 0 { r.number()? } else { 0 };
        let ids = r.column(n.saturating_sub(1), u64::MAX)?;
        let last = ids.clone().try_fold(id, |id, step| step.checked_add(1)?.checked_add(id));
        if last.is_none() {
            return Err(r.bad("an id beyond 64 bits"));
        }
        let u32s = u64::from(u32::MAX);
        let (label, score) = (r.names(n, labels, "label")?, r.column(n, SCORE_STEPS as u64)?);
        let centroid = [r.signed(n)?, r.signed(n)?, r.signed(n)?];
        let extent = [r.column(n, FAR)?, r.column(n, FAR)?, r.column(n, FAR)?];
        let (sightings, ago) = (r.column(n, u32s)?, r.signed(n)?);
        let footprints = if flags & FOOTPRINTS != 0 { Some(Footprints::read(r, n)?) } else { None };
        let mut evidence = None;
        if flags & EVIDENCE != 0 {
            let counts = r.column(n, Node::MAX_OTHERS as u64)?;
            let all = counts.clone().sum::<u64>() as usize;
            let (labels, scores) = (r.names(all, labels, "label")?, r.column(all, SCORE_STEPS as u64)?);
            evidence = Some(Evidence { counts, labels, scores, misses: r.column(n, u32s)? });
        }
        let (end, is_first) = (*r, true);
        Ok(Self {
            end,
            end_ds,
            id,
            ids,
            is_first,
            label,
            score,
            centroid,
            extent,
            sightings,
            ago,
            footprints,
            evidence,
        })
    }

    /// Which nodes have a footprint.
    pub(super) fn footprints(&self) -> impl Iterator<Item = bool> + use<'a> {
        let there = self.footprints.as_ref().map(|f| f.there.clone());
        there.into_iter().flatten().map(|t| t == 1)
    }

    /// The next node; columns do not end before their number.
    pub(super) fn node(&mut self) -> Result<Node, Error> {
        let end = self.end;
        let early = || end.bad("a column ends early");
        if !std::mem::take(&mut self.is_first) {
            self.id += self.ids.next().ok_or_else(early)? + 1;
        }
        let next = |c: &mut Column<'a>| c.next().ok_or_else(early);
        let (label, score) = (next(&mut self.label)?, next(&mut self.score)?);
        let mut extent = [0.0; 3];
        for (e, column) in extent.iter_mut().zip(&mut self.extent) {
            *e = of_cm(next(column)? as i64);
        }
        let sightings = next(&mut self.sightings)? as u32;
        let signed = |c: &mut Signed<'a>| c.next().ok_or_else(early);
        let mut centroid = [0.0; 3];
        for (c, column) in centroid.iter_mut().zip(&mut self.centroid) {
            *c = of_cm(signed(column)?);
        }
        let ago = signed(&mut self.ago)?;
        let seen = i64::from(self.end_ds).checked_sub(ago).filter(|s| s.unsigned_abs() < 1 << 40);
        let seen = seen.ok_or_else(|| end.bad("last_seen out of range"))?;
        let mut bounds = Box3::new(centroid, extent).map_err(|e| end.bad(e.to_string()))?;
        if let Some(f) = &mut self.footprints
            && next(&mut f.there)? == 1
        {
            let footprint = f.next().ok_or_else(early)?.footprint();
            bounds = bounds.with_footprint(footprint).map_err(|e| end.bad(e.to_string()))?;
        }
        let label = LabelId(label as u16);
        let mut node =
            Node { score: of_score(score), sightings, ..Node::new(NodeId(self.id), label, bounds) };
        node.last_seen = seen as f64 / 10.0;
        if let Some(e) = &mut self.evidence {
            let of = e.labels.by_ref().map(|l| LabelId(l as u16)).zip(e.scores.by_ref().map(of_score));
            node.others = of.take(next(&mut e.counts)? as usize).collect();
            node.misses = next(&mut e.misses)? as u32;
        }
        Ok(node)
    }
}
