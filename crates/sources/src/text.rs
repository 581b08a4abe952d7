//! Reading the small text files of data sets: lines, exact stamps, numbers, and errors that name the line.

use cairn_sensor::{SourceError, Stamp};
use std::path::Path;

/// Largest text file of a data set: the ground truth of an hour at 1000 Hz.
const MAX_BYTES: u64 = 512 * cairn_files::MIB;

/// The whole file as text ([`cairn_files::read_text_lossy`]).
pub fn read_text(path: &Path) -> Result<String, SourceError> {
    cairn_files::read_text_lossy(path, MAX_BYTES).map_err(|e| {
        SourceError::new(
            path.display().to_string(),
            format!("cannot be read ({e})"),
            "check the path and its permissions",
        )
    })
}

/// `file` or `file, line n`, as error messages name locations.
pub fn place(path: &Path, line: usize) -> String {
    if line == 0 { path.display().to_string() } else { format!("{}, line {line}", path.display()) }
}

/// Lines with data, with their numbers from 1: without blank lines and comments.
pub fn data_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Fields separated by commas or blanks; in a line with semicolons, as spreadsheets write where a comma is decimal, by these.
pub fn fields(line: &str) -> impl Iterator<Item = &str> {
    let separator = if line.contains(';') { ';' } else { ',' };
    line.split(move |c: char| c == separator || c.is_whitespace()).filter(|f| !f.is_empty())
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

/// A stamp in whole nanoseconds, or in decimal seconds, or in nanoseconds that went through a floating-point number
/// (`1.403636579763555584e+18`).
pub fn stamp_any(field: &str) -> Option<Stamp> {
    stamp_ns(field).or_else(|| stamp_seconds(field))
}

/// A stamp written as date and time of day (`2011-09-26 13:02:25.964389445`), since 1970.
pub fn stamp_of_date(text: &str) -> Option<Stamp> {
    let (date, time) = text.trim().split_once([' ', 'T'])?;
    let [year, month, day] = numbers::<3>(date.split('-'))?.map(|v| v as i64);
    let (clock, seconds) = time.rsplit_once(':')?;
    let [hour, minute] = numbers::<2>(clock.split(':'))?.map(|v| v as i64);
    let valid = (1970..3000).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    if !valid {
        return None;
    }
    // Days since 1970 in the Gregorian calendar, years beginning in March (Hinnant, "chrono-compatible low-level date
    // algorithms", 2013).
    let (y, m) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let (era, of_era) = (y / 400, y % 400);
    let days =
        era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + (153 * m + 2) / 5 + day - 1 - 719_468;
    let whole = ((days * 24 + hour) * 60 + minute) * 60;
    in_range(whole.checked_mul(1_000_000_000)?.checked_add(stamp_seconds(seconds)?.0)?)
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
    fn times_are_read_in_every_form() {
        let at = Some(Stamp(1_317_042_145_964_389_445));
        assert_eq!(stamp_of_date("2011-09-26 13:02:25.964389445"), at);
        assert_eq!(stamp_of_date("1970-01-01 00:00:00"), Some(Stamp(0)));
        assert_eq!(stamp_of_date("2024-02-29 00:00:01"), Some(Stamp(1_709_164_801_000_000_000)));
        assert_eq!((stamp_of_date("2011-13-26 1:2:3"), stamp_of_date("13:02:25")), (None, None));
        for text in ["1403636579763555584", "1403636579.763555584", "1.403636579763555584e+18"] {
            assert_eq!(stamp_any(text), Some(Stamp(1_403_636_579_763_555_584)), "{text}");
        }
    }

    #[test]
    fn decimal_commas_are_no_separators() {
        assert_eq!(numbers::<2>(fields("1;2.5;3")), Some([1.0, 2.5]));
        assert_eq!(numbers::<2>(fields("1;2,5;3")), None);
    }

    #[test]
    fn numbers_must_be_finite() {
        assert_eq!(numbers::<2>(fields("1, 2.5,3")), Some([1.0, 2.5]));
        assert_eq!(numbers::<2>(fields("1,nan")), None);
        assert_eq!(numbers::<2>(fields("1")), None);
    }
}
