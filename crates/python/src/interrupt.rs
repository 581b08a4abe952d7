//! Work that may take long, and still ends at Ctrl-C.

use crate::errors::Error;
use pyo3::prelude::*;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Ctrl-C is looked for this often.
const EVERY: Duration = Duration::from_millis(50);

/// Waits for an answer without the interpreter; Ctrl-C ends the waiting with `KeyboardInterrupt`.
///
/// # Errors
/// `KeyboardInterrupt`, or what else a signal handler raises; [`Error`] where whoever should answer has failed.
pub fn wait<T: Send>(py: Python<'_>, answer: &mut Receiver<T>) -> PyResult<T> {
    loop {
        let from = &mut *answer;
        match py.detach(move || from.recv_timeout(EVERY)) {
            Ok(value) => return Ok(value),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Error::new_err("stopped by an error of the program"));
            }
        }
    }
}

/// Does something on a thread of its own and waits for it. After Ctrl-C the thread goes on to its end, unheard.
///
/// # Errors
/// As [`wait`], and those of the work.
pub fn on_thread<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    let (to, mut answer) = sync_channel(1);
    let started = std::thread::Builder::new().name("cairn-call".into()).spawn(move || {
        // Nobody listens any more after Ctrl-C.
        let _ = to.send(work());
    });
    started.map_err(|e| Error::new_err(format!("no thread can be started: {e}")))?;
    wait(py, &mut answer)?
}
