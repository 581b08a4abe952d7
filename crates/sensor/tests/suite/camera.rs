//! `project` and `unproject` are inverse wherever a model has an image, and return `None` elsewhere.

use cairn_geometry::{Vec2, Vec3};
use cairn_sensor::{Camera, Distortion};
use proptest::prelude::*;

/// Real calibrations: EuRoC cam0, TUM freiburg1, TUM-VI room cam0 and cam1, RealSense D455 colour, an Azure Kinect
/// colour camera (rational); for the models without a real calibration, typical values from their papers.
fn cameras() -> Vec<(&'static str, Camera)> {
    let with =
        |w, h, fx, fy, cx, cy, distortion| Camera { distortion, ..Camera::pinhole(w, h, fx, fy, cx, cy) };
    vec![
        ("pinhole", with(1226, 370, 707.0912, 707.0912, 601.8873, 183.1104, Distortion::None)),
        (
            "euroc",
            with(
                752,
                480,
                458.654,
                457.296,
                367.215,
                248.375,
                Distortion::RadialTangential([-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]),
            ),
        ),
        (
            "freiburg1",
            with(
                640,
                480,
                517.306408,
                516.469215,
                318.64304,
                255.313989,
                Distortion::RadialTangential([0.262383, -0.953104, -0.005358, 0.002628, 1.163314]),
            ),
        ),
        (
            "d455",
            with(
                848,
                480,
                416.852234,
                414.920691,
                421.024593,
                237.761806,
                Distortion::RadialTangential([-0.0457618957, 0.0342395113, -0.00040139, 0.00043137, 0.0]),
            ),
        ),
        (
            "d455 inverse",
            with(
                848,
                480,
                416.852234,
                414.920691,
                421.024593,
                237.761806,
                Distortion::InverseRadialTangential([-0.0557, 0.0672, -0.00052, 0.00056, -0.0218]),
            ),
        ),
        (
            "rational",
            with(
                1280,
                720,
                605.9,
                605.7,
                638.2,
                366.4,
                Distortion::Rational([0.4525, -2.6247, 0.00056, -0.00020, 1.5108, 0.3318, -2.4461, 1.4374]),
            ),
        ),
        (
            "tum-vi cam0",
            with(
                512,
                512,
                190.978477,
                190.973307,
                254.931706,
                256.897443,
                Distortion::Equidistant([0.0034823894, 0.000715034845, -0.002053236141, 0.000202936736]),
            ),
        ),
        (
            "tum-vi cam1",
            with(
                512,
                512,
                190.44237,
                190.434438,
                252.599497,
                254.917231,
                Distortion::Equidistant([0.0034003170790, 0.001766278153, -0.0026631257, 0.0003299517]),
            ),
        ),
        ("fov", with(640, 480, 250.0, 333.0, 320.0, 240.0, Distortion::Fov(0.92))),
        (
            "double sphere",
            with(512, 512, 156.2, 156.2, 254.9, 256.9, Distortion::DoubleSphere { xi: -0.18, alpha: 0.59 }),
        ),
        (
            "unified, mirror",
            with(
                752,
                480,
                736.0,
                736.2,
                374.9,
                247.0,
                Distortion::Unified([0.96, -0.2, 0.11, 0.0004, -0.001]),
            ),
        ),
        (
            "unified, fisheye",
            with(
                1280,
                800,
                1170.0,
                1166.0,
                647.0,
                386.0,
                Distortion::Unified([1.89, 0.02, 0.49, 0.001, 0.0007]),
            ),
        ),
        (
            "extended unified",
            with(
                512,
                512,
                190.9,
                190.9,
                254.9,
                256.9,
                Distortion::ExtendedUnified { alpha: 0.63, beta: 1.04 },
            ),
        ),
        ("division", with(640, 480, 400.0, 400.0, 320.0, 240.0, Distortion::Division(-0.25))),
        ("division, pincushion", with(640, 480, 500.0, 500.0, 320.0, 240.0, Distortion::Division(0.1))),
    ]
}

#[test]
fn pixels_round_trip_for_real_calibrations() {
    for (name, camera) in cameras() {
        camera.validate().unwrap();
        let (mut visible, mut without_ray) = (0, 0);
        for y in (0..camera.height).step_by(5).chain([camera.height - 1]) {
            for x in (0..camera.width).step_by(5).chain([camera.width - 1]) {
                let px = Vec2::new(x as f64, y as f64);
                let Some(ray) = camera.unproject(&px) else {
                    without_ray += 1;
                    continue;
                };
                assert!((ray.norm() - 1.0).abs() < 1e-12);
                let back = camera.project(&(ray * 3.7)).unwrap_or_else(|| panic!("{name}: {px:?} lost"));
                assert!((back - px).norm() < 1e-6, "{name}: {px:?} came back as {back:?}");
                visible += 1;
            }
        }
        // Only the black corners of a fisheye image may have no ray.
        assert!(
            without_ray == 0
                || ((name.contains("double") || name.contains("unified")) && without_ray * 5 < visible),
            "{name}: {without_ray} of {visible} pixels have no ray"
        );
    }
}

