//! Map files: any bytes are read or refused, and what is read obeys the rules of a map, is written, and read again the
//! same. Bytes are tried as they are, and once more with all lengths and checksums put right, which else would stop
//! nearly everything at the door.
#![no_main]

use cairn_atlas::store::{MapFile, Table, inspect};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    take(bytes);
    if let Some(mended) = mended(bytes) {
        take(&mended);
    }
});

fn take(bytes: &[u8]) {
    let _ = (Table::read(bytes), inspect(bytes));
    let Ok(read) = MapFile::read(bytes) else { return };
    assert_eq!(read.snapshot.check(), Ok(()));
    let written = read.write().expect("what was read is not written");
    let again = MapFile::read(&written).expect("what was written is not read");
    assert_eq!(again.write().expect("what was read is not written"), written);
    for k in read.snapshot.key_frames() {
        assert!(read.snapshot.resolve(k.id, &Default::default()).is_some());
        read.snapshot.places().query(&k.bag, 3, |_| true);
    }
    let _ = read.snapshot.combined_with(&again.snapshot).map(|(both, _)| assert_eq!(both.check(), Ok(())));
}

/// The same bytes as a file whose header, table and parts fit each other, as far as there is a table.
fn mended(bytes: &[u8]) -> Option<Vec<u8>> {
    const HEADER: usize = 32;
    let mut bytes = bytes.to_vec();
    let put = |bytes: &mut Vec<u8>, at: usize, value: &[u8]| -> Option<()> {
        bytes.get_mut(at..at + value.len())?.copy_from_slice(value);
        Some(())
    };
    put(&mut bytes, 0, b"\x8ccairn\r\n")?;
    put(&mut bytes, 8, &1u32.to_le_bytes())?;
    let table = u32::from_le_bytes(bytes.get(12..16)?.try_into().ok()?) as usize;
    let end = HEADER.checked_add(table).filter(|end| *end <= bytes.len())?;
    let (mut row, mut part) = (HEADER, end);
    while row < end {
        let name = usize::from(u16::from_le_bytes(bytes.get(row..row + 2)?.try_into().ok()?));
        let fields = row + 2 + name;
        let next = fields + 1 + 8 + 8 + 4;
        if next > end {
            return None;
        }
        let stored = u64::from_le_bytes(bytes.get(fields + 9..fields + 17)?.try_into().ok()?);
        // The last part takes what is left; one that is too long is cut.
        let left = bytes.len() - part;
        let stored = if next == end { left } else { (stored as usize).min(left) };
        if bytes[fields] == 0 {
            put(&mut bytes, fields + 1, &(stored as u64).to_le_bytes())?;
        }
        put(&mut bytes, fields + 9, &(stored as u64).to_le_bytes())?;
        let crc = crc32fast::hash(&bytes[part..part + stored]);
        put(&mut bytes, fields + 17, &crc.to_le_bytes())?;
        (row, part) = (next, part + stored);
    }
    let length = bytes.len() as u64;
    put(&mut bytes, 16, &length.to_le_bytes())?;
    let crc = crc32fast::hash(&bytes[HEADER..end]);
    put(&mut bytes, 24, &crc.to_le_bytes())?;
    let crc = crc32fast::hash(&bytes[..28]);
    put(&mut bytes, 28, &crc.to_le_bytes())?;
    Some(bytes)
}
