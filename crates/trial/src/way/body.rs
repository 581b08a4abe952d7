//! The simulated walker's true body: it follows the announcements, is blocked by walls and obstacles, and carries the
//! camera.
//!
//! The walker detects obstacles ahead with a cane and slides along them, on the side with more room, without turning:
//! the announced heading is kept. Where that does not help, the walker stops and waits for an announcement.

use super::obstacles::{BODY_M, Obstacles};
use crate::walker::Walker;
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::Stamp;
use cairn_sim::{Stride, World};

/// How far the body gives way to what it runs into, metres.
const HELD_M: f64 = 0.05;
/// Reach of the cane ahead of the body, metres.
const CANE_M: f64 = 0.7;
/// Largest sideways detour around an obstacle before the walker gives up, metres.
const ASIDE_M: f64 = 1.0;
/// A change of heading above this ends a detour, degrees.
const NEW_HEADING_DEG: f64 = 10.0;
/// Directions tried when the way straight ahead is blocked, degrees to the chosen side.
const AROUND_DEG: [f64; 6] = [15.0, 35.0, 55.0, 75.0, 90.0, 100.0];

/// The state of going around an obstacle.
struct Detour {
    /// The blocked heading, radians: for a different heading a new detour starts.
    heading: f64,
    /// +1 for left, -1 for right.
    side: f64,
    /// Metres moved sideways.
    aside_m: f64,
}

/// A body in a simulated world.
pub struct Body {
    /// Reacts to the announcements.
    pub walker: Walker,
    /// Yaw of the camera relative to the chest, radians: pi when the camera looks back.
    pub mount: f64,
    /// Number of steps that were blocked.
    pub blocked: usize,
    stride: Stride,
    detour: Option<Detour>,
}

impl Body {
    /// The body of a walker, with a gait.
    pub fn new(walker: Walker, gait: cairn_sim::Walker) -> Self {
        Self { walker, mount: 0.0, blocked: 0, stride: Stride::new(gait), detour: None }
    }

    /// Advances by `dt` seconds; returns the camera's true pose.
    pub fn step(&mut self, world: &World, obstacles: &Obstacles, dt: f64, now: Stamp) -> Se3 {
        let from = self.place();
        self.walker.step(dt, now);
        let step = self.place() - from;
        if step.norm() > 1e-9 {
            // The cane is ahead of him: a step to a side ends where his body touches something.
            let stepping = self.walker.is_stepping();
            let free = if stepping { clear(world, &(from + step)) } else { self.free(world, from, step) };
            let to = match (free, stepping) {
                (true, _) => from + step,
                (false, true) => from,
                (false, false) => self.around(world, from, step),
            };
            // What he does not feel he runs into, and it holds him.
            let into = obstacles.clearance(&to) < BODY_M - HELD_M
                && obstacles.clearance(&to) < obstacles.clearance(&from);
            let to = if into { from } else { to };
            self.blocked += usize::from(!free);
            if free {
                self.detour = None;
            }
            self.walker.held_at(to.x, to.y);
        }
        self.camera(dt)
    }

    /// Whether neither body nor cane would touch anything after a step.
    fn free(&self, world: &World, from: Vec2, step: Vec2) -> bool {
        let cane_tip = from + step + step.normalize() * CANE_M;
        clear(world, &(from + step)) && world.clearance(cane_tip.x, cane_tip.y) >= 0.8 * BODY_M
    }

    /// A step along the obstacle; zero where there is no room.
    fn around(&mut self, world: &World, from: Vec2, step: Vec2) -> Vec2 {
        let turned = |deg: f64| {
            let (s, c) = deg.to_radians().sin_cos();
            Vec2::new(c * step.x - s * step.y, s * step.x + c * step.y)
        };
        let room = |side: f64| {
            let to = from + turned(90.0 * side).normalize() * 2.0 * BODY_M;
            world.clearance(to.x, to.y)
        };
        let heading = self.walker.pose().2;
        let new = Detour { heading, side: if room(1.0) >= room(-1.0) { 1.0 } else { -1.0 }, aside_m: 0.0 };
        let same = |d: &Detour| (heading - d.heading).cos() > NEW_HEADING_DEG.to_radians().cos();
        let detour = self.detour.take().filter(same).unwrap_or(new);
        // Sliding along a wall makes progress; only sideways motion is counted.
        let limit = if detour.aside_m < ASIDE_M { f64::INFINITY } else { 60.0 };
        let mut tries =
            AROUND_DEG.iter().filter(|deg| **deg < limit).map(|deg| (*deg, turned(deg * detour.side)));
        let found = tries.find(|(_, s)| self.free(world, from, *s));
        let (deg, aside) = found.unwrap_or((0.0, Vec2::zeros()));
        let aside_m = detour.aside_m + if deg < 60.0 { 0.0 } else { aside.norm() };
        self.detour = Some(Detour { aside_m, ..detour });
        from + aside
    }

    /// The camera's true pose, `dt` seconds after the previous one.
    pub fn camera(&mut self, dt: f64) -> Se3 {
        let heading = self.walker.pose().2;
        self.stride.pose(self.place(), heading + self.mount, dt)
    }

    /// The walker's true position, metres.
    pub fn place(&self) -> Vec2 {
        let (x, y, _) = self.walker.pose();
        Vec2::new(x, y)
    }
}

fn clear(world: &World, at: &Vec2) -> bool {
    world.clearance(at.x, at.y) >= BODY_M
}
