//! Floors that a network has to beat: rules on planes and heights, and the commonest answer.

use agent::{NodeInput, NodeSet, Scores};
use graph_align::Box3;
use scan3r::LabelSet;

/// Scores that say one class or predicate.
fn hot(names: &[String], name: &str) -> Vec<f32> {
    let mut v = vec![0.0; names.len()];
    let k = names.iter().position(|n| n == name).unwrap_or(names.len() - 1);
    v[k] = 1.0;
    v
}

/// Every node is a wall, and attached to the neighbour whose centre is nearest: the commonest class
/// and predicate of the training rooms.
#[must_use]
pub fn majority_scores(set: &NodeSet, labels: LabelSet) -> Scores {
    let (classes, predicates) = crate::samples::output_names(labels);
    let distance = |&[i, j]: &[usize; 2]| set.nodes[i].bounds.distance(&set.nodes[j].bounds);
    let nearest: Vec<Option<[usize; 2]>> = (0..set.nodes.len())
        .map(|i| {
            let own = set.edges.iter().filter(|e| e[0] == i);
            own.min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b))).copied()
        })
        .collect();
    let name = |e: &[usize; 2]| if nearest[e[0]] == Some(*e) { "attached to" } else { agent::NONE };
    Scores {
        classes: set.nodes.iter().map(|_| hot(&classes, "wall")).collect(),
        predicates: set.edges.iter().map(|e| hot(&predicates, name(e))).collect(),
    }
}

/// Classes from orientation, height and size; relations from contact. Heights are measured from the
/// lowest node.
#[must_use]
pub fn rule_scores(set: &NodeSet, labels: LabelSet) -> Scores {
    let (classes, predicates) = crate::samples::output_names(labels);
    let ground = set.nodes.iter().map(|n| n.bounds.min().z).fold(f32::INFINITY, f32::min);
    let names: Vec<&str> = set.nodes.iter().map(|n| class_of(n, ground)).collect();
    let relation =
        |&[i, j]: &[usize; 2]| relation_of(&set.nodes[i].bounds, names[i], &set.nodes[j].bounds, names[j]);
    Scores {
        classes: names.iter().map(|n| hot(&classes, n)).collect(),
        predicates: set.edges.iter().map(|e| hot(&predicates, relation(e))).collect(),
    }
}

fn class_of(n: &NodeInput, ground: f32) -> &'static str {
    let e = n.bounds.extent();
    let (top, bottom) = (n.bounds.max().z - ground, n.bounds.min().z - ground);
    // Share of points that face up, and that face sideways.
    let of = |f: &dyn Fn(f32) -> bool| {
        n.points.iter().filter(|(_, m)| f(m.z)).count() as f32 / n.points.len().max(1) as f32
    };
    let (level, upright) = (of(&|z| z.abs() > 0.9), of(&|z| z.abs() < 0.3));
    let long = e.x.max(e.y);
    if level > 0.7 {
        return match top {
            t if t < 0.2 => "floor",
            t if (0.35..0.6).contains(&t) && long < 0.8 => "chair",
            t if (0.35..0.65).contains(&t) && long > 1.4 => "bed",
            t if (0.35..0.9).contains(&t) && long > 0.5 => "table",
            t if (0.9..1.2).contains(&t) => "counter",
            _ => agent::NONE,
        };
    }
    if upright > 0.7 {
        return match (long, e.z) {
            (l, h) if l > 1.2 && h > 0.8 => "wall",
            (l, h) if (0.5..1.2).contains(&l) && h > 1.5 => "door",
            (l, _) if bottom > 0.7 && l > 0.5 => "window",
            (l, _) if bottom > 0.9 && l > 0.15 => "picture",
            (l, h) if l > 0.4 && h > 0.4 => "cabinet",
            _ => agent::NONE,
        };
    }
    match (long, top) {
        (l, t) if l > 1.2 && t < 1.1 => "sofa",
        (l, t) if (0.35..0.9).contains(&l) && (0.6..1.2).contains(&t) => "chair",
        _ => agent::NONE,
    }
}

fn relation_of(a: &Box3, class: &str, b: &Box3, other: &str) -> &'static str {
    let overlap = |k: usize| a.max()[k].min(b.max()[k]) - a.min()[k].max(b.min()[k]);
    let over = overlap(0) > 0.0 && overlap(1) > 0.0;
    let near = overlap(0) > -0.1 && overlap(1) > -0.1 && overlap(2) > 0.0;
    match (class, other) {
        (x, y) if x == y => agent::NONE,
        ("wall", "floor") => "attached to",
        ("door" | "window", "wall") if near => "attached to",
        ("picture" | "curtain", "wall") if near => "hanging on",
        (x, "floor") if x != "wall" && over && (a.min().z - b.max().z).abs() < 0.25 => "standing on",
        (x, _) if x != "wall" && x != "floor" && over && (a.min().z - b.max().z).abs() < 0.06 => {
            "standing on"
        }
        _ => agent::NONE,
    }
}
