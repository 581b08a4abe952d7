//! What a motion by tracks is found to be.

use crate::NavState;
use cairn_geometry::Vec3;

/// The motion that was found.
#[derive(Clone, Debug)]
pub struct TrackMotion {
    /// The state at each frame, in metres, z up, from the first frame's place on.
    pub states: Vec<NavState>,
    /// The point of each track; `None` where it is too far to be told, or does not agree.
    pub points: Vec<Option<Vec3>>,
    /// Standard deviation of the logarithm of all lengths.
    pub scale_sigma: f64,
    /// Standard deviation of gravity's direction, radians.
    pub gravity_sigma: f64,
    /// Root mean square of the rays that agree, in standard deviations of a ray.
    pub residual: f64,
    /// The share of the rays that agree.
    pub agreeing: f64,
    /// Seconds to add to the readings' stamps, and the standard deviation.
    pub offset_s: [f64; 2],
    /// The logarithm of the true focal length over that assumed, and the standard deviation.
    pub log_focal: [f64; 2],
    /// What the rows take longer than assumed, seconds, and the standard deviation.
    pub readout_s: [f64; 2],
}
