//! Where a walker truly is on a route, and whether words send him away from it.

use cairn_geometry::Vec2;
use cairn_guide::{Facing, Heading, ManeuverPlan, Match, Matcher, MatcherConfig, Side, heading_of, wrap};
use cairn_sensor::Stamp;
use std::f64::consts::PI;

/// So far from a sharp corner its two legs lie within reach of each other, metres along each.
const HAIRPIN_M: f64 = 8.0;
/// A turn to the other side by less than this is not yet away from the route, degrees.
const AWAY_DEG: f64 = 20.0;
/// From here on both sides lead there, degrees.
const EITHER_DEG: f64 = 150.0;

/// What the words that name a side ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// A step to that side.
    Aside,
    /// To turn at a corner.
    Round,
    /// To turn or bear along the route.
    Along,
    /// Either of the last two: the words alone do not say which.
    RoundOrAlong,
}

/// A route, and where a walker truly is on it.
#[derive(Clone, Debug)]
pub struct RouteTruth {
    plan: ManeuverPlan,
    facing: Facing,
    off_m: f64,
    pub(super) matcher: Matcher,
    at: Option<Match>,
}

impl RouteTruth {
    /// At its beginning; who is farther than `off_m` beside it is off it.
    pub fn new(plan: ManeuverPlan, facing: Facing, off_m: f64) -> Self {
        Self { plan, facing, off_m, matcher: Matcher::new(MatcherConfig::default()), at: None }
    }

    /// Takes where the walker is: x, y in metres, heading in radians.
    pub fn see(&mut self, walker: (f64, f64, f64), now: Stamp) -> Match {
        let truth = self.heading(walker);
        self.pass_hairpin(&truth);
        let at = self.matcher.update(&self.plan, &truth.position, now);
        self.at = Some(at);
        at
    }

    /// Where the walker was on the route when last seen.
    pub fn place(&self) -> Option<Match> {
        self.at
    }

    /// Metres from a walker to the end of the route.
    pub fn from_end_m(&self, walker: (f64, f64, f64)) -> f64 {
        (self.heading(walker).position - self.plan.end()).norm()
    }

    /// The turns that lead a walker to the points one metre and three ahead on the route, radians, positive to the left.
    pub fn turns(&self, walker: (f64, f64, f64)) -> [f64; 2] {
        let truth = self.heading(walker);
        self.turns_at(&truth, self.at.map_or(0.0, |m| m.along_m))
    }

    fn turns_at(&self, truth: &Heading, along_m: f64) -> [f64; 2] {
        [1.0, 3.0].map(|ahead| {
            let target = self.plan.point_at((along_m + ahead).min(self.plan.length()));
            turn_to(truth, heading_of(&(target - truth.position)))
        })
    }

    /// Whether words that name a side send a walker away from the route. `place_m`: where their speaker takes him to be, metres along.
    pub fn is_wrong(&self, side: Side, sent: Sent, walker: (f64, f64, f64), place_m: Option<f64>) -> bool {
        let truth = self.heading(walker);
        let along_m = self.at.map_or(0.0, |m| m.along_m);
        // Where two legs lie within reach of each other, or the walker is as near to either, the words may refer to either. Who has
        // turned at a hairpin goes along the leg after it, however far beside it he turned.
        let there = place_m.filter(|m| {
            let reach_m = self.off_m.max(self.away(along_m, &truth));
            self.away(*m, &truth) <= reach_m && (*m - along_m).abs() > 1.0
        });
        [Some(along_m), there, self.faced_leg(&truth).map(|leg| leg[1])].into_iter().flatten().all(|m| {
            match sent {
                Sent::Aside => Self::against(side, to_left(&truth, self.plan.point_at(m)), 0.1),
                Sent::Round => self.is_wrong_turn(side, &truth, m),
                Sent::Along => self.is_wrong_way(side, &truth, m),
                Sent::RoundOrAlong => {
                    self.is_wrong_turn(side, &truth, m) && self.is_wrong_way(side, &truth, m)
                }
            }
        })
    }

    fn heading(&self, (x, y, heading): (f64, f64, f64)) -> Heading {
        let course = if self.facing == Facing::Backwards { wrap(heading + PI) } else { heading };
        Heading { position: Vec2::new(x, y), height: 1.3, heading, course }
    }

    fn against(side: Side, needed: f64, limit: f64) -> bool {
        match side {
            Side::Left => needed < -limit,
            Side::Right => needed > limit,
        }
    }

