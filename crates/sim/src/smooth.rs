//! A rig with an IMU that is moved frame by frame by the caller: the motion is a spline through what he gives.
//!
//! Readings need the acceleration between the frames, and that depends on where the body goes next. So the poses given are
//! control points of a uniform quintic B-spline (de Boor, "A practical guide to splines", 1978), and each packet comes two
//! frames after its pose was given.

use crate::config::SimConfig;
use crate::imu_feed::{ImuFeed, Readings};
use crate::live::LiveRig;
use crate::walk::{ContinuousTrajectory, ImuSim, Troubled};
use crate::world::{Thing, World};
use cairn_geometry::Se3;
use cairn_sensor::{FramePacket, Rig, SourceError, Stamp};
use std::sync::Arc;

/// Frames by which a packet comes later than its pose was given.
const BEHIND: usize = 2;

/// The rig of a config with its IMU, moved by the caller at the config's frame rate.
pub struct SmoothRig {
    live: LiveRig,
    rig: Rig,
    dt: f64,
    motion: Option<ContinuousTrajectory>,
    imu: Option<ImuFeed>,
    given: usize,
}

impl SmoothRig {
    /// Builds the world of the config.
    ///
    /// # Errors
    /// When the config cannot be simulated.
    pub fn new(config: &SimConfig) -> Result<Self, SourceError> {
        let live = LiveRig::new(config)?;
        let rig = config.rig();
        let imu = rig.imu.as_ref().zip(config.imu).map(|(sensor, imu)| {
            let readings = Readings::Simulated(Box::new(ImuSim::new(imu, config.seed)));
            ImuFeed::new(readings, Troubled::new(config.troubles, config.seed), sensor.rate_hz)
        });
        Ok(Self { live, rig, dt: 1.0 / config.rate_hz, motion: None, imu, given: 0 })
    }

    /// The rig, with its IMU.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The world it is in.
    pub fn world(&self) -> &Arc<World> {
        self.live.world()
    }

    /// As [`LiveRig::put`].
    pub fn put(&mut self, things: Vec<Thing>) {
        self.live.put(things);
    }

    /// Takes the body's next pose, one frame after the one before. Returns the packet of two frames ago with the body's true
    /// pose at its stamp; none for the first two.
    ///
    /// # Errors
    /// When the pose is not finite.
    pub fn packet(&mut self, world_from_body: &Se3) -> Result<Option<(FramePacket, Se3)>, SourceError> {
        if !world_from_body.is_finite() {
            let why = format!("pose {} is not finite", self.given);
            return Err(SourceError::new("the simulated rig", why, "give finite poses"));
        }
        match &mut self.motion {
            None => self.motion = Some(ContinuousTrajectory::sampled(0.0, self.dt, &[*world_from_body])),
            Some(motion) => motion.extend(world_from_body),
        }
        self.given += 1;
        let Some(motion) = self.motion.as_ref().filter(|_| self.given > BEHIND) else { return Ok(None) };
        let nth = self.given - 1 - BEHIND;
        let stamp = Stamp((nth as f64 * self.dt * 1e9).round() as i64);
        let at = stamp.seconds();
        let mut packet = self.live.packet_along(stamp, &|dt| motion.pose(at + dt));
        if let Some(imu) = &mut self.imu {
            packet.imu = imu.until(motion, Stamp(0), stamp);
        }
        Ok(Some((packet, motion.pose(at))))
    }
}
