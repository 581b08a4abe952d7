//! The status of the engine, for people: a phase, the numbers behind it, and what is waited for.
//!
//! The phases follow from the result of a frame; nothing here decides anything. Where several apply, the
//! first of ERROR, LOST, COASTING, RESETTING, WAIT_IMU, WAIT_MOTION, INITIALIZING, TRACKING is reported. The
//! pose may be known in any of the last five: see [`Status::valid`].

#[cfg(test)]
mod tests;
mod watch;
mod words;

use cairn_inertial::{Gate, ImuFault};
use serde::{Deserialize, Serialize};
pub(crate) use watch::{FrameResult, StatusTracker};

/// What the engine is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Phase {
    /// There is no engine yet: the vocabulary is opened and checked.
    #[default]
    LoadingVocab,
    /// No image has arrived yet, or none for a second (reported by whoever knows the time, such as a
    /// session).
    WaitFrames,
    /// The IMU is to be used, scale and gravity are not known here, and no reading has arrived for half a
    /// second.
    WaitImu,
    /// One camera before its first map: there are enough matches, but the camera has not moved far enough
    /// sideways. Or, with an IMU, scale and gravity are not known here, and the last attempt to initialise
    /// them lacked excitation, baseline, or certainty of scale; in this case the pose is valid and visual
    /// mapping goes on.
    WaitMotion,
    /// There are too few points to start a map; or scale and gravity are being initialised, and nothing is
    /// lacking that motion would provide. In the latter case the pose is valid and visual mapping goes on.
    Initializing,
    /// The pose is tracked visually; where the IMU is used, scale and gravity are known too.
    Tracking,
    /// Too few visual matches; the IMU carries the pose.
    Coasting,
    /// The pose is not known; relocalisation is searching the map.
    Lost,
    /// The frame at which a new map is created while others exist, since the place was not recognised.
    /// Nothing is thrown away.
    Resetting,
    /// The image could not be processed; or a stage has failed, and tracking goes on with the map as it is.
    Error,
}

impl Phase {
    /// All phases in the order in which they usually occur.
    pub const ALL: [Self; 10] = [
        Self::LoadingVocab,
        Self::WaitFrames,
        Self::WaitImu,
        Self::WaitMotion,
        Self::Initializing,
        Self::Tracking,
        Self::Coasting,
        Self::Lost,
        Self::Resetting,
        Self::Error,
    ];

    /// Its name, in capitals.
    pub fn name(self) -> &'static str {
        match self {
            Self::LoadingVocab => "LOADING_VOCAB",
            Self::WaitFrames => "WAIT_FRAMES",
            Self::WaitImu => "WAIT_IMU",
            Self::WaitMotion => "WAIT_MOTION",
            Self::Initializing => "INITIALIZING",
            Self::Tracking => "TRACKING",
            Self::Coasting => "COASTING",
            Self::Lost => "LOST",
            Self::Resetting => "RESETTING",
            Self::Error => "ERROR",
        }
    }
}

/// What is waited for, with its numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wait {
    /// Points to start a map: features with depth, or matches between two views.
    Points {
        /// Found.
        have: usize,
        /// Needed.
        need: usize,
    },
    /// Sideways motion of the camera: the matches between two views do not determine the motion yet.
    Parallax {
        /// Matches.
        matches: usize,
    },
    /// An IMU reading: seconds since the last, if there ever was one.
    Reading {
        /// Seconds before the image.
        silent_s: Option<f64>,
    },
    /// Enough key frames for the first attempt to initialise scale and gravity.
    FirstTry,
    /// A test that the last initialisation failed.
    Gate(Gate),
    /// Visual matches, while the IMU carries the pose.
    VisualMatches {
        /// Seconds since the last visually tracked pose.
        since_s: f64,
        /// Standard deviation of the position, metres.
        sigma: f64,
    },
    /// Steps to the side or forwards: only the rotation of the camera is tracked, its position is held.
    Translation {
        /// Seconds since the last visually tracked pose.
        since_s: f64,
    },
    /// Relocalisation: inlier matches of the best candidate.
    Place {
        /// Inliers.
        have: usize,
        /// Needed.
        need: usize,
    },
}

