//! A flag that ends waiting: for a stream that does not come, a disk that does not answer, the time of the next packet.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Shared between whoever asks for an end and whoever waits. The default never ends anything by itself.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks every wait to end.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether an end was asked for.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The flag itself, for a signal handler or a solver.
    pub fn flag(&self) -> &Arc<AtomicBool> {
        &self.0
    }
}
