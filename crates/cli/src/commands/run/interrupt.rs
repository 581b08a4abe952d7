//! Signals end a run as if the source had ended, so that all results are still written.
//!
//! A second Ctrl-C or termination stops at once. A hang-up does not: a closing terminal may send several.

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
            let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, this.0.clone());
            let _ = signal_hook::flag::register(signal, this.0.clone());
        }
        #[cfg(unix)]
        if !hang_up_is_ignored() {
            let _ = signal_hook::flag::register(signal_hook::consts::SIGHUP, this.0.clone());
        }
        this
    }

    /// True once the user asked the run to end.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Whether the run was started to outlive its terminal, as by nohup. Known on Linux only.
#[cfg(unix)]
fn hang_up_is_ignored() -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return false };
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal_hook::consts::SIGHUP - 1) & 1 == 1
}
