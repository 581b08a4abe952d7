//! The one error type of the facade, with the errors of the crates below as sources.

use crate::MergeError;
use cairn_atlas::store::StoreError;
use cairn_engine::{ConfigError, OpenMapError};
use cairn_eval::EvalError;
use cairn_geometry::TrajectoryError;
use cairn_guide::RouteError;
use cairn_sensor::{RigError, SourceError, Stamp};
use cairn_session::{NotTracked, Refused};

/// Why a frame cannot be processed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// Frames have to come in the order of their times.
    #[error("it is not later than the frame before, at {before} s")]
    NotLater {
        /// The time of the frame before.
        before: Stamp,
    },
    /// A number of an IMU sample is infinite or not a number.
    #[error("the IMU sample at {0} s is not finite")]
    ImuNotFinite(Stamp),
    /// IMU samples have to come in the order of their times.
    #[error("the IMU sample at {sample} s follows one at {before} s")]
    ImuOrder {
        /// The time of the sample.
        sample: Stamp,
        /// The time of the one before.
        before: Stamp,
    },
    /// The images do not fit the rig.
    #[error(transparent)]
    NotTracked(#[from] NotTracked),
}

/// Why something outside could not be used. A lost pose or a rejected loop is no error but a value in
/// [`crate::Output`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A source could not be opened or read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The rig is impossible, or cannot serve the sensor mode.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// A configuration has an unknown entry or a number out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The frame rate is not a positive number.
    #[error("{0} frames a second is not a positive number")]
    Rate(f64),
    /// A frame was refused; the next one can be processed.
    #[error("frame at {stamp} s: {why}")]
    Frame {
        /// Its time.
        stamp: Stamp,
        /// What is wrong with it.
        why: FrameError,
    },
    /// A saved map could not be read or written.
    #[error(transparent)]
    MapFile(#[from] StoreError),
    /// A saved map does not fit the camera.
    #[error(transparent)]
    OpenMap(#[from] OpenMapError),
    /// Saved maps could not be put into one.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// There are no key frames: nothing to save, or to be localised in.
    #[error("the map has no key frames")]
    EmptyMap,
    /// Mapping has failed, so the map does not change any more.
    #[error("mapping has stopped after an error of the program")]
    MappingStopped,
    /// A recorded route could not be read.
    #[error(transparent)]
    Route(#[from] RouteError),
    /// Recording or guidance could not do what was asked for; the words are those that the walker hears.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// Poses with equal times or numbers that are not finite.
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    /// A trajectory could not be compared with its ground truth.
    #[error(transparent)]
    Evaluation(#[from] EvalError),
}
