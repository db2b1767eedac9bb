//! Every intermediate of the authors' modules, where the vectors are at hand.

#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

use sgfn_infer::{Graph, Model, Segment, Store, golden};
use std::path::{Path, PathBuf};

fn folder() -> Option<PathBuf> {
    let dir = Path::new(&std::env::var_os("MA3DSG_REAL_DATA")?).join("sgfn-golden");
    dir.is_dir().then_some(dir)
}

fn cases(dir: &Path) -> Vec<(PathBuf, PathBuf)> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(dir).expect("folder").map(|e| e.expect("entry").path()).collect();
    files.sort();
    files
        .iter()
        .filter_map(|p| {
            let (model, _) = p.file_name()?.to_str()?.split_once(".graph_")?;
            Some((dir.join(format!("{model}.weights.safetensors")), p.clone()))
        })
        .collect()
}

#[test]
fn every_stored_tensor_is_reproduced() {
    let Some(dir) = folder() else {
        eprintln!("MA3DSG_REAL_DATA is not set: nothing compared");
        return;
    };
    let cases = cases(&dir);
    assert!(cases.len() >= 17, "{} cases", cases.len());
    for (weights, graph) in cases {
        let model = Model::from_safetensors(&std::fs::read(weights).expect("weights")).expect("model");
        let store = Store::read(&std::fs::read(&graph).expect("graph")).expect("store");
        for c in golden::compare(&model, &store).expect("comparison") {
            assert!(c.within, "{} {} {}", graph.display(), c.tensor, c.max_abs_error);
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let Some(dir) = folder() else { return };
    let bytes = std::fs::read(dir.join("main_l20.weights.safetensors")).expect("weights");
    let model = Model::from_safetensors(&bytes).expect("model");
    let segments: Vec<Segment> = (0..37)
        .map(|i| {
            let p: Vec<f32> =
                (0..128 * 9).map(|k| ((k * 7919 + i * 104_729) % 1000) as f32 / 500.0 - 1.0).collect();
            Segment::new(&p, 9).expect("segment")
        })
        .collect();
    let edges: Vec<[usize; 2]> = (0..300).map(|k| [k % 37, (k * 5 + 1) % 37]).collect();
    let run = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("pool")
            .install(|| model.infer(&Graph { segments: &segments, edges: &edges }).expect("output"))
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(4));
    let sums = one.class_probabilities();
    assert!((0..37).all(|i| (sums.row(i).iter().sum::<f32>() - 1.0).abs() < 1e-5));
}

#[test]
fn a_changed_number_or_a_broken_file_is_named() {
    let Some(dir) = folder() else { return };
    let weights = std::fs::read(dir.join("sgf21_bn.weights.safetensors")).expect("weights");
    for cut in [0, 7, 8, 100, weights.len() / 2, weights.len() - 1] {
        assert!(Model::from_safetensors(&weights[..cut]).is_err());
    }
    let mut nan = weights.clone();
    let end = nan.len();
    nan[end - 2..].copy_from_slice(&[0, 0x7e]);
    let said = Model::from_safetensors(&nan).expect_err("a NaN").to_string();
    assert!(said.contains("tensor ") && said.contains("finite"), "{said}");

    let model = Model::from_safetensors(&weights).expect("model");
    let graph = std::fs::read(dir.join("sgf21_bn.graph_a.safetensors")).expect("graph");
    let mut spoilt = graph.clone();
    let end = spoilt.len();
    let last = f32::from_le_bytes(spoilt[end - 4..].try_into().expect("4 bytes")) + 1e-2;
    spoilt[end - 4..].copy_from_slice(&last.to_le_bytes());
    let bad: Vec<_> = golden::compare(&model, &Store::read(&spoilt).expect("store"))
        .expect("comparison")
        .into_iter()
        .filter(|c| !c.within)
        .collect();
    assert_eq!(bad.len(), 1, "{bad:?}");
}
