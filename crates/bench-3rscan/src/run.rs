//! Running cells: plan, visits, truth, systems, rows.

use crate::layout::{self, Placement};
use crate::rates::{Measured, measure};
use crate::report::{CellName, CellSetting, row, truth_entry};
use crate::scenario::{FramesMode, Plan, PlanParams, Replay, Scenario, Visit, plan};
use crate::systems::{
    AgentFrames, Local, LocalParams, Made, MultiParams, System, multi_agent, run_visit, single_agent,
};
use crate::truth::{self, SeenScans, Truth};
use crate::{Error, Surface};
use fleet::LinkParams;
use graph_align::json::GraphFile;
use graph_align::{Params, Vocabulary};
use nalgebra::Point3;
use scan3r::Dataset;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What all cells of a run share.
pub struct RunParams<'a> {
    /// Systems, in the order of rows.
    pub systems: Vec<System>,
    /// Number of agents.
    pub agents: usize,
    /// Wanted overlap.
    pub overlap: f64,
    /// Agents' frames.
    pub frames: FramesMode,
    /// Connect all agents by shared rooms.
    pub connect: bool,
    /// What recorded data gives to two visitors.
    pub replay: Replay,
    /// Metres between rooms.
    pub gap: f32,
    /// Loss and delay.
    pub link: LinkParams,
    /// Alignment.
    pub align: Params,
    /// Which truth counts.
    pub reading: truth::Reading,
    /// Local graphs.
    pub local: LocalParams<'a>,
    /// Threads for visits.
    pub threads: usize,
}

/// The rows of one scenario, domain and seed, and the files that let others recompute them.
#[derive(Clone, Debug)]
pub struct CellResult {
    /// One per system.
    pub rows: Vec<Value>,
    /// The truth entry.
    pub truth: Value,
    /// (path under the output folder, bytes).
    pub files: Vec<(String, Vec<u8>)>,
}

/// Local graphs of one seed: a visit that several scenarios or domains make is computed once.
/// Layout and agents' frames depend on the seed, so another seed needs another cache.
#[derive(Default)]
pub struct Cache {
    locals: BTreeMap<VisitKey, Local>,
}

/// Scan, pass, first frame, frame after the last, agent where frames differ.
type VisitKey = (String, u64, u32, u32, usize);

/// Runs the cells of one scenario and domain. `visited` is called after each computed visit.
///
/// # Errors
/// Parameters out of range, and what the data set or the pipeline refuses.
pub fn run_cell(
    data: &dyn Dataset,
    rooms: usize,
    scenario: Scenario,
    seed: u64,
    p: &RunParams<'_>,
    cache: &mut Cache,
    visited: &(dyn Fn(usize, usize) + Sync),
) -> Result<CellResult, Error> {
    let unknown = matches!(p.frames, FramesMode::Unknown | FramesMode::UnknownVisit);
    let plan = plan(
        data,
        &PlanParams {
            rooms,
            agents: p.agents,
            overlap: p.overlap,
            scenario,
            connect: p.connect || unknown,
            replay: p.replay,
            seed,
        },
    )?;
    let placements = layout::place(data, rooms, p.gap, seed)?;
    let agent_frames = AgentFrames::new(p.frames, seed);
    // Systems of one agent have one frame, and the oracle knows all of them: both work in the domain's, without drift.
    let mut modes = vec![p.frames];
    if p.frames != FramesMode::Shared && p.systems.iter().any(|s| !s.needs_frames()) {
        modes.push(FramesMode::Shared);
    }
    for &mode in &modes {
        compute_visits(data, &plan, &placements, &AgentFrames::new(mode, seed), p, cache, visited)?;
    }
    let of_mode = |mode: FramesMode| -> Vec<&Local> {
        plan.visits.iter().filter_map(|v| cache.locals.get(&key(v, mode))).collect()
    };
    let locals = of_mode(p.frames);
    let aligned = if modes.len() > 1 { of_mode(FramesMode::Shared) } else { locals.clone() };

    let mut seen = SeenScans::new();
    for (v, local) in plan.visits.iter().zip(&locals) {
        seen.entry(v.scan.clone()).and_modify(|s| s.add(&local.seen)).or_insert_with(|| local.seen.clone());
    }
    let truth =
        truth::build(data, &placements, &seen, scenario, p.reading, p.local.labels, p.local.vocabulary)?;
    let states = match scenario {
        Scenario::Scp => Vec::new(),
        Scenario::Ldcp => truth::states(data, &placements, &seen, p.local.labels, p.local.vocabulary)?,
    };
    let middles: Vec<Point3<f32>> = placements.iter().map(|r| r.bounds.centroid()).collect();
    let multi = MultiParams {
        align: p.align.clone(),
        link: p.link,
        frames: agent_frames,
        mode: p.frames,
        vocabulary: p.local.vocabulary,
        min_class: p.local.robot.graph.min_class,
        rooms: data.rooms(),
        middles: &middles,
        states: &states,
        seed,
        clocks: p.local.clocks,
    };
    let cell = Cell { plan: &plan, placements: &placements, truth: &truth, scenario, rooms, seed, p };
    cell.results(&locals, &aligned, &multi, seen.len())
}

