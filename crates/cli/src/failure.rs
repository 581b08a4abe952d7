//! Why a command failed, in one line: what failed, why, and what to do about it.

use serde::Serialize;
use std::fmt;

/// A failure and how to fix it; printed as `what: why; hint: what to do`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failure {
    /// The file, folder or argument concerned.
    pub what: String,
    /// What is wrong with it.
    pub why: String,
    /// What the user can do.
    pub hint: String,
    /// The exit code: 1; 2 where the command line itself is wrong; 3 for a place that is unknown.
    #[serde(skip)]
    pub code: u8,
    /// Further failures of the same run, when one did not stop the others.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<Failure>,
}

impl Failure {
    /// From the three parts of a good message.
    pub fn new(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.into(), hint: hint.into(), code: 1, also: Vec::new() }
    }

    /// A command line that contradicts itself: exit code 2.
    pub fn usage(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { code: 2, ..Self::new(what, why, hint) }
    }

    /// A place that no map shows: exit code 3.
    pub fn unknown_place(what: impl Into<String>, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { code: 3, ..Self::new(what, why, hint) }
    }

    /// All failures as one, in their order.
    ///
    /// # Errors
    /// When there is at least one.
    pub fn all(failures: impl IntoIterator<Item = Self>) -> Result<(), Self> {
        let mut failures = failures.into_iter();
        let Some(mut first) = failures.next() else { return Ok(()) };
        first.also.extend(failures);
        Err(first)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; hint: {}", one_line(&self.what), one_line(&self.why), one_line(&self.hint))
    }
}

/// The text with every run of white space, including line ends, replaced by one space.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl From<cairn_sensor::SourceError> for Failure {
    fn from(e: cairn_sensor::SourceError) -> Self {
        Self::new(e.what, e.why, e.cure)
    }
}

/// A file that could not be written (failures of reading are worded where they happen).
impl From<cairn_eval::FileError> for Failure {
    fn from(e: cairn_eval::FileError) -> Self {
        Self::new(
            e.file,
            e.reason,
            "check that its folder exists and is writable, and that the disk has room",
        )
    }
}
