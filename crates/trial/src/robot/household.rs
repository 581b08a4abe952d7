//! The apartment around the robot: people who walk from room to room, a door that closes, and what is where in truth.

use super::RobotConfig;
use cairn_geometry::{Se2, Vec2};
use cairn_sim::{Figure, World, WorldOptions};
use std::sync::Arc;

/// Radius of a person, metres.
pub const PERSON_RADIUS_M: f64 = 0.25;
/// A person stops for a robot this near in the walking direction, metres between the centres.
const STOPS_FOR_M: f64 = 0.9;
/// A person who had to stop turns back after this time, seconds.
const PATIENCE_S: f64 = 3.0;
/// Radians of swing of arms and legs for each metre.
const SWING_PER_M: f64 = 4.4;

/// A person who walks to and fro along a line, stops for a robot in the way, and turns back when it stays there.
#[derive(Clone, Debug)]
pub struct Person {
    line: Vec<Vec2>,
    along_m: f64,
    forwards: bool,
    speed: f64,
    waited_s: f64,
    clothes: usize,
}

impl Person {
    /// At a share (0 to 1) of a line of at least two points.
    fn new(line: Vec<Vec2>, share: f64, speed: f64, clothes: usize) -> Self {
        let length: f64 = line.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        Self { line, along_m: share * length, forwards: true, speed, waited_s: 0.0, clothes }
    }

    fn length_m(&self) -> f64 {
        self.line.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }

    /// Position and walking direction.
    fn place(&self) -> (Vec2, Vec2) {
        let mut left = self.along_m;
        let mut at = (self.line.first().copied().unwrap_or_default(), Vec2::x());
        for w in self.line.windows(2) {
            let long = (w[1] - w[0]).norm();
            let direction = (w[1] - w[0]) / long.max(1e-9);
            at = (w[0] + direction * left.min(long), direction);
            left -= long;
            if left <= 0.0 {
                break;
            }
        }
        (at.0, if self.forwards { at.1 } else { -at.1 })
    }

    fn step(&mut self, dt: f64, robot: Vec2) {
        let (at, direction) = self.place();
        let off = robot - at;
        let in_the_way = off.norm() < STOPS_FOR_M && off.dot(&direction) > 0.3 * off.norm();
        if in_the_way {
            self.waited_s += dt;
            if self.waited_s > PATIENCE_S {
                (self.forwards, self.waited_s) = (!self.forwards, 0.0);
            }
            return;
        }
        self.waited_s = 0.0;
        self.along_m += if self.forwards { self.speed * dt } else { -self.speed * dt };
        if self.along_m <= 0.0 || self.along_m >= self.length_m() {
            self.along_m = self.along_m.clamp(0.0, self.length_m());
            self.forwards = !self.forwards;
        }
    }

    fn figure(&self) -> Figure {
        let (at, direction) = self.place();
        let heading = direction.y.atan2(direction.x);
        Figure { clothes: self.clothes, at, heading, swing: self.along_m * SWING_PER_M }
    }
}

/// The apartment, its people and its doors.
pub struct Household {
    open: Arc<World>,
    closed: Arc<World>,
    is_closed: bool,
    people: Vec<Person>,
}

/// Which door closes: that from the corridor into the first room, which has a second one from its neighbour.
const DOOR: usize = 0;

impl Household {
    /// Builds the apartment of a trial, with its doors open.
    pub fn new(config: &RobotConfig) -> Self {
        let sim = &config.sim;
        let build = |options: &WorldOptions| Arc::new(World::build(sim.world, sim.seed, options));
        let open = build(&sim.options);
        let closed = build(&WorldOptions { closed_door: Some(DOOR), ..sim.options });
        let people = people(&open, config);
        Self { open, closed, is_closed: false, people }
    }

    /// The world as it is now.
    pub fn world(&self) -> &Arc<World> {
        if self.is_closed { &self.closed } else { &self.open }
    }

    /// Where the robot is switched on: at the left end of the corridor, looking along it.
    pub fn start(&self) -> Se2 {
        let route = self.open.route("corridor").map(|r| r.points.as_slice());
        let at = route.and_then(<[Vec2]>::first).copied().unwrap_or_default();
        Se2::from_xy_angle(at.x, at.y, 0.0)
    }

    /// Moves everyone; the robot stands at `robot`.
    pub fn step(&mut self, dt: f64, robot: Vec2) {
        self.people.iter_mut().for_each(|p| p.step(dt, robot));
    }

    /// The people as they are drawn.
    pub fn figures(&self) -> Vec<Figure> {
        self.people.iter().map(Person::figure).collect()
    }

    /// Closes the door if nobody stands in it; returns whether it is closed now.
    pub fn close_door(&mut self, robot: Vec2) -> bool {
        let Some(&(a, b)) = self.open.doors().get(DOOR) else { return false };
        let middle = (a + b) / 2.0;
        let far = |p: Vec2| (p - middle).norm() > 1.0;
        self.is_closed |= far(robot) && self.people.iter().all(|p| far(p.place().0));
        self.is_closed
    }

    /// Metres from a point to the nearest wall, piece of furniture or closed door.
    pub fn to_wall_m(&self, at: Vec2) -> f64 {
        self.world().clearance(at.x, at.y)
    }

    /// Metres from a point to the rim of the nearest person.
    pub fn to_person_m(&self, at: Vec2) -> f64 {
        let to = |p: &Person| (p.place().0 - at).norm() - PERSON_RADIUS_M;
        self.people.iter().map(to).fold(f64::INFINITY, f64::min)
    }
}

/// One person walks along the corridor, one between two rooms on either side of it; more take turns.
fn people(world: &World, config: &RobotConfig) -> Vec<Person> {
    let mut random = cairn_random::Random::new(config.seed ^ 0x9E09_1E5D);
    let corridor: Vec<Vec2> = world.route("corridor").map(|r| r.points.clone()).unwrap_or_default();
    let (places, doors) = (world.places(), world.doors());
    let across: Vec<Vec2> = match (places, doors) {
        ([_, _, up, _, down], [_, _, up_door, _, down_door, ..]) => {
            let middle = |d: &(Vec2, Vec2)| (d.0 + d.1) / 2.0;
            let corridor_y = corridor.first().map_or(0.0, |p| p.y);
            let (a, b) = (middle(down_door), middle(up_door));
            vec![down.1, a, Vec2::new(a.x, corridor_y), Vec2::new(b.x, corridor_y), b, up.1]
        }
        _ => Vec::new(),
    };
    let lines = [corridor, across];
    (0..config.people)
        .filter_map(|i| {
            let mut line = lines[i % 2].clone();
            if i % 2 == 0 {
                // Beside the middle of the corridor, from its far end.
                let aside = random.uniform(-0.25, 0.25);
                line.iter_mut().for_each(|p| p.y += aside);
                line.reverse();
            }
            let (share, speed) = (random.uniform(0.0, 0.5), random.uniform(0.5, 0.9));
            (line.len() > 1).then(|| Person::new(line, share, speed, i))
        })
        .collect()
}
