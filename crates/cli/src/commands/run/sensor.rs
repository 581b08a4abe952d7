//! The sensors of a rig that a run uses.

use cairn_engine::SensorMode;
use cairn_sensor::Rig;

/// Which of a rig's sensors are used.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sensor {
    /// The first camera; the scale stays unknown.
    Mono,
    /// The first two cameras.
    Stereo,
    /// The first camera and the depth sensor.
    Rgbd,
    /// The first camera and the inertial sensor, which tells scale and gravity.
    MonoImu,
    /// The first two cameras and the inertial sensor.
    StereoImu,
    /// The first camera, the depth sensor and the inertial sensor.
    RgbdImu,
}

impl Sensor {
    /// Its eyes.
    pub fn mode(self) -> SensorMode {
        match self {
            Self::Mono | Self::MonoImu => SensorMode::Mono,
            Self::Stereo | Self::StereoImu => SensorMode::Stereo,
            Self::Rgbd | Self::RgbdImu => SensorMode::Rgbd,
        }
    }

    /// Whether the inertial sensor is used.
    pub fn has_imu(self) -> bool {
        matches!(self, Self::MonoImu | Self::StereoImu | Self::RgbdImu)
    }

    /// The eyes of a mode, with the inertial sensor or without.
    pub fn with(mode: SensorMode, has_imu: bool) -> Self {
        match (mode, has_imu) {
            (SensorMode::Mono, false) => Self::Mono,
            (SensorMode::Stereo, false) => Self::Stereo,
            (SensorMode::Rgbd, false) => Self::Rgbd,
            (SensorMode::Mono, true) => Self::MonoImu,
            (SensorMode::Stereo, true) => Self::StereoImu,
            (SensorMode::Rgbd, true) => Self::RgbdImu,
        }
    }

    /// As the command line names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono => "mono",
            Self::Stereo => "stereo",
            Self::Rgbd => "rgbd",
            Self::MonoImu => "mono-imu",
            Self::StereoImu => "stereo-imu",
            Self::RgbdImu => "rgbd-imu",
        }
    }

    /// All that a rig has.
    pub fn of(rig: &Rig) -> Self {
        let mode = match (&rig.depth, rig.cameras.len()) {
            (Some(_), _) => SensorMode::Rgbd,
            (None, 0 | 1) => SensorMode::Mono,
            (None, _) => SensorMode::Stereo,
        };
        Self::with(mode, rig.imu.is_some())
    }

    /// The rig without the cameras and the depth that are not asked for, so that they are not even read; `None`
    /// when nothing is left out.
    pub fn only(self, rig: &Rig) -> Option<Rig> {
        let cameras = if self.mode() == SensorMode::Stereo { 2 } else { 1 };
        let depth = rig.depth.is_some() && self.mode() != SensorMode::Rgbd;
        (rig.cameras.len() > cameras || depth).then(|| Rig {
            cameras: rig.cameras.iter().take(cameras).cloned().collect(),
            depth: rig.depth.clone().filter(|_| !depth),
            imu: rig.imu.clone(),
        })
    }
}
