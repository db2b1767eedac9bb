//! Everything that CI checks, in the order in which it is cheap to fail.

use crate::{api, arrows, cargo, must};
use anyhow::Result;
use std::process::ExitCode;

pub(crate) fn run() -> Result<ExitCode> {
    must("fmt", &mut cargo(&["fmt", "--all", "--check"]))?;
    must(
        "clippy",
        &mut cargo(&["clippy", "--quiet", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    )?;
    // Published alone: each feature on its own, too.
    for features in ["", "json", "wire"] {
        let only = format!("--features={features}");
        let args = ["clippy", "--quiet", "-p", "graph-align", "--no-default-features", &only];
        must(
            &format!("clippy, graph-align with features {features:?}"),
            cargo(&args).args(["--", "-D", "warnings"]),
        )?;
    }
    arrows::check()?;
    api::run(false)?;
    let nextest = cargo(&["nextest", "--version"]).output().is_ok_and(|o| o.status.success());
    if nextest {
        must("tests (nextest)", &mut cargo(&["nextest", "run", "--workspace", "--no-fail-fast"]))?;
    } else {
        must("tests", &mut cargo(&["test", "--workspace", "--lib", "--bins", "--tests"]))?;
    }
    must(
        "publish, dry run",
        &mut cargo(&["publish", "--quiet", "--dry-run", "--no-verify", "--allow-dirty", "-p", "graph-align"]),
    )?;
    must(
        "documentation",
        cargo(&["doc", "--quiet", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"),
    )?;
    must("doctests", &mut cargo(&["test", "--workspace", "--doc"]))?;
    Ok(ExitCode::SUCCESS)
}
