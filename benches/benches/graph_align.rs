//! Alignment, merge, fold and codec on a building of 47 rooms.

use benches::building::{self, Dice, LABELS, Object, PREDICATES, Plan, Support};
use criterion::{BatchSize, Criterion, Throughput};
use graph_align::{
    Algorithm, Box3, Edge, Error, Folded, Index, Key, LabelId, Node, NodeId, Observation, Outcome,
    PaperParams, Params, PredicateId, Query, RobustParams, SceneGraph, Verdict, Vocabulary, align,
    align_indexed, update, wire,
};
use std::hint::black_box;

const ROOMS: usize = 47;
const QUERY: usize = 30;

/// Furniture beside the usual amount: real scans hold some thirty objects a room.
const DENSITY: f64 = 1.5;

/// 47 furnished rooms on a grid.
fn objects() -> Vec<Object> {
    let (mut dice, mut out) = (Dice::new(1), Vec::new());
    for k in 0..ROOMS {
        let plan = Plan::any(&mut dice);
        let furnished = building::room(&mut dice, &plan, k, DENSITY);
        let at = building::site(&mut dice, k, ROOMS);
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
    let own = || objects.iter().enumerate().filter(|(_, o)| o.room == room);
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
    let objects = objects();
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
    let frame = wire::encode(&last, &names)?;
    g.throughput(Throughput::Bytes(frame.len() as u64));
    g.bench_function("wire encode", |b| b.iter(|| wire::encode(black_box(&last), &names)));
    g.bench_function("wire decode", |b| b.iter(|| wire::decode(black_box(&frame), &names)));
    g.finish();
    c.final_summary();
    Ok(())
}
