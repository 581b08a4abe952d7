//! One place for the newest picture: what is overtaken is counted and forgotten.

use cairn_sensor::{GrayImage, SourceError, Stamp};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A picture and when it came.
pub(super) struct Picture {
    pub stamp: Stamp,
    pub image: GrayImage,
    /// When the moment it shows would have arrived without delay: its age counts from here.
    pub born: Instant,
}

/// What the threads of a stream share.
#[derive(Default)]
pub(super) struct State {
    pub newest: Option<Picture>,
    /// Size and rate of the first picture.
    pub known: Option<([usize; 2], f64)>,
    /// Why there will be nothing more.
    pub failed: Option<SourceError>,
    /// The reader is gone: end.
    pub closing: bool,
    /// When the child was started, and when it last gave a picture.
    pub started: Option<Instant>,
    pub heard: Option<Instant>,
    /// Pictures overtaken, and too old when they were asked for.
    pub overtaken: usize,
    pub stale: usize,
    /// What happened to the stream, for people.
    pub lines: Vec<String>,
}

/// The state with its alarm.
#[derive(Default)]
pub(super) struct Slot {
    state: Mutex<State>,
    changed: Condvar,
}

impl Slot {
    /// Looks; a thread that panicked with the state in hand does not matter.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes who waits.
    pub fn change<T>(&self, f: impl FnOnce(&mut State) -> T) -> T {
        let out = f(&mut self.lock());
        self.changed.notify_all();
        out
    }

    /// Puts a picture where the reader finds it.
    pub fn put(&self, picture: Picture) {
        self.change(|s| {
            s.heard = Some(Instant::now());
            s.overtaken += usize::from(s.newest.replace(picture).is_some());
        });
    }

    /// Waits until `ready` gives something, or the time is over.
    pub fn wait<T>(
        &self,
        limit: Option<Duration>,
        mut ready: impl FnMut(&mut State) -> Option<T>,
    ) -> Option<T> {
        let until = limit.map(|l| Instant::now() + l);
        let mut state = self.lock();
        loop {
            if let Some(out) = ready(&mut state) {
                return Some(out);
            }
            state = match until {
                None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(until) => {
                    let left = until.checked_duration_since(Instant::now())?;
                    self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }
}
