//! Trials on poses: a route is walked out, recorded and cleaned, and a simulated walker who reacts only to the spoken
//! words is guided home. Ground truth is kept apart from the guide's input.

mod config;
mod judge;
mod noise;
mod routes;
mod rules;

pub use config::{STEP_S, TrialConfig, guide_config};
pub use judge::{Outcome, Said, Tally};
pub use noise::{Noise, PoseNoise};
pub use routes::{crosses_itself, random_route, walk_out};

use crate::walker::Walker;
use cairn_geometry::{Pose, Se3, Vec2};
use cairn_guide::{
    Announcer, AnnouncerConfig, CleanConfig, CleanedRoute, Facing, Ground, Guide, GuideInput, ManeuverPlan,
    ManeuverPlanConfig, Route, Travel, camera_pose, clean,
};
use cairn_sensor::Stamp;
use judge::Judge;
use rules::Rules;

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
    let (mut rules, mut stood_s) = (Rules::default(), 0.0);
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
        let said = voice.poll(now);
        rules.see(cue.as_ref(), guide.state(), reading.stamp, said.as_ref(), phrases.language, now);
        if let Some(said) = said {
            walker.hear(&said.text, now);
            judge.hear(&said, &walker, now);
        }
        let arrived = guide.state() == cairn_guide::GuideState::Arrived;
        stood_s = if arrived && walker.is_standing() { stood_s + STEP_S } else { 0.0 };
        if stood_s > 3.0 {
            break;
        }
    }
    let mut outcome = judge.finish(&walker, guide.state() == cairn_guide::GuideState::Arrived);
    rules.finish(&mut outcome);
    outcome
}
