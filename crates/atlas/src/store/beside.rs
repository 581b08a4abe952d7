//! Work beside the caller while a map is read: on threads that end with it, or one after the other where there are none (a page).

/// Whether this program has threads.
pub const HAS_THREADS: bool = !cfg!(target_family = "wasm");

/// The number of this process, for names that no other one takes; a page has one process.
pub fn process_id() -> u32 {
    if cfg!(target_family = "wasm") { 0 } else { std::process::id() }
}

/// Does both, the second on a thread of its own; its result is `None` where it panicked.
pub(super) fn both<A, B: Send>(here: impl FnOnce() -> A, there: impl FnOnce() -> B + Send) -> (A, Option<B>) {
    if !HAS_THREADS {
        let there = there();
        return (here(), Some(there));
    }
    std::thread::scope(|scope| {
        let there = scope.spawn(there);
        (here(), there.join().ok())
    })
}
