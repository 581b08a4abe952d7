//! Journals: any bytes are read as far as they are whole, or refused; what was read is written and read again. Checksums are
//! made to fit, so that what lies behind them is reached.
#![no_main]

use cairn_engine::Journal;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    check(bytes);
    let mut sealed = Vec::new();
    for line in bytes.split(|b| *b == b'\n') {
        let payload = line.get(9..).unwrap_or(line);
        sealed.extend(format!("{:08x} ", crc32fast::hash(payload)).bytes());
        sealed.extend(payload);
        sealed.push(b'\n');
    }
    check(&sealed);
});

fn check(bytes: &[u8]) {
    let Ok(journal) = Journal::read(bytes) else { return };
    let text = journal.records.iter().fold(journal.header.to_text(), |text, r| text + &r.to_line());
    let again = Journal::read(text.as_bytes()).expect("what was written is not read");
    assert!(again.header == journal.header && again.records == journal.records);
}
