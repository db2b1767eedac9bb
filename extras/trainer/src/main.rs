//! Trains the SGFN network on sample files and writes weights that sgfn-infer reads.

mod batch;
mod data;
mod network;
mod optim;
mod score;

use anyhow::{Context, Result, bail};
use batch::{Augment, Batch};
use candle_core::{Device, Tensor, Var};
use clap::Parser;
use data::{Graph, Samples};
use network::{Mode, Network};
use optim::{AdamW, class_weights, cross_entropy};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use safetensors::tensor::{Dtype, TensorView};
use score::Tally;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Trains the SGFN network on samples of generated rooms.
#[derive(Parser)]
struct Args {
    /// Folder with train-*.safetensors and validation-*.safetensors.
    #[arg(long)]
    samples: PathBuf,
    /// Folder for checkpoint, weights and card.
    #[arg(long)]
    out: PathBuf,
    /// Weights to start from, as a weights file holds them; fresh ones without.
    #[arg(long)]
    from: Option<PathBuf>,
    #[arg(long, default_value_t = 30)]
    epochs: u32,
    /// Width of node, edge and attention features.
    #[arg(long, default_value_t = 128)]
    dim: usize,
    /// Points per node and step.
    #[arg(long, default_value_t = 64)]
    points: usize,
    /// Graphs per step.
    #[arg(long, default_value_t = 4)]
    batch: usize,
    #[arg(long, default_value_t = 1e-3)]
    lr: f64,
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Exponent of the inverse class frequency in the loss.
    #[arg(long, default_value_t = 0.35)]
    balance: f32,
    /// What the data is, for the weights' metadata.
    #[arg(long, default_value = "generated rooms")]
    trained_on: String,
}

fn main() -> Result<()> {
    let a = Args::parse();
    std::fs::create_dir_all(&a.out)?;
    let train = Samples::load(&a.samples, "train")?;
    let validation = Samples::load(&a.samples, "validation")?;
    let (k, p) = (train.class_names.len(), train.predicate_names.len());
    eprintln!("{} training graphs, {} validation graphs", train.graphs.len(), validation.graphs.len());
    let wc = class_weights(train.graphs.iter().flat_map(|g| &g.classes), k, a.balance);
    let mut wp = class_weights(train.graphs.iter().flat_map(|g| &g.predicates), p, a.balance);
    wp[p - 1] /= batch::KEEP_NONE;
    let net = Network::new(a.dim, k, p, a.seed)?;
    let mut trained_on = a.trained_on.clone();
    if let Some(file) = &a.from {
        trained_on = format!("{}; then {trained_on}", start_from(file, &net, &train)?);
        eprintln!("before: {}", evaluate(&net, &validation)?.0);
    }
    let mut adam = AdamW::new(&net.vars)?;
    let checkpoint = a.out.join("checkpoint.safetensors");
    let first = resume(&checkpoint, &net, &mut adam)?;
    let steps = train.graphs.len().div_ceil(a.batch) as u64;
    for epoch in first..a.epochs {
        let mut rng = ChaCha8Rng::seed_from_u64(a.seed ^ (u64::from(epoch) << 32) ^ 0x7261_696e);
        let mut order: Vec<usize> = (0..train.graphs.len()).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, (rng.next_u64() % (i as u64 + 1)) as usize);
        }
        // Half-way graphs resemble the final ones: each epoch takes half of them.
        order.retain(|&g| train.graphs[g].kind != "half" || rng.next_u32() & 1 == 0);
        let (mut sum, mut n) = (0.0, 0.0);
        for chunk in order.chunks(a.batch) {
            let graphs: Vec<&Graph> = chunk.iter().map(|&g| &train.graphs[g]).collect();
            let b = Batch::new(&graphs, a.points, p as i64 - 1, Some(Augment { rng: &mut rng }))?;
            let logits = net.forward(&b, &mut Mode { dropout: Some((&mut rng, 0.3)) })?;
            let nodes = cross_entropy(&logits.classes, &b.classes, &wc)?;
            let edges = if b.edges > 0 { cross_entropy(&logits.predicates, &b.predicates, &wp)? } else { None };
            let Some(loss) = sum_of(nodes, edges)? else { continue };
            let progress = adam.step as f64 / (steps * u64::from(a.epochs)) as f64;
            let lr = a.lr * (0.02 + 0.98 * 0.5 * (1.0 + (std::f64::consts::PI * progress.min(1.0)).cos()));
            adam.update(&net.vars, &loss.backward()?, lr)?;
            sum += f64::from(loss.to_scalar::<f32>()?);
            n += 1.0;
        }
        save_checkpoint(&checkpoint, &net, &adam, epoch + 1)?;
        let (text, _) = evaluate(&net, &validation)?;
        eprintln!("epoch {}/{} loss {:.3} {text}", epoch + 1, a.epochs, sum / n);
    }
    let (text, tables) = evaluate(&net, &validation)?;
    let weights = a.out.join("sgfn-l20.safetensors");
    save_weights(&weights, &net, &train, &trained_on)?;
    std::fs::write(a.out.join("validation.md"), format!("{text}\n\n{tables}"))?;
    println!("{} written; {text}", weights.display());
    Ok(())
}

