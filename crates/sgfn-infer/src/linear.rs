//! Row-major matrices and dense layers.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// A row-major matrix of f32.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Matrix {
    data: Vec<f32>,
    cols: usize,
}

impl Matrix {
    /// `rows` x `cols` zeros.
    #[must_use]
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self { data: vec![0.0; rows * cols], cols }
    }

    /// Takes over row-major values; a length that is no multiple of `cols` is cut to full rows.
    #[must_use]
    pub fn from_rows(mut data: Vec<f32>, cols: usize) -> Self {
        data.truncate(data.len() / cols.max(1) * cols.max(1));
        Self { data, cols }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.data.len().checked_div(self.cols).unwrap_or(0)
    }

    /// Number of columns.
    #[must_use]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// One row.
    #[must_use]
    pub fn row(&self, i: usize) -> &[f32] {
        &self.data[i * self.cols..(i + 1) * self.cols]
    }

    pub(crate) fn row_mut(&mut self, i: usize) -> &mut [f32] {
        &mut self.data[i * self.cols..(i + 1) * self.cols]
    }

    /// All values, row by row.
    #[must_use]
    pub fn as_slice(&self) -> &[f32] {
        &self.data
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Every value through max(0, x).
    pub(crate) fn relu(mut self) -> Self {
        relu(&mut self.data);
        self
    }
}

pub(crate) fn relu(v: &mut [f32]) {
    for x in v {
        *x = x.max(0.0);
    }
}

/// y = W x + b, with W stored [out, in].
#[derive(Clone, Debug)]
pub(crate) struct Linear {
    weight: Vec<f32>,
    bias: Vec<f32>,
    inputs: usize,
}

impl Linear {
    pub(crate) fn new(weight: Vec<f32>, bias: Vec<f32>, inputs: usize) -> Self {
        debug_assert_eq!(weight.len(), bias.len() * inputs);
        Self { weight, bias, inputs }
    }

    pub(crate) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(crate) fn outputs(&self) -> usize {
        self.bias.len()
    }

    pub(crate) fn bias(&self) -> &[f32] {
        &self.bias
    }

    /// Rows of the result in another order: output k of the new layer is output `order[k]` of this.
    pub(crate) fn permute_outputs(&self, order: &[usize]) -> Self {
        let weight = order.iter().flat_map(|&o| &self.weight[o * self.inputs..(o + 1) * self.inputs]);
        Self {
            weight: weight.copied().collect(),
            bias: order.iter().map(|&o| self.bias[o]).collect(),
            inputs: self.inputs,
        }
    }

    /// Inputs in another order: input k of the new layer is input `order[k]` of this. With fewer
    /// entries than inputs it is the part of the layer that sees these inputs.
    pub(crate) fn select_inputs(&self, order: &[usize], with_bias: bool) -> Self {
        let weight =
            self.weight.chunks_exact(self.inputs).flat_map(|r| order.iter().map(|&i| r[i])).collect();
        let bias = if with_bias { self.bias.clone() } else { vec![0.0; self.bias.len()] };
        Self { weight, bias, inputs: order.len() }
    }

    /// Folds an evaluated batch norm, gamma (y - mean) / sqrt(var + 1e-5) + beta, into the layer.
    pub(crate) fn fold_norm(mut self, gamma: &[f32], beta: &[f32], mean: &[f32], var: &[f32]) -> Self {
        for o in 0..self.outputs() {
            let s = gamma[o] / (var[o] + 1e-5).sqrt();
            for w in &mut self.weight[o * self.inputs..(o + 1) * self.inputs] {
                *w *= s;
            }
            self.bias[o] = (self.bias[o] - mean[o]) * s + beta[o];
        }
        self
    }

    /// X W^T + b for all rows of X.
    pub(crate) fn apply(&self, x: &Matrix) -> Matrix {
        let mut y = Matrix::zeros(x.rows(), self.outputs());
        self.apply_slice(x.as_slice(), y.as_mut_slice(), Accum::Replace);
        add_bias(y.as_mut_slice(), &self.bias);
        y
    }

    /// The bare product, without the bias, into (or on top of) `dst`.
    pub(crate) fn apply_slice(&self, x: &[f32], dst: &mut [f32], accum: Accum) {
        let rows = x.len() / self.inputs;
        if rows == 0 {
            return;
        }
        matmul(
            MatMut::from_row_major_slice_mut(dst, rows, self.outputs()),
            accum,
            MatRef::from_row_major_slice(x, rows, self.inputs),
            MatRef::from_row_major_slice(&self.weight, self.outputs(), self.inputs).transpose(),
            1.0_f32,
            Par::Seq,
        );
    }
}

pub(crate) fn add_bias(y: &mut [f32], bias: &[f32]) {
    for row in y.chunks_exact_mut(bias.len()) {
        for (v, b) in row.iter_mut().zip(bias) {
            *v += b;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn apply_is_the_sum_over_inputs(
            (n, i, o, seed) in (0usize..9, 1usize..20, 1usize..20, any::<u32>())
        ) {
            let mut s = seed;
            let mut next = || { s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223); (s >> 8) as f32 / 1e7 - 0.8 };
            let w: Vec<f32> = (0..i * o).map(|_| next()).collect();
            let b: Vec<f32> = (0..o).map(|_| next()).collect();
            let x: Vec<f32> = (0..n * i).map(|_| next()).collect();
            let y = Linear::new(w.clone(), b.clone(), i).apply(&Matrix::from_rows(x.clone(), i));
            for r in 0..n {
                for c in 0..o {
                    let want = (0..i).fold(f64::from(b[c]), |a, k| a + f64::from(w[c * i + k]) * f64::from(x[r * i + k]));
                    prop_assert!((f64::from(y.row(r)[c]) - want).abs() < 1e-4);
                }
            }
        }
    }
}
