//! Work that can wait gives way to work that can not.

/// The thread that calls this gives way to others where there are fewer cores than work: what adjusts a whole world takes
/// what tracking and mapping leave. On systems other than Linux nothing happens.
pub fn background() {
    #[cfg(target_os = "linux")]
    {
        // Linux knows priorities of single threads. Where it refuses, the thread goes on as it was.
        let _ = rustix::process::setpriority_process(Some(rustix::thread::gettid()), BACKGROUND);
    }
}

/// Of 19: the share of a core that is wanted by others is a thirtieth.
#[cfg(target_os = "linux")]
const BACKGROUND: i32 = 15;

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn only_the_thread_that_asks_gives_way() {
        let own = || rustix::process::getpriority_process(Some(rustix::thread::gettid())).unwrap();
        let before = own();
        let beside = std::thread::spawn(move || {
            background();
            own()
        });
        assert_eq!(beside.join().unwrap(), BACKGROUND);
        assert_eq!(own(), before);
    }
}
