//! Ctrl-C ends a run as if the source had ended, so that all results are still written; a second one stops at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the user asked the run to end.
#[derive(Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Installs the signal handlers. Where that is impossible, Ctrl-C stops the program at once as usual.
    pub fn listen() -> Self {
        let this = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // In this order, the first signal sets the flag and a second one finds it set and stops.
            let _ = signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, this.0.clone());
            let _ = signal_hook::flag::register(signal, this.0.clone());
        }
        this
    }

    /// True once the user asked the run to end.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
