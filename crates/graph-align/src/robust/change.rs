//! What became of every node, given a pose.

use super::Work;
use super::evidence::{Hypothesis, Scene};
use super::index::Item;
use crate::{Box3, Match, NodeId, Query, Verdict};
use std::collections::{BTreeMap, BTreeSet};

/// An object that is still where it was is within this of its place, metres, plus this many times
/// the noise of the pose's pairs.
const AT_REST: (f32, f32) = (0.12, 3.0);
/// Boxes of structure are grown by this before they are compared, metres.
const GROWN: f32 = 0.1;
/// Smallest share of the smaller of two boxes that both have: structure, and objects whose centres
/// are farther apart than noise explains because different parts of them were seen.
const SHARED: (f32, f32) = (0.4, 0.6);
/// Pairs of nodes that are compared: a bound for frames that hold thousands of nodes on one spot, far
/// beyond any furnished place. What is left is new.
const MOST_PAIRS: u64 = 1 << 22;
/// Half of the longest object that is looked for beyond the gate, metres.
const LONGEST: f32 = 10.0;
/// Log-size differences up to which two objects may be one that moved: height, footprint.
const MOVED_SIZE: (f32, f32) = (0.3, 0.35);
/// Farthest move that is looked for, metres.
const FARTHEST: f32 = 6.0;

/// The answer for a hypothesis.
pub(super) fn describe(
    query: &Query<'_>,
    scene: &Scene<'_>,
    h: &Hypothesis<'_>,
    margin: Option<f32>,
) -> Match {
    let mut found = Found {
        verdicts: query.graph.nodes().map(|n| (n.id, Verdict::New)).collect(),
        used: BTreeSet::new(),
    };
    let mut work = Work::new(MOST_PAIRS);
    at_rest(scene, h, &mut found, &mut work);
    structure(query, scene, h, &mut found, &mut work);
    let pairs = found.pairs();
    let gone = looked_at(scene, h, &found.used);
    moved(scene, h, &gone, &mut found, &mut work);
    let left: BTreeMap<NodeId, bool> = gone
        .iter()
        .filter(|g| !found.used.contains(&g.id))
        .map(|g| (g.id, scene.params.structure.contains(&g.label)))
        .collect();
    let of = |structure: bool| left.iter().filter(|l| *l.1 == structure).map(|l| *l.0).collect();
    Match {
        reference_from_query: h.pose,
        pairs,
        score: h.evidence,
        margin,
        verdicts: found.verdicts,
        removed: of(false),
        unmet: of(true),
    }
}

struct Found {
    verdicts: BTreeMap<NodeId, Verdict>,
    used: BTreeSet<NodeId>,
}

impl Found {
    /// Whether the pair is one-to-one with those before it; then it is taken.
    fn take(&mut self, q: NodeId, r: NodeId, verdict: Verdict) {
        if self.verdicts.get(&q) == Some(&Verdict::New) && self.used.insert(r) {
            self.verdicts.insert(q, verdict);
        }
    }

    fn is_new(&self, q: NodeId) -> bool {
        self.verdicts.get(&q) == Some(&Verdict::New)
    }

    fn pairs(&self) -> Vec<(NodeId, NodeId)> {
        let of = |(&q, v): (&NodeId, &Verdict)| match *v {
            Verdict::Same(r) | Verdict::Relabelled(r) => Some((q, r)),
            Verdict::Moved(_) | Verdict::New => None,
        };
        self.verdicts.iter().filter_map(of).collect()
    }
}

/// Objects that stand where they stood, one-to-one: of equal labels first, then of others.
fn at_rest(scene: &Scene<'_>, h: &Hypothesis<'_>, found: &mut Found, work: &mut Work) {
    let gate = (AT_REST.0 + AT_REST.1 * h.sigma).min(0.7);
    let mut pairs = Vec::new();
    for q in scene.query {
        if work.exhausted {
            break;
        }
        let there = q.bounds.transformed(&h.pose);
        let p = there.middle();
        let half = half_longest(&there);
        scene.index.near(&p, gate.max(half), |_, r| {
            if !work.spend(1) {
                return;
            }
            let distance = (p - r.p).norm();
            let same = q.label == r.label;
            let fits = if same {
                let reach = half.min(half_longest(&r.bounds));
                // Two views of different parts of one object differ in size; one that moved does not.
                let parts = distance < reach && !similar(scene, q, r);
                distance < gate || (parts && shared(&there, &r.bounds, 0.0) > SHARED.1)
            } else {
                distance < 0.7 * gate && similar(scene, q, r)
            };
            if fits {
                let evidence = scene.evidence(q, r, &p, h.sigma.max(0.08));
                pairs.push((!same, distance >= gate, -evidence, *q, *r));
            }
        });
    }
    pairs.sort_by(|a, b| {
        (a.0, a.1)
            .cmp(&(b.0, b.1))
            .then(a.2.total_cmp(&b.2))
            .then_with(|| a.3.order(&b.3))
            .then_with(|| a.4.order(&b.4))
    });
    for (other, _, _, q, r) in pairs {
        found.take(q.id, r.id, if other { Verdict::Relabelled(r.id) } else { Verdict::Same(r.id) });
    }
}

