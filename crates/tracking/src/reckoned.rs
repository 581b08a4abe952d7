//! A pose without features, with its covariance: by dead reckoning, or by the shape of what the depth camera sees. Used as a prior
//! and as a gate for the pose by features (a chi-square gate: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to
//! Tracking and Navigation", 2001, section 5.4).

use cairn_geometry::{Manifold, Se3};
use cairn_solve::PosePrior;
use nalgebra::{Matrix6, Vector6};

/// What a tracked pose is uncertain by where a motion is added to it, metres and radians: its own noise and that of the map
/// around it, which adjustment moves by about as much.
pub(crate) const TRACKED_SIGMA_M: f64 = 0.015;
pub(crate) const TRACKED_SIGMA_RAD: f64 = 0.01;
/// Chi-square of six degrees of freedom, 99.9 %.
const GATE: f64 = 22.46;

/// A pose that something else than features gives, sure enough to be the pose by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    pub world_from_camera: Se3,
    /// Standard deviation of the position along the least certain axis, metres.
    pub sigma: f64,
    /// Of its right perturbation (translation, rotation), m^2 and rad^2.
    pub covariance: Matrix6<f64>,
}

/// What a tracked pose is uncertain by, of its right perturbation: translation, rotation.
pub(crate) fn tracked_covariance() -> Matrix6<f64> {
    diagonal([TRACKED_SIGMA_M, TRACKED_SIGMA_RAD].map(|s| s * s))
}

/// Covariance of a pose with these variances of its translation and rotation along and about each axis.
pub(crate) fn diagonal([m, rad]: [f64; 2]) -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::new(m, m, m, rad, rad, rad))
}

/// A pose without features: by dead reckoning, or by the shape of what the depth camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reckoned {
    pub world_from_camera: Se3,
    /// Of its right perturbation (translation, rotation), m^2 and rad^2.
    pub covariance: Matrix6<f64>,
    /// Standard deviations up to which it may be the pose by itself, metres and radians.
    pub limit: [f64; 2],
}

impl Reckoned {
    /// The pose as a prior.
    pub fn prior(&self) -> PosePrior {
        let information = self.covariance.try_inverse().unwrap_or_default();
        PosePrior { world_from_camera: self.world_from_camera, information }
    }

    /// Whether a pose may be the one reckoned.
    pub fn agrees(&self, world_from_camera: &Se3) -> bool {
        let off = self.world_from_camera.local(world_from_camera);
        off.dot(&(self.prior().information * off)) <= GATE
    }

    /// Standard deviations along the least certain axis, in metres and radians.
    pub fn sigma(&self) -> [f64; 2] {
        [0, 3].map(|at| {
            let block = self.covariance.fixed_view::<3, 3>(at, at).into_owned();
            block.symmetric_eigenvalues().max().max(0.0).sqrt()
        })
    }

    /// Whether it is certain enough to go on with nothing else.
    pub fn may_coast(&self) -> bool {
        let sigma = self.sigma();
        sigma[0] <= self.limit[0] && sigma[1] <= self.limit[1]
    }

    /// It as the pose by itself, where it is certain enough.
    pub fn carry(&self) -> Option<Estimate> {
        let Self { world_from_camera, covariance, .. } = *self;
        self.may_coast().then(|| Estimate { world_from_camera, sigma: self.sigma()[0], covariance })
    }
}
