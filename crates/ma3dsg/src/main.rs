//! `ma3dsg`: scan, align, merge and benchmark 3D semantic scene graphs.
//!
//! Exit codes: 0 done, 1 an error or a failed check, 2 wrong usage or missing cells.

mod clock;
mod commands;
mod files;
mod pipeline;
mod progress;
mod weights;

use clap::Parser;
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "ma3dsg", version, about = "Scan, align, merge and benchmark 3D semantic scene graphs.")]
struct Cli {
    /// Worker threads (default: one per core).
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    #[command(subcommand)]
    command: commands::Command,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    if let Some(n) = cli.threads
        && let Err(e) = rayon::ThreadPoolBuilder::new().num_threads(n.max(1)).build_global()
    {
        eprintln!("error: --threads {n}: {e}");
        return ExitCode::from(2);
    }
    match cli.command.run() {
        Ok(code) => code,
        Err(e) => {
            eprintln!("error: {e:#}");
            ExitCode::FAILURE
        }
    }
}
