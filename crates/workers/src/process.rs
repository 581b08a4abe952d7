//! One worker process as the supervisor holds it: orders in, reports out, and its end.

use crate::Role;
use crate::message::{Order, Report, read, write};
use std::io;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};

/// Makes the command that starts a worker; its standard input and output are taken.
pub type Start = Arc<dyn Fn(Role) -> Command + Send + Sync>;

/// What comes from a process, with its role and its number among all that were started.
pub struct Event {
    pub role: Role,
    pub start: u64,
    pub kind: EventKind,
}

/// See [`Event`].
pub enum EventKind {
    Said(Report),
    /// Its standard output has ended; why, if it was no plain end.
    Closed(Option<String>),
}

/// A running process. Dropped, it is killed.
pub struct Process {
    child: Child,
    orders: Sender<Order>,
}

impl Process {
    /// Starts a process; two threads carry its messages, so that the supervisor never waits for a pipe.
    ///
    /// # Errors
    /// When the program or the threads cannot be started.
    pub fn start(mut command: Command, role: Role, start: u64, to: Sender<Event>) -> io::Result<Self> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C is the supervisor's; the workers end when it says so.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let pipes = child.stdin.take().zip(child.stdout.take());
        let (mut stdin, mut stdout) = pipes.ok_or_else(|| io::Error::other("no pipes"))?;
        let (orders, from) = channel::<Order>();
        let process = Self { child, orders };
        let thread = |name: &str| std::thread::Builder::new().name(format!("cairn-{}-{name}", role.name()));
        thread("in").spawn(move || {
            // A pipe that fails has ended; the reports below tell the supervisor.
            for order in from {
                if write(&mut stdin, &order).is_err() {
                    return;
                }
            }
        })?;
        thread("out").spawn(move || {
            let send = |kind| to.send(Event { role, start, kind }).is_ok();
            loop {
                let (kind, is_end) = match read::<Report>(&mut stdout) {
                    Ok(Some(report)) => (EventKind::Said(report), false),
                    Ok(None) => (EventKind::Closed(None), true),
                    Err(e) => (EventKind::Closed(Some(e.to_string())), true),
                };
                if !send(kind) || is_end {
                    return;
                }
            }
        })?;
        Ok(process)
    }

    /// Its id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Gives an order; of one that has ended nothing is heard but its end.
    pub fn order(&self, order: Order) {
        let _ = self.orders.send(order);
    }

    /// Kills it, if it has not ended, and says how it ended.
    pub fn end(mut self) -> String {
        // It may have ended by itself: then its own status counts.
        let ended = self.child.try_wait().ok().flatten();
        let _ = self.child.kill();
        match ended.map_or_else(|| self.child.wait(), Ok) {
            Ok(status) => words(status),
            Err(e) => e.to_string(),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Already ended is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// How a process ended.
pub fn words(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.signal(), status.code()) {
        (Some(6), _) => "it aborted (signal 6), as when its memory limit is reached".into(),
        (Some(9), _) => "it was killed (signal 9)".into(),
        (Some(signal), _) => format!("it was ended by signal {signal}"),
        (None, Some(0)) => "it ended by itself".into(),
        (None, code) => format!("it ended with code {}", code.unwrap_or(-1)),
    }
}
