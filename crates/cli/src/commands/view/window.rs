//! The program `cairn-view`, which is the window, and the pipe to it.

use super::Arguments;
use crate::failure::Failure;
use crate::processes::beside_or_in_path;
use cairn_view::write_message;
use std::io::{BufWriter, ErrorKind, Write};
use std::process::{Child, ChildStdin, Command, Stdio};

/// Its name; it is looked for beside this program, then in PATH.
const PROGRAM: &str = "cairn-view";

/// A window.
pub struct Window {
    child: Child,
    /// It ends by itself once all is there.
    ends: bool,
    to: Option<BufWriter<ChildStdin>>,
}

impl Window {
    /// Opens it.
    ///
    /// # Errors
    /// When the program is not installed or cannot be started.
    pub fn open(a: &Arguments) -> Result<Self, Failure> {
        let mut command = Command::new(beside_or_in_path(PROGRAM));
        command.args(["--language", a.language.code()]).stdin(Stdio::piped());
        command.args(a.picture.iter().flat_map(|path| ["--picture".as_ref(), path.as_os_str()]));
        let mut child = command.spawn().map_err(|e| match e.kind() {
            ErrorKind::NotFound => Failure::new(
                "cairn view",
                format!("the program {PROGRAM} is not installed"),
                "cargo install --path crates/view --features window, in the sources of Cairn",
            ),
            _ => Failure::new(PROGRAM, e.to_string(), "check that it can be executed"),
        })?;
        let to = child.stdin.take().map(BufWriter::new);
        Ok(Self { child, ends: a.picture.is_some(), to })
    }

    /// Sends a message; false when the window was closed.
    pub fn send(&mut self, message: &[u8]) -> bool {
        let Some(to) = &mut self.to else { return false };
        if write_message(to, message).and_then(|()| to.flush()).is_err() {
            self.to = None;
        }
        self.to.is_some()
    }

    /// Whether it is still there.
    pub fn is_open(&mut self) -> bool {
        self.to.is_some() && matches!(self.child.try_wait(), Ok(None))
    }

    /// Nothing more comes; waits until it is closed.
    ///
    /// # Errors
    /// When it could not be shown; it has said why.
    pub fn end(mut self) -> Result<(), Failure> {
        // The window is closed when the pipe is: this program was killed.
        if self.ends {
            self.to = None;
        }
        let hint = "give it a screen: a desktop, or DISPLAY or WAYLAND_DISPLAY of one";
        match self.child.wait() {
            Ok(status) if status.success() => Ok(()),
            Ok(status) => Err(Failure::new("the window", format!("{PROGRAM} ended with {status}"), hint)),
            Err(e) => Err(Failure::new("the window", e.to_string(), hint)),
        }
    }
}

impl Drop for Window {
    /// One that nothing is shown in is closed.
    fn drop(&mut self) {
        if self.to.is_some() {
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
    }
}
