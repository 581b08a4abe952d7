//! The sensors of a rig that a run uses.

use cairn::sensor_mode_of;
use cairn_engine::SensorMode;
use cairn_sensor::Rig;

/// Which sensors of a rig are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Sensor {
    /// The first camera only; the scale stays unknown.
    Mono,
    /// The first two cameras.
    Stereo,
    /// The first camera and the depth sensor.
    Rgbd,
    /// The first camera and the IMU, which makes scale and gravity known.
    MonoImu,
    /// The first two cameras and the IMU.
    StereoImu,
    /// The first camera, the depth sensor and the IMU.
    RgbdImu,
}

impl Sensor {
    /// The camera mode, without the IMU.
    pub fn mode(self) -> SensorMode {
        match self {
            Self::Mono | Self::MonoImu => SensorMode::Mono,
            Self::Stereo | Self::StereoImu => SensorMode::Stereo,
            Self::Rgbd | Self::RgbdImu => SensorMode::Rgbd,
        }
    }

    /// Whether the IMU is used.
    pub fn has_imu(self) -> bool {
        matches!(self, Self::MonoImu | Self::StereoImu | Self::RgbdImu)
    }

    /// A camera mode with or without the IMU.
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

    /// The name on the command line.
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

    /// All sensors of a rig.
    pub fn of(rig: &Rig) -> Self {
        Self::with(sensor_mode_of(rig), rig.imu.is_some())
    }

    /// Whether a rig has them.
    pub fn is_in(self, rig: &Rig) -> bool {
        let has_mode = match self.mode() {
            SensorMode::Mono => true,
            SensorMode::Stereo => rig.cameras.len() > 1,
            SensorMode::Rgbd => rig.depth.is_some(),
        };
        has_mode && (rig.imu.is_some() || !self.has_imu())
    }

    /// What of a rig a live source is opened with: nothing that these sensors do not use.
    pub fn live_rig(self, rig: Rig) -> Rig {
        let rig = self.only(&rig).unwrap_or(rig);
        Rig { imu: rig.imu.filter(|_| self.has_imu()), ..rig }
    }

    /// The rig without the cameras and depth that are not used, so that they are not even read; `None` if
    /// nothing is left out.
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
