//! Several graphs as one, with the network's input computed exactly as inference does.

use crate::data::{CHANNELS, Graph};
use candle_core::{Device, Result, Tensor};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;

/// Extents and radii below this are taken for this, metres (as in sgfn-infer).
const MIN_EXTENT: f32 = 1e-3;

/// By how much a robot may misjudge the direction of the walls, radians.
const ASTRAY: f32 = 0.09;

/// Share of the nodes of which a training step sees a part only, as a camera that did not go round them.
const CROPPED: f32 = 0.15;

/// Share of the pairs without relation that a training step sees.
pub const KEEP_NONE: f32 = 0.5;

/// Tensors of one step.
pub struct Batch {
    /// [N * P, C].
    pub points: Tensor,
    pub nodes: usize,
    pub per_node: usize,
    /// [N, 8].
    pub spatial: Tensor,
    /// [E, 11].
    pub relative: Tensor,
    pub i: Tensor,
    pub j: Tensor,
    pub edges: usize,
    /// [N * deg]: edge of each node's k-th slot, E where there is none.
    pub slots: Tensor,
    pub degree: usize,
    pub classes: Vec<i64>,
    pub predicates: Vec<i64>,
}

/// How samples are varied.
pub struct Augment<'a> {
    pub rng: &'a mut ChaCha8Rng,
}

pub fn unit(rng: &mut ChaCha8Rng) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1 << 24) as f32
}

impl Batch {
    /// Joins graphs. With `augment`: some quarter turns, a few degrees and perhaps a mirror per graph, sizes scaled by
    /// up to 5 %, some nodes cropped, `keep` points per node drawn at random; else the first `keep` points, evenly spaced.
    pub fn new(graphs: &[&Graph], keep: usize, none: i64, mut augment: Option<Augment<'_>>) -> Result<Self> {
        let (mut points, mut spatial, mut descriptors) = (Vec::<f32>::new(), Vec::<f32>::new(), Vec::new());
        let (mut index, mut classes, mut predicates) = (Vec::<[usize; 2]>::new(), Vec::<i64>::new(), Vec::new());
        for g in graphs {
            let motion = augment.as_mut().map(|a| {
                let quarters = (a.rng.next_u32() & 3) as f32 * std::f32::consts::FRAC_PI_2;
                let yaw = quarters + ASTRAY * (2.0 * unit(a.rng) - 1.0);
                let mirror = if a.rng.next_u32() & 1 == 0 { 1.0 } else { -1.0 };
                (yaw.sin_cos(), mirror, 0.95 + 0.1 * unit(a.rng))
            });
            let base = classes.len();
            for node in g.points.chunks_exact(g.per_node * CHANNELS) {
                let mut node = node.to_vec();
                if let Some(((s, c), mirror, scale)) = motion {
                    for v in node.chunks_exact_mut(3) {
                        let x = v[0] * mirror;
                        (v[0], v[1]) = (c * x - s * v[1], s * x + c * v[1]);
                    }
                    for p in node.chunks_exact_mut(CHANNELS) {
                        p[..3].iter_mut().for_each(|v| *v *= scale);
                    }
                }
                if let Some(a) = augment.as_mut()
                    && unit(a.rng) < CROPPED
                {
                    crop(&mut node, a.rng);
                }
                let d = descriptor(&node, g.per_node);
                normalise(&mut node, &d);
                for k in 0..keep {
                    let q = match augment.as_mut() {
                        Some(a) => a.rng.next_u32() as usize % g.per_node,
                        None => k * g.per_node / keep,
                    };
                    points.extend(&node[q * CHANNELS..(q + 1) * CHANNELS]);
                }
                spatial.extend([d[3], d[4], d[5], d[6], d[7], d[8], d[9].ln(), d[10].ln()]);
                descriptors.push(d);
            }
            for (e, &p) in g.edges.iter().zip(&g.predicates) {
                // Most pairs say `none` (the last output): training sees a part of them, and the loss
                // weighs them up again.
                let plain = p < 0 || p == none;
                if plain && augment.as_mut().is_some_and(|a| unit(a.rng) > KEEP_NONE) {
                    continue;
                }
                index.push(e.map(|k| base + k));
                predicates.push(p);
            }
            classes.extend(&g.classes);
        }
        let relative: Vec<f32> =
            index.iter().flat_map(|&[i, j]| relative(&descriptors[j], &descriptors[i])).collect();
        let (n, e) = (classes.len(), index.len());
        let (slots, degree) = slots(&index, n);
        let dev = &Device::Cpu;
        let ids = |k: usize| Tensor::from_vec(index.iter().map(|p| p[k] as u32).collect::<Vec<_>>(), e, dev);
        Ok(Self {
            points: Tensor::from_vec(points, (n * keep, CHANNELS), dev)?,
            nodes: n,
            per_node: keep,
            spatial: Tensor::from_vec(spatial, (n, 8), dev)?,
            relative: Tensor::from_vec(relative, (e, 11), dev)?,
            i: ids(0)?,
            j: ids(1)?,
            edges: e,
            slots: Tensor::from_vec(slots, n * degree, dev)?,
            degree,
            classes,
            predicates,
        })
    }
}

