//! A route on disk: one JSON object a line, the header first, then points and notes, only ever appended to.
//!
//! Each line ends with the CRC-32 of what stands before it in the line, `,"crc":"xxxxxxxx"}`; files of earlier builds have
//! none. A crash can truncate at most the last line; reading leaves that line out and reports it, and recording can continue
//! after the complete lines. A broken line anywhere else is an error that names the line.

mod lines;
#[cfg(test)]
mod tests;

use crate::notes::RouteNote;
use crate::route::{Route, RouteHeader, RoutePoint};
pub use lines::RouteError;
use lines::{Line, check_header, check_line, checksum, parse_line, write_line};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::Path;

/// Largest file of a route: some hundred kilometres.
const MAX_BYTES: u64 = 256 * cairn_files::MIB;

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
                Err(e) => return Err(RouteError::Line { line: number, why: e.to_string() }),
            }
        }
        Ok(route)
    }
}
