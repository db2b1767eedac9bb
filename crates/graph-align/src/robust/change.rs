//! What became of every node, given a pose.

use super::evidence::{Hypothesis, Scene};
use super::index::{Index, Item};
use crate::{Box3, LabelId, Looked, Match, Node, NodeId, Query, SceneGraph, Verdict};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};

/// An object that is still where it was is within this of its place, metres, plus four times the
/// noise of the pose's pairs.
const AT_REST: (f32, f32) = (0.12, 3.0);
/// Boxes of structure are grown by this before they are compared, metres.
const GROWN: f32 = 0.1;
/// Smallest share of the smaller of two boxes of structure that both have.
const SHARED: f32 = 0.4;
/// Log-size differences up to which two objects may be one that moved: height, footprint.
const MOVED_SIZE: (f32, f32) = (0.3, 0.35);
/// Farthest move that is looked for, metres.
const FARTHEST: f32 = 6.0;

/// The answer for a hypothesis.
pub(super) fn describe(
    reference: &SceneGraph,
    query: &Query<'_>,
    scene: &Scene<'_>,
    h: &Hypothesis,
    margin: Option<f32>,
) -> Match {
    let mut verdicts: BTreeMap<NodeId, Verdict> = query.graph.nodes().map(|n| (n.id, Verdict::New)).collect();
    let mut used: BTreeSet<NodeId> = BTreeSet::new();
    at_rest(scene, h, &mut verdicts, &mut used);
    structure(reference, query.graph, &h.pose, &scene.params.structure, &mut verdicts, &mut used);
    let gone = looked_through(scene.index, query.looked, &h.pose, &used);
    let pairs = pairs_of(&verdicts);
    moved(scene, h, &gone, &mut verdicts, &mut used);
    let removed = gone.iter().map(|g| g.id).filter(|id| !used.contains(id)).collect::<BTreeSet<_>>();
    Match {
        reference_from_query: h.pose,
        pairs,
        score: h.evidence,
        margin,
        verdicts,
        removed: removed.into_iter().collect(),
    }
}

fn pairs_of(verdicts: &BTreeMap<NodeId, Verdict>) -> Vec<(NodeId, NodeId)> {
    verdicts
        .iter()
        .filter_map(|(&q, v)| match *v {
            Verdict::Same(r) | Verdict::Relabelled(r) => Some((q, r)),
            Verdict::Moved(_) | Verdict::New => None,
        })
        .collect()
}

/// Objects that stand where they stood, one-to-one: of equal labels first, then of others.
fn at_rest(
    scene: &Scene<'_>,
    h: &Hypothesis,
    verdicts: &mut BTreeMap<NodeId, Verdict>,
    used: &mut BTreeSet<NodeId>,
) {
    let gate = (AT_REST.0 + AT_REST.1 * h.sigma).min(0.7);
    let mut pairs = Vec::new();
    for q in scene.query {
        let p = h.pose * q.p;
        scene.index.near(&p, gate, |_, r| {
            let distance = (p - r.p).norm();
            let same = q.label == r.label;
            let sizes = !scene.upright
                || (q.size.height - r.size.height).abs() < 0.35 && (q.size.foot - r.size.foot).abs() < 0.45;
            if distance < gate && (same || (sizes && distance < 0.7 * gate)) {
                let evidence = scene.evidence(q, r, &p, h.sigma.max(0.08));
                pairs.push((!same, -evidence, *q, *r));
            }
        });
    }
    pairs.sort_by(|a, b| {
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then_with(|| a.2.order(&b.2)).then_with(|| a.3.order(&b.3))
    });
    for (other, _, q, r) in pairs {
        if verdicts.get(&q.id) == Some(&Verdict::New) && used.insert(r.id) {
            verdicts.insert(q.id, if other { Verdict::Relabelled(r.id) } else { Verdict::Same(r.id) });
        }
    }
}

/// Walls, floors and ceilings by the share of their boxes that both have: a part lies within the
/// whole.
fn structure(
    reference: &SceneGraph,
    query: &SceneGraph,
    pose: &Isometry3<f32>,
    labels: &[LabelId],
    verdicts: &mut BTreeMap<NodeId, Verdict>,
    used: &mut BTreeSet<NodeId>,
) {
    if labels.is_empty() {
        return;
    }
    let of = |g: &SceneGraph| -> Vec<Node> { g.nodes().filter(|n| labels.contains(&n.label)).cloned().collect() };
    let (queries, references) = (of(query), of(reference));
    let mut pairs = Vec::new();
    for q in &queries {
        let there = q.bounds.transformed(pose);
        for r in references.iter().filter(|r| r.label == q.label) {
            let share = shared(&there, &r.bounds);
            if share > SHARED {
                pairs.push((there.distance(&r.bounds) * (1.5 - share), q.id, r.id));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    for (_, q, r) in pairs {
        if verdicts.get(&q) == Some(&Verdict::New) && used.insert(r) {
            verdicts.insert(q, Verdict::Same(r));
        }
    }
}

/// Shared volume over that of the smaller box, both grown a little.
fn shared(a: &Box3, b: &Box3) -> f32 {
    let (alo, ahi) = (a.min().coords.add_scalar(-GROWN), a.max().coords.add_scalar(GROWN));
    let (blo, bhi) = (b.min().coords.add_scalar(-GROWN), b.max().coords.add_scalar(GROWN));
    let both: f32 = (0..3).map(|k| (ahi[k].min(bhi[k]) - alo[k].max(blo[k])).max(0.0)).product();
    let (va, vb): (f32, f32) = ((ahi - alo).product(), (bhi - blo).product());
    both / va.min(vb)
}

/// Reference objects without a counterpart whose centre the query's robot looked at, by content.
fn looked_through(
    index: &Index,
    looked: Option<&Looked>,
    pose: &Isometry3<f32>,
    used: &BTreeSet<NodeId>,
) -> Vec<Item> {
    let Some(looked) = looked else { return Vec::new() };
    let back = pose.inverse();
    let seen = |r: &Item| looked.contains(&(back * r.p));
    let mut gone: Vec<Item> =
        index.items().map(|(_, r)| *r).filter(|r| !used.contains(&r.id) && seen(r)).collect();
    gone.sort_by(Item::order);
    gone
}

/// Objects that are gone from one place and turn up at another: same label, same size, the most
/// alike first.
fn moved(
    scene: &Scene<'_>,
    h: &Hypothesis,
    gone: &[Item],
    verdicts: &mut BTreeMap<NodeId, Verdict>,
    used: &mut BTreeSet<NodeId>,
) {
    let mut pairs = Vec::new();
    for q in scene.query.iter().filter(|q| verdicts.get(&q.id) == Some(&Verdict::New)) {
        let p = h.pose * q.p;
        for r in gone.iter().filter(|r| r.label == q.label) {
            let (dh, df) = ((q.size.height - r.size.height).abs(), (q.size.foot - r.size.foot).abs());
            let alike = if scene.upright {
                dh < MOVED_SIZE.0 && df < MOVED_SIZE.1
            } else {
                (q.size.all - r.size.all).abs() < 0.5
            };
            let distance = (p - r.p).norm();
            if alike && distance < FARTHEST {
                let cost = distance / 2.0 + 2.0 * dh + df;
                pairs.push((cost, *q, *r));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.order(&b.1)).then_with(|| a.2.order(&b.2)));
    for (_, q, r) in pairs {
        if verdicts.get(&q.id) == Some(&Verdict::New) && used.insert(r.id) {
            verdicts.insert(q.id, Verdict::Moved(r.id));
        }
    }
}
