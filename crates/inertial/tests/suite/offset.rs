//! The time offset and the rotation between sensor and camera, found again on simulated motion.

use crate::common;

use cairn_geometry::{So3, Vec3};
use cairn_inertial::{OffsetConfig, OffsetUnknown, TimeOffset, time_offset};
use cairn_random::Random;
use cairn_sensor::{ImuSample, Stamp};
use common::{HandMotion, noisy, samples, some_bias, vector};

fn imu_from_camera() -> So3 {
    So3::exp(&Vec3::new(1.2, -1.1, 1.3))
}

/// Ten seconds at 20 Hz seen through a camera whose clock is `offset` ahead, turned by `extra` from where it should be.
fn run(seed: u64, offset: f64, extra: So3, motion: fn(f64) -> So3) -> Result<TimeOffset, OffsetUnknown> {
    adjusted(seed, offset, extra, motion, |_| So3::identity())
}

/// The same in a map that turns as it is adjusted.
fn adjusted(
    seed: u64,
    offset: f64,
    extra: So3,
    motion: fn(f64) -> So3,
    map: fn(f64) -> So3,
) -> Result<TimeOffset, OffsetUnknown> {
    let mut rng = Random::new(seed);
    let mut readings = samples(0.0, 10.0, 200.0);
    if motion(1.0) != HandMotion::rotation(1.0) {
        for s in &mut readings {
            let t = s.stamp.seconds();
            s.gyro = (motion(t - 1e-4).inverse() * motion(t + 1e-4)).log() / 2e-4;
        }
    }
    let (readings, _): (Vec<ImuSample>, _) = noisy(&mut rng, readings, some_bias());
    let world = So3::exp(&vector(&mut rng, 1.0));
    let poses: Vec<(Stamp, So3)> = (0..200)
        .map(|k| {
            let t = 0.05 * k as f64;
            let noise = So3::exp(&vector(&mut rng, 0.002));
            (Stamp::from_seconds(t + offset), world * map(t) * motion(t) * extra * imu_from_camera() * noise)
        })
        .collect();
    time_offset(&poses, &readings, &imu_from_camera(), &OffsetConfig::default())
}

#[test]
fn offsets_are_recovered_to_a_millisecond_and_as_well_as_told() {
    let mut nees = 0.0;
    let offsets = [-0.05, -0.02, -0.003, 0.0, 0.004, 0.02, 0.07];
    for (seed, offset) in offsets.into_iter().enumerate() {
        let found = run(seed as u64, offset, So3::identity(), HandMotion::rotation).unwrap();
        assert!((found.offset_s - offset).abs() < 1e-3, "{offset}: {found:?}");
        assert!((found.gyro_bias - some_bias().gyro).norm() < 2e-3 && found.misaligned < 0.01, "{found:?}");
        nees += ((found.offset_s - offset) / found.sigma_s).powi(2) / offsets.len() as f64;
    }
    println!("NEES of the offset {nees:.2}");
    assert!((0.1..2.6).contains(&nees), "{nees}");
}

/// Adjusting a map turns it under the camera: by a degree where it is aligned with gravity or a loop closes, and slowly in between.
#[test]
fn a_map_that_is_adjusted_does_not_shift_the_offset() {
    let map = |t: f64| {
        let gravity_alignments = if t > 2.7 { Vec3::new(0.025, -0.01, 0.0) } else { Vec3::zeros() };
        let closed = if t > 6.4 { Vec3::new(0.0, 0.01, -0.02) } else { Vec3::zeros() };
        So3::exp(&(gravity_alignments + closed + Vec3::new(0.0, 0.0, 4e-4 * t)))
    };
    for offset in [-0.02, 0.0, 0.02] {
        let mut ratios: Vec<f64> = (0..9)
            .map(|seed| {
                let found = adjusted(seed, offset, So3::identity(), HandMotion::rotation, map).unwrap();
                let plain = run(seed, offset, So3::identity(), HandMotion::rotation).unwrap();
                assert!((found.offset_s - offset).abs() < 1e-3, "{offset}: {found:?}");
                found.sigma_s / plain.sigma_s
            })
            .collect();
        ratios.sort_by(f64::total_cmp);
        println!("offset {offset} s: deviation by that without adjustments {ratios:.2?}");
        // Where noise hides a step of the map, the deviation is larger, and says so.
        assert!(ratios[4] < 1.2, "{ratios:.2?}");
    }
}

#[test]
fn a_rotation_that_is_off_is_told_however_large() {
    for extra in [Vec3::new(0.0, 0.05, 0.0), Vec3::new(0.0, 0.0, 1.6), Vec3::new(2.0, -1.0, 0.7)] {
        let found = run(3, 0.015, So3::exp(&extra), HandMotion::rotation).unwrap();
        assert!((found.misaligned - So3::exp(&extra).angle()).abs() < 0.01, "{extra}: {found:?}");
        assert!((found.offset_s - 0.015).abs() < 1e-3);
    }
}

#[test]
fn what_can_not_be_told_is_not() {
    let still = run(1, 0.01, So3::identity(), |_| So3::identity());
    assert!(matches!(still, Err(OffsetUnknown::TooLittleTurn { .. })), "{still:?}");
    // A steady turn looks the same at any time.
    let steady = run(1, 0.01, So3::identity(), |t| So3::exp(&Vec3::new(0.0, 0.0, 0.5 * t)));
    assert!(matches!(steady, Err(OffsetUnknown::TooLittleTurn { .. })), "{steady:?}");
    let few = time_offset(&[], &[], &imu_from_camera(), &OffsetConfig::default());
    assert!(matches!(few, Err(OffsetUnknown::TooFew { found: 0, .. })));
    let far = run(1, 0.3, So3::identity(), HandMotion::rotation);
    assert!(far.is_err(), "{far:?}");
}
