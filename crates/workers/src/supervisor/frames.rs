//! The frames of a run on their way from capture to SLAM: those that capture may write, those that wait, those that were given.

use crate::capture::SLOTS;
use crate::message::{Frame, LeftOut};
use std::collections::VecDeque;

/// Frames that SLAM has in hand at most: few, so that a ping is answered soon.
const IN_HAND: usize = 4;

/// Frames that SLAM has not acknowledged, and what is known of those before.
pub(super) struct Frames {
    /// Oldest first; the first `sent` were given to the process of SLAM.
    pending: VecDeque<Frame>,
    sent: usize,
    /// The number of the next frame of capture.
    pub(super) next: u64,
    /// The stamps of the first and the last that capture delivered.
    pub(super) delivered: Option<(i64, i64)>,
    /// The first number that capture may not write yet.
    pub(super) credit: u64,
    /// No more come from capture.
    pub(super) have_ended: bool,
    /// By this process of capture, and by those before it.
    left_out: [LeftOut; 2],
}

impl Frames {
    pub(super) fn new() -> Self {
        Self {
            pending: VecDeque::new(),
            sent: 0,
            next: 0,
            delivered: None,
            credit: u64::from(SLOTS),
            have_ended: false,
            left_out: [LeftOut::default(), LeftOut::default()],
        }
    }

    /// Capture has delivered a frame.
    pub(super) fn add(&mut self, frame: Frame) {
        let first = self.delivered.map_or(frame.stamp, |(first, _)| first);
        (self.next, self.delivered) = (frame.number + 1, Some((first, frame.stamp)));
        self.pending.push_back(frame);
    }

    /// What this process of capture has left out until now.
    pub(super) fn leaves_out(&mut self, now: LeftOut) {
        self.left_out[0] = now;
    }

    /// Capture has died: the next process begins to count again.
    pub(super) fn capture_died(&mut self) {
        self.left_out[1] = self.left_out();
        self.left_out[0] = LeftOut::default();
    }

    /// What was left out in all.
    pub(super) fn left_out(&self) -> LeftOut {
        self.left_out[1].and(&self.left_out[0])
    }

    /// SLAM has done this frame, and those before it.
    pub(super) fn done(&mut self, number: u64) {
        while self.pending.front().is_some_and(|f| f.number <= number) {
            self.pending.pop_front();
            self.sent = self.sent.saturating_sub(1);
        }
    }

    /// The next frame for SLAM, if it has not enough in hand.
    pub(super) fn take_next(&mut self) -> Option<Frame> {
        let frame = self.pending.get(self.sent).filter(|_| self.sent < IN_HAND)?;
        self.sent += 1;
        Some(frame.clone())
    }

    /// The source is given up: what SLAM has in hand is all that it gets.
    pub(super) fn stop(&mut self) {
        self.have_ended = true;
        self.pending.truncate(self.sent);
    }

    /// Whether SLAM has done all of them, and no more come.
    pub(super) fn are_done(&self) -> bool {
        self.have_ended && self.pending.is_empty()
    }

    /// Whether SLAM has any in hand.
    pub(super) fn in_hand(&self) -> bool {
        self.sent > 0
    }

    /// The number of the oldest that SLAM has not done, or of the next.
    pub(super) fn oldest(&self) -> u64 {
        self.pending.front().map_or(self.next, |f| f.number)
    }

    /// Takes the oldest out: it is given to nobody.
    pub(super) fn leave_out_oldest(&mut self) -> Option<Frame> {
        self.pending.pop_front()
    }

    /// The process of SLAM has died: the next one is given all again.
    pub(super) fn slam_died(&mut self) {
        self.sent = 0;
    }

    /// More credit for capture, if there is: no frame is written over that is not acknowledged.
    pub(super) fn more_credit(&mut self) -> Option<u64> {
        let credit = self.oldest() + u64::from(SLOTS);
        (credit > self.credit).then(|| {
            self.credit = credit;
            credit
        })
    }
}
