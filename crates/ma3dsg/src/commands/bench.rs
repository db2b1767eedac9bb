//! `ma3dsg bench`: scenarios x domains x seeds x systems, and the report.

use super::say;
use crate::pipeline::{self, Quality};
use crate::progress::Progress;
use crate::weights::Weights;
use crate::{clock, files};
use agent::RobotParams;
use anyhow::{Context, Result, bail};
use bench_3rscan::render::{html, markdown};
use bench_3rscan::report::{Provenance, SCHEMA, summary};
use bench_3rscan::run::{Cache, RunParams, run_cell};
use bench_3rscan::scenario::{FramesMode, Replay, Scenario};
use bench_3rscan::systems::{Clocks, LocalParams, System, Variant};
use bench_3rscan::truth::Reading;
use fleet::LinkParams;
use graph_align::{PaperParams, Params};
use room_synth::{Split, World, WorldParams};
use scan3r::{Dataset, Folder, LabelSet, RoomEntry};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Number of rooms; a list runs one domain after the other.
    #[arg(long, value_delimiter = ',', default_value = "5")]
    domain: Vec<usize>,
    /// scp (static), ldcp (long-term dynamic) or both.
    #[arg(long, default_value = "both", value_parser = ["scp", "ldcp", "both"])]
    scenario: String,
    /// Systems, or all.
    #[arg(long, value_delimiter = ',', default_value = "all")]
    systems: Vec<String>,
    /// Number of agents.
    #[arg(long, default_value_t = 5)]
    agents: usize,
    /// Share of visits to rooms that two agents see.
    #[arg(long, default_value_t = 0.2)]
    overlap: f64,
    /// shared, drift, unknown or unknown-visit.
    #[arg(long, default_value = "shared")]
    frames: String,
    /// Add shared rooms until all agents are connected (always on for unknown frames).
    #[arg(long)]
    connect: bool,
    /// Label set.
    #[arg(long, default_value = "l20")]
    labels: String,
    /// How truth accumulates over the scans of a room.
    #[arg(long, default_value = "accumulated", value_parser = ["accumulated", "last-scan", "reference-minus-removed"])]
    truth: String,
    /// When graphs are published: at the end of a visit (`visit`), or every so many seconds of it as what
    /// changed, and at its end.
    #[arg(long, value_name = "visit|SECONDS", default_value = "visit")]
    publish: String,
    /// What recorded data gives to two visitors of a scan.
    #[arg(long, default_value = "halves", value_parser = ["halves", "same"])]
    replay: String,
    /// Delay of observations, seconds.
    #[arg(long, default_value_t = 0.0)]
    delay: f64,
    /// Probability that a receiver misses an observation.
    #[arg(long, default_value_t = 0.0)]
    loss: f64,
    /// Metres between rooms.
    #[arg(long, default_value_t = 3.0)]
    gap: f32,
    /// theta_dis of the paper's algorithm, metres.
    #[arg(long)]
    theta_dis: Option<f32>,
    /// theta_len of the paper's algorithm.
    #[arg(long)]
    theta_len: Option<usize>,
    /// theta_bbox of the paper's algorithm.
    #[arg(long)]
    theta_bbox: Option<f32>,
    /// Reading of the paper's pseudo-code.
    #[arg(long, default_value = "default")]
    reading: String,
    /// Which rooms: of generated ones test, or validation for tuning; of 3RScan those of that `type` in `3RScan.json`,
    /// validation if it is not said: the 47 on which 3DSSG, SGFN and the paper test. A folder written by `synth` is taken
    /// whole.
    #[arg(long, value_parser = ["train", "validation", "test"])]
    split: Option<String>,
    /// A node needs this probability of its class.
    #[arg(long)]
    min_class: Option<f32>,
    /// An edge needs this probability of its predicate.
    #[arg(long)]
    min_predicate: Option<f32>,
    /// Segments join above this probability of `same part`.
    #[arg(long)]
    min_same_part: Option<f32>,
    /// First seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of seeds, counted up from the first.
    #[arg(long, default_value_t = 1)]
    seeds: u64,
    /// Folder of a 3RScan download or of a data set made by `ma3dsg synth`; without it rooms are
    /// generated.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Weights other than the shipped ones.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Folder for report, graphs, truth and frames.
    #[arg(long, value_name = "DIR", default_value = "runs/bench")]
    out: PathBuf,
    /// Compute only cell I, I + N, ... of the list (I from 0).
    #[arg(long, value_name = "I/N")]
    shard: Option<String>,
    /// Keep cells that an earlier run with the same parameters has left in the folder.
    #[arg(long)]
    resume: bool,
}

