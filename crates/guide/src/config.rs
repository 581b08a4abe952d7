//! The guide's config: every limit with its default.

use crate::facing::Facing;
use crate::matcher::MatcherConfig;

/// Limits and times of the guide. Lengths in metres, times in seconds, angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuideConfig {
    /// How the camera is mounted relative to the walker.
    pub facing: Facing,
    /// A turn is announced this far ahead, but at most half the segment.
    pub approach_m: f64,
    /// Added to [`Self::approach_m`] per m/s above 1 m/s.
    pub approach_per_speed: f64,
    /// Stairs are announced this far ahead.
    pub approach_stairs_m: f64,
    /// On segments shorter than this the turn was announced when the segment began: no second announcement.
    pub approach_segment_m: f64,
    /// "Turn now" comes at speed times this before the turn.
    pub turn_now_s: f64,
    /// "Turn now" comes at least this far before the turn.
    pub turn_now_min_m: f64,
    /// "Turn now" comes at most at this share of the segment before the turn.
    pub turn_now_share: f64,
    /// Time a walker needs to react; added to "turn now".
    pub reaction_s: f64,
    /// "Stop turning" comes early by turn rate times this: to say the words, to hear them, to stop.
    pub turn_lead_s: f64,
    /// After a turn, a heading error below this is not corrected.
    pub turn_tolerance_deg: f64,
    /// Progress is announced after this many metres without other words; `None` turns it off.
    pub progress_m: Option<f64>,
    /// A waypoint's box: across the route, along it, and in height.
    pub waypoint_box_m: [f64; 3],
    /// The box of the last waypoint, the end.
    pub arrival_box_m: [f64; 3],
    /// The end is announced this far ahead to a fast walker, with the advice to slow down.
    pub end_m: f64,
    /// Walkers faster than this are fast in the sense of [`Self::end_m`], m/s.
    pub end_speed: f64,
    /// Arrival is said early by speed times this, so that the walker stops where the route ends.
    pub arrival_lead_s: f64,
    /// Spread of people's reaction times: speed times it is how far from the end they may stop.
    pub arrival_spread_s: f64,
    /// Standing this near to the end counts as arrived.
    pub arrival_reach_m: f64,
    /// On course: the heading error is within this angle.
    pub cone_deg: f64,
    /// Time between on-course ticks.
    pub tick_s: f64,
    /// Minimum distance of the look-ahead point on the route that the walker is directed to.
    pub look_ahead_m: f64,
    /// The look-ahead distance is at least speed times this. It is never less than twice the distance off the route, so
    /// that the walker returns to it at a small angle.
    pub look_ahead_s: f64,
    /// A course error above this is corrected at once when the course leaves the corridor.
    pub adjust_deg: f64,
    /// How far ahead the course is checked for leaving the corridor.
    pub adjust_ahead_m: f64,
    /// A smaller course error is corrected when the walker reaches this share of [`Self::off_m`].
    pub edge_share: f64,
    /// On the last leg a course that misses the end by more than this is corrected.
    pub end_miss_m: f64,
    /// Above this course error the aim alone decides the correction.
    pub adjust_far_deg: f64,
    /// A correction is said once it has been needed for this long.
    pub adjust_dwell_s: f64,
    /// Time from the last direction to a correction.
    pub adjust_again_s: f64,
    /// The same after a turn on the spot.
    pub adjust_after_turn_s: f64,
    /// From this course error on the correction is a turn on the spot.
    pub adjust_turn_deg: f64,
    /// Half the corridor: beyond this distance from the route the aim is corrected sooner.
    pub warn_m: f64,
    /// Beyond this distance from the route the walker is off the path.
    pub off_m: f64,
    /// The walker is back on the path when nearer than [`Self::off_m`] by this.
    pub off_hysteresis_m: f64,
    /// Off path is said when it has lasted this long.
    pub off_dwell_s: f64,
    /// Off path is repeated after this,
    pub off_again_s: f64,
    /// The same before the first waypoint.
    pub off_again_first_s: f64,
    /// Wrong way: the heading error is above this angle.
    pub wrong_way_deg: f64,
    /// Wrong way is said after moving this far.
    pub wrong_way_m: f64,
    /// Time until wrong way is said again.
    pub wrong_way_again_s: f64,
    /// Stopped: moved less than this within [`Self::stopped_s`].
    pub stopped_m: f64,
    /// The time over which [`Self::stopped_m`] is measured.
    pub stopped_s: f64,
    /// A stopped walker is reassured once more after this.
    pub stopped_again_s: f64,
    /// A pose older than this stops the walker.
    pub stale_s: f64,
    /// "Stop" is repeated after this.
    pub stop_again_s: f64,
    /// A stop that comes with advice to walk differently is repeated after this.
    pub advice_again_s: f64,
    /// Poses must be good for this long before guidance goes on.
    pub resume_s: f64,
    /// Weak tracking (a bridged stretch) is said when it has lasted this long.
    pub weak_s: f64,
    /// Past an obstacle the walker is turned for more than this.
    pub detour_tolerance_deg: f64,
    /// Walking backwards: a leg ends after this, unless the rest fits within [`Self::leg_most_m`].
    pub leg_m: f64,
    /// Walking backwards: the longest leg.
    pub leg_most_m: f64,
    /// Walking backwards: time to look behind at the end of a leg.
    pub check_s: f64,
    /// Walking backwards: the walker is told to slow down above this speed, m/s.
    pub backwards_speed: f64,
    /// Walking backwards: the walker is stopped at this distance from the line.
    pub backwards_off_m: f64,
    /// Walking backwards: an aim error above this is corrected.
    pub backwards_adjust_deg: f64,
    /// A correction of the map moves the route under the walker over this time; at once where he would be led wrongly
    /// meanwhile. 0 for always at once.
    pub ease_s: f64,
    /// Matching of the walker to the route.
    pub matcher: MatcherConfig,
}

