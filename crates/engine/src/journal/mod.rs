//! The journal of a threaded run: what is needed to have the same poses again, bit for bit, on one thread.
//!
//! A frame's pose follows from what the eye saw, the map version that tracking had and whether mapping was idle; the map
//! versions follow from when mapping was told to stop, which places closing looked at, and the order of commits. All that a
//! thread's timing decides is written here; all else is computed again. The form is told in `docs/events.md`.

mod read;
mod write;

pub use read::{Journal, JournalError};
pub(crate) use write::Scribe;

use crate::Config;
use crate::digest::Digest;
use cairn_atlas::Snapshot;
use cairn_sensor::{Rig, Stamp};
use cairn_vision::SensorMode;

/// Version of the form.
pub(crate) const FORMAT: u32 = 1;

/// What a journal belongs to. A replay with anything else can not give the same poses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Name of the source.
    pub source: String,
    /// Sensors, and whether the map was only looked at.
    pub sensor: String,
    /// Nominal rate of frames: the bits of the number in Hz.
    pub rate_hz: u64,
    /// The calibration, in words.
    pub rig: String,
    /// The settings as JSON.
    pub config: String,
    /// Version and digest of the map that the run began in.
    pub snapshot: [u64; 2],
}

impl Header {
    /// What stands before a source and a map are known.
    pub(crate) fn of(mode: SensorMode, rate_hz: f64, rig: &Rig, config: &Config) -> Self {
        Self {
            sensor: format!("{mode:?}"),
            rate_hz: rate_hz.to_bits(),
            rig: format!("{rig:?}"),
            config: serde_json::to_string(config).unwrap_or_default(),
            ..Self::default()
        }
    }

    /// The whole.
    pub(crate) fn with(&self, source: &str, localize_only: bool, snapshot: &Snapshot) -> Self {
        let mut digest = Digest::default();
        digest.snapshot(snapshot);
        let sensor = format!("{}{}", self.sensor, if localize_only { ", localizes only" } else { "" });
        let snapshot = [snapshot.version(), digest.value()];
        Self { source: source.to_owned(), sensor, snapshot, ..self.clone() }
    }

    /// The first thing in which another run differs, in words.
    pub(crate) fn differs(&self, run: &Self) -> Option<String> {
        if self.source != run.source {
            return Some(format!("the journal is of the source {}, this is {}", self.source, run.source));
        }
        if self.sensor != run.sensor {
            return Some(format!("the journal is of sensors {}, these are {}", self.sensor, run.sensor));
        }
        if self.rate_hz != run.rate_hz {
            let [a, b] = [self.rate_hz, run.rate_hz].map(f64::from_bits);
            return Some(format!("the journal is of {a} frames a second, these are {b}"));
        }
        let facts = [("calibration", &self.rig, &run.rig), ("settings", &self.config, &run.config)];
        for (what, a, b) in facts {
            if let Some(at) = a.bytes().zip(b.bytes()).position(|(a, b)| a != b) {
                let around =
                    |text: &str| text.chars().skip(at.saturating_sub(30)).take(50).collect::<String>();
                return Some(format!("other {what}: '{}' there, '{}' here", around(a), around(b)));
            }
            if a.len() != b.len() {
                return Some(format!("other {what}"));
            }
        }
        (self.snapshot != run.snapshot).then(|| "the run began in another map (--map-in)".into())
    }
}

/// One line of a journal after its head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Record {
    /// A frame that tracking took.
    Frame(FrameRecord),
    /// Mapping worked off the next offer of tracking; it asked so many times whether to stop before it was told yes,
    /// or was never told (`None`).
    KeyFrameRequest {
        /// Answers that said no before the one that said yes.
        stop_after: Option<u64>,
    },
    /// Closing took up a job.
    Job(JobRecord),
    /// The changes of this job were committed.
    Closed {
        /// Its number.
        job: u64,
    },
    /// The run has ended.
    End {
        /// Version of the map.
        version: u64,
        /// Its digest.
        digest: u64,
    },
}

/// What tracking had when it took a frame, and the digest of what it made of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRecord {
    /// Time of the frame.
    pub stamp: Stamp,
    /// Version of the map that it saw.
    pub version: u64,
    /// Whether mapping was idle.
    pub idle: bool,
    /// Version of the map in which tracking stood after a start, where this frame was one.
    pub map_created: Option<u64>,
    /// Digest of state and pose.
    pub digest: u64,
}

/// A job of closing; jobs are numbered as mapping asks for them, those that were passed over are absent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobRecord {
    /// Its number.
    pub number: u64,
    /// Version of the map that it was given.
    pub version: u64,
    /// Whether a whole world was adjusted; else a place was looked for.
    pub whole: bool,
    /// Key frame whose place was looked for, or root of the world: place in the order of birth.
    pub key_frame: u64,
}
