//! What the merged graph should be (BENCH.md section 2).

use crate::Error;
use crate::layout::{self, Placement};
use crate::scenario::Scenario;
use crate::surface::Seen;
use graph_align::{Box3, LabelId, PredicateId, Vocabulary};
use nalgebra::{Isometry3, Point3};
use scan3r::{Annotation, Dataset, LabelSet, RoomEntry};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// An instance counts from this many depth samples.
const MIN_SAMPLES: u64 = 100;
/// An extent that differs by more than this share is a change of shape.
const CHANGED_EXTENT: f32 = 0.2;

/// One object that is there at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthNode {
    /// Unique in the domain: room and instance.
    pub id: u64,
    /// Room index.
    pub room: usize,
    /// Class; `None` for clutter outside the label set.
    pub label: Option<LabelId>,
    /// Raw label.
    pub raw: String,
    /// Box of the seen surface, domain frame.
    pub bounds: Box3,
    /// Not to be counted: clutter, or seen too little.
    pub ignore: bool,
}

/// Numbers of a truth graph, for the report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TruthCounts {
    /// Counted objects.
    pub nodes: usize,
    /// Counted relations.
    pub edges: usize,
    /// Objects of the reference scans that stayed as they were.
    #[serde(rename = "static")]
    pub unchanged: usize,
    /// Moved as rigid bodies.
    pub moved: usize,
    /// Gone.
    pub removed: usize,
    /// Of another shape or label.
    pub changed: usize,
    /// In no reference scan.
    pub added: usize,
    /// Of a class in the set, but hit by fewer than 100 depth samples.
    pub left_out: usize,
}

/// Objects and relations, and how many of what.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// In the order of their ids.
    pub nodes: Vec<TruthNode>,
    /// (subject, object, predicate), sorted, between counted nodes.
    pub edges: Vec<(u64, u64, PredicateId)>,
    /// Numbers.
    pub counts: TruthCounts,
}

/// Which truth a run is scored against (BENCH.md section 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reading {
    /// Every instance that was ever annotated, where it was last, without those that were removed.
    #[default]
    Accumulated,
    /// The instances of each room's last scan.
    LastScan,
    /// The instances of each room's reference scan, as they stood there, without those that were removed.
    ReferenceMinusRemoved,
}

impl Reading {
    /// All readings.
    pub const ALL: [Self; 3] = [Self::Accumulated, Self::LastScan, Self::ReferenceMinusRemoved];

    /// As in flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Accumulated => "accumulated",
            Self::LastScan => "last-scan",
            Self::ReferenceMinusRemoved => "reference-minus-removed",
        }
    }

    /// The reading of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|r| r.name() == name)
    }
}

/// A room as it was during one round: what there is to be matched, and where each object's middle was and its
/// motion since the reference scan, domain frame.
#[derive(Clone, Debug)]
pub struct State {
    /// Nodes alone.
    pub truth: Truth,
    /// By id, of nodes that count.
    pub objects: BTreeMap<u64, (Point3<f32>, Isometry3<f32>)>,
    /// All that is in the room, seen well or not.
    pub there: BTreeSet<u64>,
}

/// What the visits saw of each scan.
pub type SeenScans = BTreeMap<String, Seen>;

/// One instance over the scans of its room.
struct History {
    raw: String,
    /// Rounds of the scans in which it is annotated, rising.
    rounds: Vec<usize>,
    first: usize,
    samples: u64,
    bounds: Option<Box3>,
    moved: bool,
    changed: bool,
    /// Motion since the reference scan, reference frame.
    pose: Isometry3<f32>,
    /// Of the whole annotated surface in the reference frame, scan by scan.
    extents: Vec<nalgebra::Vector3<f32>>,
}

