//! Configuration of tracking.

use crate::flow::FlowClocks;
use cairn_sensor::MotionProfile;
use cairn_settings::Settings;

/// Configuration of tracking.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct TrackerConfig {
    /// Inlier matches needed to accept a pose.
    #[setting(default = 25, range = 6..=10000)]
    pub min_inliers: usize,
    /// Key frames in the local map, at most.
    #[setting(default = 40, range = 1..=10000)]
    pub local_key_frames: usize,
    /// Seconds without a pose after which a new map begins, if the place has not been recognised by then.
    #[setting(default = 0.5, range = 0.0..=1e4)]
    pub new_map_s: f64,
    /// Standard deviation of the position in metres up to which the IMU may carry the pose (coasting).
    #[setting(default = 1.0, range = 0.0..=100.0)]
    pub coast_sigma: f64,
    /// Longest time in motion for which it may do so, in seconds.
    #[setting(default = 6.0, range = 0.0..=15.0)]
    pub coast_s: f64,
    /// Seconds from the exposure of the first row of an image to that of the last (rolling shutter); negative where the last
    /// row is first, 0 where all are exposed at once. Stamps are those of the middle row.
    #[setting(default = 0.0, range = -0.05..=0.05)]
    pub readout_s: f64,
    /// True to estimate the time above from the images and the motion, whatever is given; the rows of an upright image are
    /// taken for the columns of the sensor.
    #[setting(default = false)]
    pub estimate_readout: bool,
    /// True to find the offset of the IMU's clock and the time above from the first second of pictures, before a map begins; only where
    /// that time is estimated.
    #[setting(default = false)]
    pub clocks_by_flow: bool,
    /// What is known of both already, before the first picture; otherwise they are found.
    #[setting(skip, default = None)]
    #[serde(skip)]
    pub clocks: Option<FlowClocks>,
    /// True to take the pose of each frame from its depth image (`--front-end dense`); features still find places again. Without
    /// it the depth image gives the pose where features do not suffice.
    #[setting(default = false)]
    pub dense: bool,
    /// Seconds without a pose after which the place is looked for by the shape of its surfaces, where there is depth and
    /// surfaces are made (`--dense`).
    #[setting(default = 1.0, range = 0.0..=1e4)]
    pub find_by_depth_s: f64,
    /// True where the camera is known to be in the rooms of the map: then their shape alone tells where (a start in a saved map
    /// in the dark). Without it features have to agree, or the camera has to have been tracked near there less than three seconds
    /// before: a room that is not in the map may look like one that is.
    #[setting(default = false)]
    pub find_by_shape_alone: bool,
    /// What carries the camera can do.
    #[setting(section)]
    pub motion: MotionProfile,
}
