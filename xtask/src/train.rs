//! Samples from generated rooms, training, weights. Every step can be interrupted and goes on where
//! it stopped.

use crate::{cargo, must};
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::ExitCode;

const HELP: &str =
    "cargo xtask train [--rooms N] [--seeds N] [--validation N] [--epochs N] [--lr R] [--seed S] [--dir DIR]
                  [--from FILE] [--install]

  --rooms N        training rooms of each seed (300)
  --seeds N        seeds of training rooms, counted up from the first (1)
  --validation N   validation rooms (60)
  --epochs N       epochs (30)
  --lr R           learning rate at the start (1e-3; 3e-4 with --from)
  --seed S         first seed of rooms, and seed of training (1)
  --from FILE      weights to start from; fresh ones without
  --dir DIR        samples, checkpoint and weights (runs/train)
  --install        put the weights in fixtures/weights
";

pub(crate) fn run(args: &[String]) -> Result<ExitCode> {
    let mut opt = [
        ("--rooms", "300"),
        ("--seeds", "1"),
        ("--validation", "60"),
        ("--epochs", "30"),
        ("--lr", ""),
        ("--seed", "1"),
        ("--dir", "runs/train"),
        ("--from", ""),
    ]
    .map(|(k, v)| (k, v.to_owned()));
    let mut install = false;
    let mut it = args.iter();
    while let Some(a) = it.next() {
        match a.as_str() {
            "--install" => install = true,
            "--help" | "-h" => {
                eprint!("{HELP}");
                return Ok(ExitCode::SUCCESS);
            }
            name => match (opt.iter_mut().find(|o| o.0 == name), it.next()) {
                (Some(o), Some(value)) => o.1.clone_from(value),
                _ => bail!("{name}: unknown option or no value\n{HELP}"),
            },
        }
    }
    let [rooms, seeds, validation, epochs, lr, seed, dir, from] = opt.map(|o| o.1);
    let samples = format!("{dir}/samples");
    let first: u64 = seed.parse().with_context(|| format!("--seed {seed}"))?;
    let count: u64 = seeds.parse().with_context(|| format!("--seeds {seeds}"))?;
    let train = (first..first.saturating_add(count)).map(|s| ("train", &rooms, s));
    for (split, n, seed) in train.chain([("validation", &validation, first)]) {
        must(
            &format!("samples of {n} {split} rooms"),
            &mut cargo(&[
                "run",
                "--release",
                "--quiet",
                "-p",
                "ma3dsg",
                "--",
                "samples",
                "--split",
                split,
                "--rooms",
                n,
                "--seed",
                &seed.to_string(),
                "--out",
                &samples,
            ]),
        )?;
    }
    let of_seeds = if count > 1 {
        format!("seeds {seed} to {}, each", first.saturating_add(count) - 1)
    } else {
        format!("seed {seed},")
    };
    let what = format!("generated rooms, split train, {of_seeds} {rooms} rooms, {epochs} epochs");
    let start = if from.is_empty() { vec![] } else { vec!["--from", from.as_str()] };
    let lr = match (lr.as_str(), start.is_empty()) {
        ("", true) => "1e-3",
        ("", false) => "3e-4",
        (lr, _) => lr,
    };
    must(
        "training",
        cargo(&[
            "run",
            "--release",
            "--quiet",
            "--manifest-path",
            "extras/trainer/Cargo.toml",
            "--",
            "--samples",
            &samples,
            "--out",
            &dir,
            "--epochs",
            &epochs,
            "--lr",
            lr,
            "--seed",
            &seed,
            "--trained-on",
            &what,
        ])
        .args(start),
    )?;
    if install {
        let to = Path::new("fixtures/weights");
        std::fs::copy(format!("{dir}/sgfn-l20.safetensors"), to.join("sgfn-l20.safetensors"))?;
        std::fs::copy(format!("{dir}/validation.md"), to.join("validation.md"))?;
        eprintln!("installed in {}", to.display());
    }
    Ok(ExitCode::SUCCESS)
}
