//! A 3RScan data set in a folder, and writing one.

use crate::depth_image::{DepthImage, write_pgm};
use crate::info::SequenceInfo;
use crate::ply::{AnnotatedVertices, read_ply, write_ply};
use crate::pose::pose_text;
use crate::relationships::{ObjectRecord, ObjectsFile, RelationshipsFile, ScanObjects};
use crate::semseg::{SegGroup, Semseg};
use crate::sequence::Sequence;
use crate::{Annotation, Dataset, Error, Frame, FrameStream, Relation, RoomEntry, files};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

const ROOMS: &str = "3RScan.json";
const MESH: &str = "labels.instances.annotated.v2.ply";
const SEMSEG: &str = "semseg.v2.json";
/// Names under which relations are looked for; the unsplit file comes first.
const RELATIONS: [&str; 6] = [
    "relationships.json",
    "3DSSG/relationships.json",
    "3DSSG_subset/relationships.json",
    "3DSSG_subset/relationships_validation.json",
    "relationships_validation.json",
    "relationships_train.json",
];

/// 3RScan as its owners ship it, with 3DSSG's relationships beside it.
pub struct Folder {
    dir: PathBuf,
    rooms: Vec<RoomEntry>,
    relations: RelationshipsFile,
    generated: bool,
}

impl Folder {
    /// Reads `3RScan.json` and the relationships; scans are read when they are visited. Rooms whose
    /// reference scan is not in the folder are left out.
    ///
    /// # Errors
    /// A missing or malformed file, named, with where it comes from.
    pub fn open(dir: &Path) -> Result<Self, Error> {
        let path = dir.join(ROOMS);
        if !path.is_file() {
            return Err(Error::Missing {
                path,
                hint: "want the folder of a 3RScan download (3RScan.json and one folder per scan)".into(),
            });
        }
        let mut rooms: Vec<RoomEntry> = files::read_json(&path)?;
        rooms.retain(|r| dir.join(&r.reference).is_dir());
        for room in &mut rooms {
            room.scans.retain(|s| dir.join(&s.id).is_dir());
        }
        if rooms.is_empty() {
            return Err(Error::format(path, "rooms", "no folder of any reference scan is here"));
        }
        let found = RELATIONS.iter().map(|n| dir.join(n)).find(|p| p.is_file());
        let Some(found) = found else {
            return Err(Error::Missing {
                path: dir.join(RELATIONS[0]),
                hint: "3DSSG's relationships.json comes from the data set's page".into(),
            });
        };
        let relations = files::read_json(&found)?;
        Ok(Self { generated: dir.join(GENERATED).is_file(), dir: dir.to_owned(), rooms, relations })
    }

    /// With the rooms of one split alone: those of that `type` in `3RScan.json`.
    ///
    /// # Errors
    /// The folder has none of them.
    pub fn of_split(mut self, split: &str) -> Result<Self, Error> {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        self.rooms.iter().for_each(|r| *counts.entry(r.split.clone()).or_default() += 1);
        self.rooms.retain(|r| r.split == split);
        if self.rooms.is_empty() {
            let there: Vec<String> = counts.iter().map(|(name, n)| format!("{n} {name}")).collect();
            let problem = format!("no room of the split {split}; in the folder are {}", there.join(", "));
            return Err(Error::format(self.dir.join(ROOMS), "type", problem));
        }
        Ok(self)
    }

    fn scan_dir(&self, scan: &str) -> Result<PathBuf, Error> {
        let known = |r: &RoomEntry| r.reference == scan || r.scans.iter().any(|s| s.id == scan);
        if self.rooms.iter().any(known) {
            Ok(self.dir.join(scan))
        } else {
            Err(Error::UnknownScan(scan.to_owned()))
        }
    }
}

impl Dataset for Folder {
    fn kind(&self) -> &'static str {
        if self.generated { "generated" } else { "3rscan" }
    }

    fn has_own_path_per_visit(&self) -> bool {
        false
    }

    fn rooms(&self) -> &[RoomEntry] {
        &self.rooms
    }

    fn annotation(&self, scan: &str) -> Result<Annotation, Error> {
        let dir = self.scan_dir(scan)?;
        let path = dir.join(MESH);
        let v = read_ply(&files::read(&path)?, &path)?;
        let semseg: Semseg = files::read_json(&dir.join(SEMSEG))?;
        let labels = semseg.groups.into_iter().map(|g| (g.object_id, g.label)).collect();
        Ok(Annotation { points: v.points, instances: v.instances, labels })
    }

    fn relations(&self, scan: &str) -> Result<Vec<Relation>, Error> {
        self.scan_dir(scan)?;
        Ok(self.relations.of_scan(scan))
    }

    fn frame_count(&self, scan: &str, _visit: u64) -> Result<u32, Error> {
        Ok(Sequence::open(&self.scan_dir(scan)?)?.numbers().len() as u32)
    }

    fn frames(&self, scan: &str, _visit: u64) -> Result<FrameStream<'_>, Error> {
        Ok(Sequence::open(&self.scan_dir(scan)?)?.into_frames())
    }
}

