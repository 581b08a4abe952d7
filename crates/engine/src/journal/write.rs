//! Writes journals, line by line, as things happen.

use super::{FORMAT, Header, Record};
use std::fmt::Write as _;
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};

/// Writes the records of all threads in the order of events; does nothing until it has a sink.
#[derive(Clone, Default)]
pub(crate) struct JournalWriter(Arc<Mutex<Option<Sink>>>);

struct Sink {
    to: Box<dyn Write + Send>,
    failed: Option<String>,
}

impl JournalWriter {
    /// Starts a journal.
    pub fn start(&self, to: Box<dyn Write + Send>, header: &Header) {
        let mut sink = Sink { to, failed: None };
        sink.write(&header.to_text());
        sink.flush();
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(sink);
    }

    /// Writes one line; a frame or the end also flushes the sink.
    pub fn write(&self, record: &Record) {
        if let Some(sink) = self.0.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            sink.write(&record.to_line());
            if matches!(record, Record::Frame(_) | Record::End { .. }) {
                sink.flush();
            }
        }
    }

    /// Why writing failed, if it did.
    pub fn failed(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).as_ref()?.failed.clone()
    }
}

impl Sink {
    fn write(&mut self, text: &str) {
        if self.failed.is_none() {
            self.failed = self.to.write_all(text.as_bytes()).err().map(|e| e.to_string());
        }
    }

    fn flush(&mut self) {
        if self.failed.is_none() {
            self.failed = self.to.flush().err().map(|e| e.to_string());
        }
    }
}

fn line(payload: &str) -> String {
    format!("{:08x} {payload}\n", crc32fast::hash(payload.as_bytes()))
}

impl Header {
    /// The header lines of a journal.
    pub fn to_text(&self) -> String {
        let mut text = line(&format!("cairn-journal {FORMAT}"));
        let facts = [
            ("source", &self.source),
            ("sensor", &self.sensor),
            ("rig", &self.rig),
            ("config", &self.config),
        ];
        for (name, value) in facts {
            let json = serde_json::Value::from(value.as_str());
            text.push_str(&line(&format!("{name} {json}")));
        }
        text.push_str(&line(&format!("rate {:x}", self.rate_hz)));
        text.push_str(&line(&format!("map {:x} {:x}", self.snapshot[0], self.snapshot[1])));
        text
    }
}

impl Record {
    /// The line of a record, with its checksum.
    pub fn to_line(&self) -> String {
        let optional = |n: &Option<u64>| n.map_or("-".to_owned(), |n| n.to_string());
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = match self {
            Self::Frame(f) => write!(
                text,
                "frame {} {} {} {} {:x}",
                f.stamp.0,
                f.version,
                u8::from(f.idle),
                optional(&f.map_created),
                f.digest
            ),
            Self::KeyFrameRequest { stop_after } => write!(text, "offer {}", optional(stop_after)),
            Self::Job(j) => {
                write!(text, "job {} {} {} {}", j.number, j.version, u8::from(j.whole), j.key_frame)
            }
            Self::Closed { job } => write!(text, "closed {job}"),
            Self::End { version, digest } => write!(text, "end {version} {digest:x}"),
        };
        line(&text)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FrameRecord, JobRecord, Journal, JournalError};
    use super::*;
    use cairn_sensor::Stamp;

    fn journal() -> (Header, Vec<Record>, String) {
        let header = Header {
            source: "a \"street\"\nby night".into(),
            sensor: "Stereo".into(),
            rate_hz: 20.0f64.to_bits(),
            rig: "two".into(),
            config: "{}".into(),
            snapshot: [3, u64::MAX],
        };
        let frame =
            FrameRecord { stamp: Stamp(-5), version: 2, idle: true, map_created: Some(4), digest: 0xfeed };
        let records = vec![
            Record::Frame(frame),
            Record::KeyFrameRequest { stop_after: None },
            Record::Job(JobRecord { number: 0, version: 9, whole: true, key_frame: 7 }),
            Record::KeyFrameRequest { stop_after: Some(3) },
            Record::Closed { job: 0 },
            Record::Frame(FrameRecord { map_created: None, idle: false, ..frame }),
            Record::End { version: 11, digest: 1 },
        ];
        let text = records.iter().fold(header.to_text(), |text, r| text + &r.to_line());
        (header, records, text)
    }

    #[test]
    fn round_trip() {
        let (header, records, text) = journal();
        let read = Journal::read(text.as_bytes()).unwrap();
        assert_eq!((read.header, read.records, read.cut), (header, records, None));
    }

    #[test]
    fn truncated_journal_is_read_up_to_the_cut() {
        let (header, records, text) = journal();
        let head = header.to_text().len();
        for end in 0..text.len() {
            match Journal::read(&text.as_bytes()[..end]) {
                Ok(read) => {
                    assert!(end >= head && read.cut.is_some());
                    assert_eq!(read.records, records[..read.records.len()]);
                    let whole = text[head..end].matches('\n').count();
                    assert_eq!(read.records.len(), whole, "every complete line counts");
                }
                Err(_) => assert!(end < head),
            }
        }
    }

    #[test]
    fn any_flipped_bit_is_detected() {
        let (_, records, text) = journal();
        for at in 0..text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            if let Ok(read) = Journal::read(&bytes) {
                assert!(read.cut.is_some(), "byte {at}");
                assert_eq!(read.records, records[..read.records.len()]);
            }
        }
    }

    #[test]
    fn other_versions_and_formats_are_refused() {
        let later = line("cairn-journal 2");
        assert_eq!(Journal::read(later.as_bytes()), Err(JournalError::Version { found: 2 }));
        for foreign in ["", "\n", "frame 1 2 3", "%PDF"] {
            assert_eq!(Journal::read(foreign.as_bytes()), Err(JournalError::Foreign));
        }
    }
}
