//! Which sensors of a rig a run uses.

use cairn_sensor::Rig;
use cairn_vision::SensorMode;
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Which sensors of a rig are used: its cameras by their mode, with or without the IMU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sensors {
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

/// There are no sensors of this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no sensor \"{0}\"; write mono, stereo, rgbd, or one of them with -imu")]
pub struct UnknownSensors(String);

impl Sensors {
    /// Those without the IMU.
    pub const VISUAL: [Self; 3] = [Self::Mono, Self::Stereo, Self::Rgbd];
    /// Those with the IMU.
    pub const INERTIAL: [Self; 3] = [Self::MonoImu, Self::StereoImu, Self::RgbdImu];

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
        Self::INERTIAL.contains(&self)
    }

    /// A camera mode with or without the IMU.
    pub fn with(mode: SensorMode, has_imu: bool) -> Self {
        let all = if has_imu { Self::INERTIAL } else { Self::VISUAL };
        match mode {
            SensorMode::Mono => all[0],
            SensorMode::Stereo => all[1],
            SensorMode::Rgbd => all[2],
        }
    }

    /// The name on command lines.
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

    /// All sensors of a rig: depth where there is a depth sensor, else stereo where there are two cameras, else mono.
    pub fn of(rig: &Rig) -> Self {
        let mode = match (&rig.depth, rig.cameras.len()) {
            (Some(_), _) => SensorMode::Rgbd,
            (None, 0 | 1) => SensorMode::Mono,
            (None, _) => SensorMode::Stereo,
        };
        Self::with(mode, rig.imu.is_some())
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

impl FromStr for Sensors {
    type Err = UnknownSensors;

    fn from_str(text: &str) -> Result<Self, UnknownSensors> {
        let known = Self::VISUAL.into_iter().chain(Self::INERTIAL).find(|s| s.name() == text);
        known.ok_or_else(|| UnknownSensors(text.to_owned()))
    }
}

/// Whether the first camera's image shows the pixels of the depth.
pub fn has_colours(rig: &Rig) -> bool {
    let first = rig.cameras.first().map(|c| c.camera);
    rig.depth.as_ref().is_some_and(|d| d.registered && Some(d.camera) == first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_modes_lead_back_to_the_sensors() {
        for s in Sensors::VISUAL.into_iter().chain(Sensors::INERTIAL) {
            assert_eq!(s.name().parse(), Ok(s));
            assert_eq!(Sensors::with(s.mode(), s.has_imu()), s);
            assert_eq!(serde_json::to_value(s).unwrap(), s.name());
        }
        assert!("lidar".parse::<Sensors>().unwrap_err().to_string().contains("lidar"));
    }
}
