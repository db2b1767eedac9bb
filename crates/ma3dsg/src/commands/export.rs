//! `ma3dsg export GRAPH --format …`: graphs for other programs.

use super::say;
use crate::files;
use anyhow::{Context, Result};
use graph_align::json::GraphFile;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Graph file (ma3dsg-graph/1).
    graph: PathBuf,
    /// json (this program's own), csv (a folder with nodes.csv and edges.csv), graphml, dot, ply
    /// (a coloured box per object).
    #[arg(long, value_parser = ["json", "csv", "graphml", "dot", "ply"])]
    format: String,
    /// File to write; for csv a folder.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
}

impl Args {
    pub(crate) fn run(self) -> Result<ExitCode> {
        let read = || -> Result<GraphFile> {
            let file = GraphFile::parse(&files::read_text(&self.graph)?)?;
            // Refuses double ids, dangling edges and numbers out of range.
            file.to_graph(&mut graph_align::Vocabulary::default())?;
            Ok(file)
        };
        let file = read().with_context(|| format!("{}", self.graph.display()))?;
        match self.format.as_str() {
            "json" => files::write(&self.out, &serde_json::to_vec_pretty(&file)?)?,
            "csv" => {
                files::write(&self.out.join("nodes.csv"), nodes_csv(&file).as_bytes())?;
                files::write(&self.out.join("edges.csv"), edges_csv(&file).as_bytes())?;
            }
            "graphml" => files::write(&self.out, graphml(&file).as_bytes())?,
            "dot" => files::write(&self.out, dot(&file).as_bytes())?,
            _ => files::write(&self.out, ply(&file).as_bytes())?,
        }
        say(format!(
            "{} objects, {} relations written to {}",
            file.nodes.len(),
            file.edges.len(),
            self.out.display()
        ));
        Ok(ExitCode::SUCCESS)
    }
}

/// A CSV field: quoted where it has to be.
fn field(s: &str) -> String {
    if s.contains([',', '"', '\n', '\r']) { format!("\"{}\"", s.replace('"', "\"\"")) } else { s.to_owned() }
}

// Writing to a String cannot fail: results of `write!` are dropped below.

fn nodes_csv(f: &GraphFile) -> String {
    let mut out = "id,label,score,x_m,y_m,z_m,dx_m,dy_m,dz_m,sightings,last_seen_s\n".to_owned();
    for n in &f.nodes {
        let ([x, y, z], [a, b, c]) = (n.centroid, n.extent);
        let _ = writeln!(
            out,
            "{},{},{},{x},{y},{z},{a},{b},{c},{},{}",
            n.id,
            field(&n.label),
            n.score,
            n.sightings,
            n.last_seen
        );
    }
    out
}

fn edges_csv(f: &GraphFile) -> String {
    let mut out = "subject,predicate,object,score\n".to_owned();
    for e in &f.edges {
        let _ = writeln!(out, "{},{},{},{}", e.s, field(&e.p), e.t, e.score);
    }
    out
}

fn xml(s: &str) -> String {
    s.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn graphml(f: &GraphFile) -> String {
    let mut out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<graphml xmlns=\"http://graphml.graphdrawing.org/xmlns\">\n".to_owned();
    let keys = [
        ("label", "node", "string"),
        ("score", "node", "double"),
        ("x", "node", "double"),
        ("y", "node", "double"),
        ("z", "node", "double"),
        ("dx", "node", "double"),
        ("dy", "node", "double"),
        ("dz", "node", "double"),
        ("predicate", "edge", "string"),
        ("confidence", "edge", "double"),
    ];
    for (name, of, kind) in keys {
        let _ =
            writeln!(out, "  <key id=\"{name}\" for=\"{of}\" attr.name=\"{name}\" attr.type=\"{kind}\"/>");
    }
    out += "  <graph edgedefault=\"directed\">\n";
    for n in &f.nodes {
        let _ = write!(out, "    <node id=\"n{}\"><data key=\"label\">{}</data>", n.id, xml(&n.label));
        let numbers =
            [n.score, n.centroid[0], n.centroid[1], n.centroid[2], n.extent[0], n.extent[1], n.extent[2]];
        for ((name, ..), v) in keys[1..8].iter().zip(numbers) {
            let _ = write!(out, "<data key=\"{name}\">{v}</data>");
        }
        out += "</node>\n";
    }
    for (k, e) in f.edges.iter().enumerate() {
        let _ = writeln!(
            out,
            "    <edge id=\"e{k}\" source=\"n{}\" target=\"n{}\"><data key=\"predicate\">{}</data><data key=\"confidence\">{}</data></edge>",
            e.s,
            e.t,
            xml(&e.p),
            e.score
        );
    }
    out + "  </graph>\n</graphml>\n"
}

fn dot(f: &GraphFile) -> String {
    let quoted = |s: &str| s.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', " ");
    let mut out = "digraph scene {\n  node [shape=box];\n".to_owned();
    for n in &f.nodes {
        let _ = writeln!(out, "  n{} [label=\"{} {}\"];", n.id, quoted(&n.label), n.id);
    }
    for e in &f.edges {
        let _ = writeln!(out, "  n{} -> n{} [label=\"{}\"];", e.s, e.t, quoted(&e.p));
    }
    out + "}\n"
}

/// One box per object, coloured by class, with the object's number as a property (64-bit ids do not
/// fit a PLY property, so it is the position in the file).
fn ply(f: &GraphFile) -> String {
    let mut out = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty int objectId\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        8 * f.nodes.len(),
        6 * f.nodes.len()
    );
    for (k, n) in f.nodes.iter().enumerate() {
        let hash = n.label.bytes().fold(0x811c_9dc5_u32, |h, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193));
        let [r, g, b, _] = (hash | 0x0040_4040).to_le_bytes();
        for corner in 0..8 {
            let at = |axis: usize| {
                let side = if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
                n.centroid[axis] + side * n.extent[axis]
            };
            let _ = writeln!(out, "{} {} {} {r} {g} {b} {}", at(0), at(1), at(2), k + 1);
        }
    }
    const FACES: [[usize; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for k in 0..f.nodes.len() {
        for face in FACES {
            let [a, b, c, d] = face.map(|v| 8 * k + v);
            let _ = writeln!(out, "4 {a} {b} {c} {d}");
        }
    }
    out
}
