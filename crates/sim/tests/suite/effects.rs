//! Tests of the image effects.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{GrayImage, Stamp};
use cairn_sim::{Effects, LiveRig, SimConfig, SimSensor, WorldKind, WorldOptions};

/// The rig in the demo's first corridor with given effects.
fn rig(effects: Effects) -> LiveRig {
    let mut s = SimConfig::new(WorldKind::Demo, 2);
    s.options = WorldOptions { detail: 0.4, ..Default::default() };
    s.sensor = SimSensor::Rgbd;
    s.effects = effects;
    LiveRig::new(&s).unwrap()
}

/// Looks along x, turned a little to the left.
fn pose(turn: f64) -> Se3 {
    let (s, c) = turn.sin_cos();
    let m = nalgebra::Matrix3::from_columns(&[Vec3::new(s, -c, 0.0), -Vec3::z(), Vec3::new(c, s, 0.0)]);
    Se3::new(So3::from_matrix(&m), Vec3::new(3.0, 1.2, 1.3))
}

fn see(rig: &mut LiveRig, i: i64, turn: f64) -> GrayImage {
    (*rig.packet(Stamp(50_000_000 * (i + 1)), &pose(turn)).unwrap().images[0]).clone()
}

fn mean(image: &GrayImage) -> f64 {
    image.data().iter().map(|p| f64::from(*p)).sum::<f64>() / image.data().len() as f64
}

/// Mean step from pixel to pixel along rows.
fn sharpness(image: &GrayImage) -> f64 {
    let steps = image.data().windows(2).map(|w| (f64::from(w[0]) - f64::from(w[1])).abs());
    steps.sum::<f64>() / image.data().len() as f64
}

#[test]
fn noise_deviation() {
    let clean = see(&mut rig(Effects::none()), 0, 0.0);
    let mut noisy = rig(Effects { noise: 3.0, ..Effects::none() });
    let (a, b) = (see(&mut noisy, 0, 0.0), see(&mut noisy, 1, 0.0));
    assert_ne!(a, b);
    let errors: Vec<f64> = clean
        .data()
        .iter()
        .zip(a.data())
        .filter(|(c, _)| (30..225).contains(*c))
        .map(|(c, n)| f64::from(*n) - f64::from(*c))
        .collect();
    let n = errors.len() as f64;
    let bias = errors.iter().sum::<f64>() / n;
    let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
    assert!(bias.abs() < 0.05 && (deviation - 3.0).abs() < 0.15, "bias {bias}, deviation {deviation}");
}

#[test]
fn vignette_darkens_the_corners_only() {
    let clean = see(&mut rig(Effects::none()), 0, 0.0);
    let dark = see(&mut rig(Effects { vignette: 0.4, ..Effects::none() }), 0, 0.0);
    assert!((i32::from(clean.at(320, 240)) - i32::from(dark.at(320, 240))).abs() <= 1);
    let ratio = f64::from(dark.at(2, 476)) / f64::from(clean.at(2, 476));
    assert!((ratio - 0.6).abs() < 0.05, "corner at {ratio}");
}

#[test]
fn exposure_wanders() {
    let mut rig = rig(Effects { exposure: 0.3, ..Effects::none() });
    let means: Vec<f64> = (0..20).map(|i| mean(&see(&mut rig, i * 20, 0.0))).collect();
    let (low, high) = means.iter().fold((f64::MAX, 0f64), |(l, h), m| (l.min(*m), h.max(*m)));
    assert!(high / low > 1.3, "{low} to {high}");
}

#[test]
fn blur_follows_the_motion() {
    let mut blurred = rig(Effects { blur_s: 0.02, ..Effects::none() });
    let still = see(&mut blurred, 0, 0.0);
    // 0.05 rad in 50 ms: eight pixels during the exposure.
    let moving = see(&mut blurred, 1, 0.05);
    let sharp = see(&mut rig(Effects::none()), 1, 0.05);
    assert_eq!(still, see(&mut rig(Effects::none()), 0, 0.0));
    assert!(sharpness(&moving) < 0.75 * sharpness(&sharp), "{} of {}", sharpness(&moving), sharpness(&sharp));
    assert!((mean(&moving) - mean(&sharp)).abs() < 1.0);
}

#[test]
fn depth_noise_and_range() {
    let exact = rig(Effects::none()).packet(Stamp(1), &pose(0.0)).unwrap().depth.unwrap();
    let effects = Effects { depth_noise: 0.002, depth_range: [0.5, 8.0], ..Effects::none() };
    let noisy = rig(effects).packet(Stamp(1), &pose(0.0)).unwrap().depth.unwrap();
    let mut sums = [(0.0, 0.0); 2];
    for (e, n) in exact.data().iter().zip(noisy.data()) {
        let m = f64::from(*e) / 1000.0;
        if !(0.5..=8.0).contains(&m) {
            assert_eq!(*n, 0, "{m} m is out of range");
            continue;
        }
        let relative = (f64::from(*n) - f64::from(*e)) / 1000.0 / (m * m);
        let s = &mut sums[usize::from(m > 3.0)];
        *s = (s.0 + relative * relative, s.1 + 1.0);
    }
    for (sum, count) in sums {
        assert!(count > 5000.0);
        let deviation = (sum / count).sqrt();
        assert!((deviation / 0.002 - 1.0).abs() < 0.15, "{deviation}");
    }
}
