//! Round trips, and files that are damaged, truncated or arbitrary.

use super::*;
use proptest::prelude::*;
use std::io::Cursor;

fn written(parts: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let names = parts.iter().map(|(n, _)| n.to_string()).collect();
    let mut writer = PartsWriter::begin(&mut out, 1, names).unwrap();
    parts.iter().for_each(|(_, bytes)| writer.put(bytes).unwrap());
    writer.finish().unwrap();
    out.into_inner()
}

/// Compresses to a third.
fn even() -> Vec<u8> {
    (0..500u32).map(|i| (i / 8) as u8).collect()
}

fn sample() -> Vec<u8> {
    let noise: Vec<u8> = (0..300u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    written(&[("even", even()), ("none", vec![]), ("zeros", vec![0; 900]), ("noise", noise)])
}

/// All parts unpacked, or the first error.
fn all(bytes: &[u8]) -> Result<Vec<Vec<u8>>, StoreError> {
    let parts = Parts::open(bytes, 1)?;
    parts.names().map(|n| parts.get(n)).collect()
}

#[test]
fn parts_round_trip_and_compress() {
    let bytes = sample();
    let parts = Parts::open(&bytes, 1).unwrap();
    assert_eq!(parts.get("even").unwrap(), even());
    assert_eq!(parts.get("zeros").unwrap(), vec![0; 900]);
    assert_eq!(parts.get("none").unwrap(), Vec::<u8>::new());
    assert_eq!(parts.get("noise").unwrap().len(), 300);
    assert!(parts.get("other").unwrap_err().to_string().contains("part 'other': it is missing"));
    let info = &parts.infos()[0];
    assert_eq!(parts.infos()[2].stored_bytes, 900, "what would shrink too well is stored as it is");
    assert!(
        info.name == "even" && info.plain_bytes == 500 && (50..400).contains(&info.stored_bytes),
        "{info:?}"
    );
}

#[test]
fn every_flipped_bit_is_detected() {
    let whole = sample();
    for at in 0..whole.len() {
        for bit in 0..8 {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << bit;
            let message = all(&bytes).expect_err("a flipped bit was not detected").to_string();
            assert!(message.contains("part '") || message.contains("not a map"), "{message}");
        }
    }
}

#[test]
fn truncation_names_the_part() {
    let whole = sample();
    let parts = Parts::open(&whole, 1).unwrap();
    let sizes: Vec<usize> = parts.infos().iter().map(|i| i.stored_bytes as usize).collect();
    let start = whole.len() - sizes.iter().sum::<usize>();
    for cut in 0..whole.len() {
        let message = Parts::open(&whole[..cut], 1).unwrap_err().to_string();
        let expected = match cut {
            0 => "not a map file: it is empty",
            _ if cut < 32 => "part 'header'",
            _ if cut < start => "part 'table'",
            _ if cut < start + sizes[0] => "part 'even'",
            _ if cut < start + sizes[0] + 900 => "part 'zeros'",
            _ => "part 'noise'",
        };
        assert!(message.contains(expected), "cut at {cut}: {message}");
    }
    let longer = [&whole[..], b"more"].concat();
    assert!(Parts::open(&longer, 1).unwrap_err().to_string().contains("promises"));
}

#[test]
fn newer_version_is_refused_with_both_numbers() {
    let mut bytes = sample();
    bytes[8] = 7;
    let crc = crc32fast::hash(&bytes[..28]);
    bytes[28..32].copy_from_slice(&crc.to_le_bytes());
    let message = Parts::open(&bytes, 1).unwrap_err().to_string();
    assert_eq!(message, "the map has format version 7, this program reads versions 1 to 1");
}

#[test]
fn impossible_length_is_refused_before_allocation() {
    // 'even' promises to unpack to 2^30 bytes, with all checksums mended.
    let mut bytes = sample();
    let at = 32 + 2 + 4 + 1;
    bytes[at..at + 8].copy_from_slice(&(1u64 << 30).to_le_bytes());
    let table = u32::from_le_bytes(std::array::from_fn(|i| bytes[12 + i])) as usize;
    let crc = crc32fast::hash(&bytes[32..32 + table]);
    bytes[24..28].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32fast::hash(&bytes[..28]);
    bytes[28..32].copy_from_slice(&crc.to_le_bytes());
    let message = all(&bytes).unwrap_err().to_string();
    assert!(message.contains("part 'even'") && message.contains("cannot unpack"), "{message}");
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), keep in 0usize..40) {
        let mut mixed = sample()[..keep].to_vec();
        mixed.extend(bytes);
        prop_assert!(all(&mixed).is_err());
    }
}
