//! AdamW whose state can be saved, and weighted cross entropy.

use candle_core::{D, Device, Result, Tensor, Var, backprop::GradStore};
use std::collections::BTreeMap;

/// Decoupled weight decay (Loshchilov and Hutter 2019), gradients clipped to a global norm of 5.
pub struct AdamW {
    pub moments: BTreeMap<String, (Tensor, Tensor)>,
    pub step: u64,
}

const BETAS: (f64, f64) = (0.9, 0.999);
const DECAY: f64 = 1e-3;
const CLIP: f64 = 5.0;

impl AdamW {
    pub fn new(vars: &BTreeMap<String, Var>) -> Result<Self> {
        let zeros = |(k, v): (&String, &Var)| Ok((k.clone(), (v.zeros_like()?, v.zeros_like()?)));
        Ok(Self { moments: vars.iter().map(zeros).collect::<Result<_>>()?, step: 0 })
    }

    pub fn update(&mut self, vars: &BTreeMap<String, Var>, grads: &GradStore, lr: f64) -> Result<()> {
        self.step += 1;
        let mut squares = 0.0;
        for g in vars.values().filter_map(|v| grads.get(v)) {
            squares += f64::from(g.sqr()?.sum_all()?.to_scalar::<f32>()?);
        }
        let clip = (CLIP / squares.sqrt().max(1e-12)).min(1.0);
        let t = self.step as i32;
        let (c1, c2) = (1.0 - BETAS.0.powi(t), 1.0 - BETAS.1.powi(t));
        for (name, var) in vars {
            let (Some(g), Some((m, v))) = (grads.get(var), self.moments.get_mut(name)) else { continue };
            let g = (g.detach() * clip)?;
            *m = ((m.detach() * BETAS.0)? + (&g * (1.0 - BETAS.0))?)?;
            *v = ((v.detach() * BETAS.1)? + (g.sqr()? * (1.0 - BETAS.1))?)?;
            let step = ((&*m / c1)? / ((&*v / c2)?.sqrt()? + 1e-8)?)?;
            let decay = if name.ends_with(".weight") { lr * DECAY } else { 0.0 };
            var.set(&((var.as_tensor().detach() * (1.0 - decay))? - (step * lr)?)?)?;
        }
        Ok(())
    }
}

/// Mean of -w log p over the rows with a target; `None` without any.
pub fn cross_entropy(logits: &Tensor, targets: &[i64], weights: &[f32]) -> Result<Option<Tensor>> {
    let rows: Vec<u32> = (0..targets.len() as u32).filter(|&k| targets[k as usize] >= 0).collect();
    if rows.is_empty() {
        return Ok(None);
    }
    let n = rows.len();
    let at: Vec<u32> = rows.iter().map(|&k| targets[k as usize] as u32).collect();
    let w: Vec<f32> = at.iter().map(|&c| weights[c as usize]).collect();
    let total: f32 = w.iter().sum();
    let dev = &Device::Cpu;
    let x = logits.index_select(&Tensor::from_vec(rows, n, dev)?, 0)?;
    let x = x.broadcast_sub(&x.max_keepdim(D::Minus1)?.detach())?;
    let log_p = x.broadcast_sub(&x.exp()?.sum_keepdim(D::Minus1)?.log()?)?;
    let picked = log_p.gather(&Tensor::from_vec(at, (n, 1), dev)?, 1)?.squeeze(1)?;
    let loss = (picked * Tensor::from_vec(w, n, dev)?)?.sum_all()?;
    Ok(Some((loss / -f64::from(total.max(1e-6)))?))
}

/// (total / (K count))^power, between 0.2 and 5; classes that never occur weigh 1.
pub fn class_weights<'a>(targets: impl Iterator<Item = &'a i64>, classes: usize, power: f32) -> Vec<f32> {
    let mut counts = vec![0_u64; classes];
    targets.filter(|t| **t >= 0).for_each(|&t| counts[t as usize] += 1);
    let total: u64 = counts.iter().sum();
    let weight = |&n: &u64| match n {
        0 => 1.0,
        n => (total as f32 / (classes as f32 * n as f32)).powf(power).clamp(0.2, 5.0),
    };
    counts.iter().map(weight).collect()
}
