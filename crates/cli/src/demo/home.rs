//! The way home: the guide gets the engine's poses and nothing else, the walker hears the words and nothing else.
//!
//! Each frame: an image from where the walker truly is, the engine's pose, a step of the guide, words, a step of
//! the walker. Walls hold the walker up, as they do.

use super::body::Body;
use super::eyes::{Eyes, standing};
use super::out::WalkedOut;
use super::setting::Setting;
use crate::failure::Failure;
use crate::progress::Progress;
use cairn_geometry::{Pose, Se3, Vec2, Vec3};
use cairn_guide::{
    Announcer, AnnouncerSetting, CleanSetting, CleanWay, Confidence, Facing, Ground, Guide, GuideInput,
    GuideSetting, GuideState, PhraseSetting, PlacedPoint, RecordInput, Route, RouteSetting, Travel, Way,
    clean,
};
use cairn_sensor::Stamp;
use std::f64::consts::PI;

/// Seconds that it takes to turn the camera round on the chest.
const TURN_CAMERA_S: f64 = 4.0;
/// The route follows the map when a recorded point has moved by more than this, metres,
const MOVED_M: f64 = 0.05;
/// looked at so often, seconds.
const LOOK_AT_MAP_S: f64 = 1.0;
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
    pub cleaned: CleanWay,
    /// Turns on the route home.
    pub turns: usize,
    /// Seconds from the beginning of guidance to its end.
    pub took_s: f64,
    /// How often the walker was held up by a wall or a thing: frames.
    pub held_up: usize,
}

/// The recorded way as a route home in the map of now.
struct Course {
    ground: Ground,
    placed: Vec<PlacedPoint>,
    cleaned: CleanWay,
    looked: Stamp,
    version: u64,
}

impl Course {
    fn new(eyes: &Eyes, way: &Way, now: Stamp) -> Self {
        let (map, ground) = (eyes.map(), way.header.ground());
        let placed = way.resolve(|a| standing(&map, a));
        let cleaned = clean(&placed, way.metres_per_unit(), &ground, &CleanSetting::default());
        Self { ground, placed, cleaned, looked: now, version: map.version() }
    }

    fn route(&self) -> Result<Route, Failure> {
        Route::from_way(&self.cleaned, Travel::Home, &self.ground, &RouteSetting::default()).map_err(|e| {
            Failure::new("the way home", e.to_string(), "walk farther: --metres 10 at the least")
        })
    }

    /// The route once more, when the map has moved under it.
    fn moved(&mut self, eyes: &Eyes, way: &Way, now: Stamp) -> Result<Option<Route>, Failure> {
        if now - self.looked < LOOK_AT_MAP_S {
            return Ok(None);
        }
        self.looked = now;
        let map = eyes.map();
        if map.version() == self.version {
            return Ok(None);
        }
        self.version = map.version();
        let placed = way.resolve(|a| standing(&map, a));
        let moved = (self.placed.iter().zip(&placed))
            .map(|(a, b)| (a.frame_from_camera.translation - b.frame_from_camera.translation).norm())
            .fold(0.0, f64::max);
        if moved <= MOVED_M {
            return Ok(None);
        }
        self.cleaned = clean(&placed, way.metres_per_unit(), &self.ground, &CleanSetting::default());
        self.placed = placed;
        self.route().map(Some)
    }
}

/// Brings the walker home.
pub fn come_home(
    eyes: &mut Eyes,
    out: &WalkedOut,
    setting: &Setting,
    progress: &Progress,
) -> Result<CameHome, Failure> {
    let dt = setting.step_s();
    let (stands, heading) = out.stands;
    let mut body = Body::new(setting, stands, heading);
    let mut now = out.end;
    if setting.facing == Facing::Back {
        now = turn_camera(eyes, &mut body, now, dt)?;
    }
    let began = now;
    let mut course = Course::new(eyes, &out.way, now);
    let route = course.route()?;
    let (length_m, turns) = (route.length(), route.maneuvers().len());
    let guide_setting = GuideSetting { facing: setting.facing, ..GuideSetting::default() };
    let mut guide = Guide::new(route, course.ground, guide_setting)
        .map_err(|e| Failure::new("guidance", e.to_string(), "choose another --facing"))?;
    let mut voice = Announcer::new(AnnouncerSetting::default());
    let phrases = PhraseSetting::default();
    let mut last: Option<(Stamp, Se3)> = None;
    let mut home = CameHome {
        said: Vec::new(),
        path: vec![body.place()],
        arrived: false,
        cleaned: course.cleaned.clone(),
        turns,
        took_s: 0.0,
        held_up: 0,
    };
    let slowest = if setting.facing == Facing::Backwards { 0.08 } else { 0.2 };
    let limit_s = 90.0 + length_m / slowest;
    let mut stood_s = 0.0;
    while now - began < limit_s && stood_s < STANDS_S {
        now = now.plus_seconds(dt);
        let pose = body.step(eyes.world(), dt, now);
        let seen = eyes.see(now, &pose)?;
        if let Some(route) = course.moved(eyes, &out.way, now)? {
            guide.correct_route(route);
        }
        if let Some(cue) = input(&seen, &mut last).and_then(|i| guide.step(&i))
            && let Some(words) = phrases.words(&cue)
        {
            voice.push(words, cue.priority(), now);
        }
        if let Some(said) = voice.poll(now) {
            body.walker.hear(&said.text, now);
            home.said.push(Spoken {
                t_s: now.seconds(),
                words: said.text,
                at: body.place(),
                interrupts: said.interrupts,
            });
        }
        home.path.push(body.place());
        home.arrived = guide.state() == GuideState::Arrived;
        stood_s = if home.arrived && body.walker.is_standing() { stood_s + dt } else { 0.0 };
        progress.step(50 + (50.0 * guide.place().map_or(0.0, |m| m.along_m) / length_m) as usize);
    }
    home.took_s = now - began;
    home.held_up = body.held_up;
    home.cleaned = course.cleaned;
    Ok(home)
}

/// What the guide is given; nothing before the first pose.
fn input(seen: &RecordInput, last: &mut Option<(Stamp, Se3)>) -> Option<GuideInput> {
    if seen.confidence != Confidence::Lost {
        *last = Some((seen.stamp, seen.odom_from_camera.se3));
    }
    let (pose_stamp, pose) = (*last)?;
    Some(GuideInput {
        now: seen.stamp,
        pose_stamp,
        odom_from_camera: Pose::new(pose),
        confidence: seen.confidence,
        speed: None,
        hazard: None,
    })
}

/// The walker stands and turns the camera round on his chest, at an even rate with a soft start and end.
fn turn_camera(eyes: &mut Eyes, body: &mut Body, from: Stamp, dt: f64) -> Result<Stamp, Failure> {
    let mut now = from;
    while now - from < TURN_CAMERA_S {
        now = now.plus_seconds(dt);
        let share = ((now - from) / TURN_CAMERA_S).clamp(0.0, 1.0);
        body.mount = PI * 0.5 * (1.0 - (PI * share).cos());
        let pose = body.camera(dt);
        eyes.see(now, &pose)?;
    }
    body.mount = PI;
    Ok(now)
}

/// Points of the cleaned way on the floor of the world, given what carries map points there.
pub fn on_floor(points: &[Vec3], place: impl Fn(&Vec3) -> Vec3) -> Vec<Vec2> {
    points.iter().map(|p| place(p).xy()).collect()
}
