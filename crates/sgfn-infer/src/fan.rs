//! One feature-wise attention (FAN) layer.
//!
//! Per edge (i, j) with feature e, widths D (node), d_e (edge), d_a (attention), H heads:
//! - e' = W2 relu(W1 [v_i, e, v_j])
//! - q = Wq v_i, k = Wk e, u = Wv v_j; element c of each belongs to head c mod H
//! - per head s_h = A2 relu(A1 [q_h, k_h]), p_h = softmax(s_h / tau) over the head's features
//! - message = p * u; m_i = elementwise maximum over the edges that start at i, 0 if none
//! - v'_i = U2 relu(U1 [v_i, m_i])
//!
//! Two rearrangements, both exact up to the order of sums: weights are permuted when loaded so
//! that a head's features lie together, and everything that depends on a node alone (q, u, the
//! node parts of W1 and A1) is computed once per node instead of once per edge.

use crate::linear::{Linear, Matrix, add_bias, relu};
use crate::{Error, tensors::Store};
use faer::Accum;
use rayon::prelude::*;

/// Edges of one tile. Fixed, so that results do not depend on the number of threads.
const TILE: usize = 64;

/// Widths of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Widths {
    pub(crate) node: usize,
    pub(crate) edge: usize,
    pub(crate) att: usize,
    pub(crate) heads: usize,
}

/// Names of a layer's tensors in one of the code variants.
pub(crate) struct Names {
    pub(crate) q: String,
    pub(crate) k: String,
    pub(crate) v: String,
    pub(crate) att: [String; 2],
    pub(crate) edge: [String; 2],
    pub(crate) node: [String; 2],
}

#[derive(Clone, Debug)]
pub(crate) struct Fan {
    widths: Widths,
    temperature: f32,
    q: Linear,
    k: Linear,
    v: Linear,
    att_q: Linear,
    att_k: Linear,
    att_out: Linear,
    edge_i: Linear,
    edge_e: Linear,
    edge_j: Linear,
    edge_out: Linear,
    node_in: Linear,
    node_out: Linear,
}

/// Intermediates of a layer in the authors' layout, for comparison with stored vectors.
#[derive(Default)]
pub(crate) struct FanTrace {
    pub(crate) q: Matrix,
    pub(crate) k: Matrix,
    pub(crate) v: Matrix,
    /// [E, d_a] with element r * H + h: row-major [E, d_a / H, H].
    pub(crate) att_logits: Matrix,
    pub(crate) att_prob: Matrix,
    pub(crate) message: Matrix,
    pub(crate) aggregated: Matrix,
}

/// order[h * w + r] = r * H + h: the position of head-major element (h, r) in the authors' layout.
fn head_major(width: usize, heads: usize) -> Vec<usize> {
    let w = width / heads;
    (0..width).map(|x| (x % w) * heads + x / w).collect()
}

impl Fan {
    pub(crate) fn load(store: &Store, names: &Names, w: Widths, scaled: bool) -> Result<Self, Error> {
        let expect = |l: Linear, name: &str, out: usize| {
            if l.outputs() == out {
                Ok(l)
            } else {
                Err(Error::tensor(
                    &format!("{name}.weight"),
                    format!("gives {} outputs, want {out}", l.outputs()),
                ))
            }
        };
        let load = |name: &str, inp: usize, out: usize| expect(store.linear_from(name, inp)?, name, out);
        let per_head = (w.node + w.edge) / w.heads;
        let (dq, dk) = (w.node / w.heads, w.edge / w.heads);
        let a1 = load(&names.att[0], per_head, per_head)?;
        let w1 = load(&names.edge[0], 2 * w.node + w.edge, w.node + w.edge)?;
        let u1 = load(&names.node[0], w.node + w.att, w.node + w.att)?;
        let range = |a: usize, n: usize| (a..a + n).collect::<Vec<_>>();
        let att = head_major(w.att, w.heads);
        let node_inputs: Vec<usize> = (0..w.node).chain(att.iter().map(|o| w.node + o)).collect();
        Ok(Self {
            widths: w,
            temperature: if scaled { (dk as f32).sqrt() } else { 1.0 },
            q: load(&names.q, w.node, w.node)?.permute_outputs(&head_major(w.node, w.heads)),
            k: load(&names.k, w.edge, w.edge)?.permute_outputs(&head_major(w.edge, w.heads)),
            v: load(&names.v, w.node, w.att)?.permute_outputs(&att),
            att_q: a1.select_inputs(&range(0, dq), true),
            att_k: a1.select_inputs(&range(dq, dk), false),
            att_out: load(&names.att[1], per_head, w.att / w.heads)?,
            edge_i: w1.select_inputs(&range(0, w.node), true),
            edge_e: w1.select_inputs(&range(w.node, w.edge), false),
            edge_j: w1.select_inputs(&range(w.node + w.edge, w.node), false),
            edge_out: load(&names.edge[1], w.node + w.edge, w.edge)?,
            node_in: u1.select_inputs(&node_inputs, true),
            node_out: load(&names.node[1], w.node + w.att, w.node)?,
        })
    }

