//! Reading the small text files of data sets: lines, exact stamps, numbers, and errors that name the line.

use cairn_sensor::{SourceError, Stamp};
use std::path::Path;

/// Largest text file of a data set: the ground truth of an hour at 1000 Hz.
const MAX_BYTES: u64 = 512 * cairn_files::MIB;

/// The whole file as text (invalid UTF-8 becomes replacement characters).
pub fn read_text(path: &Path) -> Result<String, SourceError> {
    let bytes = cairn_files::read(path, MAX_BYTES).map_err(|e| {
        SourceError::new(
            path.display().to_string(),
            format!("cannot be read ({e})"),
            "check the path and its permissions",
        )
    })?;
    Ok(String::from_utf8(bytes).unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned()))
}

/// `file` or `file, line n`, as error messages name locations.
pub fn place(path: &Path, line: usize) -> String {
    if line == 0 { path.display().to_string() } else { format!("{}, line {line}", path.display()) }
}

/// Lines with data, with their numbers from 1: without blank lines and comments.
pub fn data_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim().trim_start_matches('\u{feff}')))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Fields separated by commas or blanks.
pub fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c == ',' || c.is_whitespace()).filter(|f| !f.is_empty())
}

/// The first `N` fields as finite numbers; `None` when there are fewer or one is not a number.
pub fn numbers<'a, const N: usize>(mut from: impl Iterator<Item = &'a str>) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    for v in &mut out {
        *v = from.next()?.parse().ok().filter(|v: &f64| v.is_finite())?;
    }
    Some(out)
}

/// A stamp in whole nanoseconds.
pub fn stamp_ns(field: &str) -> Option<Stamp> {
    field.parse().ok().and_then(in_range)
}

/// A stamp in decimal seconds, exact to the nanosecond.
pub fn stamp_seconds(field: &str) -> Option<Stamp> {
    cairn_eval::nanoseconds(field).and_then(in_range)
}

/// A stamp that leaves room for differences without overflow.
pub fn in_range(ns: i64) -> Option<Stamp> {
    (ns.unsigned_abs() < 1 << 61).then_some(Stamp(ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_keep_every_digit() {
        assert_eq!(stamp_seconds("1305031102.175304"), Some(Stamp(1_305_031_102_175_304_000)));
        assert_eq!(stamp_seconds("1403636584.763555584"), Some(Stamp(1_403_636_584_763_555_584)));
        assert_eq!(stamp_seconds("0.0000000015"), Some(Stamp(2)));
        assert_eq!(stamp_seconds("-2.5"), Some(Stamp(-2_500_000_000)));
        assert_eq!(stamp_seconds("1.037000e-01"), Some(Stamp(103_700_000)));
        assert_eq!(stamp_seconds("nan"), None);
        assert_eq!(stamp_seconds("99999999999999999999"), None);
        assert_eq!(stamp_seconds("x"), None);
    }

    #[test]
    fn numbers_must_be_finite() {
        assert_eq!(numbers::<2>(fields("1, 2.5,3")), Some([1.0, 2.5]));
        assert_eq!(numbers::<2>(fields("1,nan")), None);
        assert_eq!(numbers::<2>(fields("1")), None);
    }
}
