//! A simulated recording as a [`Source`]: a rig carried along a motion, with exact truth.

use crate::live::LiveRig;
use crate::setting::{Route, SimSetting};
use crate::walk::{ImuSim, Motion, read_tum};
use crate::world::{Way, World};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{FramePacket, Rig, Source, SourceError, SourceInfo, Stamp};
use std::sync::Arc;

/// Packets of a rig that goes through a world.
pub struct SimSource {
    live: LiveRig,
    rig: Rig,
    info: SourceInfo,
    motion: Motion,
    imu: Option<ImuSim>,
    epoch: Stamp,
    next: usize,
}

/// The stamp at which walks begin; recorded trajectories keep their own.
const EPOCH: Stamp = Stamp(1_000_000_000);

/// More than a day at 100 Hz.
const MOST_FRAMES: f64 = 1e7;

impl SimSource {
    /// Builds the world and the motion.
    ///
    /// # Errors
    /// When the setting can not be simulated, the way is not known, or the trajectory can not be read.
    pub fn new(setting: &SimSetting) -> Result<Self, SourceError> {
        Self::on(setting, LiveRig::new(setting)?)
    }

    /// In a world that stands already (worlds take long to build).
    ///
    /// # Errors
    /// As [`SimSource::new`].
    pub fn in_world(setting: &SimSetting, world: Arc<World>) -> Result<Self, SourceError> {
        Self::on(setting, LiveRig::in_world(setting, world)?)
    }

    /// From `sim:WORLD?key=value`; see [`SimSetting::parse`].
    ///
    /// # Errors
    /// As [`SimSource::new`] and [`SimSetting::parse`].
    pub fn open(text: &str) -> Result<Self, SourceError> {
        Self::new(&SimSetting::parse(text)?)
    }

    fn on(setting: &SimSetting, live: LiveRig) -> Result<Self, SourceError> {
        let name = format!("sim:{} seed {}", setting.world, setting.seed);
        let (motion, epoch) = motion(setting, live.world())?;
        let start = setting.start_s;
        let length = (motion.end() - start).min(setting.duration_s.unwrap_or(f64::MAX));
        if length < 0.0 {
            let why = format!("start {start} s is past the end of the motion at {:.1} s", motion.end());
            return Err(SourceError::new(name, why, "choose an earlier start"));
        }
        if length * setting.rate_hz > MOST_FRAMES {
            let why = format!("{length:.0} s at {} Hz are more than {MOST_FRAMES} frames", setting.rate_hz);
            return Err(SourceError::new(name, why, "give a duration"));
        }
        let frames = (length * setting.rate_hz + 1e-6).floor() as usize + 1;
        // Shifted so that the first frame is the motion's time `start`.
        let epoch = Stamp(epoch.0 + (start * 1e9).round() as i64);
        let motion = motion.shifted(-start);
        let truth = (0..frames)
            .map(|i| {
                let t = time(i, setting.rate_hz);
                (Stamp(epoch.0 + t), motion.pose(t as f64 * 1e-9))
            })
            .collect();
        let info = SourceInfo { name, frames: Some(frames), rate_hz: setting.rate_hz, truth };
        let imu = setting.imu.map(|s| ImuSim::new(s, setting.seed));
        Ok(Self { live, rig: setting.rig(), info, motion, imu, epoch, next: 0 })
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        self.live.world()
    }

    /// The motion of the body; its time 0 is the first frame.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }
}

/// Nanoseconds of a frame after the first.
fn time(i: usize, rate_hz: f64) -> i64 {
    (i as f64 * 1e9 / rate_hz).round() as i64
}

/// The motion that a setting asks for and the stamp of its time 0.
fn motion(setting: &SimSetting, world: &World) -> Result<(Motion, Stamp), SourceError> {
    let what = format!("sim:{}", setting.world);
    match &setting.route {
        Route::Way(name) => {
            let way = match name {
                Some(n) => world.way(n),
                None => world.ways().first(),
            };
            let way = way.ok_or_else(|| {
                let known: Vec<&str> = world.ways().iter().map(|w| w.name.as_str()).collect();
                let why = format!("there is no way \"{}\"", name.as_deref().unwrap_or(""));
                SourceError::new(&what, why, format!("choose one of {}", known.join(", ")))
            })?;
            Ok((setting.walker.motion(&way.points), EPOCH))
        }
        Route::Points(points) => {
            if points.is_empty() || !points.iter().all(|p| p.x.abs() < 1e5 && p.y.abs() < 1e5) {
                return Err(SourceError::new(
                    what,
                    "the way has no points or one that is not within 100 km",
                    "give corners in metres",
                ));
            }
            Ok((setting.walker.motion(points), EPOCH))
        }
        Route::Poses(poses) => Ok((Motion::through(poses)?, poses.first().map_or(EPOCH, |p| p.0))),
        Route::File(path) => {
            let mut poses = read_tum(path)?;
            let n = poses.len() as f64;
            let middle = poses.iter().map(|p| p.1.translation).sum::<Vec3>() / n;
            let place = middle_of(world.ways().first());
            for (_, pose) in &mut poses {
                *pose = Se3::new(pose.rotation, pose.translation - middle + place);
            }
            Ok((Motion::through(&poses)?, poses.first().map_or(EPOCH, |p| p.0)))
        }
    }
}

/// The middle of a way's extent, at 1.4 m.
fn middle_of(way: Option<&Way>) -> Vec3 {
    let Some(way) = way else { return Vec3::new(0.0, 0.0, 1.4) };
    let fold = |f: &dyn Fn(&cairn_geometry::Vec2) -> f64| {
        let low = way.points.iter().map(f).fold(f64::MAX, f64::min);
        let high = way.points.iter().map(f).fold(f64::MIN, f64::max);
        0.5 * (low + high)
    };
    Vec3::new(fold(&|p| p.x), fold(&|p| p.y), 1.4)
}

impl Source for SimSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some((stamp, _)) = self.info.truth.get(self.next) else { return Ok(None) };
        let (stamp, nanos) = (*stamp, time(self.next, self.info.rate_hz));
        let seconds = nanos as f64 * 1e-9;
        self.next += 1;
        let motion = &self.motion;
        let mut packet = self.live.packet_along(stamp, &|dt| motion.pose(seconds + dt));
        if let Some(imu) = &mut self.imu {
            packet.imu = imu.until(motion, self.epoch, nanos);
        }
        Ok(Some(packet))
    }

    fn skipped(&self) -> &[String] {
        &[]
    }
}
