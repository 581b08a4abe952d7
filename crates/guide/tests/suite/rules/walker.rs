//! A walker whose motion is scripted by the test.

use cairn_geometry::{Pose, Vec3};
use cairn_guide::*;
use cairn_sensor::Stamp;

pub const STEP: f64 = 0.05;

/// A walker whose motion is scripted by the test.
pub struct ScriptedWalker {
    pub guide: Guide,
    pub t: f64,
    pub x: f64,
    pub y: f64,
    pub heading: f64,
    pub z: f64,
    pub confidence: Confidence,
    pub hazard: Option<StopReason>,
    pub stale: bool,
    last_pose: (Stamp, f64, f64, f64, f64),
    pub cues: Vec<(f64, f64, Cue)>,
}

impl ScriptedWalker {
    pub fn new(corners: &[[f64; 3]], config: GuideConfig) -> Self {
        let line: Vec<Vec3> = corners.iter().map(|c| Vec3::from(*c)).collect();
        let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
        let [x, y, z] = corners[0];
        Self {
            guide: Guide::new(plan, Ground::z_up(), config).unwrap(),
            t: 0.0,
            x,
            y,
            heading: 0.0,
            z,
            confidence: Confidence::Good,
            hazard: None,
            stale: false,
            last_pose: (Stamp(0), x, y, z, 0.0),
            cues: Vec::new(),
        }
    }

    /// On the test route: 30 m east, then 20 m north.
    pub fn on_test_route(config: GuideConfig) -> Self {
        Self::new(&[[0., 0., 0.], [30., 0., 0.], [30., 20., 0.]], config)
    }

    pub fn tick(&mut self) {
        self.t += STEP;
        let now = Stamp::from_seconds(self.t);
        if !self.stale {
            self.last_pose = (now, self.x, self.y, self.z, self.heading);
        }
        let (pose_stamp, x, y, z, heading) = self.last_pose;
        let mut pose = camera_pose(x, y, heading, 0.2);
        pose.translation.z = z;
        let input = GuideInput {
            now,
            pose_stamp,
            odom_from_camera: Pose::new(pose),
            confidence: self.confidence,
            speed: None,
            hazard: self.hazard,
        };
        if let Some(cue) = self.guide.step(&input) {
            self.cues.push((self.t, self.x, cue));
        }
    }

    pub fn stand(&mut self, seconds: f64) -> &mut Self {
        for _ in 0..(seconds / STEP).round() as usize {
            self.tick();
        }
        self
    }

    pub fn go(&mut self, metres: f64, speed: f64) -> &mut Self {
        for _ in 0..(metres / speed / STEP).round() as usize {
            self.x += speed * STEP * self.heading.cos();
            self.y += speed * STEP * self.heading.sin();
            self.tick();
        }
        self
    }

    pub fn turn(&mut self, degrees: f64, rate_deg: f64) -> &mut Self {
        for _ in 0..(degrees.abs() / rate_deg / STEP).round() as usize {
            self.heading += (rate_deg * STEP).to_radians() * degrees.signum();
            self.tick();
        }
        self
    }

    /// Time, x and text of everything said, without sounds.
    pub fn spoken(&self) -> Vec<(f64, f64, String)> {
        let phrases = PhraseConfig::default();
        self.cues.iter().filter_map(|(t, x, c)| phrases.words(c).map(|w| (*t, *x, w))).collect()
    }

    pub fn words(&self) -> Vec<String> {
        self.spoken().into_iter().map(|h| h.2).collect()
    }

    pub fn find(&self, part: &str) -> Vec<(f64, f64)> {
        self.spoken().iter().filter(|h| h.2.contains(part)).map(|h| (h.0, h.1)).collect()
    }

    pub fn count(&self, kind: impl Fn(&CueKind) -> bool) -> usize {
        self.cues.iter().filter(|c| kind(&c.2.kind)).count()
    }
}

pub fn default_config() -> GuideConfig {
    GuideConfig::default()
}

/// A config without small corrections, to test the rules behind them.
pub fn without_corrections() -> GuideConfig {
    GuideConfig { adjust_dwell_s: 1e9, progress_m: 0.0, ..default_config() }
}
