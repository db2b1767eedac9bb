//! The binary on damaged files: exit 1 or 2, the file named, no panic, bounded memory.

#![allow(clippy::expect_used, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

fn run(args: &[&str]) -> Output {
    // 1 GiB of address space for the heap: `ulimit -v` counts mappings, of which a Rust binary with
    // two threads has few.
    let line = format!(
        "ulimit -v 2000000; exec {} --threads 2 {}",
        env!("CARGO_BIN_EXE_ma3dsg"),
        args.iter().map(|a| format!("'{a}'")).collect::<Vec<_>>().join(" ")
    );
    Command::new("sh").args(["-c", &line]).output().expect("sh")
}

/// Runs and expects an error that names every one of `words`.
fn refused(args: &[&str], words: &[&str]) {
    let out = run(args);
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(matches!(out.status.code(), Some(1 | 2)), "{args:?}: {:?}\n{text}", out.status);
    assert!(!text.contains("panicked"), "{args:?}: {text}");
    for w in words {
        assert!(text.contains(w), "{args:?}: no {w:?} in\n{text}");
    }
}

/// One generated scan, written once: its data set, and its folder with the sequence unpacked.
fn data_set() -> &'static (tempfile::TempDir, PathBuf) {
    static DATA: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    DATA.get_or_init(|| {
        let dir = tempfile::tempdir().expect("folder");
        let path = dir.path().to_str().expect("UTF-8");
        let out = run(&["synth", "--rooms", "1", "--no-rescans", "--seed", "4", "-o", path]);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let scan = fs::read_dir(dir.path())
            .expect("folder")
            .map(|e| e.expect("entry").path())
            .find(|p| p.is_dir())
            .expect("one scan");
        (dir, scan)
    })
}

/// A recording of a few frames, unpacked into a fresh folder, ready to be damaged.
fn recording() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("folder");
    let seq = dir.path().join("sequence");
    fs::create_dir(&seq).expect("folder");
    let k = "20 0 8 0 0 20 6 0 0 0 1 0 0 0 0 1";
    let info = format!(
        "m_depthWidth = 16\nm_depthHeight = 12\nm_depthShift = 1000\nm_calibrationDepthIntrinsic = {k}\nm_frames.size = 3\n"
    );
    fs::write(seq.join("_info.txt"), info).expect("info");
    for n in 0..3 {
        let mut pgm = b"P5\n16 12\n65535\n".to_vec();
        pgm.extend((0..16 * 12).flat_map(|_| 1500_u16.to_be_bytes()));
        fs::write(seq.join(format!("frame-{n:06}.depth.pgm")), pgm).expect("depth");
        fs::write(seq.join(format!("frame-{n:06}.pose.txt")), "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n")
            .expect("pose");
    }
    (dir, seq)
}

fn text(p: &Path) -> String {
    p.to_str().expect("UTF-8").to_owned()
}

fn scan_refused(dir: &Path, words: &[&str]) {
    let out = dir.join("out");
    refused(&["scan", &text(dir), "-o", &text(&out)], words);
}

#[test]
fn help_of_every_command() {
    for c in
        ["scan", "bench", "merge", "check", "export", "synth", "align", "infer", "samples", "eval-instances"]
    {
        let out = run(&[c, "--help"]);
        assert!(out.status.success() && out.stdout.len() > 100, "{c}");
    }
    assert_eq!(run(&["nonsense"]).status.code(), Some(2));
}

#[test]
fn damaged_depth_names_the_image_and_keeps_what_came_before() {
    let (dir, seq) = recording();
    let file = seq.join("frame-000001.depth.pgm");
    let bytes = fs::read(&file).expect("depth");
    fs::write(&file, &bytes[..100]).expect("cut");
    scan_refused(dir.path(), &["frame-000001.depth.pgm", "samples"]);
    let rows = fs::read_to_string(dir.path().join("out/frames.csv")).expect("what came before");
    assert_eq!(rows.lines().count(), 2, "{rows}");
    fs::write(&file, b"P5\n4000000000 12\n65535\n").expect("huge");
    scan_refused(dir.path(), &["frame-000001.depth.pgm", "width"]);
    fs::write(&file, b"P5\n4096 4096\n65535\n\0\0").expect("huge and empty");
    scan_refused(dir.path(), &["frame-000001.depth.pgm", "samples"]);
}

