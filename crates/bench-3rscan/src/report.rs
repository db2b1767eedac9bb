//! `report.json` (ma3dsg-report/1): rows, truth, summary, provenance.

use crate::rates::{Measured, Rates, Three};
use crate::systems::Made;
use crate::truth::TruthCounts;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// The schema's name.
pub const SCHEMA: &str = "ma3dsg-report/1";

/// Where numbers come from; printed with every result.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Provenance {
    /// Command line.
    pub command: String,
    /// Version of this program.
    pub version: String,
    /// `kind`, `seeds`, `labels`.
    pub data: Value,
    /// `file`, `sha256`, `trained_on`.
    pub weights: Value,
    /// `cpu`, `threads`.
    pub machine: Value,
    /// Everything that was set.
    pub params: Value,
}

/// Which cell a row belongs to.
#[derive(Clone, Debug)]
pub struct CellName<'a> {
    /// System.
    pub system: &'a str,
    /// Scenario.
    pub scenario: &'a str,
    /// Number of rooms.
    pub domain: usize,
    /// Seed.
    pub seed: u64,
}

/// What a cell was run with.
#[derive(Clone, Debug)]
pub struct CellSetting<'a> {
    /// Number of agents; 1 for single-agent systems.
    pub agents: usize,
    /// 2S / V.
    pub overlap_measured: f64,
    /// Frame mode.
    pub frames_mode: &'a str,
    /// Frames of the single agent over those of the busiest agent.
    pub bound: f64,
}

fn three(t: &Three) -> Map<String, Value> {
    let put = |r: Rates| json!(r);
    Map::from_iter([
        ("object".to_owned(), put(t.object.rates())),
        ("predicate".to_owned(), put(t.predicate.rates())),
        ("triplet".to_owned(), put(t.triplet.rates())),
    ])
}

/// One row. Cells that a system does not have are null.
#[must_use]
pub fn row(name: &CellName<'_>, set: &CellSetting<'_>, made: &Made, m: &Measured, graph_hash: &str) -> Value {
    let e = made.exchange.as_ref();
    let agents = set.agents as f64;
    let mean = |v: &[u64]| v.iter().sum::<u64>() as f64 / agents;
    let mut row = Map::from_iter([
        ("system".to_owned(), json!(name.system)),
        ("scenario".to_owned(), json!(name.scenario)),
        ("domain".to_owned(), json!(name.domain)),
        ("seed".to_owned(), json!(name.seed)),
        ("agents".to_owned(), json!(set.agents)),
        ("overlap_measured".to_owned(), json!(e.map(|_| set.overlap_measured))),
        ("frames_mode".to_owned(), json!(set.frames_mode)),
        ("visits".to_owned(), json!(made.visits)),
        ("frames".to_owned(), json!(made.frames)),
        ("frames_max_agent".to_owned(), json!(made.frames_max_agent)),
        ("bound".to_owned(), json!(e.map(|_| set.bound))),
    ]);
    row.extend(three(&m.main));
    let per_room = m.per_room.iter().enumerate().map(|(k, t)| {
        let mut r = three(t);
        r.insert("room".to_owned(), json!(k));
        Value::Object(r)
    });
    row.extend([
        ("p_ignore_clutter".to_owned(), json!(m.p_ignore_clutter)),
        (
            "class_mean".to_owned(),
            json!({"object": m.class_mean_object, "predicate": m.class_mean_predicate}),
        ),
        (
            "iou".to_owned(),
            json!({"0.25": three(&m.iou[0]), "0.5": three(&m.iou[1]), "centre": three(&m.centre)}),
        ),
        ("changes".to_owned(), json!(e.and_then(|e| e.changes.as_ref()))),
        (
            "links".to_owned(),
            json!(e.and_then(|e| e.links).map(|[f, t, w]| json!({"found": f, "true": t, "wrong": w}))),
        ),
        ("replicas_equal".to_owned(), json!(e.map(|e| e.replicas_equal))),
        ("traffic_bytes_per_agent".to_owned(), json!(e.map(|e| mean(&e.bytes)))),
        ("traffic_bytes_all_copies".to_owned(), json!(e.map(|e| mean(&e.copies)))),
        (
            "traffic_bytes_per_visit".to_owned(),
            json!(e.map(|e| e.bytes.iter().sum::<u64>() as f64 / made.visits.max(1) as f64)),
        ),
        ("points_bytes_per_agent".to_owned(), Value::Null),
        ("align_s".to_owned(), json!(e.map(|e| e.align_s))),
        ("align_s_all".to_owned(), json!(e.map(|e| e.align_s_all))),
        ("refold_s".to_owned(), json!(e.map(|e| e.refold_s))),
        ("total_cpu_s".to_owned(), json!(made.total_cpu_s)),
        ("total_wall_s".to_owned(), json!(made.total_wall_s)),
        ("world_s".to_owned(), json!(made.world_s)),
        ("graph_hash".to_owned(), json!(graph_hash)),
        ("per_room".to_owned(), per_room.collect()),
    ]);
    Value::Object(row)
}

