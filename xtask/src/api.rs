//! The public API of graph-align as text, one item a line, compared with the one that is kept.
//!
//! The list comes from rustdoc's JSON, which a stable toolchain writes when it is asked as a nightly one. Only
//! what is needed to tell two APIs apart is read from it, so that a new format number rarely matters.

use crate::{cargo, must};
use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// The kept list.
const KEPT: &str = "crates/graph-align/api.txt";

/// Compares the API with the kept one, or writes it anew.
pub(crate) fn run(write: bool) -> Result<()> {
    let list = list()?;
    if write {
        std::fs::write(KEPT, &list).context(KEPT)?;
        eprintln!("api: {} items written to {KEPT}", list.lines().count());
        return Ok(());
    }
    let kept = std::fs::read_to_string(KEPT).context(KEPT)?;
    let (now, then): (BTreeSet<&str>, BTreeSet<&str>) = (list.lines().collect(), kept.lines().collect());
    for gone in then.difference(&now) {
        eprintln!("- {gone}");
    }
    for new in now.difference(&then) {
        eprintln!("+ {new}");
    }
    if now != then {
        bail!(
            "the public API of graph-align is not that of {KEPT}; if it is meant so: cargo xtask api --write"
        );
    }
    eprintln!("api: {} items as in {KEPT}", now.len());
    Ok(())
}

fn list() -> Result<String> {
    let target = PathBuf::from(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    must(
        "public API",
        cargo(&["rustdoc", "--quiet", "-p", "graph-align", "--all-features", "--lib", "--target-dir"])
            .arg(target.join("api"))
            .args(["--", "-Z", "unstable-options", "--output-format", "json"])
            .env("RUSTC_BOOTSTRAP", "1")
            .env_remove("RUSTDOCFLAGS"),
    )?;
    let path = target.join("api/doc/graph_align.json");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let doc: Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    let root = doc["root"].clone();
    let mut walk = Walk { index: &doc["index"], out: BTreeSet::new() };
    walk.module(&root, "graph_align")?;
    let mut out: String = walk.out.into_iter().collect::<Vec<_>>().join("\n");
    out.push('\n');
    Ok(out)
}

struct Walk<'a> {
    index: &'a Value,
    out: BTreeSet<String>,
}

impl<'a> Walk<'a> {
    fn item(&self, id: &Value) -> Result<&'a Value> {
        // Ids are numbers, keys of the index their decimal text.
        let key = id.as_u64().map_or_else(|| id.as_str().unwrap_or_default().to_owned(), |n| n.to_string());
        self.index.get(&key).with_context(|| format!("rustdoc names item {key} and does not hold it"))
    }

    fn children<'b>(list: &'b Value) -> impl Iterator<Item = &'b Value> + use<'b> {
        list.as_array().into_iter().flatten()
    }

    fn module(&mut self, id: &Value, path: &str) -> Result<()> {
        let items = self.item(id)?;
        for child in Self::children(&items["inner"]["module"]["items"]) {
            let item = self.item(child)?;
            let (kind, inner) = kind_of(item)?;
            if kind == "use" {
                // What is re-exported stands in the documentation of this crate, or is another's.
                let name = inner["name"].as_str().unwrap_or("?");
                match self.item(&inner["id"]) {
                    Ok(target) => self.named(target, &format!("{path}::{name}"))?,
                    Err(_) => {
                        self.out.insert(format!("use {path}::{name} = {}", short(&inner["source"])));
                    }
                }
            } else {
                let name = item["name"].as_str().unwrap_or("?");
                self.named(item, &format!("{path}::{name}"))?;
            }
        }
        Ok(())
    }

    fn named(&mut self, item: &Value, path: &str) -> Result<()> {
        let (kind, inner) = kind_of(item)?;
        match kind {
            "module" => {
                self.out.insert(format!("mod {path}"));
                return self.module(&item["id"], path);
            }
            "struct" => {
                self.line(kind, path, item, "");
                let of = &inner["kind"];
                let fields = if of["plain"].is_object() { &of["plain"]["fields"] } else { &of["tuple"] };
                self.fields(fields, path)?;
            }
            "enum" => {
                self.line(kind, path, item, "");
                for v in Self::children(&inner["variants"]) {
                    let variant = self.item(v)?;
                    let name = format!("{path}::{}", variant["name"].as_str().unwrap_or("?"));
                    self.line("variant", &name, variant, "");
                    let k = &variant["inner"]["variant"]["kind"];
                    let fields = if k["struct"].is_object() { &k["struct"]["fields"] } else { &k["tuple"] };
                    self.fields(fields, &name)?;
                }
            }
            "function" => self.line("fn", path, item, &signature(inner)),
            "constant" => self.line("const", path, item, &short(&inner["type"])),
            _ => self.line(kind, path, item, &short(inner)),
        }
        self.impls(&inner["impls"], path)
    }

    /// Fields, whose types count; hidden ones are not in the list.
    fn fields(&mut self, list: &Value, path: &str) -> Result<()> {
        for f in Self::children(list).filter(|f| !f.is_null()) {
            let field = self.item(f)?;
            let name = format!("{path}.{}", field["name"].as_str().unwrap_or("?"));
            let of = short(&field["inner"]["struct_field"]);
            self.line("field", &name, field, &of);
        }
        Ok(())
    }

    fn impls(&mut self, list: &Value, path: &str) -> Result<()> {
        for i in Self::children(list) {
            let Ok(item) = self.item(i) else { continue };
            let inner = &item["inner"]["impl"];
            if inner["is_synthetic"] == true || !inner["blanket_impl"].is_null() {
                continue;
            }
            if let Some(of) = inner["trait"].as_object() {
                self.out.insert(format!("impl {} for {path}", short(&Value::Object(of.clone()))));
                continue;
            }
            for f in Self::children(&inner["items"]) {
                let item = self.item(f)?;
                let (kind, inner) = kind_of(item)?;
                let name = format!("{path}::{}", item["name"].as_str().unwrap_or("?"));
                match kind {
                    "function" => self.line("fn", &name, item, &signature(inner)),
                    "assoc_const" => self.line("const", &name, item, &short(&inner["type"])),
                    _ => self.line(kind, &name, item, &short(inner)),
                }
            }
        }
        Ok(())
    }

    fn line(&mut self, kind: &str, path: &str, item: &Value, rest: &str) {
        let attrs = item["attrs"].to_string();
        let open = if attrs.contains("non_exhaustive") { "non_exhaustive " } else { "" };
        let gap = if rest.is_empty() || rest.starts_with('(') { "" } else { ": " };
        self.out.insert(format!("{open}{kind} {path}{gap}{rest}"));
    }
}

