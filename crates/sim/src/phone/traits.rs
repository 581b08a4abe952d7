//! What differs from phone to phone, drawn by a seed.
//!
//! Ranges: fields of view of main cameras in video of 60 to 74 degrees across the longer side; readout of the rows of 15 to
//! 25 ms; densities and biases of consumer MEMS sensors; browsers hand out motion at 60 Hz, rounded to 0.1 degrees a second
//! and 0.1 m/s^2 (Chromium, against fingerprinting), and stamp a picture when it is presented, some frames of the display
//! after its exposure.

use cairn_geometry::Vec3;
use cairn_random::Random;
use cairn_sensor::{Camera, Distortion, ImuNoise};

/// One phone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhoneTraits {
    /// The true camera: nothing of it but the size is told to anybody.
    pub camera: Camera,
    /// Seconds from the first row's exposure to the last row's.
    pub readout_s: f64,
    /// Pictures a second that the camera takes.
    pub camera_hz: f64,
    /// Seconds by which a picture's stamp is later than the exposure of its middle row, on average, ...
    pub stamp_delay_s: f64,
    /// ... and the standard deviation of that.
    pub stamp_jitter_s: f64,
    /// Readings a second of the motion sensors.
    pub imu_hz: f64,
    /// Standard deviation of the times of readings, seconds; the stamps tell these times.
    pub imu_jitter_s: f64,
    /// Seconds until the first reading.
    pub imu_start_s: f64,
    /// True densities; what the server assumes is its own affair.
    pub noise: ImuNoise,
    /// Biases at the start: rad/s and m/s^2.
    pub gyro_bias: Vec3,
    /// See [`PhoneTraits::gyro_bias`].
    pub accel_bias: Vec3,
    /// Where the sensors are, in the camera frame, metres; their axes are those of the camera.
    pub imu_in_camera: Vec3,
    /// Readings are rounded to multiples of this: rad/s and m/s^2; 0 is not rounded.
    pub rounding: [f64; 2],
}

impl PhoneTraits {
    /// A phone of this seed, with images of `width` by `height` pixels.
    pub fn new(seed: u64, width: usize, height: usize) -> Self {
        let mut r = Random::stream(seed, 0x9408E);
        let focal = r.uniform(0.66, 0.86) * width.max(height) as f64;
        let (cx, cy) = (0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0));
        let k1 = r.uniform(-0.06, 0.06);
        let camera = Camera {
            distortion: Distortion::RadialTangential([k1, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(
                width,
                height,
                focal,
                focal,
                cx + r.normal(0.0, 0.005) * width as f64,
                cy + r.normal(0.0, 0.005) * width as f64,
            )
        };
        let mut vector = |s: f64| {
            let mut one = || s * r.standard_normal();
            Vec3::new(one(), one(), one())
        };
        let (gyro_bias, accel_bias) = (vector(5e-3), vector(0.05));
        let imu_in_camera = vector(0.03);
        Self {
            camera,
            readout_s: r.uniform(0.015, 0.025),
            camera_hz: 30.0,
            stamp_delay_s: r.uniform(0.0, 0.03),
            stamp_jitter_s: 1.5e-3,
            imu_hz: 60.0,
            imu_jitter_s: 2e-3,
            imu_start_s: r.uniform(0.5, 3.0),
            noise: ImuNoise {
                gyro: r.uniform(1e-4, 1e-3),
                gyro_walk: r.uniform(1e-5, 1e-4),
                accel: r.uniform(1e-3, 5e-3),
                accel_walk: r.uniform(1e-4, 1e-3),
            },
            gyro_bias,
            accel_bias,
            imu_in_camera,
            rounding: [0.1f64.to_radians(), 0.1],
        }
    }
}
