//! BAL problems: a made one of some size returns to its truth; text is read, written, and refused with its line.

use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_solve::bal::{Bal, BalCamera, BalConfig, BalObservation, read, write};
use cairn_solve::{Loss, Stop};
use proptest::prelude::*;

fn wave(k: usize, a: f64) -> f64 {
    (k as f64 * a + a * a).sin()
}

/// Cameras on a ring look inwards at a cloud; each point is seen by some that stand together. Pixels have no noise.
fn ring(cameras: usize, points: usize) -> Bal {
    let mut bal = Bal::default();
    for k in 0..cameras {
        let a = k as f64 / cameras as f64 * std::f64::consts::TAU;
        let turn = So3::exp(&Vec3::new(0.0, 0.0, 0.02 * wave(k, 1.3))) * So3::exp(&Vec3::new(0.0, -a, 0.0));
        bal.cameras.push(BalCamera {
            camera_from_world: Se3::new(turn, Vec3::new(0.1 * wave(k, 0.7), 0.1 * wave(k, 0.9), -10.0)),
            focal: 700.0 + 50.0 * wave(k, 2.1),
            k1: 0.02 * wave(k, 1.1),
            k2: 0.005 * wave(k, 1.7),
        });
    }
    for j in 0..points {
        let p = Vec3::new(wave(j, 1.91), wave(j, 2.57), wave(j, 3.31)) * 3.0;
        for s in 0..5 {
            let camera = (j * 7 + s * 2) % cameras;
            let pixel = bal.cameras[camera].project(&p);
            bal.observations.push(BalObservation { camera: camera as u32, point: j as u32, pixel });
        }
        bal.points.push(p);
    }
    bal
}

fn shaken(mut bal: Bal) -> Bal {
    for (k, c) in bal.cameras.iter_mut().enumerate() {
        let turn = So3::exp(&(Vec3::new(wave(k, 0.3), wave(k, 0.5), wave(k, 0.8)) * 0.01));
        c.camera_from_world.rotation = turn * c.camera_from_world.rotation;
        c.camera_from_world.translation.z += 0.05 * wave(k, 0.61);
        c.focal *= 1.0 + 0.01 * wave(k, 0.83);
    }
    for (j, p) in bal.points.iter_mut().enumerate() {
        *p += Vec3::new(wave(j, 0.21), wave(j, 0.41), wave(j, 0.77)) * 0.05;
    }
    bal
}

#[test]
fn fifty_cameras_and_five_thousand_points_return() {
    let mut bal = shaken(ring(50, 5000));
    let report = bal.solve(&BalConfig::default(), || false);
    // What is left is far below a thousandth of a pixel.
    assert!(report.cost_after < 1e-6 * bal.observations.len() as f64, "{report:?}");
    assert!(report.cost_before > 1e5, "{report:?}");
    assert_eq!(report.inliers, bal.observations.len());
}

#[test]
fn huber_lets_false_observations_go() {
    let truth = ring(12, 300);
    let mut bal = shaken(truth.clone());
    for o in bal.observations.iter_mut().step_by(25) {
        o.pixel += Vec2::new(80.0, -60.0);
    }
    let mut plain = bal.clone();
    let config = BalConfig { loss: Loss::Huber(1.0), ..BalConfig::default() };
    bal.solve(&config, || false);
    plain.solve(&BalConfig::default(), || false);
    // Medians of the errors at the true pixels.
    let median = |bal: &Bal| {
        let error = |o: &BalObservation| {
            (bal.cameras[o.camera as usize].project(&bal.points[o.point as usize]) - o.pixel).norm()
        };
        let mut errors: Vec<f64> = truth.observations.iter().map(error).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    };
    let (robust, plain) = (median(&bal), median(&plain));
    assert!(robust < 0.3 && plain > 5.0 * robust, "{robust} {plain}");
}

#[test]
fn text_goes_round() {
    let bal = ring(3, 8);
    let again = read(&write(&bal)).expect("our own text");
    assert_eq!(again.observations, bal.observations);
    assert_eq!(again.points, bal.points);
    for (a, b) in again.cameras.iter().zip(&bal.cameras) {
        assert!((a.camera_from_world.inverse() * b.camera_from_world).log().norm() < 1e-12);
        assert_eq!((a.focal, a.k1, a.k2), (b.focal, b.k1, b.k2));
    }
}

