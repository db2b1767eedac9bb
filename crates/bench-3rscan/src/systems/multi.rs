//! Several agents: observations travel, every replica folds the same set.

use super::{AgentFrames, Clocks, Exchange, Local, Made, System, Variant, oracle};
use crate::Error;
use crate::changes::{Changes, Step};
use crate::scenario::{FramesMode, Plan, Visit};
use crate::truth::State;
use fleet::{LinkParams, Network};
use graph_align::{
    Algorithm, Edge, Folded, Key, Node, NodeId, Observation, Params, RobustParams, SceneGraph, Vocabulary,
};
use nalgebra::{Isometry3, Point3};
use scan3r::RoomEntry;
use std::collections::{BTreeMap, BTreeSet};

/// How far off a drifting frame may be, radians, and metres at any object: four sigmas of two agents' yaws, and what
/// they make at 50 m.
const NEAR: [f32; 2] = [0.2, 10.0];

/// What multi-agent systems share.
pub struct MultiParams<'a> {
    /// The paper's thresholds and readings.
    pub align: Params,
    /// Loss and delay.
    pub link: LinkParams,
    /// Agents' frames.
    pub frames: AgentFrames,
    /// Their mode.
    pub mode: FramesMode,
    /// Names; fixed.
    pub vocabulary: &'a Vocabulary,
    /// Class probability below which a merged node is not part of the graph.
    pub min_class: f32,
    /// Changes between scans, for the oracle.
    pub rooms: &'a [RoomEntry],
    /// Middles of the rooms in the domain frame.
    pub middles: &'a [Point3<f32>],
    /// Each room during each of its rounds; empty where nothing changes.
    pub states: &'a [Vec<State>],
    /// Root seed.
    pub seed: u64,
    /// Clocks.
    pub clocks: Clocks,
}

/// Runs a multi-agent system. `locals` are in the order of `plan.visits`.
///
/// # Errors
/// Observations that do not fit a frame.
pub fn multi_agent(
    system: System,
    plan: &Plan,
    locals: &[&Local],
    p: &MultiParams<'_>,
) -> Result<Made, Error> {
    let mut params = p.align.clone();
    params.algorithm = match system {
        System::Append => Algorithm::Append,
        System::Ma3dsg => Algorithm::Robust,
        _ => Algorithm::Paper,
    };
    let names = RobustParams::for_vocabulary(p.vocabulary);
    (params.robust.structure, params.robust.unnamed) = (names.structure, names.unnamed);
    params.robust.named = p.min_class;
    params.near = (p.mode == FramesMode::Drift).then_some(NEAR);
    if matches!(p.mode, FramesMode::Unknown | FramesMode::UnknownVisit) {
        params.paper.transform = graph_align::paper::TransformReading::FitMap;
    }
    let mut made = Made { visits: plan.visits.len(), ..Made::default() };
    let mut work = vec![0.0; plan.agents];
    let mut frames = vec![0_u64; plan.agents];
    for (v, local) in plan.visits.iter().zip(locals) {
        work[v.agent] += local.cpu_s + local.revisions_cpu_s;
        frames[v.agent] += u64::from(local.frames);
        made.world_s += local.world_s;
        made.total_wall_s += local.wall_s;
    }
    made.frames = frames.iter().sum();
    made.frames_max_agent = frames.iter().copied().max().unwrap_or(0);

    let wall = (p.clocks.wall)();
    let (net, codec_s) = exchange(plan, locals, system.variant(), p)?;
    work.iter_mut().zip(&codec_s).for_each(|(w, c)| *w += c);
    let (graph, mut exchange) = if system.is_oracle() {
        let start = (p.clocks.cpu)();
        let graph = oracle::merge(plan, locals, p.rooms, system == System::Oracle);
        let align_s = (p.clocks.cpu)() - start;
        (
            graph,
            Exchange {
                align_s,
                align_s_all: align_s * plan.agents as f64,
                replicas_equal: true,
                ..Exchange::default()
            },
        )
    } else {
        let (graph, mut exchange) = fold_all(plan, &net, &params, p);
        exchange.changes = changes(plan, locals, &net, &params, p);
        (graph, exchange)
    };
    let folding = exchange.align_s + exchange.refold_s;
    exchange.bytes = (0..plan.agents).map(|a| net.traffic(a).sent).collect();
    exchange.copies = (0..plan.agents).map(|a| net.traffic(a).copies).collect();
    exchange.deltas = net.deltas();
    exchange.wire = net.frames().to_vec();
    made.graph = graph;
    made.total_cpu_s = work.iter().fold(0.0_f64, |m, w| m.max(*w)) + folding;
    made.total_wall_s += (p.clocks.wall)() - wall;
    made.exchange = Some(exchange);
    Ok(made)
}

