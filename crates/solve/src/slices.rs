//! Long work in slices: an `async` function that gives way at its pauses, so that whoever drives it can do something more urgent in
//! between. There is no executor, no waker and no thread: who polls such a future does its next slice.

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// The end of a slice: work goes on here when it is polled next.
pub async fn pause() {
    let mut is_paused = false;
    std::future::poll_fn(|_| match std::mem::replace(&mut is_paused, true) {
        true => Poll::Ready(()),
        false => Poll::Pending,
    })
    .await;
}

/// Does all slices of some work, one after the other.
pub fn to_end<T>(work: impl Future<Output = T>) -> T {
    let (mut work, mut context) = (pin!(work), Context::from_waker(Waker::noop()));
    loop {
        if let Poll::Ready(result) = work.as_mut().poll(&mut context) {
            return result;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn sum(of: &[u32]) -> u32 {
        let mut sum = 0;
        for n in of {
            sum += n;
            pause().await;
        }
        sum
    }

    #[test]
    fn each_poll_does_one_slice() {
        let (mut work, mut context) = (Box::pin(sum(&[1, 2, 3])), Context::from_waker(Waker::noop()));
        for _ in 0..3 {
            assert_eq!(work.as_mut().poll(&mut context), Poll::Pending);
        }
        assert_eq!(work.as_mut().poll(&mut context), Poll::Ready(6));
    }

    #[test]
    fn to_end_does_all_slices() {
        assert_eq!(to_end(sum(&[4, 5])), 9);
        assert_eq!(to_end(sum(&[])), 0);
    }
}
