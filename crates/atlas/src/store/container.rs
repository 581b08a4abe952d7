//! The container format: a header, a table of named parts, and the parts, each compressed and checksummed.
//!
//! All numbers are little-endian. Every byte of a file is covered by a checksum, and no length is trusted
//! before it has been compared with the bytes available.
//!
//! ```text
//! header, 32 bytes, the same in every version:
//!   magic 8 | version u32 | table bytes u32 | file bytes u64 | crc32 of the table u32 | crc32 of these 28 bytes u32
//! table, an entry a part, in the order of the file:
//!   name bytes u16 | name | codec u8 | plain bytes u64 | stored bytes u64 | crc32 of the stored bytes u32
//! parts, end to end until the end of the file
//! ```

mod write;

pub(crate) use write::PartsWriter;

use super::error::StoreError;
use std::io::{self, Read};

/// First bytes of a map file; the line ends reveal a transfer in text mode.
pub const MAGIC: [u8; 8] = *b"\x8ccairn\r\n";
pub(super) const HEADER: usize = 32;
/// Bytes of a table entry besides the name.
const ENTRY: usize = 2 + 1 + 8 + 8 + 4;
/// A part that would shrink by more than this is stored uncompressed, so that no small file can ask for much
/// memory.
const MAX_RATIO: usize = 32;
/// Longest part before compression, bytes.
const MAX_PLAIN_BYTES: u64 = 1 << 31;

/// How a part is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Codec {
    Plain,
    Lz4,
}

/// A part's row in the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Its name.
    pub name: String,
    codec: Codec,
    plain: u64,
    /// Bytes in the file.
    pub stored: u64,
    crc: u32,
}

/// A file's parts, found but not yet unpacked.
#[derive(Debug)]
pub(crate) struct Parts<'a> {
    /// Format version of the file.
    pub version: u32,
    /// Bytes of the file.
    pub bytes: u64,
    entries: Vec<(Entry, &'a [u8])>,
}

/// The row of a part in the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartInfo {
    /// Its name.
    pub name: String,
    /// Bytes in the file.
    pub stored_bytes: u64,
    /// Bytes when unpacked.
    pub plain_bytes: u64,
}

