//! Dense tracking: converges to the true pose from a nearby guess; unconstrained directions are left alone.

use cairn_dense::{
    DenseError, DepthConfig, DepthFrame, DepthPreparer, TrackConfig, TsdfConfig, TsdfVolume, track,
    track_from,
};
use cairn_geometry::{Manifold, Se3, Vec3};
use cairn_sensor::Camera;
use nalgebra::{Matrix6, Vector6};
use scene::{Scene, camera, pose, turn};

use crate::scene;

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

/// A frame whose depth has the noise of a structured-light sensor, different in each pixel and for each seed.
fn noisy(scene: &Scene, camera: &Camera, pose: &Se3, seed: u64) -> DepthFrame {
    let mut random = cairn_random::Random::new(seed);
    let mut depth = scene.depth(camera, pose);
    for y in 0..camera.height {
        for z in depth.row_mut(y) {
            let sigma = cairn_dense::DepthNoise::default().sigma_m(f64::from(*z));
            *z += (sigma * random.normal(0.0, 1.0)) as f32;
        }
    }
    let mut preparer = DepthPreparer::new(DepthConfig::default(), *camera, 0.001).expect("a camera");
    preparer.prepare_metres(&depth).expect("depth").clone()
}

/// The normals of a noisy field lean in all directions; that must not pass for corners.
#[test]
fn noise_does_not_constrain_what_a_bare_wall_leaves_free() {
    let scene = Scene {
        room: Some((Vec3::new(-50.0, -50.0, -50.0), Vec3::new(50.0, 50.0, 1.7))),
        spheres: Vec::new(),
    };
    let camera = Camera::pinhole(320, 240, 280.0, 280.0, 159.5, 119.5);
    for seed in 0..4 {
        let mut volume = TsdfVolume::new(TsdfConfig::default()).expect("in range");
        for i in 0..4 {
            let pose = pose([0.02 * f64::from(i), 0.0, 0.0], [0.0, 0.005 * f64::from(i), 0.0]);
            let frame = noisy(&scene, &camera, &pose, 100 * seed + i as u64);
            volume.integrate(&frame, None, &pose).expect("a pose");
        }
        let guess = Se3::identity().retract(&Vector6::new(0.03, -0.02, 0.02, 0.01, 0.005, 0.0));
        let known = Matrix6::from_diagonal(&Vector6::new(0.05, 0.05, 0.05, 0.02, 0.02, 0.02).map(|s| s * s));
        let frame = noisy(&scene, &camera, &Se3::identity(), 100 * seed + 50);
        let tracked = track_from(&volume, &frame, &guess, &known, &TrackConfig::default()).expect("finite");
        assert!(tracked.converged, "seed {seed}: {tracked:?}");
        assert_eq!(tracked.free.len(), 3, "seed {seed}: {:?}", tracked.free);
        let found = tracked.volume_from_camera;
        let slid = (found.translation - guess.translation).xy().norm();
        assert!(slid < 0.015, "seed {seed}: it slid by {slid} along the wall");
        assert!(found.translation.z.abs() < 0.003, "seed {seed}: {}", found.translation.z);
        assert!(
            tracked.covariance[(0, 0)].sqrt() > 0.1 && tracked.covariance[(1, 1)].sqrt() > 0.1,
            "seed {seed}"
        );
        let together =
            tracked.covariance.try_inverse().expect("regular") + known.try_inverse().expect("regular");
        let sigma = together.try_inverse().expect("regular").diagonal().map(f64::sqrt);
        assert!(sigma[2] < 0.005 && sigma[0] > 0.03 && sigma[1] > 0.03, "seed {seed}: {sigma}");
    }
    let bad = track_from(
        &TsdfVolume::new(TsdfConfig::default()).expect("in range"),
        &noisy(&scene, &camera, &Se3::identity(), 1),
        &Se3::identity(),
        &Matrix6::from_element(f64::NAN),
        &TrackConfig::default(),
    );
    assert!(matches!(bad, Err(DenseError::Pose(_))), "{bad:?}");
}

/// A direction that the surface gives is taken from it, whatever was known before.
#[test]
fn a_corner_outweighs_a_poor_guess() {
    let mut scene = Scene::room();
    scene.spheres.push((Vec3::new(-0.5, -0.3, 1.2), 0.3));
    let volume = fused(&scene, &turn(24));
    let truth = pose([0.05, 0.02, -0.15], [0.05, 0.15, 0.02]);
    let guess = truth.retract(&Vector6::new(0.03, 0.0, 0.02, 0.015, -0.02, 0.01));
    let frame = scene.frame(&camera(), &truth);
    let known = Matrix6::from_diagonal_element(0.0025);
    let tracked = track_from(&volume, &frame, &guess, &known, &TrackConfig::default()).expect("finite");
    assert!(tracked.converged && tracked.free.is_empty(), "{tracked:?}");
    let error = truth.local(&tracked.volume_from_camera);
    assert!(error.norm() < 0.004, "{error}");
}