fn sum_of(a: Option<Tensor>, b: Option<Tensor>) -> Result<Option<Tensor>> {
    Ok(match (a, b) {
        (Some(a), Some(b)) => Some((a + b)?),
        (a, b) => a.or(b),
    })
}

/// Validation figures in one line, and tables per output for segments and for true instances.
fn evaluate(net: &Network, v: &Samples) -> Result<(String, String)> {
    let mut tallies: BTreeMap<&str, (Tally, Tally)> = BTreeMap::new();
    for g in v.graphs.iter().filter(|g| g.kind != "half") {
        let b = Batch::new(&[g], g.per_node, -2, None)?;
        let logits = net.forward(&b, &mut Mode { dropout: None })?;
        let t = tallies.entry(if g.kind == "end" { "segments" } else { "instances" }).or_default();
        t.0.add(&logits.classes, &g.classes)?;
        if g.len() > 0 && b.edges > 0 {
            t.1.add(&logits.predicates, &g.predicates)?;
        }
    }
    let (mut line, mut tables) = (String::new(), String::new());
    for (kind, (nodes, edges)) in &tallies {
        let (none_c, none_p) = (v.class_names.len() as i64 - 1, v.predicate_names.len() as i64 - 1);
        let (acc, mean) = nodes.rates(Some(none_c));
        let (acc_p, mean_p) = edges.rates(Some(none_p));
        line += &format!(
            "{kind}: class {acc:.1} % mean {mean:.1} %, all {:.1} %, predicate {acc_p:.1} % mean {mean_p:.1} %, all {:.1} %; ",
            nodes.rates(None).0,
            edges.rates(None).0
        );
        tables += &format!("{kind}\n\n| class | nodes | recall % |\n|-|-|-|\n{}\n", nodes.table(&v.class_names));
        tables += &format!("| predicate | pairs | recall % |\n|-|-|-|\n{}\n", edges.table(&v.predicate_names));
    }
    Ok((line, tables))
}

fn write(path: &Path, tensors: &BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>, meta: &[(&str, String)]) -> Result<()> {
    let views = tensors
        .iter()
        .map(|(n, (t, s, d))| Ok((n.clone(), TensorView::new(*t, s.clone(), d)?)))
        .collect::<Result<Vec<_>>>()?;
    let meta = meta.iter().map(|(k, v)| ((*k).to_owned(), v.clone())).collect();
    let tmp = path.with_extension("tmp");
    std::fs::write(&tmp, safetensors::serialize(views, Some(meta))?)?;
    std::fs::rename(&tmp, path).with_context(|| format!("{}", path.display()))
}

fn f32_bytes(t: &Tensor) -> Result<Vec<u8>> {
    Ok(t.flatten_all()?.to_vec1::<f32>()?.into_iter().flat_map(f32::to_le_bytes).collect())
}

