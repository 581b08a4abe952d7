//! Where results go: text for people or JSON for machines on stdout, never both; a closed pipe is not an error.

use crate::failure::Failure;
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// How this run answers.
pub struct Output {
    json: bool,
}

impl Output {
    /// JSON when asked for, else text.
    pub fn new(json: bool) -> Self {
        Self { json }
    }

    /// Whether the result is JSON, so that nothing else may go to stdout.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a result: the value as JSON, or the text that `text` makes of it.
    pub fn result<T: Serialize>(&self, value: &T, text: impl FnOnce(&T) -> String) -> Result<(), Failure> {
        let shown = if self.json {
            serde_json::to_string_pretty(value)
                .map_err(|e| Failure::new("result", e.to_string(), "run again without --json"))?
        } else {
            text(value)
        };
        print(shown.trim_end())
    }

    /// Prints text for people, where no JSON was asked for: what a failure still has to show.
    pub fn text(&self, text: &str) -> Result<(), Failure> {
        if self.json { Ok(()) } else { print(text.trim_end()) }
    }

    /// Tells the failure on stderr, with --json also as an object on stdout, and gives exit code 1.
    pub fn fail(&self, failure: &Failure) -> ExitCode {
        if self.json {
            let object = serde_json::json!({ "error": failure });
            // The line on stderr and the exit code say it too, should stdout be gone.
            let _ = print(&object.to_string());
        }
        eprintln!("error: {failure}");
        ExitCode::from(1)
    }
}

fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::new("stdout", e.to_string(), "check where the output is sent"))
        }
        _ => Ok(()),
    }
}
