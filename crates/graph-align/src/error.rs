//! What can be wrong with a graph or a frame.

/// An input that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is not finite or out of range.
    #[error("{field}: {problem}")]
    Value {
        /// The field.
        field: &'static str,
        /// What was found and what was expected.
        problem: String,
    },
    /// An edge names a node that is not in the graph, or joins a node with itself.
    #[error("edge {s} -> {t}: {problem}")]
    Edge {
        /// Subject.
        s: u64,
        /// Object.
        t: u64,
        /// What is wrong.
        problem: &'static str,
    },
    /// A graph file or frame does not follow its format.
    #[error("{at}: {problem}")]
    Format {
        /// The field or byte offset.
        at: String,
        /// What was found and what was expected.
        problem: String,
    },
    /// Two different observations under one key.
    #[error("agent {agent}, epoch {epoch}, sequence number {seq}: two different observations")]
    Equivocation {
        /// Agent of both.
        agent: u16,
        /// Epoch of both.
        epoch: u16,
        /// Sequence number of both.
        seq: u32,
    },
    /// An entry of a time that is final here.
    #[error(
        "agent {agent}, epoch {epoch}, sequence number {seq}: everything before {cut_ds} ds is final here; start from the snapshot and publish in a new epoch"
    )]
    Late {
        /// Its agent.
        agent: u16,
        /// Its epoch.
        epoch: u16,
        /// Its sequence number.
        seq: u32,
        /// What is before this is final, tenths of a second.
        cut_ds: u32,
    },
}

impl Error {
    pub(crate) fn value(field: &'static str, problem: impl Into<String>) -> Self {
        Self::Value { field, problem: problem.into() }
    }

    #[cfg(any(feature = "json", feature = "wire"))]
    pub(crate) fn format(at: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Format { at: at.into(), problem: problem.into() }
    }
}