impl Serialize for Wait {
    fn serialize<S: serde::Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.collect_str(self)
    }
}

/// An event. A map is named after its oldest key frame, by that key frame's index in order of creation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum StatusEvent {
    /// A map was created.
    MapCreated {
        /// Its name.
        map: usize,
        /// Whether there are other maps already.
        others: bool,
    },
    /// Two maps were merged; the younger's name is retired.
    Merge {
        /// The younger.
        from: usize,
        /// The older.
        into: usize,
    },
    /// A loop was closed.
    Loop {
        /// The key frame that shows a place again.
        key_frame: usize,
        /// The earlier key frame of that place.
        earlier: usize,
    },
    /// Scale and gravity of a map are known.
    GravityAligned {
        /// The map.
        map: usize,
        /// Metres per unit of length before.
        scale: f64,
        /// Relative standard deviation of the scale.
        sigma: f64,
    },
    /// The IMU contradicts the scale of the last seconds in a metric map.
    ScaleContradicted {
        /// The map.
        map: usize,
        /// Metres in a metre of the map there, by the readings.
        scale: f64,
        /// Whether the last seconds have been put right; if not, lengths are not supported until they are.
        corrected: bool,
    },
    /// The readings of the IMU are not believed any more, and not used.
    ImuFailed {
        /// What is wrong with them.
        fault: ImuFault,
    },
    /// They are used again.
    ImuBack {
        /// Seconds after which.
        after_s: f64,
    },
    /// Tracking was lost and has been recovered.
    Relocalised {
        /// Seconds without a pose.
        after_s: f64,
    },
}

/// The state of the IMU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImuStatus {
    /// Readings in the last packet, synthesised ones included.
    pub batch: usize,
    /// Milliseconds from the newest real reading to the image: positive where readings lag behind; `None`
    /// before the first.
    pub lag_ms: Option<f64>,
    /// Readings synthesised so far because no real one had arrived in time
    /// ([`cairn_sensor::ImuSample::is_synthesised`]).
    pub synthesised: usize,
    /// Gaps of more than two and a half periods between readings, so far.
    pub gaps: usize,
    /// The longest of them, seconds.
    pub longest_gap_s: f64,
    /// Readings so far that were left out one by one: beyond what any sensor measures.
    pub refused: usize,
    /// What is wrong with the readings; `None` while they are believed. They are not used meanwhile: the pose goes on by vision alone, and
    /// with one camera lengths stay those of the map.
    pub fault: Option<ImuFault>,
    /// Seconds since the first reading that is wrong, 0 while they are believed.
    pub fault_s: f64,
}

/// The status of the engine after a packet.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Status {
    /// The phase.
    pub phase: Phase,
    /// Seconds since the first packet, in the source's clock.
    pub t_s: f64,
    /// Packets so far.
    pub frames: u64,
    /// Number of the last pose, from 1; 0 before the first. It is kept while there is no pose.
    pub sequence: u64,
    /// Whether the last packet has a pose.
    pub valid: bool,
    /// The map of the last pose, named after its oldest key frame by that key frame's index in order of
    /// creation.
    pub map: Option<usize>,
    /// Whether there is a map, and its scale and gravity are known where an IMU is to provide them.
    pub initialised: bool,
    /// Whether lengths there are metres.
    pub metric: bool,
    /// Inlier points of the pose; 0 at the frame that creates a map.
    pub points: usize,
    /// The IMU, where it is used.
    pub imu: Option<ImuStatus>,
    /// What is waited for, if anything. Serialised as text.
    pub waits: Vec<Wait>,
    /// Events at the last packet.
    pub events: Vec<StatusEvent>,
    /// All tests of the last attempt to initialise scale and gravity here, passed and failed.
    pub gates: Vec<Gate>,
    /// What is wrong, in [`Phase::Error`].
    pub error: Option<String>,
}