/// What the weights name has to be of the label set: all of it, without `none` and `same part` where they know none.
fn fit(weights: &Weights, labels: LabelSet) -> Result<()> {
    let (classes, predicates) = bench_3rscan::samples::output_names(labels);
    let c = weights.model.config();
    for (what, own, set) in
        [("class", &c.class_names, &classes), ("predicate", &c.predicate_names, &predicates)]
    {
        if own.is_empty() {
            bail!("{}: no metadata {what}_names: see docs/bring-3rscan.md", weights.file);
        }
        if let Some(other) = own.iter().find(|n| !set.contains(n)) {
            bail!("--labels {}: the weights ({}) name the {what} {other:?}", labels.name(), weights.file);
        }
        let must = |n: &&String| ![agent::NONE, agent::SAME_PART].contains(&n.as_str());
        if let Some(lacking) = set.iter().filter(must).find(|n| !own.contains(n)) {
            bail!("--labels {}: the weights ({}) lack the {what} {lacking:?}", labels.name(), weights.file);
        }
    }
    Ok(())
}

/// The splits of some rooms, each once.
fn splits(rooms: &[RoomEntry]) -> String {
    let all: BTreeSet<&str> = rooms.iter().map(|r| r.split.as_str()).collect();
    all.into_iter().collect::<Vec<_>>().join(" and ")
}

struct CellSpec {
    seed: u64,
    scenario: Scenario,
    rooms: usize,
}