fn save_checkpoint(path: &Path, net: &Network, adam: &AdamW, epoch: u32) -> Result<()> {
    let mut all = BTreeMap::new();
    let mut put = |name: String, t: &Tensor| -> Result<()> {
        all.insert(name, (Dtype::F32, t.dims().to_vec(), f32_bytes(t)?));
        Ok(())
    };
    for (name, var) in &net.vars {
        put(name.clone(), var.as_tensor())?;
        let (m, v) = &adam.moments[name];
        put(format!("adam.m.{name}"), m)?;
        put(format!("adam.v.{name}"), v)?;
    }
    write(path, &all, &[("epoch", epoch.to_string()), ("step", adam.step.to_string())])
}

/// Takes the weights of a file, which must be of the same outputs in the same order; returns what they were trained on.
fn start_from(path: &Path, net: &Network, s: &Samples) -> Result<String> {
    let bytes = std::fs::read(path).with_context(|| format!("--from {}", path.display()))?;
    let (_, meta) = safetensors::SafeTensors::read_metadata(&bytes)?;
    let meta = meta.metadata().clone().unwrap_or_default();
    for (field, names) in [("class_names", &s.class_names), ("predicate_names", &s.predicate_names)] {
        let found = meta.get(field).with_context(|| format!("{}: no {field} in the metadata", path.display()))?;
        if *found != names.join("\n") {
            bail!("{}: {field} are not those of the samples", path.display());
        }
    }
    let tensors = candle_core::safetensors::load_buffer(&bytes, &Device::Cpu)?;
    for (name, var) in &net.vars {
        let t = tensors.get(name).with_context(|| format!("{}: no {name}", path.display()))?;
        if t.dims() != var.dims() {
            bail!("{}: {name} is {:?}, want {:?}", path.display(), t.dims(), var.dims());
        }
        var.set(&t.to_dtype(candle_core::DType::F32)?)?;
    }
    Ok(meta.get("trained_on").cloned().unwrap_or_else(|| "unknown data".to_owned()))
}

/// Continues from a checkpoint of the same shapes, if there is one; says at which epoch.
fn resume(path: &Path, net: &Network, adam: &mut AdamW) -> Result<u32> {
    if !path.is_file() {
        return Ok(0);
    }
    let bytes = std::fs::read(path)?;
    let (_, meta) = safetensors::SafeTensors::read_metadata(&bytes)?;
    let meta = meta.metadata().clone().context("checkpoint without metadata")?;
    let tensors = candle_core::safetensors::load_buffer(&bytes, &Device::Cpu)?;
    let get = |name: &str| tensors.get(name).with_context(|| format!("{}: no {name}", path.display()));
    for (name, var) in &net.vars {
        Var::set(var, get(name)?)?;
        let m = (get(&format!("adam.m.{name}"))?.clone(), get(&format!("adam.v.{name}"))?.clone());
        adam.moments.insert(name.clone(), m);
    }
    adam.step = meta.get("step").context("step")?.parse()?;
    let epoch = meta.get("epoch").context("epoch")?.parse()?;
    eprintln!("continuing after epoch {epoch}");
    Ok(epoch)
}

fn save_weights(path: &Path, net: &Network, s: &Samples, trained_on: &str) -> Result<()> {
    let mut all = BTreeMap::new();
    for (name, var) in &net.vars {
        let v = var.as_tensor().flatten_all()?.to_vec1::<f32>()?;
        let bytes = v.into_iter().flat_map(|x| half::f16::from_f32(x).to_le_bytes()).collect();
        all.insert(name.clone(), (Dtype::F16, var.dims().to_vec(), bytes));
    }
    let meta = [
        ("variant", "main".to_owned()),
        ("class_names", s.class_names.join("\n")),
        ("predicate_names", s.predicate_names.join("\n")),
        ("trained_on", trained_on.to_owned()),
    ];
    write(path, &all, &meta)
}
