//! A step that a walker has been told to make, and what comes of it.
//!
//! In: where he is and whether he stands, at each look. Out: whether it is still due, made, or not made.

use super::past::of_step;
use cairn_geometry::Vec2;
use cairn_guide::{Heading, Step};
use cairn_sensor::Stamp;

/// A step is made within this time, seconds.
const LONGEST_S: f64 = 10.0;
/// Who stands after so much of it has made it.
const MADE: f64 = 0.4;
/// Who has got so far, metres, and less than half of that along the step, went elsewhere: while he walks, and where he stands.
const ASTRAY_M: [f64; 2] = [0.25, 0.12];

/// A step under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stepping {
    pub step: Step,
    pub from: Vec2,
    /// Where it leads.
    pub to: Vec2,
    since: Stamp,
}

/// What has come of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outcome {
    Due,
    Made,
    /// Not made in time.
    Failed,
    /// He goes elsewhere, or has.
    Astray,
}

impl Stepping {
    /// He is told to make it now.
    pub fn new(step: Step, walker: &Heading, now: Stamp) -> Self {
        let from = walker.position;
        Self { step, from, to: from + of_step(&step, walker.course), since: now }
    }

    /// What has come of it with the walker here.
    pub fn outcome(&self, here: &Vec2, stands: bool, now: Stamp) -> Outcome {
        let (moved, whole) = (here - self.from, self.to - self.from);
        let share = moved.dot(&whole) / whole.norm_squared();
        let is_astray =
            moved.norm() > ASTRAY_M[usize::from(stands)] && share * whole.norm() < 0.5 * moved.norm();
        if stands && share > MADE {
            Outcome::Made
        } else if is_astray {
            Outcome::Astray
        } else if now - self.since >= LONGEST_S {
            Outcome::Failed
        } else {
            Outcome::Due
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_made_where_he_stands_after_it_and_fails_elsewhere_or_in_time() {
        let walker = Heading { position: Vec2::new(1.0, 2.0), height: 1.3, heading: 0.0, course: 0.0 };
        let at = Stamp::from_seconds;
        let stepping = Stepping::new(Step::BackAside(1.0), &walker, at(5.0));
        let to = stepping.to - stepping.from;
        assert!(to.x < -0.3 && to.y > 0.3, "{to:?}");
        let outcome = |share: f64, stands: bool, s: f64| {
            stepping.outcome(&(walker.position + to * share), stands, at(s))
        };
        assert_eq!(outcome(0.0, true, 6.0), Outcome::Due);
        assert_eq!(outcome(0.7, false, 7.0), Outcome::Due, "he is making it");
        assert_eq!(outcome(0.7, true, 7.5), Outcome::Made);
        assert_eq!(outcome(0.2, true, 16.0), Outcome::Failed);
        let ahead = walker.position + Vec2::new(0.3, 0.0);
        assert_eq!(stepping.outcome(&ahead, false, at(6.0)), Outcome::Astray, "he goes straight on");
        let ahead = walker.position + Vec2::new(0.15, 0.0);
        assert_eq!(stepping.outcome(&ahead, false, at(6.0)), Outcome::Due);
        assert_eq!(stepping.outcome(&ahead, true, at(6.0)), Outcome::Astray, "and stands there");
    }
}
