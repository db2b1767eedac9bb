//! Alignment, merge, fold and codec on a building of 47 rooms; alignment again on 30 and 3,600 rooms (1,000 and 100,000
//! nodes), where only a kept index counts.

use benches::building::{self, Dice, LABELS, Object, PREDICATES, Plan, Support};
use benches::peers::{self, Solver};
use criterion::{BatchSize, Criterion, Throughput};
use graph_align::{
    Algorithm, Box3, Edge, Error, Folded, Index, Key, LabelId, Node, NodeId, Observation, Outcome,
    PaperParams, Params, PredicateId, Query, RobustParams, SceneGraph, Verdict, Vocabulary, align,
    align_indexed, update, wire,
};
use nalgebra::{Isometry3, Translation3, Vector3};
use std::hint::black_box;

const ROOMS: usize = 47;
const QUERY: usize = 30;

/// Furniture beside the usual amount: real scans hold some thirty objects a room.
const DENSITY: f64 = 1.5;

/// Furnished rooms on a grid.
fn objects(rooms: usize) -> Vec<Object> {
    let (mut dice, mut out) = (Dice::new(1), Vec::new());
    for k in 0..rooms {
        let plan = Plan::any(&mut dice);
        let furnished = building::room(&mut dice, &plan, k, DENSITY);
        let at = building::site(&mut dice, k, rooms);
        building::place(&mut out, furnished, &at, k);
    }
    out
}

/// The box of an object in the building, its corners turned with it.
fn bounds(o: &Object) -> Result<Box3, Error> {
    let extent = o.pose.rotation.to_rotation_matrix().matrix().abs() * o.size;
    let centre = o.pose.translation.vector;
    Box3::new(centre.cast::<f32>().into(), extent.cast::<f32>().into())
}

/// The graph of one room, each object related to what holds it.
fn graph(objects: &[Object], room: usize) -> Result<SceneGraph, Error> {
    let mut g = SceneGraph::default();
    // Objects stand in the order of their rooms.
    let first = objects.partition_point(|o| o.room < room);
    let own = || objects.iter().enumerate().skip(first).take_while(|(_, o)| o.room == room);
    for (k, o) in own() {
        let label = LABELS.iter().position(|l| *l == o.label).unwrap_or(0) as u16;
        g.insert_node(Node::new(NodeId(k as u64), LabelId(label), bounds(o)?));
    }
    for (k, o) in own() {
        let (holder, name) = match o.support {
            Support::None => continue,
            Support::On(h) => (h, "standing on"),
            Support::At(h) => (h, "attached to"),
        };
        let p = PREDICATES.iter().position(|p| *p == name).unwrap_or(0) as u16;
        g.insert_edge(Edge { s: NodeId(k as u64), t: NodeId(holder as u64), p: PredicateId(p), score: 0.9 })?;
    }
    Ok(g.quantised())
}

/// The first objects of a room as another visit sees them: 2 cm off, one in ten of another class.
fn seen_again(g: &SceneGraph) -> Result<SceneGraph, Error> {
    let mut dice = Dice::new(7);
    let mut out = SceneGraph::default();
    for n in g.nodes().take(QUERY) {
        let c = n.bounds.centroid().coords.map(|v| v + dice.within(-0.02, 0.02) as f32);
        let bounds = Box3::new(c.into(), n.bounds.extent().into())?;
        let label = if dice.chance(0.1) { LabelId(dice.below(LABELS.len()) as u16) } else { n.label };
        out.insert_node(Node { bounds, label, ..n.clone() });
    }
    for e in g.edges() {
        if out.node(e.s).is_some() && out.node(e.t).is_some() {
            out.insert_edge(e)?;
        }
    }
    Ok(out.quantised())
}

fn observation(visit: usize, graph: SceneGraph) -> Observation {
    let (start, agent) = (visit as u32 * 500, (visit % 5) as u16);
    let key = Key { start_ds: start, agent, epoch: 0, seq: visit as u32 };
    Observation { key, end_ds: start + 490, frame: 0, graph, looked: None }
}

