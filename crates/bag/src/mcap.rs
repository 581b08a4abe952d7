//! MCAP files (mcap.dev/spec): records of `u8 kind, u64 length, content`, messages in chunks or outside.
//!
//! The summary at the end is not needed: records are walked from the start, so that files which were never closed, or are
//! cut, are read as far as they go.

use crate::area::{Area, InputFile, Memory};
use crate::compression::Compression;
use crate::error::{BagError, Damage};
use crate::index::{ChunkAt, Index, PREFIX, Place};
use crate::rosbag1::note_end;
use crate::wire::WireFormat;
use std::collections::BTreeMap;

/// The first and last bytes of such a file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The longest schema or channel record.
const MAX_RECORD: u64 = 16 << 20;

const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const DATA_END: u8 = 15;

/// Names of the schemas of a file.
type Schemas = BTreeMap<u16, String>;

/// Walks the file and fills the index.
pub(crate) fn scan(file: &mut InputFile, number: u16, index: &mut Index) -> Result<(), BagError> {
    let mut schemas = Schemas::new();
    let mut at = MAGIC.len() as u64;
    while at < file.end() {
        let head = file.get(at, 9).map(|head| (head[0], &head[1..]));
        let (kind, length) = match head.map(|(kind, rest)| (kind, rest.try_into().map(u64::from_le_bytes))) {
            Ok((kind, Ok(length))) => (kind, length),
            Ok(_) => return Ok(()),
            Err(damage) => {
                note_end(file, index, &damage);
                return Ok(());
            }
        };
        let content = at + 9;
        let whole = content.checked_add(length).is_some_and(|end| end <= file.end());
        let end = content.saturating_add(length).min(file.end());
        match kind {
            // What follows repeats what was read.
            DATA_END => return Ok(()),
            CHUNK => chunk(file, number, [at, content, end], whole, &mut schemas, index),
            _ if whole => {
                if let Err(damage) = one(file, kind, content, end, Place::PLAIN, number, &mut schemas, index)
                {
                    index.notes.push(format!("{}: byte {}: {}", file.shown(), damage.at, damage.why));
                }
            }
            _ => {}
        }
        if !whole {
            let there = file.end() - content;
            let why = format!("a record of {length} bytes begins, {there} follow");
            note_end(file, index, &Damage::new(at, why));
            return Ok(());
        }
        at = end;
    }
    let why = "the mark of the end is missing: it was not closed";
    note_end(file, index, &Damage::new(at, why));
    Ok(())
}

/// A chunk between `content` and `end`; the file may end within it.
fn chunk(
    file: &mut InputFile,
    number: u16,
    [at, content, end]: [u64; 3],
    whole: bool,
    schemas: &mut Schemas,
    index: &mut Index,
) {
    let outcome = open_chunk(file, number, content, end, schemas, index);
    // That the file ends within the chunk is told by the caller.
    if let (Err(damage), true) = (outcome, whole) {
        index.notes.push(format!(
            "{}: the chunk at byte {at} is read only in part ({})",
            file.shown(),
            damage.why
        ));
    }
}

fn open_chunk(
    file: &mut InputFile,
    number: u16,
    content: u64,
    end: u64,
    schemas: &mut Schemas,
    index: &mut Index,
) -> Result<(), Damage> {
    // Two times, the size, its CRC, then the name of the compression.
    let size = file.u64(content + 16)?;
    let crc = file.u32(content + 24)?;
    let name_length = u64::from(file.u32(content + 28)?);
    if name_length > 64 {
        return Err(Damage::new(content, format!("the name of its compression has {name_length} bytes")));
    }
    let compression = Compression::named(file.get(content + 32, name_length)?);
    let compression = compression.map_err(|why| Damage::new(content, why))?;
    let stated = file.u64(content + 32 + name_length)?;
    let from = content + 40 + name_length;
    let until = from.saturating_add(stated).min(end);
    if compression == Compression::None {
        return walk(file, from, until, Place::PLAIN, number, schemas, index);
    }
    let at = ChunkAt { at: from, length: until.saturating_sub(from), compression, size };
    let (bytes, mut why) = at.unpack(file)?;
    if why.is_none() && crc != 0 && crc32fast::hash(&bytes) != crc {
        why = Some("its checksum does not match".into());
    }
    let chunk = index.chunk(at);
    let walked = walk(&mut Memory(&bytes), 0, bytes.len() as u64, chunk, number, schemas, index);
    why.map_or(walked, |why| Err(Damage::new(content, why)))
}

/// The records of a chunk.
fn walk(
    area: &mut impl Area,
    from: u64,
    end: u64,
    chunk: u32,
    file: u16,
    schemas: &mut Schemas,
    index: &mut Index,
) -> Result<(), Damage> {
    let mut at = from;
    while at < end {
        let kind = area.get(at, 1)?[0];
        let length = area.u64(at + 1)?;
        let content = at + 9;
        let next = content.checked_add(length).filter(|next| *next <= end);
        let next = next.ok_or_else(|| Damage::new(at, format!("a record of {length} bytes is cut")))?;
        one(area, kind, content, next, chunk, file, schemas, index)?;
        at = next;
    }
    Ok(())
}

/// One record that is whole.
#[allow(clippy::too_many_arguments)]
fn one(
    area: &mut impl Area,
    kind: u8,
    content: u64,
    end: u64,
    chunk: u32,
    file: u16,
    schemas: &mut Schemas,
    index: &mut Index,
) -> Result<(), Damage> {
    let length = end - content;
    match kind {
        SCHEMA | CHANNEL if length > MAX_RECORD => {
            Err(Damage::new(content, format!("a description of {length} bytes")))
        }
        SCHEMA => {
            let mut fields = Fields { bytes: area.get(content, length)?, at: content };
            let id = fields.u16()?;
            schemas.insert(id, fields.string()?);
            Ok(())
        }
        CHANNEL => {
            let mut fields = Fields { bytes: area.get(content, length)?, at: content };
            let (id, schema) = (fields.u16()?, fields.u16()?);
            let (name, encoding) = (fields.string()?, fields.string()?);
            let format = match encoding.as_str() {
                "ros1" => WireFormat::Ros1,
                "cdr" => WireFormat::Cdr,
                _ => WireFormat::Other,
            };
            let of = schemas.get(&schema).map_or("", String::as_str);
            index.connection(file, u32::from(id), &name, of, format);
            Ok(())
        }
        MESSAGE => {
            const HEAD: u64 = 22;
            if length < HEAD {
                return Err(Damage::new(content, format!("a message record of {length} bytes")));
            }
            let data = length - HEAD;
            let short = u32::try_from(data).map_err(|_| Damage::new(content, "a message above 4 GB"))?;
            let bytes = area.get(content, HEAD + data.min(PREFIX))?;
            let channel = u16::from_le_bytes([bytes[0], bytes[1]]);
            let mut log = [0; 8];
            log.copy_from_slice(&bytes[6..14]);
            let place = Place { file, chunk, offset: content + HEAD, length: short };
            index.message(u32::from(channel), u64::from_le_bytes(log) as i64, &bytes[HEAD as usize..], place);
            Ok(())
        }
        _ => Ok(()),
    }
}

/// Fields of a schema or channel.
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
