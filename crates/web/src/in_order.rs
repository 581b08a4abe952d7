//! Messages that come over several connections at once: each is taken once, and in order.

use std::collections::BTreeMap;

/// Messages that may wait for an earlier one.
const MOST: usize = 256;

/// What is taken next, and what waits for it.
#[derive(Debug)]
pub struct InOrder<T> {
    next: u64,
    early: BTreeMap<u64, T>,
}

impl<T> Default for InOrder<T> {
    fn default() -> Self {
        Self { next: 0, early: BTreeMap::new() }
    }
}

impl<T> InOrder<T> {
    /// The messages that can be taken now that this one came: none where it came before on another connection, or too early.
    pub fn take(&mut self, number: u64, message: T) -> Vec<T> {
        // What is not kept comes again on the first connection, which carries all of them.
        if number >= self.next && self.early.len() < MOST || number == self.next {
            self.early.insert(number, message);
        }
        let mut due = Vec::new();
        while let Some(message) = self.early.remove(&self.next) {
            due.push(message);
            self.next += 1;
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_two_connections_are_taken_once_and_in_order() {
        let mut order = InOrder::default();
        assert_eq!(order.take(0, "a"), ["a"]);
        assert_eq!(order.take(2, "c"), [""; 0], "the one before has not come");
        assert_eq!(order.take(0, "a"), [""; 0], "it came before");
        assert_eq!(order.take(1, "b"), ["b", "c"]);
        assert_eq!(order.take(2, "c"), [""; 0]);
        // Whoever floods it is not kept; the message that is due is taken all the same.
        for n in 4..5000 {
            assert!(order.take(n, "x").is_empty());
        }
        assert_eq!(order.take(3, "d").len(), 1 + MOST);
        assert_eq!(order.next, 4 + MOST as u64);
    }
}