fn kind_of(item: &Value) -> Result<(&str, &Value)> {
    let one = item["inner"].as_object().and_then(|o| o.iter().next());
    one.map(|(k, v)| (k.as_str(), v)).with_context(|| format!("item {} has no kind", item["id"]))
}

/// `(name: type, …) -> type`, with the bounds of its parameters where there are any.
fn signature(f: &Value) -> String {
    let of = |a: &Value| format!("{}: {}", a[0].as_str().unwrap_or("_"), short(&a[1]));
    let inputs: Vec<String> = f["sig"]["inputs"].as_array().into_iter().flatten().map(of).collect();
    let output = &f["sig"]["output"];
    let returns = if output.is_null() { String::new() } else { format!(" -> {}", short(output)) };
    let generic = f["generics"]["params"].as_array().is_some_and(|p| !p.is_empty());
    let bounds = if generic { format!(" where {}", short(&f["generics"])) } else { String::new() };
    format!("({}){returns}{bounds}", inputs.join(", "))
}

/// A type as short text: names and structure, without ids, which differ from build to build.
fn short(v: &Value) -> String {
    match v {
        Value::Object(o) if o.contains_key("path") => {
            // The last name alone: how a file imports it is no part of the API.
            let name = v["path"].as_str().unwrap_or("?").rsplit("::").next().unwrap_or("?");
            let args = v.get("args").filter(|a| !a.is_null()).map(short).filter(|a| !a.is_empty());
            args.map_or_else(|| name.to_owned(), |a| format!("{name}<{a}>"))
        }
        Value::Object(o) => {
            let skip = |k: &str, v: &Value| {
                matches!(k, "id" | "is_synthetic" | "modifier")
                    || v.is_null()
                    || k != "tuple" && v.as_array().is_some_and(Vec::is_empty)
                    || *v == Value::Bool(false)
            };
            let parts: Vec<String> = o
                .iter()
                .filter(|(k, v)| !skip(k, v))
                .map(|(k, v)| part(k, v))
                .filter(|p| !p.is_empty())
                .collect();
            parts.join(" ")
        }
        Value::Array(a) => format!("[{}]", a.iter().map(short).collect::<Vec<_>>().join(", ")),
        Value::String(s) => s.clone(),
        other => other.to_string(),
    }
}

/// One member of an object; names that every type has are left out.
fn part(key: &str, v: &Value) -> String {
    match key {
        "primitive" | "generic" | "name" | "resolved_path" | "type" | "angle_bracketed" => short(v),
        "borrowed_ref" => {
            let lifetime = v["lifetime"].as_str().map(|l| format!("{l} ")).unwrap_or_default();
            let mutable = if v["is_mutable"] == true { "mut " } else { "" };
            format!("&{lifetime}{mutable}{}", short(&v["type"]))
        }
        "tuple" => {
            format!("({})", v.as_array().into_iter().flatten().map(short).collect::<Vec<_>>().join(", "))
        }
        "args" => v.as_array().into_iter().flatten().map(short).collect::<Vec<_>>().join(", "),
        "slice" => format!("[{}]", short(v)),
        "array" => format!("[{}; {}]", short(&v["type"]), short(&v["len"])),
        _ if *v == Value::Bool(true) => key.to_owned(),
        _ => format!("{key} {}", short(v)),
    }
}