impl<'a> Parts<'a> {
    /// Parts of which the bytes are at hand, of a file of this version and length.
    pub fn of(version: u32, bytes: u64, entries: Vec<(Entry, &'a [u8])>) -> Self {
        Self { version, bytes, entries }
    }

    /// Reads header and table and checks that the length of the file is right; `newest` is the latest format
    /// version that can be read.
    pub fn open(bytes: &'a [u8], newest: u32) -> Result<Self, StoreError> {
        let (parts, promised) = Self::find(bytes, newest)?;
        for (entry, stored) in &parts.entries {
            check_length(entry, stored)?;
        }
        if promised != parts.bytes {
            let why = format!("it promises {promised} bytes, there are {}", parts.bytes);
            return Err(StoreError::part("header", why));
        }
        Ok(parts)
    }

    /// The same for a file that may be truncated or have surplus bytes; also returns the length that the
    /// header promises.
    pub fn find(bytes: &'a [u8], newest: u32) -> Result<(Self, u64), StoreError> {
        let Header { version, table_bytes, file_bytes, table_crc } = read_header(bytes, newest)?;
        let table = bytes[HEADER..].get(..table_bytes).ok_or_else(|| {
            let have = bytes.len() - HEADER;
            StoreError::part("table", format!("the file ends after {have} of its {table_bytes} bytes"))
        })?;
        if crc32fast::hash(table) != table_crc {
            return Err(StoreError::part("table", "its checksum does not match: bytes were altered"));
        }
        let entries = read_table(table)?;
        let mut parts = Self { version, bytes: bytes.len() as u64, entries: Vec::new() };
        let mut rest = &bytes[HEADER + table_bytes..];
        for entry in entries {
            let stored = usize::try_from(entry.stored).unwrap_or(usize::MAX);
            let (here, after) = rest.split_at(stored.min(rest.len()));
            parts.entries.push((entry, here));
            rest = after;
        }
        let length = if rest.is_empty() { file_bytes } else { parts.bytes - rest.len() as u64 };
        Ok((parts, length))
    }

    /// Finds the parts of a file whose header or table is damaged: reads entries of the table until they and their parts
    /// fill the file exactly. `None` where they never do.
    pub fn scan(bytes: &'a [u8], newest: u32) -> Option<Self> {
        let version = bytes.get(8..12)?.try_into().map(u32::from_le_bytes).ok()?;
        let version = if (1..=newest).contains(&version) { version } else { newest };
        let mut rest = bytes.get(HEADER..)?;
        let (mut entries, mut stored): (Vec<Entry>, u64) = (Vec::new(), 0);
        while stored < rest.len() as u64 {
            let (entry, after) = read_entry(rest)?;
            stored = stored.checked_add(entry.stored)?;
            entries.push(entry);
            rest = after;
        }
        if stored != rest.len() as u64 {
            return None;
        }
        let mut parts = Self { version, bytes: bytes.len() as u64, entries: Vec::new() };
        for entry in entries {
            let (here, after) = rest.split_at_checked(usize::try_from(entry.stored).ok()?)?;
            parts.entries.push((entry, here));
            rest = after;
        }
        Some(parts)
    }

    /// The table, each part with what is wrong with it.
    pub fn inspected(&self) -> Vec<(PartInfo, Option<StoreError>)> {
        let mut plain = Vec::new();
        self.infos()
            .into_iter()
            .map(|info| {
                let wrong = self.get_into(&info.name, &mut plain).err();
                (info, wrong)
            })
            .collect()
    }

    /// The table.
    pub fn infos(&self) -> Vec<PartInfo> {
        let info =
            |e: &Entry| PartInfo { name: e.name.clone(), stored_bytes: e.stored, plain_bytes: e.plain };
        self.entries.iter().map(|(e, _)| info(e)).collect()
    }

    /// Names of all parts in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|(e, _)| e.name.as_str())
    }

    /// A part's bytes, checked and unpacked.
    pub fn get(&self, name: &str) -> Result<Vec<u8>, StoreError> {
        let mut plain = Vec::new();
        self.get_into(name, &mut plain)?;
        Ok(plain)
    }

    /// The same into a reusable buffer.
    pub fn get_into(&self, name: &str, plain: &mut Vec<u8>) -> Result<(), StoreError> {
        let Some((entry, stored)) = self.entries.iter().find(|(e, _)| e.name == name) else {
            return Err(StoreError::part(name, "it is missing"));
        };
        entry.unpack(stored, plain)
    }
}

impl Entry {
    /// Checks the bytes of the part and unpacks them into a reusable buffer.
    pub fn unpack(&self, stored: &[u8], plain: &mut Vec<u8>) -> Result<(), StoreError> {
        let (entry, name) = (self, &self.name);
        self.check(stored)?;
        plain.clear();
        match entry.codec {
            Codec::Plain if entry.plain == entry.stored => plain.extend_from_slice(stored),
            Codec::Lz4
                if entry.plain <= MAX_PLAIN_BYTES && entry.plain / MAX_RATIO as u64 <= entry.stored =>
            {
                plain.resize(entry.plain as usize, 0);
                let unpacked = lz4_flex::block::decompress_into(stored, plain)
                    .map_err(|e| StoreError::part(name, format!("it cannot be unpacked: {e}")))?;
                if unpacked as u64 != entry.plain {
                    let why = format!("it unpacks to {unpacked} bytes, {} were promised", entry.plain);
                    return Err(StoreError::part(name, why));
                }
            }
            _ => {
                let why = format!("{} bytes cannot unpack to the promised {}", entry.stored, entry.plain);
                return Err(StoreError::part(name, why));
            }
        }
        Ok(())
    }

