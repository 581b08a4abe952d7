//! A way on disk: one JSON object a line, the header first, only ever appended to.
//!
//! A crash can tear at most the last line; reading leaves that one out and says so, and recording can go on behind
//! the lines that are whole. A broken line anywhere else is an error that names the line.

use crate::route::{Route, RouteHeader, RoutePoint};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::Path;

/// Why a way could not be read.
#[derive(Debug, thiserror::Error)]
pub enum RouteError {
    /// The file could not be opened or read.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// A line is not what it should be.
    #[error("line {line}: {why}")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What is wrong.
        why: String,
    },
    /// Nothing that could be a header.
    #[error("not a recorded way: {0}")]
    Header(String),
}

/// Something to append to that can be made to last.
pub trait Durable: Write {
    /// Returns when all that was written has reached the disk.
    fn make_durable(&mut self) -> io::Result<()>;
}

impl Durable for File {
    fn make_durable(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// For tests and for ways kept in memory only.
impl Durable for Vec<u8> {
    fn make_durable(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Appends points to a file as they come.
pub struct RouteWriter {
    out: Box<dyn Durable + Send>,
}

impl RouteWriter {
    /// Creates the file (an existing one is refused, a record is never overwritten) and writes the header.
    pub fn create(path: &Path, header: &RouteHeader) -> io::Result<Self> {
        Self::new(Box::new(File::options().write(true).create_new(true).open(path)?), header)
    }

    /// Goes on with the record in a file, after a crash too: what was torn is cut off. Returns what is recorded so far.
    pub fn resume(path: &Path) -> Result<(Route, Self), RouteError> {
        let failed = |source| RouteError::File { path: path.display().to_string(), source };
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
    pub fn new(mut out: Box<dyn Durable + Send>, header: &RouteHeader) -> io::Result<Self> {
        write_line(&mut *out, header)?;
        out.make_durable()?;
        Ok(Self { out })
    }

    /// Appends one point, in one write.
    pub fn append(&mut self, point: &RoutePoint) -> io::Result<()> {
        write_line(&mut *self.out, point)
    }

    /// Appends a header that replaces the one before, and makes it last.
    pub fn go_on_as(&mut self, header: &RouteHeader) -> io::Result<()> {
        write_line(&mut *self.out, header)?;
        self.out.make_durable()
    }

    /// Makes all appended points last.
    pub fn make_durable(&mut self) -> io::Result<()> {
        self.out.make_durable()
    }
}

fn write_line<T: serde::Serialize>(out: &mut (dyn Durable + Send), value: &T) -> io::Result<()> {
    let mut line = serde_json::to_vec(value)?;
    line.push(b'\n');
    out.write_all(&line)
}

/// How many bytes of a record are whole, and whether they end with a line's end; without it, the last line is whole
/// all the same unless it is `torn`.
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
    /// Reads a way from a file.
    pub fn load(path: &Path) -> Result<Self, RouteError> {
        let file = File::open(path)
            .map_err(|source| RouteError::File { path: path.display().to_string(), source })?;
        Self::read(BufReader::new(file))
    }

    /// Writes the whole way to a new file.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        let mut writer = RouteWriter::create(path, &self.header)?;
        for p in &self.points {
            writer.append(p)?;
        }
        writer.make_durable()
    }

    /// The bytes of a record of this way.
    pub fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let mut bytes: Vec<u8> = Vec::new();
        write_line(&mut bytes, &self.header)?;
        self.points.iter().try_for_each(|p| write_line(&mut bytes, p))?;
        Ok(bytes)
    }

    /// Reads a way: header, then points; between them headers that replace the one before.
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
        check_header(&header)?;
        let mut route = Route::new(header);
        while let Some(number) = next(&mut line)? {
            let whole = line.last() == Some(&b'\n');
            match parse_point(&line, &route) {
                Ok(point) => route.points.push(point),
                Err(_) if !whole => route.torn = true,
                Err(why) => match serde_json::from_slice::<RouteHeader>(&line) {
                    Ok(header) => {
                        check_header(&header)?;
                        route.go_on_as(header);
                    }
                    Err(_) => return Err(RouteError::Line { line: number, why }),
                },
            }
        }
        Ok(route)
    }
}

fn check_header(header: &RouteHeader) -> Result<(), RouteError> {
    if header.format != RouteHeader::FORMAT && header.format != RouteHeader::FORMER_FORMAT {
        return Err(RouteError::Header(format!("the form is called {:?}", header.format)));
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

fn parse_point(line: &[u8], route: &Route) -> Result<RoutePoint, String> {
    let point: RoutePoint = serde_json::from_slice(line).map_err(|e| e.to_string())?;
    if !(point.anchor_from_camera.is_finite() && point.odom_from_camera.is_finite()) {
        return Err("a number is not finite".into());
    }
    if route.points.last().is_some_and(|last| last.stamp >= point.stamp) {
        return Err("time does not go forward".into());
    }
    Ok(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::Ground;
    use crate::route::{Anchor, Stretch};
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
    fn comes_back_as_written() {
        let route = Route::read(text().as_bytes()).unwrap();
        assert_eq!(route.points.len(), 3);
        assert!(!route.torn);
        let path = std::env::temp_dir().join(format!("cairn-way-{}.jsonl", std::process::id()));
        let _ = std::fs::remove_file(&path);
        route.save(&path).unwrap();
        let again = Route::load(&path).unwrap();
        assert!(route.save(&path).is_err(), "a record was overwritten");
        std::fs::remove_file(&path).unwrap();
        assert_eq!(again.header, route.header);
        for (a, b) in again.points.iter().zip(&route.points) {
            assert!((a.odom_from_camera.inverse() * b.odom_from_camera).log().norm() < 1e-12);
            assert_eq!((a.stamp, a.anchor, a.stretch), (b.stamp, b.anchor, b.stretch));
        }
    }

    #[test]
    fn a_torn_last_line_is_left_out_wherever_it_tears() {
        let text = text();
        let last = text.trim_end().rfind('\n').unwrap() + 1;
        for cut in last + 1..text.len() - 1 {
            let route = Route::read(&text.as_bytes()[..cut]).unwrap();
            assert_eq!((route.points.len(), route.torn), (2, true), "cut at {cut}");
        }
        // Only the line end is missing: the point itself is whole and is kept.
        assert_eq!(Route::read(&text.as_bytes()[..text.len() - 1]).unwrap().points.len(), 3);
    }

    #[test]
    fn a_record_goes_on_after_a_crash_wherever_it_was_torn() {
        let text = text();
        let path = std::env::temp_dir().join(format!("cairn-way-resume-{}.jsonl", std::process::id()));
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
        assert!(RouteWriter::resume(&path).is_err(), "there is no header to go on behind");
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn broken_files_are_told_with_their_line() {
        let told = |s: String| Route::read(s.as_bytes()).unwrap_err().to_string();
        assert!(told(String::new()).contains("empty"));
        assert!(told("hello\n".into()).contains("first line"));
        assert!(told(text().replace("\"version\":1", "\"version\":9")).contains("version 9"));
        assert!(told(text().replace("cairn-route", "other")).contains("other"));
        assert!(told(text().replace("[0.0,0.0,1.0]", "[0.0,0.0,0.0]")).contains("up"));
        assert!(told(text().replace("\"t\":1,", "\"t\":0,")).contains("line 3: time"));
        assert!(told(text().replace("\"t\":1,", "\"t\":x,")).contains("line 3"));
        assert!(told(text().replace("\"rel\":[0.0", "\"rel\":[1e999")).contains("line 2"));
    }
}
