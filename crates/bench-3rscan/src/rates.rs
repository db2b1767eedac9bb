//! Counts and rates of a graph against the truth (BENCH.md section 3).

use crate::correspond::{Limit, correspond, on_clutter};
use crate::layout::{Placement, nearest_room};
use crate::truth::Truth;
use graph_align::{NodeId, PredicateId, SceneGraph};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// True and false positives, false negatives, and what follows from them, in percent. A rate whose
/// denominator is 0 is null.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// True positives.
    pub tp: usize,
    /// False positives.
    pub fp: usize,
    /// False negatives.
    pub fn_: usize,
}

/// As written to a report.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rates {
    /// True positives.
    pub tp: usize,
    /// False positives.
    pub fp: usize,
    /// False negatives.
    #[serde(rename = "fn")]
    pub fn_: usize,
    /// Recall, percent.
    pub r: Option<f64>,
    /// Precision, percent.
    pub p: Option<f64>,
    /// Harmonic mean of both, percent.
    pub f1: Option<f64>,
}

impl Counts {
    /// Rates of these counts.
    #[must_use]
    pub fn rates(&self) -> Rates {
        let share = |of: usize| (of > 0).then(|| 100.0 * self.tp as f64 / of as f64);
        let (r, p) = (share(self.tp + self.fn_), share(self.tp + self.fp));
        let f1 = match (r, p) {
            (Some(r), Some(p)) if r + p > 0.0 => Some(2.0 * r * p / (r + p)),
            (Some(_), Some(_)) => Some(0.0),
            _ => None,
        };
        Rates { tp: self.tp, fp: self.fp, fn_: self.fn_, r, p, f1 }
    }

    fn add(&mut self, o: &Self) {
        self.tp += o.tp;
        self.fp += o.fp;
        self.fn_ += o.fn_;
    }
}

/// Objects, predicates and triplets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Three {
    /// Nodes.
    pub object: Counts,
    /// Edges between corresponding ends.
    pub predicate: Counts,
    /// Edges whose ends have the right classes too.
    pub triplet: Counts,
}

/// Everything that one graph is measured by.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// IoU above 0: the main rates.
    pub main: Three,
    /// Per room; sums exactly to `main`.
    pub per_room: Vec<Three>,
    /// IoU above 0.25 and 0.5.
    pub iou: [Three; 2],
    /// The centre distance alone.
    pub centre: Three,
    /// Object precision without predictions on clutter, percent.
    pub p_ignore_clutter: Option<f64>,
    /// Mean recall over the classes that occur, percent.
    pub class_mean_object: Option<f64>,
    /// Mean recall over the predicates that occur, percent.
    pub class_mean_predicate: Option<f64>,
    /// (label, true positives, true nodes) per class that occurs.
    pub per_class: Vec<(graph_align::LabelId, usize, usize)>,
    /// (predicate, true positives, true edges) per predicate that occurs.
    pub per_predicate: Vec<(PredicateId, usize, usize)>,
}

/// Measures a graph in the domain frame.
#[must_use]
pub fn measure(truth: &Truth, graph: &SceneGraph, placements: &[Placement]) -> Measured {
    let run = |limit| Judged::new(truth, graph, &correspond(truth, graph, limit));
    let judged = run(Limit::Iou(0.0));
    let per_room = judged.per_room(truth, graph, placements);
    let mut main = Three::default();
    for r in &per_room {
        main.object.add(&r.object);
        main.predicate.add(&r.predicate);
        main.triplet.add(&r.triplet);
    }
    let clutter = on_clutter(truth, graph);
    let wrong =
        graph.nodes().filter(|n| !judged.right.contains_key(&n.id) && !clutter.contains(&n.id)).count();
    let total = |limit| run(limit).total(truth, graph);
    let per_class = judged.per_class(truth);
    let per_predicate = judged.per_predicate(truth);
    let mean = |v: Vec<(usize, usize)>| {
        let n = v.len();
        (n > 0).then(|| v.iter().map(|(hit, of)| 100.0 * *hit as f64 / *of as f64).sum::<f64>() / n as f64)
    };
    Measured {
        p_ignore_clutter: Counts { tp: judged.right.len(), fp: wrong, fn_: 0 }.rates().p,
        class_mean_object: mean(per_class.iter().map(|c| (c.1, c.2)).collect()),
        class_mean_predicate: mean(per_predicate.iter().map(|c| (c.1, c.2)).collect()),
        iou: [total(Limit::Iou(0.25)), total(Limit::Iou(0.5))],
        centre: total(Limit::Centre),
        per_class,
        per_predicate,
        main,
        per_room,
    }
}

type EdgeKey = (NodeId, NodeId, PredicateId);

