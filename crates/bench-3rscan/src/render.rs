//! The report for people: Markdown, and HTML with inline SVG.

use crate::report::number;
use serde_json::Value;
use std::fmt::Write;

/// What each column shows.
const COLUMNS: [(&str, &[&str], usize); 12] = [
    ("object R", &["object", "r"], 1),
    ("object P", &["object", "p"], 1),
    ("object F1", &["object", "f1"], 1),
    ("P no clutter", &["p_ignore_clutter"], 1),
    ("class mean R", &["class_mean", "object"], 1),
    ("predicate R", &["predicate", "r"], 1),
    ("predicate F1", &["predicate", "f1"], 1),
    ("triplet R", &["triplet", "r"], 1),
    ("triplet F1", &["triplet", "f1"], 1),
    ("bytes/agent", &["traffic_bytes_per_agent"], 0),
    ("align s", &["align_s"], 4),
    ("total CPU s", &["total_cpu_s"], 1),
];

/// What a table has to say about itself, a line each.
fn preface(report: &Value) -> Vec<String> {
    let p = &report["provenance"];
    let text = |v: &Value| v.as_str().map_or_else(|| v.to_string(), str::to_owned);
    let mut lines = vec![
        format!(
            "Data: {}, split {} (seeds {}), label set {}",
            text(&p["data"]["kind"]),
            text(&p["data"]["split"]),
            p["data"]["seeds"],
            text(&p["data"]["labels"])
        ),
        format!(
            "Weights: {} (SHA-256 {}), trained on {}",
            text(&p["weights"]["file"]),
            text(&p["weights"]["sha256"]),
            text(&p["weights"]["trained_on"])
        ),
        format!("Machine: {}, {} threads", text(&p["machine"]["cpu"]), p["machine"]["threads"]),
        format!("Command: `{}`, version {}", text(&p["command"]), text(&p["version"])),
    ];
    if p["data"]["kind"] == "generated" {
        lines.push("Generated rooms: these are not 3RScan numbers.".to_owned());
    }
    lines.push(
        "`ceiling-*` rows know the \
         truth. Rates in percent, means over seeds; object F1 with a 95 % bootstrap interval over rooms and seeds."
            .to_owned(),
    );
    lines
}

fn cell(v: Option<f64>, digits: usize) -> String {
    v.map_or_else(|| "–".to_owned(), |v| format!("{v:.digits$}"))
}

fn groups(report: &Value) -> Vec<(String, Vec<&Value>)> {
    let mut out: Vec<(String, Vec<&Value>)> = Vec::new();
    for s in report["summary"].as_array().into_iter().flatten() {
        let name =
            format!("{}, {} rooms", s["scenario"].as_str().unwrap_or_default().to_uppercase(), s["domain"]);
        match out.iter_mut().find(|(n, _)| *n == name) {
            Some((_, list)) => list.push(s),
            None => out.push((name, vec![s])),
        }
    }
    out
}

fn interval(s: &Value) -> String {
    let v = &s["object"]["f1_interval"];
    match (v[0].as_f64(), v[1].as_f64()) {
        (Some(a), Some(b)) => format!(" [{a:.1}, {b:.1}]"),
        _ => String::new(),
    }
}

