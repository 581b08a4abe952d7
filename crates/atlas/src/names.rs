//! Names that last: which robot created a key frame or landmark, and its number there.
//!
//! An id ([`KeyFrameId`], [`LandmarkId`]) is a place in one atlas; when two atlases become one, those of the second move.
//! A name does not change, wherever the key frame goes: routes and messages use names. Robots create ids in order and
//! atlases are joined in one piece, so a name follows from a short table of stretches: nothing is stored at each key
//! frame or landmark, and ids stay four bytes.

use std::collections::BTreeMap;

/// A robot, phone or person that creates key frames; 0 where nobody said.
pub type RobotId = u16;

/// The lasting name of a key frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyFrameName {
    /// The robot that created it.
    pub robot: RobotId,
    /// Its number there, from 0; never reused.
    pub seq: u32,
}

/// The lasting name of a landmark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LandmarkName {
    /// The robot that created it.
    pub robot: RobotId,
    /// Its number there, from 0; never reused.
    pub seq: u32,
}

/// Consecutive ids that one robot created; they end where the next stretch begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stretch {
    /// Index of the first id.
    pub first: usize,
    /// Who created them.
    pub robot: RobotId,
    /// Number of the first there.
    pub seq: u32,
}

/// The names of all ids of one kind, removed ones included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stretches(pub Vec<Stretch>);

impl Stretches {
    fn of(robot: RobotId) -> Self {
        Self(vec![Stretch { first: 0, robot, seq: 0 }])
    }

    pub(crate) fn name(&self, index: usize) -> (RobotId, u32) {
        let at = self.0.partition_point(|s| s.first <= index).saturating_sub(1);
        self.0.get(at).map_or((0, index as u32), |s| (s.robot, s.seq + (index - s.first) as u32))
    }

    /// Each stretch with the number of its ids, when `next` is the index of the id that comes next.
    pub(crate) fn lengths(&self, next: usize) -> impl Iterator<Item = (&Stretch, usize)> {
        let ends = self.0.iter().skip(1).map(|s| s.first).chain([next]);
        self.0.iter().zip(ends).map(|(s, end)| (s, end.saturating_sub(s.first)))
    }

    pub(crate) fn index(&self, robot: RobotId, seq: u32, next: usize) -> Option<usize> {
        self.lengths(next).find_map(|(s, length)| {
            let beyond = seq.checked_sub(s.seq)? as usize;
            (s.robot == robot && beyond < length).then_some(s.first + beyond)
        })
    }

    /// The number after all those of a robot.
    pub(crate) fn next_seq(&self, robot: RobotId, next: usize) -> u32 {
        let own = self.lengths(next).filter(|(s, _)| s.robot == robot);
        own.map(|(s, length)| s.seq + length as u32).max().unwrap_or(0)
    }

    pub(crate) fn continue_as(&mut self, robot: RobotId, next: usize) {
        let seq = self.next_seq(robot, next);
        if self.0.last().is_some_and(|s| s.first == next) {
            self.0.pop();
        }
        if self.0.last().is_none_or(|s| s.robot != robot || s.seq + (next - s.first) as u32 != seq) {
            self.0.push(Stretch { first: next, robot, seq });
        }
    }

    pub(crate) fn append(
        &mut self,
        next: usize,
        other: &Self,
        other_next: usize,
        renamed: &BTreeMap<RobotId, RobotId>,
    ) {
        if self.0.last().is_some_and(|s| s.first == next) {
            self.0.pop();
        }
        for (s, _) in other.lengths(other_next).filter(|(_, length)| *length > 0) {
            let robot = renamed.get(&s.robot).copied().unwrap_or(s.robot);
            self.0.push(Stretch { first: next + s.first, robot, seq: s.seq });
        }
        if self.0.is_empty() {
            *self = Self::of(0);
        }
    }

    /// The robots of which both have an id of the same name.
    pub(crate) fn clashes<'a>(
        &'a self,
        next: usize,
        other: &'a Self,
        other_next: usize,
    ) -> impl Iterator<Item = RobotId> + 'a {
        self.lengths(next).flat_map(move |(a, n)| {
            let meets = move |(b, m): &(&Stretch, usize)| {
                let (a0, b0) = (u64::from(a.seq), u64::from(b.seq));
                a.robot == b.robot && a0 < b0 + *m as u64 && b0 < a0 + n as u64
            };
            other.lengths(other_next).filter(meets).map(|(b, _)| b.robot)
        })
    }

    /// Whether this names `next` ids, each differently: for a table that was read.
    pub fn is_valid(&self, next: usize) -> bool {
        let starts = self.0.first().is_some_and(|s| s.first == 0);
        let rises = self.0.windows(2).all(|w| w[0].first < w[1].first);
        let within = self.0.iter().all(|s| s.first <= next);
        let counts =
            || self.lengths(next).map(|(s, n)| (s.robot, u64::from(s.seq), u64::from(s.seq) + n as u64));
        let mut sorted: Vec<_> = counts().filter(|(_, from, to)| from < to).collect();
        sorted.sort_unstable();
        let apart = sorted.windows(2).all(|w| w[0].0 != w[1].0 || w[0].2 <= w[1].1);
        starts && rises && within && apart && counts().all(|(.., to)| to <= u64::from(u32::MAX))
    }
}

/// The names of all key frames and landmarks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Names {
    pub key_frames: Stretches,
    pub landmarks: Stretches,
}

impl Default for Names {
    fn default() -> Self {
        Self { key_frames: Stretches::of(0), landmarks: Stretches::of(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn a_robot_that_comes_back_goes_on_counting() {
        let mut s = Stretches::of(3);
        s.continue_as(3, 10);
        assert_eq!(s.0.len(), 1, "the same robot goes on");
        s.continue_as(7, 10);
        s.continue_as(3, 25);
        assert_eq!([9, 10, 24, 25, 30].map(|i| s.name(i)), [(3, 9), (7, 0), (7, 14), (3, 10), (3, 15)]);
        assert_eq!([s.index(3, 12, 28), s.index(7, 15, 28), s.index(4, 0, 28)], [Some(27), None, None]);
        assert!(s.is_valid(28) && !s.is_valid(20));
    }

    proptest! {
        /// Whoever creates ids in whatever order, and however atlases are joined: every id has a name of its own, and is
        /// found by it.
        #[test]
        fn every_id_has_one_name(turns in prop::collection::vec((0u16..4, 0usize..20), 1..12), split in 0usize..12) {
            let build = |turns: &[(u16, usize)]| {
                let (mut s, mut next) = (Stretches::of(0), 0);
                for (robot, count) in turns {
                    s.continue_as(*robot, next);
                    next += count;
                }
                (s, next)
            };
            let split = split.min(turns.len());
            let ((mut a, n), (b, m)) = (build(&turns[..split]), build(&turns[split..]));
            let renamed: BTreeMap<u16, u16> = a.clashes(n, &b, m).map(|r| (r, r + 100)).collect();
            a.append(n, &b, m, &renamed);
            prop_assert!(a.is_valid(n + m), "{a:?}");
            let names: BTreeSet<_> = (0..n + m).map(|i| a.name(i)).collect();
            prop_assert_eq!(names.len(), n + m);
            for i in 0..n + m {
                let (robot, seq) = a.name(i);
                prop_assert_eq!(a.index(robot, seq, n + m), Some(i));
            }
        }
    }
}
