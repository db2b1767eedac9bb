//! Each format against hand-made bytes, its own writer, and damage.

#![allow(clippy::expect_used, reason = "a test that cannot go on fails")]

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use scan3r::depth_image::{DepthImage, read_pgm, read_png, write_pgm, write_png};
use scan3r::info::SequenceInfo;
use scan3r::ply::{AnnotatedVertices, read_ply, write_ply};
use scan3r::pose::{parse_pose, pose_text, settled};
use scan3r::{
    Annotation, Dataset, Error, Folder, Format, Frame, FrameStream, Intrinsics, Recording, Relation,
    RoomEntry, write_dataset,
};
use std::path::Path;

fn file() -> &'static Path {
    Path::new("some.file")
}

#[test]
fn pgm_samples_are_big_endian() {
    let bytes = b"P5 # a comment\n2 1\n65535\n\x01\x02\xff\xff";
    let image = read_pgm(bytes, file()).expect("image");
    assert_eq!((image.width, image.height, &image.samples[..]), (2, 1, &[0x102, 0xffff][..]));
    assert_eq!(image.metres(1000.0), [0.258, 0.0]);
    assert_eq!(read_pgm(b"P5\n2 1\n255\n\x07\x08", file()).expect("8 bits").samples, [7, 8]);
    for bad in [
        &b""[..],
        b"P6\n1 1\n255\n\0\0\0",
        b"P5\n99999 99999\n65535\n",
        b"P5\n2 2\n65535\n\0\0",
        b"P5\n0 1\n255\n",
    ] {
        let said = read_pgm(bad, file()).expect_err("damaged").to_string();
        assert!(said.contains("some.file"), "{said}");
    }
}

#[test]
fn poses_that_are_lost_tilted_or_short() {
    assert_eq!(parse_pose(&"-inf ".repeat(16), file()).expect("lost"), None);
    assert_eq!(parse_pose("NaN 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", file()).expect("lost"), None);
    let t = parse_pose("0 -1 0 5 1 0 0 6 0 0 1 7 0 0 0 1", file()).expect("pose").expect("valid");
    assert!((t * Point3::new(1.0, 0.0, 0.0) - Point3::new(5.0, 7.0, 7.0)).norm() < 1e-5);
    for bad in ["1 2 3", "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1", "1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1", "x"] {
        assert!(parse_pose(bad, file()).is_err(), "{bad}");
    }
}

#[test]
fn ply_in_ascii_with_the_columns_of_3rscan() {
    let text = b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty ushort objectId\nproperty ushort globalId\nproperty uchar NYU40\nproperty uchar Eigen13\nproperty uchar RIO27\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3 9 9 9 17 5 1 1 1\n4 5 -6.5 9 9 9 0 0 0 0 0\n3 0 1 0\n";
    let v = read_ply(text, file()).expect("mesh");
    assert_eq!(v.points, [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, -6.5)]);
    assert_eq!(v.instances, [17, 0]);
    let huge = String::from_utf8_lossy(text).replace("vertex 2", "vertex 4000000000");
    assert!(read_ply(huge.as_bytes(), file()).expect_err("huge").to_string().contains("vertices"));
    let many = String::from_utf8_lossy(text).replace("vertex 2", "vertex 49999999");
    assert!(read_ply(many.as_bytes(), file()).is_err());
}

proptest! {
    #[test]
    fn images_round_trip((w, h) in (1_u32..40, 1_u32..40), seed in any::<u64>()) {
        let samples = (0..w * h).map(|k| (seed.wrapping_mul(u64::from(k) + 1) >> 40) as u16).collect();
        let image = DepthImage { width: w, height: h, samples };
        prop_assert_eq!(&read_pgm(&write_pgm(&image), file()).expect("pgm"), &image);
        prop_assert_eq!(&read_png(&write_png(&image).expect("png"), file()).expect("png"), &image);
    }

    #[test]
    fn damaged_files_are_errors_not_panics(cut in any::<prop::sample::Index>(), at in any::<prop::sample::Index>(), flip in 1..=255_u8) {
        let image = DepthImage { width: 7, height: 5, samples: (0..35).map(|k| k * 1871).collect() };
        let mesh = AnnotatedVertices { points: vec![Point3::new(1.0, 2.0, 3.0); 9], instances: (0..9).collect() };
        type Reads = fn(&[u8]) -> bool;
        let files: [(Vec<u8>, Reads); 4] = [
            (write_pgm(&image), |b| read_pgm(b, file()).is_ok()),
            (write_png(&image).expect("png"), |b| read_png(b, file()).is_ok()),
            (write_ply(&mesh, false), |b| read_ply(b, file()).is_ok()),
            (write_ply(&mesh, true), |b| read_ply(b, file()).is_ok()),
        ];
        for (bytes, reads) in files {
            prop_assert!(reads(&bytes));
            // A PNG's last bytes are a chunk that holds no image data.
            let shorter = &bytes[..cut.index(bytes.len().saturating_sub(20))];
            prop_assert!(!reads(shorter));
            let mut flipped = bytes.clone();
            let at = at.index(flipped.len());
            flipped[at] ^= flip;
            let _ = reads(&flipped);
        }
    }

    #[test]
    fn poses_round_trip(t in prop::array::uniform3(-5.0_f32..5.0), r in prop::array::uniform3(-3.0_f32..3.0)) {
        let pose = Isometry3::from_parts(Translation3::from(t), UnitQuaternion::new(Vector3::from(r)));
        let back = parse_pose(&pose_text(Some(&pose)), file()).expect("pose").expect("valid");
        prop_assert!((back.to_homogeneous() - pose.to_homogeneous()).amax() < 1e-5);
        let s = settled(&pose);
        prop_assert!((s.to_homogeneous() - pose.to_homogeneous()).amax() < 3e-5);
        prop_assert_eq!(parse_pose(&pose_text(Some(&s)), file()).expect("pose").expect("valid"), s);
    }
}

