//! What the inertial sensor of a simulated rig gives, simulated or recorded, put in order with the images.

use crate::walk::{ImuSim, Motion, Troubled};
use cairn_sensor::{ImuSample, Merge, MergeConfig, Stamp, Stream};
use std::vec::IntoIter;

/// Where readings come from.
pub(crate) enum Readings {
    /// Made for the motion.
    Simulated(Box<ImuSim>),
    /// Taken on the motion.
    Recorded(IntoIter<ImuSample>),
}

/// The readings, their troubles, and the merge that all sources use.
pub(crate) struct ImuFeed {
    readings: Readings,
    troubled: Troubled,
    merge: Merge<(), ()>,
}

impl ImuFeed {
    /// `rate_hz` is that of the readings as they are given.
    pub fn new(readings: Readings, troubled: Troubled, rate_hz: f64) -> Self {
        let config = MergeConfig {
            imu_period_s: Some(1.0 / rate_hz),
            wait_s: f64::INFINITY,
            ..MergeConfig::default()
        };
        Self { readings, troubled, merge: Merge::new(config) }
    }

    /// The readings that belong to an image at `stamp`; see [`cairn_sensor::FramePacket::imu`].
    pub fn until(&mut self, motion: &Motion, epoch: Stamp, stamp: Stamp) -> Vec<ImuSample> {
        // Images rise strictly in time here, and none is taken back.
        if self.merge.push_image(0, stamp, ()).is_err() {
            return Vec::new();
        }
        while self.merge.lacks() == Some(Stream::Imu) {
            let next = match &mut self.readings {
                Readings::Simulated(sim) => Some(sim.next(motion, epoch)),
                Readings::Recorded(list) => list.next(),
            };
            match next {
                // What the merge drops it counts.
                Some(sample) => drop(self.troubled.pass(sample).map(|s| self.merge.push_imu(s))),
                None => self.merge.end(Stream::Imu),
            }
        }
        self.merge.pop().map(|merged| merged.imu).unwrap_or_default()
    }
}
