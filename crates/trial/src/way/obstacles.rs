//! Things put into the way after the route was recorded, and what became of the walker at them.
//!
//! They are in no map and no floor plan, and the walker's cane does not feel them: only the words keep him from them. Truth
//! is used to place them and to judge, never by the guide.

use cairn_geometry::{Vec2, Vec3};
use cairn_random::Random;
use cairn_sim::{Thing, World};

/// Radius of the body, metres: half the width of a person, the least distance to a wall.
pub const BODY_M: f64 = 0.25;
/// Metres between things, and from them to the corners and ends of the route.
const APART_M: f64 = 5.0;
const FROM_CORNERS_M: f64 = 3.0;
/// A barrier is taken away when the walker has stood before it for this long, seconds, ...
const AWAY_S: f64 = 6.0;
/// ... within this distance, metres.
const BEFORE_M: f64 = 4.0;
/// A stop is false when nothing is within this distance of the way straight ahead or along the route, metres, ...
const FALSE_M: f64 = 0.45;
/// ... so far ahead, metres.
const AHEAD_M: f64 = 3.6;

/// The things in the way of one walker.
#[derive(Default)]
pub struct Obstacles {
    /// All of them; a barrier that was taken away is gone.
    things: Vec<(Thing, Kind)>,
    /// How many were put in.
    pub count: usize,
    stood_s: f64,
    touching: bool,
    /// How often the walker began to touch one.
    pub touched: usize,
    /// Stops for something in the way, and those where nothing was.
    pub stops: usize,
    /// Of these, where nothing was near.
    pub false_stops: usize,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Stays,
    IsTakenAway,
}

impl Obstacles {
    /// Places things along the legs of a route (corners, metres), in turn a box on the floor, one at head height, and a
    /// barrier across the way.
    pub fn along(corners: &[Vec2], count: usize, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut places = Vec::new();
        for leg in corners.windows(2) {
            let (d, length) = (leg[1] - leg[0], (leg[1] - leg[0]).norm());
            let mut along = FROM_CORNERS_M + random.uniform(0.0, 1.0);
            while along < length - FROM_CORNERS_M {
                places.push((leg[0] + d * (along / length), d / length));
                along += APART_M + random.uniform(0.0, 1.0);
            }
        }
        let mut things = Vec::new();
        let every = (places.len() as f64 / count.max(1) as f64).max(1.0);
        for k in 0..count {
            let Some((at, along)) = places.get((k as f64 * every) as usize) else { break };
            let left = Vec2::new(-along.y, along.x);
            let yaw = along.y.atan2(along.x);
            // Beside the middle, so that there is room on one side.
            let side = if random.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
            let aside = left * side * random.uniform(0.15, 0.35);
            let (thing, kind) = match k % 3 {
                0 => (
                    Thing {
                        at: at + aside,
                        base_m: 0.0,
                        size: Vec3::new(0.4, 0.5, random.uniform(0.5, 1.1)),
                        yaw,
                    },
                    Kind::Stays,
                ),
                1 => {
                    (Thing { at: at + aside, base_m: 1.35, size: Vec3::new(0.4, 0.5, 0.5), yaw }, Kind::Stays)
                }
                _ => (Thing { at: *at, base_m: 0.0, size: Vec3::new(0.3, 2.1, 1.0), yaw }, Kind::IsTakenAway),
            };
            things.push((thing, kind));
        }
        Self { count: things.len(), things, ..Self::default() }
    }

    /// What is there now.
    pub fn things(&self) -> Vec<Thing> {
        self.things.iter().map(|(thing, _)| *thing).collect()
    }

    /// Metres from a place to the nearest thing.
    pub fn clearance(&self, at: &Vec2) -> f64 {
        self.things.iter().map(|(thing, _)| thing.distance(at)).fold(f64::INFINITY, f64::min)
    }

    /// Time passes with the walker at a place; true when something was taken away.
    pub fn step(&mut self, at: &Vec2, standing: bool, dt: f64) -> bool {
        let touching = self.clearance(at) < BODY_M;
        self.touched += usize::from(touching && !self.touching);
        self.touching = touching;
        let before =
            |(thing, kind): &(Thing, Kind)| *kind == Kind::IsTakenAway && thing.distance(at) < BEFORE_M;
        self.stood_s = if standing && self.things.iter().any(before) { self.stood_s + dt } else { 0.0 };
        if self.stood_s < AWAY_S {
            return false;
        }
        self.stood_s = 0.0;
        self.things.retain(|thing| !before(thing));
        true
    }

    /// Takes an announcement, with the walker's true place and heading and the corners that he follows.
    pub fn hear(&mut self, words: &str, world: &World, at: &Vec2, heading: f64, corners: &[Vec2]) {
        let in_the_way = ["in the way", "ground drops", "see the ground"].iter().any(|w| words.contains(w));
        if !(words.starts_with("Stop.") && in_the_way) {
            return;
        }
        self.stops += 1;
        let ahead = Vec2::new(heading.cos(), heading.sin());
        let clear = |p: &Vec2| world.clearance(p.x, p.y).min(self.clearance(p)) > FALSE_M;
        let straight = (0..36).map(|k| at + ahead * (0.1 * f64::from(k) * AHEAD_M / 3.6));
        let near_route = self.things.iter().any(|(thing, _)| {
            thing.distance(at) < AHEAD_M
                && corners.windows(2).any(|leg| {
                    (0..=100).any(|k| {
                        let p = leg[0] + (leg[1] - leg[0]) * (f64::from(k) / 100.0);
                        thing.distance(&p) < FALSE_M && (p - at).norm() < AHEAD_M
                    })
                })
        });
        self.false_stops += usize::from(!near_route && straight.into_iter().all(|p| clear(&p)));
    }
}
