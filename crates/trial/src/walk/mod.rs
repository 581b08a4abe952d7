//! Trials on poses: a route is walked out, recorded and cleaned, and a simulated walker who reacts only to the spoken
//! words is guided home. Ground truth is kept apart from the guide's input.

mod config;
mod judge;
mod noise;
mod routes;
mod rules;
mod time_line;
mod trial;
mod truth;

pub use config::{STEP_S, TrialConfig, guide_config};
pub use judge::{Outcome, Said, Tally};
pub use noise::{Noise, PoseNoise};
pub use routes::{crosses_itself, random_route, walk_out, walked_poses};
pub use rules::Rule;
pub use truth::{RouteTruth, Sent};

use cairn_geometry::Vec2;
use trial::{Moment, Trial};

/// Walks `line` out, records and cleans it, and guides a walker along it. Metres on the ground plane.
pub fn run(line: &[Vec2], config: &TrialConfig) -> Outcome {
    watch(line, config, |_| ())
}

/// The same with its time line as text: what the guide did and said, and where the walker truly was.
pub fn replay(line: &[Vec2], config: &TrialConfig) -> (Outcome, String) {
    let mut time_line = time_line::TimeLine::default();
    let outcome = watch(line, config, |moment| time_line.add(&moment));
    (outcome, time_line.text())
}

fn watch(line: &[Vec2], config: &TrialConfig, mut see: impl FnMut(Moment)) -> Outcome {
    let Some(mut trial) = Trial::new(line, config) else { return Outcome::default() };
    while !trial.is_over() {
        see(trial.step());
    }
    trial.finish()
}
