//! rosbag1 files, "#ROSBAG V2.0" (wiki.ros.org/Bags/Format/2.0).
//!
//! A file is a sequence of records: `u32 length, header fields, u32 length, data`. The index at its end is not needed:
//! records are read from the start, so that files that were never closed or are truncated are read as far as possible.

use crate::area::{Area, InputFile, Memory};
use crate::compression::Compression;
use crate::error::{BagError, Damage};
use crate::index::{ChunkAt, Index, PREFIX, Place};
use crate::wire::WireFormat;

/// The first bytes of a rosbag1 file.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Greatest length of the header of a record: connection headers contain message definitions.
const MAX_HEADER: u64 = 16 << 20;

const MESSAGE: u8 = 2;
const BAG_HEADER: u8 = 3;
const CHUNK: u8 = 5;
const CONNECTION: u8 = 7;

/// The used fields of a record's header, and the position of its data.
struct Record {
    op: u8,
    fields: Fields,
    data_at: u64,
    /// As stated; the area may end before.
    data_length: u64,
}

#[derive(Default)]
struct Fields {
    connection: u32,
    time_ns: i64,
    topic: Vec<u8>,
    kind: Vec<u8>,
    compression: Vec<u8>,
    size: u32,
    encryptor: Vec<u8>,
}

/// Scans the file and fills the index.
pub(crate) fn scan(file: &mut InputFile, number: u16, index: &mut Index) -> Result<(), BagError> {
    let mut at = MAGIC.len() as u64;
    while at < file.end() {
        let record = match record(file, at) {
            Ok(record) => record,
            Err(damage) => {
                note_end(file, index, &damage);
                return Ok(());
            }
        };
        let whole = record.data_at.saturating_add(record.data_length) <= file.end();
        match record.op {
            BAG_HEADER if !record.fields.encryptor.is_empty() => {
                return Err(BagError::Unsupported {
                    path: file.shown(),
                    why: "is encrypted".into(),
                    cure: "decrypt it with rosbag decrypt".into(),
                });
            }
            CHUNK => chunk(file, number, &record, index),
            CONNECTION if whole => {
                if let Err(damage) = connection(file, number, &record, index) {
                    index.notes.push(format!("{}: byte {}: {}", file.shown(), damage.at, damage.why));
                }
            }
            _ => {}
        }
        if !whole {
            let there = file.end() - record.data_at;
            let why = format!("a record of {} bytes begins, {there} follow", record.data_length);
            note_end(file, index, &Damage::new(at, why));
            return Ok(());
        }
        at = record.data_at + record.data_length;
    }
    Ok(())
}

/// Adds a note, one sentence long, on how far the file could be read.
pub(crate) fn note_end(file: &InputFile, index: &mut Index, damage: &Damage) {
    index.notes.push(format!(
        "{}: damaged or cut at byte {} of {} ({}): read up to there, {} messages",
        file.shown(),
        damage.at,
        file.end(),
        damage.why,
        index.count()
    ));
}

fn record(area: &mut impl Area, at: u64) -> Result<Record, Damage> {
    let length = u64::from(area.u32(at)?);
    if length > MAX_HEADER {
        return Err(Damage::new(at, format!("a record header of {length} bytes")));
    }
    let (op, fields) = fields(area.get(at + 4, length)?, at)?;
    let op = op.ok_or_else(|| Damage::new(at, "a record without a kind"))?;
    let data_length = u64::from(area.u32(at + 4 + length)?);
    Ok(Record { op, fields, data_at: at + 8 + length, data_length })
}

