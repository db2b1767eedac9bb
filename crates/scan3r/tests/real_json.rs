//! The real metadata files parse completely and survive a round trip.

#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

use scan3r::relationships::RelationshipsFile;
use scan3r::{RigidList, RoomEntry};
use serde_json::Value;
use std::path::{Path, PathBuf};

fn folder() -> Option<PathBuf> {
    let dir = Path::new(&std::env::var_os("MA3DSG_REAL_DATA")?).join("3dssg-real");
    dir.is_dir().then_some(dir)
}

/// Serialising what was parsed gives the same JSON, up to keys that were absent and have a default.
fn same(original: &Value, ours: &Value, at: &str) {
    match (original, ours) {
        (Value::Object(a), Value::Object(b)) => {
            for (k, v) in a {
                same(v, b.get(k).unwrap_or_else(|| panic!("{at}.{k} is lost")), &format!("{at}.{k}"));
            }
            for (k, v) in b.iter().filter(|(k, _)| !a.contains_key(*k)) {
                assert!(v.as_array().is_some_and(Vec::is_empty), "{at}.{k} = {v} is invented");
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            assert_eq!(a.len(), b.len(), "{at}");
            a.iter().zip(b).enumerate().for_each(|(k, (x, y))| same(x, y, &format!("{at}[{k}]")));
        }
        (Value::Number(a), Value::Number(b)) => assert_eq!(a.as_f64(), b.as_f64(), "{at}"),
        _ => assert_eq!(original, ours, "{at}"),
    }
}

#[test]
fn rooms_round_trip() {
    let Some(dir) = folder() else {
        eprintln!("MA3DSG_REAL_DATA is not set: nothing parsed");
        return;
    };
    let path = dir.join("3RScan.json");
    let text = std::fs::read_to_string(&path).expect("file");
    let rooms: Vec<RoomEntry> = serde_json::from_str(&text).expect("rooms");
    assert_eq!(rooms.len(), 431);
    let original: Value = serde_json::from_str(&text).expect("JSON");
    same(&original, &serde_json::to_value(&rooms).expect("JSON"), "3RScan");

    let rescans: Vec<_> = rooms.iter().flat_map(|r| &r.scans).collect();
    let train = rooms.iter().filter(|r| r.split == "train").count();
    let hidden = rescans.iter().filter(|s| matches!(s.rigid, RigidList::Ids(_))).count();
    assert_eq!(train, 385);
    assert!(hidden > 0 && rescans.iter().filter(|s| s.transform.is_some()).count() == 793);
    for (k, s) in rescans.iter().enumerate() {
        if let Some(t) = &s.transform {
            t.isometry(&path, &format!("scan {k}")).expect("rigid, metres");
        }
        for m in s.rigid.moves() {
            m.transform.isometry(&path, "rigid").expect("rigid, metres");
            assert_eq!(m.instance_reference, m.instance_rescan);
        }
    }
}

#[test]
fn relationships_round_trip() {
    let Some(dir) = folder() else { return };
    let text = std::fs::read_to_string(dir.join("relationships_train.json")).expect("file");
    let file: RelationshipsFile = serde_json::from_str(&text).expect("relationships");
    assert_eq!(file.scans.len(), 3852);
    let original: Value = serde_json::from_str(&text).expect("JSON");
    same(&original, &serde_json::to_value(&file).expect("JSON"), "relationships");
    // Splits of a scan are united: the scan that DATA names has 178 relations.
    let scan = file.scans.iter().find(|s| s.scan.starts_with("f62fd5fd")).expect("the scan");
    assert_eq!(file.of_scan(&scan.scan).len(), 178);
}
