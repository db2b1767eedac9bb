//! Two synthetic segments and the pair between them, scored with the shipped weights:
//! `cargo run -p sgfn-infer --example classify [-- WEIGHTS.safetensors]`

#![allow(clippy::print_stdout, reason = "an example prints")]

use sgfn_infer::{Graph, Matrix, Model, Segment};

const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/weights/sgfn-l20.safetensors");

/// 16 x 16 points on the rectangle `corner + u a + v b`, each with its normal: six channels.
fn rectangle(corner: [f32; 3], a: [f32; 3], b: [f32; 3], normal: [f32; 3]) -> Vec<f32> {
    let mut out = Vec::new();
    for i in 0..256 {
        let (u, v) = ((i % 16) as f32 / 15.0, (i / 16) as f32 / 15.0);
        out.extend([0, 1, 2].map(|k| corner[k] + u * a[k] + v * b[k]));
        out.extend(normal);
    }
    out
}

/// Index and probability of the largest entry of a row.
fn best(m: &Matrix, row: usize) -> (usize, f32) {
    let start = (0, f32::NEG_INFINITY);
    m.row(row).iter().enumerate().fold(start, |b, (k, &p)| if p > b.1 { (k, p) } else { b })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| SHIPPED.to_owned());
    let model = Model::from_safetensors(&std::fs::read(path)?)?;
    let c = model.config();
    println!("{:?}, {} classes, {} predicates, {} channels", c.variant, c.classes, c.predicates, c.channels);
    if c.channels != 6 {
        return Err("this example makes points of six channels: xyz and normal".into());
    }

    // World frame, metres, z up: the floor of a room, and one of its walls.
    let floor = rectangle([0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 1.0]);
    let wall = rectangle([0.0, 3.0, 0.05], [4.0, 0.0, 0.0], [0.0, 0.0, 2.4], [0.0, -1.0, 0.0]);
    let segments = [Segment::new(&floor, c.channels)?, Segment::new(&wall, c.channels)?];
    // `[i, j]`: i is the subject, j the object. Neighbours are joined in both directions.
    let edges = [[0, 1], [1, 0]];
    let out = model.infer(&Graph { segments: &segments, edges: &edges })?;

    let (classes, predicates) = (out.class_probabilities(), out.predicate_probabilities());
    // Files may leave the names out; then outputs have numbers.
    let name = |names: &[String], k: usize| names.get(k).cloned().unwrap_or_else(|| format!("#{k}"));
    for k in 0..segments.len() {
        let (class, p) = best(&classes, k);
        println!("segment {k}: {} ({p:.2})", name(&c.class_names, class));
    }
    for (k, [i, j]) in edges.iter().enumerate() {
        let (predicate, p) = best(&predicates, k);
        println!("segment {i} to segment {j}: {} ({p:.2})", name(&c.predicate_names, predicate));
    }
    Ok(())
}
