//! Work divided between the calling thread and a second one, with the result of one thread alone.

use std::ops::Range;
use std::sync::mpsc::channel;
use std::sync::{Mutex, PoisonError};

/// Whether this program has threads: on a page there are none.
const HAS_THREADS: bool = !cfg!(target_family = "wasm");
/// Items below which a second thread costs more than it saves.
const WORTHWHILE: usize = 128;

/// Runs both, the second on another thread where `two_threads` allows it, and returns their results.
pub(crate) fn both<A, B: Send>(
    two_threads: bool,
    first: impl FnOnce() -> A,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    if !two_threads || !HAS_THREADS {
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

/// Does each item that `make` hands out, on the calling thread or a second one, whichever is free, each with a scratch of its
/// own. The second begins while `make` is still making items; the calling thread helps when it has made all. `work` must
/// treat each item by itself; then the result is that of one thread, which does each item as soon as it is made.
pub(crate) fn share<T: Send, S: Send>(
    two_threads: bool,
    scratch: &mut [S; 2],
    make: impl FnOnce(&mut dyn FnMut(T)),
    work: impl Fn(T, &mut S) + Sync,
) {
    let [here, there] = scratch;
    if !two_threads || !HAS_THREADS {
        return make(&mut |item| work(item, here));
    }
    let (give, items) = channel();
    // When `give` is dropped, whether all is made or `make` has panicked, both threads run out of items.
    let items = Mutex::new(items);
    let run = |scratch: &mut S| {
        let next = || items.lock().unwrap_or_else(PoisonError::into_inner).recv();
        while let Ok(item) = next() {
            work(item, scratch);
        }
    };
    let first = || {
        // The receiver lives until both threads are done, so that nothing given is lost.
        make(&mut |item| _ = give.send(item));
        drop(give);
        run(here);
    };
    both(true, first, || run(there));
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
    fn shared_items_are_each_done_once() {
        for two_threads in [false, true] {
            let mut done = [0usize; 100];
            let mut counts = [0usize; 2];
            let mut slots = done.iter_mut().enumerate();
            share(
                two_threads,
                &mut counts,
                |give| slots.by_ref().for_each(give),
                |(i, slot), count| {
                    *slot += i;
                    *count += 1;
                },
            );
            assert!(done.iter().enumerate().all(|(i, slot)| *slot == i), "{done:?}");
            assert_eq!(counts[0] + counts[1], 100);
            assert!(two_threads || counts[1] == 0);
        }
    }

    #[test]
    fn panic_while_items_are_made_ends_both_threads() {
        let run = || {
            share(
                true,
                &mut [(), ()],
                |give: &mut dyn FnMut(u32)| {
                    give(1);
                    panic!("made")
                },
                |_, _| (),
            )
        };
        assert!(std::panic::catch_unwind(run).is_err());
    }

    #[test]
    fn panic_of_the_second_thread_is_passed_on() {
        let run = || both(true, || 1, || -> u32 { panic!("second") });
        assert!(std::panic::catch_unwind(run).is_err());
        assert_eq!(both(true, || 1, || 2), both(false, || 1, || 2));
    }
}
