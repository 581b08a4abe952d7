//! The clock and the threads of the standard library: what programs on a usual machine give to all that is below them.

use cairn_sensor::{Clock, Host, Spawn, Task, Work};
use std::io;
use std::sync::Arc;
use std::time::Instant;

/// This machine.
pub fn std_host() -> Host {
    let began = Instant::now();
    Host { clock: Clock::new(move || began.elapsed()), threads: Arc::new(StdThreads) }
}

/// Threads of the system.
struct StdThreads;

impl Spawn for StdThreads {
    fn spawn(&self, work: Work) -> io::Result<Task> {
        let Work { name, background: is_background, run } = work;
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
            if is_background {
                background();
            }
            run();
        })?;
        // A thread that panicked has ended, too.
        Ok(Task::new(move || drop(thread.join())))
    }
}

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
    use std::sync::mpsc::channel;

    #[test]
    fn priority_is_per_thread() {
        let own = || rustix::process::getpriority_process(Some(rustix::thread::gettid())).unwrap();
        let before = own();
        let threads = std_host().threads;
        let (tell, told) = channel();
        let waits = Work::new("waits", {
            let tell = tell.clone();
            move || tell.send(own()).unwrap()
        });
        threads.spawn(waits.in_background()).unwrap().join();
        assert_eq!(told.recv().unwrap(), BACKGROUND);
        threads.spawn(Work::new("due", move || tell.send(own()).unwrap())).unwrap().join();
        assert_eq!((told.recv().unwrap(), own()), (before, before));
    }

    #[test]
    fn clock_of_the_machine_goes_forward() {
        let clock = std_host().clock;
        let begin = clock.now();
        std::thread::sleep(std::time::Duration::from_millis(5));
        assert!(clock.ms_since(begin) >= 5.0);
    }
}
