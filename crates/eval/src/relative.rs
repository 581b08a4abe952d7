//! Pairs of poses for the relative pose error: a fixed number of frames, metres or seconds apart.
//!
//! The rules are evo's: consecutive pairs, or for every pose the pair whose distance is nearest to the requested one,
//! within a tolerance. Distances are path lengths along the estimate.

use crate::error::EvalError;
use cairn_geometry::Se3;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The distance between the two poses of a pair. As text: `1f`, `0.5m`, `2s`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Delta {
    /// Number of associated poses.
    Frames(usize),
    /// Path length in metres.
    Metres(f64),
    /// Time in seconds.
    Seconds(f64),
}

impl Default for Delta {
    /// One frame.
    fn default() -> Self {
        Self::Frames(1)
    }
}

impl fmt::Display for Delta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frames(n) => write!(f, "{n}f"),
            Self::Metres(d) => write!(f, "{d}m"),
            Self::Seconds(d) => write!(f, "{d}s"),
        }
    }
}

impl FromStr for Delta {
    type Err = EvalError;
    fn from_str(text: &str) -> Result<Self, EvalError> {
        let error = || {
            EvalError::Option(format!(
                "'{text}' is not a distance between poses; write frames, metres or seconds as 1f, 0.5m or 2s"
            ))
        };
        let number = |t: &str| t.parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0).ok_or_else(error);
        if let Some(n) = text.strip_suffix('m') {
            Ok(Self::Metres(number(n)?))
        } else if let Some(n) = text.strip_suffix('s') {
            Ok(Self::Seconds(number(n)?))
        } else {
            let n = text.strip_suffix('f').unwrap_or(text).parse::<usize>().map_err(|_| error())?;
            if n > 0 { Ok(Self::Frames(n)) } else { Err(error()) }
        }
    }
}

/// Index pairs `(i, j)`, `i < j`, that are `delta` apart.
///
/// Without `all_pairs` each pair starts where the previous one ended, and ends at the first pose at which the distance
/// is reached. With `all_pairs` each pose is paired with the later pose whose distance is nearest to the requested one,
/// if it differs by at most `tolerance` times that.
pub(crate) fn pairs(
    poses: &[Se3],
    stamps_ns: &[i64],
    delta: Delta,
    all_pairs: bool,
    tolerance: f64,
) -> Vec<(usize, usize)> {
    let n = poses.len();
    let (distances, wanted) = match delta {
        Delta::Frames(step) if all_pairs => return (step..n).map(|j| (j - step, j)).collect(),
        Delta::Frames(step) => {
            let ids: Vec<usize> = (0..n).step_by(step.max(1)).collect();
            return ids.windows(2).map(|w| (w[0], w[1])).collect();
        }
        Delta::Metres(d) => (path_lengths(poses), d),
        Delta::Seconds(d) => (seconds_from_start(stamps_ns), d),
    };
    if all_pairs {
        nearest_pairs(&distances, wanted, wanted * tolerance)
    } else {
        consecutive_pairs(&distances, wanted)
    }
}

fn path_lengths(poses: &[Se3]) -> Vec<f64> {
    let mut sum = 0.0;
    let steps = poses.windows(2).map(|w| (w[1].translation - w[0].translation).norm());
    std::iter::once(0.0)
        .chain(steps)
        .take(poses.len())
        .map(|step| {
            sum += step;
            sum
        })
        .collect()
}

fn seconds_from_start(stamps_ns: &[i64]) -> Vec<f64> {
    stamps_ns.iter().map(|s| s.abs_diff(stamps_ns[0]) as f64 * 1e-9).collect()
}

fn consecutive_pairs(distances: &[f64], wanted: f64) -> Vec<(usize, usize)> {
    let mut ids = vec![0];
    let mut start = 0.0;
    for (i, distance) in distances.iter().enumerate().skip(1) {
        // A relative tolerance of 1e-9, so that ten steps of 0.1 reach 1.
        if distance - start >= wanted * (1.0 - 1e-9) {
            ids.push(i);
            start = *distance;
        }
    }
    ids.windows(2).map(|w| (w[0], w[1])).collect()
}

fn nearest_pairs(distances: &[f64], wanted: f64, tolerance: f64) -> Vec<(usize, usize)> {
    let pair = |i: usize| {
        let rest = &distances[i + 1..];
        let target = distances[i] + wanted;
        let next = rest.partition_point(|d| *d < target);
        let difference = |k: usize| (rest[k] - target).abs();
        let best = match (next.checked_sub(1), next < rest.len()) {
            (Some(before), true) => {
                if difference(before) <= difference(next) {
                    before
                } else {
                    next
                }
            }
            (Some(before), false) => before,
            (None, true) => next,
            (None, false) => return None,
        };
        // The first of several poses at the same distance (no motion).
        let best = rest.partition_point(|d| *d < rest[best]);
        (difference(best) <= tolerance).then_some((i, i + 1 + best))
    };
    (0..distances.len()).filter_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    /// Pairs of poses on a straight line at these x, 0.1 s apart.
    fn on_line(xs: &[f64], delta: Delta, all_pairs: bool) -> Vec<(usize, usize)> {
        let poses: Vec<Se3> = xs.iter().map(|x| Se3::new(So3::identity(), Vec3::new(*x, 0.0, 0.0))).collect();
        let stamps_ns: Vec<i64> = (0..xs.len() as i64).map(|i| i * 100_000_000).collect();
        pairs(&poses, &stamps_ns, delta, all_pairs, 0.1)
    }

    #[test]
    fn delta_text_round_trips() {
        for (text, delta) in [
            ("1f", Delta::Frames(1)),
            ("10", Delta::Frames(10)),
            ("0.5m", Delta::Metres(0.5)),
            ("2s", Delta::Seconds(2.0)),
        ] {
            assert_eq!(text.parse::<Delta>().unwrap(), delta);
            assert_eq!(delta.to_string().parse::<Delta>().unwrap(), delta);
        }
        for text in ["", "0f", "-1m", "nanm", "m", "1.5f", "3km"] {
            assert!(text.parse::<Delta>().unwrap_err().to_string().contains("1f, 0.5m or 2s"), "{text}");
        }
    }

    #[test]
    fn pairs_by_frames_metres_and_seconds() {
        let t = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        assert_eq!(on_line(&t, Delta::Frames(3), false), [(0, 3), (3, 6)]);
        assert_eq!(on_line(&t, Delta::Frames(5), true), [(0, 5), (1, 6)]);
        assert_eq!(on_line(&t, Delta::Frames(9), true), []);
        assert_eq!(on_line(&t, Delta::Metres(1.5), false), [(0, 2), (2, 4), (4, 6)]);
        assert_eq!(on_line(&t, Delta::Metres(4.1), true), [(0, 4), (1, 5), (2, 6)]);
        assert_eq!(
            on_line(&t, Delta::Metres(4.5), true),
            [],
            "a difference of half a metre is beyond the tolerance"
        );
        assert_eq!(on_line(&t, Delta::Seconds(0.2), true), [(0, 2), (1, 3), (2, 4), (3, 5), (4, 6)]);
        let still = [0.0, 1.0, 1.0, 1.0, 2.0];
        assert_eq!(on_line(&still, Delta::Metres(1.0), true), [(0, 1), (1, 4), (2, 4), (3, 4)]);
        assert_eq!(on_line(&[], Delta::Seconds(1.0), true), []);
        assert_eq!(on_line(&[], Delta::Metres(1.0), false), []);
    }
}