#[test]
fn damaged_calibration_and_poses_name_file_and_field() {
    let (dir, seq) = recording();
    let info = fs::read_to_string(seq.join("_info.txt")).expect("info");
    fs::write(seq.join("_info.txt"), info.replace("20 0 8 0 0 20", "0 0 8 0 0 20")).expect("zero");
    scan_refused(dir.path(), &["_info.txt", "m_calibrationDepthIntrinsic"]);
    fs::write(seq.join("_info.txt"), info.replace("m_depthShift = 1000", "m_depthShift = 0")).expect("zero");
    scan_refused(dir.path(), &["_info.txt", "m_depthShift"]);
    fs::write(seq.join("_info.txt"), &info).expect("good");
    fs::write(seq.join("frame-000002.pose.txt"), "1 0 0").expect("short");
    scan_refused(dir.path(), &["frame-000002.pose.txt", "16"]);
    fs::remove_file(seq.join("frame-000002.pose.txt")).expect("gone");
    scan_refused(dir.path(), &["frame-000002.pose.txt"]);
}

#[test]
fn frames_without_a_pose_are_skipped_and_counted_and_gaps_are_no_error() {
    let (dir, seq) = recording();
    fs::write(seq.join("frame-000000.pose.txt"), "nan ".repeat(16)).expect("NaN");
    fs::remove_file(seq.join("frame-000001.depth.pgm")).expect("a gap");
    let out = run(&["scan", &text(dir.path()), "-o", &text(&dir.path().join("out"))]);
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(said.contains("2 frames (1 skipped)"), "{said}");
    let rows = fs::read_to_string(dir.path().join("out/frames.csv")).expect("rows");
    assert_eq!(rows.lines().skip(1).map(|l| l.split(',').next().unwrap()).collect::<Vec<_>>(), ["0", "2"]);
}

#[test]
fn empty_and_absent_folders() {
    let dir = tempfile::tempdir().expect("folder");
    scan_refused(dir.path(), &["no recording"]);
    scan_refused(&dir.path().join("absent"), &["absent"]);
    refused(&["check", &text(dir.path())], &["no recording"]);
    refused(&["bench", "--data", &text(dir.path()), "--domain", "1"], &["3RScan.json"]);
    // Rooms of another split than those asked for; 3RScan's test rooms are its validation.
    let (data, _) = data_set();
    refused(
        &["bench", "--data", &text(data.path()), "--domain", "1", "--split", "train"],
        &["no room of the split train", "1 test"],
    );
    let recorded = tempfile::tempdir().expect("folder");
    for entry in fs::read_dir(data.path()).expect("folder").map(|e| e.expect("entry").path()) {
        let name = entry.file_name().expect("name");
        if name != "GENERATED.txt" {
            std::os::unix::fs::symlink(&entry, recorded.path().join(name)).expect("link");
        }
    }
    refused(
        &["bench", "--data", &text(recorded.path()), "--domain", "1"],
        &["no room of the split validation", "1 test"],
    );
    refused(&["align", "--cases", &text(dir.path()), "--json", "x"], &["cases"]);
    refused(&["infer", "--golden", &text(dir.path())], &["no golden file"]);
    refused(&["bench", "--domain", "0"], &["domain"]);
    refused(&["bench", "--labels", "l160"], &["l160"]);
    refused(&["bench", "--overlap", "1.5", "--domain", "1"], &["overlap"]);
    refused(&["bench", "--systems", "sgfm"], &["sgfm"]);
    refused(&["bench", "--shard", "3/2"], &["shard"]);
}

#[test]
fn damaged_png_and_archives() {
    let dir = tempfile::tempdir().expect("folder");
    fs::write(dir.path().join("frame-000000.depth.png"), b"\x89PNG\r\n\x1a\n rubbish").expect("png");
    fs::write(dir.path().join("frame-000000.pose.txt"), "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1").expect("pose");
    scan_refused(dir.path(), &["frame-000000.depth.png"]);

    let zip = fs::read(data_set().1.join("sequence.zip")).expect("zip");
    for (k, damage) in [zip[..zip.len() / 2].to_vec(), b"PK rubbish".to_vec(), Vec::new()].iter().enumerate()
    {
        let dir = tempfile::tempdir().expect("folder");
        fs::write(dir.path().join("sequence.zip"), damage).expect("zip");
        let out = dir.path().join(k.to_string());
        refused(&["scan", &text(dir.path()), "-o", &text(&out)], &["sequence.zip"]);
    }
}