#[test]
fn rays_round_trip() {
    for (name, camera) in cameras() {
        let mut visible = 0;
        for i in 0..2000 {
            // A spiral of directions over the front half sphere.
            let (theta, phi) = (1.5 * i as f64 / 2000.0, 0.7 * i as f64);
            let ray = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let Some(px) = camera.project(&(ray * 0.3)) else { continue };
            // Up to one image width from the centre; no calibration extends beyond.
            if (px.x - camera.cx).abs() > camera.width as f64
                || (px.y - camera.cy).abs() > camera.width as f64
            {
                continue;
            }
            let back = camera.unproject(&px).unwrap_or_else(|| panic!("{name}: {theta} rad lost"));
            assert!((back - ray).norm() < 1e-7, "{name}: {ray:?} came back as {back:?}");
            visible += 1;
        }
        assert!(visible > 700, "{name}: {visible} of 2000 rays are visible");
    }
}

#[test]
fn points_behind_the_camera_have_no_image() {
    for (name, camera) in cameras() {
        assert_eq!(camera.project(&Vec3::zeros()), None, "{name}");
        assert_eq!(camera.project(&Vec3::new(0.0, 0.0, -1.0)), None, "{name}");
        assert_eq!(camera.project(&Vec3::new(f64::NAN, 0.0, 1.0)), None, "{name}");
        assert_eq!(camera.unproject(&Vec2::new(f64::NAN, 1.0)), None, "{name}");
        let wide = matches!(
            camera.distortion,
            Distortion::Equidistant(_)
                | Distortion::DoubleSphere { .. }
                | Distortion::Unified(_)
                | Distortion::ExtendedUnified { .. }
        );
        assert_eq!(camera.project(&Vec3::new(1.0, 0.0, -0.05)).is_some(), wide, "{name}");
    }
}

