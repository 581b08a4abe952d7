//! What came of each candidate for a loop or a merge, with its numbers.

use super::scales::ScaleConflict;
use cairn_adjust::MatchFailure;
use cairn_atlas::{Change, KeyFrameId, MapId};
use std::fmt;

/// Why a candidate was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// The appearance or the geometry does not match.
    MatchFailure(MatchFailure),
    /// Too few points have a depth on both sides, or those depths do not agree on one scale.
    Scale {
        /// Points with both depths.
        points: usize,
        /// Median of the scale.
        median: f64,
        /// Its spread: median absolute deviation of the logarithm.
        spread: f64,
    },
    /// Both maps have metres, and their lengths differ by more than what is known of both allows.
    MetricScale(ScaleConflict),
    /// Both maps are gravity-aligned, and their gravity directions disagree.
    Tilt {
        /// Angle between them, radians.
        tilt_rad: f64,
    },
    /// The correction is larger than the plausible drift.
    Drift {
        /// The correction, map units.
        off: f64,
        /// The plausible drift over the distance travelled in between, map units.
        plausible: f64,
    },
    /// The correction rotates the camera by more than can have drifted: rooms that look similar from several sides.
    Turned {
        /// The rotation, radians.
        off_rad: f64,
        /// The plausible drift, radians.
        plausible_rad: f64,
    },
    /// Other sensors measured a motion since the earlier visit that it contradicts: what was recognised has moved meanwhile.
    Measured {
        /// The correction, metres.
        off: f64,
        /// The rotation, radians.
        off_rad: f64,
    },
    /// Depth gives the poses (`mapper.window.hold_poses`), and the correction is no larger than features may differ from it by
    /// an error of the calibration.
    Held {
        /// The correction, metres.
        off: f64,
        /// The rotation, radians.
        off_rad: f64,
    },
    /// All checks passed; waits for confirmation by another key frame.
    Alone,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MatchFailure(why) => why.fmt(f),
            Self::MetricScale(why) => why.fmt(f),
            Self::Scale { points, median, spread } => {
                write!(f, "{points} points give a scale of {median:.3} with a spread of {spread:.3}")
            }
            Self::Tilt { tilt_rad } => {
                write!(f, "the gravity directions differ by {:.1} degrees", tilt_rad.to_degrees())
            }
            Self::Held { off, off_rad } => write!(
                f,
                "the correction would be {off:.2} m and {:.1} degrees: features may differ from depth by as much",
                off_rad.to_degrees()
            ),
            Self::Measured { off, off_rad } => write!(
                f,
                "the correction would be {off:.2} m and {:.1} degrees, against the motion measured since",
                off_rad.to_degrees()
            ),
            Self::Drift { off, plausible } => {
                write!(f, "the correction would be {off:.2}, at most {plausible:.2} is plausible")
            }
            Self::Turned { off_rad, plausible_rad } => write!(
                f,
                "the correction would turn by {:.0} degrees, at most {:.0} is plausible",
                off_rad.to_degrees(),
                plausible_rad.to_degrees()
            ),
            Self::Alone => write!(f, "waits for confirmation by a second key frame"),
        }
    }
}

/// The result of recognising a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Joined {
    /// A loop in one map was closed.
    Loop,
    /// Two maps became one.
    Merge {
        /// The younger, whose id is retired.
        from: MapId,
        /// The older.
        into: MapId,
    },
}

/// A candidate that was verified, and the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// The key frame.
    pub key_frame: KeyFrameId,
    /// The earlier key frame that may show the same place.
    pub candidate: KeyFrameId,
    /// The numbers when accepted, or why it was refused.
    pub result: Result<Accepted, Refusal>,
}

/// The numbers of an accepted candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accepted {
    /// What was joined.
    pub joined: Joined,
    /// Landmarks of the earlier visit that are inliers.
    pub inliers: usize,
    /// Landmarks of the earlier visit that should be in view.
    pub expected: usize,
    /// Distance by which the key frame was corrected, map units.
    pub off: f64,
    /// Angle by which it was corrected, radians.
    pub off_rad: f64,
    /// Scale: length in the earlier map for each length here.
    pub scale: f64,
}

/// The result of closing for one key frame.
#[derive(Clone, Debug, Default)]
pub struct Closed {
    /// The changes to commit, made on the given snapshot.
    pub changes: Vec<Change>,
    /// The verdict on each candidate.
    pub verdicts: Vec<Verdict>,
    /// A key frame of the map that was corrected and should be adjusted as a whole when there is time.
    pub joined: Option<KeyFrameId>,
}
