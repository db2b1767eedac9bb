//! `ma3dsg merge A B [C …]`: graph files folded in the order given.

use super::say;
use crate::{files, pipeline};
use anyhow::{Context, Result};
use graph_align::json::{GraphFile, pairs_line, row_major};
use graph_align::{Outcome, Params, Query, RobustParams, Vocabulary, Why, align, update};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Graph files; the result is in the first one's frame.
    #[arg(required = true, num_args = 2..)]
    graphs: Vec<PathBuf>,
    /// Merged graph file.
    #[arg(short, long, value_name = "OUT")]
    out: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// The files share one frame up to drift: only its surroundings are searched.
    #[arg(long)]
    shared_frame: bool,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let mut vocabulary = Vocabulary::default();
        // Every node of the files is named; landmarks are when they become as sure as those.
        let mut least = pipeline::MIN_CLASS;
        let mut loaded = Vec::new();
        for path in &self.graphs {
            let mut read = || -> Result<_> {
                let file = GraphFile::parse(&files::read_text(path)?)?;
                let graph = file.to_graph_with_landmarks(&mut vocabulary)?;
                least = file.nodes.iter().map(|n| n.score).fold(least, f32::min);
                Ok((graph, file.gravity_aligned.unwrap_or(true), file.provenance))
            };
            loaded.push(read().with_context(|| format!("{}", path.display()))?);
        }
        let mut params = Params { robust: RobustParams::for_vocabulary(&vocabulary), ..Params::default() };
        params.robust.named = least;
        let mut graph = loaded[0].0.clone();
        let mut merges = Vec::new();
        for (path, (query, up, _)) in self.graphs.iter().zip(&loaded).skip(1) {
            let prior = self.shared_frame.then(Isometry3::identity);
            let ask = Query { prior, gravity_aligned: *up && loaded[0].1, ..Query::new(query) };
            let mut outcome = align(&graph, &ask, &params);
            // What was found upright, but not well enough, is not looked for otherwise.
            let nowhere = |why| why != Why::Loose && why != Why::Mirrored;
            if ask.gravity_aligned && matches!(outcome, Outcome::NoMatch { why } if nowhere(why)) {
                // An estimated up may be wrong: any rotation then.
                outcome = align(&graph, &Query { gravity_aligned: false, ..ask }, &params);
            }
            if let Outcome::Match(_) = &outcome {
                graph = update(&graph, &ask, &outcome, &params);
            }
            let (text, value) = describe(&outcome);
            if !self.json {
                say(format!("{}: {text}", path.display()));
            }
            merges.push(json!({"file": path, "merge": value}));
        }
        let all = graph;
        let graph = all.named(params.robust.unnamed, least);
        let merged = merges.iter().filter(|m| m["merge"]["outcome"] == "match").count();
        let summary = format!(
            "{merged} of {} graphs merged: {} objects, {} relations",
            merges.len(),
            graph.len(),
            graph.edges().len()
        );
        if self.json {
            let v = json!({"merges": merges, "nodes": graph.len(), "edges": graph.edges().len()});
            say(serde_json::to_string_pretty(&v)?);
        } else {
            say(summary);
        }
        if let Some(out) = &self.out {
            let mut file = GraphFile::with_landmarks(&all, &vocabulary, params.robust.unnamed, least);
            file.gravity_aligned = Some(loaded[0].1);
            file.provenance = json!({
                "command": std::env::args().collect::<Vec<_>>().join(" "),
                "version": env!("CARGO_PKG_VERSION"),
                "inputs": loaded.iter().map(|l| &l.2).collect::<Vec<&Value>>(),
                "merges": merges,
            });
            files::write(out, &serde_json::to_vec_pretty(&file)?)?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn describe(outcome: &Outcome) -> (String, Value) {
    match outcome {
        Outcome::Match(m) => {
            let margin = m.margin.map_or("none computed".to_owned(), |m| m.to_string());
            let t = row_major(&m.reference_from_query);
            (
                format!(
                    "match, score {}, margin {margin}\n  T_a_b {t:?}\n  pairs (b-a) {}",
                    m.score,
                    pairs_line(m)
                ),
                json!({
                    "outcome": "match", "T_a_b": t, "score": m.score, "margin": m.margin,
                    "pairs": m.pairs.iter().map(|(q, r)| [q.0, r.0]).collect::<Vec<_>>(),
                }),
            )
        }
        Outcome::Ambiguous { candidates } => (
            format!("ambiguous, {} candidates: not merged", candidates.len()),
            json!({"outcome": "ambiguous", "candidates": candidates.iter().map(|c| row_major(&c.reference_from_query)).collect::<Vec<_>>()}),
        ),
        Outcome::NoMatch { why } => (
            format!("no match ({}): not merged", why.word()),
            json!({"outcome": "no_match", "why": why.word()}),
        ),
    }
}
