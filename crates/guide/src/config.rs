//! Every number the guide goes by, with its default.

use crate::facing::Facing;
use crate::matcher::MatcherConfig;

/// When the guide speaks. Lengths in metres, times in seconds, angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuideConfig {
    /// How the walker stands to the camera.
    pub facing: Facing,
    /// A turn is announced this far ahead,
    pub approach_m: f64,
    /// plus this per m/s above 1 m/s,
    pub approach_per_speed: f64,
    /// at most half the segment; this far ahead of stairs.
    pub approach_stairs_m: f64,
    /// On segments shorter than this the turn was told when the segment began: no second announcement.
    pub approach_segment_m: f64,
    /// "Turn now" comes at speed times this before the turn,
    pub turn_now_s: f64,
    /// but not nearer than this,
    pub turn_now_min_m: f64,
    /// nor farther than this share of the segment before it.
    pub turn_now_share: f64,
    /// Time a walker needs to react; added to "turn now".
    pub reaction_s: f64,
    /// "Stop turning" comes early by turn rate times this: to say the word, to hear it, to stand.
    pub turn_lead_s: f64,
    /// After a turn within this of the wanted heading nothing is corrected.
    pub turn_tolerance_deg: f64,
    /// Progress is told each so many metres without other words; `None` turns it off.
    pub progress_m: Option<f64>,
    /// A waypoint's box: across the way, along it, and in height.
    pub waypoint_box_m: [f64; 3],
    /// The box of the last one.
    pub arrival_box_m: [f64; 3],
    /// The end is announced this far ahead
    pub end_m: f64,
    /// to a walker faster than this, m/s, with the word to slow down.
    pub end_speed: f64,
    /// Arrival is said early by speed times this, so that the walker stands where the way ends.
    pub arrival_lead_s: f64,
    /// People's reactions differ from the mean by this: speed times it is how far they may stand off.
    pub arrival_spread_s: f64,
    /// Standing this near to the end counts as arrived.
    pub arrival_reach_m: f64,
    /// On course: the heading is within this of the one wanted.
    pub cone_deg: f64,
    /// Time between on-course ticks.
    pub tick_s: f64,
    /// How far ahead on the way the walker is aimed at, at least;
    pub look_ahead_m: f64,
    /// farther when fast, by speed times this, and never nearer than twice the distance off the way, so
    /// that the walker comes back to it at a small angle.
    pub look_ahead_s: f64,
    /// A course that is off by more than this is corrected at once where it leaves the corridor,
    pub adjust_deg: f64,
    /// within so many metres; a lesser error when the walker is about to leave it, by this share of
    pub adjust_ahead_m: f64,
    /// [`Self::off_m`].
    pub edge_share: f64,
    /// On the last leg a course that misses the end by more than this is corrected.
    pub end_miss_m: f64,
    /// From here on the aim counts alone.
    pub adjust_far_deg: f64,
    /// A correction is given when wanted for this long,
    pub adjust_dwell_s: f64,
    /// and this long after the last direction.
    pub adjust_again_s: f64,
    /// sooner after a turn on the spot.
    pub adjust_after_turn_s: f64,
    /// From here on the correction is a turn on the spot.
    pub adjust_turn_deg: f64,
    /// Half the corridor: from here on the aim is corrected sooner.
    pub warn_m: f64,
    /// From here on the walker is off the path,
    pub off_m: f64,
    /// until back by this much,
    pub off_hysteresis_m: f64,
    /// when it lasted this long.
    pub off_dwell_s: f64,
    /// Off path is repeated after this,
    pub off_again_s: f64,
    /// and after this before the first waypoint.
    pub off_again_first_s: f64,
    /// Wrong way: the heading is off by more than this
    pub wrong_way_deg: f64,
    /// for more than this,
    pub wrong_way_m: f64,
    /// told at most once in this time.
    pub wrong_way_again_s: f64,
    /// Stopped: moved less than this
    pub stopped_m: f64,
    /// in this time,
    pub stopped_s: f64,
    /// told again once after this.
    pub stopped_again_s: f64,
    /// A pose older than this stops the walker.
    pub stale_s: f64,
    /// "Stop" is repeated after this.
    pub stop_again_s: f64,
    /// Poses must be good for this long before guidance goes on.
    pub resume_s: f64,
    /// A bridged stretch that lasts this long is told.
    pub weak_s: f64,
    /// Backwards: a leg ends after this, unless it would end within 15 m anyway,
    pub leg_m: f64,
    /// or that.
    pub leg_most_m: f64,
    /// Backwards: time to look behind at the end of a leg.
    pub check_s: f64,
    /// Backwards: faster than this is told.
    pub backwards_speed: f64,
    /// Backwards: stop when so far off.
    pub backwards_off_m: f64,
    /// Backwards: an aim that is off by more than this is corrected.
    pub backwards_adjust_deg: f64,
    /// How the walker is found on the way.
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
            resume_s: 0.5,
            weak_s: 1.0,
            leg_m: 12.0,
            leg_most_m: 15.0,
            check_s: 2.0,
            backwards_speed: 0.5,
            backwards_off_m: 0.5,
            backwards_adjust_deg: 12.0,
            matcher: MatcherConfig::default(),
        }
    }
}
