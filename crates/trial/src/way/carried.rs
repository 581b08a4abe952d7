//! A phone that a simulated walker carries along a way and, by the words that are heard, back: its readings and the poses that
//! its images are drawn from, moment by moment. Time is the caller's.

use super::{Body, Obstacles};
use crate::walker::Walker;
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{ImuSample, RigError, Stamp};
use cairn_sim::{
    ContinuousTrajectory, Effects, MotionSensors, PhoneMotion, PhoneTraits, RollingCamera, SimConfig, World,
};
use std::f64::consts::PI;
use std::sync::Arc;

/// Steps a second of the body.
pub const BODY_HZ: f64 = 50.0;
/// Grey levels of noise, standard deviation: the small sensor of a phone.
const NOISE: f64 = 3.0;
/// Seconds it takes to turn the camera round on the chest.
pub const TURN_CAMERA_S: f64 = 4.0;
/// Seconds in which one who walks comes to a stand, and in which a body that stood in the middle of a step begins another walk.
const HALTS_S: f64 = 0.6;

/// The phone and who carries it.
pub struct CarriedPhone {
    /// The phone.
    pub traits: PhoneTraits,
    /// The corners of the way out, metres.
    pub corners: Vec<Vec2>,
    /// Where the body was at each step of the way back, metres.
    pub path: Vec<Vec2>,
    world: Arc<World>,
    obstacles: Obstacles,
    gait: cairn_sim::Walker,
    /// The walk out, and the second of it that is reached; how fast its time goes, and whether the walker comes to a stand.
    out: ContinuousTrajectory,
    out_at_s: f64,
    pace: f64,
    is_halting: bool,
    /// Where the camera was when it was moved otherwise from then on, and when.
    before: (Se3, f64),
    /// The body of the return, and since when the camera is being turned round.
    body: Option<Body>,
    turning_s: Option<f64>,
    motion: PhoneMotion,
    sensors: MotionSensors,
    times: Vec<f64>,
    /// The camera takes an image at multiples of its period; the next one.
    next_image: u64,
}

impl CarriedPhone {
    /// At the start of the world's first route, of which so many metres are walked; with its camera.
    ///
    /// # Errors
    /// When the camera is not valid.
    pub fn new(
        sim: &SimConfig,
        traits: &PhoneTraits,
        seed: u64,
        metres: Option<f64>,
    ) -> Result<(Self, RollingCamera), RigError> {
        let world = Arc::new(World::build(sim.world, seed, &sim.options));
        let corners = corners(world.routes().first().map_or(&[][..], |r| &r.points), metres);
        let out = sim.walker.motion(&corners);
        let effects = Effects { noise: NOISE, ..sim.effects };
        let camera = RollingCamera::new(&world, &traits.camera, traits.readout_s, effects, seed)?;
        let phone = Self {
            traits: *traits,
            corners,
            path: Vec::new(),
            world,
            obstacles: Obstacles::default(),
            gait: sim.walker.clone(),
            motion: PhoneMotion::new(1.0 / BODY_HZ, &out.pose(0.0)),
            before: (out.pose(0.0), 0.0),
            out,
            out_at_s: 0.0,
            pace: 0.0,
            is_halting: false,
            body: None,
            turning_s: None,
            sensors: MotionSensors::new(traits, seed),
            times: camera.times(),
            next_image: 1,
        };
        Ok((phone, camera))
    }

    /// The walker goes out from now on.
    pub fn set_out(&mut self, now_s: f64) {
        self.moves_otherwise();
        // What of the body's time lies ahead of now is still stood.
        self.out_at_s = self.motion.end_s() - now_s;
        (self.pace, self.is_halting) = (1.0, false);
    }

    /// The walker goes along these corners from now on, metres.
    pub fn set_out_along(&mut self, corners: &[Vec2], now_s: f64) {
        self.out = self.gait.motion(corners);
        self.set_out(now_s);
    }

    /// The walker goes out and back again without any words, to let the phone be learned.
    pub fn set_out_and_return(&mut self, now_s: f64) {
        let back = self.corners.iter().rev().skip(1);
        let there_and_back: Vec<Vec2> = self.corners.iter().chain(back).copied().collect();
        self.set_out_along(&there_and_back, now_s);
    }

    /// The walker comes to a stand where he is.
    pub fn halt(&mut self) {
        self.is_halting = true;
    }

    /// Whether the walk out is over, or the walker stands before its end.
    pub fn stands(&self) -> bool {
        self.pace == 0.0 || self.out_at_s >= self.out.end()
    }

    fn moves_otherwise(&mut self) {
        let end_s = self.motion.end_s();
        self.before = (self.motion.motion().pose(end_s), end_s);
    }

