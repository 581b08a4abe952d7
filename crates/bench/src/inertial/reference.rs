//! Reference values of a recording: gravity, biases and velocities, estimated from IMU data and noise-free poses at
//! their true scale, window by window. Initialisations are compared with them, and drift starts from them.

use super::data::{ImuRecording, links};
use cairn_geometry::{Se3, Vec3};
use cairn_inertial::{
    Bias, InitialiseConfig, NavState, OffsetConfig, Scale, Seen, SeenPose, TimeOffset, initialise,
    time_offset,
};
use cairn_sensor::Stamp;

/// Duration of a window, seconds; the biases are constant in it.
const WINDOW_S: f64 = 20.0;
/// Seconds between the key frames of a window.
const STEP_S: f64 = 0.25;

/// Reference values besides the poses.
pub struct Reference {
    /// Gravity in the ground-truth frame, m/s^2.
    pub gravity: Vec3,
    /// For each window: its start, its biases, and the weighted squared residual per degree of freedom.
    pub windows: Vec<(Stamp, Bias, f64)>,
    /// States at key frames.
    pub states: Vec<(Stamp, NavState)>,
    /// Time offset and rotation between ground truth and IMU, estimated on the whole recording.
    pub clock: Option<TimeOffset>,
}

impl Reference {
    /// Estimates the reference values of a recording.
    pub fn of(motion: &ImuRecording) -> Self {
        let buffer = motion.buffer();
        let (first, last) = motion.span();
        let (mut windows, mut states, mut gravities) = (Vec::new(), Vec::new(), Vec::new());
        let mut from = first;
        while last - from > WINDOW_S {
            let stamps: Vec<Stamp> =
                (0..=(WINDOW_S / STEP_S) as usize).map(|k| from.plus_seconds(STEP_S * k as f64)).collect();
            let poses: Option<Vec<SeenPose>> = stamps
                .iter()
                .map(|t| Some(SeenPose { stamp: *t, world_from_camera: motion.pose(*t)? }))
                .collect();
            if let (Some(poses), Some(links)) = (poses, links(&buffer, Bias::default(), &stamps)) {
                let seen = Seen { poses: &poses, rotation_sigma: 1e-3, position_sigma: 1e-3 };
                let config = InitialiseConfig { accel_bias_sigma: 1.0, ..Default::default() };
                let scale = Scale::Known { sigma: 1e-6 };
                if let Some(found) = initialise(&seen, &links, &Se3::identity(), scale, &config).found {
                    gravities.push(found.gravity.vector());
                    windows.push((from, found.bias, found.residual));
                    states.extend(stamps.iter().copied().zip(found.states));
                }
            }
            from = from.plus_seconds(WINDOW_S);
        }
        let gravity = gravities.iter().sum::<Vec3>() / gravities.len().max(1) as f64;
        let poses: Vec<_> = (0..((last - first) * 20.0) as usize)
            .map(|k| first.plus_seconds(0.05 * k as f64))
            .filter_map(|t| Some((t, motion.pose(t)?.rotation)))
            .collect();
        let given = cairn_geometry::So3::identity();
        let clock = time_offset(&poses, &motion.samples, &given, &OffsetConfig::default()).ok();
        Self { gravity, windows, states, clock }
    }

    /// The true pose at a key frame of the reference: the measured position, and the rotation smoothed with the
    /// gyroscope, because that of the markers sometimes jumps by half a degree (TUM-VI). The accelerometer is not used
    /// for it.
    pub fn pose(&self, motion: &ImuRecording, at: Stamp) -> Option<Se3> {
        let near = self.states.partition_point(|(t, _)| *t < at.plus_seconds(-1e-4));
        let (stamp, state) = self.states.get(near)?;
        let rotation = state.world_from_imu.rotation;
        ((*stamp - at).abs() < 1e-4).then_some(Se3::new(rotation, motion.pose(at)?.translation))
    }

    /// The biases at an instant.
    pub fn bias(&self, at: Stamp) -> Bias {
        let near = self.windows.iter().min_by(|a, b| {
            let off = |w: &(Stamp, Bias, f64)| (w.0.plus_seconds(0.5 * WINDOW_S) - at).abs();
            off(a).total_cmp(&off(b))
        });
        near.map_or(Bias::default(), |w| w.1)
    }
}