impl CellSpec {
    fn stem(&self) -> String {
        format!("{}-{}-{}", self.scenario.name(), self.rooms, self.seed)
    }
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let weights = Weights::load(self.weights.as_deref())?;
        let Some(labels) = LabelSet::parse(&self.labels) else {
            bail!("--labels {:?}, want l20 or l160", self.labels);
        };
        fit(&weights, labels)?;
        let cells = self.cells()?;
        let mine = self.mine(cells.len())?;
        let params = self.params(&weights);
        let mut missing = 0;
        let mut stored = Vec::new();
        let mut world: Option<(u64, Box<dyn Dataset>, Cache)> = None;
        for (k, cell) in cells.iter().enumerate() {
            let path = self.out.join("cells").join(format!("{}.json", cell.stem()));
            if let Some(found) = self.resumed(&path, &params)? {
                stored.push(found);
                continue;
            }
            if !mine(k) {
                missing += 1;
                continue;
            }
            if world.as_ref().is_none_or(|w| w.0 != cell.seed) {
                world = Some((cell.seed, self.dataset(cell.seed)?, Cache::default()));
            }
            let Some((_, data, cache)) = &mut world else { bail!("no data set") };
            stored.push(self.compute(cell, data.as_ref(), cache, &weights, labels, &params, &path)?);
        }
        self.report(&stored, &weights, &params)?;
        if missing > 0 {
            eprintln!("{missing} of {} cells are missing (other shards compute them)", cells.len());
            return Ok(ExitCode::from(2));
        }
        Ok(ExitCode::SUCCESS)
    }

    fn cells(&self) -> Result<Vec<CellSpec>> {
        if let Some(bad) = self.domain.iter().find(|n| **n == 0) {
            bail!("--domain {bad}, want at least one room");
        }
        let scenarios = match self.scenario.as_str() {
            "scp" => vec![Scenario::Scp],
            "ldcp" => vec![Scenario::Ldcp],
            _ => vec![Scenario::Scp, Scenario::Ldcp],
        };
        let mut out = Vec::new();
        for seed in self.seed..self.seed.saturating_add(self.seeds.max(1)) {
            for &rooms in &self.domain {
                out.extend(scenarios.iter().map(|&scenario| CellSpec { seed, scenario, rooms }));
            }
        }
        Ok(out)
    }

    fn mine(&self, cells: usize) -> Result<impl Fn(usize) -> bool + use<>> {
        let (i, n) = match &self.shard {
            None => (0, 1),
            Some(s) => s
                .split_once('/')
                .and_then(|(i, n)| Some((i.parse::<usize>().ok()?, n.parse::<usize>().ok()?)))
                .filter(|(i, n)| *n > 0 && i < n)
                .with_context(|| format!("--shard {s:?}, want I/N with I below N"))?,
        };
        Ok(move |k: usize| k < cells && k % n == i)
    }

    fn dataset(&self, seed: u64) -> Result<Box<dyn Dataset>> {
        let rooms = self.domain.iter().copied().max().unwrap_or(1);
        Ok(match &self.data {
            Some(dir) => {
                let folder = Folder::open(dir)?;
                let usual = (folder.kind() == "3rscan").then_some("validation");
                Box::new(match self.split.as_deref().or(usual) {
                    Some(split) => folder.of_split(split).context("--split says which rooms are taken")?,
                    None => folder,
                })
            }
            None => {
                let split = Split::parse(self.split.as_deref().unwrap_or("test")).context("--split")?;
                Box::new(World::new(split, seed, rooms, &WorldParams::default()))
            }
        })
    }

    fn systems(&self) -> Result<Vec<System>> {
        if self.systems.iter().any(|s| s == "all") {
            return Ok(System::ALL.to_vec());
        }
        let parse = |s: &String| {
            let known = System::ALL.map(System::name).join(", ");
            System::parse(s).with_context(|| format!("--systems {s:?}, want some of {known}"))
        };
        self.systems.iter().map(parse).collect()
    }

    fn align(&self) -> Result<Params> {
        let Some(mut paper) = PaperParams::reading(&self.reading) else {
            bail!("--reading {:?}, want one of {}", self.reading, PaperParams::READINGS.join(", "));
        };
        paper.theta_dis = self.theta_dis.unwrap_or(paper.theta_dis);
        paper.theta_len = self.theta_len.unwrap_or(paper.theta_len);
        paper.theta_bbox = self.theta_bbox.unwrap_or(paper.theta_bbox);
        Ok(Params { paper, seed: self.seed, ..Params::default() })
    }

    fn robot(&self) -> RobotParams {
        let mut robot = pipeline::robot(Quality::Bench);
        robot.segmentation = pipeline::segmentation(gsm::Profile::TofPhone);
        robot.graph.min_class = self.min_class.unwrap_or(robot.graph.min_class);
        robot.graph.min_predicate = self.min_predicate.unwrap_or(robot.graph.min_predicate);
        robot.graph.min_same_part = self.min_same_part.unwrap_or(robot.graph.min_same_part);
        robot
    }

    /// Seconds between revisions, at least that of a frame.
    fn publish_s(&self) -> Result<Option<f64>> {
        if self.publish == "visit" {
            return Ok(None);
        }
        let seconds = self.publish.parse::<f64>().ok().filter(|s| (0.2..=86_400.0).contains(s));
        match seconds {
            Some(s) => Ok(Some(s)),
            None => bail!("--publish {:?}, want visit or 0.2 to 86,400 seconds", self.publish),
        }
    }

    /// Everything that decides about numbers, for the report and for `--resume`.
    fn params(&self, weights: &Weights) -> Value {
        json!({
            "systems": self.systems, "agents": self.agents, "overlap": self.overlap, "frames": self.frames,
            "connect": self.connect, "labels": self.labels, "truth": self.truth, "publish": self.publish,
            "replay": self.replay, "delay": self.delay, "loss": self.loss, "gap": self.gap,
            "theta_dis": self.theta_dis, "theta_len": self.theta_len, "theta_bbox": self.theta_bbox,
            "reading": self.reading, "split": self.split, "min_class": self.min_class,
            "min_predicate": self.min_predicate, "min_same_part": self.min_same_part, "data": self.data, "weights": weights.sha256,
            "version": env!("CARGO_PKG_VERSION"),
        })
    }

    fn resumed(&self, path: &Path, params: &Value) -> Result<Option<Value>> {
        if !self.resume || !path.is_file() {
            return Ok(None);
        }
        let cell: Value =
            serde_json::from_str(&files::read_text(path)?).with_context(|| format!("{}", path.display()))?;
        Ok((cell["params"] == *params).then_some(cell))
    }

    #[expect(clippy::too_many_arguments, reason = "one call, all of them needed")]
    fn compute(
        &self,
        cell: &CellSpec,
        data: &dyn Dataset,
        cache: &mut Cache,
        weights: &Weights,
        labels: LabelSet,
        params: &Value,
        path: &Path,
    ) -> Result<Value> {
        let Some(frames) = FramesMode::parse(&self.frames) else {
            bail!("--frames {:?}, want shared, drift, unknown or unknown-visit", self.frames);
        };
        if !(0.0..=1.0).contains(&self.loss) || !(0.0..=86_400.0).contains(&self.delay) {
            bail!("--loss {} --delay {}, want 0 to 1 and 0 to 86,400 s", self.loss, self.delay);
        }
        let Some(reading) = Reading::parse(&self.truth) else {
            bail!("--truth {:?}, want one of {}", self.truth, Reading::ALL.map(Reading::name).join(", "));
        };
        let vocabulary = pipeline::vocabulary(labels)?;
        let systems = self.systems()?;
        let mut variants: Vec<Variant> = systems.iter().map(|s| s.variant()).collect();
        variants.sort_unstable();
        variants.dedup();
        let run = RunParams {
            agents: self.agents,
            overlap: self.overlap,
            frames,
            connect: self.connect,
            replay: if self.replay == "same" { Replay::Same } else { Replay::Halves },
            gap: self.gap,
            link: LinkParams { loss: self.loss, delay_ds: (self.delay * 10.0).round() as u32 },
            align: self.align()?,
            reading,
            local: LocalParams {
                publish_s: self.publish_s()?,
                robot: self.robot(),
                model: &weights.model,
                labels,
                vocabulary: &vocabulary,
                variants,
                clocks: Clocks { cpu: clock::thread_cpu_seconds, wall: clock::wall_seconds },
            },
            threads: rayon::current_num_threads(),
            systems,
        };
        eprintln!("cell {}", cell.stem());
        let progress = std::sync::OnceLock::new();
        let visited = |_done: usize, of: usize| {
            progress.get_or_init(|| Progress::new("visits", of as u64)).step();
        };
        let result = run_cell(data, cell.rooms, cell.scenario, cell.seed, &run, cache, &visited)?;
        for (name, bytes) in &result.files {
            files::write(&self.out.join(name), bytes)?;
        }
        let value = json!({"params": params, "rows": result.rows, "truth": result.truth, "kind": data.kind(),
                "split": splits(&data.rooms()[..cell.rooms])});
        files::write(path, &serde_json::to_vec(&value)?)?;
        Ok(value)
    }

    fn report(&self, cells: &[Value], weights: &Weights, params: &Value) -> Result<()> {
        let rows: Vec<Value> =
            cells.iter().flat_map(|c| c["rows"].as_array().into_iter().flatten()).cloned().collect();
        let truth: Vec<&Value> = cells.iter().map(|c| &c["truth"]).collect();
        let seeds: Vec<u64> = (self.seed..self.seed.saturating_add(self.seeds.max(1))).collect();
        let of = |what: &str| cells.first().map_or(json!("none"), |c| c[what].clone());
        let provenance = Provenance {
            command: std::env::args().collect::<Vec<_>>().join(" "),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            data: json!({"kind": of("kind"), "split": of("split"), "seeds": seeds, "labels": self.labels}),
            weights: weights.provenance(),
            machine: json!({"cpu": pipeline::cpu_name(), "threads": rayon::current_num_threads()}),
            params: params.clone(),
        };
        let report = json!({
            "schema": SCHEMA, "provenance": provenance, "truth": truth, "rows": rows, "summary": summary(&rows),
        });
        files::write(&self.out.join("report.json"), &serde_json::to_vec_pretty(&report)?)?;
        let text = markdown(&report);
        files::write(&self.out.join("report.md"), text.as_bytes())?;
        files::write(&self.out.join("report.html"), html(&report).as_bytes())?;
        say(&text);
        say(format!("written to {}", self.out.display()));
        Ok(())
    }
}