/// One room, one rescan, three frames each; frame 1 has no pose and number 2 is missing.
struct Tiny {
    rooms: Vec<RoomEntry>,
}

fn tiny() -> Tiny {
    let text = r#"[{"reference":"a","type":"validation","ambiguity":[],"scans":[{"reference":"b","transform":[1,0,0,0,0,1,0,0,0,0,1,0,0.5,0,0,1],"rigid":[],"removed":[3],"nonrigid":[]}]}]"#;
    Tiny { rooms: serde_json::from_str(text).expect("rooms") }
}

impl Dataset for Tiny {
    fn kind(&self) -> &'static str {
        "generated"
    }
    fn has_own_path_per_visit(&self) -> bool {
        true
    }
    fn rooms(&self) -> &[RoomEntry] {
        &self.rooms
    }
    fn annotation(&self, scan: &str) -> Result<Annotation, Error> {
        let n = if scan == "a" { 3 } else { 2 };
        Ok(Annotation {
            points: (0..n).map(|k| Point3::new(k as f32 / 3.0, 1.0, 2.0)).collect(),
            instances: (1..=n).collect(),
            labels: (1..=n).map(|k| (k, format!("label {k}"))).collect(),
        })
    }
    fn relations(&self, _: &str) -> Result<Vec<Relation>, Error> {
        Ok(vec![Relation { subject: 2, object: 1, predicate: "standing on".into() }])
    }
    fn frame_count(&self, _: &str, _: u64) -> Result<u32, Error> {
        Ok(3)
    }
    fn frames(&self, _: &str, _: u64) -> Result<FrameStream<'_>, Error> {
        let k = Intrinsics::new(176.594, 240.808, 4.5, 3.5, 9, 7)?;
        Ok(Box::new([0_u32, 1, 3].into_iter().map(move |index| {
            Ok(Frame {
                index,
                time: f64::from(index) / 5.0,
                depth: (0..63).map(|p| (p * 37 + index as u16) as f32 / 1000.0).collect(),
                intrinsics: k,
                world_from_camera: (index != 1).then(|| Isometry3::translation(index as f32, 0.25, -1.0)),
            })
        })))
    }
}

#[test]
fn a_written_data_set_reads_back() {
    let dir = tempfile::tempdir().expect("folder");
    let source = tiny();
    let mut done = Vec::new();
    write_dataset(&source, dir.path(), "generated for a test", |s| done.push(s.to_owned())).expect("written");
    assert_eq!(done, ["a", "b"]);
    let folder = Folder::open(dir.path()).expect("data set");
    assert_eq!((folder.kind(), folder.rooms()), ("generated", source.rooms()));
    for scan in ["a", "b"] {
        assert_eq!(folder.frame_count(scan, 0).expect("count"), 3);
        assert_eq!(folder.annotation(scan).expect("mesh"), source.annotation(scan).expect("mesh"));
        assert_eq!(folder.relations(scan).expect("relations"), source.relations(scan).expect("relations"));
        let read: Vec<Frame> = folder.frames(scan, 0).expect("frames").map(|f| f.expect("frame")).collect();
        let made: Vec<Frame> = source.frames(scan, 0).expect("frames").map(|f| f.expect("frame")).collect();
        assert_eq!(read.len(), 3);
        for (r, m) in read.iter().zip(&made) {
            assert_eq!((r.index, &r.depth, r.intrinsics, r.time), (m.index, &m.depth, m.intrinsics, m.time));
            assert_eq!(r.world_from_camera, m.world_from_camera);
        }
    }
    assert!(matches!(folder.annotation("c"), Err(Error::UnknownScan(_))));
    let r = Recording::open(&dir.path().join("a"), None).expect("recording");
    assert_eq!((r.format(), r.len(), r.has_gravity()), (Format::ThreeRScan, 3, true));
    // The same sequence unpacked.
    let zip = dir.path().join("a/sequence.zip");
    let mut archive = zip::ZipArchive::new(std::fs::File::open(&zip).expect("zip")).expect("archive");
    archive.extract(dir.path().join("a/sequence")).expect("unpacked");
    std::fs::remove_file(&zip).expect("removed");
    let unpacked = Recording::open(&dir.path().join("a"), None).expect("folder").into_frames();
    assert_eq!(unpacked.map(|f| f.expect("frame").index).collect::<Vec<_>>(), [0, 1, 3]);
}

