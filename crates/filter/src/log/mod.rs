//! Recorded runs of wheeled robots: controls and sightings in order of time, and surveyed landmarks if available.

mod csv;
mod error;
mod find;
mod lines;
mod mrclam;
mod plaza;
mod steps;
mod victoria;

pub use csv::{CSV_FORMAT, parse_csv};
pub use error::LogError;
pub use find::{Format, load};
pub use mrclam::parse_mrclam;
pub use plaza::parse_plaza;
pub use steps::{Noise, Sighting, Step, Target};
pub use victoria::parse_victoria;

use cairn_geometry::{Se2, Vec2};
use nalgebra::{Matrix2, Matrix3};
use std::collections::BTreeMap;

/// A recorded run.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// Its name.
    pub name: String,
    /// The robots; one for most logs.
    pub robots: Vec<RobotLog>,
    /// Surveyed landmarks by label, in metres in the survey's frame; empty where there is no survey.
    pub surveyed: BTreeMap<u32, Vec2>,
    /// True poses of the first robot (seconds from the start of the log, `world_from_body`), if the log has them.
    pub truth: Vec<(f64, Se2)>,
    /// Noise of its robots and sensors, for filtering.
    pub noise: Noise,
    /// Whether it is known; else it is a guess, and estimated from the innovations where there are labels.
    pub noise_known: bool,
    /// The same where labels are not used, tuned to the likelihood of the innovations, so that the gates are correct.
    pub unlabelled_noise: Noise,
    /// The same for robust smoothing, which works with a small bearing noise and far outliers.
    pub smoothing_noise: Noise,
    /// Gate that suits the reliability of its labels ([`crate::ekf::EkfConfig::gate_probability`]).
    pub gate_probability: f64,
    /// What was corrected or left out while reading, for users.
    pub notes: Vec<String>,
}

/// What one robot recorded, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotLog {
    /// Its name.
    pub name: String,
    /// Controls and sightings in order of time.
    pub entries: Vec<Entry>,
}

/// A recorded event and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Seconds from the start of the log.
    pub time_s: f64,
    /// The event.
    pub event: Event,
}

/// A control or a sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// From this time on the robot moves at this forward (m/s) and angular (rad/s) velocity.
    Velocity {
        /// Forward.
        speed_m_s: f64,
        /// Counter-clockwise.
        turn_rad_s: f64,
    },
    /// Distance and turn since the previous event of this kind.
    Travel {
        /// Along the arc.
        way_m: f64,
        /// Counter-clockwise.
        turn_rad: f64,
    },
    /// Motion since the previous event of this kind, with the covariance of (x, y, angle).
    Relative {
        /// The motion.
        before_from_after: Se2,
        /// Its covariance.
        covariance: Matrix3<f64>,
    },
    /// The robot sees something.
    Seen {
        /// The target: a landmark by its label, another robot by its index in [`Log::robots`], or something unknown.
        target: Target,
        /// The measured values.
        reading: Reading,
    },
}

/// A reading as recorded, without noise: the log's [`Noise`] is added later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// Distance in metres and direction in radians.
    RangeBearing(f64, f64),
    /// Distance in metres.
    Range(f64),
    /// Direction in radians.
    Bearing(f64),
    /// Position in the body's frame in metres, with its covariance.
    Position(Vec2, Matrix2<f64>),
}
