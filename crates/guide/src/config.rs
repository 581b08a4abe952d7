//! The guide's config: every limit with its default.

use crate::facing::Facing;
use crate::matcher::MatcherConfig;
use cairn_sensor::MotionProfile;
use cairn_settings::Settings;

/// Limits and times of the guide. Lengths in metres, times in seconds, angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct GuideConfig {
    /// How the camera is mounted relative to the walker.
    #[setting(skip, default = Facing::Home)]
    #[serde(skip)]
    pub facing: Facing,
    /// What the walker can do: the tracker's setting.
    #[setting(skip, default = MotionProfile::default())]
    #[serde(skip)]
    pub motion: MotionProfile,
    /// A turn is announced this far ahead, but at most half the segment.
    #[setting(default = 6.0, range = 0.0..=100.0)]
    pub approach_m: f64,
    /// Added to [`Self::approach_m`] per m/s above 1 m/s.
    #[setting(default = 2.0, range = 0.0..=10.0)]
    pub approach_per_speed: f64,
    /// Stairs are announced this far ahead.
    #[setting(default = 3.0, range = 0.0..=100.0)]
    pub approach_stairs_m: f64,
    /// On segments shorter than this the turn was announced when the segment began: no second announcement.
    #[setting(default = 12.0, range = 0.0..=100.0)]
    pub approach_segment_m: f64,
    /// "Turn now" comes at speed times this before the turn.
    #[setting(default = 2.0, range = 0.0..=600.0)]
    pub turn_now_s: f64,
    /// "Turn now" comes at least this far before the turn.
    #[setting(default = 0.6, range = 0.0..=100.0)]
    pub turn_now_min_m: f64,
    /// "Turn now" comes at most at this share of the segment before the turn.
    #[setting(default = 0.25, range = 0.0..=1.0)]
    pub turn_now_share: f64,
    /// Time a walker needs to react; added to "turn now".
    #[setting(default = 0.3, range = 0.0..=600.0)]
    pub reaction_s: f64,
    /// "Stop turning" comes early by turn rate times this: to say the words, to hear them, to stop.
    #[setting(default = 1.1, range = 0.0..=600.0)]
    pub turn_lead_s: f64,
    /// After a turn, a heading error below this is not corrected.
    #[setting(default = 25.0, range = 0.0..=180.0)]
    pub turn_tolerance_deg: f64,
    /// Progress is announced after this many metres without other words; 0: never.
    #[setting(default = 10.0, range = 0.0..=1000.0)]
    pub progress_m: f64,
    /// A waypoint's box: across the route, along it, and in height.
    #[setting(default = [2.0, 0.5, 3.0], range = 0.01..=100.0)]
    pub waypoint_box_m: [f64; 3],
    /// The box of the last waypoint, the end.
    #[setting(default = [1.0, 1.0, 3.0], range = 0.01..=100.0)]
    pub arrival_box_m: [f64; 3],
    /// The end is announced this far ahead to a fast walker, with the advice to slow down.
    #[setting(default = 5.0, range = 0.0..=100.0)]
    pub end_m: f64,
    /// Walkers faster than this are fast in the sense of [`Self::end_m`], m/s.
    #[setting(default = 0.8, range = 0.0..=10.0)]
    pub end_speed: f64,
    /// Arrival is said early by speed times this, so that the walker stops where the route ends.
    #[setting(default = 1.1, range = 0.0..=600.0)]
    pub arrival_lead_s: f64,
    /// Spread of people's reaction times: speed times it is how far from the end they may stop.
    #[setting(default = 0.45, range = 0.0..=600.0)]
    pub arrival_spread_s: f64,
    /// Standing this near to the end counts as arrived.
    #[setting(default = 0.8, range = 0.0..=100.0)]
    pub arrival_reach_m: f64,
    /// On course: the heading error is within this angle.
    #[setting(default = 15.0, range = 1.0..=90.0)]
    pub cone_deg: f64,
    /// Time between on-course ticks.
    #[setting(default = 0.4, range = 0.1..=10.0)]
    pub tick_s: f64,
    /// Minimum distance of the look-ahead point on the route that the walker is directed to.
    #[setting(default = 3.0, range = 0.5..=20.0)]
    pub look_ahead_m: f64,
    /// The look-ahead distance is at least speed times this. It is never less than twice the distance off the route,
    /// so that the walker returns to it at a small angle.
    #[setting(default = 3.5, range = 0.0..=600.0)]
    pub look_ahead_s: f64,
    /// A course error above this is corrected at once when the course leaves the corridor.
    #[setting(default = 15.0, range = 0.0..=180.0)]
    pub adjust_deg: f64,
    /// How far ahead the course is checked for leaving the corridor.
    #[setting(default = 20.0, range = 0.0..=100.0)]
    pub adjust_ahead_m: f64,
    /// A smaller course error is corrected when the walker reaches this share of [`Self::off_m`].
    #[setting(default = 0.8, range = 0.0..=1.0)]
    pub edge_share: f64,
    /// On the last leg a course that misses the end by more than this is corrected.
    #[setting(default = 0.25, range = 0.0..=100.0)]
    pub end_miss_m: f64,
    /// Above this course error the aim alone decides the correction.
    #[setting(default = 35.0, range = 0.0..=180.0)]
    pub adjust_far_deg: f64,
    /// A correction is said once it has been needed for this long.
    #[setting(default = 0.6, range = 0.0..=600.0)]
    pub adjust_dwell_s: f64,
    /// Time from the last direction to a correction.
    #[setting(default = 3.0, range = 0.0..=600.0)]
    pub adjust_again_s: f64,
    /// The same after a turn on the spot.
    #[setting(default = 1.0, range = 0.0..=600.0)]
    pub adjust_after_turn_s: f64,
    /// From this course error on the correction is a turn on the spot.
    #[setting(default = 60.0, range = 0.0..=180.0)]
    pub adjust_turn_deg: f64,
    /// Half the corridor: beyond this distance from the route the aim is corrected sooner.
    #[setting(default = 1.0, range = 0.1..=10.0)]
    pub warn_m: f64,
    /// Beyond this distance from the route the walker is off the path.
    #[setting(default = 1.5, range = 0.2..=10.0)]
    pub off_m: f64,
    /// The walker is back on the path when nearer than [`Self::off_m`] by this.
    #[setting(default = 0.3, range = 0.0..=100.0)]
    pub off_hysteresis_m: f64,
    /// Off path is said when it has lasted this long.
    #[setting(default = 2.0, range = 0.0..=600.0)]
    pub off_dwell_s: f64,
    /// Off path is repeated after this.
    #[setting(default = 5.0, range = 0.0..=600.0)]
    pub off_again_s: f64,
    /// The same before the first waypoint.
    #[setting(default = 10.0, range = 0.0..=600.0)]
    pub off_again_first_s: f64,
    /// Wrong way: the heading error is above this angle.
    #[setting(default = 120.0, range = 60.0..=180.0)]
    pub wrong_way_deg: f64,
    /// Wrong way is said after moving this far.
    #[setting(default = 2.0, range = 0.0..=100.0)]
    pub wrong_way_m: f64,
    /// Time until wrong way is said again.
    #[setting(default = 10.0, range = 0.0..=600.0)]
    pub wrong_way_again_s: f64,
    /// Stopped: moved less than this within [`Self::stopped_s`].
    #[setting(default = 0.3, range = 0.0..=100.0)]
    pub stopped_m: f64,
    /// The time over which [`Self::stopped_m`] is measured.
    #[setting(default = 5.0, range = 0.0..=600.0)]
    pub stopped_s: f64,
    /// A stopped walker is reassured once more after this.
    #[setting(default = 15.0, range = 0.0..=600.0)]
    pub stopped_again_s: f64,
    /// A pose older than this stops the walker; it can be lowered, but no old picture guides anyone.
    #[setting(default = 0.5, range = 0.1..=0.5)]
    pub stale_s: f64,
    /// "Stop" is repeated after this.
    #[setting(default = 3.0, range = 1.0..=10.0)]
    pub stop_again_s: f64,
    /// A stop that comes with advice to walk differently is repeated after this.
    #[setting(default = 18.0, range = 0.0..=600.0)]
    pub advice_again_s: f64,
    /// Poses must be good for this long before guidance goes on.
    #[setting(default = 1.0, range = 0.2..=60.0)]
    pub resume_s: f64,
    /// Without the map in view, by motion sensors or rotation alone, the walker is guided for this long, turns on the spot not
    /// counted and standing still counted a tenth; then he is stopped.
    #[setting(default = 2.0, range = 0.5..=4.0)]
    pub blind_s: f64,
    /// Weak tracking (a bridged stretch) is said when it has lasted this long.
    #[setting(default = 1.0, range = 0.0..=600.0)]
    pub weak_s: f64,
    /// Past an obstacle the walker is turned for more than this.
    #[setting(default = 12.0, range = 0.0..=180.0)]
    pub detour_tolerance_deg: f64,
    /// Walking backwards: a leg ends after this, unless the rest fits within [`Self::leg_most_m`].
    #[setting(default = 12.0, range = 0.01..=100.0)]
    pub leg_m: f64,
    /// Walking backwards: the longest leg.
    #[setting(default = 15.0, range = 0.01..=100.0)]
    pub leg_most_m: f64,
    /// Walking backwards: time to look behind at the end of a leg.
    #[setting(default = 2.0, range = 0.0..=600.0)]
    pub check_s: f64,
    /// Walking backwards: the walker is told to slow down above this speed, m/s.
    #[setting(default = 0.5, range = 0.0..=10.0)]
    pub backwards_speed: f64,
    /// Walking backwards: the walker is stopped at this distance from the line.
    #[setting(default = 0.5, range = 0.0..=100.0)]
    pub backwards_off_m: f64,
    /// Walking backwards: an aim error above this is corrected.
    #[setting(default = 12.0, range = 0.0..=180.0)]
    pub backwards_adjust_deg: f64,
    /// A correction of the map moves the route under the walker over this time; at once where he would be led wrongly
    /// meanwhile. 0 for always at once.
    #[setting(default = 2.0, range = 0.0..=600.0)]
    pub ease_s: f64,
    /// Matching of the walker to the route.
    #[setting(section)]
    pub matcher: MatcherConfig,
}
