//! A slot for the newest image: overtaken images are counted and dropped.

use cairn_sensor::{GrayImage, SourceError, Stamp};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// An image and its time of arrival.
pub(super) struct LiveImage {
    pub stamp: Stamp,
    pub image: GrayImage,
    /// When it would have arrived without delay: its age counts from here.
    pub on_time: Instant,
}

/// What the threads of a stream share.
#[derive(Default)]
pub(super) struct State {
    pub newest: Option<LiveImage>,
    /// Size and rate of the first image.
    pub known: Option<([usize; 2], f64)>,
    /// Why the stream has failed for good.
    pub failed: Option<SourceError>,
    /// The source was dropped: end.
    pub closing: bool,
    /// When the child was started, and when it last delivered an image.
    pub started: Option<Instant>,
    pub last_image: Option<Instant>,
    /// Images overtaken, and images too old when requested.
    pub overtaken: usize,
    pub stale: usize,
    /// A peer that sent no video was refused, which is said once.
    pub refused: bool,
    /// Events of the stream, for people.
    pub lines: Vec<String>,
    /// The least delay from an image's stamp to its arrival, seconds: the usual delay, which cannot be told from none.
    pub least_delay_s: f64,
    /// Why the images that are sent cannot be used.
    pub trouble: Option<String>,
}

/// The state with its condition variable.
#[derive(Default)]
pub(super) struct Slot {
    state: Mutex<State>,
    changed: Condvar,
}

impl Slot {
    /// Locks the state; a thread that panicked while holding it does not matter.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state and wakes the waiting threads.
    pub fn change<T>(&self, f: impl FnOnce(&mut State) -> T) -> T {
        let out = f(&mut self.lock());
        self.changed.notify_all();
        out
    }

    /// Stores a new image for the reader.
    pub fn put(&self, image: LiveImage) {
        self.change(|s| {
            s.last_image = Some(Instant::now());
            s.overtaken += usize::from(s.newest.replace(image).is_some());
        });
    }

    /// Waits until `ready` returns something, or the time limit is reached.
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