/// Publishes every visit's graph at its end, or in revisions until then; agents sync at the end of their
/// visits, and once more when all is over. Beside it the CPU seconds of each agent's codec.
fn exchange(
    plan: &Plan,
    locals: &[&Local],
    variant: Variant,
    p: &MultiParams<'_>,
) -> Result<(Network, Vec<f64>), Error> {
    let seed = rand_chacha::rand_core::Rng::next_u64(&mut crate::seeds::stream(p.seed, "network", &[]));
    let mut net = Network::new(plan.agents, p.vocabulary.clone(), p.link, seed);
    // (time, visit, revision; none where the visit is published once).
    let mut said: Vec<(f64, usize, Option<usize>)> = Vec::new();
    for (k, (v, local)) in plan.visits.iter().zip(locals).enumerate() {
        let n = local.revisions.len();
        let early = local.revisions.iter().take(n.saturating_sub(1)).enumerate();
        said.extend(early.map(|(r, revision)| (v.start + revision.at_s, k, Some(r))));
        said.push((v.end(), k, n.checked_sub(1)));
    }
    said.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut codec_s = vec![0.0; plan.agents];
    let (mut last, mut seq) = (0, vec![0; plan.agents]);
    let mut before: BTreeMap<usize, SceneGraph> = BTreeMap::new();
    for (at, k, r) in said {
        let (v, local) = (&plan.visits[k], locals[k]);
        let is_end = r.is_none_or(|r| r + 1 == local.revisions.len());
        let end = if is_end { v.end() } else { at };
        let now = ds(end);
        let start = (p.clocks.cpu)();
        let (graph, looked) = match r.map(|r| &local.revisions[r]) {
            None => (&local.graphs[&variant], &local.looked),
            Some(r) => (&r.graphs[&variant], &r.looked),
        };
        let key = Key { start_ds: ds(v.start), agent: v.agent as u16, epoch: 0, seq: seq[v.agent] };
        let graph = in_fleet(v, graph, end, before.get(&k));
        before.insert(k, graph.clone());
        let frame = p.frames.number(v);
        net.publish(now, Observation { key, end_ds: now, frame, graph, looked: Some(looked.clone()) })?;
        seq[v.agent] += 1;
        if is_end {
            net.sync(now, v.agent)?;
        }
        codec_s[v.agent] += (p.clocks.cpu)() - start;
        last = last.max(now);
    }
    net.finish(last)?;
    Ok((net, codec_s))
}

fn ds(seconds: f64) -> u32 {
    (seconds * 10.0).round() as u32
}

/// The graph of a visit as it is published. Node ids hold agent, visit and node, so they are unique in the fleet.
/// What is as in the revision before was not seen since.
fn in_fleet(v: &Visit, local: &SceneGraph, end: f64, before: Option<&SceneGraph>) -> SceneGraph {
    let base = (v.agent as u64) << 48 | u64::from(v.seq) << 24;
    let id = |n: NodeId| NodeId(base + n.0);
    let mut graph = SceneGraph::default();
    for n in local.nodes() {
        graph.insert_node(Node { id: id(n.id), last_seen: end, ..n });
    }
    for e in local.edges() {
        // Both ends were just inserted.
        let _ = graph.insert_edge(Edge { s: id(e.s), t: id(e.t), ..e });
    }
    let graph = graph.quantised();
    let same = |n: &Node| {
        let old = before.and_then(|b| b.node(n.id));
        old.filter(|o| *o == Node { last_seen: o.last_seen, ..n.clone() })
    };
    let kept: Vec<Node> = graph.nodes().filter_map(|n| same(&n)).collect();
    let mut graph = graph;
    kept.into_iter().for_each(|n| graph.insert_node(n));
    graph
}

