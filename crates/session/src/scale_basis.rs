//! What the unit of length of a pose rests on, with one camera and no IMU, and whether that is enough for directions.

use cairn_guide::GuideState;

/// Longest time for turning around on the spot, seconds: for this long a monocular camera may rely on the previous
/// scale.
const TURN_ABOUT_S: f64 = 8.0;

/// What the last pose's unit of length rests on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScaleBasis {
    /// What the guide is doing.
    pub state: GuideState,
    /// The pose is in a map that has no common unit with the route's.
    pub other_map: bool,
    /// For how long scale has been unsupported since guidance was asked for, seconds; `None` where it is supported. What
    /// was before, such as turning the camera round on the chest, is not the walker's turn.
    pub unsupported_s: Option<f64>,
}

impl ScaleBasis {
    /// Whether no direction may be given. While the walker turns on the spot nothing depends on scale: how far he has
    /// turned needs no unit, and after the turn the camera may see what it knows.
    pub fn rules_out_directions(&self) -> bool {
        let too_long = self.unsupported_s.is_some_and(|s| s > TURN_ABOUT_S);
        self.state != GuideState::Turning && (self.other_map || too_long)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turn_is_finished_before_scale_is_asked_for() {
        let of = |state, other_map, unsupported_s| {
            ScaleBasis { state, other_map, unsupported_s }.rules_out_directions()
        };
        for state in [GuideState::Waiting, GuideState::Moving, GuideState::SteppingAside] {
            assert!(!of(state, false, None) && !of(state, false, Some(7.0)));
            assert!(of(state, true, None) && of(state, false, Some(8.5)), "{state:?}");
        }
        assert!(!of(GuideState::Turning, true, Some(20.0)));
    }
}
