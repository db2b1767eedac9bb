//! One recording of any supported format, found by looking at its folder.

use crate::depth_image::read_png;
use crate::pose::{parse_pose, parse_tum_line};
use crate::sequence::Sequence;
use crate::{Error, Frame, FrameStream, Intrinsics, files};
use nalgebra::Isometry3;
use std::fs;
use std::path::{Path, PathBuf};

/// Frames and poses of TUM recordings belong together within this, seconds.
const TUM_TOLERANCE: f64 = 0.02;

/// A layout of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `sequence.zip` or `sequence/` with PGM depth.
    ThreeRScan,
    /// `frame-NNNNNN.depth.png` and `.pose.txt`, in the folder or in `seq-XX`.
    SevenScenes,
    /// `depth.txt` and `groundtruth.txt`.
    Tum,
}

impl Format {
    /// As written on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ThreeRScan => "3rscan",
            Self::SevenScenes => "7scenes",
            Self::Tum => "tum",
        }
    }

    /// The format of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        [Self::ThreeRScan, Self::SevenScenes, Self::Tum].into_iter().find(|f| f.name() == name)
    }

    /// The format of a folder, by the files in it.
    fn detect(dir: &Path) -> Option<Self> {
        if dir.join("sequence.zip").is_file()
            || dir.join("sequence/_info.txt").is_file()
            || dir.join("_info.txt").is_file()
        {
            Some(Self::ThreeRScan)
        } else if dir.join("depth.txt").is_file() {
            Some(Self::Tum)
        } else if seven_scenes_folder(dir).is_some() {
            Some(Self::SevenScenes)
        } else {
            None
        }
    }
}

/// Frames of one recording.
pub struct Recording {
    format: Format,
    len: usize,
    notes: Vec<String>,
    frames: FrameStream<'static>,
}

impl Recording {
    /// Opens a folder, of a given or found format.
    ///
    /// # Errors
    /// A folder without a recording, saying what was looked for.
    pub fn open(dir: &Path, format: Option<Format>) -> Result<Self, Error> {
        if !dir.is_dir() {
            return Err(Error::Missing {
                path: dir.to_owned(),
                hint: "want the folder of a recording".into(),
            });
        }
        let format = format.or_else(|| Format::detect(dir)).ok_or_else(|| Error::Missing {
            path: dir.to_owned(),
            hint:
                "no recording: want sequence.zip or sequence/ (3RScan), frame-NNNNNN.depth.png (7-Scenes), \
                   or depth.txt with groundtruth.txt (TUM)"
                    .into(),
        })?;
        match format {
            Format::ThreeRScan => {
                let s = Sequence::open(dir)?;
                Ok(Self { format, len: s.numbers().len(), notes: Vec::new(), frames: s.into_frames() })
            }
            Format::SevenScenes => open_seven_scenes(dir),
            Format::Tum => open_tum(dir),
        }
    }

    /// What the folder turned out to be.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }

    /// Number of frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// True without frames.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Assumptions that were made where the folder says nothing.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether the recording's own z axis points up. 7-Scenes and TUM worlds stand anyhow.
    #[must_use]
    pub fn has_gravity(&self) -> bool {
        self.format == Format::ThreeRScan
    }

    /// All frames in order.
    #[must_use]
    pub fn into_frames(self) -> FrameStream<'static> {
        self.frames
    }
}

/// The folder that holds `frame-*.depth.png`: the given one or its first `seq-XX`.
fn seven_scenes_folder(dir: &Path) -> Option<PathBuf> {
    let holds = |d: &Path| numbers(d).is_ok_and(|n| !n.is_empty());
    if holds(dir) {
        return Some(dir.to_owned());
    }
    let mut seqs: Vec<PathBuf> = fs::read_dir(dir)
        .ok()?
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with("seq-")))
        .collect();
    seqs.sort();
    seqs.into_iter().find(|d| holds(d))
}

fn numbers(dir: &Path) -> Result<Vec<u32>, Error> {
    let number = |n: &str| n.strip_prefix("frame-")?.strip_suffix(".depth.png")?.parse::<u32>().ok();
    let mut v: Vec<u32> = fs::read_dir(dir)
        .map_err(Error::io(dir))?
        .filter_map(|e| number(e.ok()?.file_name().to_str()?))
        .collect();
    v.sort_unstable();
    Ok(v)
}

/// The 3x3 of `camera-intrinsics.txt`, or the default with a note.
fn intrinsics(
    dir: &Path,
    default: [f32; 4],
    width: u32,
    height: u32,
    notes: &mut Vec<String>,
) -> Result<Intrinsics, Error> {
    let path = dir.join("camera-intrinsics.txt");
    if !path.is_file() {
        let [fx, fy, cx, cy] = default;
        notes.push(format!("no camera-intrinsics.txt: f {fx} {fy}, c {cx} {cy} assumed"));
        return Intrinsics::new(fx, fy, cx, cy, width, height);
    }
    let text = files::read_text(&path)?;
    let k: Vec<f32> = text.split_whitespace().filter_map(|t| t.parse().ok()).collect();
    if k.len() != 9 {
        return Err(Error::format(
            &path,
            "matrix",
            format!("{} numbers, want the 9 of a 3x3 matrix", k.len()),
        ));
    }
    Intrinsics::new(k[0], k[4], k[2], k[5], width, height)
        .map_err(|e| Error::format(&path, "matrix", e.to_string()))
}

