//! Real depth: `MA3DSG_REAL_DATA` names a folder with `rgbd-7scenes`; without it these tests pass unrun.

#![allow(clippy::unwrap_used, reason = "a failed test may panic")]

use gsm::{DepthView, Intrinsics, Map, NoiseMeter, Params, Profile};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use std::fs;
use std::path::{Path, PathBuf};

struct Recording {
    intrinsics: Intrinsics,
    frames: Vec<(Vec<f32>, Isometry3<f32>)>,
}

fn numbers(path: &Path) -> Vec<f64> {
    fs::read_to_string(path).unwrap().split_whitespace().map(|s| s.parse().unwrap()).collect()
}

fn recording() -> Option<Recording> {
    let dir = PathBuf::from(std::env::var_os("MA3DSG_REAL_DATA")?).join("rgbd-7scenes");
    let k = numbers(&dir.join("camera-intrinsics.txt"));
    let intrinsics = Intrinsics::new(k[0] as f32, k[4] as f32, k[2] as f32, k[5] as f32, 640, 480).unwrap();
    let mut files: Vec<PathBuf> = fs::read_dir(&dir).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|p| p.to_string_lossy().ends_with(".depth.png"));
    files.sort();
    let read = |path: &PathBuf| {
        let m = numbers(Path::new(&path.to_string_lossy().replace(".depth.png", ".pose.txt")));
        let r = Rotation3::from_matrix(&Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]));
        let r = UnitQuaternion::from_rotation_matrix(&r).cast::<f32>();
        let pose = Isometry3::from_parts(Translation3::new(m[3] as f32, m[7] as f32, m[11] as f32), r);
        let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut raw = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut raw).unwrap();
        let metres = |b: &[u8]| match u16::from_be_bytes([b[0], b[1]]) {
            u16::MAX => 0.0,
            mm => f32::from(mm) * 1e-3,
        };
        (raw.chunks_exact(2).map(metres).collect(), pose)
    };
    Some(Recording { intrinsics, frames: files.iter().map(read).collect() })
}

fn run(r: &Recording, threads: usize, params: &Params) -> Map {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
        let mut map = Map::new(params.clone()).unwrap();
        for (i, (depth, world_from_camera)) in r.frames.iter().enumerate() {
            let (intrinsics, world_from_camera) = (r.intrinsics, *world_from_camera);
            map.integrate(&DepthView { depth, intrinsics, world_from_camera, time: i as f64 / 15.0 });
        }
        map
    })
}

#[test]
fn a_kitchen_is_segmented_and_threads_do_not_matter() {
    let Some(r) = recording() else { return };
    for max_pixels in [40_000, 400_000] {
        let params = Params { max_pixels, ..Params::default() };
        let map = run(&r, 1, &params);
        for threads in [2, 4] {
            let other = run(&r, threads, &params);
            assert!(map.surfels().eq(other.surfels()));
            let all = |m: &Map| m.segments().map(|s| (s.id(), *s.moments())).collect::<Vec<_>>();
            assert_eq!(all(&map), all(&other));
        }
        let stable = map.surfels().filter(|s| s.stable).count();
        let labelled = map.surfels().filter(|s| s.stable && s.segment.is_some()).count();
        assert!(labelled * 100 >= stable * 94, "{labelled} of {stable}");
        let planes = map.segments().filter(|s| s.surfels() >= 512 && s.plane().rms < 0.015).count();
        assert!(planes >= 8, "{planes}");
        assert!(map.bytes() <= 120 * map.surfels().count());
    }
}

#[test]
fn a_structured_light_sensor_is_known_by_its_steps() {
    let Some(r) = recording() else { return };
    let mut meter = NoiseMeter::default();
    for (depth, world_from_camera) in r.frames.iter().take(10) {
        let (intrinsics, world_from_camera) = (r.intrinsics, *world_from_camera);
        meter.add(&DepthView { depth, intrinsics, world_from_camera, time: 0.0 });
    }
    let found = meter.measured().unwrap();
    assert_eq!(found.model.profile, Profile::Structured, "{found:?}");
}
