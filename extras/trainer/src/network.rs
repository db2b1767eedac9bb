//! The network of sgfn-infer (variant `main`), differentiable.

use crate::batch::{Batch, unit};
use crate::data::CHANNELS;
use candle_core::{D, Device, Result, Tensor, Var};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::collections::BTreeMap;

const HEADS: usize = 8;
const LAYERS: usize = 2;

/// Parameters by their name in the weights file.
pub struct Network {
    pub vars: BTreeMap<String, Var>,
    dim: usize,
}

/// Scores before softmax.
pub struct Logits {
    pub classes: Tensor,
    pub predicates: Tensor,
}

/// Dropout is on while training.
pub struct Mode<'a> {
    pub dropout: Option<(&'a mut ChaCha8Rng, f32)>,
}

impl Network {
    /// Fresh weights: uniform in +-sqrt(3 / inputs) (variance 1 / inputs), biases 0.
    pub fn new(dim: usize, classes: usize, predicates: usize, seed: u64) -> Result<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut vars = BTreeMap::new();
        for (name, inp, out) in shapes(dim, classes, predicates) {
            let bound = (3.0 / inp as f32).sqrt();
            let w: Vec<f32> = (0..inp * out).map(|_| (2.0 * unit(&mut rng) - 1.0) * bound).collect();
            vars.insert(format!("{name}.weight"), Var::from_vec(w, (out, inp), &Device::Cpu)?);
            vars.insert(format!("{name}.bias"), Var::zeros(out, candle_core::DType::F32, &Device::Cpu)?);
        }
        Ok(Self { vars, dim })
    }

    fn linear(&self, name: &str, x: &Tensor) -> Result<Tensor> {
        let w = self.vars[&format!("{name}.weight")].as_tensor();
        x.matmul(&w.t()?)?.broadcast_add(self.vars[&format!("{name}.bias")].as_tensor())
    }

    fn mlp(&self, names: [&str; 2], x: &Tensor) -> Result<Tensor> {
        self.linear(names[1], &self.linear(names[0], x)?.relu()?)
    }

    /// The whole forward pass.
    pub fn forward(&self, b: &Batch, mode: &mut Mode<'_>) -> Result<Logits> {
        let mut x = b.points.clone();
        for k in 1..=2 {
            x = self.linear(&format!("obj_encoder.model.conv{k}"), &x)?.relu()?;
        }
        let x = self.linear("obj_encoder.model.conv3", &x)?.reshape((b.nodes, b.per_node, self.dim - 8))?;
        let mut nodes = Tensor::cat(&[&x.max(1)?.relu()?, &b.spatial], 1)?;
        let mut edges = b.relative.clone();
        if b.edges > 0 {
            for k in 1..=3 {
                edges = self.linear(&format!("rel_encoder.encoder.conv{k}"), &edges)?.relu()?;
            }
            for l in 0..LAYERS {
                let (v, e) = self.fan(l, &nodes, &edges, b)?;
                let last = l + 1 == LAYERS;
                (nodes, edges) = if last { (v, e) } else { (v.relu()?, e.relu()?) };
            }
        } else {
            edges = Tensor::zeros((0, self.dim), candle_core::DType::F32, &Device::Cpu)?;
        }
        Ok(Logits {
            classes: self.head("obj_predictor", &nodes, mode)?,
            predicates: if b.edges > 0 { self.head("rel_predictor", &edges, mode)? } else { edges },
        })
    }

    fn head(&self, name: &str, x: &Tensor, mode: &mut Mode<'_>) -> Result<Tensor> {
        let x = self.linear(&format!("{name}.fc1"), x)?.relu()?;
        let mut x = self.linear(&format!("{name}.fc2"), &x)?;
        if let Some((rng, p)) = &mut mode.dropout {
            let n = x.elem_count();
            let mask: Vec<f32> =
                (0..n).map(|_| if unit(rng) < *p { 0.0 } else { 1.0 / (1.0 - *p) }).collect();
            x = (x.clone() * Tensor::from_vec(mask, x.shape(), &Device::Cpu)?)?;
        }
        self.linear(&format!("{name}.fc3"), &x.relu()?)
    }

    /// One feature-wise attention layer; equations in sgfn-infer's `fan`.
    fn fan(&self, l: usize, nodes: &Tensor, edges: &Tensor, b: &Batch) -> Result<(Tensor, Tensor)> {
        let n = |s: &str| format!("gnn.gconvs.{l}.{s}");
        let (d, e) = (self.dim, b.edges);
        let vi = nodes.index_select(&b.i, 0)?;
        let vj = nodes.index_select(&b.j, 0)?;
        let joint = Tensor::cat(&[&vi, edges, &vj], 1)?;
        let edge_new = self.mlp([&n("nn_edge.0"), &n("nn_edge.2")], &joint)?;
        // Element c belongs to head c mod H: [E, D / H, H] -> [E, H, D / H].
        let heads = |t: Tensor| t.reshape((e, d / HEADS, HEADS))?.transpose(1, 2)?.contiguous();
        let project = |name: &str, x: &Tensor, at: &Tensor| self.linear(&n(name), x)?.index_select(at, 0);
        let q = heads(project("proj_q.0", nodes, &b.i)?)?;
        let k = heads(self.linear(&n("proj_k.0"), edges)?)?;
        let u = heads(project("proj_v.0", nodes, &b.j)?)?;
        let qk = Tensor::cat(&[&q, &k], 2)?.reshape((e * HEADS, 2 * d / HEADS))?;
        let s = self.mlp([&n("nn_att.0"), &n("nn_att.2")], &qk)?.reshape((e, HEADS, d / HEADS))?;
        let p = softmax(&(s / ((d / HEADS) as f64).sqrt())?)?;
        let message = (p * u)?.transpose(1, 2)?.reshape((e, d))?;
        // Maximum over the edges of each node; empty slots are far below, nodes without edges get 0.
        let pad = Tensor::full(-1e9_f32, (1, d), &Device::Cpu)?;
        let padded = Tensor::cat(&[&message, &pad], 0)?.index_select(&b.slots, 0)?;
        let most = padded.reshape((b.nodes, b.degree, d))?.max(1)?;
        let empty = most.lt(-1e8)?;
        let aggregated = empty.where_cond(&most.zeros_like()?, &most)?;
        let joined = Tensor::cat(&[nodes, &aggregated], 1)?;
        Ok((self.mlp([&n("update_node.0"), &n("update_node.2")], &joined)?, edge_new))
    }
}

