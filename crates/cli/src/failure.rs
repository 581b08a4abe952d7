//! Why a command failed, told in one line: what, why, and what to do about it.

use serde::Serialize;
use std::fmt;

/// A failure with its cure; prints as `what: why; hint: cure`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failure {
    /// File, folder or argument that is concerned.
    pub what: String,
    /// What is wrong with it.
    pub why: String,
    /// What the user can do.
    pub hint: String,
}

impl Failure {
    /// From the three parts of a good message.
    pub fn new(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.into(), hint: hint.into() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; hint: {}", one_line(&self.what), one_line(&self.why), one_line(&self.hint))
    }
}

/// The text with every run of white space, line ends among them, made one space.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl From<cairn_sensor::SourceError> for Failure {
    fn from(e: cairn_sensor::SourceError) -> Self {
        Self::new(e.what, e.why, e.cure)
    }
}

/// A file that could not be written (reading has its own words where it happens).
impl From<cairn_eval::FileError> for Failure {
    fn from(e: cairn_eval::FileError) -> Self {
        Self::new(e.file, e.reason, "check that its folder exists, may be written, and has room")
    }
}