#[test]
fn no_image_beyond_the_fold() {
    // 1 - 3 * 0.3 s changes sign at r = 1.054, where the image radius is 0.703.
    let mut camera = Camera::pinhole(640, 480, 300.0, 300.0, 320.0, 240.0);
    for distortion in [
        Distortion::RadialTangential([-0.3, 0.0, 0.0, 0.0, 0.0]),
        Distortion::Rational([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-9, 0.0]),
    ] {
        camera.distortion = distortion;
        assert!(camera.project(&Vec3::new(1.04, 0.0, 1.0)).is_some());
        assert_eq!(camera.project(&Vec3::new(1.07, 0.0, 1.0)), None);
        assert_eq!(camera.project(&Vec3::new(5.0, 0.0, 1.0)), None);
        assert!(camera.unproject(&Vec2::new(320.0 + 300.0 * 0.70, 240.0)).is_some());
        assert_eq!(camera.unproject(&Vec2::new(320.0 + 300.0 * 0.71, 240.0)), None);
    }
    // Folds over and increases again: beyond the dip radius and slope are positive, but there is still no image.
    camera.distortion = Distortion::RadialTangential([-0.8, 0.2, 0.0, 0.0, 0.0]);
    assert_eq!(camera.project(&Vec3::new(3.0, 0.0, 1.0)), None);
    camera.distortion = Distortion::InverseRadialTangential([-0.3, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(camera.unproject(&Vec2::new(320.0 + 300.0 * 1.07, 240.0)), None);
    camera.distortion = Distortion::Equidistant([-0.1, 0.0, 0.0, 0.0]); // folds over at 1.826 rad
    assert_eq!(camera.project(&Vec3::new(1.9f64.sin(), 0.0, 1.9f64.cos())), None);
    assert_eq!(camera.unproject(&Vec2::new(320.0 + 300.0 * 1.3, 240.0)), None);
    camera.distortion = Distortion::Fov(1.0);
    assert_eq!(camera.unproject(&Vec2::new(320.0 + 300.0 * 1.6, 240.0)), None);
    camera.distortion = Distortion::DoubleSphere { xi: 0.1, alpha: 0.7 };
    assert_eq!(camera.unproject(&Vec2::new(320.0 + 300.0 * 1.7, 240.0)), None);
    assert_eq!(camera.project(&Vec3::new(0.2, 0.0, -1.0)), None);
}

#[test]
fn invalid_distortion_is_rejected() {
    let mut camera = Camera::pinhole(640, 480, 300.0, 300.0, 320.0, 240.0);
    let nan = f64::NAN;
    for distortion in [
        Distortion::RadialTangential([0.0, nan, 0.0, 0.0, 0.0]),
        Distortion::Rational([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, nan]),
        Distortion::InverseRadialTangential([f64::INFINITY, 0.0, 0.0, 0.0, 0.0]),
        Distortion::Equidistant([0.0, 0.0, nan, 0.0]),
        Distortion::Fov(nan),
        Distortion::Fov(4.0),
        Distortion::DoubleSphere { xi: nan, alpha: 0.5 },
        Distortion::DoubleSphere { xi: 0.0, alpha: 1.2 },
        Distortion::Unified([-0.1, 0.0, 0.0, 0.0, 0.0]),
        Distortion::ExtendedUnified { alpha: 1.1, beta: 1.0 },
        Distortion::ExtendedUnified { alpha: 0.5, beta: 0.0 },
        Distortion::Division(nan),
    ] {
        camera.distortion = distortion;
        assert!(camera.validate().is_err(), "{distortion:?}");
    }
}

#[test]
fn invalid_resolution_is_rejected() {
    let validate = |width, height| {
        Camera::pinhole(width, height, 300.0, 300.0, 320.0, 240.0).validate().map_err(|e| e.to_string())
    };
    assert_eq!(validate(16_384, 480), Ok(()));
    assert!(validate(16_385, 480).unwrap_err().contains("16385x480, at most 16384"));
    assert!(validate(640, usize::MAX).is_err());
    assert!(validate(0, 480).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(4000) })]

    #[test]
    fn pixels_round_trip_for_mild_lenses(
        kind in 0..9usize,
        c in prop::array::uniform8(-0.08..0.08f64),
        x in 0.0..639.0f64,
        y in 0.0..479.0f64,
    ) {
        // Beyond 0.025 a lens may fold over inside the image (its radial curve turns before the corner), and a corner
        // has no ray.
        let radial = [0.3 * c[0], 0.3 * c[1], 0.05 * c[2], 0.05 * c[3], 0.3 * c[4]];
        let distortion = match kind {
            0 => Distortion::RadialTangential(radial),
            1 => Distortion::Rational(c.map(|v| 0.15 * v)),
            2 => Distortion::InverseRadialTangential(radial),
            3 => Distortion::Equidistant([0.5 * c[0], 0.5 * c[1], 0.1 * c[2], 0.1 * c[3]]),
            4 => Distortion::Fov(0.1 + 6.0 * c[0].abs()),
            5 => Distortion::DoubleSphere { xi: 4.0 * c[0], alpha: 0.5 + 5.0 * c[1] },
            6 => Distortion::Unified([0.9 + 4.0 * c[5], radial[0], radial[1], radial[2], radial[3]]),
            7 => Distortion::ExtendedUnified { alpha: 0.5 + 5.0 * c[1], beta: 1.0 + 2.0 * c[0] },
            _ => Distortion::Division(2.0 * c[0]),
        };
        let camera = Camera { distortion, ..Camera::pinhole(640, 480, 420.0, 410.0, 322.0, 238.0) };
        let px = Vec2::new(x, y);
        let ray = camera.unproject(&px);
        prop_assert!(ray.is_some(), "{:?} has no ray at {}", distortion, px);
        let back = camera.project(&ray.unwrap());
        prop_assert!(back.is_some_and(|b| (b - px).norm() < 1e-6), "{:?}: {} came back as {:?}", distortion, px, back);
    }

    /// For any radial coefficients (real tangential ones are below 0.01) the result is correct or `None`, never wrong,
    /// and never a panic.
    #[test]
    fn any_lens_is_correct_or_none(
        kind in 0..9usize,
        c in prop::array::uniform8(-2.0..2.0f64),
        x in -1.5..1.5f64,
        y in -1.5..1.5f64,
    ) {
        let (p1, p2) = (0.02 * c[2], 0.02 * c[3]);
        let radial = [c[0], c[1], p1, p2, c[4]];
        let distortion = match kind {
            0 => Distortion::RadialTangential(radial),
            1 => Distortion::Rational([c[0], c[1], p1, p2, c[4], c[5], c[6], c[7]]),
            2 => Distortion::InverseRadialTangential(radial),
            3 => Distortion::Equidistant([c[0], c[1], c[2], c[3]]),
            4 => Distortion::Fov(c[0].abs()),
            5 => Distortion::DoubleSphere { xi: c[0], alpha: c[1].abs().min(1.0) },
            6 => Distortion::Unified([c[5].abs(), c[0], c[1], p1, p2]),
            7 => Distortion::ExtendedUnified { alpha: c[0].abs().min(1.0), beta: c[1].abs() },
            _ => Distortion::Division(c[0]),
        };
        let camera = Camera { distortion, ..Camera::pinhole(2, 2, 1.0, 1.0, 0.0, 0.0) };
        prop_assume!(camera.validate().is_ok());
        let px = Vec2::new(x, y);
        if let Some(ray) = camera.unproject(&px)
            && let Some(back) = camera.project(&ray)
        {
            prop_assert!((back - px).norm() < 1e-5, "{:?}: {} came back as {}", distortion, px, back);
        }
    }
}
