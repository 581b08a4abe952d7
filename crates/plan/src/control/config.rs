//! How a [`Navigator`](super::Navigator) plans, follows, waits and recovers.

use super::mppi::MppiConfig;
use super::pursuit::PursuitConfig;
use crate::smooth::SmoothConfig;

/// Configuration of the navigator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavigatorConfig {
    /// Pure pursuit.
    pub pursuit: PursuitConfig,
    /// If set, follows by path integral control with this configuration; pure pursuit then only turns in place and
    /// brakes at the goal.
    pub predictive: Option<MppiConfig>,
    /// Path smoothing; radius and clearance come from the costmap.
    pub smooth: SmoothConfig,
    /// Clearance kept beyond that of the costmap where there is room, in metres.
    pub room_m: f64,
    /// Time to wait before each recovery when something is in the way, in seconds.
    pub wait_s: f64,
    /// Time to wait before the first recovery when what is in the way moves and may leave by itself, in seconds. A body that
    /// backs up before someone who waits for it brings him after it.
    pub passing_s: f64,
    /// Time for which what moves may be in the way in all before the navigator gives up, in seconds: a body that creeps up to
    /// someone each time he moves a little never comes to the end of its recoveries.
    pub patience_s: f64,
    /// Longest distance to back up, in metres.
    pub back_up_m: f64,
    /// Rounds of recovery after which the navigator plans again; one more, and it gives up.
    pub attempts: u32,
    /// A pose that differs by more than this from the predicted one has jumped, in metres.
    pub jump_m: f64,
    /// A body farther than this from its path plans again, in metres.
    pub off_path_m: f64,
    /// A start too near to an obstacle is accepted if free ground is this near, in metres: following is not exact. The path then
    /// begins with the way out.
    pub way_out_m: f64,
}

impl NavigatorConfig {
    /// Defaults that suit a pure pursuit configuration.
    pub fn new(pursuit: PursuitConfig) -> Self {
        Self {
            pursuit,
            predictive: None,
            smooth: SmoothConfig::default(),
            room_m: 0.2,
            wait_s: 1.0,
            passing_s: 4.0,
            patience_s: 60.0,
            back_up_m: 0.3,
            attempts: 3,
            jump_m: 0.4,
            off_path_m: 0.5,
            way_out_m: 0.6,
        }
    }
}