#[test]
fn damaged_archives_name_file_and_entry() {
    let dir = tempfile::tempdir().expect("folder");
    write_dataset(&tiny(), dir.path(), "", |_| ()).expect("written");
    let path = dir.path().join("a/sequence.zip");
    let good = std::fs::read(&path).expect("zip");
    for cut in [0, 10, good.len() / 2, good.len() - 1] {
        std::fs::write(&path, &good[..cut]).expect("cut");
        let said = Recording::open(&dir.path().join("a"), None).map(|_| ()).expect_err("cut").to_string();
        assert!(said.contains("sequence.zip"), "{said}");
    }
    for at in (30..good.len()).step_by(7) {
        let mut bad = good.clone();
        bad[at] ^= 0x55;
        std::fs::write(&path, &bad).expect("flipped");
        if let Ok(r) = Recording::open(&dir.path().join("a"), None) {
            for f in r.into_frames() {
                if let Err(e) = f {
                    assert!(e.to_string().contains("sequence.zip"), "{e}");
                }
            }
        }
    }
}

#[test]
fn tum_and_seven_scenes_folders() {
    let dir = tempfile::tempdir().expect("folder");
    let at = |n: &str| dir.path().join(n);
    let image = DepthImage { width: 4, height: 3, samples: vec![5000; 12] };
    std::fs::create_dir(at("depth")).expect("folder");
    std::fs::write(at("depth/1.png"), write_png(&image).expect("png")).expect("image");
    std::fs::write(at("depth.txt"), "# time file\n10.00 depth/1.png\n10.50 depth/1.png\n").expect("list");
    std::fs::write(at("groundtruth.txt"), "10.01 1 2 3 0 0 0.7071068 0.7071068\n10.4 0 0 0 0 0 0 1\n")
        .expect("poses");
    let r = Recording::open(dir.path(), None).expect("TUM");
    assert_eq!((r.format(), r.len(), r.notes().len()), (Format::Tum, 2, 1));
    let frames: Vec<Frame> = r.into_frames().map(|f| f.expect("frame")).collect();
    assert_eq!(frames[0].depth, [1.0; 12]);
    let p = frames[0].world_from_camera.expect("within 20 ms") * Point3::new(1.0, 0.0, 0.0);
    assert!((p - Point3::new(1.0, 3.0, 3.0)).norm() < 1e-5, "{p}");
    assert!(frames[1].world_from_camera.is_none(), "100 ms away");

    let dir = tempfile::tempdir().expect("folder");
    let seq = dir.path().join("seq-01");
    std::fs::create_dir(&seq).expect("folder");
    for n in [3, 8] {
        std::fs::write(seq.join(format!("frame-{n:06}.depth.png")), write_png(&image).expect("png"))
            .expect("image");
        std::fs::write(seq.join(format!("frame-{n:06}.pose.txt")), pose_text(Some(&Isometry3::identity())))
            .expect("pose");
    }
    std::fs::write(dir.path().join("camera-intrinsics.txt"), "5 0 2\n0 6 1\n0 0 1\n").expect("matrix");
    let r = Recording::open(dir.path(), None).expect("7-Scenes");
    assert_eq!((r.format(), r.len()), (Format::SevenScenes, 2));
    let frames: Vec<Frame> = r.into_frames().map(|f| f.expect("frame")).collect();
    assert_eq!((frames[1].index, frames[1].depth[0], frames[1].intrinsics.fy), (8, 5.0, 6.0));

    let empty = tempfile::tempdir().expect("folder");
    for format in [None, Some(Format::SevenScenes), Some(Format::Tum), Some(Format::ThreeRScan)] {
        assert!(Recording::open(empty.path(), format).is_err());
    }
    assert!(Folder::open(empty.path()).is_err());
}

#[test]
fn info_text_round_trips_and_names_what_is_wrong() {
    let info = SequenceInfo {
        depth: Intrinsics::new(176.594, 240.808, 114.613, 85.7915, 224, 172).expect("camera"),
        per_metre: 1000.0,
        frames: Some(12),
    };
    let text = info.text();
    assert_eq!(SequenceInfo::parse(&text, file()).expect("info"), info);
    let zero = text.replace("176.594", "0");
    assert!(
        SequenceInfo::parse(&zero, file())
            .expect_err("zero")
            .to_string()
            .contains("m_calibrationDepthIntrinsic")
    );
    let gone = text.replace("m_depthShift", "m_depth");
    assert!(SequenceInfo::parse(&gone, file()).expect_err("gone").to_string().contains("m_depthShift"));
}
