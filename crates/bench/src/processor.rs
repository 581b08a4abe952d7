//! CPU time of the calling thread, where the system tells it; `None` elsewhere. Other load on the machine affects it
//! less than wall time.

use std::time::Instant;

/// CPU time of the calling thread so far, milliseconds.
#[cfg(unix)]
pub fn thread_cpu_ms() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Some(time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6)
}

/// CPU time of the calling thread so far, milliseconds.
#[cfg(not(unix))]
pub fn thread_cpu_ms() -> Option<f64> {
    None
}

/// Processor time of this thread in milliseconds; wall time where the system does not tell it.
pub fn now_ms() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    thread_cpu_ms().unwrap_or_else(|| START.elapsed().as_secs_f64() * 1e3)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time() {
        let before = thread_cpu_ms();
        let sum = (0..2_000_000u64).fold(0, |sum: u64, v| std::hint::black_box(sum.wrapping_add(v)));
        assert!(thread_cpu_ms() > before && sum > 0);
    }
}