/// Folds every replica; the scored graph is agent 0's, in the domain frame.
fn fold_all(plan: &Plan, net: &Network, params: &Params, p: &MultiParams<'_>) -> (SceneGraph, Exchange) {
    let mut times = Vec::with_capacity(plan.agents);
    let mut first: Option<Folded> = None;
    let mut equal = true;
    for agent in 0..plan.agents {
        let start = (p.clocks.cpu)();
        let folded = net.replica(agent).fold(params);
        times.push((p.clocks.cpu)() - start);
        match &first {
            None => first = Some(folded),
            Some(f) => equal &= *f == folded,
        }
    }
    let folded = first.unwrap_or_default();
    let exchange = Exchange {
        align_s: times.first().copied().unwrap_or(0.0),
        align_s_all: times.iter().sum(),
        refold_s: refold(plan, net, params, p.clocks.cpu),
        replicas_equal: equal,
        links: links(plan, &folded, p),
        ..Exchange::default()
    };
    (in_domain(plan, &folded, p), exchange)
}

/// What agent 0 spends on folding anew at its own visits' ends because observations arrived that
/// sort before ones it had folded.
fn refold(plan: &Plan, net: &Network, params: &Params, clock: fn() -> f64) -> f64 {
    let all: Vec<&Observation> = net.replica(0).observations().collect();
    let mut known: Vec<Key> = Vec::new();
    let mut spent = 0.0;
    for v in plan.visits.iter().filter(|v| v.agent == 0) {
        let now = ds(v.end());
        let there: Vec<&&Observation> = all.iter().filter(|o| o.end_ds <= now).collect();
        let late = there.iter().any(|o| !known.contains(&o.key) && known.last().is_some_and(|l| o.key < *l));
        if late {
            let start = clock();
            let mut again = Folded::default();
            there.iter().for_each(|o| again.push(o, params));
            spent += clock() - start;
        }
        known = there.iter().map(|o| o.key).collect();
    }
    spent
}

/// What the fold made of every change, visit by visit. `None` where no room is visited in two rounds.
fn changes(
    plan: &Plan,
    locals: &[&Local],
    net: &Network,
    params: &Params,
    p: &MultiParams<'_>,
) -> Option<Changes> {
    if p.states.is_empty() || plan.visits.iter().all(|v| v.round == 0) {
        return None;
    }
    let mut out = Changes::default();
    let mut folded = Folded::default();
    let mut last: BTreeMap<usize, usize> = BTreeMap::new();
    for o in net.replica(0).observations() {
        let of = |v: &Visit| v.agent == usize::from(o.key.agent) && ds(v.start) == o.key.start_ds;
        let (v, local) = plan.visits.iter().zip(locals).find(|(v, _)| of(v))?;
        let (before, all_before) = around(plan, &folded, o.frame, p);
        folded.push(o, params);
        let round = last.insert(v.room, v.round);
        let Some(was) = round.and_then(|r| p.states.get(v.room)?.get(r)) else { continue };
        let Some(is) = p.states.get(v.room).and_then(|s| s.get(v.round)) else { continue };
        let (after, all_after) = around(plan, &folded, o.frame, p);
        let frame_from_domain = p.frames.frame_from_domain(v);
        let own = &local.graphs[&Variant::Network];
        let visit = graph_align::append(&SceneGraph::default(), own, &frame_from_domain.inverse());
        out.count(&Step {
            before: &before,
            all_before: &all_before,
            after: &after,
            all_after: &all_after,
            heir: &|id| heir(&folded, id),
            visit: &visit,
            looked: &|at| local.looked.contains(&(frame_from_domain * at)),
            was,
            is,
        });
    }
    Some(out)
}

