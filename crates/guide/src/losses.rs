//! When directions are given up: tracking stays lost, or is lost again and again at one place.
//!
//! A view that the map does not know (a corridor seen from the other side) is lost each time the walker turns to it,
//! and found each time the guide lets him look round. Nothing gets better by repeating that: the walker is told so,
//! with what helps, and directions begin again once he has come on along the route.

use cairn_sensor::Stamp;

/// This many losses at one place are one too many.
const LOSSES: u32 = 3;
/// How far apart along the route they may be to count as one place, metres.
const NEAR_M: f64 = 2.0;
/// How soon after it was found the place must be lost again to count, seconds.
const AGAIN_S: f64 = 30.0;
/// Looking round is given up when tracking stays lost for this long, seconds.
const LOST_S: f64 = 60.0;

/// The latest losses of tracking.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Losses {
    /// Metres along the route of the first of them.
    at_m: f64,
    count: u32,
    /// When the last one began, and when guidance last went on after one.
    since: Option<Stamp>,
    resumed: Option<Stamp>,
}

impl Losses {
    /// Tracking has just been lost while the walker was guided.
    pub fn begin(&mut self, at_m: f64, now: Stamp) {
        let again = self.resumed.is_some_and(|t| now - t <= AGAIN_S) && self.is_near(at_m);
        *self = match again {
            true => Self { count: self.count + 1, since: Some(now), ..*self },
            false => Self { at_m, count: 1, since: Some(now), resumed: None },
        };
    }

    /// Guidance goes on.
    pub fn resume(&mut self, now: Stamp) {
        self.resumed = Some(now);
    }

    /// While tracking is lost: whether looking round has been given up.
    pub fn are_final(&self, now: Stamp) -> bool {
        self.count >= LOSSES || self.since.is_some_and(|t| now - t >= LOST_S)
    }

    /// With a pose: whether tracking would only be lost here again.
    pub fn are_final_at(&self, along_m: f64) -> bool {
        self.count >= LOSSES && self.is_near(along_m)
    }

    fn is_near(&self, along_m: f64) -> bool {
        (along_m - self.at_m).abs() <= NEAR_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Losses at these times (seconds) and metres along the route, each found after 5 s.
    fn after(each: &[(f64, f64)]) -> Losses {
        let mut losses = Losses::default();
        for (t, at_m) in each {
            losses.begin(*at_m, Stamp::from_seconds(*t));
            losses.resume(Stamp::from_seconds(t + 5.0));
        }
        losses
    }

    #[test]
    fn three_losses_at_one_place_are_final_there_alone() {
        let losses = after(&[(10.0, 8.0), (20.0, 9.0), (30.0, 7.0)]);
        assert!(losses.are_final_at(8.5) && !losses.are_final_at(12.0));
        assert!(!after(&[(10.0, 8.0), (20.0, 9.0)]).are_final_at(8.5));
    }

    #[test]
    fn losses_apart_in_time_or_along_the_route_are_not() {
        for each in [[(10.0, 8.0), (60.0, 8.0), (110.0, 8.0)], [(10.0, 8.0), (20.0, 11.0), (30.0, 14.0)]] {
            let losses = after(&each);
            assert!(each.iter().all(|(_, at_m)| !losses.are_final_at(*at_m)), "{losses:?}");
        }
    }

    #[test]
    fn a_minute_of_one_loss_is_final_until_it_ends() {
        let losses = after(&[(10.0, 8.0)]);
        assert!(!losses.are_final(Stamp::from_seconds(69.0)) && losses.are_final(Stamp::from_seconds(70.0)));
        assert!(!losses.are_final_at(8.0), "a covered camera may come back");
    }
}
