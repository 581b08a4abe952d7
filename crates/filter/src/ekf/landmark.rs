//! Landmarks, results for sightings, and errors of the caller.

use super::active::Place;
use cairn_geometry::Vec2;
use nalgebra::Matrix2;

/// Number of a landmark; never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LandmarkId(pub u32);

/// A landmark in the filter.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub id: LandmarkId,
    pub label: Option<u32>,
    /// Its place in the active state, if it is active.
    pub place: Option<Place>,
    /// Its index in the passive store, if it has ever been passive.
    pub store: Option<usize>,
    pub seen: usize,
    /// Rejections since its last accepted sighting.
    pub rejected: usize,
    /// Log odds that it is gone, accumulated over missed sightings.
    pub absence: f64,
    /// Distance that the robot had travelled when the landmark last counted as missed, in metres.
    pub missed_at_m: f64,
    /// Number of views from different positions, and the distance that the robot had travelled at the last one.
    pub views: usize,
    pub viewed_at_m: f64,
    pub confirmed: bool,
}

/// The estimate of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// Its number.
    pub id: LandmarkId,
    /// Its label, where it has one.
    pub label: Option<u32>,
    /// Where it is, in metres.
    pub position: Vec2,
    /// Covariance of the position, in m^2.
    pub covariance: Matrix2<f64>,
    /// Sightings of it that corrected the state.
    pub seen: usize,
    /// False while it is tentative.
    pub confirmed: bool,
}

/// Result for a sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It corrected the state.
    Taken {
        /// The landmark; `None` for a robot.
        landmark: Option<LandmarkId>,
        /// Normalised innovation squared.
        nis: f64,
        /// Its degrees of freedom.
        dof: usize,
    },
    /// It initialised a landmark.
    New {
        /// The new landmark.
        landmark: LandmarkId,
    },
    /// It is outside its gate.
    Rejected {
        /// Normalised innovation squared.
        nis: f64,
        /// The bound of the gate.
        gate: f64,
    },
    /// Without a label: near a landmark, but too far to match it and too near to start a new one.
    Ambiguous {
        /// Normalised innovation squared for the nearest landmark.
        nis: f64,
    },
    /// It is stored until there are enough measurements to initialise its landmark.
    Waiting {
        /// Number of stored measurements.
        kept: usize,
    },
    /// It cannot be used: its target is unknown or at the same position as the observer, or one measurement of this
    /// kind without a label is not enough.
    Unusable,
}

/// An error of the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FilterError {
    /// There is no robot with this number.
    #[error("there is no robot {0}")]
    NoRobot(usize),
    /// A motion or an initial pose is not finite, or a variance is negative.
    #[error("a motion or a first pose is not finite, or its covariance is not one")]
    NotFinite,
    /// There is not one measurement for the map for each sighting.
    #[error("{0} sightings, but {1} measurements for the map")]
    Measurements(usize, usize),
}
