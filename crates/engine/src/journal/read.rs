//! Reads journals: any bytes give a journal, as far as it is intact, or an error that says why not.

use super::{FORMAT, FrameRecord, Header, JobRecord, Record};
use cairn_sensor::Stamp;

/// A journal that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Journal {
    /// The run it belongs to.
    pub header: Header,
    /// The records, in order.
    pub records: Vec<Record>,
    /// Why it ends before the run did; `None` when it is complete.
    pub cut: Option<String>,
}

/// Why a journal cannot be replayed in an engine.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReplayError {
    /// Source, sensors, configuration or map are others: the first difference.
    #[error("{0}")]
    Differs(String),
    /// The engine runs in threads.
    #[error("a journal is replayed in lockstep")]
    NotLockstep,
}

/// Why bytes cannot be read as a journal.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JournalError {
    /// It does not start like a journal.
    #[error("is not a Cairn journal")]
    Foreign,
    /// It is of another version.
    #[error("is a journal of version {found}; this program reads version {FORMAT}")]
    Version {
        /// The version it names.
        found: u64,
    },
    /// It ends or is damaged within its header.
    #[error("line {line}: {why}")]
    Head {
        /// Line, counted from one.
        line: usize,
        /// What is wrong.
        why: String,
    },
}

impl Journal {
    /// Reads a journal. Reading stops at the first damaged or unfinished line; the records before it are
    /// returned, and `cut` gives the reason.
    ///
    /// # Errors
    ///
    /// [`JournalError`] when the bytes are not a journal, are of another version, or the header is damaged.
    pub fn read(bytes: &[u8]) -> Result<Self, JournalError> {
        let mut lines = bytes.split_inclusive(|b| *b == b'\n').enumerate();
        let mut head = |name: &'static str| -> Result<(usize, String), JournalError> {
            let (at, line) = lines.next().map_or((0, None), |(at, line)| (at + 1, Some(line)));
            let fail = |why: &str| JournalError::Head { line: at, why: why.to_owned() };
            let line = line.ok_or_else(|| fail("it ends within its header"))?;
            let payload = payload(line).map_err(|e| fail(&e.to_string()))?;
            let rest = payload.strip_prefix(name).and_then(|rest| rest.strip_prefix(' '));
            Ok((at, rest.ok_or_else(|| fail("it is not the expected header line"))?.to_owned()))
        };
        let version = head("cairn-journal").map_err(|_| JournalError::Foreign)?.1;
        let found: u64 = version.parse().map_err(|_| JournalError::Foreign)?;
        if found != u64::from(FORMAT) {
            return Err(JournalError::Version { found });
        }
        let bad = |line: usize, why: &str| JournalError::Head { line, why: why.to_owned() };
        let mut text = |name| {
            let (at, json) = head(name)?;
            serde_json::from_str::<String>(&json).map_err(|_| bad(at, "it is not a JSON string"))
        };
        let (source, sensor, rig, config) = (text("source")?, text("sensor")?, text("rig")?, text("config")?);
        let mut numbers = |name| {
            let (at, words) = head(name)?;
            let numbers: Option<Vec<u64>> =
                words.split(' ').map(|w| u64::from_str_radix(w, 16).ok()).collect();
            numbers.ok_or_else(|| bad(at, "it is not a number"))
        };
        let (rate, snapshot) = (numbers("rate")?, numbers("map")?);
        let ([rate_hz], [map_version, map_digest]) = (rate.as_slice(), snapshot.as_slice()) else {
            return Err(bad(7, "it has too many or too few numbers"));
        };
        let header =
            Header { source, sensor, rig, config, rate_hz: *rate_hz, snapshot: [*map_version, *map_digest] };
        let (mut records, mut cut) = (Vec::new(), None);
        for (at, line) in lines {
            let record = payload(line).and_then(|text| record(text).ok_or(LineError::Unknown));
            match record {
                Ok(record) => records.push(record),
                Err(why) => {
                    cut = Some(format!("line {}: {why}", at + 1));
                    break;
                }
            }
        }
        if cut.is_none() && !matches!(records.last(), Some(Record::End { .. })) {
            cut = Some("it has no end record: the run was interrupted".into());
        }
        Ok(Self { header, records, cut })
    }

    /// Stamps of the frames that tracking took, in order.
    pub fn stamps(&self) -> Vec<Stamp> {
        let stamp = |r: &Record| match r {
            Record::Frame(frame) => Some(frame.stamp),
            _ => None,
        };
        self.records.iter().filter_map(stamp).collect()
    }
}

/// Why a line ends what is read of a journal.
#[derive(Debug, thiserror::Error)]
enum LineError {
    #[error("it is unfinished")]
    Unfinished,
    #[error("it is not UTF-8")]
    NotUtf8,
    #[error("it has no checksum")]
    NoChecksum,
    #[error("its checksum does not match")]
    Checksum,
    #[error("it is not a known record")]
    Unknown,
}

/// The text after the checksum of a line.
fn payload(line: &[u8]) -> Result<&str, LineError> {
    let line = line.strip_suffix(b"\n").ok_or(LineError::Unfinished)?;
    let text = std::str::from_utf8(line).map_err(|_| LineError::NotUtf8)?;
    let (sum, payload) = text.split_once(' ').ok_or(LineError::NoChecksum)?;
    let whole = sum.len() == 8 && u32::from_str_radix(sum, 16) == Ok(crc32fast::hash(payload.as_bytes()));
    if whole { Ok(payload) } else { Err(LineError::Checksum) }
}

fn record(text: &str) -> Option<Record> {
    let mut words = text.split(' ');
    let name = words.next()?;
    let words: Vec<&str> = words.collect();
    let hex = |w: &str| u64::from_str_radix(w, 16).ok();
    let number = |w: &str| w.parse::<u64>().ok();
    let flag = |w: &str| match w {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    };
    let optional = |w: &str| if w == "-" { Some(None) } else { number(w).map(Some) };
    Some(match (name, words.as_slice()) {
        ("frame", [stamp, version, idle, map_created, digest]) => Record::Frame(FrameRecord {
            stamp: Stamp(stamp.parse().ok()?),
            version: number(version)?,
            idle: flag(idle)?,
            map_created: optional(map_created)?,
            digest: hex(digest)?,
        }),
        ("offer", [stop_after]) => Record::KeyFrameRequest { stop_after: optional(stop_after)? },
        ("job", [number_, version, whole, key_frame]) => Record::Job(JobRecord {
            number: number(number_)?,
            version: number(version)?,
            whole: flag(whole)?,
            key_frame: number(key_frame)?,
        }),
        ("closed", [job]) => Record::Closed { job: number(job)? },
        ("end", [version, digest]) => Record::End { version: number(version)?, digest: hex(digest)? },
        _ => return None,
    })
}
