//! One process that is started again whenever it dies or hangs, with the terminal of this one.
//!
//! In: its command, and a file that it writes again and again while it lives. Out: how it ended at last. It tells nothing
//! else: what must survive it lies in the folder of the run.

use crate::backoff::Backoff;
use crate::process::words;
use crate::supervision::{Death, RunEvent};
use crate::{Role, SuperviseError};
use std::path::Path;
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant, SystemTime};

/// A process that has written nothing for so long hangs.
const HANG_LIMIT: Duration = Duration::from_secs(2);
/// A process that has not begun after this time hangs.
const BEGIN_LIMIT: Duration = Duration::from_secs(60);
/// A process that lived so long is in no crash loop.
const LONG_LIFE: Duration = Duration::from_secs(10);
/// It is looked after so often.
const LOOK: Duration = Duration::from_millis(5);
/// The exit code of a program that panicked.
const PANICKED: i32 = 101;

/// Runs the command until it ends by itself, and gives its exit code. `alive` is the file that the process writes.
///
/// # Errors
/// [`SuperviseError`] when the process cannot be started or dies again and again.
pub fn respawn(
    role: Role,
    command: impl Fn() -> Command,
    alive: &Path,
    tell: &mut dyn FnMut(RunEvent),
) -> Result<i32, SuperviseError> {
    let (began, mut backoff) = (Instant::now(), Backoff::default());
    loop {
        // That of the process before counts no more.
        let _ = std::fs::remove_file(alive);
        let cannot = |e: std::io::Error| SuperviseError::Start { role, why: e.to_string() };
        let mut child = command().spawn().map_err(cannot)?;
        tell(RunEvent::Started { role, id: child.id() });
        let started = Instant::now();
        let (status, why) = wait(&mut child, alive).map_err(cannot)?;
        let how = match (why, status.code()) {
            (Some(why), _) => why,
            (None, Some(code)) if code != PANICKED => return Ok(code),
            (None, _) => words(status),
        };
        let t_s = began.elapsed().as_secs_f64();
        tell(RunEvent::Died(&Death { role, how: how.clone(), at_frame: 0, t_s }));
        let delay = backoff.after_death(started.elapsed() > LONG_LIFE);
        let times = backoff.times();
        let Some(delay) = delay else { return Err(SuperviseError::CrashLoop { role, how, times }) };
        if !delay.is_zero() {
            tell(RunEvent::Waits { role, delay_s: delay.as_secs_f64(), times });
            std::thread::sleep(delay);
        }
    }
}

/// Waits for the end of a process; one that hangs is killed, and why is said.
fn wait(child: &mut Child, alive: &Path) -> std::io::Result<(ExitStatus, Option<String>)> {
    let (mut heard, mut looked, mut last) = (Instant::now(), Instant::now(), None);
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok((status, None));
        }
        let written: Option<SystemTime> = std::fs::metadata(alive).and_then(|m| m.modified()).ok();
        // Whoever was stopped itself must not take others for hanging.
        if written != last || looked.elapsed() > Duration::from_secs(1) {
            (heard, last) = (Instant::now(), written);
        }
        looked = Instant::now();
        let limit = if written.is_some() { HANG_LIMIT } else { BEGIN_LIMIT };
        if heard.elapsed() > limit {
            child.kill()?;
            let why = format!("it gave no sign of life for {:.1} s and was killed", limit.as_secs_f64());
            return Ok((child.wait()?, Some(why)));
        }
        std::thread::sleep(LOOK);
    }
}
