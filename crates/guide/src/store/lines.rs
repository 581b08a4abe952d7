//! The lines of a route's file: their checksums, and what they hold.

use crate::notes::{NoteError, RouteNote};
use crate::route::{Route, RouteHeader, RoutePoint};
use std::io;

/// Why a route could not be read.
#[derive(Debug, thiserror::Error)]
pub enum RouteError {
    /// The file could not be opened or read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// A line is malformed.
    #[error("line {line}: {why}")]
    Line {
        /// Line number, counted from 1.
        line: usize,
        /// What is wrong with it.
        why: String,
    },
    /// There is no usable header.
    #[error("not a recorded route: {0}")]
    Header(String),
}

/// What is wrong with a line; [`RouteError`] says which.
#[derive(Debug, thiserror::Error)]
pub(super) enum LineError {
    #[error("its checksum does not match: bytes were altered")]
    Checksum,
    #[error("its checksum is missing: bytes were altered")]
    NoChecksum,
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    #[error("there are more than {} notes", RouteNote::MOST)]
    TooManyNotes,
    #[error(transparent)]
    Note(#[from] NoteError),
    #[error("a value is not finite")]
    NotFinite,
    #[error("time does not increase")]
    Time,
}

pub(super) fn write_line<T: serde::Serialize>(
    out: &mut (impl io::Write + ?Sized),
    value: &T,
) -> io::Result<()> {
    let mut line = serde_json::to_vec(value)?;
    // The brace that closes the object comes after the checksum.
    line.pop();
    let crc = crc32fast::hash(&line);
    line.extend_from_slice(CRC_KEY);
    line.extend_from_slice(format!("{crc:08x}\"}}\n").as_bytes());
    out.write_all(&line)
}

/// What stands between the content of a line and its checksum.
const CRC_KEY: &[u8] = b",\"crc\":\"";

/// Whether a line has a checksum that matches; `None` where it has none.
pub(super) fn checksum(line: &[u8]) -> Option<bool> {
    let line = line.trim_ascii_end();
    // Eight digits, a quote and a brace end the line.
    let content = line.len().checked_sub(CRC_KEY.len() + 10)?;
    let (content, rest) = line.split_at(content);
    let digits = rest.strip_prefix(CRC_KEY)?.strip_suffix(b"\"}")?;
    let crc = u32::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
    Some(crc == crc32fast::hash(content))
}

/// Checks the checksum of a line; `needed` where the file has them.
pub(super) fn check_line(line: &[u8], needed: bool) -> Result<(), LineError> {
    match checksum(line) {
        Some(true) => Ok(()),
        None if !needed => Ok(()),
        Some(false) => Err(LineError::Checksum),
        None => Err(LineError::NoChecksum),
    }
}

pub(super) fn check_header(header: &RouteHeader) -> Result<(), RouteError> {
    if header.format != RouteHeader::FORMAT && header.format != RouteHeader::FORMER_FORMAT {
        return Err(RouteError::Header(format!("the format is called {:?}", header.format)));
    }
    if header.version != RouteHeader::VERSION {
        let (found, known) = (header.version, RouteHeader::VERSION);
        return Err(RouteError::Header(format!("version {found}, this program reads version {known}")));
    }
    if crate::Ground::new(header.up.into()).is_none() {
        return Err(RouteError::Header(format!("{:?} does not point up", header.up)));
    }
    Ok(())
}

/// A line after the first.
pub(super) enum Line {
    Point(RoutePoint),
    Note(RouteNote),
    Header(RouteHeader),
}

/// What a line is, by its first key.
pub(super) fn parse_line(line: &[u8], route: &Route) -> Result<Line, LineError> {
    if line.starts_with(b"{\"format\"") {
        return Ok(Line::Header(serde_json::from_slice(line)?));
    }
    if line.starts_with(b"{\"note\"") {
        let note: RouteNote = serde_json::from_slice(line)?;
        if route.notes.len() >= RouteNote::MOST {
            return Err(LineError::TooManyNotes);
        }
        note.check()?;
        return Ok(Line::Note(note));
    }
    parse_point(line, route).map(Line::Point)
}

fn parse_point(line: &[u8], route: &Route) -> Result<RoutePoint, LineError> {
    let point: RoutePoint = serde_json::from_slice(line)?;
    if !(point.anchor_from_camera.is_finite() && point.odom_from_camera.is_finite()) {
        return Err(LineError::NotFinite);
    }
    if route.points.last().is_some_and(|last| last.stamp >= point.stamp) {
        return Err(LineError::Time);
    }
    Ok(point)
}
