//! One trial: the walker, the guide and the judge, step by step.

use super::config::{STEP_S, TrialConfig, guide_config};
use super::judge::{Judge, Outcome, Said};
use super::noise::{PoseNoise, Reading};
use super::routes::walk_out;
use super::rules::{Rule, Rules};
use crate::walker::Walker;
use cairn_geometry::{Pose, Se3, Vec2};
use cairn_guide::{
    Announcer, AnnouncerConfig, CleanConfig, CleanedRoute, Confidence, Cue, CueKind, Facing, Ground, Guide,
    GuideInput, GuideState, ManeuverPlan, ManeuverPlanConfig, Match, Route, Travel, Utterance, camera_pose,
    clean,
};
use cairn_sensor::Stamp;
use std::f64::consts::PI;

/// What happened in one step.
pub(crate) struct Moment {
    pub now: Stamp,
    /// True position in metres and heading in radians.
    pub walker: (f64, f64, f64),
    /// Where that is on the route.
    pub truth: Option<Match>,
    /// Where the guide has the walker.
    pub place: Option<Match>,
    pub state: GuideState,
    pub confidence: Confidence,
    pub pose_age_s: f64,
    pub cue: Option<CueKind>,
    pub said: Option<Said>,
    /// Rules that were broken now.
    pub broken: Vec<Rule>,
}

/// A walk home, or along the route again.
pub(crate) struct Trial {
    config: TrialConfig,
    cleaned: CleanedRoute,
    guide: Guide,
    voice: Announcer,
    noise: PoseNoise,
    walker: Walker,
    judge: Judge,
    rules: Rules,
    /// The odometry frame in which the guide has the route.
    odom_from_world: Se3,
    tick: i64,
    stood_s: f64,
}

impl Trial {
    /// Walks the line out and stands at the start; `None` where nothing was recorded that can be guided.
    pub fn new(line: &[Vec2], config: &TrialConfig) -> Option<Self> {
        let route = walk_out(line, config.noise, config.seed);
        let placed = route.resolve(|_| None);
        let clean_config = CleanConfig { cut_detours: config.cut_detours, ..CleanConfig::default() };
        let cleaned = clean(&placed, route.metres_per_unit(&placed), &route.header.ground(), &clean_config);
        let plan = plan_in(&cleaned, config.travel, &Se3::identity())?;
        let guide_config = guide_config(config.facing, config.corridor_m);
        Some(Self {
            judge: Judge::new(plan.clone(), config),
            guide: Guide::new(plan, Ground::z_up(), guide_config).ok()?,
            voice: Announcer::new(AnnouncerConfig::default()),
            noise: PoseNoise::new(config.noise, config.seed),
            walker: walker_at_start(&route, config)?,
            rules: Rules::default(),
            config: *config,
            cleaned,
            odom_from_world: Se3::identity(),
            tick: 0,
            stood_s: 0.0,
        })
    }

    /// The walker has arrived and stands, or time is over.
    pub fn is_over(&self) -> bool {
        let speed = if self.config.facing == Facing::Backwards { 0.08 } else { 0.2 };
        let limit_s = 90.0 + self.judge.length() / speed;
        self.stood_s > 3.0 || self.tick >= (limit_s / STEP_S) as i64
    }

    /// The next step.
    pub fn step(&mut self) -> Moment {
        let now = Stamp::from_seconds(self.tick as f64 * STEP_S);
        self.tick += 1;
        let (x, y, heading) = self.walker.step(STEP_S, now);
        let looks = heading + if self.config.facing == Facing::Back { PI } else { 0.0 };
        // The chest sways and the camera is tilted down; neither may leak into the directions.
        let tilt = 0.25 + 0.05 * (now.seconds() * 6.0).sin();
        let reading = self.noise.read(&camera_pose(x, y, looks, tilt), now);
        if let Some(odom_from_world) = reading.corrected {
            self.correct(odom_from_world, now);
        }
        let cue = self.guide.step(&GuideInput {
            now,
            pose_stamp: reading.stamp,
            odom_from_camera: Pose::new(reading.odom_from_camera),
            confidence: reading.confidence,
            speed: None,
            hazard: None,
        });
        let phrases = self.config.phrases;
        if let Some(words) = cue.as_ref().and_then(|c| phrases.words(c).map(|w| (w, c.priority()))) {
            self.voice.push(words.0, words.1, now);
        }
        let said = self.voice.poll(now);
        self.judged(&reading, cue, said, now)
    }

    /// The map was corrected.
    fn correct(&mut self, odom_from_world: Se3, now: Stamp) {
        let Some(plan) = plan_in(&self.cleaned, self.config.travel, &odom_from_world) else { return };
        let moved = odom_from_world * self.odom_from_world.inverse();
        self.odom_from_world = odom_from_world;
        self.guide.correct_route(plan, &moved, now);
    }

    fn judged(&mut self, reading: &Reading, cue: Option<Cue>, said: Option<Utterance>, now: Stamp) -> Moment {
        let (state, place) = (self.guide.state(), self.guide.place());
        self.judge.see(&self.walker, cue.as_ref(), place.map(|m| m.along_m), now);
        let language = self.config.phrases.language;
        let mut broken = self.rules.see(cue.as_ref(), state, reading.stamp, said.as_ref(), language, now);
        let heard = said.map(|said| {
            self.walker.hear(&said.text, now);
            self.judge.hear(&said, &self.walker, now)
        });
        if heard.as_ref().is_some_and(|said| said.wrong_side) {
            self.rules.count(Rule::RightSide, now);
            broken.push(Rule::RightSide);
        }
        let stands = state == GuideState::Arrived && self.walker.is_standing();
        self.stood_s = if stands { self.stood_s + STEP_S } else { 0.0 };
        Moment {
            now,
            walker: self.walker.pose(),
            truth: self.judge.place(),
            place,
            state,
            confidence: reading.confidence,
            pose_age_s: now - reading.stamp,
            cue: cue.map(|cue| cue.kind),
            said: heard,
            broken,
        }
    }

    /// The result.
    pub fn finish(self) -> Outcome {
        let mut outcome = self.judge.finish(&self.walker, self.guide.state() == GuideState::Arrived);
        outcome.broken = self.rules.finish(outcome.arrived, outcome.error_m, outcome.seconds);
        outcome
    }
}

/// The route in an odometry frame.
fn plan_in(cleaned: &CleanedRoute, travel: Travel, odom_from_world: &Se3) -> Option<ManeuverPlan> {
    let points = cleaned.points.iter().map(|p| *odom_from_world * *p).collect();
    let moved = CleanedRoute { points, ..cleaned.clone() };
    ManeuverPlan::from_route(&moved, travel, &Ground::z_up(), &ManeuverPlanConfig::default()).ok()
}

/// Facing as on the way out. Another day the walker starts with an arbitrary heading.
fn walker_at_start(route: &Route, config: &TrialConfig) -> Option<Walker> {
    let (start, turned) = match config.travel {
        Travel::Home => (route.points.last()?, 0.0),
        Travel::Again => (route.points.first()?, 2.4 * ((config.seed % 7) as f64 / 3.0 - 1.0)),
    };
    let at = start.odom_from_camera.translation;
    let heading = Ground::z_up().heading(&start.odom_from_camera).unwrap_or(0.0) + turned;
    Some(Walker::new(config.seed, (at.x, at.y, heading)).with_language(config.phrases.language))
}