    /// (v', e'), without the ReLU that stands between layers.
    pub(crate) fn apply(
        &self,
        nodes: &Matrix,
        edges: &Matrix,
        index: &[[usize; 2]],
        trace: Option<&mut FanTrace>,
    ) -> (Matrix, Matrix) {
        let (n, w) = (nodes.rows(), self.widths);
        let q = self.q.apply(nodes);
        let u = self.v.apply(nodes);
        // q is head-major, so its memory is [n * H, D / H].
        let att_q = self.att_q.apply(&Matrix::from_rows(q.as_slice().to_vec(), w.node / w.heads));
        let (edge_i, edge_j) = (self.edge_i.apply(nodes), self.edge_j.apply(nodes));
        let node_parts = NodeParts { u: &u, att_q: &att_q, edge_i: &edge_i, edge_j: &edge_j };

        let mut edge_new = Matrix::zeros(index.len(), w.edge);
        let mut message = Matrix::zeros(index.len(), w.att);
        edge_new
            .as_mut_slice()
            .par_chunks_mut(TILE * w.edge)
            .zip(message.as_mut_slice().par_chunks_mut(TILE * w.att))
            .zip(index.par_chunks(TILE).zip(edges.as_slice().par_chunks(TILE * w.edge)))
            .for_each(|((e_new, m), (index, e))| self.tile(&node_parts, index, e, e_new, m));

        let mut joined = Matrix::zeros(n, w.node + w.att);
        let mut seen = vec![false; n];
        for (r, &[i, _]) in index.iter().enumerate() {
            let dst = &mut joined.row_mut(i)[w.node..];
            if seen[i] {
                dst.iter_mut().zip(message.row(r)).for_each(|(d, v)| *d = d.max(*v));
            } else {
                dst.copy_from_slice(message.row(r));
                seen[i] = true;
            }
        }
        for i in 0..n {
            joined.row_mut(i)[..w.node].copy_from_slice(nodes.row(i));
        }
        if let Some(trace) = trace {
            *trace = self.trace(&node_parts, &q, edges, index, &message, &joined);
        }
        let node_new = self.node_out.apply(&self.node_in.apply(&joined).relu());
        (node_new, edge_new)
    }

    /// s = A2 relu(A1 [q_h, k_h]) of a tile, [edges * H, d_a / H], and the projected edges k.
    fn attention(&self, parts: &NodeParts<'_>, index: &[[usize; 2]], e: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let w = self.widths;
        let hidden = self.att_q.outputs();
        let mut k = vec![0.0; index.len() * w.edge];
        self.k.apply_slice(e, &mut k, Accum::Replace);
        add_bias(&mut k, self.k.bias());
        let mut a = vec![0.0; index.len() * w.heads * hidden];
        for (row, &[i, _]) in a.chunks_exact_mut(w.heads * hidden).zip(index) {
            row.copy_from_slice(&parts.att_q.as_slice()[i * w.heads * hidden..(i + 1) * w.heads * hidden]);
        }
        self.att_k.apply_slice(&k, &mut a, Accum::Add);
        relu(&mut a);
        let mut s = vec![0.0; index.len() * w.att];
        self.att_out.apply_slice(&a, &mut s, Accum::Replace);
        add_bias(&mut s, self.att_out.bias());
        (s, k)
    }

