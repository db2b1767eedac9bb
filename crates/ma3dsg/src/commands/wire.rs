//! `ma3dsg encode`, `decode` and `fold`: graphs as the frames in which they travel.

use super::say;
use crate::{files, pipeline};
use anyhow::{Context, Result, bail};
use graph_align::json::GraphFile;
use graph_align::{Key, Observation, Params, Replica, RobustParams, Vocabulary, wire};
use scan3r::LabelSet;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct EncodeArgs {
    /// Graph file (ma3dsg-graph/1) of the l20 or l160 label set.
    graph: PathBuf,
    /// The frame.
    #[arg(short, long, value_name = "FRAME")]
    out: PathBuf,
    /// Who saw it.
    #[arg(long, default_value_t = 0)]
    agent: u16,
    /// Number of the observation.
    #[arg(long, default_value_t = 0)]
    seq: u32,
    /// Start of the visit, tenths of a second; its end is the latest `last_seen`.
    #[arg(long, default_value_t = 0)]
    start: u32,
    /// Coordinate frame; graphs of one number need no search to be laid together.
    #[arg(long, default_value_t = 0)]
    frame: u32,
    /// A frame that the receiver has: write only what changed since.
    #[arg(long, value_name = "FRAME")]
    since: Option<PathBuf>,
}

#[derive(clap::Args)]
pub(crate) struct DecodeArgs {
    /// The frame.
    frame: PathBuf,
    /// The frame that it was written against with `encode --since`.
    #[arg(long, value_name = "FRAME")]
    since: Option<PathBuf>,
    /// Graph file.
    #[arg(short, long, value_name = "GRAPH")]
    out: PathBuf,
}

#[derive(clap::Args)]
pub(crate) struct FoldArgs {
    /// Frames, or files of frames each behind its length (u32, little-endian) as `bench` writes them.
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// Leave out what this agent saw.
    #[arg(long, value_name = "AGENT")]
    without: Option<u16>,
    /// Nodes below this probability of their class, and those without one, are left out.
    #[arg(long, default_value_t = pipeline::MIN_CLASS)]
    min_class: f32,
    /// A parameter of the robust algorithm, for example slack=0.2; may be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    robust: Vec<String>,
    /// Print JSON, with the graph of the largest component.
    #[arg(long)]
    json: bool,
    /// Graph file of the largest component.
    #[arg(short, long, value_name = "GRAPH")]
    out: Option<PathBuf>,
}

/// The label sets whose vocabularies frames are written in.
fn vocabularies() -> Result<Vec<Vocabulary>> {
    Ok(vec![pipeline::vocabulary(LabelSet::L20)?, pipeline::vocabulary(LabelSet::L160)?])
}

impl EncodeArgs {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let file = GraphFile::parse(&files::read_text(&self.graph)?)
            .with_context(|| format!("{}", self.graph.display()))?;
        for known in vocabularies()? {
            // Names that are not in it would be added.
            let mut vocabulary = known.clone();
            let graph =
                file.to_graph(&mut vocabulary).with_context(|| format!("{}", self.graph.display()))?;
            if vocabulary != known {
                continue;
            }
            let end = graph.nodes().map(|n| n.last_seen).fold(f64::from(self.start) / 10.0, f64::max);
            let o = Observation {
                key: Key { start_ds: self.start, agent: self.agent, epoch: 0, seq: self.seq },
                end_ds: (end * 10.0).round() as u32,
                frame: self.frame,
                graph,
                looked: None,
            };
            let bytes = match &self.since {
                None => wire::encode(&o, &known)?,
                Some(path) => {
                    let (base, _) = decode(&files::read(path)?, path)?;
                    wire::encode_delta(&base, &o, &known)?
                }
            };
            say(format!("{} nodes, {} edges, {} bytes", o.graph.len(), o.graph.edges().len(), bytes.len()));
            files::write(&self.out, &bytes)?;
            return Ok(ExitCode::SUCCESS);
        }
        bail!("{}: has names that are neither in l20 nor in l160", self.graph.display());
    }
}

/// A frame and the vocabulary that it was written with.
fn decode(bytes: &[u8], path: &Path) -> Result<(Observation, Vocabulary)> {
    let mut first = None;
    for v in vocabularies()? {
        match wire::decode(bytes, &v) {
            Ok(o) => return Ok((o, v)),
            Err(e) => first = first.or(Some(e)),
        }
    }
    match first {
        Some(e) => Err(e).with_context(|| format!("{}", path.display())),
        None => bail!("no vocabulary"),
    }
}

impl DecodeArgs {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let bytes = files::read(&self.frame)?;
        let (o, vocabulary) = match &self.since {
            None => decode(&bytes, &self.frame)?,
            Some(path) => {
                let (base, vocabulary) = decode(&files::read(path)?, path)?;
                let o = wire::decode_delta(&bytes, &base, &vocabulary)
                    .with_context(|| format!("{}", self.frame.display()))?;
                (o, vocabulary)
            }
        };
        let mut file = GraphFile::of_graph(&o.graph, &vocabulary);
        file.provenance = json!({
            "agent": o.key.agent, "epoch": o.key.epoch, "seq": o.key.seq,
            "start_s": f64::from(o.key.start_ds) / 10.0, "end_s": f64::from(o.end_ds) / 10.0, "frame": o.frame,
        });
        files::write(&self.out, &serde_json::to_vec_pretty(&file)?)?;
        say(format!("{} nodes, {} edges", o.graph.len(), o.graph.edges().len()));
        Ok(ExitCode::SUCCESS)
    }
}

impl FoldArgs {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let mut replica = Replica::default();
        let mut vocabulary = None;
        for path in &self.frames {
            let bytes = files::read(path)?;
            for frame in wire::split(&bytes).with_context(|| format!("{}", path.display()))? {
                let (o, v) = decode(frame, path)?;
                if vocabulary.get_or_insert_with(|| v.clone()) != &v {
                    bail!("{}: another label set than the frames before it", path.display());
                }
                if Some(o.key.agent) != self.without {
                    replica.apply(o).with_context(|| format!("{}", path.display()))?;
                }
            }
        }
        let vocabulary = vocabulary.unwrap_or_default();
        let mut state = Sha256::new();
        for o in replica.observations() {
            state.update(wire::encode(o, &vocabulary)?);
        }
        let state = bench_3rscan::run::hex(&state.finalize());
        let mut params = Params { robust: RobustParams::for_vocabulary(&vocabulary), ..Params::default() };
        params.robust.named = self.min_class;
        pipeline::set_robust(&mut params.robust, &self.robust)?;
        let folded = replica.fold(&params);
        let named = folded.main_graph().named(vocabulary.find_label(agent::NONE), self.min_class);
        let mut file = GraphFile::of_graph(&named, &vocabulary);
        file.provenance = json!({"observations": replica.observations().len(), "state_hash": state});
        if self.json {
            let v = json!({
                "state_hash": state, "observations": replica.observations().len(),
                "components": folded.components.len(), "graph": file,
            });
            say(serde_json::to_string_pretty(&v)?);
        } else {
            say(format!(
                "state {state}\n{} observations, {} components, {} nodes, {} edges in the largest",
                replica.observations().len(),
                folded.components.len(),
                file.nodes.len(),
                file.edges.len()
            ));
        }
        if let Some(out) = &self.out {
            files::write(out, &serde_json::to_vec_pretty(&file)?)?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