    /// Seconds that the way out takes.
    pub fn out_s(&self) -> f64 {
        self.out.end()
    }

    /// From where the way out has led: `walker` makes the one who goes by words from now on, of a place and a heading. Nothing happens
    /// where there is no way.
    pub fn follow_words(&mut self, walker: impl FnOnce((f64, f64, f64)) -> Walker) {
        if self.corners.len() < 2 {
            return;
        }
        self.moves_otherwise();
        let (at, ahead) = (self.before.0.translation, self.before.0.rotation * Vec3::z());
        let walker = walker((at.x, at.y, ahead.y.atan2(ahead.x)));
        self.body = Some(Body::new(walker, self.gait.clone()));
    }

    /// The camera is turned round on the chest, from now on.
    pub fn turn_camera(&mut self) {
        self.turning_s = Some(self.motion.end_s());
    }

    /// Whoever goes by words.
    pub fn walker(&self) -> Option<&Walker> {
        self.body.as_ref().map(|body| &body.walker)
    }

    /// The walker hears this now.
    pub fn hear(&mut self, words: &str) {
        if let Some(body) = &mut self.body {
            body.walker.hear(words, Stamp::from_seconds(self.motion.end_s()));
        }
    }

    /// Steps of the body until now and two ahead.
    pub fn move_until(&mut self, now_s: f64) {
        let dt = 1.0 / BODY_HZ;
        while self.motion.end_s() < now_s + 2.0 * dt {
            let next_s = self.motion.end_s() + dt;
            let pose = match &mut self.body {
                Some(body) => {
                    if let Some(since) = self.turning_s {
                        let share = ((next_s - since) / TURN_CAMERA_S).clamp(0.0, 1.0);
                        body.mount = PI * 0.5 * (1.0 - (PI * share).cos());
                    }
                    let pose = body.step(&self.world, &self.obstacles, dt, Stamp::from_seconds(next_s));
                    self.path.push(body.place());
                    pose
                }
                None => {
                    let slower = if self.is_halting { dt / HALTS_S } else { 0.0 };
                    self.pace = (self.pace - slower).max(0.0);
                    self.out_at_s += self.pace * dt;
                    self.out.pose(self.out_at_s.max(0.0))
                }
            };
            let (before, since) = self.before;
            let share = ((next_s - since) / HALTS_S).min(1.0);
            self.motion.step(&before.interpolate(&pose, share * share * (3.0 - 2.0 * share)));
        }
    }

    /// The body's steps that were made so far, seconds.
    pub fn end_s(&self) -> f64 {
        self.motion.end_s()
    }

    /// The readings of the motion sensors until now that were not taken yet.
    pub fn readings(&mut self, now_s: f64) -> Vec<ImuSample> {
        self.sensors.until(self.motion.motion(), self.motion.settled_s().min(now_s))
    }

    /// When the image that is due was exposed (its middle row); none is due before the camera's next period. Images that nobody took
    /// are gone.
    pub fn exposure(&mut self, now_s: f64) -> Option<f64> {
        let exposed = |nth: u64| nth as f64 / self.traits.camera_hz;
        let ready = |nth: u64| exposed(nth) + 0.5 * self.traits.readout_s;
        while ready(self.next_image + 1) < now_s {
            self.next_image += 1;
        }
        let is_due = ready(self.next_image) <= now_s.min(self.motion.settled_s());
        is_due.then(|| {
            self.next_image += 1;
            exposed(self.next_image - 1)
        })
    }

    /// The camera's true pose at a time.
    pub fn pose(&self, at_s: f64) -> Se3 {
        self.motion.motion().pose(at_s.max(0.0))
    }

    /// The camera's true poses during an exposure, as [`RollingCamera::picture`] takes them.
    pub fn poses(&self, exposure_s: f64) -> Vec<Se3> {
        self.times.iter().map(|dt| self.pose(exposure_s + dt)).collect()
    }

    /// Until when the motion is settled, seconds.
    pub fn settled_s(&self) -> f64 {
        self.motion.settled_s()
    }
}

/// The corners of a route, cut off after `metres`.
pub fn corners(points: &[Vec2], metres: Option<f64>) -> Vec<Vec2> {
    let mut left = metres.unwrap_or(f64::INFINITY);
    let mut out: Vec<Vec2> = points.first().copied().into_iter().collect();
    for leg in points.windows(2) {
        let length = (leg[1] - leg[0]).norm();
        if left <= length {
            out.push(leg[0] + (leg[1] - leg[0]) * (left / length));
            break;
        }
        out.push(leg[1]);
        left -= length;
    }
    out
}
