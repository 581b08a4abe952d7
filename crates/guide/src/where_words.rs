//! The answer to "Where am I?" on a route: beside it or on it, and what comes next.

use crate::cue::{Next, UpcomingManeuver};
use crate::facing::Facing;
use crate::phrases::PhraseConfig;

/// A walker nearer to the route than this is on it, when he asks, metres.
const ON_ROUTE_M: f64 = 1.0;

impl PhraseConfig {
    /// Where a walker is on the route who asks: what comes next, and whether the route is where he is or to which side of him, by
    /// metres and a bearing, radians, positive left.
    pub fn where_words(
        &self,
        ahead: &UpcomingManeuver,
        away_m: f64,
        bearing_rad: f64,
        facing: Facing,
    ) -> String {
        let back = facing == Facing::Backwards;
        let beside = match away_m < ON_ROUTE_M {
            true => self.language.text("guide-on-path"),
            false => {
                let place = self.place(bearing_rad, back);
                let ids = ["guide-off-path-place", "guide-off-path-place-unmeasured"];
                self.measured(ids, away_m, &[("place", (&place).into())])
            }
        };
        match ahead.next {
            Next::End => beside,
            _ => format!("{beside} {}", self.approach(ahead, back)),
        }
    }
}
