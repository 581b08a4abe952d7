//! What is in the walker's way: from live depth and the route to a reason to stop, and to a way past it.
//!
//! In: depth images with odometry, and the guide's plan. Out: for each step of the guide whether the walker must stop, or
//! which heading leads past an obstacle. All in the odometry frame: no correction of the map moves an obstacle.
//!
//! Two strips are watched. One follows the route from where the walker is, as far as he walks until he has heard "stop"
//! and stands: what is there was put there after the route was recorded. The other goes straight ahead, for the second
//! that is left to warn of what he is about to walk into, wherever he was led. The guide is told what is free in every heading,
//! so that it sends nobody where he could not be stopped in time. What leads past an obstacle is found in `past.rs`.

mod attempts;
mod pace;
mod past;
mod stepping;
mod strip;
#[cfg(test)]
mod tests;
mod turns;
mod watch;

use cairn_dense::DenseError;
use cairn_dense::walk::{LocalConfig, LocalSpace};
use cairn_geometry::Se3;
use cairn_guide::{Ground, Guide, Heading, StopReason};
use cairn_sensor::{FramePacket, Rig, Stamp};
use std::time::Instant;
use strip::level;
pub(crate) use watch::Found;
use watch::{ObstacleScan, Watch};

/// A sensor that gave no usable depth for this long is blind, seconds.
const BLIND_S: f64 = 1.0;
/// Looks farther apart than this count as this, seconds.
const LONGEST_STEP_S: f64 = 0.5;

/// Seconds since the last look, which is now.
fn seconds_since(last: &mut Option<Stamp>, now: Stamp) -> f64 {
    last.replace(now).map_or(0.0, |last| (now - last).clamp(0.0, LONGEST_STEP_S))
}

/// Watches for obstacles on the way of one walker.
pub(crate) struct ObstacleMonitor {
    space: LocalSpace,
    camera_from_depth: Se3,
    segment: Option<u32>,
    /// The last usable depth, and the first image since guidance began.
    seen: Option<Stamp>,
    began: Option<Stamp>,
    watch: Watch,
    /// Milliseconds that the last image and the steps since took: for reports only, nothing is decided by it.
    pub cost_ms: f64,
}

impl ObstacleMonitor {
    /// For a rig with depth; `None` without a depth sensor.
    ///
    /// # Errors
    /// An invalid depth camera.
    pub fn new(rig: &Rig, body_from_camera: &Se3) -> Result<Option<Self>, DenseError> {
        let Some(sensor) = &rig.depth else { return Ok(None) };
        let space = LocalSpace::new(LocalConfig::default(), sensor.camera, sensor.metres_per_unit)?;
        Ok(Some(Self {
            space,
            camera_from_depth: body_from_camera.inverse() * sensor.body_from_depth,
            segment: None,
            seen: None,
            began: None,
            watch: Watch::new(),
            cost_ms: 0.0,
        }))
    }

    /// Forgets what was seen: guidance has ended.
    pub fn reset(&mut self) {
        if self.began.is_some() {
            self.space.clear();
            (self.segment, self.seen, self.began, self.watch) = (None, None, None, Watch::new());
        }
    }

    /// Adds the depth of a packet, seen from a pose of the camera in the odometry frame, in metres; `segment` names that
    /// frame, `ground` its ground plane.
    pub fn observe(&mut self, packet: &FramePacket, odom_from_camera: &Se3, segment: u32, ground: &Ground) {
        let begin = Instant::now();
        self.began.get_or_insert(packet.stamp);
        if self.segment.replace(segment).is_some_and(|before| before != segment) {
            self.space.clear();
            self.watch.begin_segment();
        }
        if let Some(depth) = &packet.depth {
            let pose = *odom_from_camera * self.camera_from_depth;
            if self.space.observe(depth, &pose, &level(ground)).is_ok() {
                self.seen = Some(packet.stamp);
            }
        }
        self.cost_ms = begin.elapsed().as_secs_f64() * 1e3;
    }

    /// Looks at the way of a walker who goes where his camera looks, before a step of his guide.
    pub fn look(&mut self, guide: &Guide, walker: &Heading, now: Stamp) -> Found {
        let begin = Instant::now();
        let last = self.seen.max(self.began);
        let found = if last.is_some_and(|last| now - last > BLIND_S) {
            self.watch.walked(guide, walker, now);
            Found { stop: Some(StopReason::UnknownGround), ..Found::default() }
        } else {
            let space = &self.space;
            let config = space.config();
            let sight = ObstacleScan {
                obstacles: space.obstacles(),
                reach_m: config.reach_m,
                chest_m: config.chest_m,
                drop_along: &|line, half_m, length_m| space.drop_along(line, half_m, length_m),
            };
            self.watch.look(guide, walker, sight, now)
        };
        self.cost_ms += begin.elapsed().as_secs_f64() * 1e3;
        found
    }
}
