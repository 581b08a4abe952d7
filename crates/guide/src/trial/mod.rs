//! Trials on poses: a route is walked out, recorded and cleaned, and a simulated walker who reacts only to the spoken
//! words is guided home. Ground truth is kept apart from the guide's input.

mod judge;
mod noise;
mod routes;

pub use judge::{Outcome, Said, Tally};
pub use noise::{Noise, PoseNoise};
pub use routes::{crosses_itself, random_route, walk_out};

use crate::announcer::{Announcer, AnnouncerConfig};
use crate::clean::{CleanConfig, CleanedRoute, clean};
use crate::config::GuideConfig;
use crate::facing::Facing;
use crate::ground::Ground;
use crate::guide::Guide;
use crate::input::GuideInput;
use crate::maneuvers::{ManeuverPlan, ManeuverPlanConfig, Travel};
use crate::phrases::PhraseConfig;
use crate::route::{Confidence, Route};
use crate::walker::Walker;
use cairn_geometry::{Mat3, Pose, Se3, So3, Vec2, Vec3};
use cairn_sensor::Stamp;
use judge::Judge;

/// Seconds between steps of a trial.
pub const STEP_S: f64 = 0.05;

/// Config of a trial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrialConfig {
    /// How the camera is mounted relative to the walker.
    pub facing: Facing,
    /// Home right after the way out, or the same route again another day.
    pub travel: Travel,
    /// The noise added to the poses.
    pub noise: Noise,
    /// Width of the corridor in metres: off the path is half of it, the warning two thirds of that.
    pub corridor_m: f64,
    /// Whether detours are cut before guidance.
    pub cut_detours: bool,
    /// Language, unit and form of what is said; the walker understands this language.
    pub phrases: PhraseConfig,
    /// Seed of the walker, the recording and the noise.
    pub seed: u64,
}

/// The level pose of a camera 1.3 m above the ground that looks along `heading`, tilted down.
pub fn camera_pose(x: f64, y: f64, heading: f64, tilt_down: f64) -> Se3 {
    let (s, c) = heading.sin_cos();
    let level = Mat3::from_columns(&[Vec3::new(s, -c, 0.0), -Vec3::z(), Vec3::new(c, s, 0.0)]);
    let tilt = So3::exp(&Vec3::new(-tilt_down, 0.0, 0.0));
    Se3::new(So3::from_matrix(&level) * tilt, Vec3::new(x, y, 1.3))
}

/// The guide's config for a corridor of this width.
pub fn guide_config(facing: Facing, corridor_m: f64) -> GuideConfig {
    let off_m = 0.5 * corridor_m;
    GuideConfig {
        facing,
        off_m,
        warn_m: off_m * 2.0 / 3.0,
        off_hysteresis_m: 0.2 * off_m,
        ..GuideConfig::default()
    }
}

/// Walks `line` out, records and cleans it, and guides a walker along it. Metres on the ground plane.
pub fn run(line: &[Vec2], config: &TrialConfig) -> Outcome {
    let route = walk_out(line, config.noise, config.seed);
    let placed = route.resolve(|_| None);
    let clean_config = CleanConfig { cut_detours: config.cut_detours, ..CleanConfig::default() };
    let cleaned = clean(&placed, route.metres_per_unit(&placed), &route.header.ground(), &clean_config);
    walk(&route, &cleaned, config)
}

fn walk(route: &Route, cleaned: &CleanedRoute, config: &TrialConfig) -> Outcome {
    let ground = Ground::z_up();
    let route_in = |odom_from_world: &Se3| {
        let moved = CleanedRoute {
            points: cleaned.points.iter().map(|p| *odom_from_world * *p).collect(),
            ..cleaned.clone()
        };
        ManeuverPlan::from_route(&moved, config.travel, &ground, &ManeuverPlanConfig::default())
    };
    let Ok(plan) = route_in(&Se3::identity()) else { return Outcome::default() };
    let start = match config.travel {
        Travel::Home => route.points.last(),
        Travel::Again => route.points.first(),
    };
    let Some(start) = start else { return Outcome::default() };
    let mut judge = Judge::new(plan.clone(), config);
    let guide_config = guide_config(config.facing, config.corridor_m);
    let Ok(mut guide) = Guide::new(plan, ground, guide_config) else { return Outcome::default() };
    let mut voice = Announcer::new(AnnouncerConfig::default());
    let phrases = config.phrases;
    let mut noise = PoseNoise::new(config.noise, config.seed);
    let at = start.odom_from_camera.translation;
    // Facing as on the way out. Another day the walker starts with an arbitrary heading.
    let facing = ground.heading(&start.odom_from_camera).unwrap_or(0.0)
        + if config.travel == Travel::Again { 2.4 * ((config.seed % 7) as f64 / 3.0 - 1.0) } else { 0.0 };
    let walker = Walker::new(config.seed, (at.x, at.y, facing));
    let mut walker = walker.with_language(phrases.language);

    let mut told_from_world = Se3::identity();
    let limit_s = 90.0 + judge.length() / if config.facing == Facing::Backwards { 0.08 } else { 0.2 };
    let mut stood_s = 0.0;
    for tick in 0..(limit_s / STEP_S) as i64 {
        let now = Stamp::from_seconds(tick as f64 * STEP_S);
        let (x, y, heading) = walker.step(STEP_S, now);
        let looks = heading + if config.facing == Facing::Back { std::f64::consts::PI } else { 0.0 };
        // The chest sways and the camera is tilted down; neither may leak into the directions.
        let tilt = 0.25 + 0.05 * (now.seconds() * 6.0).sin();
        let reading = noise.read(&camera_pose(x, y, looks, tilt), now);
        if let Some(odom_from_world) = reading.corrected
            && let Ok(plan) = route_in(&odom_from_world)
        {
            let moved = odom_from_world * told_from_world.inverse();
            told_from_world = odom_from_world;
            guide.correct_route(plan, &moved, now);
        }
        let cue = guide.step(&GuideInput {
            now,
            pose_stamp: reading.stamp,
            odom_from_camera: Pose::new(reading.odom_from_camera),
            confidence: reading.confidence,
            speed: None,
            hazard: None,
        });
        if let Some(words) = cue.as_ref().and_then(|c| phrases.words(c).map(|w| (w, c.priority()))) {
            voice.push(words.0, words.1, now);
        }
        judge.see(&walker, cue.as_ref(), guide.place().map(|m| m.along_m), now);
        if let Some(said) = voice.poll(now) {
            walker.hear(&said.text, now);
            judge.hear(&said, &walker, now);
        }
        let arrived = guide.state() == crate::GuideState::Arrived;
        stood_s = if arrived && walker.is_standing() { stood_s + STEP_S } else { 0.0 };
        if stood_s > 3.0 {
            break;
        }
    }
    judge.finish(&walker, guide.state() == crate::GuideState::Arrived)
}

/// The guide's input at one instant.
pub(crate) struct Reading {
    pub stamp: Stamp,
    pub odom_from_camera: Se3,
    pub confidence: Confidence,
    /// The odom frame relative to the world, when the map was corrected just now.
    pub corrected: Option<Se3>,
}
