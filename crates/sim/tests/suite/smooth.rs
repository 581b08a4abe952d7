//! A rig with an IMU that is moved frame by frame: its readings belong to the motion that its camera sees.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::GRAVITY_M_S2;
use cairn_sim::{ImuConfig, SimConfig, SimSensor, SmoothRig, WorldKind};

fn config() -> SimConfig {
    SimConfig {
        sensor: SimSensor::Mono,
        imu: Some(ImuConfig { noisy: false, ..ImuConfig::default() }),
        camera: cairn_sensor::Camera::pinhole(64, 48, 42.0, 42.0, 31.5, 23.5),
        ..SimConfig::new(WorldKind::Demo, 1)
    }
}

/// A body that goes along x, sways and turns.
fn pose(k: usize) -> Se3 {
    let t = k as f64 * 0.05;
    Se3::new(
        So3::exp(&Vec3::new(0.0, 0.1 * (2.0 * t).sin(), 0.4 * t)),
        Vec3::new(0.8 * t, 0.05 * (5.0 * t).sin(), 1.3 + 0.02 * (9.0 * t).sin()),
    )
}

#[test]
fn readings_integrate_to_the_motion() {
    let mut rig = SmoothRig::new(&config()).unwrap();
    let mut before: Option<(Se3, f64)> = None;
    let (mut rotation, mut velocity, mut place) = (So3::identity(), Vec3::zeros(), Vec3::zeros());
    let mut worst: f64 = 0.0;
    let mut frames = 0;
    for k in 0..60 {
        let Some((packet, truth)) = rig.packet(&pose(k)).unwrap() else {
            assert!(k < 2);
            continue;
        };
        frames += 1;
        assert_eq!(packet.stamp.0, 50_000_000 * (k as i64 - 2));
        if k == 30 {
            // From here on the readings alone carry the body, with the velocity of the truth.
            let (last, at) = before.unwrap();
            let h = packet.stamp.seconds() - at;
            rotation = truth.rotation;
            velocity = (truth.translation - last.translation) / h;
            place = truth.translation;
        } else if k > 30 {
            let from = before.unwrap().1;
            let mut at = from;
            assert!(packet.imu.len() >= 10, "{} readings", packet.imu.len());
            for sample in packet.imu.iter().filter(|s| s.stamp.seconds() > from + 1e-9) {
                let dt = sample.stamp.seconds() - at;
                at = sample.stamp.seconds();
                rotation = rotation * So3::exp(&(sample.gyro * dt));
                velocity += (rotation * sample.accel - Vec3::z() * GRAVITY_M_S2) * dt;
                place += velocity * dt;
            }
            worst = worst.max((place - truth.translation).norm());
            let off = (rotation.inverse() * truth.rotation).angle();
            assert!(off < 0.02, "frame {k}: {off} rad");
        }
        before = Some((truth, packet.stamp.seconds()));
    }
    assert_eq!(frames, 58);
    // A second and a half by Euler's rule, begun with the velocity of a quarter of a tenth of a second before.
    assert!(worst < 0.08, "{worst} m");
}

#[test]
fn a_pose_that_is_not_finite_is_refused() {
    let mut rig = SmoothRig::new(&config()).unwrap();
    let nan = Se3::new(So3::identity(), Vec3::new(f64::NAN, 0.0, 0.0));
    assert!(rig.packet(&nan).is_err());
}