fn key(v: &Visit, mode: FramesMode) -> VisitKey {
    // In shared frames a visit is the same whoever makes it.
    let who = if mode == FramesMode::Shared { 0 } else { v.agent * 100_000 + v.seq as usize + 1 };
    (v.scan.clone(), v.pass, v.frames.start, v.frames.end, who)
}

/// Computes what the cache lacks. Each worker runs a visit on one thread, so that thread CPU time is
/// the visit's own.
fn compute_visits(
    data: &dyn Dataset,
    plan: &Plan,
    placements: &[Placement],
    frames: &AgentFrames,
    p: &RunParams<'_>,
    cache: &mut Cache,
    visited: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), Error> {
    let mode = frames.mode();
    let missing: Vec<&Visit> =
        plan.visits.iter().filter(|v| !cache.locals.contains_key(&key(v, mode))).collect();
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    let failed = Mutex::new(None);
    let work = || {
        loop {
            let k = next.fetch_add(1, Ordering::Relaxed);
            let Some(&v) = missing.get(k) else { break };
            match one_visit(data, v, placements, frames, p) {
                Ok(local) => lock(&done).push((key(v, mode), local)),
                Err(e) => {
                    next.store(missing.len(), Ordering::Relaxed);
                    lock(&failed).get_or_insert(e);
                }
            }
            visited(lock(&done).len(), missing.len());
        }
    };
    std::thread::scope(|s| {
        for _ in 0..p.threads.clamp(1, 64) {
            s.spawn(|| match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
                Ok(pool) => pool.install(work),
                Err(_) => work(),
            });
        }
    });
    if let Some(e) = lock(&failed).take() {
        return Err(e);
    }
    cache.locals.extend(lock(&done).drain(..));
    Ok(())
}

/// A poisoned lock means that a worker panicked; what was stored before is whole.
fn lock<T>(m: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    m.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn one_visit(
    data: &dyn Dataset,
    v: &Visit,
    placements: &[Placement],
    frames: &AgentFrames,
    p: &RunParams<'_>,
) -> Result<Local, Error> {
    let surface = Surface::new(data.annotation(&v.scan)?);
    let reference_from_scan = truth::reference_from(&data.rooms()[v.room], v.round)?;
    let domain_from_scan = placements[v.room].domain_from_reference * reference_from_scan;
    run_visit(data, v, &surface, &domain_from_scan, frames, &p.local)
}

struct Cell<'a> {
    plan: &'a Plan,
    placements: &'a [Placement],
    truth: &'a Truth,
    scenario: Scenario,
    rooms: usize,
    seed: u64,
    p: &'a RunParams<'a>,
}

