//! Whole files within a limit, and writes that never leave half a file.

use crate::Error;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;

/// Largest file that is read whole, bytes.
pub(crate) const MAX_FILE: u64 = 256 << 20;

pub(crate) fn read(path: &Path) -> Result<Vec<u8>, Error> {
    let file = File::open(path).map_err(Error::io(path))?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > MAX_FILE {
        return Err(Error::format(path, "size", format!("more than {} MiB", MAX_FILE >> 20)));
    }
    Ok(bytes)
}

pub(crate) fn read_text(path: &Path) -> Result<String, Error> {
    text(read(path)?, path)
}

pub(crate) fn text(bytes: Vec<u8>, path: &Path) -> Result<String, Error> {
    String::from_utf8(bytes).map_err(|_| Error::format(path, "text", "not UTF-8"))
}

pub(crate) fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, Error> {
    serde_json::from_slice(&read(path)?).map_err(|e| Error::format(path, "JSON", e.to_string()))
}

pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    if let Some(dir) = path.parent() {
        fs::create_dir_all(dir).map_err(Error::io(dir))?;
    }
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".tmp");
    let tmp = path.with_file_name(name);
    let mut file = File::create(&tmp).map_err(Error::io(&tmp))?;
    file.write_all(bytes).map_err(Error::io(&tmp))?;
    fs::rename(&tmp, path).map_err(Error::io(path))
}

pub(crate) fn write_json<T: serde::Serialize>(path: &Path, value: &T) -> Result<(), Error> {
    let text = serde_json::to_vec(value).map_err(|e| Error::format(path, "JSON", e.to_string()))?;
    write(path, &text)
}