/// Builds the truth of a scenario.
///
/// # Errors
/// Unreadable scans, transforms that are no rigid motions.
pub fn build(
    data: &dyn Dataset,
    placements: &[Placement],
    seen: &SeenScans,
    scenario: Scenario,
    reading: Reading,
    labels: LabelSet,
    vocabulary: &Vocabulary,
) -> Result<Truth, Error> {
    let mut truth = Truth { nodes: Vec::new(), edges: Vec::new(), counts: TruthCounts::default() };
    for (room, placement) in placements.iter().enumerate() {
        let entry = &data.rooms()[room];
        let rounds = if scenario == Scenario::Scp { 0 } else { entry.scans.len() };
        let part = RoomTruth { data, entry, placement, seen, rounds, reading };
        let (history, gone) = part.histories(|_, _, _| ())?;
        let mut kept = BTreeSet::new();
        for (&instance, h) in &history {
            if gone.contains(&instance) {
                let was_seen = h.samples >= MIN_SAMPLES && labels.class_of(&h.raw).is_some();
                truth.counts.removed += usize::from(was_seen);
                continue;
            }
            let label = labels.class_of(&h.raw).and_then(|c| vocabulary.find_label(c));
            let counts = h.samples >= MIN_SAMPLES;
            truth.counts.left_out += usize::from(label.is_some() && !counts);
            let Some(bounds) = h.bounds else { continue };
            let ignore = label.is_none() || !counts;
            if !ignore {
                kept.insert(instance);
                tally(&mut truth.counts, h);
            }
            let id = node_id(room, instance);
            truth.nodes.push(TruthNode { id, room, label, raw: h.raw.clone(), bounds, ignore });
        }
        let relations = part.relations(&history)?;
        truth.edges.extend(
            relations
                .into_iter()
                .filter_map(|((s, t), names)| {
                    let both = kept.contains(&s) && kept.contains(&t);
                    both.then_some(()).and_then(|()| scored(&names, labels, vocabulary)).map(|ps| {
                        ps.into_iter()
                            .map(move |p| (node_id(room, s), node_id(room, t), p))
                            .collect::<Vec<_>>()
                    })
                })
                .flatten(),
        );
    }
    truth.edges.sort_unstable();
    truth.edges.dedup();
    truth.counts.nodes = truth.nodes.iter().filter(|n| !n.ignore).count();
    truth.counts.edges = truth.edges.len();
    Ok(truth)
}

/// Each room of the scenario during each of its rounds; rounds that nobody visited are as the one before.
///
/// # Errors
/// As [`build`].
pub fn states(
    data: &dyn Dataset,
    placements: &[Placement],
    seen: &SeenScans,
    labels: LabelSet,
    vocabulary: &Vocabulary,
) -> Result<Vec<Vec<State>>, Error> {
    let mut out = Vec::with_capacity(placements.len());
    for (room, placement) in placements.iter().enumerate() {
        let entry = &data.rooms()[room];
        let rounds = entry.scans.len();
        let part = RoomTruth { data, entry, placement, seen, rounds, reading: Reading::Accumulated };
        let mut list: Vec<State> = Vec::with_capacity(rounds + 1);
        part.histories(|round, all, gone| {
            while list.len() < round {
                list.push(list.last().cloned().unwrap_or_else(State::nothing));
            }
            list.push(State::of(room, placement, all, gone, labels, vocabulary));
        })?;
        while list.len() <= rounds {
            list.push(list.last().cloned().unwrap_or_else(State::nothing));
        }
        out.push(list);
    }
    Ok(out)
}

impl State {
    fn nothing() -> Self {
        let truth = Truth { nodes: Vec::new(), edges: Vec::new(), counts: TruthCounts::default() };
        Self { truth, objects: BTreeMap::new(), there: BTreeSet::new() }
    }

    fn of(
        room: usize,
        placement: &Placement,
        all: &BTreeMap<u32, History>,
        gone: &BTreeSet<u32>,
        labels: LabelSet,
        vocabulary: &Vocabulary,
    ) -> Self {
        let mut out = Self::nothing();
        let domain = placement.domain_from_reference;
        for (&instance, h) in all.iter().filter(|(i, _)| !gone.contains(i)) {
            out.there.insert(node_id(room, instance));
            let label = labels.class_of(&h.raw).and_then(|c| vocabulary.find_label(c));
            let (Some(bounds), true, true) = (h.bounds, label.is_some(), h.samples >= MIN_SAMPLES) else {
                continue;
            };
            let id = node_id(room, instance);
            out.objects.insert(id, (bounds.centroid(), domain * h.pose * domain.inverse()));
            out.truth.nodes.push(TruthNode { id, room, label, raw: h.raw.clone(), bounds, ignore: false });
        }
        out
    }
}

fn node_id(room: usize, instance: u32) -> u64 {
    room as u64 * 1_000_000 + u64::from(instance)
}