    /// Checks length and checksum of the bytes of the part.
    pub fn check(&self, stored: &[u8]) -> Result<(), StoreError> {
        check_length(self, stored)?;
        if crc32fast::hash(stored) != self.crc {
            return Err(StoreError::part(&self.name, "its checksum does not match: bytes were altered"));
        }
        Ok(())
    }

    /// Reads the bytes of the part from where the file stands into a reusable buffer; they are not checked.
    pub fn read(&self, file: &mut impl Read, stored: &mut Vec<u8>) -> io::Result<()> {
        stored.clear();
        file.take(self.stored).read_to_end(stored).map(|_| ())
    }
}

/// The first bytes of a file.
pub(super) struct Header {
    pub version: u32,
    pub table_bytes: usize,
    pub file_bytes: u64,
    pub table_crc: u32,
}

/// Reads the header from the start of a file; `newest` is the latest format version that can be read.
pub(super) fn read_header(bytes: &[u8], newest: u32) -> Result<Header, StoreError> {
    if bytes.is_empty() {
        return Err(StoreError::Foreign("it is empty".into()));
    }
    let start = &bytes[..bytes.len().min(MAGIC.len())];
    if start != &MAGIC[..start.len()] {
        return Err(StoreError::Foreign("it starts with other bytes".into()));
    }
    let damaged = |why: String| StoreError::part("header", why);
    let header: &[u8; HEADER] = bytes
        .first_chunk()
        .ok_or_else(|| damaged(format!("the file ends after {} of {HEADER} bytes", bytes.len())))?;
    let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
    if crc32fast::hash(&header[..28]) != u32_at(28) {
        return Err(damaged("its checksum does not match: bytes were altered".into()));
    }
    let version = u32_at(8);
    if version == 0 || version > newest {
        return Err(StoreError::Version { found: version, known: newest });
    }
    let file_bytes = u64::from_le_bytes(std::array::from_fn(|i| header[16 + i]));
    Ok(Header { version, table_bytes: u32_at(12) as usize, file_bytes, table_crc: u32_at(24) })
}

/// The length that the header of a file promises.
pub(super) fn promised_length(start: &[u8], newest: u32) -> Result<u64, StoreError> {
    read_header(start, newest).map(|header| header.file_bytes)
}

/// Refuses a truncated part.
fn check_length(entry: &Entry, stored: &[u8]) -> Result<(), StoreError> {
    if stored.len() as u64 == entry.stored {
        return Ok(());
    }
    let why = format!("the file ends after {} of its {} bytes", stored.len(), entry.stored);
    Err(StoreError::part(&entry.name, why))
}

pub(super) fn read_table(table: &[u8]) -> Result<Vec<Entry>, StoreError> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut rest = table;
    while !rest.is_empty() {
        let (entry, after) =
            read_entry(rest).ok_or_else(|| StoreError::part("table", "an entry is invalid"))?;
        entries.push(entry);
        rest = after;
    }
    let mut names: Vec<&str> = entries.iter().map(|e| e.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(StoreError::part("table", format!("part '{}' is listed twice", twice[0])));
    }
    Ok(entries)
}

fn read_entry(bytes: &[u8]) -> Option<(Entry, &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    let (name, rest) = rest.split_at_checked(usize::from(u16::from_le_bytes(*length)))?;
    let (codec, rest) = rest.split_first()?;
    let (plain, rest) = rest.split_first_chunk()?;
    let (stored, rest) = rest.split_first_chunk()?;
    let (crc, rest) = rest.split_first_chunk()?;
    let entry = Entry {
        name: String::from_utf8(name.to_vec()).ok()?,
        codec: match codec {
            0 => Codec::Plain,
            1 => Codec::Lz4,
            _ => return None,
        },
        plain: u64::from_le_bytes(*plain),
        stored: u64::from_le_bytes(*stored),
        crc: u32::from_le_bytes(*crc),
    };
    Some((entry, rest))
}

#[cfg(test)]
mod tests;
