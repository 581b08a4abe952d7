//! Exact conversion of decimal text to integer nanoseconds: a float would lose the digits of epoch times below 100 ns.

/// A time beyond this (10^11 s, the year 5138) must be nanoseconds written in the column for seconds, as some programs
/// do.
const MAX_SECONDS_NS: i128 = 100_000_000_000 * 1_000_000_000;

/// Nanoseconds of a time written in seconds (`1403636584.763555584`, `1.403715529112143517e+09`); numbers too large for
/// seconds are interpreted as nanoseconds. Rounds half away from zero; `None` for other text and out of range.
pub fn nanoseconds(text: &str) -> Option<i64> {
    let ns = scaled(text, 9)?;
    let ns = if ns.abs() > MAX_SECONDS_NS { scaled(text, 0)? } else { ns };
    i64::try_from(ns).ok()
}

/// The decimal number times `10^power`, rounded to the nearest integer.
fn scaled(text: &str, power: i32) -> Option<i128> {
    let (mantissa, exponent) = match text.find(['e', 'E']) {
        Some(at) => (&text[..at], text[at + 1..].parse::<i32>().ok()?),
        None => (text, 0),
    };
    let (negative, digits) = match mantissa.as_bytes().first()? {
        b'-' => (true, &mantissa[1..]),
        b'+' => (false, &mantissa[1..]),
        _ => (false, mantissa),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    if whole.is_empty() && fraction.is_empty() {
        return None;
    }
    let mut value: i128 = 0;
    let mut shift = exponent.checked_add(power)?;
    for (i, byte) in whole.bytes().chain(fraction.bytes()).enumerate() {
        if !byte.is_ascii_digit() {
            return None;
        }
        let in_fraction = i >= whole.len();
        // Digits too small to affect the rounding to an integer are dropped before they overflow.
        match value.checked_mul(10).and_then(|v| v.checked_add(i128::from(byte - b'0'))) {
            Some(v) if v < i128::MAX / 10 => {
                value = v;
                shift = shift.checked_sub(i32::from(in_fraction))?;
            }
            _ if in_fraction => {}
            _ => return None,
        }
    }
    let power_of_ten = 10i128.checked_pow(shift.unsigned_abs());
    let value = match (shift >= 0, power_of_ten) {
        (true, Some(p)) => value.checked_mul(p)?,
        (true, None) if value == 0 => 0,
        (true, None) => return None,
        (false, Some(p)) => (value + p / 2) / p,
        (false, None) => 0,
    };
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::nanoseconds;

    #[test]
    fn conversion_is_exact() {
        for (text, ns) in [
            ("1403636584.763555584", 1_403_636_584_763_555_584),
            ("1.403715529112143517e+09", 1_403_715_529_112_143_517),
            ("1311868163.8697", 1_311_868_163_869_700_000),
            ("0", 0),
            ("-0.000000005", -5),
            ("+.5", 500_000_000),
            ("5.", 5_000_000_000),
            ("0.0000000005", 1),
            ("0.00000000049999999999999999999999999999999999999999999", 0),
            ("1e-400", 0),
            ("0e900", 0),
            ("1403636584763555584", 1_403_636_584_763_555_584),
            ("1403636584763555584.000000", 1_403_636_584_763_555_584),
        ] {
            assert_eq!(nanoseconds(text), Some(ns), "{text}");
        }
        for text in ["", "-", ".", "e5", "1.2.3", "abc", "nan", "inf", "1e", "0x10", "1e400", "1e30", "12 "] {
            assert_eq!(nanoseconds(text), None, "{text}");
        }
    }
}
