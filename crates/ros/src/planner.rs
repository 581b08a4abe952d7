//! A goal and the path to it over the occupancy grid, in the form of Nav2: `goal_pose` in, `plan` out. The search is that of
//! `cairn::plan`; unknown ground is not entered.

use cairn::geometry::{Se2, Se3, So3, Vec2, Vec3};
use cairn::plan::control::{Limits, Navigator, NavigatorConfig, PursuitConfig, Twist};
use cairn::plan::{CostConfig, Costmap, Grid};

/// The goal is reached within this distance, metres, as by default in Nav2.
const REACHED_M: f64 = 0.25;

/// What became of a goal.
#[derive(Clone, Debug, PartialEq)]
pub enum Planned {
    /// Poses in the map from the robot to the goal, each towards the next, the last as the goal.
    Path(Vec<Se3>),
    /// The robot is there.
    Reached,
    /// Why there is no path yet.
    NoPath(String),
}

/// Plans to one goal at a time.
pub struct Planner {
    costs: CostConfig,
    goal: Option<Se3>,
}

impl Planner {
    /// For a robot of this radius.
    pub fn new(radius_m: f64) -> Self {
        let inflation_m = radius_m + 0.6;
        Self { costs: CostConfig { radius_m, inflation_m, ..CostConfig::default() }, goal: None }
    }

    /// The ground on which the robot has stood is free as far as this from its middle, metres.
    pub fn stood_m(&self) -> f64 {
        self.costs.radius_m + 2.0 * self.costs.margin_m
    }

    /// The goal in the map.
    pub fn goal(&self) -> Option<&Se3> {
        self.goal.as_ref()
    }

    /// Sets a goal, in the map.
    pub fn set_goal(&mut self, goal: Option<Se3>) {
        self.goal = goal;
    }

    /// The path from where the robot is; `None` without a goal.
    pub fn step(&mut self, map: Grid<i8>, map_from_base: &Se3) -> Option<Planned> {
        let goal = self.goal?;
        let at = |pose: &Se3| Vec2::new(pose.translation.x, pose.translation.y);
        if (at(map_from_base) - at(&goal)).norm() < REACHED_M {
            self.goal = None;
            return Some(Planned::Reached);
        }
        let costs = match Costmap::new(map, self.costs) {
            Ok(costs) => costs,
            Err(e) => return Some(Planned::NoPath(e.to_string())),
        };
        // Another program drives: of the navigator only its path is wanted.
        let pursuit = PursuitConfig::new(Limits::differential_drive());
        let mut navigator = Navigator::new(NavigatorConfig::new(pursuit));
        navigator.set_goal(at(&goal));
        let start = Se2::from_xy_angle(map_from_base.translation.x, map_from_base.translation.y, 0.0);
        let step = navigator.step(0.0, &start, Twist::stop(), &costs, None);
        Some(match navigator.path() {
            Some(path) => Planned::Path(poses(path.points(), &goal)),
            None => Planned::NoPath(step.reason.map_or_else(|| "no reason".into(), |r| r.to_string())),
        })
    }
}

/// Points on the ground as poses along the line, the last one the goal's.
fn poses(points: &[Vec2], goal: &Se3) -> Vec<Se3> {
    let along = points.windows(2).map(|w| {
        let ahead = w[1] - w[0];
        let heading = So3::exp(&(Vec3::z() * ahead.y.atan2(ahead.x)));
        Se3::new(heading, Vec3::new(w[0].x, w[0].y, 0.0))
    });
    along.chain([*goal]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn::plan::GridFrame;

    /// A room of 6 m x 4 m with a wall across it that ends 1 m before the far wall; beyond 5 m nothing is known.
    fn room() -> Grid<i8> {
        let frame = GridFrame::new(120, 80, 0.05, Se2::identity()).unwrap();
        let mut map = Grid::filled(frame, 0i8);
        for y in 0..80 {
            for x in 0..120 {
                let value = match (x, y) {
                    (60, 0..60) | (_, 79) => 100,
                    (100.., _) => -1,
                    _ => 0,
                };
                map.values_mut()[y * 120 + x] = value;
            }
        }
        map
    }

    fn at(x: f64, y: f64, heading: f64) -> Se3 {
        Se3::new(So3::exp(&(Vec3::z() * heading)), Vec3::new(x, y, 0.0))
    }

    #[test]
    fn the_path_goes_around_the_wall_and_ends_as_the_goal() {
        let mut planner = Planner::new(0.2);
        assert_eq!(planner.step(room(), &at(1.0, 1.0, 2.0)), None);
        let goal = at(4.4, 1.0, -1.2);
        planner.set_goal(Some(goal));
        let Some(Planned::Path(path)) = planner.step(room(), &at(1.0, 1.0, 2.0)) else { panic!("no path") };
        assert_eq!(path.last(), Some(&goal));
        assert!((path[0].translation - Vec3::new(1.0, 1.0, 0.0)).norm() < 1e-9);
        let least =
            path.iter().map(|p| (p.translation - Vec3::new(3.025, 2.975, 0.0)).norm()).fold(9.0, f64::min);
        assert!(least > 0.2 && least < 0.8, "{least} m from the end of the wall");
        for w in path.windows(2) {
            let step = w[1].translation - w[0].translation;
            assert!(step.norm() < 0.3 && (w[0].rotation * Vec3::x()).dot(&step) > 0.999 * step.norm());
        }
        // There, whatever the heading: the goal is done with.
        assert_eq!(planner.step(room(), &at(4.3, 1.1, 0.0)), Some(Planned::Reached));
        assert_eq!(planner.step(room(), &at(1.0, 1.0, 0.0)), None);
    }

    #[test]
    fn what_cannot_be_reached_has_its_reason() {
        let mut planner = Planner::new(0.2);
        for (goal, words) in [
            (at(5.5, 2.0, 0.0), "unknown ground"),
            (at(7.0, 0.0, 0.0), "outside"),
            (at(3.0, 1.0, 0.0), "too near"),
        ] {
            planner.set_goal(Some(goal));
            let planned = planner.step(room(), &at(1.0, 1.0, 0.0));
            assert!(matches!(&planned, Some(Planned::NoPath(why)) if why.contains(words)), "{planned:?}");
            assert!(planner.goal().is_some(), "the map may grow");
        }
        // A robot as wide as the gap.
        let mut wide = Planner::new(0.6);
        wide.set_goal(Some(at(4.0, 2.0, 0.0)));
        assert!(matches!(wide.step(room(), &at(1.5, 2.0, 0.0)), Some(Planned::NoPath(_))));
    }
}
