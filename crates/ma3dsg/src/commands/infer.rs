//! `ma3dsg infer --golden DIR [--out DIR]`.

use super::say;
use crate::files;
use anyhow::{Context, Result, bail};
use sgfn_infer::{Model, Store, golden};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder with MODEL.weights.safetensors and MODEL.graph_CASE.safetensors.
    #[arg(long, value_name = "DIR")]
    golden: PathBuf,
    /// Where to write the comparison as golden.json.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let mut models: BTreeMap<String, Model> = BTreeMap::new();
        let (mut rows, mut wrong) = (Vec::new(), Vec::new());
        for path in files::list(&self.golden, "safetensors")? {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let Some((model, _)) = name.split_once(".graph_") else { continue };
            let named = |p: &std::path::Path| format!("{}", p.display());
            if !models.contains_key(model) {
                let weights = self.golden.join(format!("{model}.weights.safetensors"));
                let m = Model::from_safetensors(&files::read(&weights)?).with_context(|| named(&weights))?;
                models.insert(model.to_owned(), m);
            }
            let store = Store::read(&files::read(&path)?).with_context(|| named(&path))?;
            for c in golden::compare(&models[model], &store).with_context(|| named(&path))? {
                say(format!("{name} {} {:.3e}", c.tensor, c.max_abs_error));
                if !c.within {
                    wrong.push(format!("{name} {}", c.tensor));
                }
                rows.push(serde_json::json!({"file": name, "tensor": c.tensor, "max_abs_error": c.max_abs_error, "within": c.within}));
            }
        }
        if rows.is_empty() {
            bail!("{}: no golden file (<model>.graph_<case>.safetensors)", self.golden.display());
        }
        if let Some(dir) = &self.out {
            files::write(&dir.join("golden.json"), &serde_json::to_vec_pretty(&rows)?)?;
        }
        if wrong.is_empty() {
            say(format!("{} tensors agree within 1e-4 + 1e-5 |x| (probabilities 1e-5)", rows.len()));
            return Ok(ExitCode::SUCCESS);
        }
        for w in &wrong {
            eprintln!("out of tolerance: {w}");
        }
        Ok(ExitCode::FAILURE)
    }
}
