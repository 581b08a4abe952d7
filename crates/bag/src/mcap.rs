//! MCAP files (mcap.dev/spec): records of `u8 kind, u64 length, content`, with messages inside or outside of chunks.
//!
//! The summary at the end is not needed: records are read from the start, so that files that were never closed or are
//! truncated are read as far as possible.

use crate::area::{Area, InputFile, Memory};
use crate::compression::Compression;
use crate::error::{BagError, Damage};
use crate::index::{ChunkAt, Index, PREFIX, Place};
use crate::rosbag1::note_end;
use crate::wire::WireFormat;
use std::collections::BTreeMap;

/// The first and last bytes of an MCAP file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Greatest length of a schema or channel record.
const MAX_RECORD: u64 = 16 << 20;

const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const DATA_END: u8 = 15;

/// State of the scan of a file.
struct Walk<'a, 'b> {
    /// Number of the file in the bag.
    file: u16,
    /// Names of the schemas by id.
    schemas: BTreeMap<u16, String>,
    index: &'a mut Index<'b>,
}

/// Scans the file and fills the index.
pub(crate) fn scan(file: &mut InputFile, number: u16, index: &mut Index) -> Result<(), BagError> {
    let mut walk = Walk { file: number, schemas: BTreeMap::new(), index };
    if let Some(damage) = walk.records(file) {
        note_end(file, index, &damage);
    }
    Ok(())
}

impl Walk<'_, '_> {
    /// The records of the file up to the end of its data; returns where it is truncated.
    fn records(&mut self, file: &mut InputFile) -> Option<Damage> {
        let mut at = MAGIC.len() as u64;
        while at < file.end() {
            let [kind, length] = match head(file, at) {
                Ok(head) => head,
                Err(damage) => return Some(damage),
            };
            let content = at + HEAD;
            let whole = content.checked_add(length).is_some_and(|end| end <= file.end());
            let end = content.saturating_add(length).min(file.end());
            let outcome = match kind as u8 {
                // The rest repeats what was already read.
                DATA_END => return None,
                CHUNK => self.chunk(file, content, end),
                kind if whole => self.record(file, kind, [content, end], Place::PLAIN),
                _ => Ok(()),
            };
            // If the file ends within a chunk, that is reported below.
            if let (Err(damage), true) = (outcome, whole) {
                let what = if kind as u8 == CHUNK { "chunk" } else { "record" };
                self.index.notes.push(format!(
                    "{}: the {what} at byte {at} is read only in part ({})",
                    file.shown(),
                    damage.why
                ));
            }
            if !whole {
                let there = file.end() - content;
                return Some(Damage::new(at, format!("a record of {length} bytes begins, {there} follow")));
            }
            at = end;
        }
        Some(Damage::new(at, "the mark of the end is missing: it was not closed"))
    }

    /// A chunk between `content` and `end`; the file may end within it.
    fn chunk(&mut self, file: &mut InputFile, content: u64, end: u64) -> Result<(), Damage> {
        // Two times, the size, its CRC, then the name of the compression.
        let size = file.u64(content + 16)?;
        let crc = file.u32(content + 24)?;
        let name_length = u64::from(file.u32(content + 28)?);
        if name_length > 64 {
            return Err(Damage::new(content, format!("the name of its compression has {name_length} bytes")));
        }
        let compression = Compression::named(file.get(content + 32, name_length)?);
        let compression = compression.map_err(|unknown| Damage::new(content, unknown.to_string()))?;
        let stated = file.u64(content + 32 + name_length)?;
        let from = content + 40 + name_length;
        let until = from.saturating_add(stated).min(end);
        if compression == Compression::None {
            return self.within(file, [from, until], Place::PLAIN);
        }
        let at = ChunkAt { at: from, length: until.saturating_sub(from), compression, size };
        let (bytes, mut why) = at.unpack(file)?;
        if why.is_none() && crc != 0 && crc32fast::hash(&bytes) != crc {
            why = Some("its checksum does not match".into());
        }
        let chunk = self.index.chunk(at);
        let walked = self.within(&mut Memory(&bytes), [0, bytes.len() as u64], chunk);
        why.map_or(walked, |why| Err(Damage::new(content, why)))
    }

