//! Motions that other sensors measured between key frames (the wheels of a robot), as factors of a window.
//!
//! Someone who passes close to the camera fills the view, and key frames made then see little else than him. Their observations agree
//! with each other and would turn these key frames along with him; what the wheels measured holds them. A key frame whose pose was carried
//! there, by the wheels or by the shape of what a depth camera sees, shares no landmark with the one before it: only the motion relates the two.

use crate::factor::{Frames, Judgement, WindowFactors};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::{LieGroup, Manifold, Se3};
use cairn_sensor::Stamp;
use cairn_solve::{Equations, Factors, Variable};
use nalgebra::{SMatrix, Vector6};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// No motion counts as more exact, metres and radians.
const FLOOR: [f64; 2] = [0.001, 0.001];
/// What a key frame's pose by itself is uncertain by, metres and radians.
const KEY_FRAME_SIGMA: [f64; 2] = [0.015, 0.01];
/// Chi-square of six degrees of freedom, 99.9 %.
const GATE: f64 = 22.46;

/// The camera's measured motion since an earlier frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionSince {
    /// Time of that frame.
    pub stamp: Stamp,
    /// Pose of the camera now, in the camera frame at that time; metres.
    pub since_from_now: Se3,
    /// Variance of its translation along each axis and of its rotation about each, m^2 and rad^2.
    pub variance: [f64; 2],
}

impl MotionSince {
    /// At that frame itself.
    pub fn none(stamp: Stamp) -> Self {
        Self { stamp, since_from_now: Se3::identity(), variance: [0.0; 2] }
    }

    /// With a motion after it.
    pub fn then(&self, motion: &Se3, variance: [f64; 2]) -> Self {
        // An error of the turn so far carries the way after it aside.
        let aside = self.variance[1] * motion.translation.norm_squared();
        Self {
            stamp: self.stamp,
            since_from_now: self.since_from_now * *motion,
            variance: [self.variance[0] + variance[0] + aside, self.variance[1] + variance[1]],
        }
    }

    /// How far a motion is from this one: chi-square of six degrees of freedom, where the poses at both ends have an error of their own.
    fn chi2(&self, since_from_now: &Se3) -> f64 {
        let off = self.since_from_now.local(since_from_now);
        let variance = |i: usize| self.variance[i] + KEY_FRAME_SIGMA[i].powi(2);
        off.fixed_rows::<3>(0).norm_squared() / variance(0)
            + off.fixed_rows::<3>(3).norm_squared() / variance(1)
    }

    /// Whether the camera can have moved so.
    pub fn agrees(&self, since_from_now: &Se3) -> bool {
        self.chi2(since_from_now) <= GATE
    }
}

/// For each key frame the one before it, and the motion measured since. Mapping adds to it and loop closing reads it: clones share it.
#[derive(Clone, Debug, Default)]
pub struct MotionLinks {
    links: Arc<Mutex<Links>>,
}

type Links = BTreeMap<KeyFrameId, (KeyFrameId, MotionSince)>;

/// From one key frame to another.
type Motion = (KeyFrameId, KeyFrameId, MotionSince);

impl MotionLinks {
    /// Adds what was measured from one key frame to a later one.
    pub fn insert(&self, from: KeyFrameId, to: KeyFrameId, motion: MotionSince) {
        self.locked().insert(to, (from, motion));
    }

    fn locked(&self) -> MutexGuard<'_, Links> {
        self.links.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The motion measured from one key frame to a later one; `None` where a part was not measured.
    pub fn between(&self, from: KeyFrameId, to: KeyFrameId) -> Option<MotionSince> {
        let links = self.locked();
        let (mut before, mut motion) = *links.get(&to)?;
        while before > from {
            let (earlier, first) = *links.get(&before)?;
            (before, motion) = (earlier, first.then(&motion.since_from_now, motion.variance));
        }
        (before == from).then_some(motion)
    }

    /// The last key frame before this one that is still in its map, with the motion since.
    fn before(&self, snapshot: &Snapshot, to: KeyFrameId) -> Option<(KeyFrameId, MotionSince)> {
        let map = snapshot.key_frame(to)?.map;
        let links = self.locked();
        let (mut from, mut motion) = *links.get(&to)?;
        loop {
            match snapshot.key_frame(from) {
                Some(k) => return (k.map == map).then_some((from, motion)),
                None => {
                    let (earlier, first) = *links.get(&from)?;
                    motion = first.then(&motion.since_from_now, motion.variance);
                    from = earlier;
                }
            }
        }
    }

    /// These motions as factors of a window.
    pub fn factors(&self) -> MotionFactors {
        MotionFactors { measured: self.clone(), ..MotionFactors::default() }
    }

    /// Those to or from the key frames that a window moves.
    fn of(&self, snapshot: &Snapshot, frames: &Frames) -> Vec<Motion> {
        let moving: BTreeSet<KeyFrameId> = frames.key_frames[..frames.moving].iter().copied().collect();
        let motion = |to: &KeyFrameId| {
            let (from, motion) = self.before(snapshot, *to)?;
            (moving.contains(to) || moving.contains(&from)).then_some((from, *to, motion))
        };
        frames.key_frames.iter().filter_map(motion).collect()
    }
}

#[derive(Clone, Copy, Debug)]
struct Link {
    from: usize,
    to: usize,
    motion: MotionSince,
}

impl Link {
    /// Motion between its ends, by the poses.
    fn between(&self, poses: &[Se3]) -> Se3 {
        poses[self.from].inverse() * poses[self.to]
    }

    fn weights(&self) -> Vector6<f64> {
        let [m, rad] = [0, 1].map(|i| self.motion.variance[i].sqrt().max(FLOOR[i]).recip());
        Vector6::new(m, m, m, rad, rad, rad)
    }

