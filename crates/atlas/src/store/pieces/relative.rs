//! A pose of a key frame relative to an earlier one, as robots send it: in whole numbers, and again only where it changed by what matters.

use super::super::relative_poses::symmetric;
use super::pose::Pose;
use crate::{KeyFrameId, RelativePose};
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

/// A relative pose, and the upper triangle of the symmetric root of its information.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Relative {
    pose: Pose,
    root: Vec<i32>,
}

impl Relative {
    pub fn of(z: &RelativePose) -> Self {
        let eigen = SymmetricEigen::new(z.information);
        let values = Matrix6::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
        let root = eigen.eigenvectors * values * eigen.eigenvectors.transpose();
        let rows = (0..6).flat_map(|i| (i..6).map(move |j| (i, j)));
        let root = rows.map(|at| (root[at] * ROOT).round() as i32).collect();
        Self { pose: Pose::of(&z.from_from_here), root }
    }

    /// `None` where the numbers are none.
    pub fn root(&self) -> Option<Matrix6<f64>> {
        let small = self.root.iter().all(|v| v.unsigned_abs() <= LARGEST.unsigned_abs());
        let all: [f64; 21] =
            self.root.iter().map(|v| f64::from(*v) / ROOT).collect::<Vec<_>>().try_into().ok()?;
        small.then(|| symmetric(&all))
    }

    pub fn measured(&self, from: KeyFrameId) -> Option<RelativePose> {
        let root = self.root()?;
        // A square is nowhere negative, whatever was rounded.
        let squared = root * root;
        let information = (squared + squared.transpose()) * 0.5;
        Some(RelativePose { from, from_from_here: self.pose.pose()?, information })
    }

    /// Whether what was sent before is as good.
    pub fn is_near(&self, z: &RelativePose, now: &Self) -> bool {
        let ([Some(was), Some(is)], Some(pose)) = ([self.root(), now.root()], self.pose.pose()) else {
            return false;
        };
        let off = (pose.inverse() * z.from_from_here).coordinates();
        off.dot(&(z.information * off)) <= CHANGED[0] && (was - is).norm() <= CHANGED[1] * is.norm()
    }
}