#[test]
fn errors_name_the_line_and_the_reason() {
    for (text, line, words) in [
        ("", 1, "number of cameras is missing"),
        ("1 1", 1, "number of observations is missing"),
        ("1 x 1", 1, "not a whole number: x"),
        ("99999999999 1 1", 1, "must be below"),
        ("1 1 4000000000\n0 0 1 2\n", 2, "is missing"),
        ("1 1 1\n1 0 1 2\n", 2, "camera of an observation is 1"),
        ("1 1 1\n\n0 7 1 2\n", 3, "point of an observation is 7"),
        ("1 1 1\n0 0 nan 2\n", 2, "not finite"),
        ("1 1 1\n0 0 1 2\n0 0 0 0 0 0 500 0\n", 3, "k2 of a camera is missing"),
        ("1 1 1\n0 0 1 2\n0 0 0 0 0 0 500 0 0\n1 2 3\n4", 5, "more numbers"),
        ("0 0 0", 1, "no observation"),
    ] {
        let error = read(text).expect_err(text);
        assert_eq!(error.line, line, "{text}: {error}");
        assert!(error.to_string().contains(words), "{text}: {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damaged_text_never_panics(
        cuts in prop::collection::vec((0..3000usize, 0..12usize, "[ -~\n]{0,8}"), 0..5),
    ) {
        let mut text = write(&ring(3, 8)).into_bytes();
        for (at, drop, put) in cuts {
            let at = at.min(text.len());
            let end = (at + drop).min(text.len());
            text.splice(at..end, put.bytes());
        }
        if let Ok(mut bal) = read(&String::from_utf8_lossy(&text)) {
            bal.solve(&BalConfig { iterations: 3, ..BalConfig::default() }, || false);
            prop_assert!(read(&write(&bal)).is_ok());
        }
    }

    #[test]
    fn cancelling_leaves_a_valid_state(after in 0..8usize) {
        let mut bal = shaken(ring(6, 40));
        let before = bal.cost(Loss::Squared);
        let mut asked = 0;
        let report = bal.solve(&BalConfig::default(), || {
            asked += 1;
            asked > after
        });
        prop_assert!(report.iterations <= after);
        prop_assert!(report.stop == Stop::Interrupted || report.stop == Stop::Converged);
        prop_assert!(bal.cost(Loss::Squared) <= before);
        prop_assert_eq!(bal.cost(Loss::Squared).to_bits(), report.cost_after.to_bits());
    }
}

#[test]
fn bundler_is_read_as_the_same_problem() {
    let bal = ring(6, 40);
    let mut text = format!("# Bundle file v0.3\n{} {}\n", bal.cameras.len() + 1, bal.points.len());
    // The second camera was not found: Bundler writes zeros.
    for (k, c) in bal.cameras.iter().enumerate() {
        if k == 1 {
            text += &"0 0 0\n".repeat(5);
        }
        let (r, t) = (c.camera_from_world.rotation.matrix(), c.camera_from_world.translation);
        text += &format!("{} {} {}\n", c.focal, c.k1, c.k2);
        (0..3).for_each(|i| text += &format!("{} {} {}\n", r[(i, 0)], r[(i, 1)], r[(i, 2)]));
        text += &format!("{} {} {}\n", t.x, t.y, t.z);
    }
    for (j, p) in bal.points.iter().enumerate() {
        text += &format!("{} {} {}\n255 0 7\n", p.x, p.y, p.z);
        let views: Vec<&BalObservation> = bal.observations.iter().filter(|o| o.point as usize == j).collect();
        text += &views.len().to_string();
        for o in views {
            let camera = o.camera + u32::from(o.camera >= 1);
            text += &format!(" {camera} 12 {} {}", o.pixel.x, o.pixel.y);
        }
        text += "\n";
    }
    let found = read(&text).unwrap();
    assert_eq!((found.cameras.len(), found.points.len()), (6, 40));
    assert_eq!(found.observations.len(), bal.observations.len());
    assert!(found.cost(Loss::Squared) < 1e-12, "{}", found.cost(Loss::Squared));
    let cut = text.rsplit_once('\n').unwrap().0.rsplit_once(' ').unwrap().0;
    assert!(read(cut).unwrap_err().to_string().contains("y of a view"));
    assert!(read(&text.replacen("255 0 7", "255 0", 1)).is_err());
    let other = read("# Camera list\n1 SIMPLE_RADIAL 640 480 500 320 240 0.01\n").unwrap_err();
    assert!(other.to_string().contains("# Camera list"), "{other}");
}
