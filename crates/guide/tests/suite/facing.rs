//! The three ways back: sides, checked from first principles on poses written out by hand.
//!
//! The world frame here has x east, y north, z up. The camera's axes are given as east, north, up vectors, so no
//! code of the crate takes part in making a pose.

use cairn_geometry::{Mat3, Pose, Se3, So3, Vec3};
use cairn_guide::{
    Confidence, CueKind, Facing, First, Ground, Guide, GuideConfig, GuideInput, ManeuverPlan,
    ManeuverPlanConfig, PhraseConfig,
};
use cairn_sensor::Stamp;

const EAST: [f64; 3] = [1.0, 0.0, 0.0];
const WEST: [f64; 3] = [-1.0, 0.0, 0.0];
const NORTH: [f64; 3] = [0.0, 1.0, 0.0];
const SOUTH: [f64; 3] = [0.0, -1.0, 0.0];

/// A level camera at a place, from the directions of its x axis (right) and z axis (forward); y is down.
fn pose(at: [f64; 3], right: [f64; 3], forward: [f64; 3]) -> Se3 {
    let m = Mat3::from_columns(&[Vec3::from(right), -Vec3::z(), Vec3::from(forward)]);
    assert!((m.determinant() - 1.0).abs() < 1e-12, "not a right-handed camera");
    Se3::new(So3::from_matrix(&m), Vec3::from(at))
}

fn guide(corners: &[[f64; 3]], facing: Facing) -> Guide {
    let line: Vec<Vec3> = corners.iter().map(|c| Vec3::from(*c)).collect();
    let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    Guide::new(plan, Ground::z_up(), GuideConfig { facing, ..GuideConfig::default() }).unwrap()
}

fn input(t: f64, pose: Se3) -> GuideInput {
    let now = Stamp::from_seconds(t);
    GuideInput {
        now,
        pose_stamp: now,
        odom_from_camera: Pose::new(pose),
        confidence: Confidence::Good,
        speed: None,
        hazard: None,
    }
}

fn first_words(guide: &mut Guide, pose: Se3) -> (CueKind, String) {
    let cue = guide.step(&input(0.0, pose)).unwrap();
    (cue.kind, PhraseConfig::default().words(&cue).unwrap())
}

#[test]
fn home_sides_and_first_words() {
    let north = [[0., 0., 1.], [0., 20., 1.]];
    // Facing east: the right hand points south.
    let (_, words) = first_words(&mut guide(&north, Facing::Home), pose([0., 0., 1.], SOUTH, EAST));
    assert_eq!(words, "Turn left. The route is 20 metres long.");
    let (_, words) = first_words(&mut guide(&north, Facing::Home), pose([0., 0., 1.], NORTH, WEST));
    assert_eq!(words, "Turn right. The route is 20 metres long.");
    let (_, words) = first_words(&mut guide(&north, Facing::Home), pose([0., 0., 1.], WEST, SOUTH));
    assert_eq!(words, "Turn around. The route is 20 metres long.");
    let (_, words) = first_words(&mut guide(&north, Facing::Home), pose([0., 0., 1.], EAST, NORTH));
    assert_eq!(words, "Continue 20 metres to the end. The route is 20 metres long.");
}

#[test]
fn camera_back_uses_the_walkers_own_left() {
    let north = [[0., 0., 1.], [0., 20., 1.]];
    // The camera looks west, so the walker faces east; north is to the left.
    let (_, words) = first_words(&mut guide(&north, Facing::Back), pose([0., 0., 1.], NORTH, WEST));
    assert_eq!(words, "Turn left. The route is 20 metres long. The camera faces behind you.");
    // The camera looks south: the walker faces north and moves on.
    let (_, words) = first_words(&mut guide(&north, Facing::Back), pose([0., 0., 1.], WEST, SOUTH));
    assert_eq!(
        words,
        "Continue 20 metres to the end. The route is 20 metres long. The camera faces behind you."
    );
}

