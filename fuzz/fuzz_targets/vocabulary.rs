//! Vocabulary files: any bytes are used or refused. The checksum is made to fit, so that what lies behind it is reached.
#![no_main]

use cairn_vision::bow::Vocabulary;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = Vocabulary::open(bytes.to_vec());
    let mut sealed = bytes.to_vec();
    if sealed.len() > 16 {
        let sum = crc32fast::hash(&sealed[16..]);
        sealed[12..16].copy_from_slice(&sum.to_le_bytes());
    }
    let Ok(vocabulary) = Vocabulary::open(sealed) else { return };
    let descriptors: Vec<[u8; 32]> = bytes.as_chunks().0.to_vec();
    let bag = vocabulary.bag(&descriptors);
    assert!(bag.words().windows(2).all(|w| w[0].0 < w[1].0));
    assert!(bag.is_empty() || (bag.similarity(&bag) - 1.0).abs() < 1e-3);
});
