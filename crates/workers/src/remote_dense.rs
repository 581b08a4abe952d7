//! The process of surfaces for a session that is in another process: it follows the journal of the map and sends what changes.
//!
//! A thread of its own looks after the process, so that its death, a hang or a wait costs the session nothing. The surface that
//! was sent stays until the next process has all of it.

use crate::Role;
use crate::message::{Failure, Opened, Order, Report};
use crate::process::{Event, EventKind, Process, Start};
use crate::supervision::{Death, EventSink, RunEvent};
use crate::worker::Worker;
use cairn_dense::SurfaceChange;
use cairn_session::DepthWanted;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// The process is looked after so often.
const LOOK: Duration = Duration::from_millis(20);
/// A process that gives no sign of life for so long is killed: nobody waits for it.
const HANG_LIMIT: Duration = Duration::from_secs(5);
/// A process that has not begun its work after this time hangs.
const BEGIN_LIMIT: Duration = Duration::from_secs(60);

/// The process, as long as this is kept.
pub(crate) struct RemoteDense {
    ended: Arc<AtomicBool>,
}

impl Drop for RemoteDense {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
    }
}

impl RemoteDense {
    /// Begins, with the folder of the journal, and gives where changes come from while they are wanted.
    ///
    /// # Errors
    /// When the system provides no thread.
    pub fn begin(
        ring: PathBuf,
        folder: PathBuf,
        opened: Opened,
        command: Start,
        tell: EventSink,
        wanted: Arc<DepthWanted>,
    ) -> std::io::Result<(Self, Receiver<SurfaceChange>)> {
        let (changes, surfaces) = channel();
        let (to, events) = channel();
        let ended = Arc::new(AtomicBool::new(false));
        let mut looking = Looking {
            first: Order::Map { ring, folder, opened, start: 0, surfaces: None, session: None },
            command,
            tell,
            to,
            worker: Worker::new(),
            starts: 0,
            began: Instant::now(),
            died: None,
            changes,
            wanted,
        };
        let is_ended = ended.clone();
        let thread = std::thread::Builder::new().name("cairn-dense".into());
        thread.spawn(move || looking.run(&events, &is_ended))?;
        Ok((Self { ended }, surfaces))
    }
}

struct Looking {
    /// What a process is told first, but for its number.
    first: Order,
    command: Start,
    tell: EventSink,
    to: Sender<Event>,
    worker: Worker,
    starts: u64,
    began: Instant,
    /// When the one before died, until the next has begun.
    died: Option<Instant>,
    changes: Sender<SurfaceChange>,
    wanted: Arc<DepthWanted>,
}

impl Looking {
    fn run(&mut self, events: &Receiver<Event>, ended: &AtomicBool) {
        let mut goes_on = self.start();
        let mut looked = Instant::now();
        while goes_on && !ended.load(Ordering::Relaxed) {
            if let Ok(event) = events.recv_timeout(LOOK) {
                goes_on = self.event(event);
            }
            // This process was stopped meanwhile: the other had no chance to answer.
            if looked.elapsed() > Duration::from_secs(1) {
                self.worker.heard = Instant::now();
            }
            looked = Instant::now();
            goes_on &= self.look();
        }
    }

    /// False where there is no use in going on.
    fn start(&mut self) -> bool {
        self.starts += 1;
        let (role, number) = (Role::Dense, self.starts);
        match Process::start((self.command)(role), role, number, self.to.clone()) {
            Ok(process) => {
                let mut first = self.first.clone();
                if let Order::Map { start, .. } = &mut first {
                    *start = number;
                }
                process.order(first);
                (self.tell)(RunEvent::Started { role, id: process.id() });
                self.worker.started(process, number);
                true
            }
            Err(e) => {
                let why = Failure::new("the process for dense", e, "close other programs");
                (self.tell)(RunEvent::NoSurfaces(&why));
                false
            }
        }
    }

    fn event(&mut self, event: Event) -> bool {
        if event.start != self.worker.start || self.worker.process.is_none() {
            return true;
        }
        let report = match event.kind {
            EventKind::Closed(why) => return self.died(why),
            EventKind::Said(report) => report,
        };
        self.worker.heard = Instant::now();
        match report {
            Report::Ready { key_frames, .. } => {
                self.worker.ready = true;
                if let Some(died) = self.died.take() {
                    (self.tell)(RunEvent::DenseResumed { key_frames, after_s: died.elapsed().as_secs_f64() });
                }
            }
            Report::Followed => {
                self.worker.progress = true;
                self.worker.backoff.calm();
            }
            // Without a receiver the session has ended, and this soon does.
            Report::Shown(shown) => return shown.into_change().is_none_or(|c| self.changes.send(c).is_ok()),
            Report::Failed(why) => {
                (self.tell)(RunEvent::NoSurfaces(&why));
                return false;
            }
            _ => {}
        }
        true
    }

    fn look(&mut self) -> bool {
        if self.worker.take_due() {
            return self.start();
        }
        if self.worker.ping() && self.wanted.any.load(Ordering::Relaxed) {
            self.worker.order(Order::Show { columns: self.wanted.columns.load(Ordering::Relaxed) });
        }
        let limit = if self.worker.ready { HANG_LIMIT } else { BEGIN_LIMIT };
        if self.worker.process.is_some() && self.worker.heard.elapsed() > limit {
            let why = format!("it did not answer for {:.1} s and was killed", limit.as_secs_f64());
            return self.died(Some(why));
        }
        true
    }

    /// The process has ended, or is ended here for the reason `why`.
    fn died(&mut self, why: Option<String>) -> bool {
        let Some(process) = self.worker.process.take() else { return true };
        let status = process.end();
        let (role, how) = (Role::Dense, why.unwrap_or(status));
        (self.tell)(RunEvent::Died(&Death {
            role,
            how,
            at_frame: 0,
            t_s: self.began.elapsed().as_secs_f64(),
        }));
        self.worker.ready = false;
        self.died.get_or_insert_with(Instant::now);
        let had_done_work = self.worker.has_done_work();
        let Some(delay) = self.worker.backoff.after_death(had_done_work) else {
            (self.tell)(RunEvent::GivenUp { role });
            return false;
        };
        if !delay.is_zero() {
            let times = self.worker.backoff.times();
            (self.tell)(RunEvent::Waits { role, delay_s: delay.as_secs_f64(), times });
        }
        self.worker.due = Some(Instant::now() + delay);
        true
    }
}