/// Marks a folder as generated, so that its numbers are never taken for 3RScan's.
const GENERATED: &str = "GENERATED.txt";

/// Writes a whole data set in 3RScan's form; [`Folder`] reads it back.
///
/// `scan_done` is called after each scan; a scan whose last file is there is not written again, so
/// an interrupted run goes on where it stopped.
///
/// # Errors
/// What the source or the file system refuses.
pub fn write_dataset(
    source: &dyn Dataset,
    dir: &Path,
    note: &str,
    mut scan_done: impl FnMut(&str),
) -> Result<(), Error> {
    files::write(&dir.join(GENERATED), note.as_bytes())?;
    let mut relations = BTreeMap::new();
    let mut objects = ObjectsFile::default();
    for room in source.rooms() {
        for scan in std::iter::once(&room.reference).chain(room.scans.iter().map(|s| &s.id)) {
            let annotation = source.annotation(scan)?;
            if !dir.join(scan).join(MESH).is_file() {
                write_sequence(&dir.join(scan), source.frames(scan, 0)?)?;
                write_annotation(&dir.join(scan), scan, &annotation)?;
            }
            relations.insert(scan.clone(), source.relations(scan)?);
            let record = |(id, label): (&u32, &String)| ObjectRecord {
                id: id.to_string(),
                label: label.clone(),
                other: BTreeMap::new(),
            };
            objects.scans.push(ScanObjects {
                scan: scan.clone(),
                objects: annotation.labels.iter().map(record).collect(),
            });
            scan_done(scan);
        }
    }
    let path = dir.join(RELATIONS[0]);
    files::write_json(&path, &RelationshipsFile::from_relations(&relations, &path)?)?;
    files::write_json(&dir.join("objects.json"), &objects)?;
    files::write_json(&dir.join(ROOMS), &source.rooms())
}

fn write_annotation(dir: &Path, scan: &str, a: &Annotation) -> Result<(), Error> {
    let groups = a.labels.iter().map(|(&id, label)| SegGroup {
        object_id: id,
        id,
        label: label.clone(),
        segments: vec![id],
        obb: None,
    });
    files::write_json(&dir.join(SEMSEG), &Semseg { scan_id: scan.to_owned(), groups: groups.collect() })?;
    let v = AnnotatedVertices { points: a.points.clone(), instances: a.instances.clone() };
    // The mesh comes last: its presence says that the scan is complete.
    files::write(&dir.join(MESH), &write_ply(&v, false))
}

fn write_sequence(dir: &Path, frames: FrameStream<'_>) -> Result<(), Error> {
    let path = dir.join("sequence.zip");
    let bad = |e: zip::result::ZipError| Error::format(&path, "archive", e.to_string());
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    // A fixed date keeps the bytes of equal sequences equal.
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .compression_level(Some(1))
        .last_modified_time(zip::DateTime::default());
    let mut put = |name: &str, bytes: &[u8]| {
        zip.start_file(name, options).map_err(bad)?;
        zip.write_all(bytes).map_err(Error::io(&path))
    };
    let mut info = None;
    for frame in frames {
        let f: Frame = frame?;
        put(&format!("frame-{:06}.depth.pgm", f.index), &write_pgm(&millimetres(&f)))?;
        put(&format!("frame-{:06}.pose.txt", f.index), pose_text(f.world_from_camera.as_ref()).as_bytes())?;
        let i = info.get_or_insert(SequenceInfo { depth: f.intrinsics, per_metre: 1000.0, frames: Some(0) });
        i.frames = Some(f.index + 1);
    }
    let info = info.ok_or_else(|| Error::format(&path, "frames", "the source gave none"))?;
    put("_info.txt", info.text().as_bytes())?;
    let bytes = zip.finish().map_err(bad)?.into_inner();
    files::write(&path, &bytes)
}

fn millimetres(f: &Frame) -> DepthImage {
    let samples = f.depth.iter().map(|d| (d * 1000.0).round().clamp(0.0, 65534.0) as u16).collect();
    DepthImage { width: f.intrinsics.width, height: f.intrinsics.height, samples }
}
