//! Poses of key frames relative to earlier ones, as robots send them: in whole numbers, and again only where they changed by what matters.

use super::state::{Pose, State};
use crate::{KeyFrame, KeyFrameId, RelativePose, Snapshot};
use cairn_geometry::LieGroup;
use nalgebra::{Matrix6, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Steps of the root of an information: what is known to a millimetre has 16,000, and rounding adds no more to what nothing is known of than a
/// standard deviation of five metres.
const ROOT: f64 = 16.0;
/// Largest number of a root, in steps.
const LARGEST: i32 = 16_000_000;
/// It is not sent again where its pose moved by no more than this chi-square, and its root by no more than this share of it.
const CHANGED: [f64; 2] = [0.1, 0.15];
/// So many of a map at most.
const MAX_ALL: usize = 1 << 20;

/// A relative pose, and the upper triangle of the symmetric root of its information.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Relative {
    pose: Pose,
    root: Vec<i32>,
}

/// What changed of them: the key frame and the earlier one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct RelativeDelta {
    gone: Vec<[u32; 2]>,
    new: Vec<([u32; 2], Relative)>,
}

impl Relative {
    fn of(z: &RelativePose) -> Self {
        let eigen = SymmetricEigen::new(z.information);
        let values = Matrix6::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
        let root = eigen.eigenvectors * values * eigen.eigenvectors.transpose();
        let rows = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
        let root = rows.map(|at| (root[at] * ROOT).round() as i32).collect();
        Self { pose: Pose::of(&z.from_from_here), root }
    }

    /// `None` where the numbers are none.
    fn root(&self) -> Option<Matrix6<f64>> {
        let small = self.root.iter().all(|v| v.unsigned_abs() <= LARGEST.unsigned_abs());
        let all: [f64; 21] =
            self.root.iter().map(|v| f64::from(*v) / ROOT).collect::<Vec<_>>().try_into().ok()?;
        small.then(|| super::super::relative_poses::symmetric(&all))
    }

    fn measured(&self, from: KeyFrameId) -> Option<RelativePose> {
        let root = self.root()?;
        // A square is nowhere negative, whatever was rounded.
        let squared = root * root;
        let information = (squared + squared.transpose()) * 0.5;
        Some(RelativePose { from, from_from_here: self.pose.pose()?, information })
    }

    /// Whether what was sent before is as good.
    fn is_near(&self, z: &RelativePose, now: &Self) -> bool {
        let ([Some(was), Some(is)], Some(pose)) = ([self.root(), now.root()], self.pose.pose()) else {
            return false;
        };
        let off = (pose.inverse() * z.from_from_here).coordinates();
        off.dot(&(z.information * off)) <= CHANGED[0] && (was - is).norm() <= CHANGED[1] * is.norm()
    }
}

impl State {
    /// Adds the relative poses of a map, as they were known `before` where they hardly changed.
    pub(super) fn relate(&mut self, s: &Snapshot, before: &Self) {
        for k in s.key_frames() {
            for z in &k.relative_poses {
                let (at, now) = ([k.id.raw(), z.from.raw()], Relative::of(z));
                let known = before.relative.get(&at).filter(|known| known.is_near(z, &now));
                let kept = known.cloned().unwrap_or(now);
                if kept.root().is_some() && self.relative.len() < MAX_ALL {
                    self.relative.insert(at, kept);
                }
            }
        }
    }
}

impl RelativeDelta {
    /// What leads from one state to another.
    pub fn between(a: &State, b: &State) -> Self {
        let gone = a.relative.keys().filter(|at| !b.relative.contains_key(*at)).copied().collect();
        let new = b.relative.iter().filter(|(at, z)| a.relative.get(*at) != Some(z));
        Self { gone, new: new.map(|(at, z)| (*at, z.clone())).collect() }
    }

    /// Makes the changes; `None` where they do not fit what is known.
    pub fn apply(self, to: &mut State) -> Option<()> {
        for at in &self.gone {
            to.relative.remove(at)?;
        }
        to.relative.extend(self.new);
        (to.relative.len() <= MAX_ALL).then_some(())
    }
}

/// Gives key frames their relative poses; `Err` has the number of the first that cannot be.
pub(super) fn give(state: &State, key_frames: &mut [KeyFrame]) -> Result<(), u32> {
    for ([raw, from], z) in &state.relative {
        let at = |raw: u32| {
            let id = KeyFrameId::from_raw(raw)?;
            key_frames.binary_search_by_key(&id, |k| k.id).ok()
        };
        let (here, from) = at(*raw).zip(at(*from)).ok_or(*raw)?;
        let of_map = from < here && key_frames[from].map == key_frames[here].map;
        let z = z.measured(key_frames[from].id).filter(|z| of_map && z.is_sound());
        key_frames[here].relative_poses.push(z.ok_or(*raw)?);
    }
    Ok(())
}
