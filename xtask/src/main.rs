//! Development commands of this workspace. Thin: it links none of our crates and spawns cargo.

mod api;
mod arrows;
mod consumer;
mod planted;
mod test;
mod train;

use anyhow::{Context, Result, bail};
use std::process::{Command, ExitCode};

const HELP: &str = "cargo xtask COMMAND

  bench ARGS…   run the benchmark from a release build (see: cargo xtask bench --help)
  test          everything CI checks: fmt, clippy, arrows, tests, doctests, doc warnings
  train ARGS…   samples from generated rooms, training, weights (see: cargo xtask train --help)
  fuzz gsm|wire|align [--minutes M] [--seed N]
                mutated inputs, checked results; prints executions and behaviours
  consumer      package graph-align and run a program whose only dependency it is
  planted       plant bugs in graph-align, one at a time, and see its tests catch them
  api [--write] compare the public API of graph-align with crates/graph-align/api.txt, or write it there
  arrows        check which crates may know which
";

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let command = args.next().unwrap_or_default();
    let rest: Vec<String> = args.collect();
    let result = match command.as_str() {
        "bench" => bench(&rest),
        "test" => test::run(),
        "train" => train::run(&rest),
        "fuzz" => fuzz(&rest),
        "consumer" => consumer::run(),
        "planted" => planted::run(),
        "api" => api::run(rest.iter().any(|a| a == "--write")).map(|()| ExitCode::SUCCESS),
        "arrows" => arrows::check().map(|()| ExitCode::SUCCESS),
        _ => {
            eprint!("{HELP}");
            return ExitCode::from(if matches!(command.as_str(), "" | "help" | "--help" | "-h") {
                0
            } else {
                2
            });
        }
    };
    result.unwrap_or_else(|e| {
        eprintln!("xtask: {e:#}");
        ExitCode::FAILURE
    })
}

/// `ma3dsg bench` from a release build; its exit code is ours.
fn bench(args: &[String]) -> Result<ExitCode> {
    let status = cargo(&["run", "--release", "--quiet", "-p", "ma3dsg", "--", "bench"])
        .args(args)
        .status()
        .context("cargo run")?;
    Ok(ExitCode::from(u8::try_from(status.code().unwrap_or(1)).unwrap_or(1)))
}

/// A fuzzer, from a release build; its exit code is ours.
fn fuzz(args: &[String]) -> Result<ExitCode> {
    let status = cargo(&["run", "--release", "--quiet", "-p", "benches", "--bin", "fuzz", "--"])
        .args(args)
        .status()
        .context("cargo run")?;
    Ok(ExitCode::from(u8::try_from(status.code().unwrap_or(1)).unwrap_or(1)))
}

/// The cargo that runs us.
fn cargo(args: &[&str]) -> Command {
    let mut c = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    c.args(args);
    c
}

/// Runs a command and fails with its name unless it succeeds.
fn must(what: &str, command: &mut Command) -> Result<()> {
    eprintln!("== {what}");
    let status = command.status().with_context(|| what.to_owned())?;
    if !status.success() {
        bail!("{what}: {status}");
    }
    Ok(())
}
