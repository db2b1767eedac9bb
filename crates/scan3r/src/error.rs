//! What can be wrong with a file.

use std::path::{Path, PathBuf};

/// A file that could not be read or written, with the place and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's word.
        source: std::io::Error,
    },
    /// A file does not follow its format.
    #[error("{path}: {field}: {problem}")]
    Format {
        /// The file.
        path: PathBuf,
        /// The field, line, property or archive entry.
        field: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// A file that the data set needs is absent.
    #[error("{path} is missing: {hint}")]
    Missing {
        /// The file.
        path: PathBuf,
        /// Where it comes from or what to do.
        hint: String,
    },
    /// A value handed to a constructor is out of range.
    #[error("{field}: {problem}")]
    Value {
        /// The field.
        field: &'static str,
        /// What was found and what was expected.
        problem: String,
    },
    /// A scan id that the data set does not hold.
    #[error("no scan {0:?} in this data set")]
    UnknownScan(String),
}

impl Error {
    /// A [`Error::Format`] in one line.
    pub fn format(path: impl AsRef<Path>, field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Format { path: path.as_ref().to_owned(), field: field.into(), problem: problem.into() }
    }

    /// A [`Error::Io`] in one line, for `map_err`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_owned();
        move |source| Self::Io { path, source }
    }
}
