//! Frames on their way to SLAM in another process: one in hand at most, the readings of the others kept for the next.

use crate::message::{Frame, Tracked};
use crate::pixels;
use crate::ring::Ring;
use cairn_sensor::{FramePacket, ImuSample};
use cairn_session::NotTracked;

/// Readings that are kept for the next frame at most: some seconds of them.
const MOST_READINGS: usize = 4000;

/// The frame that SLAM has, and its answer.
pub(super) struct Frames {
    ring: Ring,
    /// The number of the next frame.
    pub(super) next: u64,
    /// The frame that SLAM has not answered.
    in_hand: Option<u64>,
    /// The answer to it.
    answer: Option<Box<Tracked>>,
    /// Readings of packets that were not given to it.
    readings: Vec<ImuSample>,
}

impl Frames {
    /// None yet; their images go through this ring.
    pub(super) fn new(ring: Ring) -> Self {
        Self { ring, next: 0, in_hand: None, answer: None, readings: Vec::new() }
    }

    /// Whether SLAM has one that it has not answered.
    pub(super) fn in_hand(&self) -> bool {
        self.in_hand.is_some()
    }

    /// Keeps the readings of a packet that is not given to SLAM.
    pub(super) fn keep_readings(&mut self, packet: &FramePacket) {
        self.readings.extend(packet.imu.iter().cloned());
        let excess = self.readings.len().saturating_sub(MOST_READINGS);
        self.readings.drain(..excess);
    }

    /// Writes the images of a packet into the ring; the frame is then to be given to SLAM.
    ///
    /// # Errors
    /// When they do not fit.
    pub(super) fn give(&mut self, packet: &FramePacket) -> Result<Frame, NotTracked> {
        let number = self.next;
        self.next += 1;
        let written = pixels::pieces(packet, |pieces| self.ring.write(number, pieces));
        written.map_err(|e| NotTracked::Refused(e.to_string()))?;
        let mut imu = std::mem::take(&mut self.readings);
        imu.extend(packet.imu.iter().cloned());
        (self.in_hand, self.answer) = (Some(number), None);
        Ok(Frame::of(number, &FramePacket { images: Vec::new(), depth: None, imu, ..packet.clone() }))
    }

    /// SLAM has answered; whether it was the frame in hand.
    pub(super) fn answered(&mut self, tracked: Box<Tracked>) -> bool {
        let is_in_hand = self.in_hand == Some(tracked.number);
        if is_in_hand {
            (self.in_hand, self.answer) = (None, Some(tracked));
        }
        is_in_hand
    }

    /// The answer, once.
    pub(super) fn take_answer(&mut self) -> Option<Box<Tracked>> {
        self.answer.take()
    }

    /// SLAM has died: a process that begins anew has no use for readings from before.
    pub(super) fn died(&mut self) {
        (self.in_hand, self.answer) = (None, None);
        self.readings.clear();
    }
}
