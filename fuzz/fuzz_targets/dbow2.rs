//! DBoW2's text form of a vocabulary: any bytes are read or refused; what was read is a vocabulary that works.
#![no_main]

use cairn_vision::bow::{Vocabulary, import_dbow2};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(vocabulary) = import_dbow2(bytes) else { return };
    let again = Vocabulary::open(vocabulary.bytes().to_vec());
    assert!(again.is_ok_and(|v| v.facts() == vocabulary.facts()));
    vocabulary.bag(&[[0; 32], [255; 32]]);
});
