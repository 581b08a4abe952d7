//! BAL text: any bytes are read or refused; what was read is solved for a few steps, written and read again.
#![no_main]

use cairn_solve::Loss;
use cairn_solve::bal::{BalConfig, read, write};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(mut bal) = read(text) else { return };
    bal.solve(&BalConfig { iterations: 3, ..BalConfig::default() }, || false);
    bal.solve(&BalConfig { loss: Loss::Huber(1.0), iterations: 3, ..BalConfig::default() }, || false);
    assert!(read(&write(&bal)).is_ok(), "what was written is not read");
});
