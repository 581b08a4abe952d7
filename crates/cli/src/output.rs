//! Results on stdout: text for people or JSON for machines, never both. A closed pipe is not an error.

use crate::failure::Failure;
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

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

    /// Prints the failure on stderr, with --json also as an object on stdout, and returns exit code 1.
    pub fn fail(&self, failure: &Failure) -> ExitCode {
        if self.json {
            let object = serde_json::json!({ "error": failure });
            // If stdout is closed, the line on stderr and the exit code still report the failure.
            let _ = print(&object.to_string());
        }
        eprintln!("error: {failure}");
        ExitCode::from(1)
    }
}

fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new("stdout", e.to_string(), "check where the output is redirected to"))
        }
        _ => Ok(()),
    }
}
