//! Any damage to a file is detected, and never a panic.

use crate::store::history::{Dice, file};
use cairn_atlas::store::{MapFile, inspect};

#[test]
fn every_flipped_byte_is_detected() {
    let whole = file(3, 4, 6).write().unwrap();
    assert!(MapFile::read(&whole).is_ok());
    for at in 0..whole.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= flip;
            let message = MapFile::read(&bytes).expect_err("it was not seen").to_string();
            assert!(message.contains("part '") || message.starts_with("not a map file"), "{message}");
        }
    }
}

#[test]
fn every_truncation_is_detected() {
    let whole = file(3, 4, 6).write().unwrap();
    for cut in 0..whole.len() {
        let message = MapFile::read(&whole[..cut]).expect_err("it was not seen").to_string();
        assert!(
            message.contains("part '") || message.starts_with("not a map file: it is empty"),
            "{message}"
        );
    }
}

#[test]
fn damaged_parts_are_listed() {
    let mut bytes = file(3, 4, 6).write().unwrap();
    assert!(inspect(&bytes).unwrap().iter().all(|(_, wrong)| wrong.is_none()));
    bytes.truncate(bytes.len() - 3);
    let last = bytes.len() - 200;
    bytes[last] ^= 4;
    let message: Vec<(String, bool)> =
        inspect(&bytes).unwrap().into_iter().map(|(part, wrong)| (part.name, wrong.is_some())).collect();
    let wrong: Vec<&str> =
        message.iter().filter(|(_, wrong)| *wrong).map(|(name, _)| name.as_str()).collect();
    assert_eq!(wrong, ["features 0", "attached/way/home"], "{message:?}");
}

/// Recomputes all checksums of a file, so that altered content is not detected by them.
fn with_valid_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    let u32_at = |b: &[u8], at: usize| u32::from_le_bytes(std::array::from_fn(|i| b[at + i]));
    let table_end = 32 + u32_at(&bytes, 12) as usize;
    let (mut at, mut part) = (32, table_end);
    while at < table_end {
        let name = usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        let row = at + 2 + name;
        let stored = u32_at(&bytes, row + 9) as usize;
        let crc = crc32fast::hash(&bytes[part..part + stored]);
        bytes[row + 17..row + 21].copy_from_slice(&crc.to_le_bytes());
        (at, part) = (row + 21, part + stored);
    }
    let crc = crc32fast::hash(&bytes[32..table_end]);
    bytes[24..28].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32fast::hash(&bytes[..28]);
    bytes[28..32].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// With recomputed checksums, an altered byte gives either a valid map of other numbers or an error; never a
/// panic, and a map that is read satisfies the invariants.
#[test]
fn altered_content_with_valid_checksums_never_panics() {
    let whole = file(5, 5, 6).write().unwrap();
    assert_eq!(with_valid_checksums(whole.clone()), whole);
    let table_end = 32 + u32::from_le_bytes(std::array::from_fn(|i| whole[12 + i])) as usize;
    let mut dice = Dice::new(7);
    let (mut valid, mut refused) = (0, 0);
    for at in table_end..whole.len() {
        for _ in 0..4 {
            let mut bytes = whole.clone();
            bytes[at] = dice.roll(256) as u8;
            match MapFile::read(&with_valid_checksums(bytes)) {
                Ok(read) => {
                    assert_eq!(read.snapshot.check(), Ok(()));
                    valid += 1;
                }
                Err(_) => refused += 1,
            }
        }
    }
    assert!(valid > 100 && refused > 100, "{valid} valid, {refused} refused: too few to test anything");
}