    /// The records of a chunk.
    fn within(&mut self, area: &mut impl Area, [from, end]: [u64; 2], chunk: u32) -> Result<(), Damage> {
        let mut at = from;
        while at < end {
            let [kind, length] = head(area, at)?;
            let content = at + HEAD;
            let next = content.checked_add(length).filter(|next| *next <= end);
            let next = next.ok_or_else(|| Damage::new(at, format!("a record of {length} bytes is cut")))?;
            self.record(area, kind as u8, [content, next], chunk)?;
            at = next;
        }
        Ok(())
    }

    /// One complete record.
    fn record(
        &mut self,
        area: &mut impl Area,
        kind: u8,
        [content, end]: [u64; 2],
        chunk: u32,
    ) -> Result<(), Damage> {
        let length = end - content;
        match kind {
            SCHEMA | CHANNEL if length > MAX_RECORD => {
                Err(Damage::new(content, format!("a description of {length} bytes")))
            }
            SCHEMA => {
                let mut fields = Fields { bytes: area.get(content, length)?, at: content };
                let id = fields.u16()?;
                self.schemas.insert(id, fields.string()?);
                Ok(())
            }
            CHANNEL => {
                let mut fields = Fields { bytes: area.get(content, length)?, at: content };
                let (id, schema) = (fields.u16()?, fields.u16()?);
                let (name, encoding) = (fields.string()?, fields.string()?);
                let format = match encoding.as_str() {
                    "ros1" => WireFormat::Ros1,
                    "cdr" => WireFormat::Cdr,
                    "protobuf" => WireFormat::Protobuf,
                    _ => WireFormat::Other,
                };
                let of = self.schemas.get(&schema).map_or("", String::as_str);
                self.index.connection(self.file, u32::from(id), &name, of, format);
                Ok(())
            }
            MESSAGE => self.message(area, [content, length], chunk),
            _ => Ok(()),
        }
    }

    /// Channel, sequence number, two times, then the data.
    fn message(
        &mut self,
        area: &mut impl Area,
        [content, length]: [u64; 2],
        chunk: u32,
    ) -> Result<(), Damage> {
        const FIELDS: u64 = 22;
        let data = length.checked_sub(FIELDS);
        let data = data.ok_or_else(|| Damage::new(content, format!("a message record of {length} bytes")))?;
        let short = u32::try_from(data).map_err(|_| Damage::new(content, "a message above 4 GB"))?;
        let bytes = area.get(content, FIELDS + data.min(PREFIX))?;
        let channel = u16::from_le_bytes([bytes[0], bytes[1]]);
        let mut log = [0; 8];
        log.copy_from_slice(&bytes[6..14]);
        let place = Place { file: self.file, chunk, offset: content + FIELDS, length: short };
        let log_ns = i64::try_from(u64::from_le_bytes(log)).unwrap_or(i64::MAX);
        self.index.message(u32::from(channel), log_ns, &bytes[FIELDS as usize..], place);
        Ok(())
    }
}

/// Bytes of a record before its content.
const HEAD: u64 = 9;

/// The kind and length of a record.
fn head(area: &mut impl Area, at: u64) -> Result<[u64; 2], Damage> {
    let kind = area.get(at, HEAD)?[0];
    Ok([u64::from(kind), area.u64(at + 1)?])
}

/// Reads the fields of a schema or channel.
struct Fields<'a> {
    bytes: &'a [u8],
    at: u64,
}

impl Fields<'_> {
    fn take(&mut self, n: usize) -> Result<&[u8], Damage> {
        let cut = || Damage::new(self.at, "a description is cut");
        let (head, rest) = self.bytes.split_at_checked(n).ok_or_else(cut)?;
        self.bytes = rest;
        Ok(head)
    }

    fn u16(&mut self) -> Result<u16, Damage> {
        self.take(2).map(|b| u16::from_le_bytes([b[0], b[1]]))
    }

    fn string(&mut self) -> Result<String, Damage> {
        let n = self.take(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))?;
        self.take(n as usize).map(|b| String::from_utf8_lossy(b).into_owned())
    }
}
