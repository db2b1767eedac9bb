//! Bugs planted in graph-align, one at a time: a test that no bug can fail is no test.

use crate::cargo;
use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Applies every patch of `crates/graph-align/planted` to a copy of the last commit and runs the crate's tests;
/// each has to fail. Without a patch they have to pass.
pub(crate) fn run() -> Result<ExitCode> {
    let target = PathBuf::from(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    let copy = target.join("planted");
    if copy.exists() {
        std::fs::remove_dir_all(&copy).with_context(|| format!("{}", copy.display()))?;
    }
    git(Path::new("."), &["clone", "--quiet", "--no-hardlinks", ".", &copy.to_string_lossy()])?;
    let copy = copy.canonicalize().context("copy")?;
    let build = copy.join("target");
    if !passes(&copy, &build)? {
        bail!("the tests of graph-align fail without any planted bug");
    }
    let mut patches: Vec<PathBuf> = std::fs::read_dir("crates/graph-align/planted")
        .context("crates/graph-align/planted")?
        .map(|e| Ok(e?.path().canonicalize()?))
        .collect::<Result<_>>()?;
    patches.sort();
    let mut missed = 0;
    for patch in &patches {
        let name = patch.file_stem().and_then(|n| n.to_str()).unwrap_or("?");
        git(&copy, &["apply", &patch.to_string_lossy()])
            .with_context(|| format!("{name}: does not apply"))?;
        let caught = !passes(&copy, &build)?;
        git(&copy, &["checkout", "--quiet", "."])?;
        missed += usize::from(!caught);
        eprintln!("{name}: {}", if caught { "caught" } else { "NOT CAUGHT" });
    }
    eprintln!("{} planted bugs, {} caught", patches.len(), patches.len() - missed);
    Ok(ExitCode::from(u8::from(missed > 0)))
}

fn git(dir: &Path, args: &[&str]) -> Result<()> {
    let out = Command::new("git").current_dir(dir).args(args).output().context("git")?;
    if !out.status.success() {
        bail!("git {}: {}", args.join(" "), String::from_utf8_lossy(&out.stderr));
    }
    Ok(())
}

/// Whether the tests pass. A patch that does not compile is an error: it tests nothing.
fn passes(copy: &Path, build: &Path) -> Result<bool> {
    let run = |args: &[&str]| {
        cargo(args).current_dir(copy).env("CARGO_TARGET_DIR", build).output().context("cargo test")
    };
    let built = run(&["test", "-p", "graph-align", "--tests", "--no-run"])?;
    if !built.status.success() {
        bail!("does not compile: {}", String::from_utf8_lossy(&built.stderr));
    }
    Ok(run(&["test", "-p", "graph-align", "--tests"])?.status.success())
}
