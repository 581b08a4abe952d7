//! What the machine gives to code that takes nothing of it by itself: a clock, and threads for work beside.
//!
//! The same engine runs in a terminal, on a page (WebAssembly has neither thread nor clock of the standard library) and in a
//! simulator on virtual time; which of these it is, only the program around it knows. Everything from here up to the engine
//! reads time from a [`Clock`] and begins threads by a [`Spawn`]; the programs give those of the standard library.

use std::fmt;
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// Time that passes; only differences of readings mean anything.
#[derive(Clone)]
pub struct Clock(Arc<dyn Fn() -> Duration + Send + Sync>);

impl Clock {
    /// A clock that reads what this function returns, which never goes back.
    pub fn new(now: impl Fn() -> Duration + Send + Sync + 'static) -> Self {
        Self(Arc::new(now))
    }

    /// A clock that stands still: nothing is measured, every duration is zero.
    pub fn still() -> Self {
        Self::new(Duration::default)
    }

    /// Its reading.
    pub fn now(&self) -> Duration {
        (self.0)()
    }

    /// Milliseconds since an earlier reading.
    pub fn ms_since(&self, earlier: Duration) -> f64 {
        self.now().saturating_sub(earlier).as_secs_f64() * 1e3
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "Clock({:?})", self.now())
    }
}

/// Work that runs beside its caller.
pub struct Work {
    /// The name of its thread.
    pub name: &'static str,
    /// Whether it takes only what others leave of the processor.
    pub background: bool,
    /// What it does.
    pub run: Box<dyn FnOnce() + Send>,
}

impl Work {
    /// Work of the usual priority.
    pub fn new(name: &'static str, run: impl FnOnce() + Send + 'static) -> Self {
        Self { name, background: false, run: Box::new(run) }
    }

    /// The same work, in the background.
    pub fn in_background(self) -> Self {
        Self { background: true, ..self }
    }
}

/// Work that goes on; dropped, it goes on by itself.
pub struct Task(Box<dyn FnOnce() + Send>);

impl Task {
    /// Work whose end this function waits for.
    pub fn new(join: impl FnOnce() + Send + 'static) -> Self {
        Self(Box::new(join))
    }

    /// Waits until it has ended, in whatever way.
    pub fn join(self) {
        (self.0)();
    }
}

impl fmt::Debug for Task {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("Task")
    }
}

/// Begins work beside the caller.
pub trait Spawn: Send + Sync {
    /// Begins it.
    ///
    /// # Errors
    /// When there is no thread for it; then nothing of it is done.
    fn spawn(&self, work: Work) -> io::Result<Task>;
}

/// A machine without threads.
struct NoThreads;

impl Spawn for NoThreads {
    fn spawn(&self, work: Work) -> io::Result<Task> {
        Err(io::Error::new(io::ErrorKind::Unsupported, format!("there is no thread for {}", work.name)))
    }
}

/// A clock and threads.
#[derive(Clone)]
pub struct Host {
    /// The clock by which work is timed.
    pub clock: Clock,
    /// Begins threads.
    pub threads: Arc<dyn Spawn>,
}

impl Host {
    /// A clock that stands still and no threads: for one thing after the other, where nobody reads how long it took.
    pub fn bare() -> Self {
        Self { clock: Clock::still(), threads: Arc::new(NoThreads) }
    }

    /// The same threads with another clock.
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { clock, ..self }
    }
}

impl fmt::Debug for Host {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Host").field("clock", &self.clock).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn clock_tells_what_it_is_given() {
        let ms = Arc::new(AtomicU64::new(5));
        let virtual_ms = ms.clone();
        let clock = Clock::new(move || Duration::from_millis(virtual_ms.load(Ordering::Relaxed)));
        let begin = clock.now();
        ms.store(12, Ordering::Relaxed);
        assert_eq!(clock.ms_since(begin), 7.0);
        ms.store(1, Ordering::Relaxed);
        assert_eq!(clock.ms_since(begin), 0.0, "a clock that went back");
        assert_eq!(Clock::still().ms_since(Duration::ZERO), 0.0);
    }

    #[test]
    fn bare_host_refuses_work_and_names_it() {
        let refused = Host::bare().threads.spawn(Work::new("cairn-mapping", || panic!("it ran")));
        assert!(refused.unwrap_err().to_string().contains("cairn-mapping"));
    }
}
