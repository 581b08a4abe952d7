//! Results on stdout: text for people or JSON for machines, never both. A closed pipe is not an error.

use crate::failure::Failure;
use crate::style::{self, Paint};
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// The exit code of a command that a signal ended early.
pub const INTERRUPTED: u8 = 130;
/// What is said when there is nothing to write.
pub const NOTHING: &str = "interrupted: nothing was written";

/// The output format of this invocation.
pub struct Output {
    json: bool,
}

impl Output {
    /// JSON if requested, else text.
    pub fn new(json: bool) -> Self {
        Self { json }
    }

    /// Whether the result is JSON, so that nothing else may go to stdout.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a result: the value as JSON, or formatted by `text`.
    ///
    /// # Errors
    /// When the value cannot be serialised or stdout cannot be written (a closed pipe is no error).
    pub fn result<T: Serialize>(&self, value: &T, text: impl FnOnce(&T) -> String) -> Result<(), Failure> {
        let shown = if self.json {
            serde_json::to_string_pretty(value)
                .map_err(|e| Failure::new("result", e.to_string(), "run again without --json"))?
        } else {
            text(value)
        };
        print(shown.trim_end())
    }

    /// Prints text for people unless JSON was requested; used for what is shown besides a failure.
    ///
    /// # Errors
    /// When stdout cannot be written (a closed pipe is no error).
    pub fn text(&self, text: &str) -> Result<(), Failure> {
        if self.json { Ok(()) } else { print(text.trim_end()) }
    }

    /// Says that a signal ended the command before it had anything to write; returns that exit code.
    pub fn interrupted(&self) -> ExitCode {
        if self.json {
            let _ = print(&serde_json::json!({ "interrupted": true }).to_string());
        }
        note(NOTHING);
        ExitCode::from(INTERRUPTED)
    }

    /// Prints the failure on stderr, with --json also as an object on stdout; returns exit code 1, or 2 for wrong
    /// usage.
    pub fn fail(&self, failure: &Failure) -> ExitCode {
        if self.json {
            let object = serde_json::json!({ "error": failure });
            // If stdout is closed, the line on stderr and the exit code still report the failure.
            let _ = print(&object.to_string());
        }
        for failure in std::iter::once(failure).chain(&failure.also) {
            note(&format!("{} {failure}", style::on_stderr(Paint::Wrong, "error:")));
        }
        ExitCode::from(failure.code)
    }
}

/// Warns, unless `RUST_LOG` leaves warnings out.
pub fn warn(text: &str) {
    tracing::warn!("{text}");
}

/// Prints a line on stderr. After a hang-up there is nobody to read it; the work continues all the same.
pub fn note(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new("stdout", e.to_string(), "check where the output is redirected to"))
        }
        _ => Ok(()),
    }
}
