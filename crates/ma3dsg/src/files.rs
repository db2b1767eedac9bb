//! Reading whole files within a limit, and writing them so that a reader never sees half of one.

use anyhow::{Context, Result, bail};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Largest JSON or weights file that is read, bytes.
pub(crate) const MAX_FILE: u64 = 256 << 20;

/// A whole file.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>> {
    let file = File::open(path).with_context(|| format!("{}", path.display()))?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE + 1).read_to_end(&mut bytes).with_context(|| format!("{}", path.display()))?;
    if bytes.len() as u64 > MAX_FILE {
        bail!("{}: more than {} MiB", path.display(), MAX_FILE >> 20);
    }
    Ok(bytes)
}

/// A whole text file.
pub(crate) fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read(path)?).with_context(|| format!("{}: not UTF-8", path.display()))
}

/// Writes through a temporary file beside the target, then renames it.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let context = || format!("{}", path.display());
    if let Some(dir) = path.parent().filter(|d| !d.as_os_str().is_empty()) {
        fs::create_dir_all(dir).with_context(context)?;
    }
    let mut name = path.file_name().with_context(context)?.to_owned();
    name.push(".tmp");
    let tmp = path.with_file_name(name);
    let mut file = File::create(&tmp).with_context(context)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).with_context(context)?;
    fs::rename(&tmp, path).with_context(context)
}

/// Files of a folder with one extension, sorted by name.
pub(crate) fn list(dir: &Path, extension: &str) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(dir).with_context(|| format!("{}", dir.display()))?;
    let mut files = Vec::new();
    for e in entries {
        let path = e.with_context(|| format!("{}", dir.display()))?.path();
        if path.extension().is_some_and(|x| x == extension) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
