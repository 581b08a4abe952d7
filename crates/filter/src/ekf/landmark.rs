//! Landmarks, what becomes of sightings, and what can go wrong.

use super::active::Place;
use cairn_geometry::Vec2;
use nalgebra::Matrix2;

/// Number of a landmark; never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LandmarkId(pub u32);

/// A landmark as the filter keeps it.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub id: LandmarkId,
    pub label: Option<u32>,
    /// Among the active ones, if it is.
    pub place: Option<Place>,
    /// In the passive store, once it was there.
    pub store: Option<usize>,
    pub seen: usize,
    /// Rejected since it was last taken.
    pub rejected: usize,
    /// Log odds that it is gone: what missing it so often says.
    pub absence: f64,
    /// What the robot had travelled when it last counted as missed, in metres.
    pub missed_at_m: f64,
    /// Views from different places, and what the robot had travelled at the last.
    pub views: usize,
    pub viewed_at_m: f64,
    pub confirmed: bool,
}

/// A landmark as it is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// Its number.
    pub id: LandmarkId,
    /// Its label, where it has one.
    pub label: Option<u32>,
    /// Where it is, in metres.
    pub position: Vec2,
    /// Covariance of that, in m^2.
    pub covariance: Matrix2<f64>,
    /// Sightings that it was corrected by.
    pub seen: usize,
    /// False while it is provisional.
    pub confirmed: bool,
}

/// What became of a sighting.
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
    /// It founded a landmark.
    New {
        /// Which.
        landmark: LandmarkId,
    },
    /// It is outside its gate.
    Rejected {
        /// Normalised innovation squared.
        nis: f64,
        /// The bound that it had to keep.
        gate: f64,
    },
    /// Without a label: near a landmark, but not near enough to be of it, nor far enough to be of another.
    Ambiguous {
        /// Normalised innovation squared to the nearest.
        nis: f64,
    },
    /// It is kept until there are enough to place its landmark.
    Waiting {
        /// Kept so far.
        kept: usize,
    },
    /// It cannot be used: its target is not known, stands where the observer stands, or one such measurement of
    /// something without a label says nothing.
    Unusable,
}

/// What the caller did wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FilterError {
    /// There is no such robot.
    #[error("there is no robot {0}")]
    NoRobot(usize),
    /// A motion or a start is not finite, or a variance negative.
    #[error("a motion or a first pose is not finite, or its covariance is not one")]
    NotFinite,
}
