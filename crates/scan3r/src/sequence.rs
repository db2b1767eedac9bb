//! The frames of a 3RScan sequence, in a folder or an archive.

use crate::depth_image::read_pgm;
use crate::files;
use crate::info::SequenceInfo;
use crate::pose::parse_pose;
use crate::{Error, Frame, FrameStream};
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

/// 3RScan records at 5 Hz.
pub const FRAMES_PER_SECOND: f64 = 5.0;
/// Largest entry of an archive, bytes.
const MAX_ENTRY: u64 = 64 << 20;
/// Most entries of an archive.
const MAX_ENTRIES: usize = 1 << 20;
/// Largest ratio of unpacked to packed bytes. Depth images with large empty parts pack well.
const MAX_RATIO: u64 = 1000;

/// Where the files of a sequence lie.
enum Store {
    Folder(PathBuf),
    Archive { path: PathBuf, prefix: String, zip: Box<zip::ZipArchive<BufReader<File>>> },
}

impl Store {
    /// `dir/sequence.zip`, `dir/sequence/` or `dir` itself; entries of the archive lie at its root or
    /// under `sequence/`.
    fn open(dir: &Path) -> Result<Self, Error> {
        let archive = dir.join("sequence.zip");
        if archive.is_file() {
            let file = BufReader::new(File::open(&archive).map_err(Error::io(&archive))?);
            return Self::open_archive(file, archive);
        }
        for folder in [dir.join("sequence"), dir.to_owned()] {
            if folder.join("_info.txt").is_file() {
                return Ok(Self::Folder(folder));
            }
        }
        Err(Error::Missing {
            path: dir.join("sequence.zip"),
            hint: "a scan holds sequence.zip or sequence/_info.txt; it comes with 3RScan's download script"
                .into(),
        })
    }

    fn open_archive(file: BufReader<File>, path: PathBuf) -> Result<Self, Error> {
        let bad = |e: zip::result::ZipError| Error::format(&path, "archive", e.to_string());
        let zip = zip::ZipArchive::new(file).map_err(bad)?;
        if zip.len() > MAX_ENTRIES {
            return Err(Error::format(&path, "archive", format!("{} entries", zip.len())));
        }
        let prefix = zip
            .file_names()
            .filter_map(Result::ok)
            .find_map(|n| {
                n.strip_suffix("_info.txt").filter(|p| matches!(*p, "" | "sequence/")).map(str::to_owned)
            })
            .ok_or_else(|| Error::format(&path, "archive", "no entry _info.txt or sequence/_info.txt"))?;
        Ok(Self::Archive { path, prefix, zip: Box::new(zip) })
    }

    fn read(&mut self, name: &str) -> Result<Vec<u8>, Error> {
        match self {
            Self::Folder(dir) => files::read(&dir.join(name)),
            Self::Archive { path, prefix, zip } => {
                read_entry(zip, &format!("{prefix}{name}")).map_err(|e| Error::format(path, name, e))
            }
        }
    }

    fn path_of(&self, name: &str) -> PathBuf {
        match self {
            Self::Folder(dir) => dir.join(name),
            Self::Archive { path, .. } => path.join(name),
        }
    }

    /// Numbers of all frames that have a depth image, rising, gaps kept.
    fn numbers(&self) -> Result<Vec<u32>, Error> {
        let number = |n: &str| n.strip_prefix("frame-")?.strip_suffix(".depth.pgm")?.parse::<u32>().ok();
        let mut numbers: Vec<u32> = match self {
            Self::Folder(dir) => std::fs::read_dir(dir)
                .map_err(Error::io(dir))?
                .filter_map(|e| number(e.ok()?.file_name().to_str()?))
                .collect(),
            Self::Archive { prefix, zip, .. } => zip
                .file_names()
                .filter_map(Result::ok)
                .filter_map(|n| number(n.strip_prefix(prefix.as_str())?))
                .collect(),
        };
        numbers.sort_unstable();
        numbers.dedup();
        Ok(numbers)
    }
}

fn read_entry<R: Read + Seek>(zip: &mut zip::ZipArchive<R>, name: &str) -> Result<Vec<u8>, String> {
    let entry = zip.by_name(name).map_err(|e| e.to_string())?;
    let (size, packed) = (entry.size(), entry.compressed_size());
    if size > MAX_ENTRY || size / packed.max(1) > MAX_RATIO {
        return Err(format!("{size} bytes from {packed}, want at most {MAX_ENTRY}"));
    }
    let mut bytes = Vec::new();
    entry.take(MAX_ENTRY).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if bytes.len() as u64 != size {
        return Err(format!("{} bytes, {size} announced", bytes.len()));
    }
    Ok(bytes)
}

/// A sequence whose frames are read one at a time.
pub struct Sequence {
    store: Store,
    info: SequenceInfo,
    numbers: Vec<u32>,
}

impl Sequence {
    /// Opens the sequence of a scan folder.
    ///
    /// # Errors
    /// No sequence, an unreadable archive, a malformed `_info.txt`, no frame.
    pub fn open(dir: &Path) -> Result<Self, Error> {
        let mut store = Store::open(dir)?;
        let path = store.path_of("_info.txt");
        let info = SequenceInfo::parse(&files::text(store.read("_info.txt")?, &path)?, &path)?;
        let numbers = store.numbers()?;
        if numbers.is_empty() {
            return Err(Error::format(store.path_of(""), "frames", "no frame-NNNNNN.depth.pgm"));
        }
        Ok(Self { store, info, numbers })
    }

    /// The calibration.
    #[must_use]
    pub fn info(&self) -> &SequenceInfo {
        &self.info
    }

    /// Numbers of the frames.
    #[must_use]
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    fn frame(&mut self, index: u32) -> Result<Frame, Error> {
        let name = format!("frame-{index:06}.depth.pgm");
        let path = self.store.path_of(&name);
        let image = read_pgm(&self.store.read(&name)?, &path)?;
        let k = self.info.depth;
        if (image.width, image.height) != (k.width, k.height) {
            return Err(Error::format(
                path,
                "size",
                format!("{} x {}, _info.txt says {} x {}", image.width, image.height, k.width, k.height),
            ));
        }
        let name = format!("frame-{index:06}.pose.txt");
        let path = self.store.path_of(&name);
        let pose = parse_pose(&files::text(self.store.read(&name)?, &path)?, &path)?;
        Ok(Frame {
            index,
            time: f64::from(index) / FRAMES_PER_SECOND,
            depth: image.metres(self.info.per_metre),
            intrinsics: k,
            world_from_camera: pose,
        })
    }

    /// All frames in order.
    #[must_use]
    pub fn into_frames(mut self) -> FrameStream<'static> {
        let numbers = std::mem::take(&mut self.numbers);
        Box::new(numbers.into_iter().map(move |n| self.frame(n)))
    }
}
