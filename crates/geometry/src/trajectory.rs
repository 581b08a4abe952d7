//! Trajectories: poses in order of time, their interpolation, and the association of two trajectories by nearest time.
//!
//! Input: time stamps in nanoseconds and poses `world_from_body`. Output: poses at other times, and pairs of indices.
//! The association rule is that of the public tool evo, so that results can be compared.

use crate::{Se3, Vec3};
use std::fmt;

/// Poses `world_from_body` at non-decreasing times; two poses may have the same time, as happens in recorded ground
/// truth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    stamps_ns: Vec<i64>,
    poses: Vec<Se3>,
}

/// Why poses do not form a valid trajectory. The index is that of the invalid pose in the order given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrajectoryError {
    /// The time is earlier than that of the previous pose.
    Backwards {
        /// Index of the pose.
        index: usize,
        /// Time of the pose in nanoseconds.
        stamp_ns: i64,
        /// Time of the previous pose in nanoseconds.
        previous_ns: i64,
    },
    /// A number of the pose is NaN or infinite.
    NotFinite {
        /// Index of the pose.
        index: usize,
    },
}

impl fmt::Display for TrajectoryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Backwards { index, stamp_ns, previous_ns } => {
                write!(f, "pose {index}: time {stamp_ns} ns comes before {previous_ns} ns")
            }
            Self::NotFinite { index } => write!(f, "pose {index}: a number is NaN or infinite"),
        }
    }
}

impl std::error::Error for TrajectoryError {}

impl Trajectory {
    /// An empty trajectory.
    pub fn new() -> Self {
        Self::default()
    }

    /// From poses in any order; those with the same time keep their order.
    ///
    /// # Errors
    /// When a number is not finite; the index is that in order of time.
    pub fn from_unsorted(mut poses: Vec<(i64, Se3)>) -> Result<Self, TrajectoryError> {
        poses.sort_by_key(|(stamp, _)| *stamp);
        let mut out = Self::new();
        for (stamp_ns, pose) in poses {
            out.push(stamp_ns, pose)?;
        }
        Ok(out)
    }

    /// Appends a pose.
    ///
    /// # Errors
    /// When its time is earlier than that of the last pose or a number is not finite; the trajectory is left unchanged.
    pub fn push(&mut self, stamp_ns: i64, world_from_body: Se3) -> Result<(), TrajectoryError> {
        let index = self.len();
        if let Some(&previous_ns) = self.stamps_ns.last()
            && stamp_ns < previous_ns
        {
            return Err(TrajectoryError::Backwards { index, stamp_ns, previous_ns });
        }
        if !world_from_body.is_finite() {
            return Err(TrajectoryError::NotFinite { index });
        }
        self.stamps_ns.push(stamp_ns);
        self.poses.push(world_from_body);
        Ok(())
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// True without poses.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Times in nanoseconds, non-decreasing, (n).
    pub fn stamps_ns(&self) -> &[i64] {
        &self.stamps_ns
    }

    /// Poses `world_from_body`, (n).
    pub fn poses(&self) -> &[Se3] {
        &self.poses
    }

    /// Time and pose, in order.
    pub fn iter(&self) -> impl Iterator<Item = (i64, &Se3)> {
        self.stamps_ns.iter().copied().zip(&self.poses)
    }

    /// The same times with other poses.
    #[must_use]
    pub fn map(&self, pose: impl FnMut(&Se3) -> Se3) -> Self {
        Self { stamps_ns: self.stamps_ns.clone(), poses: self.poses.iter().map(pose).collect() }
    }

    /// Positions in metres, (n).
    pub fn positions(&self) -> Vec<Vec3> {
        self.poses.iter().map(|p| p.translation).collect()
    }

    /// Length of the polyline through all positions, in metres.
    pub fn length_m(&self) -> f64 {
        self.poses.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).sum()
    }

    /// Seconds from the first pose to the last; 0 with fewer than two poses.
    pub fn duration_s(&self) -> f64 {
        match (self.stamps_ns.first(), self.stamps_ns.last()) {
            (Some(a), Some(b)) => b.abs_diff(*a) as f64 * 1e-9,
            _ => 0.0,
        }
    }