    fn residual(&self, poses: &[Se3]) -> Vector6<f64> {
        let off = self.motion.since_from_now.inverse() * self.between(poses);
        off.coordinates().component_mul(&self.weights())
    }

    /// Derivative of the residual by right perturbations of both ends.
    fn jacobian(&self, poses: &[Se3]) -> SMatrix<f64, 6, 12> {
        let between = self.between(poses);
        let off = self.motion.since_from_now.inverse() * between;
        let weights = SMatrix::<f64, 6, 6>::from_diagonal(&self.weights());
        by_both_ends(weights * off.coordinates_jacobian(), &between)
    }
}

/// Derivative of a residual by right perturbations of the poses of two key frames, from that by one of the motion between them. It moves
/// with its later end as with a perturbation of itself, with its earlier end through the adjoint (Sola, Deray, Atchuthan, "A micro Lie
/// theory for state estimation in robotics", 2018, equations 69, 74, 82).
pub(crate) fn by_both_ends(by_later: SMatrix<f64, 6, 6>, between: &Se3) -> SMatrix<f64, 6, 12> {
    let mut jacobian = SMatrix::<f64, 6, 12>::zeros();
    jacobian.fixed_columns_mut::<6>(0).copy_from(&(-by_later * between.inverse().adjoint()));
    jacobian.fixed_columns_mut::<6>(6).copy_from(&by_later);
    jacobian
}

/// The motions measured between the key frames of a window. In that of a whole map those between key frames that no landmark relates.
#[derive(Clone, Debug, Default)]
pub struct MotionFactors {
    measured: MotionLinks,
    motions: Vec<Motion>,
    links: Vec<Link>,
    /// Poses need not agree with them afterwards: where observations relate their ends along a way around, they decide by their weight.
    may_give_way: bool,
}

impl WindowFactors for MotionFactors {
    /// Key frames before those that move stay.
    fn choose(&mut self, snapshot: &Snapshot, frames: &mut Frames) {
        self.motions = self.measured.of(snapshot, frames);
        self.motions.iter().for_each(|(from, ..)| frames.hold(snapshot, *from));
    }
    fn bind(&mut self, snapshot: &Snapshot, frames: &Frames) -> usize {
        self.may_give_way = frames.centre.is_none();
        let unrelated = |from: KeyFrameId, to: KeyFrameId| {
            snapshot.key_frame(to).is_none_or(|k| k.covisible.iter().all(|(id, _)| *id != from))
        };
        let link = |(from, to, motion): &Motion| {
            let link = Link { from: frames.slot(*from)?, to: frames.slot(*to)?, motion: *motion };
            let counts = !self.may_give_way || unrelated(*from, *to);
            (counts && frames.any_moves(&[link.from, link.to])).then_some(link)
        };
        self.links = self.motions.iter().filter_map(link).collect();
        self.links.len()
    }
    /// Observations of something that moves can outvote a measured motion that the poses agreed with.
    fn judge(&mut self, before: &[Se3], after: &[Se3]) -> Judgement {
        let agrees = |l: &Link, poses: &[Se3]| l.motion.agrees(&l.between(poses));
        let contradicted = self.links.iter().any(|l| agrees(l, before) && !agrees(l, after));
        if contradicted && !self.may_give_way { Judgement::PosesWereRight } else { Judgement::Agrees }
    }
}

impl Factors for MotionFactors {
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.links.iter().for_each(|l| visit(&[Variable::Pose(l.from), Variable::Pose(l.to)]));
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        for l in &self.links {
            let parts = [(Some(Variable::Pose(l.from)), 0..6), (Some(Variable::Pose(l.to)), 6..12)];
            equations.add(&l.residual(poses), &l.jacobian(poses), &parts);
        }
        Some(())
    }
    fn attempt(&mut self, poses: &[Se3], _: &[f64]) -> f64 {
        self.links.iter().map(|l| 0.5 * l.residual(poses).norm_squared()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    fn pose(k: f64) -> Se3 {
        Se3::new(
            So3::exp(&(Vec3::new((1.1 * k).sin(), (2.3 * k).sin(), (3.7 * k).sin()) * 0.6)),
            Vec3::new((1.7 * k).cos(), (0.9 * k).cos(), (2.9 * k).cos()),
        )
    }

    #[test]
    fn the_jacobian_is_that_of_the_residual() {
        let since = MotionSince::none(Stamp::from_seconds(0.0));
        let link = Link { from: 1, to: 0, motion: since.then(&pose(3.0), [0.04, 0.01]) };
        let poses = [pose(1.0), pose(2.0)];
        let jacobian = link.jacobian(&poses);
        for column in 0..12 {
            let moved = |by: f64| {
                let mut moved = poses;
                let end = if column < 6 { link.from } else { link.to };
                let mut step = Vector6::zeros();
                step[column % 6] = by;
                moved[end] = moved[end].retract(&step);
                link.residual(&moved)
            };
            let numeric = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((numeric - jacobian.column(column)).norm() < 1e-6, "column {column}");
        }
    }

    #[test]
    fn errors_of_a_turn_carry_the_way_after_it_aside() {
        let since = MotionSince::none(Stamp::from_seconds(0.0)).then(&Se3::identity(), [0.0, 1e-4]);
        let ahead = since.then(&Se3::new(So3::identity(), Vec3::x() * 2.0), [0.0; 2]);
        assert!((ahead.variance[0] - 4e-4).abs() < 1e-12);
        assert!(ahead.agrees(&Se3::new(So3::identity(), Vec3::new(2.0, 0.05, 0.0))));
        assert!(!ahead.agrees(&Se3::new(So3::identity(), Vec3::new(2.0, 0.2, 0.0))));
    }
}
