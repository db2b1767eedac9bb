//! The shipped weights, or a file of the user's.

use crate::files;
use anyhow::{Context, Result};
use bench_3rscan::run::hex;
use sgfn_infer::{Model, Store};
use sha2::{Digest, Sha256};
use std::path::Path;

/// Trained on generated rooms by `cargo xtask train`; see fixtures/weights/README.md.
const SHIPPED: &[u8] = include_bytes!("../../../fixtures/weights/sgfn-l20.safetensors");

/// A network and where it comes from.
pub(crate) struct Weights {
    pub(crate) model: Model,
    pub(crate) file: String,
    pub(crate) sha256: String,
    pub(crate) trained_on: String,
}

impl Weights {
    /// The shipped weights, or those of a file.
    pub(crate) fn load(path: Option<&Path>) -> Result<Self> {
        let (bytes, file) = match path {
            None => (SHIPPED.to_vec(), "shipped sgfn-l20".to_owned()),
            Some(p) => (files::read(p)?, p.display().to_string()),
        };
        let read = || -> Result<Self> {
            let store = Store::read(&bytes)?;
            let trained_on =
                store.metadata("trained_on").unwrap_or("unknown (the file does not say)").to_owned();
            let sha256 = hex(&Sha256::digest(&bytes));
            Ok(Self { model: Model::from_store(&store)?, file: file.clone(), sha256, trained_on })
        };
        read().with_context(|| file.clone())
    }

    /// For a file's provenance.
    pub(crate) fn provenance(&self) -> serde_json::Value {
        serde_json::json!({"file": self.file, "sha256": self.sha256, "trained_on": self.trained_on})
    }
}
