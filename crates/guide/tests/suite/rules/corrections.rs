//! Corrections of the map while somebody is guided.

use super::walker::{STEP, ScriptedWalker, default_config};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_guide::*;
use cairn_sensor::Stamp;

/// The test route after its map was corrected: rotated about a point and shifted to the left of the first leg.
fn corrected(about: [f64; 2], left_m: f64, degrees: f64) -> (ManeuverPlan, Se3) {
    let turn = So3::exp(&(Vec3::z() * degrees.to_radians()));
    let at = Vec3::new(about[0], about[1], 0.0);
    let moved = Se3::new(turn, at - turn * at + Vec3::new(0.0, left_m, 0.0));
    let line = [[0., 0., 0.], [30., 0., 0.], [30., 20., 0.]].map(|p| moved * Vec3::from(p));
    (ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap(), moved)
}

#[test]
fn a_correction_moves_the_route_under_the_walker_over_the_time_of_easing() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(12.0, 1.0);
    let before = walker.words().len();
    let (plan, moved) = corrected([12.0, 0.0], 1.0, 5.0);
    walker.guide.correct_route(plan, &moved, Stamp::from_seconds(walker.t));
    let mut cross = vec![walker.guide.place().unwrap().cross_m];
    for _ in 0..44 {
        walker.go(STEP, 1.0);
        cross.push(walker.guide.place().unwrap().cross_m);
    }
    // He walks on for 2.2 m and the route leaves to the left by 5 degrees.
    let steps: Vec<f64> = cross.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    assert!(steps.iter().all(|step| *step < 0.05), "{steps:?}");
    assert!(cross[20].abs() > 0.3 && cross[20].abs() < 0.8, "half of it after a second: {}", cross[20]);
    assert!((cross[44] + 1.19).abs() < 0.05, "all of it after two: {}", cross[44]);
    // The speed of the easing is not taken for his.
    let words = walker.words()[before..].to_vec();
    assert!(
        !words.iter().any(|w| w.contains("Correction") || w.contains("right") || w.contains("Off")),
        "{words:?}"
    );
}

#[test]
fn a_correction_does_not_put_a_walker_back_before_the_sharp_corner_where_he_was_told_to_turn() {
    let line = [[0., 0., 0.], [20., 0., 0.], [12., 6., 0.]];
    let mut walker = ScriptedWalker::new(&line, default_config());
    walker.go(18.4, 1.0);
    assert!(!walker.find("Turn sharp left now").is_empty(), "{:?}", walker.words());
    let plan = walker.guide.plan().clone();
    walker.guide.correct_route(plan, &Se3::identity(), Stamp::from_seconds(walker.t));
    // Between the two legs, nearer to the first.
    walker.turn(143.0, 45.0);
    walker.y = 0.2;
    walker.stand(STEP);
    assert!(walker.guide.place().unwrap().along_m >= 20.0 - 1e-6, "{:?}", walker.guide.place());
}

#[test]
fn without_easing_a_correction_counts_at_once() {
    let mut walker = ScriptedWalker::on_test_route(GuideConfig { ease_s: 0.0, ..default_config() });
    walker.go(12.0, 1.0);
    let (plan, moved) = corrected([12.0, 0.0], 1.0, 5.0);
    walker.guide.correct_route(plan, &moved, Stamp::from_seconds(walker.t));
    walker.go(STEP, 1.0);
    assert!((walker.guide.place().unwrap().cross_m + 1.0).abs() < 0.05);
}

#[test]
fn a_correction_out_of_the_corridor_counts_at_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(12.0, 1.0);
    let (plan, moved) = corrected([12.0, 0.0], 2.0, 0.0);
    walker.guide.correct_route(plan, &moved, Stamp::from_seconds(walker.t));
    walker.go(STEP, 1.0);
    assert!((walker.guide.place().unwrap().cross_m + 2.0).abs() < 0.05);
    walker.go(4.0, 1.0);
    let words = walker.words();
    assert!(!walker.find("Bear left").is_empty() && walker.find("right").is_empty(), "{words:?}");
}

