//! `ma3dsg eval-instances`: the network on true instances of generated rooms, beside a decision tree
//! that sees box sizes alone.

use super::say;
use crate::pipeline;
use crate::progress::Progress;
use crate::weights::Weights;
use agent::NodeParams;
use anyhow::{Context, Result};
use bench_3rscan::samples::{self, Kind};
use rayon::prelude::*;
use room_synth::stats::size_tree;
use room_synth::{Split, World, WorldParams};
use scan3r::{Dataset, LabelSet};
use sgfn_infer::Graph;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Which rooms: validation or test.
    #[arg(long, default_value = "test", value_parser = ["train", "validation", "test"])]
    split: String,
    /// Number of rooms.
    #[arg(long, default_value_t = 47)]
    rooms: usize,
    /// Training rooms of the tree.
    #[arg(long, default_value_t = 200)]
    tree_rooms: usize,
    /// Seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Weights other than the shipped ones.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let weights = Weights::load(self.weights.as_deref())?;
        let split = Split::parse(&self.split).context("--split")?;
        let plain = WorldParams { rescans: false, ..WorldParams::default() };
        let world = World::new(split, self.seed, self.rooms, &plain);
        let segmentation = pipeline::segmentation(gsm::Profile::TofPhone);
        let progress = Progress::new("rooms", self.rooms as u64);
        let counted: Vec<Vec<(usize, usize)>> = world
            .rooms()
            .par_iter()
            .map(|room| {
                let found = answers(&world, &room.reference, &segmentation, &weights);
                progress.step();
                found
            })
            .collect::<Result<_>>()?;
        drop(progress);
        let classes = LabelSet::L20.classes();
        let mut per_class = vec![(0_usize, 0_usize); classes.len()];
        for (truth, said) in counted.into_iter().flatten() {
            per_class[truth].1 += 1;
            per_class[truth].0 += usize::from(truth == said);
        }
        let (hits, all) = per_class.iter().fold((0, 0), |a, c| (a.0 + c.0, a.1 + c.1));
        let present: Vec<f64> =
            per_class.iter().filter(|c| c.1 > 0).map(|c| c.0 as f64 / c.1 as f64).collect();
        say(format!(
            "{} generated {} rooms, seed {}; weights {} ({}), trained on {}",
            self.rooms,
            split.name(),
            self.seed,
            weights.file,
            &weights.sha256[..12],
            weights.trained_on
        ));
        say(format!(
            "network on true instances (seen surfels): accuracy {:.1} %, class mean {:.1} % over {all} instances of the set",
            100.0 * hits as f64 / all.max(1) as f64,
            100.0 * present.iter().sum::<f64>() / present.len().max(1) as f64
        ));
        let train = World::new(Split::Train, self.seed, self.tree_rooms, &plain);
        let tree = size_tree(&train, &world);
        say(format!(
            "depth-8 tree on true box extents and centre height ({} training rooms): accuracy {:.1} %, class mean {:.1} %",
            self.tree_rooms,
            100.0 * tree.accuracy,
            100.0 * tree.class_mean
        ));
        for (name, (hit, of)) in classes.iter().zip(&per_class).filter(|(_, c)| c.1 > 0) {
            say(format!("  {name}: {:.0} % of {of}", 100.0 * *hit as f64 / *of as f64));
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// (true class, answer) of every true instance of the set in one room. The answer is the best of the
/// classes of the set, as the tree's is.
fn answers(
    world: &World,
    scan: &str,
    segmentation: &gsm::Params,
    weights: &Weights,
) -> Result<Vec<(usize, usize)>> {
    let n = LabelSet::L20.classes().len();
    let all = samples::of_visit(world, scan, 0, segmentation, &NodeParams::default(), LabelSet::L20)?;
    let Some(s) = all.into_iter().find(|s| s.kind == Kind::Instances) else { return Ok(Vec::new()) };
    let channels = weights.model.config().channels;
    let segments = s.set.segments(channels)?;
    let out = weights.model.infer(&Graph { segments: &segments, edges: &s.set.edges })?;
    let best = |row: &[f32]| (0..n).fold(0, |b, k| if row[k] > row[b] { k } else { b });
    Ok(s.classes
        .iter()
        .enumerate()
        .filter_map(|(k, &c)| {
            Some((usize::try_from(c).ok().filter(|c| *c < n)?, best(out.class_logits.row(k))))
        })
        .collect())
}
