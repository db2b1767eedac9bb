//! The published crate as its users get it: packaged, unpacked, and the only dependency of a program.

use crate::{cargo, must};
use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

const PROGRAM: &str = r#"use graph_align::{align, Box3, Node, NodeId, Outcome, Params, Query, SceneGraph, Vocabulary};

fn main() -> Result<(), graph_align::Error> {
    let mut names = Vocabulary::default();
    let mut map = SceneGraph::default();
    for (k, name) in ["bed", "desk", "lamp", "sofa", "chair", "plant"].into_iter().enumerate() {
        let at = [(k * k) as f32 * 0.4, k as f32 * 0.9, 0.5];
        map.insert_node(Node::new(NodeId(k as u64), names.label(name)?, Box3::new(at, [0.5; 3])?));
    }
    let found = align(&map, &Query::new(&map), &Params::default());
    println!("{}", if matches!(found, Outcome::Match(_)) { "found" } else { "not found" });
    Ok(())
}
"#;

/// Packages graph-align and builds and runs a program against the unpacked package.
pub(crate) fn run() -> Result<ExitCode> {
    let target = PathBuf::from(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    must(
        "package",
        &mut cargo(&["package", "--quiet", "--allow-dirty", "--no-verify", "-p", "graph-align"]),
    )?;
    let package = newest(&target.join("package"))?;
    let home = target.join("consumer");
    std::fs::create_dir_all(home.join("src")).context("target/consumer")?;
    must("unpack", Command::new("tar").args(["xzf"]).arg(&package).arg("-C").arg(&home))?;
    let name = package.file_stem().and_then(|n| n.to_str()).context("package name")?;
    let manifest = format!(
        "[package]\nname = \"consumer\"\nversion = \"0.0.0\"\nedition = \"2021\"\n\n[dependencies]\n\
         graph-align = {{ path = \"{name}\" }}\n\n[workspace]\n"
    );
    std::fs::write(home.join("Cargo.toml"), manifest).context("manifest")?;
    std::fs::write(home.join("src/main.rs"), PROGRAM).context("program")?;
    let out = cargo(&["run", "--quiet", "--manifest-path"])
        .arg(home.join("Cargo.toml"))
        .output()
        .context("cargo run")?;
    let said = String::from_utf8_lossy(&out.stdout);
    if said.trim() != "found" {
        bail!("the consumer said {said:?}\n{}", String::from_utf8_lossy(&out.stderr));
    }
    eprintln!("a program whose only dependency is {name} builds and finds its room");
    Ok(ExitCode::SUCCESS)
}

/// The package of graph-align that was written last.
fn newest(dir: &Path) -> Result<PathBuf> {
    let mut found: Vec<(std::time::SystemTime, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(dir).with_context(|| format!("{}", dir.display()))? {
        let path = entry?.path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        if name.starts_with("graph-align-") && name.ends_with(".crate") {
            found.push((path.metadata()?.modified()?, path));
        }
    }
    found.sort();
    Ok(found.pop().with_context(|| format!("{}: no package", dir.display()))?.1)
}
