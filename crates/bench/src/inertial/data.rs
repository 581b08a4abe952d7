//! Complete recordings of real IMUs with ground truth, without images.

use crate::MeasureError;
use cairn_geometry::{Se3, So3, Trajectory, Vec3};
use cairn_inertial::{Bias, ImuBuffer, Preintegrated};
use cairn_sensor::{ImuNoise, ImuSample, ImuSensor, Stamp};
use std::path::Path;

/// Folders in `imu-truth`.
pub const NAMES: [&str; 5] = ["MH_03_medium", "V1_02_medium", "V2_01_easy", "tumvi_room1", "tumvi_room3"];

/// The ADIS16448 of EuRoC, by its data sheet.
const EUROC: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 };
/// The BMI160 of TUM-VI, by its calibration.
const TUMVI: ImuNoise = ImuNoise { gyro: 1.6e-4, gyro_walk: 2.2e-5, accel: 2.8e-3, accel_walk: 8.6e-4 };

/// The extrinsics of EuRoC's left camera, used for all recordings.
pub fn imu_from_camera() -> Se3 {
    let q = So3::from_xyzw(-0.007_707_18, 0.010_499_32, 0.701_752_8, 0.712_301_5).unwrap_or(So3::identity());
    Se3::new(q, Vec3::new(-0.021_640_1, -0.064_677, 0.009_810_7))
}

/// A recording.
pub struct ImuRecording {
    /// Its folder.
    pub name: &'static str,
    /// The sensor; its frame is the body frame.
    pub sensor: ImuSensor,
    /// All its samples.
    pub samples: Vec<ImuSample>,
    /// `world_from_imu`, up to 200 Hz.
    pub truth: Trajectory,
}

impl ImuRecording {
    /// Reads a recording of [`NAMES`] from the data folder.
    ///
    /// # Errors
    /// When a file is missing or invalid.
    pub fn read(data: &Path, name: &'static str) -> Result<Self, MeasureError> {
        let folder = data.join("imu-truth").join(name);
        let samples = cairn_sources::read_imu(folder.join("imu.csv"))?;
        let truth = cairn_eval::load_trajectory(&folder.join("gt_tum.txt"))?.trajectory;
        let noise = if name.starts_with("tumvi") { TUMVI } else { EUROC };
        let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise, offset_s: 0.0 };
        Ok(Self { name, sensor, samples, truth })
    }

    /// The true pose at an instant, if there are poses within 50 ms around it.
    pub fn pose(&self, stamp: Stamp) -> Option<Se3> {
        self.truth.at_within(stamp.0, 50_000_000)
    }

    /// The first and the last stamp of the ground truth.
    pub fn span(&self) -> (Stamp, Stamp) {
        let stamps = self.truth.stamps_ns();
        (Stamp(stamps.first().copied().unwrap_or(0)), Stamp(stamps.last().copied().unwrap_or(0)))
    }

    /// A buffer of all samples.
    pub fn buffer(&self) -> ImuBuffer {
        let mut buffer = ImuBuffer::new(&self.sensor, 0.1);
        buffer.push(&self.samples);
        buffer
    }
}

/// Preintegrated IMU data from stamp to stamp; `None` if samples are missing.
pub fn links(buffer: &ImuBuffer, bias: Bias, stamps: &[Stamp]) -> Option<Vec<Preintegrated>> {
    stamps.windows(2).map(|w| buffer.preintegrate(bias, w[0], w[1]).ok()).collect()
}
