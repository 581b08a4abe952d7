//! Time stamps as integer nanoseconds.

use std::fmt;
use std::ops::Sub;

/// A time in nanoseconds of the source's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Stamp(pub i64);

impl Stamp {
    /// From seconds, rounded to the nearest nanosecond; saturates.
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// Seconds as a float, for display and differences; absolute epoch times lose precision below 100 ns.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// This stamp shifted by seconds.
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0 + (seconds * 1e9).round() as i64)
    }
}

impl Sub for Stamp {
    type Output = f64;
    /// Seconds from `rhs` to `self`.
    fn sub(self, rhs: Stamp) -> f64 {
        (self.0 - rhs.0) as f64 * 1e-9
    }
}

impl fmt::Display for Stamp {
    /// Seconds with exactly nine decimals, as in trajectory files.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let n = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09}", n / 1_000_000_000, n % 1_000_000_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displays_all_digits() {
        assert_eq!(Stamp(1_403_636_584_763_555_584).to_string(), "1403636584.763555584");
        assert_eq!(Stamp(-5).to_string(), "-0.000000005");
    }
}
