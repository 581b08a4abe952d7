//! A worker as whoever looks after it holds it: the process that does its work at present, and what is known of its life.

use crate::backoff::Backoff;
use crate::message::Order;
use crate::process::Process;
use std::time::{Duration, Instant};

/// Interval of the pings, at which SLAM also writes what is due.
const PING: Duration = Duration::from_millis(100);
/// A process that lived so long is not in a crash loop.
const LONG_LIFE: Duration = Duration::from_secs(10);

/// A worker and the process that does its work at present.
pub struct Worker {
    pub process: Option<Process>,
    /// Number of the process among all that were started.
    pub start: u64,
    /// It has begun its work.
    pub ready: bool,
    began: Instant,
    pub heard: Instant,
    pinged: Instant,
    /// What it has done counts since its start: only deaths without any are a crash loop.
    pub progress: bool,
    pub backoff: Backoff,
    /// When it is started again.
    pub due: Option<Instant>,
    /// It was told that there are no more frames.
    pub ending: bool,
}

impl Worker {
    /// Whether it has answered a ping that was sent later than this.
    pub fn has_answered_since(&self, since: Instant) -> bool {
        self.pinged >= since && self.heard >= self.pinged
    }

    /// One that is not started yet.
    pub fn new() -> Self {
        let now = Instant::now();
        Self {
            process: None,
            start: 0,
            ready: false,
            began: now,
            heard: now,
            pinged: now,
            progress: false,
            backoff: Backoff::default(),
            due: None,
            ending: false,
        }
    }

    /// Its process number `start` has begun.
    pub fn started(&mut self, process: Process, start: u64) {
        let backoff = std::mem::take(&mut self.backoff);
        *self = Self { process: Some(process), start, backoff, ..Self::new() };
    }

    pub fn order(&self, order: Order) {
        if let Some(process) = &self.process {
            process.order(order);
        }
    }

    /// Pings it where that is due, and returns whether it was.
    pub fn ping(&mut self) -> bool {
        let is_due = self.process.is_some() && self.pinged.elapsed() >= PING;
        if is_due {
            self.pinged = Instant::now();
            self.order(Order::Ping);
        }
        is_due
    }

    /// Whether it is time to start it again; true once.
    pub fn take_due(&mut self) -> bool {
        let is_due = self.due.is_some_and(|due| due <= Instant::now());
        if is_due {
            self.due = None;
        }
        is_due
    }

    /// Whether its process has done anything since it began, or lived so long that it is in no crash loop.
    pub fn has_done_work(&self) -> bool {
        self.progress || self.began.elapsed() > LONG_LIFE
    }
}
