//! Dense tracking: converges to the true pose from a nearby guess; unconstrained directions are left alone.

use cairn_dense::{DenseError, TrackConfig, TsdfConfig, TsdfVolume, track};
use cairn_geometry::{Manifold, Se3, Vec3};
use nalgebra::Vector6;
use scene::{Scene, camera, pose, turn};

mod scene;

fn fused(scene: &Scene, poses: &[Se3]) -> TsdfVolume {
    let mut volume = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    for pose in poses {
        volume.integrate(&scene.frame(&camera(), pose), None, pose).expect("a pose");
    }
    volume
}

#[test]
fn a_frame_finds_back_from_beside() {
    let mut scene = Scene::room();
    scene.spheres.push((Vec3::new(-0.5, -0.3, 1.2), 0.3));
    let volume = fused(&scene, &turn(24));
    for (i, off) in [[0.03, 0.0, 0.02], [0.0, -0.03, 0.02], [-0.02, 0.02, -0.03]].into_iter().enumerate() {
        let truth = pose([0.05, 0.02, -0.15], [0.05, 0.15 * i as f64, 0.02]);
        let guess = truth.retract(&Vector6::new(off[0], off[1], off[2], 0.015, -0.02, 0.01));
        let tracked =
            track(&volume, &scene.frame(&camera(), &truth), &guess, &TrackConfig::default()).expect("finite");
        let error = truth.local(&tracked.volume_from_camera);
        assert!(tracked.converged, "{tracked:?}");
        assert!(tracked.free.is_empty());
        assert!(
            error.fixed_rows::<3>(0).norm() < 0.003 && error.fixed_rows::<3>(3).norm() < 0.003,
            "{error}"
        );
        assert!((0..6).all(|k| tracked.covariance[(k, k)] > 0.0 && tracked.covariance[(k, k)] < 1e-4));
    }
}

#[test]
fn along_a_bare_wall_the_guess_is_kept() {
    // One wall that fills the view: it constrains the distance and two rotations, nothing else.
    let scene = Scene {
        room: Some((Vec3::new(-50.0, -50.0, -50.0), Vec3::new(50.0, 50.0, 1.5))),
        spheres: Vec::new(),
    };
    let volume = fused(&scene, &[Se3::identity()]);
    let guess = Se3::identity().retract(&Vector6::new(0.02, -0.01, 0.03, 0.01, 0.005, 0.0));
    let tracked = track(&volume, &scene.frame(&camera(), &Se3::identity()), &guess, &TrackConfig::default())
        .expect("finite");
    assert_eq!(tracked.free.len(), 3, "{:?}", tracked.free);
    let found = tracked.volume_from_camera;
    assert!(found.translation.z.abs() < 0.002, "the distance is found: {}", found.translation.z);
    let slid = found.translation - guess.translation;
    assert!(slid.x.abs() < 0.03 && slid.y.abs() < 0.03, "{slid}");
    let tilt = found.rotation * Vec3::z();
    assert!((tilt - Vec3::z()).norm() < 0.003, "{tilt}");
}

#[test]
fn where_nothing_is_nothing_is_tracked() {
    let scene = Scene::room();
    let volume = fused(&scene, &[Se3::identity()]);
    let frame = scene.frame(&camera(), &Se3::identity());
    let away = pose([5.0, 0.0, 0.0], [0.0; 3]);
    let tracked = track(&volume, &frame, &away, &TrackConfig::default()).expect("finite");
    assert!(!tracked.converged && tracked.volume_from_camera == away);
    let bad = track(&volume, &frame, &pose([f64::NAN; 3], [0.0; 3]), &TrackConfig::default());
    assert!(matches!(bad, Err(DenseError::Pose(_))));
}
