//! The depth image as a prior: the pose of the frame that is tracked by the shape of what it shows ([`DenseAligner`]).

use super::MotionPrior;
use crate::dense::DenseAligner;
use crate::match_last::Matches;
use crate::odometry::MotionSource;
use crate::reckoned::{Estimate, Reckoned};
use crate::state::Last;
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_solve::PosePrior;

impl MotionPrior for DenseAligner {
    fn predict(&self, _: Option<&Last>, _: Stamp) -> Option<Se3> {
        Some(self.aligned()?.reckoned.world_from_camera)
    }

    fn carry(&self, _: Option<&Last>, _: Stamp) -> Option<Estimate> {
        self.aligned()?.reckoned.carry()
    }

    fn prior(&self, _: Option<&Last>, _: Stamp) -> Option<PosePrior> {
        let reckoned = self.aligned().map(|aligned| aligned.reckoned);
        Some(reckoned.filter(Reckoned::may_coast)?.prior())
    }

    fn agrees(&self, _: Option<&Last>, _: Stamp, world_from_camera: &Se3) -> bool {
        self.aligned().is_none_or(|aligned| aligned.reckoned.agrees(world_from_camera))
    }

    fn relative(&self) -> Option<(Se3, MotionSource)> {
        self.aligned().map(|aligned| (aligned.last_from_now, MotionSource::Measured))
    }
}

impl DenseAligner {
    /// Whether features that suffice by themselves, `enough` of them, contradict the depth, where that only helps them out.
    pub fn is_contradicted(&self, pose: &Se3, matches: &Matches, enough: usize) -> bool {
        let aligned = self.aligned().filter(|_| !self.is_front_end());
        aligned.is_some_and(|a| !a.reckoned.agrees(pose)) && matches.count() >= enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense_tests::{RIGHT, at, begun, room, stamp};
    use crate::synthetic::{off, pose};

    #[test]
    fn an_aligned_image_predicts_carries_and_gates_the_pose_and_another_says_nothing() {
        let (atlas, _, mut aligner) = begun(false);
        aligner.next(Some(room(&at(2), RIGHT)), None);
        let now = stamp(2);
        assert!(aligner.predict(None, now).is_none() && aligner.relative().is_none());
        assert!(aligner.agrees(None, now, &pose(9.0, 0.0, 0.0)), "nothing contradicts it");
        aligner.align(atlas.latest(), now, None, None).expect("aligned");
        let predicted = aligner.predict(None, now).expect("aligned");
        assert!(off(&predicted, &at(2)).0 < 0.01, "{predicted:?}");
        assert_eq!(aligner.carry(None, now).expect("sure").world_from_camera, predicted);
        assert_eq!(aligner.prior(None, now).expect("sure").world_from_camera, predicted);
        assert!(
            aligner.agrees(None, now, &at(2)) && !aligner.agrees(None, now, &(at(2) * pose(0.5, 0.0, 0.0)))
        );
        let (moved, source) = aligner.relative().expect("aligned");
        assert_eq!(source, MotionSource::Measured);
        assert!(off(&moved, &(at(1).inverse() * at(2))).0 < 0.01, "{moved:?}");
    }
}
