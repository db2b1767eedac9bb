//! Sample files: graphs with points, pairs and truth.

use anyhow::{Context, Result, bail};
use safetensors::SafeTensors;
use std::path::Path;

/// Numbers per stored point: xyz, normal.
pub const CHANNELS: usize = 6;

/// One graph.
pub struct Graph {
    pub kind: String,
    /// N x P x 6.
    pub points: Vec<f32>,
    pub per_node: usize,
    /// Output index per node; -1 takes no part.
    pub classes: Vec<i64>,
    pub edges: Vec<[usize; 2]>,
    pub predicates: Vec<i64>,
}

impl Graph {
    pub fn len(&self) -> usize {
        self.classes.len()
    }
}

/// All graphs of some files, with the names of the outputs.
pub struct Samples {
    pub graphs: Vec<Graph>,
    pub class_names: Vec<String>,
    pub predicate_names: Vec<String>,
}

impl Samples {
    /// Reads every sample file of a folder whose name starts with `split`.
    pub fn load(dir: &Path, split: &str) -> Result<Self> {
        let mut files: Vec<_> = std::fs::read_dir(dir)
            .with_context(|| format!("{}", dir.display()))?
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with(split)))
            .filter(|p| p.extension().is_some_and(|x| x == "safetensors"))
            .collect();
        files.sort();
        let mut all = Self { graphs: Vec::new(), class_names: Vec::new(), predicate_names: Vec::new() };
        for f in &files {
            let bytes = std::fs::read(f)?;
            all.read(&bytes).with_context(|| format!("{}", f.display()))?;
        }
        if all.graphs.is_empty() {
            bail!("{}: no {split}-*.safetensors", dir.display());
        }
        Ok(all)
    }

    fn read(&mut self, bytes: &[u8]) -> Result<()> {
        let (_, meta) = SafeTensors::read_metadata(bytes)?;
        let meta = meta.metadata().clone().context("no metadata")?;
        let lines = |key: &str| -> Result<Vec<String>> {
            Ok(meta.get(key).with_context(|| key.to_owned())?.lines().map(str::to_owned).collect())
        };
        (self.class_names, self.predicate_names) = (lines("class_names")?, lines("predicate_names")?);
        let file = SafeTensors::deserialize(bytes)?;
        for (k, kind) in lines("kinds")?.into_iter().enumerate() {
            let points = file.tensor(&format!("{k}.points"))?;
            let &[_, per_node, CHANNELS] = points.shape() else { bail!("{k}.points: {:?}", points.shape()) };
            let ints = |name: &str| -> Result<Vec<i64>> {
                let t = file.tensor(&format!("{k}.{name}"))?;
                Ok(t.data().as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b)).collect())
            };
            let edges = ints("edges")?;
            let mut points: Vec<f32> =
                points.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
            turn_to_walls(&mut points, per_node);
            self.graphs.push(Graph {
                kind,
                points,
                per_node,
                classes: ints("classes")?,
                edges: edges.as_chunks::<2>().0.iter().map(|e| e.map(|v| v as usize)).collect(),
                predicates: ints("predicates")?,
            });
        }
        Ok(())
    }
}

/// Turns points about z so that most upright surface faces along an axis, as `agent` does before it infers: the mean of
/// the normals' directions modulo a quarter turn, each node by the area of its box seen from the side (samples do not hold the
/// area of the surfels, by which `agent` goes).
fn turn_to_walls(points: &mut [f32], per_node: usize) {
    let (mut sin, mut cos) = (0.0_f64, 0.0_f64);
    for node in points.chunks_exact(per_node * CHANNELS) {
        let side = |k: usize| {
            let of = node.chunks_exact(CHANNELS).map(|p| p[k]);
            f64::from(of.clone().fold(f32::MIN, f32::max) - of.fold(f32::MAX, f32::min))
        };
        let area = side(0).hypot(side(1)) * side(2);
        for n in node.chunks_exact(CHANNELS).map(|p| &p[3..]).filter(|n| n[2].abs() < 0.3) {
            let four = 4.0 * f64::from(n[1].atan2(n[0]));
            sin += area * four.sin();
            cos += area * four.cos();
        }
    }
    let (s, c) = (-sin.atan2(cos) / 4.0).sin_cos();
    for v in points.chunks_exact_mut(3) {
        let (x, y) = (f64::from(v[0]), f64::from(v[1]));
        (v[0], v[1]) = ((c * x - s * y) as f32, (s * x + c * y) as f32);
    }
}