#[test]
fn backwards_warning_and_rotation_side() {
    let north = [[0., 0., 1.], [0., 20., 1.]];
    // Facing south, moving north: correct from the start, with the warning.
    let (_, words) = first_words(&mut guide(&north, Facing::Backwards), pose([0., 0., 1.], WEST, SOUTH));
    assert_eq!(
        words,
        "Caution, you will move backwards. Go slowly and only on flat ground. \
         Feel behind you with the cane. Move back 20 metres to the end. The route is 20 metres long."
    );
    // Facing east, the back points west; it must point north. Turning right from east leads to south, and
    // then the back points north.
    let (kind, words) = first_words(&mut guide(&north, Facing::Backwards), pose([0., 0., 1.], SOUTH, EAST));
    assert!(words.ends_with("Rotate right. The route is 20 metres long."), "{words}");
    let CueKind::Start { first: First::Turn(angle), .. } = kind else { panic!("{kind:?}") };
    assert!((angle + std::f64::consts::FRAC_PI_2).abs() < 1e-9, "turning left is positive: {angle}");
}

#[test]
fn backwards_rotation_differs_from_translation() {
    // Facing south, moving north along x = 0. Off to the east by 0.7 m: the line is to the west, which is to
    // the right hand of a walker who faces south.
    for (x, side) in [(0.7, "right"), (-0.7, "left")] {
        let mut guide = guide(&[[0., 0., 1.], [0., 20., 1.]], Facing::Backwards);
        let mut words = Vec::new();
        for k in 0..200 {
            let t = 0.05 * k as f64;
            // On the line for 3 s, then beside it, still moving north and facing south.
            let at = [if t < 3.0 { 0.0 } else { x }, 0.3 * t, 1.0];
            let cue = guide.step(&input(t, pose(at, WEST, SOUTH)));
            words.extend(cue.and_then(|c| PhraseConfig::default().words(&c)));
        }
        assert_eq!(words[1], format!("Stop. Step back and to your {side}."), "{words:?}");
    }
    // On the line, but facing 17 degrees off: south and a little east (turned left), so the back points
    // north and a little west; turning right a little corrects it.
    for (sign, side) in [(1.0, "right"), (-1.0, "left")] {
        let mut guide = guide(&[[0., 0., 1.], [0., 20., 1.]], Facing::Backwards);
        let mut words = Vec::new();
        for k in 0..120 {
            let t = 0.05 * k as f64;
            let off = if t < 1.0 { 0.0 } else { sign * 0.3_f64 };
            let (forward, right) = ([off.sin(), -off.cos(), 0.0], [-off.cos(), -off.sin(), 0.0]);
            let cue = guide.step(&input(t, pose([0.0, 0.4 * t, 1.0], right, forward)));
            words.extend(cue.and_then(|c| PhraseConfig::default().words(&c)));
        }
        assert_eq!(words[1], format!("Rotate {side} a little."), "{words:?}");
    }
}

#[test]
fn backwards_on_stairs_is_an_error() {
    let line: Vec<Vec3> =
        [[0., 0., 0.], [5., 0., 0.], [9., 0., 2.5]].iter().map(|c| Vec3::from(*c)).collect();
    let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    let config = GuideConfig { facing: Facing::Backwards, ..GuideConfig::default() };
    let error = Guide::new(plan, Ground::z_up(), config).unwrap_err();
    assert!(error.to_string().contains("stairs"));
}

#[test]
fn camera_pitch_does_not_change_the_words() {
    let north = [[0., 0., 1.], [0., 20., 1.]];
    for pitch in [-0.7, 0.4, 1.3] {
        let level = pose([0., 0., 1.], SOUTH, EAST);
        let tilt = So3::exp(&Vec3::new(-pitch, 0.0, 0.0));
        let tilted = Se3::new(level.rotation * tilt, level.translation);
        let (_, words) = first_words(&mut guide(&north, Facing::Home), tilted);
        assert_eq!(words, "Turn left. The route is 20 metres long.");
    }
}