/// A 30-node query against a kept index of a building: unknown frame, and a prior that is 0.3 m and 2
/// degrees off; what an update of the index costs; and the peers where the table fits.
fn scale(
    g: &mut criterion::BenchmarkGroup<'_, criterion::measurement::WallTime>,
    rooms: usize,
    names: &Vocabulary,
    robust: &Params,
) -> Result<(), Error> {
    let objects = objects(rooms);
    let mut reference = SceneGraph::default();
    let mut query = None;
    for r in 0..rooms {
        let room = graph(&objects, r)?;
        if r >= rooms / 2 && query.is_none() && room.len() >= QUERY {
            query = Some(seen_again(&room)?);
        }
        room.nodes().for_each(|n| reference.insert_node(n.clone()));
    }
    let seen = query.unwrap_or_default();
    // A frame of its own: everything is found anew.
    let away = Isometry3::new(Vector3::new(31.0, -7.0, 0.4), Vector3::z() * 2.1);
    let moved = graph_align::append(&SceneGraph::default(), &seen, &away);
    let unknown = Query::new(&moved);
    // Off where the query is, not about an origin that may be a kilometre away.
    let here =
        Translation3::from(seen.nodes().next().map(|n| n.bounds.centroid().coords).unwrap_or_default());
    let drift = Isometry3::new(Vector3::new(0.2, 0.2, 0.05), Vector3::z() * 2.0_f32.to_radians());
    let drift = here * drift * here.inverse();
    let near = Query { prior: Some(drift * away.inverse()), ..unknown };
    let mut index = Index::of(&reference, &robust.robust);
    let size = format!("{} nodes, {} pair entries", reference.len(), index.pair_entries());
    let right = |o: &Outcome| match o {
        Outcome::Match(m) => {
            let off = m.reference_from_query
                * away
                * seen.nodes().next().map(|n| n.bounds.centroid()).unwrap_or_default();
            let truth = seen.nodes().next().map(|n| n.bounds.centroid()).unwrap_or_default();
            if (off - truth).norm() < 0.3 { "right" } else { "WRONG" }
        }
        Outcome::Ambiguous { .. } | Outcome::NoMatch { .. } => "refused",
    };
    for (name, q) in [("unknown frame", &unknown), ("prior", &near)] {
        eprintln!("{rooms} rooms ({size}), {name}: {}", right(&align_indexed(&reference, &index, q, robust)));
        g.bench_function(format!("{rooms} rooms, {name}"), |b| {
            b.iter(|| align_indexed(&reference, &index, black_box(q), robust));
        });
    }
    let node = reference.nodes().nth(reference.len() / 2);
    if let Some(node) = node {
        let all = index.pair_entries();
        index.remove(node.id);
        let entries = all - index.pair_entries();
        eprintln!("{rooms} rooms: the node that comes and goes has {entries} pair entries");
        g.throughput(Throughput::Elements(2 * entries as u64));
        g.bench_function(format!("{rooms} rooms, index insert and remove"), |b| {
            b.iter(|| {
                index.insert(black_box(&node));
                index.remove(node.id);
            });
        });
    }
    if rooms <= ROOMS {
        for (name, solver) in [("spectral peer", Solver::Spectral), ("clique peer", Solver::Clique)] {
            let outcome = peers::align(&reference, &unknown, names, solver);
            eprintln!("{rooms} rooms, {name}: {}", right(&outcome));
            g.bench_function(format!("{rooms} rooms, {name}"), |b| {
                b.iter(|| peers::align(&reference, black_box(&unknown), names, solver));
            });
        }
    }
    Ok(())
}

