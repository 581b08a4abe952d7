//! A limit of what is sent in a second: a token bucket that holds what a second gives, and a queue of blocks for each robot, which
//! take turns.

use cairn_team::peer::{Outgoing, To};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Bytes that wait for one robot, at most; what is beyond is dropped, as by a bad network, and asked for again.
const MAX_WAITING: usize = 2 << 20;

/// Blocks that wait, and how much may be sent now.
#[derive(Debug)]
pub(crate) struct SendLimit {
    bytes_per_s: f64,
    /// Below zero after a message that was longer than what there was.
    allowance: f64,
    at: Instant,
    /// For each robot what waits for it, the one whose turn it is first.
    waiting: VecDeque<(To, VecDeque<Outgoing>)>,
}

impl SendLimit {
    pub fn new(bytes_per_s: f64, now: Instant) -> Self {
        Self { bytes_per_s, allowance: bytes_per_s, at: now, waiting: VecDeque::new() }
    }

    /// Puts a message into the queue of the robot that it is for, unless it is in it already.
    pub fn wait(&mut self, message: Outgoing) {
        let Some((_, queue)) = self.waiting.iter_mut().find(|(to, _)| *to == message.to) else {
            return self.waiting.push_back((message.to, VecDeque::from([message])));
        };
        let bytes: usize = queue.iter().map(|m| m.bytes.len()).sum();
        if bytes + message.bytes.len() <= MAX_WAITING && queue.iter().all(|m| m.bytes != message.bytes) {
            queue.push_back(message);
        }
    }

    /// The next message, if there is one and the time for it has come.
    pub fn take(&mut self, now: Instant) -> Option<Outgoing> {
        let seconds = now.saturating_duration_since(self.at).as_secs_f64();
        self.at = now;
        self.allowance = (self.allowance + seconds * self.bytes_per_s).min(self.bytes_per_s);
        if self.allowance < 0.0 {
            return None;
        }
        let (to, mut queue) = self.waiting.pop_front()?;
        let message = queue.pop_front();
        if !queue.is_empty() {
            self.waiting.push_back((to, queue));
        }
        message
    }

    /// When the next message may go, if one waits.
    pub fn next_at(&self, now: Instant) -> Option<Instant> {
        let wait = || Duration::try_from_secs_f64((-self.allowance / self.bytes_per_s).max(0.0)).ok();
        (!self.waiting.is_empty()).then(|| Some(now + wait()? + Duration::from_millis(1))).flatten()
    }

    /// Counts what was sent, blocks or not.
    pub fn sent(&mut self, bytes: usize) {
        self.allowance -= bytes as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_team::peer::PeerKind;
    use std::sync::Arc;

    fn block(to: u16, content: u8) -> Outgoing {
        Outgoing { to: To::Robot(to), kind: PeerKind::Block, bytes: Arc::new(vec![content; 10_000]) }
    }

    /// Two robots want 40 blocks of 10 kB each, of which some are asked for twice; 50 kB/s are allowed.
    #[test]
    fn blocks_take_turns_and_no_more_goes_than_is_allowed() {
        let start = Instant::now();
        let mut limit = SendLimit::new(50_000.0, start);
        for content in 0..40 {
            for to in [1, 2, 1] {
                limit.wait(block(to, content));
            }
        }
        let mut sent: Vec<(f64, To)> = Vec::new();
        let mut now = start;
        while let Some(next) = limit.next_at(now) {
            now = next;
            while let Some(message) = limit.take(now) {
                limit.sent(message.bytes.len());
                sent.push(((now - start).as_secs_f64(), message.to));
            }
        }
        assert_eq!(sent.len(), 80);
        assert!(sent.windows(2).take(70).all(|pair| pair[0].1 != pair[1].1), "each has its turn");
        // At any time no more than what a second gives at once, one message more, and what the time gave.
        for (k, (seconds, _)) in sent.iter().enumerate() {
            let bytes = 10_000.0 * (k + 1) as f64;
            assert!(bytes <= 50_000.0 * (1.0 + seconds) + 10_000.0, "{bytes} after {seconds} s");
        }
        let last = sent[79].0;
        assert!((14.0..16.0).contains(&last), "800 kB at 50 kB/s, 50 of them at once: {last} s");
        assert!(limit.next_at(now).is_none());
    }

    /// Words and versions go at once, and what they take is not there for blocks.
    #[test]
    fn what_goes_at_once_counts_as_well() {
        let start = Instant::now();
        let mut limit = SendLimit::new(50_000.0, start);
        limit.sent(150_000);
        limit.wait(block(1, 0));
        assert!(limit.take(start + Duration::from_millis(1_900)).is_none());
        assert!(limit.take(start + Duration::from_millis(2_100)).is_some());
    }
}