/// A graph after correspondence.
struct Judged {
    /// Predicted nodes of the right class -> index of the true node.
    right: BTreeMap<NodeId, usize>,
    /// Predicted edges that are true -> the true edge.
    edges: BTreeMap<EdgeKey, (u64, u64, PredicateId)>,
    /// Those of them whose ends have the right class.
    triplets: BTreeSet<EdgeKey>,
}

impl Judged {
    fn new(truth: &Truth, graph: &SceneGraph, to: &BTreeMap<NodeId, usize>) -> Self {
        let right: BTreeMap<_, _> = to
            .iter()
            .filter(|(p, k)| graph.node(**p).map(|n| n.label) == truth.nodes[**k].label)
            .map(|(&p, &k)| (p, k))
            .collect();
        let mut edges = BTreeMap::new();
        for e in graph.edges() {
            let (Some(&s), Some(&t)) = (to.get(&e.s), to.get(&e.t)) else { continue };
            let key = (truth.nodes[s].id, truth.nodes[t].id, e.p);
            if truth.edges.binary_search(&key).is_ok() {
                edges.insert((e.s, e.t, e.p), key);
            }
        }
        let both = |(s, t, _): &EdgeKey| right.contains_key(s) && right.contains_key(t);
        let triplets = edges.keys().filter(|k| both(k)).copied().collect();
        Self { right, edges, triplets }
    }

    fn total(&self, truth: &Truth, graph: &SceneGraph) -> Three {
        let of = |tp, predicted: usize, there: usize| Counts { tp, fp: predicted - tp, fn_: there - tp };
        Three {
            object: of(self.right.len(), graph.len(), truth.counts.nodes),
            predicate: of(self.edges.len(), graph.edges().len(), truth.edges.len()),
            triplet: of(self.triplets.len(), graph.edges().len(), truth.edges.len()),
        }
    }

    /// A true positive and a miss belong to the true node's room, a false positive to the room that
    /// is nearest to it; edges go with their subject.
    fn per_room(&self, truth: &Truth, graph: &SceneGraph, placements: &[Placement]) -> Vec<Three> {
        let mut rooms = vec![Three::default(); placements.len()];
        let room_of_true =
            |id: u64| truth.nodes.binary_search_by_key(&id, |n| n.id).map_or(0, |k| truth.nodes[k].room);
        let room_of =
            |id: NodeId| graph.node(id).map_or(0, |n| nearest_room(placements, &n.bounds.centroid()));
        for n in graph.nodes() {
            match self.right.get(&n.id) {
                Some(&k) => rooms[truth.nodes[k].room].object.tp += 1,
                None => rooms[room_of(n.id)].object.fp += 1,
            }
        }
        for e in graph.edges() {
            let key = (e.s, e.t, e.p);
            match self.edges.get(&key) {
                Some(t) => rooms[room_of_true(t.0)].predicate.tp += 1,
                None => rooms[room_of(e.s)].predicate.fp += 1,
            }
            match self.edges.get(&key).filter(|_| self.triplets.contains(&key)) {
                Some(t) => rooms[room_of_true(t.0)].triplet.tp += 1,
                None => rooms[room_of(e.s)].triplet.fp += 1,
            }
        }
        let mut there = vec![(0, 0); placements.len()];
        truth.nodes.iter().filter(|n| !n.ignore).for_each(|n| there[n.room].0 += 1);
        truth.edges.iter().for_each(|e| there[room_of_true(e.0)].1 += 1);
        for (r, (nodes, edges)) in rooms.iter_mut().zip(there) {
            r.object.fn_ = nodes - r.object.tp;
            r.predicate.fn_ = edges - r.predicate.tp;
            r.triplet.fn_ = edges - r.triplet.tp;
        }
        rooms
    }

    fn per_class(&self, truth: &Truth) -> Vec<(graph_align::LabelId, usize, usize)> {
        let mut of: BTreeMap<_, (usize, usize)> = BTreeMap::new();
        for l in truth.nodes.iter().filter(|n| !n.ignore).filter_map(|n| n.label) {
            of.entry(l).or_default().1 += 1;
        }
        for l in self.right.values().filter_map(|&k| truth.nodes[k].label) {
            of.entry(l).or_default().0 += 1;
        }
        of.into_iter().map(|(l, (hit, n))| (l, hit, n)).collect()
    }

    fn per_predicate(&self, truth: &Truth) -> Vec<(PredicateId, usize, usize)> {
        let mut of: BTreeMap<_, (usize, usize)> = BTreeMap::new();
        truth.edges.iter().for_each(|e| of.entry(e.2).or_default().1 += 1);
        self.edges.values().for_each(|e| of.entry(e.2).or_default().0 += 1);
        of.into_iter().map(|(p, (hit, n))| (p, hit, n)).collect()
    }
}