/// The header fields: a sequence of `u32 length, name=value`; `at` is where they are in the file.
fn fields(mut bytes: &[u8], at: u64) -> Result<(Option<u8>, Fields), Damage> {
    let damaged = |why: &str| Damage::new(at, why);
    let (mut op, mut out) = (None, Fields::default());
    while !bytes.is_empty() {
        let (length, rest) =
            bytes.split_first_chunk::<4>().ok_or_else(|| damaged("a header field is cut"))?;
        let length = u32::from_le_bytes(*length) as usize;
        let field = rest.get(..length);
        let field = field.ok_or_else(|| damaged(&format!("a header field of {length} bytes is cut")))?;
        bytes = &rest[length..];
        let equals = field.iter().position(|b| *b == b'=');
        let equals = equals.ok_or_else(|| damaged("a header field without \"=\""))?;
        let (name, value) = (&field[..equals], &field[equals + 1..]);
        let number =
            || value.try_into().map(u32::from_le_bytes).map_err(|_| damaged("a number of wrong length"));
        match name {
            b"op" => op = value.first().copied(),
            b"conn" => out.connection = number()?,
            b"size" => out.size = number()?,
            b"time" => {
                let raw: [u8; 8] = value.try_into().map_err(|_| damaged("a time of wrong length"))?;
                let raw = u64::from_le_bytes(raw);
                let (seconds, ns) = (raw & 0xffff_ffff, raw >> 32);
                out.time_ns = (seconds * 1_000_000_000 + ns) as i64;
            }
            b"topic" => out.topic = value.to_vec(),
            b"type" => out.kind = value.to_vec(),
            b"compression" => out.compression = value.to_vec(),
            b"encryptor" => out.encryptor = value.to_vec(),
            _ => {}
        }
    }
    Ok((op, out))
}

fn connection(area: &mut impl Area, number: u16, record: &Record, index: &mut Index) -> Result<(), Damage> {
    if record.data_length > MAX_HEADER {
        return Err(Damage::new(record.data_at, format!("a connection of {} bytes", record.data_length)));
    }
    let data = area.get(record.data_at, record.data_length)?;
    let (_, about) = fields(data, record.data_at)?;
    let name = String::from_utf8_lossy(&record.fields.topic).into_owned();
    let kind = String::from_utf8_lossy(&about.kind).into_owned();
    index.connection(number, record.fields.connection, &name, &kind, WireFormat::Ros1);
    Ok(())
}

/// A chunk, which may reach beyond the end of a truncated file.
fn chunk(file: &mut InputFile, number: u16, record: &Record, index: &mut Index) {
    let end = record.data_at.saturating_add(record.data_length).min(file.end());
    let cut = end - record.data_at < record.data_length;
    let outcome = match Compression::named(&record.fields.compression) {
        Err(unknown) => Err(Damage::new(record.data_at, unknown.to_string())),
        Ok(Compression::None) => walk(file, record.data_at, end, Place::PLAIN, number, index),
        Ok(compression) => {
            let size = u64::from(record.fields.size);
            let at = ChunkAt { at: record.data_at, length: end - record.data_at, compression, size };
            at.unpack(file).and_then(|(bytes, why)| {
                let number_of_chunk = index.chunk(at);
                let all = bytes.len() as u64;
                let walked = walk(&mut Memory(&bytes), 0, all, number_of_chunk, number, index);
                why.map_or(walked, |why| Err(Damage::new(record.data_at, why)))
            })
        }
    };
    // If the file ends within the chunk, the caller reports that.
    if let (Err(damage), false) = (outcome, cut) {
        index.notes.push(format!(
            "{}: the chunk at byte {} is read only in part ({})",
            file.shown(),
            record.data_at,
            damage.why
        ));
    }
}

/// The connections and messages of a chunk.
fn walk(
    area: &mut impl Area,
    from: u64,
    end: u64,
    chunk: u32,
    file: u16,
    index: &mut Index,
) -> Result<(), Damage> {
    let mut at = from;
    while at < end {
        let record = record(area, at)?;
        let next = record.data_at.saturating_add(record.data_length);
        if next > end {
            return Err(Damage::new(at, format!("a record of {} bytes is cut", record.data_length)));
        }
        match record.op {
            CONNECTION => connection(area, file, &record, index)?,
            MESSAGE => {
                let prefix = area.get(record.data_at, record.data_length.min(PREFIX))?;
                let length = record.data_length as u32;
                let place = Place { file, chunk, offset: record.data_at, length };
                index.message(record.fields.connection, record.fields.time_ns, prefix, place);
            }
            _ => {}
        }
        at = next;
    }
    Ok(())
}
