//! Errors: invalid files, and trajectories that cannot be compared.

use cairn_geometry::Degenerate;
use thiserror::Error;

/// A file that cannot be read or written; the message names the file, the line where there is one, and the reason.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{file}{}: {reason}", line.map(|l| format!(":{l}")).unwrap_or_default())]
pub struct FileError {
    /// Path or name.
    pub file: String,
    /// Line number, counted from one.
    pub line: Option<usize>,
    /// What is wrong, and the remedy if known.
    pub reason: String,
}

impl FileError {
    pub(crate) fn at(file: &str, line: usize, reason: String) -> Self {
        Self { file: file.to_owned(), line: Some(line), reason }
    }

    pub(crate) fn whole(file: &str, reason: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line: None, reason: reason.into() }
    }
}

/// Why an estimate cannot be compared with its reference.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EvalError {
    /// No two poses are close in time.
    #[error(
        "no pose of the estimate is within {max_difference_s} s of a pose of the reference (reference \
         {reference_span}, estimate {estimate_span}); are both in the same clock? --max-difference widens the search"
    )]
    NoPairs {
        /// Maximum time difference, in seconds.
        max_difference_s: f64,
        /// First and last time of the reference.
        reference_span: String,
        /// First and last time of the estimate.
        estimate_span: String,
    },
    /// The pairs do not determine an alignment.
    #[error("the trajectories cannot be aligned: {0}; --align none compares them as they are")]
    Alignment(#[from] Degenerate),
    /// Neither has times, and they have not as many poses.
    #[error(
        "the estimate has {estimate} poses and the reference {reference}, and without times it is not known which belong \
         together"
    )]
    Counts {
        /// Poses of the estimate.
        estimate: usize,
        /// Poses of the reference.
        reference: usize,
    },
    /// One has times, the other has not.
    #[error("{without} has no times, and its {poses} poses are not as many as the {others} of the other")]
    NoTimes {
        /// The file without times.
        without: String,
        /// Its poses.
        poses: usize,
        /// Poses of the other.
        others: usize,
    },
    /// An invalid option.
    #[error("{0}")]
    Option(String),
}
