//! The journal of a threaded run: what is needed to reproduce its poses, bit for bit, on one thread.
//!
//! A frame's pose follows from its features, the map version that tracking used and whether mapping was idle;
//! the map versions follow from when mapping was told to stop, which places closing compared, and the order
//! of commits. Everything that depends on the timing of threads is written here; all else is computed again.
//! The format is specified in `docs/formats/journal.md`.

mod read;
mod write;

pub use read::{Journal, JournalError, ReplayError};
pub(crate) use write::JournalWriter;

use crate::Config;
use crate::digest::Digest;
use cairn_atlas::Snapshot;
use cairn_sensor::{Rig, Stamp};
use cairn_vision::SensorMode;

/// Version of the format.
pub(crate) const FORMAT: u32 = 1;

/// The run that a journal belongs to. A replay with anything else cannot give the same poses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Name of the source.
    pub source: String,
    /// Sensor mode, and whether the run only localised.
    pub sensor: String,
    /// Nominal frame rate: the bits of the number in Hz.
    pub rate_hz: u64,
    /// The calibration, as text.
    pub rig: String,
    /// The configuration as JSON.
    pub config: String,
    /// Version and digest of the map that the run started in.
    pub snapshot: [u64; 2],
}

impl Header {
    /// The part that is known before the source and the map are.
    pub(crate) fn of(mode: SensorMode, rate_hz: f64, rig: &Rig, config: &Config) -> Self {
        Self {
            sensor: format!("{mode:?}"),
            rate_hz: rate_hz.to_bits(),
            rig: format!("{rig:?}"),
            config: serde_json::to_string(config).unwrap_or_default(),
            ..Self::default()
        }
    }

    /// The complete header.
    pub(crate) fn with(&self, source: &str, localize_only: bool, snapshot: &Snapshot) -> Self {
        let mut digest = Digest::default();
        digest.snapshot(snapshot);
        let sensor = format!("{}{}", self.sensor, if localize_only { ", localizes only" } else { "" });
        let snapshot = [snapshot.version(), digest.value()];
        Self { source: source.to_owned(), sensor, snapshot, ..self.clone() }
    }

    /// A description of the first difference to another run.
    pub(crate) fn differs(&self, run: &Self) -> Option<String> {
        if self.source != run.source {
            return Some(format!("the journal is of source {}, this run is of {}", self.source, run.source));
        }
        if self.sensor != run.sensor {
            return Some(format!("the journal is of sensors {}, this run uses {}", self.sensor, run.sensor));
        }
        if self.rate_hz != run.rate_hz {
            let [a, b] = [self.rate_hz, run.rate_hz].map(f64::from_bits);
            return Some(format!("the journal is of {a} frames per second, this run has {b}"));
        }
        let facts = [("calibration", &self.rig, &run.rig), ("configuration", &self.config, &run.config)];
        for (what, a, b) in facts {
            if let Some(at) = a.bytes().zip(b.bytes()).position(|(a, b)| a != b) {
                let around =
                    |text: &str| text.chars().skip(at.saturating_sub(30)).take(50).collect::<String>();
                return Some(format!(
                    "different {what}: '{}' in the journal, '{}' here",
                    around(a),
                    around(b)
                ));
            }
            if a.len() != b.len() {
                return Some(format!("different {what}"));
            }
        }
        (self.snapshot != run.snapshot).then(|| "the run started in another map (--map-in)".into())
    }
}

/// One line of a journal after its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Record {
    /// A frame that tracking took.
    Frame(FrameRecord),
    /// Mapping processed the next request of tracking; it asked so often whether to stop before the answer
    /// was yes, or it never was (`None`).
    KeyFrameRequest {
        /// Number of answers "no" before the first "yes".
        stop_after: Option<u64>,
    },
    /// Closing started a job.
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

/// The inputs of tracking for a frame, and the digest of its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRecord {
    /// Time of the frame.
    pub stamp: Stamp,
    /// Version of the map that was used.
    pub version: u64,
    /// Whether mapping was idle.
    pub idle: bool,
    /// Version of the map after this frame created one, if it did.
    pub map_created: Option<u64>,
    /// Digest of state and pose.
    pub digest: u64,
}

/// A closing job; jobs are numbered as mapping requests them, skipped ones are absent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobRecord {
    /// Its number.
    pub number: u64,
    /// Version of the map it ran on.
    pub version: u64,
    /// Whether a map was adjusted as a whole; else a place was searched.
    pub whole: bool,
    /// The key frame whose place was searched, or the root of the map, as an index in order of creation.
    pub key_frame: u64,
}
