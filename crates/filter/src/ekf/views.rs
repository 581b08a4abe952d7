//! How much each sighting says that the sightings before it did not: errors of successive sightings of one thing from nearly the same
//! position are correlated.
//!
//! In: motions by odometry and sightings, before it is known of what they are. Out: a weight for each sighting, the same for all answers
//! of [`super::Hypotheses`], so that they stay comparable.

use super::landmark::FilterError;
use crate::log::Sighting;
use crate::motion::Motion;
use cairn_geometry::{Se2, Vec2};
use nalgebra::Vector3;

/// A sighting this near to a former one, by odometry, is of the same thing, in metres.
const NEAR_M: f64 = 0.5;
/// What was seen is forgotten when the robot has travelled this far since, in metres: odometry drifts.
const FORGET_M: f64 = 3.0;
/// Correlation of the errors of successive sightings from one position. A difference between two answers that stays the same from sighting
/// to sighting then weighs `(1 - c) / (1 + c)` each time (first-order autoregression).
const CORRELATION: f64 = 0.95;

/// What a robot saw last.
#[derive(Clone, Debug, Default)]
pub(super) struct Views {
    robots: Vec<Viewer>,
}

#[derive(Clone, Debug)]
struct Viewer {
    /// By odometry alone, from where it was added.
    start_from_body: Se2,
    travelled_m: f64,
    things: Vec<Thing>,
}

/// Something seen.
#[derive(Clone, Copy, Debug)]
struct Thing {
    /// In metres, in the frame of [`Viewer::start_from_body`].
    at: Vec2,
    /// Distance that the robot had travelled when it was last counted in full, and when it was last seen, in metres.
    counted_at_m: f64,
    seen_at_m: f64,
}

impl Views {
    pub fn add_robot(&mut self) {
        self.robots.push(Viewer { start_from_body: Se2::identity(), travelled_m: 0.0, things: Vec::new() });
    }

    pub fn predict(&mut self, robot: usize, motion: &Motion) -> Result<(), FilterError> {
        let viewer = self.robots.get_mut(robot).ok_or(FilterError::NoRobot(robot))?;
        viewer.start_from_body = viewer.start_from_body * motion.before_from_after;
        viewer.travelled_m += motion.before_from_after.translation.norm();
        Ok(())
    }

    /// The weight of each sighting of an instant: 1 for what is seen for the first time, or again after `spacing_m` metres of way.
    pub fn weights(&mut self, robot: usize, sightings: &[Sighting], spacing_m: f64) -> Vec<f64> {
        let Some(viewer) = self.robots.get_mut(robot) else { return vec![1.0; sightings.len()] };
        let (pose, now_m) = (viewer.start_from_body, viewer.travelled_m);
        viewer.things.retain(|t| now_m - t.seen_at_m <= FORGET_M);
        let observer = Vector3::new(pose.translation.x, pose.translation.y, pose.rotation.log());
        let weight = |s: &Sighting| {
            let Some(at) = s.measurement.target(&observer) else { return 1.0 };
            let near = viewer.things.iter_mut().filter(|t| (t.at - at).norm() <= NEAR_M);
            match near.min_by(|a, b| (a.at - at).norm().total_cmp(&(b.at - at).norm())) {
                Some(thing) => {
                    (thing.at, thing.seen_at_m) = (at, now_m);
                    let again = now_m - thing.counted_at_m < spacing_m;
                    thing.counted_at_m = if again { thing.counted_at_m } else { now_m };
                    if again { (1.0 - CORRELATION) / (1.0 + CORRELATION) } else { 1.0 }
                }
                None => {
                    viewer.things.push(Thing { at, counted_at_m: now_m, seen_at_m: now_m });
                    1.0
                }
            }
        };
        sightings.iter().map(weight).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Target;
    use crate::measure::Measurement;
    use nalgebra::Matrix3;

    fn seen(range_m: f64, bearing_rad: f64) -> Sighting {
        let measurement = Measurement::range_bearing(range_m, bearing_rad, 0.1, 0.01).unwrap();
        Sighting { target: Target::Unlabelled, measurement }
    }

    #[test]
    fn the_same_thing_from_the_same_place_counts_once() {
        let mut views = Views::default();
        views.add_robot();
        let again = (1.0 - CORRELATION) / (1.0 + CORRELATION);
        assert_eq!(views.weights(0, &[seen(4.0, 0.0), seen(4.0, 0.5)], 0.5), [1.0, 1.0], "two new things");
        assert_eq!(
            views.weights(0, &[seen(4.1, 0.01), seen(2.0, -0.5)], 0.5),
            [again, 1.0],
            "the second is new"
        );
        let go = |views: &mut Views, way_m: f64, turn_rad: f64| {
            let before_from_after = Se2::from_xy_angle(way_m, 0.0, turn_rad);
            views.predict(0, &Motion { before_from_after, covariance: Matrix3::zeros() }).unwrap();
        };
        // A turn on the spot is no other position.
        go(&mut views, 0.0, 0.4);
        assert_eq!(views.weights(0, &[seen(4.1, -0.4)], 0.5), [again]);
        go(&mut views, 0.6, 0.0);
        let onwards = views.weights(0, &[seen(3.6, -0.46)], 0.5);
        assert_eq!((onwards, views.weights(0, &[seen(3.6, -0.46)], 0.5)), (vec![1.0], vec![again]));
        // After a long way it is new again, and so is a range alone, of which nobody knows what it is of.
        go(&mut views, 4.0, 0.0);
        go(&mut views, -4.0, 0.0);
        let range =
            Sighting { target: Target::Unlabelled, measurement: Measurement::range(3.0, 0.1).unwrap() };
        assert_eq!(views.weights(0, &[seen(3.6, -0.46), range], 0.5), [1.0, 1.0]);
        assert!(views.predict(1, &Motion::identity()).is_err());
    }
}