#[test]
fn a_correction_that_brings_a_turn_sooner_counts_at_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(25.0, 1.0);
    // The corner is 1.5 m nearer than it seemed.
    let moved = Se3::new(So3::identity(), Vec3::new(-1.5, 0.0, 0.0));
    let line = [[-1.5, 0., 0.], [28.5, 0., 0.], [28.5, 20., 0.]].map(Vec3::from);
    let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    walker.guide.correct_route(plan, &moved, Stamp::from_seconds(walker.t));
    walker.go(3.0, 1.0);
    let turn = walker.find("Turn left now.");
    assert!(turn.len() == 1 && (26.0..27.5).contains(&turn[0].1), "{turn:?}");
}

#[test]
fn a_contradicted_cue_is_taken_back_at_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(25.5, 1.0);
    assert!(walker.words().last().unwrap().ends_with("turn left."), "{:?}", walker.words());
    // The route turns to the other side after all.
    let line = [[0., 0., 0.], [30., 0., 0.], [30., -20., 0.]].map(Vec3::from);
    let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    let moved = Se3::new(So3::identity(), Vec3::new(0.0, 0.3, 0.0));
    walker.guide.correct_route(plan, &moved, Stamp::from_seconds(walker.t));
    walker.go(STEP, 1.0);
    assert_eq!(walker.words().last().unwrap(), "Correction. Continue 4 metres, then turn right.");
    walker.go(3.0, 1.0);
    assert_eq!(walker.find("Correction.").len(), 1);
}

#[test]
fn a_turn_to_the_wrong_side_is_taken_back() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(29.0, 1.0);
    assert_eq!(walker.find("Turn left now.").len(), 1, "{:?}", walker.words());
    let line = [[0., 0., 0.], [30., 0., 0.], [30., -20., 0.]].map(Vec3::from);
    let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    let moved = Se3::new(So3::identity(), Vec3::new(0.0, 0.3, 0.0));
    walker.guide.correct_route(plan, &moved, Stamp::from_seconds(walker.t));
    walker.stand(0.1);
    assert_eq!(walker.words().last().unwrap(), "Correction. Turn right.");
}

#[test]
fn a_new_segment_of_odometry_is_no_motion() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(12.0, 1.0);
    let before = walker.words().len();
    // The poses to come are 100 m away, and so is the route.
    walker.x += 100.0;
    let line = [[100., 0., 0.], [130., 0., 0.], [130., 20., 0.]].map(Vec3::from);
    let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    walker.guide.begin_segment(plan, Ground::z_up());
    walker.go(3.0, 1.0);
    assert!(walker.words().len() - before <= 1, "{:?}", &walker.words()[before..]);
    assert!((walker.guide.place().unwrap().along_m - 15.0).abs() < 0.2);
}

#[test]
fn corrected_route_keeps_the_walkers_place() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(28.0, 1.0).turn(90.0, 45.0);
    walker.heading = std::f64::consts::FRAC_PI_2;
    walker.go(2.0, 1.0);
    // The map was corrected by a metre and a small rotation; the walker's odom pose with it, except for the metre.
    let moved: Vec<Vec3> =
        [[0.5, -1.0, 0.], [29.5, 0.3, 0.], [29.2, 20.3, 0.]].iter().map(|p| Vec3::from(*p)).collect();
    let before = walker.words().len();
    let plan = ManeuverPlan::new(&moved, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
    let shift = Se3::new(So3::identity(), Vec3::new(-0.5, 0.3, 0.0));
    walker.guide.correct_route(plan, &shift, Stamp::from_seconds(walker.t));
    walker.go(3.0, 1.0);
    let after = &walker.words()[before..];
    assert!(!after.iter().any(|w| w.contains("Turn left")), "the turn was told again: {after:?}");
    assert!(walker.guide.place().unwrap().along_m > 30.0);
}
