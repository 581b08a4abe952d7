//! Where the parts of an open file are, so that each can be read by itself.

use super::container::{Entry, HEADER, Header, Parts, read_header, read_table};
use super::error::StoreError;
use std::io::Read;

/// Where the parts of an open file are, so that each can be read by itself.
#[derive(Debug)]
pub(crate) struct Places {
    /// Format version of the file.
    pub version: u32,
    /// Bytes of the file.
    pub bytes: u64,
    /// The parts, each with where it begins.
    pub entries: Vec<(Entry, u64)>,
}

impl Places {
    /// Reads header and table of a file of this length and checks that they fit it.
    pub fn read(file: &mut impl Read, bytes: u64, newest: u32) -> Result<Self, StoreError> {
        let reading = |source| StoreError::File { path: Default::default(), doing: "cannot read", source };
        let mut start = Vec::new();
        file.take(HEADER as u64).read_to_end(&mut start).map_err(reading)?;
        let Header { version, table_bytes, file_bytes, table_crc } = read_header(&start, newest)?;
        let mut table = Vec::new();
        file.take(table_bytes as u64).read_to_end(&mut table).map_err(reading)?;
        if crc32fast::hash(&table) != table_crc {
            return Err(StoreError::part("table", "its checksum does not match: bytes were altered"));
        }
        let mut at = (HEADER + table_bytes) as u64;
        let mut entries = Vec::new();
        for entry in read_table(&table)? {
            let next = at.checked_add(entry.stored).filter(|end| *end <= bytes);
            let next = next.ok_or_else(|| StoreError::part(&entry.name, "the file ends before it does"))?;
            entries.push((entry, std::mem::replace(&mut at, next)));
        }
        if at != bytes || file_bytes != bytes {
            let why = format!("it promises {file_bytes} bytes in {at} bytes of parts, there are {bytes}");
            return Err(StoreError::part("header", why));
        }
        Ok(Self { version, bytes, entries })
    }

    /// Parts of which the bytes are at hand.
    pub fn parts<'a>(&self, stored: impl Iterator<Item = (&'a Entry, &'a [u8])>) -> Parts<'a> {
        let entries = stored.map(|(entry, stored)| (entry.clone(), stored)).collect();
        Parts::of(self.version, self.bytes, entries)
    }
}
