//! Comparison of every intermediate with stored vectors of the authors' modules.
//!
//! The tolerance is 1e-4 + 1e-5 |x|, for probabilities 1e-5. Where an input graph holds a
//! degenerate segment (an extent below [`MIN_EXTENT`](crate::MIN_EXTENT)), the authors' code yields
//! numbers that are not finite; there `pre.*` and `enc.*` of nodes and edges that touch no
//! degenerate node are compared, and everything else has to be finite here.

use crate::model::Trace;
use crate::{EdgeScores, Error, Matrix, Model, Segment, Store};

/// One tensor of a golden file against ours.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Name in the file.
    pub tensor: String,
    /// Largest absolute difference over the compared entries.
    pub max_abs_error: f64,
    /// True when every compared entry is within tolerance, and ours are finite.
    pub within: bool,
}

/// Recomputes one golden graph and compares all its tensors, in name order.
///
/// # Errors
/// A file without inputs, inputs that the model does not take, or a shape other than ours.
pub fn compare(model: &Model, golden: &Store) -> Result<Vec<Comparison>, Error> {
    let (segments, edges) = read_inputs(golden)?;
    let features = model.encode(&segments)?;
    let mut trace = Trace::default();
    let out = model.run(&features, &edges, Some(&mut trace))?;

    let flat: Vec<bool> =
        segments.iter().map(|s| s.descriptor.0[6..9].contains(&crate::MIN_EXTENT)).collect();
    let degenerate = flat.contains(&true);
    let on_nodes = |_: usize, row: usize| !flat[row];
    let on_edges = |_: usize, row: usize| !edges[row].iter().any(|&k| flat[k]);

    let mut found = Vec::new();
    for name in golden.names().filter(|n| !n.starts_with("in.")) {
        let (shape, want) = golden.floats(name)?;
        let ours = ours(name, model, &segments, &features.nodes, &trace, &out)?;
        if ours.as_slice().len() != want.len() {
            return Err(Error::tensor(
                name,
                format!("shape {shape:?}, ours holds {} numbers", ours.as_slice().len()),
            ));
        }
        let rows = shape.first().copied().unwrap_or(1).max(1);
        let keep: &dyn Fn(usize, usize) -> bool = if !degenerate {
            &|_, _| true
        } else if name.starts_with("pre.") || name.starts_with("enc.node") {
            &on_nodes
        } else if name.starts_with("enc.edge") {
            &on_edges
        } else {
            &|_, _| false
        };
        found.push(compare_rows(name, want, ours.as_slice(), rows, keep));
    }
    Ok(found)
}

fn compare_rows(
    name: &str,
    want: &[f32],
    ours: &[f32],
    rows: usize,
    keep: &dyn Fn(usize, usize) -> bool,
) -> Comparison {
    let width = want.len() / rows;
    let probability = name.ends_with("prob") && !name.ends_with("logprob");
    let mut c = Comparison { tensor: name.to_owned(), max_abs_error: 0.0, within: true };
    for (k, (w, o)) in want.iter().zip(ours).enumerate() {
        c.within &= o.is_finite();
        if !keep(k, k / width.max(1)) {
            continue;
        }
        let (w, o) = (f64::from(*w), f64::from(*o));
        let err = (w - o).abs();
        let bound = if probability { 1e-5 } else { 1e-4 + 1e-5 * w.abs() };
        // A difference with a number that is not finite is not within any bound.
        c.within &= err <= bound;
        c.max_abs_error = if err.is_finite() { c.max_abs_error.max(err) } else { f64::INFINITY };
    }
    c
}

type Inputs = (Vec<Segment>, Vec<[usize; 2]>);

fn read_inputs(golden: &Store) -> Result<Inputs, Error> {
    let (shape, points) = golden.floats("in.raw_points")?;
    let &[n, p, c] = shape else {
        return Err(Error::tensor(
            "in.raw_points",
            format!("shape {shape:?}, want [nodes, points, channels]"),
        ));
    };
    if n * p * c == 0 {
        return Err(Error::tensor("in.raw_points", "is empty"));
    }
    let segments = points.chunks_exact(p * c).map(|s| Segment::new(s, c)).collect::<Result<Vec<_>, _>>()?;
    let (shape, index) = golden.ints("in.edge_index")?;
    let &[2, e] = shape else {
        return Err(Error::tensor("in.edge_index", format!("shape {shape:?}, want [2, edges]")));
    };
    let node = |v: i64| {
        usize::try_from(v)
            .ok()
            .filter(|&v| v < n)
            .ok_or_else(|| Error::tensor("in.edge_index", format!("node {v}, but there are {n}")))
    };
    let edges =
        (0..e).map(|k| Ok([node(index[k])?, node(index[e + k])?])).collect::<Result<Vec<_>, Error>>()?;
    Ok((segments, edges))
}

fn ours(
    name: &str,
    model: &Model,
    segments: &[Segment],
    nodes: &Matrix,
    trace: &Trace,
    out: &crate::Output,
) -> Result<Matrix, Error> {
    let split = model.config().node_dim - 8;
    let part = |a: usize, b: usize| {
        Matrix::from_rows((0..nodes.rows()).flat_map(|i| &nodes.row(i)[a..b]).copied().collect(), b - a)
    };
    let known = match name {
        "pre.points" => channels_first(segments),
        "pre.descriptor" => Matrix::from_rows(segments.iter().flat_map(|s| s.descriptor.0).collect(), 11),
        "enc.node" => nodes.clone(),
        "enc.node_pointnet" => part(0, split),
        "enc.node_spatial" => part(split, split + 8),
        "enc.edge_descriptor" => trace.edge_descriptor.clone(),
        "enc.edge" => trace.edges.clone(),
        "out.node_logits" => out.class_logits.clone(),
        "out.node_logprob" => ln(out.class_probabilities()),
        "out.edge_logits" => out.predicate_logits.clone(),
        "out.edge_prob" if model.config().edge_scores == EdgeScores::Multi => out.predicate_probabilities(),
        "out.edge_logprob" => ln(out.predicate_probabilities()),
        _ => layer_tensor(name, trace).ok_or_else(|| Error::tensor(name, "is no tensor that we compute"))?,
    };
    Ok(known)
}

fn layer_tensor(name: &str, trace: &Trace) -> Option<Matrix> {
    let (layer, what) = name.strip_prefix("gnn.")?.split_once('.')?;
    let (inner, v, e) = trace.layers.get(layer.parse::<usize>().ok()?)?;
    Some(
        match what {
            "q" => &inner.q,
            "k" => &inner.k,
            "v" => &inner.v,
            "att_logits" => &inner.att_logits,
            "att_prob" => &inner.att_prob,
            "att_weighted" => &inner.message,
            "aggregated" => &inner.aggregated,
            "node_out" => v,
            "edge_out" => e,
            _ => return None,
        }
        .clone(),
    )
}

/// [N, C, P] from our [N, P, C].
fn channels_first(segments: &[Segment]) -> Matrix {
    let mut data = Vec::new();
    for s in segments {
        for c in 0..s.channels {
            data.extend(s.points.iter().skip(c).step_by(s.channels));
        }
    }
    let cols = data.len() / segments.len().max(1);
    Matrix::from_rows(data, cols)
}

fn ln(m: Matrix) -> Matrix {
    let cols = m.cols();
    Matrix::from_rows(m.as_slice().iter().map(|v| v.ln()).collect(), cols)
}
