//! Scored objects to the scene graph of a visit.

use crate::{Error, NONE, Objects, SAME_PART};
use graph_align::{Edge, Node, NodeId, Others, SceneGraph, Vocabulary};

/// How scores become nodes and edges.
#[derive(Clone, Debug, PartialEq)]
pub struct GraphParams {
    /// A node needs at least this probability of its class.
    pub min_class: f32,
    /// An edge needs at least this probability of its predicate.
    pub min_predicate: f32,
    /// Likeness from which segments are joined ([`Objects::join`]).
    pub min_same_part: f32,
    /// Weight of the network's second look, at objects in place of segments ([`Objects::look_again`]).
    pub second_look: f32,
    /// Every predicate above `min_predicate` counts, not the best alone (l160).
    pub multi: bool,
    /// Objects outside the label set (class [`NONE`]) and those below `min_class` are kept: landmarks
    /// for alignment. Relations of [`NONE`] are not.
    pub unnamed: bool,
    /// Id of the first node; the others follow.
    pub first_id: u64,
    /// When the graph was made, seconds.
    pub time: f64,
}

impl Default for GraphParams {
    fn default() -> Self {
        Self {
            min_class: 0.0,
            min_predicate: 0.0,
            min_same_part: 0.5,
            second_look: 0.0,
            multi: false,
            unnamed: false,
            first_id: 0,
            time: 0.0,
        }
    }
}

/// The graph of a visit: a node for each object whose class is not [`NONE`], and the node of each
/// segment.
///
/// # Errors
/// A vocabulary that is full, objects whose boxes are none.
pub fn build_graph(
    objects: &Objects,
    class_names: &[String],
    predicate_names: &[String],
    vocabulary: &mut Vocabulary,
    p: &GraphParams,
) -> Result<(SceneGraph, Vec<Option<NodeId>>), Error> {
    let mut graph = SceneGraph::default();
    let mut node_of = vec![None; objects.set.nodes.len()];
    for (k, (object, classes)) in objects.set.nodes.iter().zip(&objects.scores.classes).enumerate() {
        let (class, score) = argmax(classes);
        let Some(name) = class_names.get(class).filter(|n| p.unnamed || *n != NONE) else { continue };
        if score < p.min_class && !p.unnamed {
            continue;
        }
        let id = NodeId(p.first_id + graph.len() as u64);
        node_of[k] = Some(id);
        graph.insert_node(Node {
            id,
            label: vocabulary.label(name)?,
            score,
            bounds: object.bounds,
            others: others(classes, class, class_names, vocabulary, p.unnamed)?,
            sightings: 1,
            misses: 0,
            last_seen: p.time,
        });
    }
    add_edges(&mut graph, objects, predicate_names, &node_of, vocabulary, p)?;
    Ok((graph, objects.of.iter().map(|&k| node_of[k]).collect()))
}

/// The classes after the best one, falling; [`NONE`] is no class unless the unnamed are kept.
fn others(
    mean: &[f32],
    best: usize,
    names: &[String],
    vocabulary: &mut Vocabulary,
    unnamed: bool,
) -> Result<Others, Error> {
    let mut order: Vec<usize> =
        (0..mean.len().min(names.len())).filter(|&k| k != best && (unnamed || names[k] != NONE)).collect();
    order.sort_by(|&a, &b| mean[b].total_cmp(&mean[a]).then(a.cmp(&b)));
    order.truncate(Node::MAX_OTHERS);
    order.iter().map(|&k| Ok((vocabulary.label(&names[k])?, mean[k]))).collect()
}

/// Predicates between objects, `same part` left out.
fn add_edges(
    graph: &mut SceneGraph,
    objects: &Objects,
    names: &[String],
    node_of: &[Option<NodeId>],
    vocabulary: &mut Vocabulary,
    p: &GraphParams,
) -> Result<(), Error> {
    let same = names.iter().position(|n| n == SAME_PART);
    let none = vocabulary.find_label(NONE);
    for (&[i, j], scores) in objects.set.edges.iter().zip(&objects.scores.predicates) {
        let (Some(s), Some(t)) = (node_of[i], node_of[j]) else { continue };
        let unnamed = |id| none.is_some() && graph.node(id).map(|n| n.label) == none;
        if unnamed(s) || unnamed(t) {
            continue;
        }
        let mut scores = scores.clone();
        if let Some(k) = same.filter(|k| *k < scores.len()) {
            scores[k] = 0.0;
            if !p.multi {
                let rest: f32 = scores.iter().sum();
                scores.iter_mut().for_each(|v| *v /= rest.max(1e-12));
            }
        }
        let best = argmax(&scores).0;
        for (k, &score) in scores.iter().enumerate() {
            let wanted = if p.multi { score >= p.min_predicate.max(0.5) } else { k == best && score > 0.0 };
            let Some(name) = names.get(k).filter(|n| *n != NONE && *n != SAME_PART) else { continue };
            if wanted && score >= p.min_predicate {
                graph.insert_edge(Edge { s, t, p: vocabulary.predicate(name)?, score })?;
            }
        }
    }
    Ok(())
}

