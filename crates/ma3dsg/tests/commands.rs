//! The commands end to end on one generated room.

#![allow(clippy::expect_used, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ma3dsg")).args(args).output().expect("ma3dsg")
}

fn done(args: &[&str]) -> String {
    let out = run(args);
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).expect("UTF-8")
}

fn text(p: &Path) -> String {
    p.to_str().expect("UTF-8").to_owned()
}

fn read(p: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(p).expect("file")).expect("JSON")
}

#[test]
fn bench_writes_what_the_contract_asks_and_shards_resume() {
    let dir = tempfile::tempdir().expect("folder");
    let out = text(dir.path());
    let base =
        ["bench", "--domain", "1,2", "--agents", "2", "--scenario", "scp", "--seed", "6", "--out", &out];
    let with = |more: &[&'static str]| -> Vec<String> {
        base.iter().map(|s| (*s).to_owned()).chain(more.iter().map(|s| (*s).to_owned())).collect()
    };
    let call = |more: &[&'static str]| run(&with(more).iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(call(&["--shard", "0/2"]).status.code(), Some(2), "one cell is missing");
    assert_eq!(call(&["--resume"]).status.code(), Some(0));
    let report = read(&dir.path().join("report.json"));
    assert_eq!(report["schema"], "ma3dsg-report/1");
    let rows = report["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 22, "eleven systems, two domains");
    for r in rows {
        let stem = format!("{}-scp-{}-6", r["system"].as_str().unwrap(), r["domain"]);
        let bytes = fs::read(dir.path().join("graphs").join(format!("{stem}.json"))).expect("graph");
        let hash = bench_3rscan::run::hex(&<sha2::Sha256 as sha2::Digest>::digest(&bytes));
        assert_eq!(r["graph_hash"], hash.as_str());
        assert_eq!(r["traffic_bytes_per_agent"].is_null(), !stem.starts_with("ma3dsg"), "{stem}");
        // Frames on disk are what the traffic counts, plus sync requests.
        if let Some(sent) = r["traffic_bytes_per_agent"].as_f64() {
            let wire = fs::read(dir.path().join("wire").join(format!("{stem}.bin"))).expect("frames");
            let (mut at, mut frames) = (0, 0);
            while at < wire.len() {
                let n = u32::from_le_bytes(wire[at..at + 4].try_into().unwrap()) as usize;
                (at, frames) = (at + 4 + n, frames + n);
            }
            assert!(frames as f64 <= 2.0 * sent && frames > 0, "{stem}: {frames} of {sent}");
        }
    }
    let by = |system: &str| rows.iter().find(|r| r["system"] == system && r["domain"] == 2).unwrap().clone();
    for system in ["ma3dsg", "ma3dsg-paper", "ma3dsg-append"] {
        assert_eq!(by(system)["replicas_equal"], true, "{system}");
    }
    assert_ne!(by("ma3dsg")["graph_hash"], by("ma3dsg-append")["graph_hash"], "nothing was aligned");
    let f1 = |system: &str| by(system)["object"]["f1"].as_f64().unwrap();
    assert!(f1("ceiling-oracle-labels") > f1("sgfn") && f1("sgfn") > f1("majority"));
    for f in ["report.md", "report.html", "truth/scp-2-6.json"] {
        assert!(dir.path().join(f).is_file(), "{f}");
    }
    assert!(fs::read_to_string(dir.path().join("report.md")).unwrap().contains("not 3RScan numbers"));
}

#[test]
fn threads_do_not_change_a_graph_and_seeds_do() {
    let hash = |threads: &str, seed: &str| {
        let dir = tempfile::tempdir().expect("folder");
        let out = text(dir.path());
        done(
            &[
                "--threads",
                threads,
                "bench",
                "--domain",
                "2",
                "--agents",
                "2",
                "--scenario",
                "scp",
                "--systems",
                "ma3dsg-paper",
                "--seed",
                seed,
                "--out",
                &out,
            ][..],
        );
        read(&dir.path().join("report.json"))["rows"][0]["graph_hash"].clone()
    };
    assert_eq!(hash("1", "8"), hash("3", "8"));
    assert_ne!(hash("2", "8"), hash("2", "9"));
}

#[test]
fn a_written_data_set_gives_the_rendered_one_and_scans() {
    let dir = tempfile::tempdir().expect("folder");
    let data = text(&dir.path().join("data"));
    done(&["synth", "--rooms", "1", "--seed", "5", "-o", &data]);
    let hashes = |more: &[&str]| {
        let out = text(&dir.path().join("run"));
        let mut args = vec![
            "bench",
            "--domain",
            "1",
            "--agents",
            "1",
            "--seed",
            "5",
            "--systems",
            "sgfn",
            "--out",
            &out,
        ];
        args.extend(more);
        done(&args);
        let rows = read(&dir.path().join("run/report.json"))["rows"].as_array().unwrap().clone();
        rows.iter().map(|r| r["graph_hash"].clone()).collect::<Vec<_>>()
    };
    let rendered = hashes(&[]);
    assert_eq!(rendered.len(), 2);
    assert_eq!(hashes(&["--data", &data]), rendered);
    // Rooms stand elsewhere under another seed: what one cell computed is no other seed's.
    let scp = |seeds: &[&str]| hashes(&[&["--data", &data, "--scenario", "scp"], seeds].concat());
    let both = scp(&["--seeds", "2"]);
    assert_eq!((both[0].clone(), both.len()), (rendered[0].clone(), 2));
    assert_ne!(both[0], both[1]);
    let first = fs::read_dir(&data).unwrap().map(|e| e.unwrap().path()).find(|p| p.is_dir()).unwrap();
    let out = dir.path().join("scan");
    done(&["scan", &text(&first), "-o", &text(&out)]);
    let graph = read(&out.join("graph.json"));
    assert_eq!((&graph["schema"], &graph["gravity_aligned"]), (&json!("ma3dsg-graph/1"), &json!(true)));
    let frames = fs::read_to_string(out.join("frames.csv")).unwrap();
    assert_eq!(frames.lines().next(), Some("frame,ms_segment,ms_infer,surfels,active_surfels,segments"));
    let ply = fs::read(out.join("segments.ply")).unwrap();
    let mesh = scan3r::ply::read_ply(&ply, Path::new("segments.ply")).expect("a PLY with labels");
    assert!(
        mesh.points.len() > 10_000
            && mesh.instances.iter().filter(|&&l| l > 0).count() * 10 > 9 * mesh.points.len()
    );
}

/// A room of eight objects on a floor.
fn room(turn: f64, shift: [f64; 2], first: u64) -> Value {
    let (s, c) = turn.sin_cos();
    let labels = ["chair", "table", "sofa", "cabinet", "door", "window", "bed", "desk"];
    let mut nodes = vec![
        json!({"id": first, "label": "floor", "centroid": [shift[0], shift[1], 0.0], "extent": [6, 6, 0.1]}),
    ];
    let mut edges = Vec::new();
    for (k, label) in labels.iter().enumerate() {
        let (x, y) = (1.3 * (k % 3) as f64 - 1.0 + 0.1 * k as f64, 1.1 * (k / 3) as f64 - 0.7);
        let at = [c * x - s * y + shift[0], s * x + c * y + shift[1], 0.2 + 0.05 * k as f64];
        nodes.push(
            json!({"id": first + 1 + k as u64, "label": label, "centroid": at, "extent": [0.5, 0.5, 0.4]}),
        );
        edges.push(json!({"s": first + 1 + k as u64, "t": first, "p": "standing on"}));
    }
    json!({"schema": "ma3dsg-graph/1", "nodes": nodes, "edges": edges})
}

/// Frames carry what they were written from, fold to the same in any order, and are refused when damaged.
#[test]
fn frames_are_written_read_and_folded() {
    let dir = tempfile::tempdir().expect("folder");
    let at = |n: &str| text(&dir.path().join(n));
    fs::write(at("a.json"), room(0.0, [0.0, 0.0], 10).to_string()).unwrap();
    fs::write(at("b.json"), room(0.7, [3.0, -2.0], 500).to_string()).unwrap();
    done(&["encode", &at("a.json"), "-o", &at("a.msg")]);
    done(&["encode", &at("b.json"), "-o", &at("b.msg"), "--agent", "1", "--frame", "1", "--start", "9"]);
    done(&["decode", &at("b.msg"), "-o", &at("c.json")]);
    let (b, c) = (read(&dir.path().join("b.json")), read(&dir.path().join("c.json")));
    for (b, c) in b["nodes"].as_array().unwrap().iter().zip(c["nodes"].as_array().unwrap()) {
        assert_eq!((&b["id"], &b["label"]), (&c["id"], &c["label"]));
        for k in 0..3 {
            let off = |f: &str| (b[f][k].as_f64().unwrap() - c[f][k].as_f64().unwrap()).abs();
            assert!(off("centroid") <= 0.005 + 1e-6 && off("extent") <= 0.005 + 1e-6);
        }
    }
    let fold = |args: &[&str]| -> Value {
        serde_json::from_str(&done(&[&["fold", "--json"], args].concat())).expect("JSON")
    };
    let (ab, ba) = (fold(&[&at("a.msg"), &at("b.msg")]), fold(&[&at("b.msg"), &at("a.msg")]));
    assert_eq!(ab, ba);
    assert_eq!((&ab["observations"], &ab["components"]), (&json!(2), &json!(1)));
    // One room of eight objects and a floor, however often it was seen.
    assert_eq!(ab["graph"]["nodes"].as_array().unwrap().len(), 9);
    let alone = fold(&[&at("a.msg"), &at("b.msg"), "--without", "1"]);
    assert_eq!(alone, fold(&[&at("a.msg")]));
    assert_ne!(alone["state_hash"], ab["state_hash"]);
    let mut bytes = fs::read(at("a.msg")).unwrap();
    bytes.pop();
    fs::write(at("short.msg"), bytes).unwrap();
    for args in
        [["decode", &at("short.msg"), "-o", &at("x.json")], ["fold", &at("short.msg"), "-o", &at("x.json")]]
    {
        let out = run(&args);
        assert_eq!(out.status.code(), Some(1));
        assert!(String::from_utf8_lossy(&out.stderr).contains("short.msg"));
    }
}

/// Six benches of 1.6 m side by side, of whose ends so much was not seen, metres.
fn benches(hidden: [[f64; 2]; 6]) -> Value {
    let bench = |k: usize| {
        let ([low, high], width) = (hidden[k], 0.3 + 0.05 * k as f64);
        let (length, height) = (1.6 - low - high, 0.5 + 0.1 * k as f64);
        let reach = [width, 0.0, length, 0.0, width, 0.0, length, 0.0].map(|side| side / 2.0);
        let corner = (width + length) / 8f64.sqrt();
        let reach: Vec<f64> = reach.iter().map(|&r| if r == 0.0 { corner } else { r }).collect();
        let label = ["chair", "table", "sofa"][k % 3];
        let x = [0.0, 0.9, 1.5, 2.8, 3.5, 4.9][k] + width / 2.0;
        json!({
            "id": k, "label": label, "score": 0.9,
            "centroid": [x, low + length / 2.0, height / 2.0], "extent": [width, length, height],
            "footprint": {"yaw": 0.0, "reach": reach},
        })
    };
    let nodes: Vec<Value> = (0..6).map(bench).collect();
    json!({"schema": "ma3dsg-graph/1", "gravity_aligned": true, "nodes": nodes, "edges": []})
}

#[test]
fn merge_leaves_what_can_slide_alone() {
    let dir = tempfile::tempdir().expect("folder");
    let at = |n: &str| text(&dir.path().join(n));
    let ends = [[0.2, 0.5], [0.5, 0.2], [0.35, 0.25], [0.1, 0.4], [0.55, 0.35], [0.3, 0.6]];
    for (name, hidden) in [("whole.json", [[0.0; 2]; 6]), ("open.json", ends)] {
        fs::write(at(name), benches(hidden).to_string()).unwrap();
    }
    let merged = |query: &str| {
        let said: Value =
            serde_json::from_str(&done(&["merge", &at("whole.json"), &at(query), "--json"])).unwrap();
        said["merges"][0]["merge"].clone()
    };
    assert_eq!(merged("whole.json")["outcome"], "match");
    let open = merged("open.json");
    assert_eq!((&open["outcome"], &open["why"]), (&json!("no_match"), &json!("loose")), "{open}");
}

#[test]
fn merge_align_and_export_on_graph_files() {
    let dir = tempfile::tempdir().expect("folder");
    let at = |n: &str| text(&dir.path().join(n));
    let (turn, shift) = (0.7, [3.0, -2.0]);
    fs::write(at("a.json"), room(0.0, [0.0, 0.0], 10).to_string()).unwrap();
    fs::write(at("b.json"), room(turn, shift, 500).to_string()).unwrap();
    let said: Value =
        serde_json::from_str(&done(&["merge", &at("a.json"), &at("b.json"), "-o", &at("m.json"), "--json"]))
            .unwrap();
    let t: Vec<f64> =
        said["merges"][0]["merge"]["T_a_b"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    // b = R a + s, so a = R^-1 (b - s).
    let (s, c) = turn.sin_cos();
    let want = [c, s, -(c * shift[0] + s * shift[1]), -s, c, s * shift[0] - c * shift[1]];
    for (got, want) in [t[0], t[1], t[3], t[4], t[5], t[7]].iter().zip(want) {
        assert!((got - want).abs() < 1e-3, "{t:?}");
    }
    let case = json!({"id": "one", "gravity_aligned": true, "query": room(turn, shift, 500), "reference": room(0.0, [0.0, 0.0], 10)});
    fs::create_dir(dir.path().join("cases")).unwrap();
    fs::write(at("cases/one.json"), case.to_string()).unwrap();
    done(&["align", "--cases", &text(dir.path()), "--json", &at("out.json")]);
    let answer = &read(&dir.path().join("out.json"))[0];
    assert_eq!((&answer["id"], &answer["outcome"]), (&json!("one"), &json!("match")));
    for field in ["T_ref_query", "matches", "moved", "removed", "added", "alternatives", "ms"] {
        assert!(answer.get(field).is_some(), "{field}");
    }
    for format in ["json", "csv", "graphml", "dot", "ply"] {
        done(&["export", &at("a.json"), "--format", format, "-o", &at(&format!("x.{format}"))]);
    }
    assert_eq!(fs::read_to_string(dir.path().join("x.csv/nodes.csv")).unwrap().lines().count(), 10);
    assert_eq!(fs::read_to_string(dir.path().join("x.csv/edges.csv")).unwrap().lines().count(), 9);
    let xml = fs::read_to_string(dir.path().join("x.graphml")).unwrap();
    assert_eq!(
        (xml.matches("<node ").count(), xml.matches("</node>").count(), xml.matches("</edge>").count()),
        (9, 9, 8)
    );
    assert_eq!(fs::read_to_string(dir.path().join("x.dot")).unwrap().matches("->").count(), 8);
    let mesh =
        scan3r::ply::read_ply(&fs::read(dir.path().join("x.ply")).unwrap(), Path::new("x.ply")).unwrap();
    assert_eq!(mesh.points.len(), 9 * 8);
}

/// The shipped weights with some of their outputs, in another order: rows of the last layers, and their names.
fn with_outputs(classes: &[usize], predicates: &[usize]) -> Vec<u8> {
    let shipped =
        fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/weights/sgfn-l20.safetensors"))
            .unwrap();
    let (length, rest) = shipped.split_first_chunk::<8>().unwrap();
    let (header, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let mut header: Value = serde_json::from_slice(header).unwrap();
    let mut out = Vec::new();
    for (name, tensor) in header.as_object_mut().unwrap() {
        let keep = match name.as_str() {
            "__metadata__" => {
                for (what, keep) in [("class_names", classes), ("predicate_names", predicates)] {
                    let all = tensor[what].as_str().unwrap().to_owned();
                    let all: Vec<&str> = all.lines().collect();
                    tensor[what] = json!(keep.iter().map(|k| all[*k]).collect::<Vec<_>>().join("\n"));
                }
                continue;
            }
            "obj_predictor.fc3.weight" | "obj_predictor.fc3.bias" => Some(classes),
            "rel_predictor.fc3.weight" | "rel_predictor.fc3.bias" => Some(predicates),
            _ => None,
        };
        let [from, to] = [0, 1].map(|k| tensor["data_offsets"][k].as_u64().unwrap() as usize);
        let bytes = &data[from..to];
        let start = out.len();
        if let Some(keep) = keep {
            let row = bytes.len() / tensor["shape"][0].as_u64().unwrap() as usize;
            keep.iter().for_each(|k| out.extend(&bytes[k * row..(k + 1) * row]));
            tensor["shape"][0] = json!(keep.len());
        } else {
            out.extend(bytes);
        }
        tensor["data_offsets"] = json!([start, out.len()]);
    }
    let header = serde_json::to_vec(&header).unwrap();
    [&(header.len() as u64).to_le_bytes()[..], &header, &out].concat()
}

/// Published SGFN weights have 20 classes and no `none`, in an order of their own.
#[test]
fn weights_may_name_their_outputs_in_any_order_and_lack_none() {
    let dir = tempfile::tempdir().expect("folder");
    let weights = dir.path().join("weights.safetensors");
    let bench = |classes: Vec<usize>, predicates: Vec<usize>| {
        fs::write(&weights, with_outputs(&classes, &predicates)).expect("weights");
        let out = text(&dir.path().join("run"));
        let args =
            ["bench", "--domain", "1", "--agents", "2", "--overlap", "1", "--scenario", "scp", "--seed", "6"];
        let more = ["--systems", "sgfn,ma3dsg", "--weights", &text(&weights), "--out", &out];
        done(&[&args[..], &more].concat());
        let rates = |row: &Value| ["object", "predicate", "triplet"].map(|of| row[of]["f1"].as_f64());
        let report = read(&dir.path().join("run/report.json"));
        report["rows"].as_array().unwrap().iter().map(rates).collect::<Vec<_>>()
    };
    let all = |n: usize| (0..n).collect::<Vec<_>>();
    let back = |n: usize| (0..n).rev().collect::<Vec<_>>();
    let shipped = bench(all(21), all(9));
    assert!(shipped[0][0] > Some(40.0), "{shipped:?}");
    assert_eq!(bench(back(21), back(9)), shipped);
    let bare = bench(all(20), all(8));
    assert!(bare[0][0] > Some(20.0) && bare != shipped, "{bare:?}");
    assert_eq!(bench(back(20), back(8)), bare);
    fs::write(&weights, with_outputs(&all(19), &all(9))).expect("weights");
    let out = run(&["bench", "--domain", "1", "--weights", &text(&weights)]);
    assert!(String::from_utf8_lossy(&out.stderr).contains("lack the class \"window\""), "{out:?}");
}
