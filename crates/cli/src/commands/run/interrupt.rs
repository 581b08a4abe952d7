//! Ctrl-C ends a run as if the source had ended, so that everything is still written; a second one stops at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the run was asked to end.
#[derive(Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens from now on. Where signals can not be listened to, Ctrl-C stops at once as usual.
    pub fn listen() -> Self {
        let this = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // In this order the first one sets the flag, and the next one finds it set.
            let _ = signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, this.0.clone());
            let _ = signal_hook::flag::register(signal, this.0.clone());
        }
        this
    }

    /// True once the run was asked to end.
    pub fn asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