/// Index and value of the largest entry, the first of equals.
fn argmax(v: &[f32]) -> (usize, f32) {
    v.iter().enumerate().fold((0, f32::NEG_INFINITY), |b, (k, &x)| if x > b.1 { (k, x) } else { b })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NodeInput, NodeSet, Scores};
    use graph_align::Box3;
    use gsm::SegmentId;

    fn set(xs: &[f32]) -> NodeSet {
        let node = |(k, &x): (usize, &f32)| NodeInput {
            id: SegmentId(k as u32 + 1),
            surfels: 100,
            area: 1.0,
            bounds: Box3::new([x, 0.0, 0.0], [1.0; 3]).expect("finite"),
            points: Vec::new(),
        };
        NodeSet::new(xs.iter().enumerate().map(node).collect(), 0.5)
    }

    #[test]
    fn parts_join_none_stays_out_and_edges_go_between_objects() {
        let names = |v: &[&str]| v.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        let (classes, predicates) = (names(&["wall", "chair", NONE]), names(&["on", SAME_PART, NONE]));
        // 0 and 1 are two parts of a wall, 2 is a chair, 3 is clutter; 0 and 2 are too far apart.
        let set = set(&[0.0, 1.2, 2.5, 3.0]);
        let class = [[0.9, 0.1, 0.0], [0.7, 0.3, 0.0], [0.2, 0.8, 0.0], [0.1, 0.1, 0.8]];
        let pair = |&[i, j]: &[usize; 2]| match (i, j) {
            (0, 1) => vec![0.1, 0.9, 0.0],
            (1, 0) => vec![0.5, 0.3, 0.2],
            (2, 1) => vec![0.3, 0.6, 0.1],
            _ => vec![0.2, 0.0, 0.8],
        };
        let scores = Scores {
            classes: class.iter().map(|c| c.to_vec()).collect(),
            predicates: set.edges.iter().map(pair).collect(),
        };
        let mut v = Vocabulary::default();
        let p = GraphParams { first_id: 40, ..GraphParams::default() };
        let objects = Objects::join(&set, &scores, &predicates, p.min_same_part, 0.5).expect("rows fit");
        let (g, of) = build_graph(&objects, &classes, &predicates, &mut v, &p).expect("graph");
        assert_eq!(of, [Some(NodeId(40)), Some(NodeId(40)), Some(NodeId(41)), None]);
        assert_eq!(g.len(), 2);
        let wall = g.node(NodeId(40)).expect("wall");
        assert!((wall.score - 0.8).abs() < 1e-6 && (wall.bounds.extent().x - 2.2).abs() < 1e-5);
        // Without `same part`, 0.3 beats 0.1 for chair -> wall; the other way `none` wins.
        let edges: Vec<_> = g.edges().map(|e| (e.s.0, e.t.0)).collect();
        assert_eq!(edges, [(41, 40)]);
        assert!((g.edges().next().expect("edge").score - 0.75).abs() < 1e-6);
        assert!(Objects::join(&set, &Scores::default(), &predicates, p.min_same_part, 0.5).is_err());
        // A second look decides in proportion to its weight.
        let mut again = objects.clone();
        let chair =
            Scores { classes: vec![vec![0.0, 1.0, 0.0]; 3], predicates: objects.scores.predicates.clone() };
        again.look_again(&chair, 0.75);
        let (g, _) = build_graph(&again, &classes, &predicates, &mut v, &p).expect("graph");
        assert!(g.nodes().all(|n| n.label == v.find_label("chair").expect("used")));
        assert!((g.node(NodeId(40)).expect("first").score - (0.2 + 0.75 * 0.8)).abs() < 1e-6);
    }
}
