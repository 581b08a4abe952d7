//! The IMU readings of a simulated rig, simulated or recorded, merged with the images.

use crate::walk::{ContinuousTrajectory, ImuSim, Troubled};
use cairn_sensor::{ImuSample, Merge, MergeConfig, Stamp, Stream};
use std::vec::IntoIter;

/// The origin of the readings.
pub(crate) enum Readings {
    /// Simulated for the motion.
    Simulated(Box<ImuSim>),
    /// Recorded on the motion.
    Recorded(IntoIter<ImuSample>),
}

/// The readings, their faults, and the merge that all sources use.
pub(crate) struct ImuFeed {
    readings: Readings,
    troubled: Troubled,
    merge: Merge<(), ()>,
}

impl ImuFeed {
    /// `rate_hz` is the rate of the readings after the faults.
    pub fn new(readings: Readings, troubled: Troubled, rate_hz: f64) -> Self {
        let config = MergeConfig {
            imu_period_s: Some(1.0 / rate_hz),
            wait_s: f64::INFINITY,
            ..MergeConfig::default()
        };
        Self { readings, troubled, merge: Merge::new(config) }
    }

    /// The readings that belong to an image at `stamp`; see [`cairn_sensor::FramePacket::imu`].
    pub fn until(&mut self, motion: &ContinuousTrajectory, epoch: Stamp, stamp: Stamp) -> Vec<ImuSample> {
        // Images are strictly increasing in time here, and none is taken back.
        if self.merge.push_image(0, stamp, ()).is_err() {
            return Vec::new();
        }
        while self.merge.lacks() == Some(Stream::Imu) {
            let next = match &mut self.readings {
                Readings::Simulated(sim) => Some(sim.next(motion, epoch)),
                Readings::Recorded(list) => list.next(),
            };
            match next {
                // The merge counts the samples that it drops.
                Some(sample) => drop(self.troubled.pass(sample).map(|s| self.merge.push_imu(s))),
                None => self.merge.end(Stream::Imu),
            }
        }
        self.merge.pop().map(|merged| merged.imu).unwrap_or_default()
    }
}
