//! `ma3dsg align QUERY REFERENCE` and `ma3dsg align --cases DIR --json OUT`.

use super::say;
use crate::files;
use anyhow::{Context, Result, bail};
use graph_align::json::{Case, GraphFile, pairs_line};
use graph_align::paper::TransformReading;
use graph_align::{Algorithm, Outcome, PaperParams, Params, Query, RobustParams, Vocabulary, align};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Graph to be found (ma3dsg-graph/1).
    #[arg(required_unless_present = "cases")]
    query: Option<PathBuf>,
    /// Graph to find it in.
    #[arg(required_unless_present = "cases")]
    reference: Option<PathBuf>,
    /// Folder whose cases/*.json are solved.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["query", "reference"])]
    cases: Option<PathBuf>,
    /// Print JSON; with --cases the file to write.
    #[arg(long, value_name = "OUT", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    /// Which algorithm.
    #[arg(long, default_value = "robust", value_parser = ["robust", "paper"])]
    algorithm: String,
    /// How the gaps of the paper's pseudo-code are read: default, literal, labels, per-call, fit,
    /// near-same.
    #[arg(long, default_value = "fit")]
    reading: String,
    /// Seed of the random anchors.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let Some(mut paper) = PaperParams::reading(&self.reading) else {
            bail!("--reading {:?}, want one of {}", self.reading, PaperParams::READINGS.join(", "));
        };
        if self.cases.is_some() {
            // Cases have frames of their own, which the paper's shared frame cannot express.
            paper.transform = TransformReading::FitMap;
        }
        let algorithm = if self.algorithm == "paper" { Algorithm::Paper } else { Algorithm::Robust };
        let params = Params { algorithm, paper, seed: self.seed, ..Params::default() };
        match (&self.cases, &self.query, &self.reference) {
            (Some(dir), ..) => self.cases(dir, &params),
            (None, Some(q), Some(r)) => self.pair(q, r, &params),
            _ => bail!("want QUERY and REFERENCE, or --cases DIR"),
        }
    }

    fn cases(&self, dir: &Path, params: &Params) -> Result<ExitCode> {
        let files = files::list(&dir.join("cases"), "json")?;
        if files.is_empty() {
            bail!("{}: no case (*.json)", dir.join("cases").display());
        }
        let mut answers = Vec::new();
        for path in &files {
            let mut vocabulary = Vocabulary::default();
            let case = Case::parse(&files::read_text(path)?, &mut vocabulary)
                .with_context(|| format!("{}", path.display()))?;
            let query = Query {
                graph: &case.query,
                looked: case.looked.as_ref(),
                prior: case.prior,
                gravity_aligned: case.gravity_aligned,
            };
            let params = Params { robust: RobustParams::for_vocabulary(&vocabulary), ..params.clone() };
            let start = cpu_time::now();
            let outcome = align(&case.reference, &query, &params);
            answers.push(case.answer(&outcome, cpu_time::ms_since(start)));
        }
        let count = |word: &str| answers.iter().filter(|a| a["outcome"] == word).count();
        let summary = format!(
            "{} cases: {} match, {} ambiguous, {} no_match",
            answers.len(),
            count("match"),
            count("ambiguous"),
            count("no_match")
        );
        let text = serde_json::to_vec_pretty(&Value::Array(answers))?;
        match &self.json {
            Some(out) if out.as_os_str() != "-" => {
                files::write(out, &text)?;
                say(format!("{summary}; written to {}", out.display()));
            }
            _ => say(String::from_utf8_lossy(&text)),
        }
        Ok(ExitCode::SUCCESS)
    }

    fn pair(&self, query: &Path, reference: &Path, params: &Params) -> Result<ExitCode> {
        let mut vocabulary = Vocabulary::default();
        let mut load = |path: &Path| -> Result<_> {
            let mut read = || -> Result<_> {
                let file = GraphFile::parse(&files::read_text(path)?)?;
                let aligned = file.gravity_aligned.unwrap_or(true);
                Ok((file.to_graph(&mut vocabulary)?, aligned))
            };
            read().with_context(|| format!("{}", path.display()))
        };
        let ((query, up_q), (reference, up_r)) = (load(query)?, load(reference)?);
        let ask = Query { gravity_aligned: up_q && up_r, ..Query::new(&query) };
        let params = Params { robust: RobustParams::for_vocabulary(&vocabulary), ..params.clone() };
        let start = cpu_time::now();
        let outcome = align(&reference, &ask, &params);
        let ms = cpu_time::ms_since(start);
        if let Some(out) = &self.json {
            let case = Case {
                id: "pair".to_owned(),
                gravity_aligned: ask.gravity_aligned,
                query: query.clone(),
                reference,
                looked: None,
                prior: None,
            };
            let text = serde_json::to_string_pretty(&case.answer(&outcome, ms))?;
            match out.as_os_str() == "-" {
                true => say(text),
                false => files::write(out, text.as_bytes())?,
            }
            return Ok(ExitCode::SUCCESS);
        }
        match &outcome {
            Outcome::Match(m) => {
                say(format!("match: score {}, {} pairs", m.score, m.pairs.len()));
                say(format!("T_reference_query {:?}", graph_align::json::row_major(&m.reference_from_query)));
                say(format!("pairs (query-reference) {}", pairs_line(m)));
            }
            Outcome::Ambiguous { candidates } => say(format!("ambiguous: {} candidates", candidates.len())),
            Outcome::NoMatch { why } => say(format!("no match: {}", why.word())),
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// CPU time of this process, for the `ms` field of answers.
mod cpu_time {
    pub(super) use crate::clock::cpu_seconds as now;

    pub(super) fn ms_since(start: f64) -> f64 {
        (now() - start) * 1e3
    }
}
