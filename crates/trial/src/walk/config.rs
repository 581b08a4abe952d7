//! What a trial is made of.

use super::noise::Noise;
use cairn_guide::{Facing, GuideConfig, PhraseConfig, Travel};

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
