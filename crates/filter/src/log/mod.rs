//! Recorded runs of wheeled robots: controls and sightings in order of time, and surveyed landmarks where there are any.

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
    /// Surveyed landmarks by label, in metres in the survey's frame; empty where there is no truth.
    pub surveyed: BTreeMap<u32, Vec2>,
    /// True poses of the first robot, where the log has them.
    pub truth: Vec<(f64, Se2)>,
    /// The noise that suits its robots and sensors, for filtering.
    pub noise: Noise,
    /// The same where labels are not used: as likely as the innovations make it, so that gates mean what they say.
    pub unlabelled_noise: Noise,
    /// The same for robust smoothing, which bears narrow bearings with far outliers.
    pub smoothing_noise: Noise,
    /// The gate that suits its labels ([`crate::ekf::EkfConfig::gate_probability`]).
    pub gate_probability: f64,
    /// What was found and mended or left out while reading, for people.
    pub notes: Vec<String>,
}

/// What one robot recorded, in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotLog {
    /// Its name.
    pub name: String,
    /// Controls and sightings by rising time.
    pub entries: Vec<Entry>,
}

/// Something recorded at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Seconds from the start of the log.
    pub time_s: f64,
    /// What.
    pub event: Event,
}

/// What was recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// From now on the robot moves at this forward (m/s) and angular (rad/s) velocity.
    Velocity {
        /// Forward.
        speed_m_s: f64,
        /// Counter-clockwise.
        turn_rad_s: f64,
    },
    /// Up to now it travelled so far and turned so much.
    Travel {
        /// Along the arc.
        way_m: f64,
        /// Counter-clockwise.
        turn_rad: f64,
    },
    /// Up to now it moved so, with this covariance of (x, y, angle).
    Relative {
        /// The motion.
        before_from_after: Se2,
        /// Its noise.
        covariance: Matrix3<f64>,
    },
    /// It sees something.
    Seen {
        /// Of what: a landmark by its label, another robot by its place in [`Log::robots`], or something unknown.
        target: Target,
        /// What is measured.
        reading: Reading,
    },
}

/// A reading as recorded, without noise: that is the log's [`Noise`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// Distance in metres and direction in radians.
    RangeBearing(f64, f64),
    /// Distance in metres.
    Range(f64),
    /// Direction in radians.
    Bearing(f64),
    /// Place in the body's frame in metres, with its covariance.
    Position(Vec2, Matrix2<f64>),
}
