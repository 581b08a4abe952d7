//! Drift of pure IMU prediction over seconds from known states, compared with ground truth.

use super::data::ImuRecording;
use super::reference::Reference;
use cairn_geometry::Vec3;
use serde::Serialize;

/// Errors after some seconds without camera.
#[derive(Clone, Debug, Serialize)]
pub struct Drift {
    /// Recording.
    pub name: &'static str,
    /// Duration of the prediction, seconds.
    pub seconds: f64,
    /// Number of starts.
    pub tries: usize,
    /// Position error, metres: median and 95th percentile.
    pub place_m: [f64; 2],
    /// Rotation error, degrees: median and 95th percentile.
    pub turn_deg: [f64; 2],
    /// Root mean square of the position error over its standard deviation, per axis; 1 is consistent.
    pub place_over_sigma: f64,
}

/// The durations, seconds.
pub const SECONDS: [f64; 3] = [1.0, 5.0, 10.0];

/// Starts at every second key frame of the reference.
pub fn measure(motion: &ImuRecording, reference: &Reference) -> Vec<Drift> {
    let buffer = motion.buffer();
    let over = |seconds: f64| {
        let (mut places, mut turns, mut square) = (Vec::new(), Vec::new(), 0.0);
        for (stamp, state) in reference.states.iter().step_by(2) {
            let end = stamp.plus_seconds(seconds);
            let (Some(truth), Ok(sum)) = (motion.pose(end), buffer.preintegrate(state.bias, *stamp, end))
            else {
                continue;
            };
            let found = sum.predict(state, &reference.gravity);
            let off: Vec3 = found.world_from_imu.translation - truth.translation;
            places.push(off.norm());
            turns.push((truth.rotation.inverse() * found.world_from_imu.rotation).angle().to_degrees());
            let sigma2 = sum.covariance().fixed_view::<3, 3>(6, 6).trace() / 3.0;
            square += off.norm_squared() / (3.0 * sigma2);
        }
        let tries = places.len();
        Drift {
            name: motion.name,
            seconds,
            tries,
            place_m: median_and_p95(&mut places),
            turn_deg: median_and_p95(&mut turns),
            place_over_sigma: (square / tries.max(1) as f64).sqrt(),
        }
    };
    SECONDS.map(over).to_vec()
}

/// Median and 95th percentile of values; NaN if there are none.
pub fn median_and_p95(values: &mut [f64]) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let at = |part: f64| {
        let i = (part * values.len() as f64).ceil() as usize;
        values.get(i.saturating_sub(1)).copied().unwrap_or(f64::NAN)
    };
    [at(0.5), at(0.95)]
}
