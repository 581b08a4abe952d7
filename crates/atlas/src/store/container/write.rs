//! Writing a container: parts one by one, then the header and the table that name them.

use super::super::error::StoreError;
use super::{Codec, ENTRY, Entry, HEADER, MAGIC, MAX_PLAIN_BYTES, MAX_RATIO};
use std::io::{self, Seek, SeekFrom, Write};

/// Writes parts one by one in the announced order; header and table are written last, into the room reserved
/// for them, so that an unfinished file has no header at all.
pub(crate) struct PartsWriter<'a, W: Write + Seek> {
    out: &'a mut W,
    version: u32,
    names: Vec<String>,
    entries: Vec<Entry>,
}

impl<'a, W: Write + Seek> PartsWriter<'a, W> {
    /// Reserves room for the header and a table with these names.
    pub fn begin(out: &'a mut W, version: u32, names: Vec<String>) -> Result<Self, StoreError> {
        for (i, name) in names.iter().enumerate() {
            if name.is_empty() || name.len() > usize::from(u16::MAX) || names[..i].contains(name) {
                return Err(StoreError::CombineError(format!("'{name}' cannot be the name of a part")));
            }
        }
        let room = HEADER + names.iter().map(|n| ENTRY + n.len()).sum::<usize>();
        out.write_all(&vec![0; room]).map_err(writing)?;
        Ok(Self { out, version, names, entries: Vec::new() })
    }

    /// Writes the next part.
    pub fn put(&mut self, plain: &[u8]) -> Result<(), StoreError> {
        let Some(name) = self.names.get(self.entries.len()).cloned() else {
            return Err(StoreError::CombineError("more parts than announced".into()));
        };
        if plain.len() as u64 > MAX_PLAIN_BYTES {
            return Err(StoreError::CombineError(format!("part '{name}' has {} bytes", plain.len())));
        }
        let packed = lz4_flex::block::compress(plain);
        let shrinks = packed.len() < plain.len() && plain.len() / MAX_RATIO <= packed.len();
        let (codec, stored) = if shrinks { (Codec::Lz4, &packed[..]) } else { (Codec::Plain, plain) };
        self.out.write_all(stored).map_err(writing)?;
        self.entries.push(Entry {
            name,
            codec,
            plain: plain.len() as u64,
            stored: stored.len() as u64,
            crc: crc32fast::hash(stored),
        });
        Ok(())
    }

    /// Writes header and table.
    pub fn finish(self) -> Result<(), StoreError> {
        if self.entries.len() != self.names.len() {
            return Err(StoreError::CombineError("fewer parts than announced".into()));
        }
        let mut table = Vec::new();
        for e in &self.entries {
            table.extend((e.name.len() as u16).to_le_bytes());
            table.extend(e.name.as_bytes());
            table.push(match e.codec {
                Codec::Plain => 0,
                Codec::Lz4 => 1,
            });
            table.extend(e.plain.to_le_bytes());
            table.extend(e.stored.to_le_bytes());
            table.extend(e.crc.to_le_bytes());
        }
        let length = HEADER as u64 + table.len() as u64 + self.entries.iter().map(|e| e.stored).sum::<u64>();
        let mut header = Vec::with_capacity(HEADER);
        header.extend(MAGIC);
        header.extend(self.version.to_le_bytes());
        header.extend((table.len() as u32).to_le_bytes());
        header.extend(length.to_le_bytes());
        header.extend(crc32fast::hash(&table).to_le_bytes());
        header.extend(crc32fast::hash(&header).to_le_bytes());
        self.out.seek(SeekFrom::Start(0)).map_err(writing)?;
        self.out.write_all(&header).map_err(writing)?;
        self.out.write_all(&table).map_err(writing)?;
        self.out.flush().map_err(writing)
    }
}

/// An error of a writer that does not know its path; the caller fills it in.
fn writing(source: io::Error) -> StoreError {
    StoreError::File { path: Default::default(), doing: "cannot write", source }
}
