//! Folders of depth images with poses: 7-Scenes (`*.depth.png` in millimetres beside `*.pose.txt`) and TUM RGB-D
//! (`depth.txt` and `groundtruth.txt`; 5000 to the metre).

use crate::Result;
use gsm::Intrinsics;
use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use std::fs;
use std::path::{Path, PathBuf};

/// Poses and images of TUM recordings belong together within this, seconds.
const TOLERANCE: f64 = 0.02;

/// A posed depth image.
pub(crate) struct Frame {
    /// Row-major, metres, 0 = invalid.
    pub(crate) depth: Vec<f32>,
    pub(crate) world_from_camera: Isometry3<f32>,
    /// Seconds.
    pub(crate) time: f64,
}

pub(crate) struct Recording {
    pub(crate) intrinsics: Intrinsics,
    pub(crate) frames: Vec<Frame>,
    /// Images without a pose, left out.
    pub(crate) unposed: usize,
}

impl Recording {
    /// Reads up to `most` frames, from the end if `reverse`.
    pub(crate) fn read(dir: &Path, reverse: bool, most: usize) -> Result<Self> {
        if dir.join("depth.txt").is_file() {
            tum(dir, reverse, most)
        } else {
            seven_scenes(dir, reverse, most)
        }
    }
}

fn seven_scenes(dir: &Path, reverse: bool, most: usize) -> Result<Recording> {
    let k = numbers(&dir.join("camera-intrinsics.txt"))?;
    let mut list: Vec<PathBuf> =
        fs::read_dir(dir)?.map(|e| e.map(|e| e.path())).collect::<std::io::Result<_>>()?;
    list.retain(|p| p.to_string_lossy().ends_with(".depth.png"));
    list.sort();
    if reverse {
        list.reverse();
    }
    list.truncate(most);
    let mut images = Vec::new();
    for (n, file) in list.iter().enumerate() {
        let pose = file.to_string_lossy().replace(".depth.png", ".pose.txt");
        images.push((file.clone(), matrix_pose(Path::new(&pose))?, n as f64 / 15.0));
    }
    let [fx, _, cx, _, fy, cy, ..] = k[..] else { return Err("camera-intrinsics.txt: not 3x3".into()) };
    read(images, [fx, fy, cx, cy], 1000.0, 0)
}

/// TUM's `depth.txt` lists `time file`, `groundtruth.txt` lists `time tx ty tz qx qy qz qw`. Where there is no
/// `camera-intrinsics.txt`, the camera is the data set's default.
fn tum(dir: &Path, reverse: bool, most: usize) -> Result<Recording> {
    let poses: Vec<(f64, Isometry3<f32>)> =
        lines(&dir.join("groundtruth.txt"))?.iter().map(|l| tum_pose(l)).collect::<Result<_>>()?;
    let mut list = lines(&dir.join("depth.txt"))?;
    if reverse {
        list.reverse();
    }
    list.truncate(most);
    let (mut images, mut unposed) = (Vec::new(), 0);
    for line in &list {
        let (time, name) = line.split_once(char::is_whitespace).ok_or("depth.txt: want `time file`")?;
        let time: f64 = time.parse()?;
        let off = |p: &&(f64, Isometry3<f32>)| (p.0 - time).abs();
        match poses.iter().min_by(|a, b| off(a).total_cmp(&off(b))).filter(|p| off(p) <= TOLERANCE) {
            Some((_, pose)) => images.push((dir.join(name.trim()), *pose, time)),
            None => unposed += 1,
        }
    }
    let file = dir.join("camera-intrinsics.txt");
    let camera = match numbers(&file).ok().as_deref() {
        Some(&[fx, _, cx, _, fy, cy, ..]) => [fx, fy, cx, cy],
        _ => [525.0, 525.0, 319.5, 239.5],
    };
    read(images, camera, 5000.0, unposed)
}

fn read(
    images: Vec<(PathBuf, Isometry3<f32>, f64)>,
    [fx, fy, cx, cy]: [f64; 4],
    units_per_metre: f32,
    unposed: usize,
) -> Result<Recording> {
    let (mut frames, mut size) = (Vec::new(), None);
    for (file, world_from_camera, time) in images {
        let (depth, this) = depth(&file, units_per_metre).map_err(|e| format!("{}: {e}", file.display()))?;
        if *size.get_or_insert(this) != this {
            return Err(format!("{}: {this:?} pixels, the first one has {size:?}", file.display()).into());
        }
        frames.push(Frame { depth, world_from_camera, time });
    }
    let (width, height) = size.ok_or("no depth image with a pose in the folder")?;
    let intrinsics = Intrinsics::new(fx as f32, fy as f32, cx as f32, cy as f32, width, height)?;
    Ok(Recording { intrinsics, frames, unposed })
}

/// Metres of a 16-bit image, and its size.
fn depth(path: &Path, units_per_metre: f32) -> Result<(Vec<f32>, (u32, u32))> {
    let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path)?));
    let mut reader = decoder.read_info()?;
    let mut raw = vec![0; reader.output_buffer_size().ok_or("png too large")?];
    let info = reader.next_frame(&mut raw)?;
    let pixels = info.width as usize * info.height as usize;
    if info.bit_depth != png::BitDepth::Sixteen || raw.len() != 2 * pixels {
        return Err("not a 16-bit grey image".into());
    }
    let metres = |b: &[u8]| match u16::from_be_bytes([b[0], b[1]]) {
        u16::MAX => 0.0,
        n => f32::from(n) / units_per_metre,
    };
    Ok((raw.chunks_exact(2).map(metres).collect(), (info.width, info.height)))
}

fn numbers(path: &Path) -> Result<Vec<f64>> {
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(text.split_whitespace().map(str::parse).collect::<std::result::Result<_, _>>()?)
}

/// Lines that are neither empty nor comments.
fn lines(path: &Path) -> Result<Vec<String>> {
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(text.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty()).map(str::to_owned).collect())
}

fn matrix_pose(path: &Path) -> Result<Isometry3<f32>> {
    let m = numbers(path)?;
    let [a, b, c, x, d, e, f, y, g, h, i, z, ..] = m[..] else { return Err("pose: not 4x4".into()) };
    let rotation = Rotation3::from_matrix(&Matrix3::new(a, b, c, d, e, f, g, h, i));
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation).cast::<f32>();
    Ok(Isometry3::from_parts(Translation3::new(x as f32, y as f32, z as f32), rotation))
}

fn tum_pose(line: &str) -> Result<(f64, Isometry3<f32>)> {
    let v: Vec<f64> = line.split_whitespace().map(str::parse).collect::<std::result::Result<_, _>>()?;
    let [t, x, y, z, qx, qy, qz, qw] = v[..] else {
        return Err(format!("groundtruth.txt: {line:?}, want `t tx ty tz qx qy qz qw`").into());
    };
    let q = UnitQuaternion::try_new(Quaternion::new(qw, qx, qy, qz), 1e-6)
        .ok_or("groundtruth.txt: a quaternion of length 0")?;
    Ok((t, Isometry3::from_parts(Translation3::new(x, y, z), q).cast()))
}
