//! Work divided between the calling thread and a second one, with the result of one thread alone.

use std::ops::Range;

/// Items below which a second thread costs more than it saves.
const WORTHWHILE: usize = 128;

/// Runs both, the second on another thread where `two_threads` allows it, and returns their results.
pub(crate) fn both<A, B: Send>(
    two_threads: bool,
    first: impl FnOnce() -> A,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    if !two_threads {
        return (first(), second());
    }
    std::thread::scope(|s| {
        let second = s.spawn(second);
        let first = first();
        (first, second.join().unwrap_or_else(|cause| std::panic::resume_unwind(cause)))
    })
}

/// What `work` returns for all of `0..n`, in order: for the two halves of the range at the same time where `two_threads`
/// allows it and there is enough to do. `work` must treat each item by itself; then the result is the same either way.
pub(crate) fn in_halves<T: Send>(
    n: usize,
    two_threads: bool,
    work: impl Fn(Range<usize>) -> Vec<T> + Sync,
) -> Vec<T> {
    if !two_threads || n < WORTHWHILE {
        return work(0..n);
    }
    let (mut first, mut second) = both(true, || work(0..n / 2), || work(n / 2..n));
    first.append(&mut second);
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_keep_the_order() {
        for n in [0, 1, WORTHWHILE - 1, WORTHWHILE, WORTHWHILE + 1, 1001] {
            for two_threads in [false, true] {
                let all = in_halves(n, two_threads, |range| range.filter(|i| i % 3 > 0).collect());
                assert_eq!(all, (0..n).filter(|i| i % 3 > 0).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn panic_of_the_second_thread_is_passed_on() {
        let run = || both(true, || 1, || -> u32 { panic!("second") });
        assert!(std::panic::catch_unwind(run).is_err());
        assert_eq!(both(true, || 1, || 2), both(false, || 1, || 2));
    }
}
