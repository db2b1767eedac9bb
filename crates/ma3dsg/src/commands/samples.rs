//! `ma3dsg samples --split train --rooms N --seed S -o DIR`: training samples from generated rooms.

use super::say;
use crate::files;
use crate::progress::Progress;
use agent::NodeParams;
use anyhow::{Result, bail};
use bench_3rscan::samples;
use rayon::prelude::*;
use room_synth::{Split, World, WorldParams};
use scan3r::{Dataset, LabelSet};
use std::path::PathBuf;
use std::process::ExitCode;

/// Rooms per file.
const SHARD: usize = 10;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Which rooms: train, validation or test.
    #[arg(long, default_value = "train")]
    split: String,
    /// Number of rooms.
    #[arg(long, default_value_t = 300)]
    rooms: usize,
    /// Seed of the rooms.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Scan each room again after things have changed, and take those scans too.
    #[arg(long)]
    rescans: bool,
    /// Folder for the sample files; files that are there are kept.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let Some(split) = Split::parse(&self.split) else {
            bail!("--split {:?}, want train, validation or test", self.split);
        };
        let params = WorldParams { rescans: self.rescans, ..WorldParams::default() };
        let world = World::new(split, self.seed, self.rooms, &params);
        let segmentation = crate::pipeline::segmentation(gsm::Profile::TofPhone);
        let nodes = NodeParams::default();
        let scans: Vec<&str> = world
            .rooms()
            .iter()
            .flat_map(|r| {
                std::iter::once(r.reference.as_str()).chain(r.scans.iter().take(1).map(|s| s.id.as_str()))
            })
            .collect();
        let progress = Progress::new("scans sampled", scans.len() as u64);
        let shards: Vec<&[&str]> = scans.chunks(SHARD).collect();
        let graphs: Vec<usize> = shards
            .par_iter()
            .enumerate()
            .map(|(k, shard)| -> Result<usize> {
                let path = self.out.join(format!("{}-{}-{k:04}.safetensors", split.name(), self.seed));
                if path.is_file() {
                    shard.iter().for_each(|_| progress.step());
                    return Ok(0);
                }
                let mut all = Vec::new();
                for scan in *shard {
                    all.extend(samples::of_visit(&world, scan, 0, &segmentation, &nodes, LabelSet::L20)?);
                    progress.step();
                }
                files::write(&path, &samples::to_safetensors(&all, nodes.points, LabelSet::L20)?)?;
                Ok(all.len())
            })
            .collect::<Result<_>>()?;
        let written: usize = graphs.iter().sum();
        say(format!("{written} graphs of {} scans written to {}", scans.len(), self.out.display()));
        Ok(ExitCode::SUCCESS)
    }
}