/// What a node has become.
fn heir(folded: &Folded, id: NodeId) -> NodeId {
    let other = folded.components.iter().map(|c| c.heir(id)).find(|h| *h != id);
    other.unwrap_or(id)
}

/// The named nodes of the component that holds a frame, in the domain frame, and all its nodes.
fn around(plan: &Plan, folded: &Folded, frame: u32, p: &MultiParams<'_>) -> (SceneGraph, BTreeSet<NodeId>) {
    let Some(c) = folded.components.iter().find(|c| c.frames.contains_key(&frame)) else {
        return Default::default();
    };
    let t = domain_from(plan, c.root, p);
    let graph = graph_align::append(&SceneGraph::default(), &c.graph, &t);
    let all = graph.nodes().map(|n| n.id).collect();
    (graph.named(p.vocabulary.find_label(agent::NONE), p.min_class), all)
}

/// The true transform of a frame; the identity where frames are known. What a frame's owner believes of its own
/// place nobody can tell better, so drift is scored as unknown frames are.
fn domain_from(plan: &Plan, frame: u32, p: &MultiParams<'_>) -> Isometry3<f32> {
    let visit = plan.visits.iter().find(|v| p.frames.number(v) == frame);
    visit
        .filter(|_| p.mode != FramesMode::Shared)
        .map_or_else(Isometry3::identity, |v| p.frames.frame_from_domain(v).inverse())
}

/// The largest component, carried into the domain frame by the true transform of its oldest frame;
/// other components stay where they are and count as false.
fn in_domain(plan: &Plan, folded: &Folded, p: &MultiParams<'_>) -> SceneGraph {
    let Some(main) = folded
        .components
        .iter()
        .max_by(|a, b| a.graph.len().cmp(&b.graph.len()).then(std::cmp::Ordering::Greater))
    else {
        return SceneGraph::default();
    };
    let t = domain_from(plan, main.root, p);
    let mut graph = graph_align::append(&SceneGraph::default(), &main.graph, &t);
    for c in folded.components.iter().filter(|c| !std::ptr::eq(*c, main)) {
        // Far below the domain: no true node is near.
        let away = Isometry3::translation(0.0, 0.0, -1000.0);
        graph = graph_align::append(&graph, &c.graph, &away);
    }
    graph.named(p.vocabulary.find_label(agent::NONE), p.min_class)
}

/// Pairs of agents with a common room: found (in one component, within 5 degrees and 0.5 m of the
/// true transform), true (all such pairs), wrong (in one component, farther off).
fn links(plan: &Plan, folded: &Folded, p: &MultiParams<'_>) -> Option<[usize; 3]> {
    if p.mode != FramesMode::Unknown {
        return None;
    }
    let first = |agent: usize| plan.visits.iter().find(|v| v.agent == agent);
    let mut out = [0; 3];
    for a in 0..plan.agents {
        for b in a + 1..plan.agents {
            let rooms = |k: usize| plan.visits.iter().filter(move |v| v.agent == k).map(|v| v.room);
            let Some(room) = rooms(a).find(|r| rooms(b).any(|s| s == *r)) else { continue };
            let (Some(va), Some(vb)) = (first(a), first(b)) else { continue };
            out[1] += 1;
            let (fa, fb) = (p.frames.number(va), p.frames.number(vb));
            let found = folded.components.iter().find_map(|c| Some((c.frames.get(&fa)?, c.frames.get(&fb)?)));
            let Some((ca, cb)) = found else { continue };
            // Where the shared room's middle lands in a's frame, against where it should.
            let b_from_domain = p.frames.frame_from_domain(vb);
            let truth = p.frames.frame_from_domain(va) * b_from_domain.inverse();
            let estimate = ca.inverse() * cb;
            let middle = b_from_domain * p.middles[room];
            let close = (truth.inverse() * estimate).rotation.angle().to_degrees() < 5.0
                && (estimate * middle - truth * middle).norm() < 0.5;
            out[if close { 0 } else { 2 }] += 1;
        }
    }
    Some(out)
}
