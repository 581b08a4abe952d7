//! What the unit of length of a pose rests on, with one camera and no IMU, and whether that is enough for directions.

use cairn_guide::GuideState;

/// Longest time for turning around on the spot, seconds: for this long a monocular camera may rely on the previous
/// scale.
const TURN_ABOUT_S: f64 = 8.0;

/// In a map with a unit of its own a walker whose camera sees what it saw on the way out is led straight on for so many metres, by the
/// unit that the map was begun with (it may be half or twice as long),
const STRAIGHT_ON_M: f64 = 2.0;
/// where at least so many lie before the next thing to do,
const FREE_M: f64 = 5.0;
/// and the map began at a place known to within so many metres and radians: standard deviations.
const BEGAN_WITHIN_M: f64 = 1.0;
const BEGAN_WITHIN_RAD: f64 = 0.15;

/// What the last pose's unit of length rests on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScaleBasis {
    /// What the guide is doing.
    pub state: GuideState,
    /// The pose is in a map that has no common unit with the route's.
    pub other_map: Option<OtherMap>,
    /// For how long scale has been unsupported since guidance was asked for, seconds; `None` where it is supported. What
    /// was before, such as turning the camera round on the chest, is not the walker's turn.
    pub unsupported_s: Option<f64>,
}

/// A map with a unit of its own, that was begun while the walker was guided.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OtherMap {
    /// Standard deviations of where it began in the map before: metres, and radians.
    pub began_within: [f64; 2],
    /// Metres walked in it, by the unit that it was begun with.
    pub walked_m: f64,
    /// Metres on the route to the next thing to do; 0 where that is not known.
    pub to_next_m: f64,
    /// Whether the camera sees what it saw on the way out: then a place is soon recognised, and the unit with it.
    pub sees_way_out: bool,
}

impl OtherMap {
    /// Whether the walker may be led straight on for a few steps. The direction needs no unit, and a place that he sees again gives
    /// one: in front of a wall that he has never seen so near he would stand forever.
    fn may_go_straight_on(&self) -> bool {
        let [metres, radians] = self.began_within;
        self.sees_way_out
            && metres < BEGAN_WITHIN_M
            && radians < BEGAN_WITHIN_RAD
            && self.walked_m < STRAIGHT_ON_M
            && self.to_next_m > FREE_M
    }
}

impl ScaleBasis {
    /// Whether no direction may be given. While the walker turns on the spot nothing depends on scale: how far he has
    /// turned needs no unit, and after the turn the camera may see what it knows.
    pub fn rules_out_directions(&self) -> bool {
        let too_long = self.unsupported_s.is_some_and(|s| s > TURN_ABOUT_S);
        let elsewhere = self.other_map.is_some_and(|map| !map.may_go_straight_on());
        self.state != GuideState::Turning && (elsewhere || too_long)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEAR: OtherMap =
        OtherMap { began_within: [0.5, 0.1], walked_m: 0.3, to_next_m: 9.0, sees_way_out: true };

    #[test]
    fn turn_is_finished_before_scale_is_asked_for() {
        let other = Some(OtherMap { sees_way_out: false, ..NEAR });
        let of = |state, other_map, unsupported_s| {
            ScaleBasis { state, other_map, unsupported_s }.rules_out_directions()
        };
        for state in [GuideState::Waiting, GuideState::Moving, GuideState::SteppingAside] {
            assert!(!of(state, None, None) && !of(state, None, Some(7.0)));
            assert!(of(state, other, None) && of(state, None, Some(8.5)), "{state:?}");
        }
        assert!(!of(GuideState::Turning, other, Some(20.0)));
    }

    #[test]
    fn few_steps_straight_on_need_no_unit_where_the_way_out_comes_into_view() {
        let ruled_out = |map| {
            ScaleBasis { state: GuideState::Moving, other_map: Some(map), unsupported_s: None }
                .rules_out_directions()
        };
        assert!(!ruled_out(NEAR));
        for (why, map) in [
            ("the camera looks home", OtherMap { sees_way_out: false, ..NEAR }),
            ("he has walked on without recognising a place", OtherMap { walked_m: 2.1, ..NEAR }),
            ("the next turn may be right ahead", OtherMap { to_next_m: 4.5, ..NEAR }),
            ("where the map began is not known", OtherMap { began_within: [1.5, 0.1], ..NEAR }),
            ("in which direction it began is not known", OtherMap { began_within: [0.5, 0.3], ..NEAR }),
        ] {
            assert!(ruled_out(map), "{why}");
        }
    }
}