/// Takes up to half of the points away, those furthest to one side, and puts copies of others in their place.
fn crop(node: &mut [f32], rng: &mut ChaCha8Rng) {
    let (s, c) = (std::f32::consts::TAU * unit(rng)).sin_cos();
    let mut along: Vec<(f32, usize)> =
        node.chunks_exact(CHANNELS).map(|p| c * p[0] + s * p[1]).zip(0..).collect();
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (gone, kept) = along.split_at((0.5 * unit(rng) * along.len() as f32) as usize);
    for &(_, to) in gone {
        let from = kept[rng.next_u32() as usize % kept.len()].1;
        node.copy_within(from * CHANNELS..(from + 1) * CHANNELS, to * CHANNELS);
    }
}

fn slots(index: &[[usize; 2]], nodes: usize) -> (Vec<u32>, usize) {
    let mut lists = vec![Vec::new(); nodes];
    for (k, e) in index.iter().enumerate() {
        lists[e[0]].push(k as u32);
    }
    let degree = lists.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let pad = index.len() as u32;
    let flat = lists.into_iter().flat_map(|mut l| {
        l.resize(degree, pad);
        l
    });
    (flat.collect(), degree)
}

fn descriptor(node: &[f32], n: usize) -> [f32; 11] {
    let mut d = [0.0_f32; 11];
    let (mut volume, mut longest) = (1.0_f64, 0.0_f64);
    for axis in 0..3 {
        let values = || node.iter().skip(axis).step_by(CHANNELS).map(|&v| f64::from(v));
        let mean = values().sum::<f64>() / n as f64;
        let var = values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n as f64 - 1.0).max(1.0);
        let (lo, hi) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let extent = (hi - lo).max(f64::from(MIN_EXTENT));
        (d[axis], d[3 + axis], d[6 + axis]) = (mean as f32, var.sqrt() as f32, extent as f32);
        volume *= extent;
        longest = longest.max(extent);
    }
    (d[9], d[10]) = (volume as f32, longest as f32);
    d
}

fn normalise(node: &mut [f32], d: &[f32; 11]) {
    let mut radius = 0.0_f32;
    for p in node.chunks_exact_mut(CHANNELS) {
        (0..3).for_each(|k| p[k] -= d[k]);
        radius = radius.max((p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt());
    }
    let scale = 1.0 / radius.max(MIN_EXTENT);
    node.chunks_exact_mut(CHANNELS).for_each(|p| p[..3].iter_mut().for_each(|v| *v *= scale));
}

fn relative(a: &[f32; 11], b: &[f32; 11]) -> [f32; 11] {
    std::array::from_fn(|k| if k < 6 { a[k] - b[k] } else { (a[k] / b[k]).ln() })
}
