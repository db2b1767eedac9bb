//! What can go wrong in a benchmark.

/// A run that cannot be made as asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter is out of range.
    #[error("--{field}: {problem}")]
    Parameter {
        /// Name of the flag.
        field: &'static str,
        /// What was found and what was expected.
        problem: String,
    },
    /// The data set refused.
    #[error(transparent)]
    Data(#[from] scan3r::Error),
    /// The graph code refused.
    #[error(transparent)]
    Graph(#[from] graph_align::Error),
    /// Something in the pipeline refused.
    #[error("{0}")]
    Pipeline(String),
    /// A file could not be written or read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: std::path::PathBuf,
        /// The system's word.
        source: std::io::Error,
    },
}

impl Error {
    pub(crate) fn parameter(field: &'static str, problem: impl Into<String>) -> Self {
        Self::Parameter { field, problem: problem.into() }
    }
}
