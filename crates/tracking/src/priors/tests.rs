//! Which prior is asked, and in which order.

use super::*;
use crate::dense_tests::{RIGHT, at, begun, room, stamp};
use crate::synthetic::{off, pose};
use cairn_geometry::{So3, Vec3};
use cairn_vision::Frame;
use std::sync::Arc;

/// The last frame: where the aligner of [`begun`] has seen the second image.
fn last(reference: cairn_atlas::KeyFrameId) -> Last {
    let mut frame = Frame::default();
    frame.stamp = stamp(1);
    Last { frame: Arc::new(frame), landmarks: Vec::new(), anchored: AnchoredPose::at(reference, at(1)) }
}

/// Priors of a camera that has moved at a steady velocity, of which the wheels have measured a step, if they have.
fn priors(wheels: Option<Se3>) -> MotionPriors {
    let mut priors = MotionPriors::default();
    priors.velocity.turns(Vec3::y() * 0.5);
    priors.measured.restart(true);
    let motion = wheels.map(|last_from_now| MeasuredMotion { last_from_now, sigma_m: 0.01, sigma_rad: 0.01 });
    priors.measured.measured(motion.as_ref(), &Se3::identity());
    priors.take(&[], 0.0);
    priors
}

#[test]
fn a_measured_motion_is_asked_before_constant_velocity() {
    let (last, now) = (last(cairn_atlas::KeyFrameId::FIRST), stamp(2));
    let step = Se3::new(So3::exp(&(Vec3::y() * 0.01)), Vec3::x() * 0.03);
    let with = priors(Some(step));
    assert_eq!(with.predict(Some(&last), now), Some(at(1) * step));
    assert_eq!(with.sure(Some(&last), now), Some(at(1) * step));
    assert!(with.prior(Some(&last), now).is_some());
    assert_eq!(with.relative().map(|(_, source)| source), Some(MotionSource::Measured));
    let without = priors(None);
    let turned = without.predict(Some(&last), now).expect("constant velocity");
    assert_eq!(turned.translation, at(1).translation);
    assert!(without.sure(Some(&last), now).is_none() && without.carry(Some(&last), now).is_none());
    assert!(without.prior(Some(&last), now).is_none() && without.relative().is_none());
    let snapshot = Snapshot::new();
    assert!(without.agrees(&snapshot, Some(&last), now, &pose(9.0, 0.0, 0.0)), "nothing contradicts it");
    assert!(!with.agrees(&snapshot, Some(&last), now, &pose(9.0, 0.0, 0.0)));
}

#[test]
fn an_aligned_depth_image_is_asked_before_the_motion_that_is_part_of_it() {
    let (atlas, id, mut aligner) = begun(false);
    aligner.next(Some(room(&at(2), RIGHT)), None);
    let (last, now) = (last(id), stamp(2));
    let step = at(1).inverse() * at(2) * pose(0.01, 0.0, 0.0);
    let mut priors = priors(Some(step));
    priors.depth = Some(aligner);
    assert_eq!(priors.predict(Some(&last), now), Some(at(1) * step), "it is not aligned yet");
    priors.begin(atlas.latest(), Some(&last), now);
    assert!(priors.is_aligned());
    let aligned = priors.predict(Some(&last), now).expect("aligned");
    assert!(aligned != at(1) * step && off(&aligned, &at(2)).0 < 0.01, "{aligned:?}");
    priors.refuse_depth(now);
    assert_eq!(priors.predict(Some(&last), now), Some(at(1) * step), "features contradicted it");
}
