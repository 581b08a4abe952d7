//! Numbers on the command line, within bounds.

use std::ops::{Bound, RangeBounds};

/// Above zero and finite.
pub const POSITIVE: (Bound<f64>, Bound<f64>) = (Bound::Excluded(0.0), Bound::Included(f64::MAX));

/// A word is not the number that is asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be {0}")]
pub struct NumberError(String);

/// A parser for a number within bounds, which `told` says in words.
pub fn number(
    bounds: impl RangeBounds<f64> + Clone + Send + Sync + 'static,
    told: impl Into<String>,
) -> impl Fn(&str) -> Result<f64, NumberError> + Clone + Send + Sync + 'static {
    let told = told.into();
    move |text| match text.parse::<f64>() {
        Ok(v) if bounds.contains(&v) => Ok(v),
        _ => Err(NumberError(told.clone())),
    }
}

/// A parser for a number from one to another, both included.
pub fn between(
    low: f64,
    high: f64,
) -> impl Fn(&str) -> Result<f64, NumberError> + Clone + Send + Sync + 'static {
    number(low..=high, format!("a number from {low} to {high}"))
}

/// A parser for a number above zero.
pub fn positive() -> impl Fn(&str) -> Result<f64, NumberError> + Clone + Send + Sync + 'static {
    number(POSITIVE, "a number above 0")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_beyond_their_bounds_are_refused_with_the_bounds() {
        assert_eq!(between(0.5, 2.0)("2"), Ok(2.0));
        assert_eq!(between(0.5, 2.0)("2.1").unwrap_err().to_string(), "must be a number from 0.5 to 2");
        assert_eq!(positive()("1e-300"), Ok(1e-300));
        for wrong in ["0", "-1", "inf", "nan", "x", ""] {
            assert_eq!(positive()(wrong).unwrap_err().to_string(), "must be a number above 0", "{wrong}");
        }
    }
}
