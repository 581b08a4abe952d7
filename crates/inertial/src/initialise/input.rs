//! What an initialisation is given.

use cairn_geometry::Se3;
use cairn_sensor::Stamp;

/// A visual pose of a key frame, in the map's own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPose {
    /// Its time.
    pub stamp: Stamp,
    /// Pose of the camera.
    pub world_from_camera: Se3,
}

/// The key frames of a map, and how good their poses are.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// In time order.
    pub poses: &'a [SeenPose],
    /// Standard deviation of a rotation, rad.
    pub rotation_sigma: f64,
    /// Standard deviation of a position, in the map's units: about the median depth times the error in pixels over the focal
    /// length, less with many points observed.
    pub position_sigma: f64,
}

/// What is known of the map's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// One camera: nothing.
    Free,
    /// Stereo, depth, or an earlier estimate: metres, up to this standard deviation of the scale's logarithm.
    Known {
        /// Relative standard deviation.
        sigma: f64,
    },
}

/// Settings of the solver and bounds of the tests.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InitialiseConfig {
    /// Prior of the gyroscope's bias around zero, rad/s.
    pub gyro_bias_sigma: f64,
    /// Prior of the accelerometer's bias around zero, m/s^2.
    pub accel_bias_sigma: f64,
    /// Prior of what is left of the offset between the clocks of IMU and camera, around zero, seconds; 0 where they are known to
    /// agree.
    pub offset_sigma_s: f64,
    /// Prior of where the camera is on the IMU around where it is said to be, each axis, metres; 0 where that is known. One who walks
    /// pitches and rolls in time with their bob: a camera 3 cm from there makes the scale wrong by several per cent.
    pub lever_arm_sigma: f64,
    /// Least factor on the noise densities of the IMU: real ones are worse than their data sheets. It is raised to fit the
    /// residuals.
    pub noise_times: f64,
    /// Greatest such factor, for gyroscope and accelerometer.
    pub most_noise_times: [f64; 2],
    /// Maximum number of solver steps.
    pub iterations: usize,
    /// Minimum number of key frames.
    pub least_key_frames: usize,
    /// Minimum time from the first key frame to the last, seconds.
    pub least_seconds: f64,
    /// Minimum root mean square of the acceleration around its mean, m/s^2; only where scale is free.
    pub least_excitation: f64,
    /// Minimum spread of the camera's positions, in standard deviations of a position; only where scale is free.
    pub least_baseline: f64,
    /// Maximum weighted squared residual per degree of freedom.
    pub most_residual: f64,
    /// Maximum difference of gravity's norm, when estimated, from 9.81, beyond twice its standard deviation, m/s^2.
    pub most_gravity_off: f64,
    /// Maximum relative standard deviation of the scale.
    pub most_scale_sigma: f64,
    /// Maximum standard deviation of gravity's direction, rad.
    pub most_gravity_sigma: f64,
    /// Maximum norm of the gyro bias, rad/s.
    pub most_gyro_bias: f64,
    /// Maximum norm of the accel bias, m/s^2.
    pub most_accel_bias: f64,
}

impl Default for InitialiseConfig {
    fn default() -> Self {
        Self {
            gyro_bias_sigma: 0.1,
            accel_bias_sigma: 0.2,
            offset_sigma_s: 0.0,
            lever_arm_sigma: 0.0,
            noise_times: 5.0,
            most_noise_times: [30.0, 60.0],
            iterations: 20,
            least_key_frames: 5,
            least_seconds: 1.5,
            least_excitation: 0.2,
            least_baseline: 10.0,
            most_residual: 4.0,
            most_gravity_off: 0.5,
            most_scale_sigma: 0.03,
            most_gravity_sigma: 0.035,
            most_gyro_bias: 0.3,
            most_accel_bias: 1.0,
        }
    }
}
