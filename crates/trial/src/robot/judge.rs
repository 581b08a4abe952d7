//! The judge: collisions and arrivals by the truth of the simulated world.

use super::household::Household;
use cairn_geometry::Vec2;
use serde::Serialize;

/// Once touching, a robot must get this far away before another touch is counted, metres.
const APART_M: f64 = 0.02;

/// What was touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Touched {
    /// A wall, a piece of furniture or a closed door.
    Wall,
    /// A person.
    Person,
}

/// A touch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Collision {
    /// When, seconds.
    pub t_s: f64,
    /// Where the robot was, metres.
    pub at: [f64; 2],
    /// What was touched.
    pub with: Touched,
    /// Speed of the robot, m/s.
    pub speed: f64,
}

/// Watches the true pose of the robot.
#[derive(Clone, Debug)]
pub struct Judge {
    radius_m: f64,
    touching: [bool; 2],
    last: Option<Vec2>,
    /// All collisions, in order.
    pub collisions: Vec<Collision>,
    /// Least distance from the rim of the robot to a wall, metres.
    pub wall_clearance_m: f64,
    /// Least distance from the rim of the robot to a person, metres.
    pub person_clearance_m: f64,
    /// Distance driven, metres.
    pub driven_m: f64,
}

impl Judge {
    /// For a robot of this radius.
    pub fn new(radius_m: f64) -> Self {
        Self {
            radius_m,
            touching: [false; 2],
            last: None,
            collisions: Vec::new(),
            wall_clearance_m: f64::INFINITY,
            person_clearance_m: f64::INFINITY,
            driven_m: 0.0,
        }
    }

    /// Sees the robot at a place at a time.
    pub fn see(&mut self, t_s: f64, at: Vec2, speed: f64, household: &Household) {
        self.driven_m += self.last.replace(at).map_or(0.0, |last| (at - last).norm());
        let wall = household.to_wall_m(at) - self.radius_m;
        let person = household.to_person_m(at) - self.radius_m;
        self.wall_clearance_m = self.wall_clearance_m.min(wall);
        self.person_clearance_m = self.person_clearance_m.min(person);
        for (k, (clear_m, with)) in [(wall, Touched::Wall), (person, Touched::Person)].into_iter().enumerate()
        {
            if clear_m < 0.0 && !self.touching[k] {
                self.collisions.push(Collision { t_s, at: at.into(), with, speed });
            }
            self.touching[k] = clear_m < if self.touching[k] { APART_M } else { 0.0 };
        }
    }
}
