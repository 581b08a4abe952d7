//! IMU initialisation: scale, gravity, biases and velocities of a visual map from the IMU readings of the same time. It is a
//! hypothesis tested beside the map, which changes nothing until it is accepted.
//!
//! Source: Campos, Montiel, Tardós, "Inertial-only optimization for visual-inertial initialization" (ICRA 2020): the
//! maximum a posteriori over (scale, gravity's direction, biases, velocities) of eq. 3-7 with the updates of eq. 8-12. Unlike
//! there, the visual poses are not taken as exact: each has an error with a prior that the caller states, which is
//! solved for too. First guesses after Mur-Artal & Tardós, "Visual-inertial monocular SLAM with map reuse" (RA-L 2017),
//! section IV.
//!
//! Every test is a [`Gate`] with its number, so that a waiting user can be told what is missing.

mod chain;
mod estimate;
mod gates;
mod guess;
mod input;
mod link;
mod map;
mod problem;
mod unmodelled;

use crate::Preintegrated;
use cairn_geometry::Se3;
use cairn_solve::{pause, to_end};
pub use estimate::Initial;
pub use gates::{Gate, GateKind};
pub use input::{InitialiseConfig, Scale, Seen, SeenPose};
use problem::Problem;

/// An attempt: its tests, and the estimate where there is one.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// All tests with their numbers, passed and failed.
    pub gates: Vec<Gate>,
    /// The estimate, accepted or not.
    pub found: Option<Initial>,
}

impl Attempt {
    /// The estimate, when every test was passed.
    pub fn accepted(&self) -> Option<&Initial> {
        self.found.as_ref().filter(|_| self.gates.iter().all(|g| g.passed))
    }

    /// The estimate, when every test was passed but perhaps those of some kinds.
    pub fn good_but_for(&self, kinds: &[GateKind]) -> Option<&Initial> {
        self.found.as_ref().filter(|_| self.gates.iter().all(|g| g.passed || kinds.contains(&g.kind)))
    }

    /// The failed tests.
    pub fn failed(&self) -> impl Iterator<Item = &Gate> {
        self.gates.iter().filter(|g| !g.passed)
    }
}

/// Attempts to estimate scale, gravity and biases. `links[k]` preintegrates the readings from key frame `k` to `k + 1`;
/// `imu_from_camera` is in metres.
pub fn initialise(
    seen: &Seen,
    links: &[Preintegrated],
    imu_from_camera: &Se3,
    scale: Scale,
    config: &InitialiseConfig,
) -> Attempt {
    to_end(initialise_in_slices(seen, links, imu_from_camera, scale, config))
}

/// The same in slices.
pub async fn initialise_in_slices(
    seen: &Seen<'_>,
    links: &[Preintegrated],
    imu_from_camera: &Se3,
    scale: Scale,
    config: &InitialiseConfig,
) -> Attempt {
    let mut gates = gates::before(seen, links, imu_from_camera, scale, config);
    if gates.iter().any(|g| !g.passed && g.kind.is_structural()) {
        return Attempt { gates, found: None };
    }
    let problem = Problem::new(seen, links, imu_from_camera, scale, config);
    pause().await;
    let found = map::solve(problem).await;
    gates.push(gates::converged(found.is_some()));
    if let Some(found) = &found {
        gates.extend(gates::after(found, scale, config));
    }
    Attempt { gates, found }
}
