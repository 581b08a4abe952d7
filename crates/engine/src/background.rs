//! Low priority for work that can wait.

/// Lowers the priority of the calling thread: adjustments of whole maps use only what tracking and mapping
/// leave of the cores. No effect on systems other than Linux.
pub fn background() {
    #[cfg(target_os = "linux")]
    {
        // Linux has per-thread priorities. Where it refuses, the thread goes on with the one it has.
        let _ = rustix::process::setpriority_process(Some(rustix::thread::gettid()), BACKGROUND);
    }
}

/// Nice value, of 19: the share of a contended core is about a thirtieth.
#[cfg(target_os = "linux")]
const BACKGROUND: i32 = 15;

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn priority_is_per_thread() {
        let own = || rustix::process::getpriority_process(Some(rustix::thread::gettid())).unwrap();
        let before = own();
        let other_thread = std::thread::spawn(move || {
            background();
            own()
        });
        assert_eq!(other_thread.join().unwrap(), BACKGROUND);
        assert_eq!(own(), before);
    }
}