#[test]
fn damaged_graphs_weights_and_meshes() {
    let dir = tempfile::tempdir().expect("folder");
    let file = dir.path().join("g.json");
    let graph = r#"{"nodes":[{"id":1,"label":"chair","centroid":[0,0,0],"extent":[1,1,1]},{"id":2,"label":"floor","centroid":[0,0,0],"extent":[1,1,1]}],"edges":[{"s":1,"t":2,"p":"standing on"}]}"#;
    let cases: [(String, &str); 7] = [
        (graph[..40].to_owned(), "JSON"),
        (graph.replace("\"id\":2", "\"id\":1"), "twice"),
        (graph.replace("\"t\":2", "\"t\":7"), "edge"),
        (graph.replace("[1,1,1]", "[1,-1,1]"), "extent"),
        (graph.replace("[0,0,0]", "[0,1e30,0]"), "centroid"),
        (graph.replace("\"chair\"", "7"), "JSON"),
        (format!("{{\"schema\":\"other/9\",{}", &graph[1..]), "schema"),
    ];
    for (damaged, word) in cases {
        fs::write(&file, damaged).expect("graph");
        refused(
            &["export", &text(&file), "--format", "dot", "-o", &text(&dir.path().join("x"))],
            &["g.json", word],
        );
        refused(&["merge", &text(&file), &text(&file)], &["g.json", word]);
    }
    let weights = dir.path().join("w.safetensors");
    let good = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/weights/sgfn-l20.safetensors"))
        .expect("weights");
    let mut nan = good.clone();
    let end = nan.len();
    nan[end - 2..].copy_from_slice(&[0, 0x7e]);
    let mut huge = good.clone();
    huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    for (damaged, word) in [
        (good[..good.len() / 2].to_vec(), "safetensors"),
        (nan, "tensor"),
        (huge, "header"),
        (Vec::new(), "safetensors"),
    ] {
        fs::write(&weights, damaged).expect("weights");
        refused(&["bench", "--domain", "1", "--weights", &text(&weights)], &["w.safetensors", word]);
    }
    let (set, scan) = data_set();
    let copy = tempfile::tempdir().expect("folder");
    let name = scan.file_name().unwrap();
    fs::create_dir(copy.path().join(name)).expect("folder");
    for f in ["3RScan.json", "relationships.json", "GENERATED.txt"] {
        fs::copy(set.path().join(f), copy.path().join(f)).expect("copied");
    }
    for f in ["sequence.zip", "semseg.v2.json", "labels.instances.annotated.v2.ply"] {
        fs::copy(scan.join(f), copy.path().join(name).join(f)).expect("copied");
    }
    let bench = |words: &[&str]| {
        let out = text(&copy.path().join("run"));
        let data = text(copy.path());
        refused(
            &["bench", "--data", &data, "--domain", "1", "--agents", "1", "--scenario", "scp", "--out", &out],
            words,
        );
    };
    let mesh = copy.path().join(name).join("labels.instances.annotated.v2.ply");
    let bytes = fs::read(&mesh).expect("mesh");
    fs::write(&mesh, &bytes[..bytes.len() / 2]).expect("cut");
    bench(&["annotated.v2.ply", "vertices"]);
    let head = String::from_utf8_lossy(&bytes[..400]).replace("element vertex ", "element vertex 9999");
    fs::write(&mesh, head.as_bytes()).expect("huge count");
    bench(&["annotated.v2.ply"]);
    fs::write(&mesh, &bytes).expect("good");
    let rooms = copy.path().join("3RScan.json");
    let good = fs::read_to_string(&rooms).expect("rooms");
    fs::write(&rooms, &good[..good.len() / 2]).expect("cut");
    bench(&["3RScan.json", "JSON"]);
    fs::write(&rooms, good).expect("good");
    fs::write(copy.path().join(name).join("semseg.v2.json"), "[]").expect("other shape");
    bench(&["semseg.v2.json"]);
}

#[test]
fn a_good_recording_passes_and_broken_conventions_are_found() {
    let good = run(&["check", &text(&data_set().1)]);
    let said = String::from_utf8_lossy(&good.stdout);
    assert!(good.status.success() && said.contains("nothing wrong found"), "{said}");
    // The same recording with the poses the other way round.
    let dir = tempfile::tempdir().expect("folder");
    let mut zip = zip_reader(&data_set().1.join("sequence.zip"));
    zip.extract(dir.path().join("sequence")).expect("unpacked");
    for e in fs::read_dir(dir.path().join("sequence")).expect("folder") {
        let path = e.expect("entry").path();
        if path.to_string_lossy().ends_with(".pose.txt") {
            let pose =
                scan3r::pose::parse_pose(&fs::read_to_string(&path).expect("pose"), &path).expect("pose");
            let turned = pose.map(|p| p.inverse());
            fs::write(&path, scan3r::pose::pose_text(turned.as_ref())).expect("pose");
        }
    }
    let out = run(&["check", &text(dir.path())]);
    let said = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("camera_from_world"), "{said}");
}

fn zip_reader(path: &Path) -> zip::ZipArchive<fs::File> {
    zip::ZipArchive::new(fs::File::open(path).expect("zip")).expect("archive")
}