    /// None of the corners here turns to that side, seen from the walker's heading.
    fn is_wrong_turn(&self, side: Side, truth: &Heading, along_m: f64) -> bool {
        let here = |m: &&cairn_guide::Maneuver| {
            m.turn_rad != 0.0 && m.at_m - along_m < 4.0 && along_m - m.end_m < 4.0
        };
        !self.plan.maneuvers().iter().filter(here).any(|m| {
            let needed = turn_to(truth, m.exit_heading);
            !Self::against(side, needed, AWAY_DEG.to_radians()) || needed.abs() >= EITHER_DEG.to_radians()
        })
    }

    /// Away from the route at look-ahead distances of both one and three metres.
    fn is_wrong_way(&self, side: Side, truth: &Heading, along_m: f64) -> bool {
        self.turns_at(truth, along_m).into_iter().all(|needed| {
            Self::against(side, needed, AWAY_DEG.to_radians()) && needed.abs() < EITHER_DEG.to_radians()
        })
    }

    /// The leg after a hairpin, for a walker who faces along it: metres along the route of its begin and of its nearest point. Where
    /// two legs lie at an acute angle the matcher alone would keep him on the first, backwards, while he goes away from it.
    fn faced_leg(&self, truth: &Heading) -> Option<[f64; 2]> {
        let along_m = self.at?.along_m;
        let corners: Vec<_> = self.plan.maneuvers().iter().filter(|m| m.turn_rad != 0.0).collect();
        let taken = (0..corners.len()).find(|k| {
            let m = corners[*k];
            // No other corner lies between the walker and this one.
            let next = (*k == 0 || corners[k - 1].end_m <= along_m)
                && corners.get(k + 1).is_none_or(|after| along_m <= after.at_m);
            let near = (m.at_m - along_m).abs() <= HAIRPIN_M;
            let faces = turn_to(truth, m.exit_heading).abs() < PI / 3.0;
            next && near && faces && m.turn_rad.abs() > PI / 2.0
        })?;
        let end_m = corners[taken].end_m;
        // Not farther than that leg goes: the one after it may cross the leg that the walker is on.
        let leg_m = corners.get(taken + 1).map_or(self.plan.length(), |next| next.at_m) - end_m;
        let steps = (HAIRPIN_M.min(leg_m) / 0.1) as usize;
        let after = (0..=steps).map(|k| end_m + 0.1 * k as f64);
        let nearest = after.min_by(|a, b| self.away(*a, truth).total_cmp(&self.away(*b, truth)))?;
        Some([end_m, nearest])
    }

    /// Metres from the walker to the route at a distance along it.
    fn away(&self, along_m: f64, truth: &Heading) -> f64 {
        (self.plan.point_at(along_m) - truth.position).norm()
    }

    /// A walker who faces along the leg after a hairpin and is nearer to it than to the leg before is on it.
    fn pass_hairpin(&mut self, truth: &Heading) {
        let (Some(at), Some([end_m, nearest_m])) = (self.at, self.faced_leg(truth)) else { return };
        if self.away(nearest_m, truth) < self.away(at.along_m, truth) {
            self.matcher.pass(end_m);
        }
    }
}

// Not those of the guide, which may be wrong.

/// The turn from a walker's course to a heading, radians, positive to the left.
fn turn_to(walker: &Heading, heading: f64) -> f64 {
    wrap(heading - walker.course)
}

/// Metres from a walker to a point, to the left of where the chest looks.
fn to_left(walker: &Heading, point: Vec2) -> f64 {
    let to = point - walker.position;
    to.y * walker.heading.cos() - to.x * walker.heading.sin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;
    use cairn_guide::{Ground, ManeuverPlanConfig};

    /// The leg after the next one crosses the leg that the walker is on: being near to it is not being past a hairpin before it.
    #[test]
    fn a_walker_near_a_crossing_is_not_past_the_hairpin_before_it() {
        let corners = [[-0.9, 7.2], [-2.7, 9.1], [-4.5, 7.2], [-5.2, 9.3], [-2.5, 10.7], [-3.4, -3.0]];
        let line: Vec<Vec3> = corners.iter().map(|c| Vec3::new(c[0], c[1], 0.0)).collect();
        let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
        let mut truth = RouteTruth::new(plan, Facing::Home, 1.5);
        for k in 0..3 {
            truth.see((-2.2, 7.7, 2.06), Stamp::from_seconds(0.05 * f64::from(k)));
        }
        let along_m = truth.place().unwrap().along_m;
        assert!((0.9..1.6).contains(&along_m), "{along_m}");
    }
}