/// K_40 in K_40: one class, a ring of forty equal places, every node related to every other.
fn cliques() -> Result<SceneGraph, Error> {
    let chair = LabelId(LABELS.iter().position(|l| *l == "chair").unwrap_or(0) as u16);
    let mut g = SceneGraph::default();
    for k in 0..40_u64 {
        let turn = k as f32 / 40.0 * std::f32::consts::TAU;
        let at = [1.5 * turn.cos(), 1.5 * turn.sin(), 0.5];
        g.insert_node(Node::new(NodeId(k), chair, Box3::new(at, [0.5; 3])?));
    }
    for (s, t) in (0..40).flat_map(|s| (0..40).map(move |t| (s, t))).filter(|(s, t)| s != t) {
        g.insert_edge(Edge { s: NodeId(s), t: NodeId(t), p: PredicateId(0), score: 0.9 })?;
    }
    Ok(g)
}

fn describe(name: &str, outcome: &Outcome) {
    match outcome {
        Outcome::Match(m) => {
            let known = m.verdicts.values().filter(|v| **v != Verdict::New).count();
            eprintln!("{name}: match, {known} of the query's nodes known again");
        }
        Outcome::Ambiguous { candidates } => eprintln!("{name}: ambiguous, {} places", candidates.len()),
        Outcome::NoMatch { why } => eprintln!("{name}: no match ({})", why.word()),
    }
}

fn main() -> Result<(), Error> {
    let names = Vocabulary::new(LABELS, PREDICATES)?;
    let objects = objects(ROOMS);
    let rooms = (0..ROOMS).map(|r| graph(&objects, r)).collect::<Result<Vec<_>, _>>()?;
    let large = rooms.iter().find(|g| g.len() >= QUERY).unwrap_or(&rooms[0]);
    let seen = seen_again(large)?;
    let query = Query::new(&seen);

    let paper = Params { algorithm: Algorithm::Paper, ..Params::default() };
    let fit = Params { paper: PaperParams::reading("fit").unwrap_or_default(), ..paper.clone() };
    let robust = Params { robust: RobustParams::for_vocabulary(&names), ..Params::default() };
    let mut folded = Folded::default();
    rooms.iter().enumerate().for_each(|(k, g)| folded.push(&observation(k, g.clone()), &paper));
    let reference = folded.main_graph();
    let outcome = align(&reference, &query, &paper);
    let sizes = |g: &SceneGraph| format!("{} nodes, {} edges", g.len(), g.edges().len());
    eprintln!("reference: {}; query: {}", sizes(&reference), sizes(&seen));
    describe("paper, shared frame", &outcome);
    describe("paper, fitted transform", &align(&reference, &query, &fit));
    describe("robust", &align(&reference, &query, &robust));

    let mut c = Criterion::default().configure_from_args();
    let mut g = c.benchmark_group("graph_align");
    for (name, params) in
        [("paper, shared frame", &paper), ("paper, fitted transform", &fit), ("robust", &robust)]
    {
        g.bench_function(format!("align, {name}"), |b| {
            b.iter(|| align(&reference, black_box(&query), params))
        });
    }
    let index = Index::of(&reference, &robust.robust);
    g.bench_function("align, robust, index kept", |b| {
        b.iter(|| align_indexed(&reference, &index, black_box(&query), &robust));
    });
    g.bench_function("update", |b| b.iter(|| update(&reference, black_box(&query), &outcome, &paper)));
    let last = observation(ROOMS, seen.clone());
    g.bench_function("fold push, paper", |b| {
        b.iter_batched_ref(|| folded.clone(), |f| f.push(black_box(&last), &paper), BatchSize::LargeInput);
    });
    let k40 = cliques()?;
    describe("K_40 in K_40", &align(&k40, &Query::new(&k40), &robust));
    g.bench_function("K_40 in K_40", |b| b.iter(|| align(&k40, black_box(&Query::new(&k40)), &robust)));
    g.sample_size(20);
    for rooms in [30, ROOMS, 3_600] {
        scale(&mut g, rooms, &names, &robust)?;
    }
    let frame = wire::encode(&last, &names)?;
    g.throughput(Throughput::Bytes(frame.len() as u64));
    g.bench_function("wire encode", |b| b.iter(|| wire::encode(black_box(&last), &names)));
    g.bench_function("wire decode", |b| b.iter(|| wire::decode(black_box(&frame), &names)));
    g.finish();
    c.final_summary();
    Ok(())
}
