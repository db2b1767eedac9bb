//! Samples from generated rooms, training, weights. Every step can be interrupted and goes on where
//! it stopped.

use crate::{cargo, must};
use anyhow::{Result, bail};
use std::path::Path;
use std::process::ExitCode;

const HELP: &str =
    "cargo xtask train [--rooms N] [--validation N] [--epochs N] [--seed S] [--dir DIR] [--from FILE] [--install]

  --rooms N        training rooms (300)
  --validation N   validation rooms (60)
  --epochs N       epochs (30)
  --seed S         seed of rooms and training (1)
  --from FILE      weights to start from, at a third of the learning rate; fresh ones without
  --dir DIR        samples, checkpoint and weights (runs/train)
  --install        put the weights in fixtures/weights
";

pub(crate) fn run(args: &[String]) -> Result<ExitCode> {
    let mut opt = [
        ("--rooms", "300"),
        ("--validation", "60"),
        ("--epochs", "30"),
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
    let [rooms, validation, epochs, seed, dir, from] = opt.map(|o| o.1);
    let samples = format!("{dir}/samples");
    for (split, n) in [("train", &rooms), ("validation", &validation)] {
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
                &seed,
                "--out",
                &samples,
            ]),
        )?;
    }
    let what = format!("generated rooms, split train, seed {seed}, {rooms} rooms, {epochs} epochs");
    let start = if from.is_empty() { vec![] } else { vec!["--from", from.as_str(), "--lr", "3e-4"] };
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
