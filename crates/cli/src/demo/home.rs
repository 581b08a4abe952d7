//! The way home: the session gets the images and nothing else, the walker hears the words and nothing else.
//!
//! Each frame: an image from where the walker truly is, a step of the session, words, a step of the walker. Walls hold the walker up, as they do.

use super::body::Body;
use super::camera::DemoCamera;
use super::config::DemoConfig;
use super::out::WalkedOut;
use crate::failure::Failure;
use crate::progress::Progress;
use cairn_geometry::{Vec2, Vec3};
use cairn_guide::{CleanedRoute, Facing, Route, Travel};
use cairn_sensor::Stamp;
use cairn_session::{Command, ReferencePath, Said};
use std::f64::consts::PI;

/// Seconds that it takes to turn the camera round on the chest.
const TURN_CAMERA_S: f64 = 4.0;
/// The walk is over when the walker has stood so long after the words of arrival, seconds.
const STANDS_S: f64 = 2.0;

/// Something that was said.
#[derive(Clone, Debug)]
pub struct Spoken {
    /// Seconds from the first frame of the way out.
    pub t_s: f64,
    /// The words.
    pub words: String,
    /// Where the walker truly was, metres.
    pub at: Vec2,
    /// Whether it broke off what was being said.
    pub interrupts: bool,
}

/// What came of it.
pub struct CameHome {
    /// What was said.
    pub said: Vec<Spoken>,
    /// Where the walker truly went, metres.
    pub path: Vec<Vec2>,
    /// The guide said that the end is reached.
    pub arrived: bool,
    /// The way after cleaning, as the map had it at the end.
    pub cleaned: CleanedRoute,
    /// Turns on the route home.
    pub turns: usize,
    /// Seconds from the beginning of guidance to its end.
    pub took_s: f64,
    /// How often the walker was held up by a wall or a thing: frames.
    pub held_up: usize,
}

/// Brings the walker home.
pub fn come_home(
    camera: &mut DemoCamera,
    out: &WalkedOut,
    config: &DemoConfig,
    progress: &Progress,
) -> Result<CameHome, Failure> {
    let dt = config.step_s();
    let (stands, heading) = out.stands;
    let mut body = Body::new(config, stands, heading);
    let mut now = out.end;
    if config.facing == Facing::Back {
        now = turn_camera(camera, &mut body, now, dt)?;
    }
    let began = now;
    let planned = reference_path(camera, &out.route, now);
    let plan = planned
        .plan()
        .map_err(|e| Failure::new("the way home", e.to_string(), "walk farther: --metres 10 at the least"))?;
    let length_m = plan.length();
    let mut home = CameHome {
        said: Vec::new(),
        path: vec![body.place()],
        arrived: false,
        cleaned: planned.cleaned,
        turns: plan.maneuvers().len(),
        took_s: 0.0,
        held_up: 0,
    };
    let mut said = camera.ask(&Command::Guide { facing: Some(config.facing), again: false })?;
    home.hear(&mut body, &said);
    let slowest = if config.facing == Facing::Backwards { 0.08 } else { 0.2 };
    let limit_s = 90.0 + length_m / slowest;
    let mut stood_s = 0.0;
    while now - began < limit_s && stood_s < STANDS_S {
        now = now.plus_seconds(dt);
        let pose = body.step(camera.world(), dt, now);
        said = camera.see(now, &pose)?;
        home.hear(&mut body, &said);
        home.path.push(body.place());
        home.arrived = camera.session().has_arrived();
        stood_s = if home.arrived && body.walker.is_standing() { stood_s + dt } else { 0.0 };
        let along_m = camera.session().status().guiding.map_or(length_m, |g| g.along_m);
        progress.step(50 + (50.0 * along_m / length_m) as usize);
    }
    home.took_s = now - began;
    home.held_up = body.held_up;
    home.cleaned = reference_path(camera, &out.route, now).cleaned;
    Ok(home)
}

/// The way as the map has it now, as the session goes by it.
fn reference_path(camera: &DemoCamera, route: &Route, now: Stamp) -> ReferencePath {
    ReferencePath::new(&camera.snapshot(), route, Travel::Home, now)
}

impl CameHome {
    /// The walker hears, and it is written down where he truly stands.
    fn hear(&mut self, body: &mut Body, said: &[Said]) {
        for said in said {
            body.walker.hear(&said.text, said.stamp);
            self.said.push(Spoken {
                t_s: said.stamp.seconds(),
                words: said.text.clone(),
                at: body.place(),
                interrupts: said.interrupts,
            });
        }
    }
}

/// The walker stands and turns the camera round on his chest, at an even rate with a soft start and end.
fn turn_camera(camera: &mut DemoCamera, body: &mut Body, from: Stamp, dt: f64) -> Result<Stamp, Failure> {
    let mut now = from;
    while now - from < TURN_CAMERA_S {
        now = now.plus_seconds(dt);
        let share = ((now - from) / TURN_CAMERA_S).clamp(0.0, 1.0);
        body.mount = PI * 0.5 * (1.0 - (PI * share).cos());
        let pose = body.camera(dt);
        camera.see(now, &pose)?;
    }
    body.mount = PI;
    Ok(now)
}

/// Points of the cleaned way on the floor of the world, given what carries map points there.
pub fn on_floor(points: &[Vec3], place: impl Fn(&Vec3) -> Vec3) -> Vec<Vec2> {
    points.iter().map(|p| place(p).xy()).collect()
}