fn tally(c: &mut TruthCounts, h: &History) {
    if h.first > 0 {
        c.added += 1;
    } else if h.moved {
        c.moved += 1;
    } else if h.changed {
        c.changed += 1;
    } else {
        c.unchanged += 1;
    }
}

/// l20 counts one predicate per ordered pair: the first in the list's order. l160 counts all.
fn scored(names: &BTreeSet<String>, labels: LabelSet, v: &Vocabulary) -> Option<Vec<PredicateId>> {
    let hits = labels.predicates().iter().filter(|p| names.contains(**p)).filter_map(|p| v.find_predicate(p));
    let all: Vec<PredicateId> = match labels {
        LabelSet::L20 => hits.take(1).collect(),
        LabelSet::L160 => hits.collect(),
    };
    (!all.is_empty()).then_some(all)
}

struct RoomTruth<'a> {
    data: &'a dyn Dataset,
    entry: &'a RoomEntry,
    placement: &'a Placement,
    seen: &'a SeenScans,
    rounds: usize,
    reading: Reading,
}

/// Depth samples, points in the reference frame, and the pose that the instance had then.
type LastSeen = (u64, Vec<Point3<f32>>, Isometry3<f32>);
type Pairs = BTreeMap<(u32, u32), BTreeSet<String>>;

impl RoomTruth<'_> {
    fn scan(&self, round: usize) -> &str {
        if round == 0 { &self.entry.reference } else { &self.entry.scans[round - 1].id }
    }

    /// Every annotated instance, and those that are gone at the end; `after` hears of both after each visited
    /// round.
    fn histories(
        &self,
        mut after: impl FnMut(usize, &BTreeMap<u32, History>, &BTreeSet<u32>),
    ) -> Result<(BTreeMap<u32, History>, BTreeSet<u32>), Error> {
        let mut all: BTreeMap<u32, History> = BTreeMap::new();
        let mut gone = BTreeSet::new();
        // Points of an instance as last seen well, in the reference frame, with its pose then.
        let mut last_seen: BTreeMap<u32, LastSeen> = BTreeMap::new();
        for round in 0..=self.rounds {
            let Some(seen) = self.seen.get(self.scan(round)) else { continue };
            let annotation = self.data.annotation(self.scan(round))?;
            let reference_from_scan = reference_from(self.entry, round)?;
            let points = seen.seen_points(&annotation);
            let whole = annotated_extents(&annotation, &reference_from_scan);
            if round > 0 {
                gone.extend(self.entry.scans[round - 1].removed.iter().flatten());
            }
            for (&id, raw) in &annotation.labels {
                gone.remove(&id);
                if round > 0 && self.reading == Reading::ReferenceMinusRemoved {
                    continue;
                }
                let pose = self.instance_pose(round, id)?;
                let samples = seen.samples(id);
                if let Some(p) = points.get(&id) {
                    let in_reference: Vec<_> = p.iter().map(|p| reference_from_scan * p).collect();
                    let better = last_seen.get(&id).is_none_or(|l| samples >= MIN_SAMPLES || samples >= l.0);
                    if better {
                        last_seen.insert(id, (samples, in_reference, pose));
                    }
                }
                let h = all.entry(id).or_insert_with(|| History {
                    raw: raw.clone(),
                    rounds: Vec::new(),
                    first: round,
                    samples: 0,
                    bounds: None,
                    moved: false,
                    changed: false,
                    pose,
                    extents: Vec::new(),
                });
                h.changed |= h.raw != *raw || self.nonrigid(round, id);
                h.moved |= round > 0
                    && self.entry.scans[round - 1].rigid.moves().iter().any(|m| m.instance_reference == id);
                h.raw.clone_from(raw);
                h.pose = pose;
                h.rounds.push(round);
                h.samples += samples;
                h.extents.extend(whole.get(&id).copied());
                if let Some((_, points, then)) = last_seen.get(&id) {
                    // Seen earlier, annotated now at another pose: the points move along.
                    let carry = pose * then.inverse();
                    let t = self.placement.domain_from_reference * carry;
                    if let Some((lo, hi)) = layout::bounds(points.iter().map(|p| t * p)) {
                        h.bounds =
                            Some(Box3::new(nalgebra::center(&lo, &hi).coords.into(), (hi - lo).into())?);
                    }
                }
            }
            if self.reading == Reading::LastScan {
                all.retain(|id, _| annotation.labels.contains_key(id));
            }
            after(round, &all, &gone);
        }
        for h in all.values_mut() {
            h.changed |= !h.moved && extents_differ(&h.extents);
        }
        Ok((all, gone))
    }

    fn nonrigid(&self, round: usize, id: u32) -> bool {
        round > 0 && self.entry.scans[round - 1].nonrigid.iter().flatten().any(|&n| n == id)
    }

    /// The instance's motion since the reference scan, in the reference frame:
    /// `T_reference_rescan * rigid`.
    fn instance_pose(&self, round: usize, id: u32) -> Result<Isometry3<f32>, Error> {
        if round == 0 {
            return Ok(Isometry3::identity());
        }
        let scan = &self.entry.scans[round - 1];
        let Some(m) = scan.rigid.moves().iter().find(|m| m.instance_reference == id) else {
            return Ok(Isometry3::identity());
        };
        let rigid: Isometry3<f32> = m.transform.isometry(Path::new("3RScan.json"), "rigid.transform")?.cast();
        Ok(reference_from(self.entry, round)? * rigid)
    }

    /// The relations of the latest scan in which both ends are annotated.
    fn relations(&self, history: &BTreeMap<u32, History>) -> Result<Pairs, Error> {
        let mut latest: BTreeMap<(u32, u32), (usize, BTreeSet<String>)> = BTreeMap::new();
        let last = if self.reading == Reading::ReferenceMinusRemoved { 0 } else { self.rounds };
        for round in 0..=last {
            if !self.seen.contains_key(self.scan(round)) {
                continue;
            }
            for r in self.data.relations(self.scan(round))? {
                let e = latest.entry((r.subject, r.object)).or_insert((round, BTreeSet::new()));
                if e.0 < round {
                    *e = (round, BTreeSet::new());
                }
                e.1.insert(r.predicate);
            }
        }
        // A later scan that shows both ends without this relation ends it.
        latest.retain(|(s, t), (round, _)| match (history.get(s), history.get(t)) {
            (Some(a), Some(b)) => !a.rounds.iter().any(|r| r > round && b.rounds.contains(r)),
            _ => false,
        });
        Ok(latest.into_iter().map(|(k, (_, names))| (k, names)).collect())
    }
}

