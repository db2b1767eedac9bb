//! Which crates may know which, read off cargo's own tree.

use crate::cargo;
use anyhow::{Context, Result, bail};

/// Every crate of ours and the crates of ours that it may know, directly or not.
const ALLOWED: [(&str, &[&str]); 8] = [
    ("graph-align", &[]),
    ("ma3dsg-gsm", &[]),
    ("sgfn-infer", &[]),
    ("scan3r", &[]),
    ("room-synth", &["scan3r"]),
    ("fleet", &["graph-align"]),
    ("agent", &["graph-align", "ma3dsg-gsm", "scan3r", "sgfn-infer"]),
    ("bench-3rscan", &["agent", "fleet", "graph-align", "ma3dsg-gsm", "room-synth", "scan3r", "sgfn-infer"]),
];

/// Source text that the pure cores may not contain: input and output, clocks.
const IMPURE: [&str; 5] = ["std::fs", "std::net", "std::io", "std::time", "println!"];
const PURE: [&str; 3] = ["graph-align", "gsm", "sgfn-infer"];

/// Fails at the first arrow or import that the house forbids.
pub(crate) fn check() -> Result<()> {
    let ours: Vec<&str> = ALLOWED.iter().map(|a| a.0).chain(["ma3dsg"]).collect();
    for (name, allowed) in ALLOWED {
        let out =
            cargo(&["tree", "-p", name, "-e", "normal", "--prefix", "none", "--all-features", "--offline"])
                .output()
                .context("cargo tree")?;
        if !out.status.success() {
            bail!("cargo tree -p {name}: {}", String::from_utf8_lossy(&out.stderr));
        }
        let text = String::from_utf8_lossy(&out.stdout);
        let known = text.lines().filter_map(|l| l.split_whitespace().next()).filter(|n| ours.contains(n));
        for other in known.filter(|n| *n != name) {
            if !allowed.contains(&other) {
                bail!("{name} knows {other}; it may know {allowed:?}");
            }
        }
    }
    for dir in PURE {
        pure(std::path::Path::new("crates").join(dir).join("src").as_path())?;
    }
    eprintln!("arrows: {} crates know what they may, {} cores are pure", ALLOWED.len(), PURE.len());
    Ok(())
}

fn pure(dir: &std::path::Path) -> Result<()> {
    for entry in std::fs::read_dir(dir).with_context(|| dir.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            pure(&path)?;
            continue;
        }
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        // Doc comments show how a caller reads files; unit tests come last in a file.
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        let found = code
            .lines()
            .filter(|l| !l.trim_start().starts_with("//"))
            .find_map(|l| IMPURE.iter().find(|w| l.contains(**w)).map(|w| (w, l)));
        if let Some((word, line)) = found {
            bail!("{}: {word} in a pure core: {}", path.display(), line.trim());
        }
    }
    Ok(())
}