impl Default for GuideConfig {
    fn default() -> Self {
        Self {
            facing: Facing::Home,
            approach_m: 6.0,
            approach_per_speed: 2.0,
            approach_stairs_m: 3.0,
            approach_segment_m: 12.0,
            turn_now_s: 2.0,
            turn_now_min_m: 0.6,
            turn_now_share: 0.25,
            reaction_s: 0.3,
            turn_lead_s: 1.1,
            turn_tolerance_deg: 25.0,
            progress_m: Some(10.0),
            waypoint_box_m: [2.0, 0.5, 3.0],
            arrival_box_m: [1.0, 1.0, 3.0],
            end_m: 5.0,
            end_speed: 0.8,
            arrival_lead_s: 1.1,
            arrival_spread_s: 0.45,
            arrival_reach_m: 0.8,
            cone_deg: 15.0,
            tick_s: 0.4,
            look_ahead_m: 3.0,
            look_ahead_s: 3.5,
            adjust_deg: 15.0,
            adjust_ahead_m: 20.0,
            edge_share: 0.8,
            end_miss_m: 0.35,
            adjust_far_deg: 35.0,
            adjust_dwell_s: 0.6,
            adjust_again_s: 2.5,
            adjust_after_turn_s: 1.0,
            adjust_turn_deg: 60.0,
            warn_m: 1.0,
            off_m: 1.5,
            off_hysteresis_m: 0.3,
            off_dwell_s: 2.0,
            off_again_s: 5.0,
            off_again_first_s: 10.0,
            wrong_way_deg: 120.0,
            wrong_way_m: 2.0,
            wrong_way_again_s: 10.0,
            stopped_m: 0.3,
            stopped_s: 5.0,
            stopped_again_s: 15.0,
            stale_s: 0.5,
            stop_again_s: 3.0,
            advice_again_s: 18.0,
            resume_s: 1.0,
            weak_s: 1.0,
            detour_tolerance_deg: 12.0,
            leg_m: 12.0,
            leg_most_m: 15.0,
            check_s: 2.0,
            backwards_speed: 0.5,
            backwards_off_m: 0.5,
            backwards_adjust_deg: 12.0,
            ease_s: 2.0,
            matcher: MatcherConfig::default(),
        }
    }
}