fn half_longest(b: &Box3) -> f32 {
    (b.extent().max() / 2.0).min(LONGEST)
}

/// Sizes that two views of one object may have.
fn similar(scene: &Scene<'_>, q: &Item, r: &Item) -> bool {
    !scene.upright || (q.size.height - r.size.height).abs() < 0.35 && (q.size.foot - r.size.foot).abs() < 0.45
}

/// Walls, floors and ceilings by the share of their boxes that both have: a part lies within the
/// whole.
fn structure(query: &Query<'_>, scene: &Scene<'_>, h: &Hypothesis<'_>, found: &mut Found, work: &mut Work) {
    let mut pairs = Vec::new();
    for q in query.graph.nodes().filter(|n| scene.params.structure.contains(&n.label)) {
        if work.exhausted {
            break;
        }
        let there = q.bounds.transformed(&h.pose);
        scene.index.structure_near(&there, 0.0, |_, r| {
            if !work.spend(1) {
                return;
            }
            let share = shared(&there, &r.bounds, GROWN);
            if r.label == q.label && share > SHARED.0 {
                pairs.push((there.distance(&r.bounds) * (1.5 - share), Item::of(&q), *r));
            }
        });
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.order(&b.1)).then_with(|| a.2.order(&b.2)));
    for (_, q, r) in pairs {
        found.take(q.id, r.id, Verdict::Same(r.id));
    }
}

/// Shared volume over that of the smaller box, both grown.
pub(super) fn shared(a: &Box3, b: &Box3, grown: f32) -> f32 {
    let (alo, ahi) = (a.min().coords.add_scalar(-grown), a.max().coords.add_scalar(grown));
    let (blo, bhi) = (b.min().coords.add_scalar(-grown), b.max().coords.add_scalar(grown));
    let both: f32 = (0..3).map(|k| (ahi[k].min(bhi[k]) - alo[k].max(blo[k])).max(0.0)).product();
    let (va, vb): (f32, f32) = ((ahi - alo).product(), (bhi - blo).product());
    both / va.min(vb).max(1e-9)
}

/// Reference objects without a counterpart whose centre the query's robot looked at, by content.
fn looked_at(scene: &Scene<'_>, h: &Hypothesis<'_>, used: &BTreeSet<NodeId>) -> Vec<Item> {
    let Some(looked) = scene.looked else { return Vec::new() };
    let back = h.pose.inverse();
    let (middle, radius) = looked.ball();
    let mut gone = Vec::new();
    let mut check = |_: u32, r: &Item| {
        if !used.contains(&r.id) && looked.contains(&(back * r.p)) {
            gone.push(*r);
        }
    };
    let middle = h.pose * middle;
    scene.index.near(&middle, radius, &mut check);
    scene.index.structure_within(&middle, radius, &mut check);
    gone.sort_by(Item::order);
    gone
}

/// Objects that are gone from one place and turn up at another: same label, same size, the most
/// alike and nearest first.
fn moved(scene: &Scene<'_>, h: &Hypothesis<'_>, gone: &[Item], found: &mut Found, work: &mut Work) {
    let mut pairs = Vec::new();
    for q in scene.query.iter().filter(|q| found.is_new(q.id)) {
        if !work.spend(gone.len() as u64) {
            break;
        }
        let p = h.pose * q.p;
        // Structure is in no pair of equal labels: the query's objects are none.
        for r in gone.iter().filter(|r| r.label == q.label) {
            let (dh, df) = ((q.size.height - r.size.height).abs(), (q.size.foot - r.size.foot).abs());
            let alike = if scene.upright {
                dh < MOVED_SIZE.0 && df < MOVED_SIZE.1
            } else {
                (q.size.all - r.size.all).abs() < 0.5
            };
            let distance = (p - r.p).norm();
            if alike && distance < FARTHEST {
                pairs.push((distance / 2.0 + 2.0 * dh + df, *q, *r));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.order(&b.1)).then_with(|| a.2.order(&b.2)));
    for (_, q, r) in pairs {
        found.take(q.id, r.id, Verdict::Moved(r.id));
    }
}
