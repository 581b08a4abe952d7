//! Errors of reading a log.

/// Why a log could not be read: file, line where there is one, and reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}{}: {reason}", line.map(|l| format!(", line {l}")).unwrap_or_default())]
pub struct LogError {
    /// Path or name.
    pub file: String,
    /// Line, counted from one.
    pub line: Option<usize>,
    /// What is wrong, and how to fix it where that is known.
    pub reason: String,
}

impl LogError {
    /// An error of a file as a whole.
    pub fn whole(file: &str, reason: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line: None, reason: reason.into() }
    }

    /// An error of one line.
    pub fn at(file: &str, line: usize, reason: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line: Some(line), reason: reason.into() }
    }
}
