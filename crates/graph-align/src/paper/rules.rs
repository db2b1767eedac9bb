//! GRAPHUPDATE's rules (i) to (iii): what a query node is, given a transform.

use super::{NearReading, PaperParams};
use crate::{Node, NodeId, SceneGraph, Verdict};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};

/// (i) centroids nearer than theta_dis, IoU above theta_bbox, equal label: the same object; (ii)
/// the same with another label: relabelled; (iii) everything else is new.
///
/// Several reference nodes may qualify: pairs are taken one-to-one, those of rule (i) first, by
/// falling IoU, then by distance.
#[must_use]
pub fn verdicts(
    reference: &SceneGraph,
    query: &SceneGraph,
    reference_from_query: &Isometry3<f32>,
    params: &PaperParams,
) -> BTreeMap<NodeId, Verdict> {
    let x_of = |n: &Node| n.bounds.centroid().x;
    let mut by_x: Vec<Node> = reference.nodes().collect();
    by_x.sort_by(|a, b| x_of(a).total_cmp(&x_of(b)).then(a.id.cmp(&b.id)));
    let mut pairs = Vec::new();
    for q in query.nodes() {
        let bounds = q.bounds.transformed(reference_from_query);
        let x = bounds.centroid().x;
        let from = by_x.partition_point(|r| x_of(r) < x - params.theta_dis);
        for r in by_x[from..].iter().take_while(|r| x_of(r) <= x + params.theta_dis) {
            let (distance, iou) = (bounds.distance(&r.bounds), bounds.iou(&r.bounds));
            let same_label = q.label == r.label;
            let overlaps =
                iou > params.theta_bbox || (params.near_low_iou == NearReading::Same && same_label);
            if distance < params.theta_dis && overlaps {
                pairs.push((!same_label, -iou, distance, q.id, r.id));
            }
        }
    }
    pairs.sort_by(|a, b| {
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)).then((a.3, a.4).cmp(&(b.3, b.4)))
    });
    let mut out: BTreeMap<NodeId, Verdict> = query.nodes().map(|n| (n.id, Verdict::New)).collect();
    let mut used = BTreeSet::new();
    for (other_label, _, _, q, r) in pairs {
        if out.get(&q) == Some(&Verdict::New) && used.insert(r) {
            out.insert(q, if other_label { Verdict::Relabelled(r) } else { Verdict::Same(r) });
        }
    }
    out
}
