//! The one error type of the crate.

/// Why a map, a camera or a parameter set was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An intrinsic value is not usable.
    #[error("intrinsics: {field} = {value}, expected {expected}")]
    Intrinsics {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would have been accepted.
        expected: &'static str,
    },
    /// A parameter is out of its range.
    #[error("params: {field} = {value}, expected {expected}")]
    Params {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would have been accepted.
        expected: &'static str,
    },
    /// Bytes that are no evicted part of a map.
    #[error(
        "evicted part of a map: byte {at}: {problem}; it was cut off, damaged, or written by another version"
    )]
    Evicted {
        /// Where it was noticed.
        at: usize,
        /// What was found there.
        problem: &'static str,
    },
}