    /// The pose at a time, interpolated between its two neighbours: position linearly, rotation spherically. `None`
    /// outside the range of times; the first of several poses at this time.
    pub fn at(&self, stamp_ns: i64) -> Option<Se3> {
        self.at_within(stamp_ns, u64::MAX)
    }

    /// As [`Self::at`], but also `None` when the two neighbours are more than `max_gap_ns` apart, so that gaps in the
    /// ground truth are not interpolated.
    pub fn at_within(&self, stamp_ns: i64, max_gap_ns: u64) -> Option<Se3> {
        let next = self.stamps_ns.partition_point(|s| *s < stamp_ns);
        if self.stamps_ns.get(next) == Some(&stamp_ns) {
            return Some(self.poses[next]);
        }
        let (previous, b) = (next.checked_sub(1)?, *self.stamps_ns.get(next)?);
        let a = self.stamps_ns[previous];
        let gap = b.abs_diff(a);
        let t = stamp_ns.abs_diff(a) as f64 / gap as f64;
        (gap <= max_gap_ns).then(|| self.poses[previous].interpolate(&self.poses[next], t))
    }

    /// Index of the pose nearest in time, the first of several equally near; `None` when empty.
    pub fn nearest(&self, stamp_ns: i64) -> Option<usize> {
        nearest(&self.stamps_ns, stamp_ns)
    }

    /// The poses at these indices; indices out of range are ignored.
    ///
    /// # Errors
    /// When the indices are not in order of time.
    pub fn select(&self, indices: &[usize]) -> Result<Self, TrajectoryError> {
        let mut out = Self::new();
        for &i in indices {
            if let (Some(stamp), Some(pose)) = (self.stamps_ns.get(i), self.poses.get(i)) {
                out.push(*stamp, *pose)?;
            }
        }
        Ok(out)
    }
}

/// Index of the value nearest to `value` in a sorted list, the first of several equally near.
fn nearest(sorted: &[i64], value: i64) -> Option<usize> {
    let next = sorted.partition_point(|s| *s < value);
    let before = next.checked_sub(1);
    match (before, sorted.get(next)) {
        (Some(b), Some(n)) if n.abs_diff(value) < value.abs_diff(sorted[b]) => Some(next),
        (Some(b), _) => Some(sorted.partition_point(|s| *s < sorted[b])),
        (None, Some(_)) => Some(next),
        (None, None) => None,
    }
}

/// Pairs `(index in reference, index in estimate)` nearest in time, at most `max_difference_s` seconds apart.
///
/// Each stamp of the shorter list (the estimate when both have the same length) is paired with the nearest stamp of the
/// other; a stamp of the longer list may be used twice. Both lists must be sorted. This is evo's rule including its
/// arithmetic: where a rounded stamp is in the middle between two others, differences of `f64` seconds decide (they are
/// multiples of 240 ns for epoch times), and the first is taken when these are equal.
pub fn associate(reference_ns: &[i64], estimate_ns: &[i64], max_difference_s: f64) -> Vec<(usize, usize)> {
    let estimate_is_longer = estimate_ns.len() > reference_ns.len();
    let (short, long) =
        if estimate_is_longer { (reference_ns, estimate_ns) } else { (estimate_ns, reference_ns) };
    let pair = |(i, stamp): (usize, &i64)| {
        let distance = |j: usize| (seconds(long[j]) - seconds(*stamp)).abs();
        let next = long.partition_point(|s| s < stamp);
        let before = next.checked_sub(1).map(|b| long.partition_point(|s| *s < long[b]));
        let next = (next < long.len()).then_some(next);
        let j = match (before, next) {
            (Some(b), Some(n)) => {
                if distance(n) < distance(b) {
                    n
                } else {
                    b
                }
            }
            (b, n) => b.or(n)?,
        };
        (distance(j) <= max_difference_s).then_some(if estimate_is_longer { (i, j) } else { (j, i) })
    };
    short.iter().enumerate().filter_map(pair).collect()
}

