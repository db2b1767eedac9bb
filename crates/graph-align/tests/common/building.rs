//! Whole buildings as frames.

use graph_align::{
    Box3, Edge, Footprint, Key, LabelId, Looked, Node, NodeId, Observation, PredicateId, SceneGraph,
    Vocabulary,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A building: rooms of 5 m on a grid, nodes and edges spread evenly over them, in l20 or l160 names.
pub(crate) fn building(
    rooms: u64,
    nodes: u64,
    edges: u64,
    names: (u16, u16),
    seed: u64,
) -> (SceneGraph, Vocabulary) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut pick = move |n: u64| rng.next_u64() % n;
    let name = |k: u16| format!("name {k}");
    let (labels, predicates): (Vec<_>, Vec<_>) =
        ((0..names.0).map(name).collect(), (0..names.1).map(name).collect());
    let v = Vocabulary::new(labels.iter().map(String::as_str), predicates.iter().map(String::as_str))
        .expect("names differ");
    let mut g = SceneGraph::default();
    for k in 0..nodes {
        let room = k * rooms / nodes;
        let corner = [(room % 7) as f32 * 8.0, (room / 7) as f32 * 8.0, 0.0];
        let mut cm = |most: u64| pick(most) as f32 / 100.0;
        let centroid = [corner[0] + cm(500), corner[1] + cm(500), corner[2] + cm(260)];
        let extent = if k % 5 == 0 { [cm(500), cm(20), cm(260)] } else { [cm(150), cm(150), cm(150)] };
        let mut n = Node::new(
            NodeId(k),
            LabelId(pick(u64::from(names.0)) as u16),
            Box3::new(centroid, extent).expect("finite"),
        );
        n.score = pick(128) as f32 / 127.0;
        n.sightings = 1 + pick(6) as u32;
        n.last_seen = (room * 600 + pick(600)) as f64 / 10.0;
        g.insert_node(n);
    }
    while (g.edges().len() as u64) < edges {
        let room = pick(rooms);
        let (first, last) = ((room * nodes).div_ceil(rooms), ((room + 1) * nodes).div_ceil(rooms));
        let mut end = || NodeId(first + pick(last - first));
        let (s, t) = (end(), end());
        let e =
            Edge { s, t, p: PredicateId(pick(u64::from(names.1)) as u16), score: pick(128) as f32 / 127.0 };
        // A node has no edge with itself.
        let _ = g.insert_edge(e);
    }
    (g, v)
}

/// A footprint of any shape for every node.
pub(crate) fn with_footprints(g: &SceneGraph, seed: u64) -> SceneGraph {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut share = || (rng.next_u64() % 100) as f32 / 100.0;
    let mut out = SceneGraph::default();
    for n in g.nodes() {
        let e = n.bounds.extent();
        let mut f = Footprint::rectangle([e.x, e.y], share() * 1.57);
        f.reach.iter_mut().for_each(|r| *r *= 0.7 + 0.3 * share());
        let bounds = n.bounds.with_footprint(f).expect("reaches of at least 0");
        out.insert_node(Node { bounds, ..n });
    }
    g.edges().for_each(|e| out.insert_edge(e).expect("living ends"));
    out
}

/// Two more classes, a rectangle for every fourth node, and what was looked at in cells of 0.5 m:
/// rooms but for what stands behind furniture.
pub(crate) fn with_evidence(g: &SceneGraph, rooms: u64, seed: u64) -> (SceneGraph, Looked) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut out = SceneGraph::default();
    for mut n in g.nodes() {
        n.others =
            (1..3).map(|k| (LabelId((n.label.0 + k) % 20), (rng.next_u64() % 64) as f32 / 127.0)).collect();
        if n.id.0 % 4 == 0 {
            let sides = [n.bounds.extent().x, n.bounds.extent().y];
            n.bounds = n.bounds.with_footprint(Footprint::rectangle(sides, 0.5)).expect("sides of a box");
        }
        out.insert_node(n);
    }
    g.edges().for_each(|e| out.insert_edge(e).expect("living ends"));
    let mut cells = Vec::new();
    for room in 0..rooms as i32 {
        let mut pick = |n: i32| (rng.next_u64() % n as u64) as i32;
        let hidden: Vec<[i32; 3]> = (0..6).map(|_| [pick(12), pick(12), pick(7)]).collect();
        for c in 0..12 * 12 * 7 {
            let c = [c % 12, c / 12 % 12, c / 144];
            if !hidden.iter().any(|h| (0..3).all(|k| (h[k]..h[k] + 3).contains(&c[k]))) {
                cells.push([room % 7 * 16 + c[0] - 1, room / 7 * 16 + c[1] - 1, c[2] - 1]);
            }
        }
    }
    (out, Looked::new(0.5, [0.0; 3], &cells).expect("small"))
}

pub(crate) fn frame(graph: SceneGraph, looked: Option<Looked>) -> Observation {
    Observation {
        key: Key { start_ds: 0, agent: 3, epoch: 0, seq: 7 },
        end_ds: 30_000,
        frame: 3,
        graph: graph.quantised(),
        looked,
    }
}