fn depth_png(path: &Path, k: Intrinsics, per_metre: f32) -> Result<Vec<f32>, Error> {
    let image = read_png(&files::read(path)?, path)?;
    if (image.width, image.height) != (k.width, k.height) {
        return Err(Error::format(
            path,
            "size",
            format!("{} x {}, the first frame has {} x {}", image.width, image.height, k.width, k.height),
        ));
    }
    Ok(image.metres(per_metre))
}

fn open_seven_scenes(dir: &Path) -> Result<Recording, Error> {
    let Some(folder) = seven_scenes_folder(dir) else {
        return Err(Error::Missing {
            path: dir.join("frame-000000.depth.png"),
            hint: "a 7-Scenes folder holds frame-NNNNNN.depth.png, directly or in seq-XX".into(),
        });
    };
    let numbers = numbers(&folder)?;
    let first = folder.join(format!("frame-{:06}.depth.png", numbers[0]));
    let image = read_png(&files::read(&first)?, &first)?;
    let mut notes = Vec::new();
    let at = [&folder, dir].map(Path::to_owned);
    let holder = at.iter().find(|d| d.join("camera-intrinsics.txt").is_file()).unwrap_or(&folder);
    let k = intrinsics(holder, [585.0, 585.0, 320.0, 240.0], image.width, image.height, &mut notes)?;
    let len = numbers.len();
    let frames = numbers.into_iter().map(move |index| {
        let path = folder.join(format!("frame-{index:06}.pose.txt"));
        Ok(Frame {
            index,
            time: f64::from(index) / 30.0,
            depth: depth_png(&folder.join(format!("frame-{index:06}.depth.png")), k, 1000.0)?,
            intrinsics: k,
            world_from_camera: parse_pose(&files::read_text(&path)?, &path)?,
        })
    });
    Ok(Recording { format: Format::SevenScenes, len, notes, frames: Box::new(frames) })
}

/// `time name` lines of a TUM list.
fn tum_list(path: &Path) -> Result<Vec<(f64, String)>, Error> {
    let text = files::read_text(path)?;
    let mut out = Vec::new();
    for (k, line) in text.lines().enumerate().filter(|(_, l)| !l.starts_with('#') && !l.trim().is_empty()) {
        let entry = line.split_whitespace().collect::<Vec<_>>();
        let time = entry.first().and_then(|t| t.parse::<f64>().ok()).filter(|t| t.is_finite());
        match (time, entry.get(1)) {
            (Some(t), Some(name)) => out.push((t, (*name).to_owned())),
            _ => return Err(Error::format(path, format!("line {}", k + 1), "want `time file`")),
        }
    }
    Ok(out)
}

fn open_tum(dir: &Path) -> Result<Recording, Error> {
    let list = tum_list(&dir.join("depth.txt"))?;
    let poses_path = dir.join("groundtruth.txt");
    let text = files::read_text(&poses_path)?;
    let mut poses = Vec::new();
    for (k, line) in text.lines().enumerate().filter(|(_, l)| !l.starts_with('#') && !l.trim().is_empty()) {
        poses.push(parse_tum_line(line, &poses_path, k + 1)?);
    }
    poses.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((start, name)) = list.first().cloned() else {
        return Err(Error::format(dir.join("depth.txt"), "list", "no depth image"));
    };
    if let Some((_, bad)) = list.iter().find(|(_, n)| n.starts_with('/') || n.split('/').any(|c| c == "..")) {
        return Err(Error::format(dir.join("depth.txt"), "file", format!("{bad:?} leaves the folder")));
    }
    let first = dir.join(name);
    let image = read_png(&files::read(&first)?, &first)?;
    let mut notes = Vec::new();
    let k = intrinsics(dir, [525.0, 525.0, 319.5, 239.5], image.width, image.height, &mut notes)?;
    let (len, dir) = (list.len(), dir.to_owned());
    let frames = list.into_iter().enumerate().map(move |(n, (time, name))| {
        Ok(Frame {
            index: n as u32,
            time: time - start,
            depth: depth_png(&dir.join(name), k, 5000.0)?,
            intrinsics: k,
            world_from_camera: nearest(&poses, time),
        })
    });
    Ok(Recording { format: Format::Tum, len, notes, frames: Box::new(frames) })
}

fn nearest(poses: &[(f64, Isometry3<f32>)], time: f64) -> Option<Isometry3<f32>> {
    let after = poses.partition_point(|p| p.0 < time);
    [after.checked_sub(1), Some(after)]
        .into_iter()
        .flatten()
        .filter_map(|k| poses.get(k))
        .min_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()))
        .filter(|p| (p.0 - time).abs() <= TUM_TOLERANCE)
        .map(|p| p.1)
}
