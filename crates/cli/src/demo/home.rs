//! The return: the session gets only the images, the walker only the announcements.
//!
//! Each frame: an image from the walker's true pose, a step of the session, announcements, a step of the walker. Walls
//! block the walker.

use super::camera::DemoCamera;
use super::config::DemoConfig;
use super::out::WalkedOut;
use crate::failure::Failure;
use crate::progress::Progress;
use cairn_geometry::{Vec2, Vec3};
use cairn_guide::{CleanedRoute, Facing, Route, RouteConfig, Travel, reason_words};
use cairn_sensor::Stamp;
use cairn_session::{Command, ReferencePath, Said};
use cairn_trial::way::{Body, Obstacles};
use std::f64::consts::PI;

/// Seconds it takes to turn the camera round on the chest.
const TURN_CAMERA_S: f64 = 4.0;
/// The demo ends when the walker has stood still this long after arrival was announced, seconds.
const STANDING_S: f64 = 2.0;

/// It also ends when he has stood this long because the guide gives no directions any more, seconds.
const STOPPED_S: f64 = 30.0;

/// One announcement.
#[derive(Clone, Debug)]
pub struct Spoken {
    /// Seconds since the first frame of the outbound walk.
    pub t_s: f64,
    /// Its text.
    pub words: String,
    /// The walker's true position, metres.
    pub at: Vec2,
    /// Whether it interrupted the previous announcement.
    pub interrupts: bool,
}

/// Result of the return.
pub struct Return {
    /// The announcements.
    pub said: Vec<Spoken>,
    /// The walker's true path, metres.
    pub path: Vec<Vec2>,
    /// Whether the guide announced arrival.
    pub arrived: bool,
    /// Why the guide gave up directions, when the walker stood for long because of that.
    pub stopped: Option<String>,
    /// The cleaned route, placed by the map at the end.
    pub cleaned: CleanedRoute,
    /// Number of turns on the return.
    pub turns: usize,
    /// Seconds from the start of guidance to its end.
    pub took_s: f64,
    /// Number of frames in which a wall or an obstacle blocked the walker.
    pub blocked: usize,
    /// What was in the way, and what became of the walker there.
    pub obstacles: Obstacles,
}

/// Guides the walker back to the start.
///
/// # Errors
/// When the session or the renderer fails, or the recorded route is too short to plan on.
pub fn walk_back(
    camera: &mut DemoCamera,
    out: &WalkedOut,
    config: &DemoConfig,
    progress: &Progress,
) -> Result<Return, Failure> {
    let dt = config.step_s();
    let (place, heading) = out.turning_point;
    let mut body = config.body(place, heading);
    let mut now = out.end;
    if config.facing == Facing::Back {
        now = turn_camera(camera, &mut body, now, dt)?;
    }
    let began = now;
    let back: Vec<Vec2> = out.corners.iter().rev().copied().collect();
    let mut obstacles = Obstacles::along(&back, config.obstacles, config.seed);
    camera.put(obstacles.things());
    let planned = reference_path(camera, &out.route);
    let plan = planned
        .plan()
        .map_err(|e| Failure::new("the return", e.to_string(), "walk farther: at least --metres 10"))?;
    let length_m = plan.length();
    let mut home = Return {
        said: Vec::new(),
        path: vec![body.place()],
        arrived: false,
        stopped: None,
        cleaned: planned.cleaned,
        turns: plan.maneuvers().len(),
        took_s: 0.0,
        blocked: 0,
        obstacles: Obstacles::default(),
    };
    let mut said = camera.ask(&Command::Guide { facing: Some(config.facing), again: false })?;
    home.hear(&mut body, &said);
    let slowest = if config.facing == Facing::Backwards { 0.08 } else { 0.2 };
    let limit_s = 90.0 + length_m / slowest;
    let (mut standing_s, mut stopped_s) = (0.0, 0.0);
    while now - began < limit_s && standing_s < STANDING_S && stopped_s < STOPPED_S {
        now = now.plus_seconds(dt);
        let pose = body.step(camera.world(), &obstacles, dt, now);
        if obstacles.step(&body.place(), body.walker.is_standing(), dt) {
            camera.put(obstacles.things());
        }
        said = camera.see(now, &pose)?;
        home.hear(&mut body, &said);
        let (place, heading) = (body.place(), body.walker.pose().2);
        said.iter().for_each(|s| obstacles.hear(&s.text, camera.world(), &place, heading, &back));
        home.path.push(body.place());
        home.arrived = camera.session().has_arrived();
        standing_s = if home.arrived && body.walker.is_standing() { standing_s + dt } else { 0.0 };
        let stopped = camera.session().status().guiding.filter(|g| g.state == "stopped");
        stopped_s = if stopped.is_some() && body.walker.is_standing() { stopped_s + dt } else { 0.0 };
        let along_m = camera.session().status().guiding.map_or(length_m, |g| g.along_m);
        progress.step(50 + (50.0 * along_m / length_m) as usize);
    }
    if stopped_s >= STOPPED_S {
        let words = |reason| reason_words(reason, config.facing, camera.session().language());
        home.stopped = camera.session().stop_reason().map(words);
    }
    home.took_s = now - began;
    home.blocked = body.blocked;
    home.obstacles = obstacles;
    home.cleaned = reference_path(camera, &out.route).cleaned;
    Ok(home)
}

/// The route placed by the current map, as the session follows it.
fn reference_path(camera: &DemoCamera, route: &Route) -> ReferencePath {
    ReferencePath::in_map(&camera.snapshot(), route, Travel::Home, &RouteConfig::default())
}

impl Return {
    /// Gives announcements to the walker and logs them with the walker's true position.
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

/// The walker stands still and turns the camera round on the chest, with a smooth start and end.
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

/// Points of a route projected onto the floor plan; `place` maps points from the map frame to the world frame.
pub fn to_floor_plan(points: &[Vec3], place: impl Fn(&Vec3) -> Vec3) -> Vec<Vec2> {
    points.iter().map(|p| place(p).xy()).collect()
}