/// The summary as Markdown tables, one per scenario and domain, and what the truth holds.
#[must_use]
pub fn markdown(report: &Value) -> String {
    let mut out = "# MA3DSG-Bench\n\n".to_owned();
    for line in preface(report) {
        // Writing to a String cannot fail.
        let _ = writeln!(out, "{line}  ");
    }
    for (name, rows) in groups(report) {
        let heads: Vec<&str> = COLUMNS.iter().map(|c| c.0).collect();
        let _ = writeln!(
            out,
            "\n## {name}\n\n| system | {} |\n|-|{}",
            heads.join(" | "),
            "-:|".repeat(COLUMNS.len())
        );
        for s in rows {
            let cells: Vec<String> = COLUMNS
                .iter()
                .map(|(head, path, digits)| {
                    let extra = if *head == "object F1" { interval(s) } else { String::new() };
                    cell(number(s, path), *digits) + &extra
                })
                .collect();
            let _ = writeln!(out, "| {} | {} |", s["system"].as_str().unwrap_or_default(), cells.join(" | "));
        }
    }
    out += "\n## Truth\n\n| scenario | rooms | seed | scans | frames | nodes | edges | static | moved | removed | changed | added | left out |\n|-|-:|-:|-:|-:|-:|-:|-:|-:|-:|-:|-:|-:|\n";
    for t in report["truth"].as_array().into_iter().flatten() {
        let fields = [
            "scans", "frames", "nodes", "edges", "static", "moved", "removed", "changed", "added", "left_out",
        ];
        let cells: Vec<String> = fields.iter().map(|f| t[*f].to_string()).collect();
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} |",
            t["scenario"].as_str().unwrap_or_default(),
            t["domain"],
            t["seed"],
            cells.join(" | ")
        );
    }
    out
}

fn escape(s: &str) -> String {
    s.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// One page without any outside file: bars of the three F1 rates per system, and the tables.
#[must_use]
pub fn html(report: &Value) -> String {
    let mut out = "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>MA3DSG-Bench</title><style>\
        body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:72rem;padding:0 1rem;color:#1a1a1a}\
        table{border-collapse:collapse;margin:1rem 0}td,th{padding:.2rem .6rem;text-align:right;border-bottom:1px solid #ddd}\
        td:first-child,th:first-child{text-align:left}svg text{font:12px system-ui,sans-serif}</style></head><body>\
        <h1>MA3DSG-Bench</h1>"
        .to_owned();
    for line in preface(report) {
        let _ = write!(out, "<p>{}</p>", escape(&line));
    }
    for (name, rows) in groups(report) {
        let _ = write!(out, "<h2>{}</h2>{}<table><tr><th>system</th>", escape(&name), bars(&rows));
        for (head, _, _) in COLUMNS {
            let _ = write!(out, "<th>{head}</th>");
        }
        out += "</tr>";
        for s in rows {
            let _ = write!(out, "<tr><td>{}</td>", escape(s["system"].as_str().unwrap_or_default()));
            for (_, path, digits) in COLUMNS {
                let _ = write!(out, "<td>{}</td>", cell(number(s, path), digits));
            }
            out += "</tr>";
        }
        out += "</table>";
    }
    out + "</body></html>"
}

/// Horizontal bars: object, predicate and triplet F1 of each system.
fn bars(rows: &[&Value]) -> String {
    let kinds = [("object", "#2f6db3"), ("predicate", "#d08a1d"), ("triplet", "#4d9a5a")];
    let height = rows.len() * 48 + 30;
    let mut out =
        format!("<svg width=\"720\" height=\"{height}\" role=\"img\" aria-label=\"F1 per system\">");
    for (k, (kind, colour)) in kinds.iter().enumerate() {
        let x = 180 + k * 120;
        let _ = write!(
            out,
            "<rect x=\"{x}\" y=\"4\" width=\"10\" height=\"10\" fill=\"{colour}\"/><text x=\"{}\" y=\"13\">{kind} F1</text>",
            x + 14
        );
    }
    for (i, s) in rows.iter().enumerate() {
        let y = 26 + i * 48;
        let system = escape(s["system"].as_str().unwrap_or_default());
        let _ = write!(out, "<text x=\"0\" y=\"{}\">{system}</text>", y + 22);
        for (k, (kind, colour)) in kinds.iter().enumerate() {
            let v = number(s, &[kind, "f1"]).unwrap_or(0.0);
            let y = y + k * 13;
            let _ = write!(
                out,
                "<rect x=\"180\" y=\"{y}\" width=\"{:.1}\" height=\"11\" fill=\"{colour}\"/><text x=\"{:.1}\" y=\"{}\">{v:.1}</text>",
                v * 4.6,
                186.0 + v * 4.6,
                y + 10
            );
        }
    }
    out + "</svg>"
}
