//! A route on disk: one JSON object a line, the header first, then points and notes, only ever appended to.
//!
//! Each line ends with the CRC-32 of what stands before it in the line, `,"crc":"xxxxxxxx"}`; files of earlier builds have
//! none. A crash can truncate at most the last line; reading leaves that line out and reports it, and recording can continue
//! after the complete lines. A broken line anywhere else is an error that names the line.

use crate::notes::RouteNote;
use crate::route::{Route, RouteHeader, RoutePoint};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::Path;

/// Largest file of a route: some hundred kilometres.
const MAX_BYTES: u64 = 256 * cairn_files::MIB;

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

/// A writer whose data can be synced to the medium.
pub trait Durable: Write {
    /// Returns once everything written has reached the disk.
    ///
    /// # Errors
    /// Those of the disk.
    fn make_durable(&mut self) -> io::Result<()>;
}

impl Durable for File {
    fn make_durable(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// For tests and for routes kept in memory only.
impl Durable for Vec<u8> {
    fn make_durable(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Appends points to a file as they are recorded.
pub struct RouteWriter {
    out: Box<dyn Durable + Send>,
}

impl RouteWriter {
    /// Creates the file and writes the header.
    ///
    /// # Errors
    /// The system's error; an existing file is refused, so a recording is never overwritten.
    pub fn create(path: &Path, header: &RouteHeader) -> io::Result<Self> {
        Self::new(Box::new(File::options().write(true).create_new(true).open(path)?), header)
    }

    /// Continues the recording in a file, also after a crash: a truncated last line is removed. Returns the route so
    /// far.
    ///
    /// # Errors
    /// [`RouteError`] for a file that cannot be read or is no recorded route.
    pub fn resume(path: &Path) -> Result<(Route, Self), RouteError> {
        let failed = |source| RouteError::File { path: path.display().to_string(), source };
        drop(cairn_files::open(path, MAX_BYTES).map_err(failed)?);
        let mut file = File::options().read(true).append(true).open(path).map_err(failed)?;
        let mut route = Route::read(BufReader::new(&file))?;
        let (whole, ended) = whole_lines(&mut file, route.torn).map_err(failed)?;
        file.set_len(whole).map_err(failed)?;
        if !ended {
            file.write_all(b"\n").map_err(failed)?;
        }
        file.sync_data().map_err(failed)?;
        route.torn = false;
        Ok((route, Self { out: Box::new(file) }))
    }

    /// Writes the header to `out`.
    ///
    /// # Errors
    /// The writer's error.
    pub fn new(mut out: Box<dyn Durable + Send>, header: &RouteHeader) -> io::Result<Self> {
        write_line(&mut *out, header)?;
        out.make_durable()?;
        Ok(Self { out })
    }

    /// Appends one point, in one write.
    ///
    /// # Errors
    /// The writer's error.
    pub fn append(&mut self, point: &RoutePoint) -> io::Result<()> {
        write_line(&mut *self.out, point)
    }

    /// Appends a note, and syncs it.
    ///
    /// # Errors
    /// The writer's error.
    pub fn append_note(&mut self, note: &RouteNote) -> io::Result<()> {
        write_line(&mut *self.out, note)?;
        self.out.make_durable()
    }

    /// Appends a header that replaces the previous one, and syncs it.
    ///
    /// # Errors
    /// The writer's error.
    pub fn append_header(&mut self, header: &RouteHeader) -> io::Result<()> {
        write_line(&mut *self.out, header)?;
        self.out.make_durable()
    }

    /// Syncs all appended points.
    ///
    /// # Errors
    /// The writer's error.
    pub fn make_durable(&mut self) -> io::Result<()> {
        self.out.make_durable()
    }
}

fn write_line<T: serde::Serialize>(out: &mut (dyn Durable + Send), value: &T) -> io::Result<()> {
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
fn checksum(line: &[u8]) -> Option<bool> {
    let line = line.trim_ascii_end();
    // Eight digits, a quote and a brace end the line.
    let content = line.len().checked_sub(CRC_KEY.len() + 10)?;
    let (content, rest) = line.split_at(content);
    let digits = rest.strip_prefix(CRC_KEY)?.strip_suffix(b"\"}")?;
    let crc = u32::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
    Some(crc == crc32fast::hash(content))
}

/// Checks the checksum of a line; `needed` where the file has them.
fn check_line(line: &[u8], needed: bool) -> Result<(), String> {
    match checksum(line) {
        Some(true) => Ok(()),
        None if !needed => Ok(()),
        Some(false) => Err("its checksum does not match: bytes were altered".into()),
        None => Err("its checksum is missing: bytes were altered".into()),
    }
}

/// How many bytes of a recording are complete lines, and whether they end with a line end; without one, the last
/// line counts as complete unless it is `torn`.
fn whole_lines(file: &mut File, torn: bool) -> io::Result<(u64, bool)> {
    file.seek(SeekFrom::Start(0))?;
    let mut lines = BufReader::new(file);
    let (mut whole, mut line) = (0, Vec::new());
    loop {
        line.clear();
        let length = lines.read_until(b'\n', &mut line)? as u64;
        let ended = line.ends_with(b"\n");
        if length == 0 || (torn && !ended) {
            return Ok((whole, true));
        }
        whole += length;
        if !ended {
            return Ok((whole, false));
        }
    }
}

impl Route {
    /// Reads a route from a file.
    ///
    /// # Errors
    /// [`RouteError`], with the line where there is one.
    pub fn load(path: &Path) -> Result<Self, RouteError> {
        let file = cairn_files::open(path, MAX_BYTES)
            .map_err(|source| RouteError::File { path: path.display().to_string(), source })?;
        Self::read(BufReader::new(file))
    }

    /// Writes the whole route to a new file.
    ///
    /// # Errors
    /// The system's error; an existing file is refused.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        let mut writer = RouteWriter::create(path, &self.header)?;
        for p in &self.points {
            writer.append(p)?;
        }
        for note in &self.notes {
            writer.append_note(note)?;
        }
        writer.make_durable()
    }

    /// The bytes of a recording of this route.
    ///
    /// # Errors
    /// None in practice: writing to memory does not fail.
    pub fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes: Vec<u8> = Vec::new();
        write_line(&mut bytes, &self.header)?;
        self.points.iter().try_for_each(|p| write_line(&mut bytes, p))?;
        self.notes.iter().try_for_each(|n| write_line(&mut bytes, n))?;
        Ok(bytes)
    }

    /// Reads a route: header, then points and notes; later headers replace the one before.
    ///
    /// # Errors
    /// [`RouteError`], with the line where there is one.
    pub fn read(mut input: impl BufRead) -> Result<Self, RouteError> {
        let mut line = Vec::new();
        let mut number = 0;
        let mut next = |line: &mut Vec<u8>| {
            line.clear();
            number += 1;
            let read = input.read_until(b'\n', line);
            read.map(|n| (n > 0).then_some(number))
                .map_err(|e| RouteError::Line { line: number, why: e.to_string() })
        };
        if next(&mut line)?.is_none() {
            return Err(RouteError::Header("the file is empty".into()));
        }
        let header: RouteHeader =
            serde_json::from_slice(&line).map_err(|e| RouteError::Header(format!("first line: {e}")))?;
        check_line(&line, false).map_err(|why| RouteError::Header(format!("first line: {why}")))?;
        check_header(&header)?;
        let checked = checksum(&line).is_some();
        let mut route = Route::new(header);
        while let Some(number) = next(&mut line)? {
            let whole = line.last() == Some(&b'\n');
            match check_line(&line, checked).and_then(|()| parse_line(&line, &route)) {
                Ok(Line::Point(point)) => route.points.push(point),
                Ok(Line::Note(note)) => route.notes.push(note),
                Ok(Line::Header(header)) => {
                    check_header(&header)?;
                    route.apply_header(header);
                }
                Err(_) if !whole => route.torn = true,
                Err(why) => return Err(RouteError::Line { line: number, why }),
            }
        }
        Ok(route)
    }
}

fn check_header(header: &RouteHeader) -> Result<(), RouteError> {
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
enum Line {
    Point(RoutePoint),
    Note(RouteNote),
    Header(RouteHeader),
}

/// What a line is, by its first key.
fn parse_line(line: &[u8], route: &Route) -> Result<Line, String> {
    if line.starts_with(b"{\"format\"") {
        return serde_json::from_slice(line).map(Line::Header).map_err(|e| e.to_string());
    }
    if line.starts_with(b"{\"note\"") {
        let note: RouteNote = serde_json::from_slice(line).map_err(|e| e.to_string())?;
        if route.notes.len() >= RouteNote::MOST {
            return Err(format!("there are more than {} notes", RouteNote::MOST));
        }
        return note.check().map(|()| Line::Note(note)).map_err(|e| e.to_string());
    }
    parse_point(line, route).map(Line::Point)
}

fn parse_point(line: &[u8], route: &Route) -> Result<RoutePoint, String> {
    let point: RoutePoint = serde_json::from_slice(line).map_err(|e| e.to_string())?;
    if !(point.anchor_from_camera.is_finite() && point.odom_from_camera.is_finite()) {
        return Err("a value is not finite".into());
    }
    if route.points.last().is_some_and(|last| last.stamp >= point.stamp) {
        return Err("time does not increase".into());
    }
    Ok(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::anchor::Anchor;
    use crate::ground::Ground;
    use crate::route::Stretch;
    use cairn_geometry::{Se3, So3, Vec3};
    use cairn_sensor::Stamp;

    fn text() -> String {
        let mut s = serde_json::to_string(&RouteHeader::new(true, &Ground::z_up(), "test")).unwrap() + "\n";
        for k in 0..3 {
            let pose = Se3::new(So3::exp(&Vec3::new(0.1, 0.2, k as f64)), Vec3::new(k as f64, 0.25, -1.0));
            let point = RoutePoint {
                stamp: Stamp(k),
                anchor: Anchor { robot: 1, seq: 7 },
                anchor_from_camera: pose,
                odom_from_camera: pose,
                stretch: Stretch::Tracked,
                quality: 0.5,
            };
            s += &(serde_json::to_string(&point).unwrap() + "\n");
        }
        s
    }

    #[test]
    fn save_and_load_round_trip() {
        let route = Route::read(text().as_bytes()).unwrap();
        assert_eq!(route.points.len(), 3);
        assert!(!route.torn);
        let path = std::env::temp_dir().join(format!("cairn-route-{}.jsonl", std::process::id()));
        let _ = std::fs::remove_file(&path);
        route.save(&path).unwrap();
        let again = Route::load(&path).unwrap();
        assert!(route.save(&path).is_err(), "a recording was overwritten");
        std::fs::remove_file(&path).unwrap();
        assert_eq!(again.header, route.header);
        for (a, b) in again.points.iter().zip(&route.points) {
            assert!((a.odom_from_camera.inverse() * b.odom_from_camera).log().norm() < 1e-12);
            assert_eq!((a.stamp, a.anchor, a.stretch), (b.stamp, b.anchor, b.stretch));
        }
    }

    #[test]
    fn truncated_last_line_is_dropped() {
        let text = text();
        let last = text.trim_end().rfind('\n').unwrap() + 1;
        for cut in last + 1..text.len() - 1 {
            let route = Route::read(&text.as_bytes()[..cut]).unwrap();
            assert_eq!((route.points.len(), route.torn), (2, true), "cut at {cut}");
        }
        // Only the line end is missing: the point itself is complete and is kept.
        assert_eq!(Route::read(&text.as_bytes()[..text.len() - 1]).unwrap().points.len(), 3);
    }

    #[test]
    fn recording_resumes_after_truncation() {
        let text = text();
        let path = std::env::temp_dir().join(format!("cairn-route-resume-{}.jsonl", std::process::id()));
        let header = text.find('\n').unwrap() + 1;
        let mut after = Route::read(text.as_bytes()).unwrap().points[2];
        after.stamp = Stamp(9);
        let ends: Vec<usize> = text.match_indices('\n').map(|(i, _)| i).collect();
        let near_an_end = |cut: &usize| ends.iter().any(|end| end.abs_diff(*cut) < 3);
        for cut in (header..=text.len()).filter(|cut| cut % 37 == 0 || near_an_end(cut)) {
            std::fs::write(&path, &text.as_bytes()[..cut]).unwrap();
            let before = Route::load(&path).unwrap();
            let (so_far, mut writer) = RouteWriter::resume(&path).unwrap();
            assert_eq!((so_far.points.len(), so_far.torn), (before.points.len(), false), "cut at {cut}");
            writer.append(&after).unwrap();
            writer.make_durable().unwrap();
            let again = Route::load(&path).unwrap();
            assert!(!again.torn, "cut at {cut}");
            let (last, others) = again.points.split_last().unwrap();
            assert_eq!((last.stamp, others), (after.stamp, &before.points[..]), "cut at {cut}");
            assert_eq!(Route::read(&again.to_bytes().unwrap()[..]).unwrap().points.len(), again.points.len());
        }
        std::fs::write(&path, &text.as_bytes()[..header - 5]).unwrap();
        assert!(RouteWriter::resume(&path).is_err(), "a file without a header was resumed");
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn no_altered_byte_changes_a_route_unseen() {
        let route = Route::read(text().as_bytes()).unwrap();
        let bytes = route.to_bytes().unwrap();
        let same = Route::read(&bytes[..]).unwrap();
        assert_eq!((same.points.len(), same.torn), (3, false));
        for at in 0..bytes.len() - 1 {
            // White space where there was none, another digit, another letter.
            for flip in [0x01, 0x10, 0x20] {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                match Route::read(&damaged[..]) {
                    // In the name of the header's checksum: then the file reads as one without, and is the same.
                    Ok(read) => assert_eq!(read, same, "byte {at} flipped by {flip}"),
                    Err(e) => assert!(matches!(e, RouteError::Line { .. } | RouteError::Header(_)), "{e}"),
                }
            }
        }
        let error = Route::read(&bytes[..].replace_first(b"\"q\":0.5", b"\"q\":0.6")[..]).unwrap_err();
        assert_eq!(error.to_string(), "line 2: its checksum does not match: bytes were altered");
    }

    #[test]
    fn routes_with_checksums_resume_after_truncation() {
        let bytes = Route::read(text().as_bytes()).unwrap().to_bytes().unwrap();
        let second = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(1).unwrap().0 + 1;
        for cut in second..bytes.len() {
            let route = Route::read(&bytes[..cut]).unwrap();
            assert!((1..=3).contains(&route.points.len()), "cut at {cut}");
        }
    }

    #[test]
    fn notes_and_names_round_trip_and_old_files_have_none() {
        let old = Route::read(text().as_bytes()).unwrap();
        assert!(old.notes.is_empty() && old.header.name.is_none());
        let p = old.points[1];
        let note = RouteNote {
            text: "door to the yard".into(),
            side: Some(crate::Side::Left),
            stamp: p.stamp,
            anchor: p.anchor,
            anchor_from_camera: p.anchor_from_camera,
            odom_from_camera: p.odom_from_camera,
        };
        let mut bytes = old.to_bytes().unwrap();
        // A note may be taken before the last point, and the name come last.
        write_line(&mut bytes, &note).unwrap();
        let header =
            RouteHeader { name: Some("to the kitchen".into()), recorded_s: Some(5), ..old.header.clone() };
        write_line(&mut bytes, &header).unwrap();
        let read = Route::read(&bytes[..]).unwrap();
        assert_eq!((read.header.name.as_deref(), read.header.recorded_s), (Some("to the kitchen"), Some(5)));
        assert_eq!((&read.notes[0].text, read.notes[0].side, read.points.len()), (&note.text, note.side, 3));
        assert_eq!(Route::read(&read.to_bytes().unwrap()[..]).unwrap().notes.len(), 1);
        // Every altered byte of the note is found, a torn one is left out.
        let from = bytes.windows(7).position(|w| w == b"{\"note\"").unwrap();
        let to = from + bytes[from..].iter().position(|b| *b == b'\n').unwrap();
        for at in from..to {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert!(Route::read(&damaged[..]).is_err(), "byte {at}");
        }
        for cut in from + 1..to - 1 {
            let torn = Route::read(&bytes[..cut]).unwrap();
            assert_eq!((torn.notes.len(), torn.points.len(), torn.torn), (0, 3, true), "cut at {cut}");
        }
        for wrong in ["", "a\nb", &"x".repeat(121)] {
            assert!(RouteNote { text: wrong.into(), ..note.clone() }.check().is_err(), "{wrong:?}");
        }
    }

    trait Replace {
        fn replace_first(&self, from: &[u8], to: &[u8]) -> Vec<u8>;
    }

    impl Replace for [u8] {
        fn replace_first(&self, from: &[u8], to: &[u8]) -> Vec<u8> {
            let at = self.windows(from.len()).position(|w| w == from).expect("it is there");
            [&self[..at], to, &self[at + from.len()..]].concat()
        }
    }

    #[test]
    fn malformed_files_are_errors_with_line() {
        let message = |s: String| Route::read(s.as_bytes()).unwrap_err().to_string();
        assert!(message(String::new()).contains("empty"));
        assert!(message("hello\n".into()).contains("first line"));
        assert!(message(text().replace("\"version\":1", "\"version\":9")).contains("version 9"));
        assert!(message(text().replace("cairn-route", "other")).contains("other"));
        assert!(message(text().replace("[0.0,0.0,1.0]", "[0.0,0.0,0.0]")).contains("up"));
        assert!(message(text().replace("\"t\":1,", "\"t\":0,")).contains("line 3: time"));
        assert!(message(text().replace("\"t\":1,", "\"t\":x,")).contains("line 3"));
        assert!(message(text().replace("\"rel\":[0.0", "\"rel\":[1e999")).contains("line 2"));
    }
}
