//! Whether the threads that serve pages still take turns: a count that goes up ten times a second on one of them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::runtime::Handle;

/// Interval of the turns.
const EVERY: Duration = Duration::from_millis(100);

/// The count.
#[derive(Clone, Default)]
pub(crate) struct Pulse(Arc<AtomicU64>);

impl Pulse {
    /// Begins to count on the threads of a runtime, until that ends.
    pub fn beat_on(&self, runtime: &Handle) {
        let count = self.0.clone();
        runtime.spawn(async move {
            loop {
                count.fetch_add(1, Ordering::Relaxed);
                tokio::time::sleep(EVERY).await;
            }
        });
    }

    /// The turns so far.
    pub fn turns(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::time::Instant;

    /// Waits until the count has gone up by three; false after two seconds.
    fn goes_up(pulse: &Pulse) -> bool {
        let (from, began) = (pulse.turns(), Instant::now());
        while pulse.turns() < from + 3 {
            if began.elapsed() > Duration::from_secs(2) {
                return false;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        true
    }

    #[test]
    fn no_turn_is_taken_while_every_thread_hangs() {
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        let pulse = Pulse::default();
        pulse.beat_on(runtime.handle());
        assert!(goes_up(&pulse));
        // Two pages wait for what somebody holds, as they would for a surface that is never let go.
        let held = Arc::new(Mutex::new(()));
        let holding = held.lock().unwrap();
        for _ in 0..2 {
            let held = held.clone();
            runtime.spawn(async move { drop(held.lock()) });
        }
        std::thread::sleep(Duration::from_millis(300));
        assert!(!goes_up(&pulse), "both threads hang");
        drop(holding);
        assert!(goes_up(&pulse), "and go on");
    }
}