/// Extents of the whole annotated surface of each instance, in the reference frame.
fn annotated_extents(a: &Annotation, t: &Isometry3<f32>) -> BTreeMap<u32, nalgebra::Vector3<f32>> {
    let mut corners: BTreeMap<u32, (Point3<f32>, Point3<f32>)> = BTreeMap::new();
    for (p, &i) in a.points.iter().zip(&a.instances).filter(|(_, i)| **i != 0) {
        let p = t * p;
        corners.entry(i).and_modify(|(lo, hi)| (*lo, *hi) = (lo.inf(&p), hi.sup(&p))).or_insert((p, p));
    }
    corners.into_iter().map(|(i, (lo, hi))| (i, hi - lo)).collect()
}

/// True when an extent of two scans differs by more than 20 % (and by more than 10 cm).
fn extents_differ(extents: &[nalgebra::Vector3<f32>]) -> bool {
    let Some(first) = extents.first() else { return false };
    extents.iter().any(|e| {
        (0..3).any(|k| {
            (e[k] - first[k]).abs() > CHANGED_EXTENT * first[k].max(e[k]) && (e[k] - first[k]).abs() > 0.1
        })
    })
}

/// `T_reference_scan` of a round; the identity for the reference itself.
///
/// # Errors
/// A rescan without a transform, or one that is no rigid motion.
pub fn reference_from(entry: &RoomEntry, round: usize) -> Result<Isometry3<f32>, Error> {
    if round == 0 {
        return Ok(Isometry3::identity());
    }
    let scan = &entry.scans[round - 1];
    let t = scan.transform.ok_or_else(|| {
        Error::Pipeline(format!("3RScan.json: rescan {} has no transform (a hidden test room?)", scan.id))
    })?;
    Ok(t.isometry(Path::new("3RScan.json"), &format!("transform of {}", scan.id))?.cast())
}
