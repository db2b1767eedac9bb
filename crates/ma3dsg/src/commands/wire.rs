//! `ma3dsg encode`, `decode` and `fold`: graphs as the frames in which they travel.

use super::say;
use crate::{files, pipeline};
use anyhow::{Context, Result, bail};
use graph_align::json::GraphFile;
use graph_align::{Key, Observation, Params, Replica, RobustParams, Vocabulary, wire};
use scan3r::LabelSet;
use serde_json::json;
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
    /// Start of the visit, tenths of a second, by default its number; its end is the latest `last_seen`.
    /// Of several with the same agent and start the one with the highest number counts.
    #[arg(long)]
    start: Option<u32>,
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
        let start_ds = self.start.unwrap_or(self.seq);
        for known in vocabularies()? {
            // Names that are not in it would be added.
            let mut vocabulary = known.clone();
            let graph =
                file.to_graph(&mut vocabulary).with_context(|| format!("{}", self.graph.display()))?;
            if vocabulary != known {
                continue;
            }
            let end = graph.nodes().map(|n| n.last_seen).fold(f64::from(start_ds) / 10.0, f64::max);
            let o = Observation {
                key: Key { start_ds, agent: self.agent, epoch: 0, seq: self.seq },
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

/// The vocabulary that a frame was written with.
fn vocabulary_of(bytes: &[u8], path: &Path) -> Result<Vocabulary> {
    let mut first = None;
    for v in vocabularies()? {
        match wire::kind(bytes, &v) {
            Ok(_) => return Ok(v),
            Err(e) => first = first.or(Some(e)),
        }
    }
    Err(first.map_or_else(|| anyhow::anyhow!("no vocabulary"), Into::into))
        .with_context(|| format!("{}", path.display()))
}

/// What a frame says joins a replica; a delta needs its base in a frame before it.
fn take(replica: &mut Replica, bytes: &[u8], v: &Vocabulary) -> Result<()> {
    match wire::kind(bytes, v)? {
        wire::Kind::Retraction => drop(replica.retract(wire::decode_retraction(bytes, v)?)?),
        wire::Kind::Gone => replica.pass_over(wire::decode_gone(bytes, v)?)?,
        wire::Kind::Delta => {
            let key = wire::revision_of(bytes, v)?;
            match replica.revision_before(&key).map(|base| wire::decode_delta(bytes, base, v)) {
                Some(Ok(o)) => drop(replica.apply(o)?),
                Some(Err(_)) | None if replica.vector().contains(&key) => {}
                Some(Err(e)) => return Err(e.into()),
                None => bail!(
                    "a delta of agent {}, number {}, whose base is in no frame before it",
                    key.agent,
                    key.seq
                ),
            }
        }
        _ => drop(replica.apply(wire::decode(bytes, v)?)?),
    }
    Ok(())
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
        let mut vocabulary: Option<Vocabulary> = None;
        for path in &self.frames {
            let bytes = files::read(path)?;
            for frame in wire::split(&bytes).with_context(|| format!("{}", path.display()))? {
                let v = vocabulary_of(frame, path)?;
                if *vocabulary.get_or_insert_with(|| v.clone()) != v {
                    bail!("{}: another label set than the frames before it", path.display());
                }
                take(&mut replica, frame, &v).with_context(|| format!("{}", path.display()))?;
            }
        }
        if let Some(agent) = self.without {
            replica = replica.without(agent)?;
        }
        let vocabulary = vocabulary.unwrap_or_default();
        let state = bench_3rscan::run::hex(&replica.state_hash());
        let mut params = Params { robust: RobustParams::for_vocabulary(&vocabulary), ..Params::default() };
        params.robust.named = self.min_class;
        pipeline::set_robust(&mut params.robust, &self.robust)?;
        let folded = replica.fold(&params);
        let named = folded.main_graph().named(vocabulary.find_label(agent::NONE), self.min_class);
        let mut file = GraphFile::of_graph(&named, &vocabulary);
        file.provenance = json!({"observations": replica.len(), "state_hash": state});
        if self.json {
            let v = json!({
                "state_hash": state, "observations": replica.len(),
                "components": folded.components.len(), "graph": file,
            });
            say(serde_json::to_string_pretty(&v)?);
        } else {
            say(format!(
                "state {state}\n{} observations, {} components, {} nodes, {} edges in the largest",
                replica.len(),
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
