//! One module per command.

mod align;
mod bench;
mod check;
mod eval;
mod eval_map;
mod eval_seg;
mod export;
mod infer;
mod merge;
mod samples;
mod scan;
mod synth;
mod wire;

use anyhow::Result;
use std::process::ExitCode;

#[derive(clap::Subcommand)]
pub(crate) enum Command {
    /// Scan a recording: segments, objects and relations.
    Scan(scan::Args),
    /// Run the benchmark and write a report.
    Bench(Box<bench::Args>),
    /// Merge graph files in the order given.
    Merge(merge::Args),
    /// Say what is wrong with a recording: units, poses, gravity, unreadable frames.
    Check(check::Args),
    /// Write a graph for other programs.
    Export(export::Args),
    /// Write generated rooms in 3RScan's form, or print their statistics.
    Synth(synth::Args),
    /// Align a query graph with a reference graph, or a folder of cases.
    Align(align::Args),
    /// Write a graph as a frame.
    Encode(wire::EncodeArgs),
    /// Read a frame into a graph file.
    Decode(wire::DecodeArgs),
    /// Fold frames of any number of agents.
    Fold(wire::FoldArgs),
    /// Recompute stored vectors of the network and compare every tensor.
    Infer(infer::Args),
    /// The network on true instances of generated rooms, beside a tree on box sizes.
    EvalInstances(eval::Args),
    /// The segmentation on generated rooms with truth, noise-free and noisy.
    EvalSeg(eval_seg::Args),
    /// The map over time on generated rooms: what goes when things are moved, and what a long walk costs.
    EvalMap(eval_map::Args),
    /// Write training samples from generated rooms.
    Samples(samples::Args),
}

impl Command {
    pub(crate) fn run(self) -> Result<ExitCode> {
        match self {
            Self::Scan(a) => a.run(),
            Self::Bench(a) => a.run(),
            Self::Merge(a) => a.run(),
            Self::Check(a) => a.run(),
            Self::Export(a) => a.run(),
            Self::Synth(a) => a.run(),
            Self::Align(a) => a.run(),
            Self::Encode(a) => a.run(),
            Self::Decode(a) => a.run(),
            Self::Fold(a) => a.run(),
            Self::Infer(a) => a.run(),
            Self::EvalInstances(a) => a.run(),
            Self::EvalSeg(a) => a.run(),
            Self::EvalMap(a) => a.run(),
            Self::Samples(a) => a.run(),
        }
    }
}

/// Prints a line to standard output. A closed pipe is no error: the reader has what it wanted.
pub(crate) fn say(line: impl std::fmt::Display) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{line}");
}