    fn tile(&self, p: &NodeParts<'_>, index: &[[usize; 2]], e: &[f32], e_new: &mut [f32], m: &mut [f32]) {
        let w = self.widths;
        let mut hidden = vec![0.0; index.len() * (w.node + w.edge)];
        for (row, &[i, j]) in hidden.chunks_exact_mut(w.node + w.edge).zip(index) {
            for ((h, a), b) in row.iter_mut().zip(p.edge_i.row(i)).zip(p.edge_j.row(j)) {
                *h = a + b;
            }
        }
        self.edge_e.apply_slice(e, &mut hidden, Accum::Add);
        relu(&mut hidden);
        self.edge_out.apply_slice(&hidden, e_new, Accum::Replace);
        add_bias(e_new, self.edge_out.bias());

        let (mut s, _) = self.attention(p, index, e);
        for row in s.chunks_exact_mut(w.att / w.heads) {
            softmax(row, self.temperature);
        }
        for ((row, prob), &[_, j]) in m.chunks_exact_mut(w.att).zip(s.chunks_exact(w.att)).zip(index) {
            for ((m, p), u) in row.iter_mut().zip(prob).zip(p.u.row(j)) {
                *m = p * u;
            }
        }
    }

    fn trace(
        &self,
        parts: &NodeParts<'_>,
        q: &Matrix,
        edges: &Matrix,
        index: &[[usize; 2]],
        message: &Matrix,
        joined: &Matrix,
    ) -> FanTrace {
        let w = self.widths;
        let (s, k) = self.attention(parts, index, edges.as_slice());
        let mut prob = s.clone();
        for row in prob.chunks_exact_mut(w.att / w.heads) {
            softmax(row, self.temperature);
        }
        let of_nodes = |x: &Matrix, end: usize| {
            let rows: Vec<f32> = index.iter().flat_map(|ij| x.row(ij[end])).copied().collect();
            authors_layout(&rows, x.cols(), w.heads)
        };
        let aggregated: Vec<f32> =
            (0..joined.rows()).flat_map(|i| &joined.row(i)[w.node..]).copied().collect();
        FanTrace {
            q: of_nodes(q, 0),
            k: authors_layout(&k, w.edge, w.heads),
            v: of_nodes(parts.u, 1),
            att_logits: authors_layout(&s, w.att, w.heads),
            att_prob: authors_layout(&prob, w.att, w.heads),
            message: authors_layout(message.as_slice(), w.att, w.heads),
            aggregated: authors_layout(&aggregated, w.att, w.heads),
        }
    }
}

/// What depends on a node alone.
struct NodeParts<'a> {
    u: &'a Matrix,
    att_q: &'a Matrix,
    edge_i: &'a Matrix,
    edge_j: &'a Matrix,
}

/// Rows of head-major features back to the authors' order.
fn authors_layout(rows: &[f32], width: usize, heads: usize) -> Matrix {
    let order = head_major(width, heads);
    let mut out = Matrix::zeros(rows.len() / width, width);
    for (r, row) in rows.chunks_exact(width).enumerate() {
        let dst = out.row_mut(r);
        order.iter().zip(row).for_each(|(&o, v)| dst[o] = *v);
    }
    out
}

/// softmax(x / tau) in place.
pub(crate) fn softmax(x: &mut [f32], tau: f32) {
    let max = x.iter().fold(f32::NEG_INFINITY, |m, v| m.max(*v));
    let mut sum = 0.0;
    for v in x.iter_mut() {
        *v = ((*v - max) / tau).exp();
        sum += *v;
    }
    x.iter_mut().for_each(|v| *v /= sum);
}