/// Seconds as the nearest `f64`, equal to the result of parsing the decimal text.
fn seconds(ns: i64) -> f64 {
    (ns / 1_000_000_000) as f64 + (ns % 1_000_000_000) as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::So3;

    fn at_x(x: f64, yaw: f64) -> Se3 {
        Se3::new(So3::exp(&Vec3::new(0.0, 0.0, yaw)), Vec3::new(x, 0.0, 0.0))
    }

    #[test]
    fn interpolates_between_poses_only() {
        let t = Trajectory::from_unsorted(vec![(30, at_x(3.0, 0.3)), (10, at_x(1.0, 0.1))]).unwrap();
        let mid = t.at(15).unwrap();
        assert!((mid.translation.x - 1.5).abs() < 1e-12);
        assert!((mid.rotation.log().z - 0.15).abs() < 1e-12);
        assert_eq!(t.at(10), Some(at_x(1.0, 0.1)));
        assert_eq!(t.at(30), Some(at_x(3.0, 0.3)));
        assert_eq!((t.at(9), t.at(31)), (None, None));
        assert_eq!(t.at_within(15, 19), None, "a gap is not interpolated");
        assert!(t.at_within(15, 20).is_some());
        assert!((t.length_m() - 2.0).abs() < 1e-12);
        assert_eq!(t.duration_s(), 20e-9);
        assert_eq!(Trajectory::new().at(0), None);
    }

    #[test]
    fn rejects_decreasing_time_and_nan() {
        let mut t = Trajectory::new();
        t.push(5, at_x(0.0, 0.0)).unwrap();
        let error = t.push(4, at_x(1.0, 0.0)).unwrap_err();
        assert_eq!(error, TrajectoryError::Backwards { index: 1, stamp_ns: 4, previous_ns: 5 });
        assert_eq!(t.push(6, at_x(f64::NAN, 0.0)), Err(TrajectoryError::NotFinite { index: 1 }));
        assert_eq!(t.len(), 1, "a rejected pose is not stored");
    }

    #[test]
    fn first_of_poses_with_the_same_time_is_used() {
        let mut t = Trajectory::new();
        for (ns, x) in [(0, 0.0), (10, 1.0), (10, 2.0), (20, 3.0)] {
            t.push(ns, at_x(x, 0.0)).unwrap();
        }
        assert_eq!(t.at(10).unwrap().translation.x, 1.0);
        assert_eq!(t.at(15).unwrap().translation.x, 2.5, "the last pose before");
        assert_eq!((t.nearest(9), t.nearest(12), t.nearest(19)), (Some(1), Some(1), Some(3)));
    }

    #[test]
    fn shorter_list_chooses_the_nearest() {
        let reference = [0, 10, 20, 30, 40];
        assert_eq!(associate(&reference, &[9, 21, 47], 5e-9), [(1, 0), (2, 1)]);
        assert_eq!(associate(&[9, 11], &reference, 5e-9), [(0, 1), (1, 1)], "a stamp may be used twice");
        assert_eq!(
            associate(&[0, 10], &[4, 4], 6e-9),
            [(0, 0), (0, 1)],
            "equal lengths: the estimate chooses"
        );
        assert_eq!(associate(&[0, 10, 10], &[9], 5e-9), [(1, 0)], "the first of two with the same time");
        assert_eq!(associate(&[], &reference, 5e-9), []);
        assert_eq!(associate(&[i64::MIN], &[i64::MAX], 5e-9), [], "extremes do not overflow");
    }

    #[test]
    fn ties_are_decided_in_float_seconds() {
        // Exactly in the middle, as rounded decimals of real recordings can be.
        let middle = 1_311_868_172_363_500_000;
        let (mut first, mut second) = (0, 0);
        for half in (1..200).map(|i| i * 50_000) {
            match associate(&[middle - half, middle + half], &[middle], 0.02)[..] {
                [(0, 0)] => first += 1,
                [(1, 0)] => second += 1,
                _ => panic!("no pair"),
            }
        }
        assert!(first > 0 && second > 0, "{first} took the first, {second} the second");
    }
}