/// The truth entry of a scenario, domain and seed.
#[must_use]
pub fn truth_entry(name: &CellName<'_>, scans: usize, frames: u64, c: &TruthCounts) -> Value {
    let mut v = json!({
        "scenario": name.scenario, "domain": name.domain, "seed": name.seed,
        "rooms": name.domain, "scans": scans, "frames": frames,
    });
    if let (Some(v), Value::Object(c)) = (v.as_object_mut(), json!(c)) {
        v.extend(c);
    }
    v
}

/// A row's number under a dotted path.
#[must_use]
pub fn number(row: &Value, path: &[&str]) -> Option<f64> {
    path.iter().try_fold(row, |v, k| v.get(k)).and_then(Value::as_f64)
}

/// Means over seeds per (system, scenario, domain), with bootstrap intervals over rooms and seeds.
#[must_use]
pub fn summary(rows: &[Value]) -> Vec<Value> {
    let mut keys: Vec<(String, String, u64)> = Vec::new();
    let key = |r: &Value| {
        let text = |k: &str| r[k].as_str().unwrap_or_default().to_owned();
        (text("system"), text("scenario"), r["domain"].as_u64().unwrap_or(0))
    };
    for r in rows {
        if !keys.contains(&key(r)) {
            keys.push(key(r));
        }
    }
    keys.into_iter()
        .map(|k| one_summary(&k, &rows.iter().filter(|r| key(r) == k).collect::<Vec<_>>()))
        .collect()
}

fn one_summary(key: &(String, String, u64), rows: &[&Value]) -> Value {
    let mean = |path: &[&str]| {
        let v: Vec<f64> = rows.iter().filter_map(|r| number(r, path)).collect();
        (!v.is_empty()).then(|| v.iter().sum::<f64>() / v.len() as f64)
    };
    let kind = |k: &str| {
        json!({
            "r": mean(&[k, "r"]), "p": mean(&[k, "p"]), "f1": mean(&[k, "f1"]),
            "f1_interval": interval(rows, k),
        })
    };
    json!({
        "system": key.0, "scenario": key.1, "domain": key.2, "seeds": rows.len(),
        "object": kind("object"), "predicate": kind("predicate"), "triplet": kind("triplet"),
        "class_mean": {"object": mean(&["class_mean", "object"]), "predicate": mean(&["class_mean", "predicate"])},
        "p_ignore_clutter": mean(&["p_ignore_clutter"]),
        "traffic_bytes_per_agent": mean(&["traffic_bytes_per_agent"]),
        "align_s": mean(&["align_s"]), "total_cpu_s": mean(&["total_cpu_s"]),
    })
}

/// 95 % interval of the pooled F1 under resampling of rooms (1000 draws, fixed seed).
fn interval(rows: &[&Value], kind: &str) -> Option<[f64; 2]> {
    let rooms: Vec<[f64; 3]> = rows
        .iter()
        .flat_map(|r| r["per_room"].as_array().into_iter().flatten())
        .map(|r| ["tp", "fp", "fn"].map(|k| number(r, &[kind, k]).unwrap_or(0.0)))
        .collect();
    if rooms.len() < 2 {
        return None;
    }
    let mut rng = crate::seeds::stream(1, "bootstrap", &[]);
    let mut f1: Vec<f64> = (0..1000)
        .map(|_| {
            let mut s = [0.0; 3];
            for _ in 0..rooms.len() {
                let k = (crate::seeds::unit(&mut rng) * rooms.len() as f64) as usize;
                s.iter_mut().zip(rooms[k.min(rooms.len() - 1)]).for_each(|(a, v)| *a += v);
            }
            200.0 * s[0] / (2.0 * s[0] + s[1] + s[2]).max(1.0)
        })
        .collect();
    f1.sort_by(f64::total_cmp);
    Some([f1[25], f1[974]])
}