impl Cell<'_> {
    fn results(
        &self,
        locals: &[&Local],
        aligned: &[&Local],
        multi: &MultiParams<'_>,
        scans: usize,
    ) -> Result<CellResult, Error> {
        let vocabulary = self.p.local.vocabulary;
        let single_frames: u64 =
            self.plan.visits.iter().filter(|v| v.pass == 0).map(|v| u64::from(v.len())).sum();
        let mut out = CellResult { rows: Vec::new(), truth: Value::Null, files: Vec::new() };
        for &system in &self.p.systems {
            let locals = if system.needs_frames() { locals } else { aligned };
            let made = if system.is_multi_agent() {
                multi_agent(system, self.plan, locals, multi)?
            } else {
                single_agent(system, self.plan, locals)
            };
            let measured = measure(self.truth, &made.graph, self.placements);
            let bytes = to_bytes(&json!(GraphFile::of_graph(&made.graph, vocabulary)))?;
            let hash = hex(&Sha256::digest(&bytes));
            out.rows.push(self.row(system, &made, &measured, single_frames, &hash));
            let stem = format!("{}-{}-{}-{}", system.name(), self.scenario.name(), self.rooms, self.seed);
            out.files.push((format!("graphs/{stem}.json"), bytes));
            if let Some(e) = &made.exchange {
                let frame = |f: &Vec<u8>| [(f.len() as u32).to_le_bytes().to_vec(), f.clone()].concat();
                out.files.push((format!("wire/{stem}.bin"), e.wire.iter().flat_map(frame).collect()));
            }
        }
        let frames = self.plan.visits.iter().map(|v| u64::from(v.len())).sum();
        out.truth = truth_entry(&self.name(""), scans, frames, &self.truth.counts);
        let path = format!("truth/{}-{}-{}.json", self.scenario.name(), self.rooms, self.seed);
        out.files.push((path, to_bytes(&truth_file(self.truth, vocabulary))?));
        Ok(out)
    }

    fn name<'n>(&self, system: &'n str) -> CellName<'n> {
        CellName { system, scenario: self.scenario.name(), domain: self.rooms, seed: self.seed }
    }

    fn row(&self, system: System, made: &Made, m: &Measured, single_frames: u64, hash: &str) -> Value {
        let setting = CellSetting {
            agents: if system.is_multi_agent() { self.plan.agents } else { 1 },
            overlap_measured: self.plan.overlap_measured,
            frames_mode: self.p.frames.name(),
            bound: single_frames as f64 / made.frames_max_agent.max(1) as f64,
        };
        let mut row = row(&self.name(system.name()), &setting, made, m, hash);
        let vocabulary = self.p.local.vocabulary;
        let classes: Vec<Value> = m
            .per_class
            .iter()
            .map(|(l, tp, n)| json!({"class": vocabulary.label_name(*l), "tp": tp, "of": n}))
            .collect();
        let predicates: Vec<Value> = m
            .per_predicate
            .iter()
            .map(|(p, tp, n)| json!({"predicate": vocabulary.predicate_name(*p), "tp": tp, "of": n}))
            .collect();
        row["per_class"] = json!(classes);
        row["per_predicate"] = json!(predicates);
        row
    }
}

fn truth_file(truth: &Truth, vocabulary: &Vocabulary) -> Value {
    let nodes: Vec<Value> = truth
        .nodes
        .iter()
        .map(|n| {
            json!({
                "id": n.id,
                "label": n.label.map_or(n.raw.as_str(), |l| vocabulary.label_name(l)),
                "centroid": [n.bounds.centroid().x, n.bounds.centroid().y, n.bounds.centroid().z],
                "extent": [n.bounds.extent().x, n.bounds.extent().y, n.bounds.extent().z],
                "room": n.room,
                "ignore": n.ignore,
            })
        })
        .collect();
    let edges: Vec<Value> = truth
        .edges
        .iter()
        .map(|(s, t, p)| json!({"s": s, "t": t, "p": vocabulary.predicate_name(*p)}))
        .collect();
    json!({"schema": "ma3dsg-truth/1", "nodes": nodes, "edges": edges})
}

fn to_bytes(v: &Value) -> Result<Vec<u8>, Error> {
    serde_json::to_vec(v).map_err(|e| Error::Pipeline(format!("JSON: {e}")))
}

/// Lower-case hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With `--replay halves` a shared scan is seen in parts: a part is no whole.
    #[test]
    fn visits_of_different_frames_are_different() {
        let visit = |frames| Visit {
            agent: 1,
            room: 0,
            scan: "a".to_owned(),
            round: 0,
            pass: 0,
            frames,
            start: 0.0,
            seq: 0,
        };
        let of = |v: &Visit| key(v, FramesMode::Shared);
        assert_eq!(of(&visit(0..60)), of(&Visit { agent: 2, seq: 3, ..visit(0..60) }));
        assert_ne!(of(&visit(0..60)), of(&visit(0..100)));
        assert_ne!(of(&visit(0..60)), of(&visit(40..60)));
        let own = |v: &Visit| key(v, FramesMode::Unknown);
        assert_ne!(own(&visit(0..60)), own(&Visit { agent: 2, ..visit(0..60) }));
    }
}
