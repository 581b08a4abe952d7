//! How the engine stands, for people: a phase, the numbers behind it, and what is waited for.
//!
//! The phases are told apart by what a frame found; nothing here decides anything. Several may seem to hold at once: the
//! first that holds of ERROR, LOST, COASTING, RESETTING, WAIT_IMU, WAIT_MOTION, INITIALIZING, TRACKING is told. The pose
//! may be known in any of the last five: [`Status::valid`] says so.

#[cfg(test)]
mod tests;
mod watch;
mod words;

use cairn_inertial::Gate;
use serde::Serialize;
pub(crate) use watch::{Seen, Watch};

/// What the engine is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Phase {
    /// There is no engine yet: the vocabulary is opened and checked.
    #[default]
    LoadingVocab,
    /// No picture has come yet, or none for a second (told by whoever knows the time, such as a session).
    WaitFrames,
    /// The inertial sensor is to be used, scale and gravity are not known here, and no reading has come for half a second.
    WaitImu,
    /// One camera before its first map: what is seen is the same as before, but the camera has not moved enough aside.
    /// Or, with an inertial sensor, scale and gravity are not known here, and the last try to find them lacked
    /// excitation, baseline, or certainty of scale. In the latter case the pose is valid and mapping goes on by eye.
    WaitMotion,
    /// There is too little to see to begin a map; or scale and gravity are being sought, and nothing lacks that moving
    /// would mend first. In the latter case the pose is valid and mapping goes on by eye.
    Initializing,
    /// The pose is known by what is seen; where the inertial sensor is used, scale and gravity are known too.
    Tracking,
    /// Too little is seen; the inertial sensor carries the pose.
    Coasting,
    /// The pose is not known; the place is sought in the map.
    Lost,
    /// The frame at which a new world begins beside the others, since the place was not recognised. Nothing is thrown
    /// away.
    Resetting,
    /// The picture could not be taken; or a stage has died, and tracking goes on with the map there is.
    Error,
}

impl Phase {
    /// All in the order in which they usually come.
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
    /// Points to begin a map with: features with depth, or matches between two views.
    Points {
        /// Found.
        have: usize,
        /// Needed.
        need: usize,
    },
    /// The camera to move aside: so many matches between two views do not tell the motion yet.
    Parallax {
        /// Matches.
        matches: usize,
    },
    /// A reading of the inertial sensor: seconds since the last, where there ever was one.
    Reading {
        /// Seconds before the picture.
        silent_s: Option<f64>,
    },
    /// Enough key frames for the first try to find scale and gravity.
    FirstTry,
    /// A test that the last try failed.
    Gate(Gate),
    /// Enough to see again, while the inertial sensor carries the pose.
    Sight {
        /// Seconds since the pose was last seen.
        since_s: f64,
        /// Standard deviation of the place, metres.
        sigma: f64,
    },
    /// A place that is recognised: matches that agreed at the best candidate.
    Place {
        /// Agreed.
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

/// Something that has happened. Worlds are named after their eldest key frame, by its place in the order of birth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum StatusEvent {
    /// A world begins.
    World {
        /// Its name.
        map: usize,
        /// Whether there are others beside it.
        beside: bool,
    },
    /// Two worlds are one; the younger's name goes.
    Merge {
        /// The younger.
        from: usize,
        /// The older.
        into: usize,
    },
    /// A loop was closed.
    Loop {
        /// The key frame that saw a place again.
        key_frame: usize,
        /// The one that had seen it before.
        again: usize,
    },
    /// Scale and gravity of a world are known.
    AlignGravity {
        /// The world.
        map: usize,
        /// Metres in a unit of length before.
        scale: f64,
        /// Relative standard deviation of the scale.
        sigma: f64,
    },
    /// A lost pose is known again.
    Found {
        /// Seconds without it.
        after_s: f64,
    },
}

/// What came of the inertial sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ImuStatus {
    /// Readings that came with the last packet, made-up ones too.
    pub batch: usize,
    /// Milliseconds from the newest real reading to the picture: positive where readings lag behind; `None` before
    /// the first.
    pub lag_ms: Option<f64>,
    /// Readings made up so far because no real one had come in time ([`cairn_sensor::ImuSample::is_synthesised`]).
    pub synthesised: usize,
    /// Holes of more than two and a half periods between readings, so far.
    pub gaps: usize,
    /// The longest of them, seconds.
    pub longest_gap_s: f64,
}

/// How the engine stands after a packet.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Status {
    /// What it is doing.
    pub phase: Phase,
    /// Seconds since the first packet, in the source's clock.
    pub t_s: f64,
    /// Packets so far.
    pub frames: u64,
    /// Number of the last pose, from 1; 0 before the first. It stays while there is none.
    pub sequence: u64,
    /// Whether the last packet has a pose.
    pub valid: bool,
    /// The world of the last pose (its map), named after its eldest key frame by its place in the order of birth.
    pub map: Option<usize>,
    /// Whether there is a world, and its scale and gravity are known where the inertial sensor is to find them.
    pub initialised: bool,
    /// Whether lengths there are metres.
    pub metric: bool,
    /// Points that agree with the pose; 0 at the frame a world begins with.
    pub points: usize,
    /// The inertial sensor, where it is used.
    pub imu: Option<ImuStatus>,
    /// What is waited for; nothing where nothing is. Serialised as words.
    pub waits: Vec<Wait>,
    /// What happened at the last packet.
    pub events: Vec<StatusEvent>,
    /// All tests of the last try to find scale and gravity here, passed and failed.
    pub gates: Vec<Gate>,
    /// What is wrong, in [`Phase::Error`].
    pub error: Option<String>,
}