fn softmax(x: &Tensor) -> Result<Tensor> {
    let e = x.broadcast_sub(&x.max_keepdim(D::Minus1)?.detach())?.exp()?;
    e.broadcast_div(&e.sum_keepdim(D::Minus1)?)
}

/// (name, inputs, outputs) of every layer.
fn shapes(d: usize, classes: usize, predicates: usize) -> Vec<(String, usize, usize)> {
    let mut v: Vec<(String, usize, usize)> = Vec::new();
    let mut add = |name: &str, inp, out| v.push((name.to_owned(), inp, out));
    for (k, (inp, out)) in [(CHANNELS, 64), (64, 128), (128, d - 8)].into_iter().enumerate() {
        add(&format!("obj_encoder.model.conv{}", k + 1), inp, out);
    }
    for (k, (inp, out)) in [(11, 64), (64, 128), (128, d)].into_iter().enumerate() {
        add(&format!("rel_encoder.encoder.conv{}", k + 1), inp, out);
    }
    for l in 0..LAYERS {
        let mut layer = |name: &str, inp, out| add(&format!("gnn.gconvs.{l}.{name}"), inp, out);
        layer("proj_q.0", d, d);
        layer("proj_k.0", d, d);
        layer("proj_v.0", d, d);
        layer("nn_att.0", 2 * d / HEADS, 2 * d / HEADS);
        layer("nn_att.2", 2 * d / HEADS, d / HEADS);
        layer("nn_edge.0", 3 * d, 2 * d);
        layer("nn_edge.2", 2 * d, d);
        layer("update_node.0", 2 * d, 2 * d);
        layer("update_node.2", 2 * d, d);
    }
    // Narrower heads than the authors' 512 and 256: pairs are many, and the edge head alone would
    // cost more than the rest of the network.
    for (head, wide, narrow, out) in [("obj_predictor", 256, 128, classes), ("rel_predictor", 128, 64, predicates)]
    {
        add(&format!("{head}.fc1"), d, wide);
        add(&format!("{head}.fc2"), wide, narrow);
        add(&format!("{head}.fc3"), narrow, out);
    }
    v
}
