//! The PointNet over a segment's points and the MLP over a pair's descriptor.

use crate::linear::{Linear, Matrix, add_bias, relu};
use crate::{Error, tensors::Store};
use faer::Accum;
use rayon::prelude::*;

/// Points of one tile: activations of a tile (64 x 248 floats) stay in the L2 cache.
const TILE: usize = 64;

/// Three per-point layers with ReLU after each; for nodes the maximum over the points follows.
#[derive(Clone, Debug)]
pub(crate) struct PointNet {
    layers: [Linear; 3],
}

impl PointNet {
    pub(crate) fn load(store: &Store, prefix: &str) -> Result<Self, Error> {
        let a = store.linear(&format!("{prefix}.conv1"))?;
        let b = store.linear_from(&format!("{prefix}.conv2"), a.outputs())?;
        let c = store.linear_from(&format!("{prefix}.conv3"), b.outputs())?;
        Ok(Self { layers: [a, b, c] })
    }

    pub(crate) fn inputs(&self) -> usize {
        self.layers[0].inputs()
    }

    pub(crate) fn outputs(&self) -> usize {
        self.layers[2].outputs()
    }

    /// The feature of one point set. ReLU and the last bias commute with the maximum, so both are
    /// applied once, after it.
    pub(crate) fn pool(&self, points: &[f32], dst: &mut [f32]) {
        let [a, b, c] = &self.layers;
        let (mut x, mut y) = (vec![0.0; TILE * a.outputs()], vec![0.0; TILE * b.outputs()]);
        let mut z = vec![0.0; TILE * c.outputs()];
        dst.fill(f32::NEG_INFINITY);
        for tile in points.chunks(TILE * self.inputs()) {
            let n = tile.len() / self.inputs();
            let (x, y) = (&mut x[..n * a.outputs()], &mut y[..n * b.outputs()]);
            let z = &mut z[..n * c.outputs()];
            a.apply_slice(tile, x, Accum::Replace);
            add_bias(x, a.bias());
            relu(x);
            b.apply_slice(x, y, Accum::Replace);
            add_bias(y, b.bias());
            relu(y);
            c.apply_slice(y, z, Accum::Replace);
            for row in z.chunks_exact(c.outputs()) {
                for (d, v) in dst.iter_mut().zip(row) {
                    *d = d.max(*v);
                }
            }
        }
        for (d, b) in dst.iter_mut().zip(c.bias()) {
            *d = (*d + b).max(0.0);
        }
    }

    /// Every row of `x` on its own (a point set of one).
    pub(crate) fn rows(&self, x: &Matrix) -> Matrix {
        let [a, b, c] = &self.layers;
        let mut out = Matrix::zeros(x.rows(), self.outputs());
        let (wi, wo) = (self.inputs(), self.outputs());
        out.as_mut_slice().par_chunks_mut(TILE * wo).zip(x.as_slice().par_chunks(TILE * wi)).for_each(
            |(dst, src)| {
                let src = Matrix::from_rows(src.to_vec(), wi);
                let y = c.apply(&b.apply(&a.apply(&src).relu()).relu()).relu();
                dst.copy_from_slice(y.as_slice());
            },
        );
        out
    }
}

/// fc1, ReLU, fc2, ReLU, fc3; batch norms (evaluated, before the ReLU) are folded in.
#[derive(Clone, Debug)]
pub(crate) struct Head {
    layers: [Linear; 3],
}

impl Head {
    pub(crate) fn load(store: &Store, prefix: &str, inputs: usize) -> Result<Self, Error> {
        let mut a = store.linear_from(&format!("{prefix}.fc1"), inputs)?;
        let mut b = store.linear_from(&format!("{prefix}.fc2"), a.outputs())?;
        let c = store.linear_from(&format!("{prefix}.fc3"), b.outputs())?;
        for (k, layer) in [(1, &mut a), (2, &mut b)] {
            let bn = format!("{prefix}.bn{k}");
            if store.has(&format!("{bn}.weight")) {
                let n = layer.outputs();
                let v = |field: &str| store.vector(&format!("{bn}.{field}"), n);
                let var = v("running_var")?;
                if var.iter().any(|&x| x < 0.0) {
                    return Err(Error::tensor(&format!("{bn}.running_var"), "holds a negative variance"));
                }
                *layer = layer.clone().fold_norm(&v("weight")?, &v("bias")?, &v("running_mean")?, &var);
            }
        }
        Ok(Self { layers: [a, b, c] })
    }

    pub(crate) fn outputs(&self) -> usize {
        self.layers[2].outputs()
    }

    pub(crate) fn apply(&self, x: &Matrix) -> Matrix {
        let [a, b, c] = &self.layers;
        let mut out = Matrix::zeros(x.rows(), self.outputs());
        let (wi, wo) = (a.inputs(), self.outputs());
        out.as_mut_slice().par_chunks_mut(TILE * wo).zip(x.as_slice().par_chunks(TILE * wi)).for_each(
            |(dst, src)| {
                let src = Matrix::from_rows(src.to_vec(), wi);
                let y = c.apply(&b.apply(&a.apply(&src).relu()).relu());
                dst.copy_from_slice(y.as_slice());
            },
        );
        out
    }
}
