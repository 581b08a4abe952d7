//! The walker's true body: it goes where the words send it, walls and things are in its way, and it carries the camera.
//!
//! A walker feels what is ahead with the cane and goes along it, on the side where there is more room, without turning:
//! the reference_path that was told stays the reference_path. Where that leads nowhere he stands and waits for words.

use super::config::DemoConfig;
use cairn_geometry::{Se3, Vec2};
use cairn_guide::Walker;
use cairn_sensor::Stamp;
use cairn_sim::{Stride, World};

/// Half the width of a person, metres: nearer than this to a wall nobody comes.
const BODY_M: f64 = 0.25;
/// How far ahead of the body the cane feels, metres: a walker does not walk into a wall with his nose.
const CANE_M: f64 = 0.7;
/// How far to a side a walker goes around something before he gives up, metres.
const ASIDE_M: f64 = 1.0;
/// From this change of heading on a reference_path is another one, degrees.
const ANOTHER_COURSE_DEG: f64 = 10.0;
/// Directions that are tried when the straight one is blocked, degrees to either side.
const AROUND_DEG: [f64; 6] = [15.0, 35.0, 55.0, 75.0, 90.0, 100.0];

/// Feeling one's way along something.
struct ImuModel {
    /// The heading that is blocked, radians: another reference_path is felt out anew.
    heading: f64,
    /// Plus one for left.
    side: f64,
    /// Metres gone aside.
    gone_m: f64,
}

/// A body in a world.
pub struct Body {
    /// Who hears the words.
    pub walker: Walker,
    /// The direction of the camera against that of the chest, radians: half a turn when the camera looks back.
    pub mount: f64,
    /// Steps in which something was in the way.
    pub held_up: usize,
    stride: Stride,
    with_imu: Option<ImuModel>,
}

impl Body {
    /// A body that stands at a place (metres) and faces along a heading (radians).
    pub fn new(config: &DemoConfig, place: Vec2, heading: f64) -> Self {
        Self {
            walker: Walker::new(config.seed, (place.x, place.y, heading)),
            mount: 0.0,
            held_up: 0,
            stride: Stride::new(config.sim.walker.clone()),
            with_imu: None,
        }
    }

    /// Lets `dt` seconds pass; gives the camera's true pose after them.
    pub fn step(&mut self, world: &World, dt: f64, now: Stamp) -> Se3 {
        let from = self.place();
        self.walker.step(dt, now);
        let step = self.place() - from;
        if step.norm() > 1e-9 {
            let free = self.free(world, from, step);
            let to = if free { from + step } else { self.around(world, from, step) };
            self.held_up += usize::from(!free);
            if free {
                self.with_imu = None;
            }
            self.walker.held_at(to.x, to.y);
        }
        self.camera(dt)
    }

    /// True when body and cane find nothing in the way of a step.
    fn free(&self, world: &World, from: Vec2, step: Vec2) -> bool {
        let felt = from + step + step.normalize() * CANE_M;
        clear(world, &(from + step)) && world.clearance(felt.x, felt.y) >= 0.8 * BODY_M
    }

    /// A step along what is in the way; none where there is no room.
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
        let anew = ImuModel { heading, side: if room(1.0) >= room(-1.0) { 1.0 } else { -1.0 }, gone_m: 0.0 };
        let same = |f: &ImuModel| (heading - f.heading).cos() > ANOTHER_COURSE_DEG.to_radians().cos();
        let with_imu = self.with_imu.take().filter(same).unwrap_or(anew);
        // Sliding along a wall leads on; only what leads aside is counted.
        let limit = if with_imu.gone_m < ASIDE_M { f64::INFINITY } else { 60.0 };
        let mut tries =
            AROUND_DEG.iter().filter(|deg| **deg < limit).map(|deg| (*deg, turned(deg * with_imu.side)));
        let found = tries.find(|(_, s)| self.free(world, from, *s));
        let (deg, aside) = found.unwrap_or((0.0, Vec2::zeros()));
        let gone_m = with_imu.gone_m + if deg < 60.0 { 0.0 } else { aside.norm() };
        self.with_imu = Some(ImuModel { gone_m, ..with_imu });
        from + aside
    }

    /// The camera's true pose, `dt` seconds after the one before.
    pub fn camera(&mut self, dt: f64) -> Se3 {
        let heading = self.walker.pose().2;
        self.stride.pose(self.place(), heading + self.mount, dt)
    }

    /// Where the walker truly is, metres.
    pub fn place(&self) -> Vec2 {
        let (x, y, _) = self.walker.pose();
        Vec2::new(x, y)
    }
}

fn clear(world: &World, at: &Vec2) -> bool {
    world.clearance(at.x, at.y) >= BODY_M
}
