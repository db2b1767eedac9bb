//! What can be wrong with weights and inputs.

/// Weights or inputs that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The bytes are no safetensors file that we take.
    #[error("safetensors: {0}")]
    File(String),
    /// A tensor is missing, has another shape or type, or holds a number that is not finite.
    #[error("tensor {name}: {problem}")]
    Tensor {
        /// Name as in the file.
        name: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// An input does not fit the model.
    #[error("{field}: {problem}")]
    Input {
        /// The argument.
        field: &'static str,
        /// What was found and what was expected.
        problem: String,
    },
}

impl Error {
    pub(crate) fn tensor(name: &str, problem: impl Into<String>) -> Self {
        Self::Tensor { name: name.to_owned(), problem: problem.into() }
    }

    pub(crate) fn input(field: &'static str, problem: impl Into<String>) -> Self {
        Self::Input { field, problem: problem.into() }
    }
}
