//! Directions: approach, turns, progress, aim, the end; distances and the way the walker faces.

use super::walker::{ScriptedWalker, default_config, without_corrections};
use cairn_guide::*;

#[test]
fn words_of_a_route_with_one_turn() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(29.9, 1.0).stand(0.4).turn(90.0, 40.0).go(22.0, 1.0);
    let words = walker.words();
    assert_eq!(words[0], "Continue 30 metres, then turn left. The route is 50 metres long.");
    let expected = [
        "Another 20 metres, then turn left.",
        "Another 10 metres, then turn left.",
        "In 6 metres, turn left.",
        "Turn left now.",
        "Stop turning. Continue 20 metres to the end.",
        "Another 9 metres to the end.",
        "Slow down, 5 metres to the end.",
        "Stop. You have arrived. Guidance ends.",
    ];
    assert_eq!(&words[1..], expected, "{:#?}", walker.spoken());
    assert_eq!(walker.guide.state(), GuideState::Arrived);
}

#[test]
fn approach_distance_grows_with_speed() {
    for (speed, ahead) in [(0.6, 6.0), (1.0, 6.0), (1.5, 7.0)] {
        let mut walker = ScriptedWalker::on_test_route(default_config());
        walker.go(27.0, speed);
        let at = walker.find("In ")[0].1;
        assert!((30.0 - at - ahead).abs() < 0.3, "at {speed} m/s {} m ahead", 30.0 - at);
    }
}

#[test]
fn turn_now_distance_follows_speed_within_limits() {
    // 2 m x speed + 0.3 s of reaction; at most a quarter of the segment, at least 0.6 m, plus reaction.
    for (length, speed, ahead) in [(30.0, 1.0, 2.3), (30.0, 0.5, 1.15), (6.0, 1.0, 1.8), (30.0, 0.2, 0.66)] {
        let mut walker =
            ScriptedWalker::new(&[[0., 0., 0.], [length, 0., 0.], [length, 20., 0.]], default_config());
        walker.go(length - 0.1, speed);
        let at = walker.find("Turn left now")[0].1;
        assert!((length - at - ahead).abs() < 0.15, "{length} m at {speed} m/s: {} m ahead", length - at);
    }
}

#[test]
fn stop_turning_leads_by_turn_rate() {
    for rate in [20.0, 40.0] {
        let mut walker = ScriptedWalker::on_test_route(default_config());
        walker.go(29.9, 1.0).stand(1.2).turn(90.0, rate).stand(2.0);
        let turned = walker.cues.iter().position(|c| matches!(c.2.kind, CueKind::StopTurning(_))).unwrap();
        let (t, ..) = walker.cues[turned];
        let map_created = walker.t - 2.0 - 90.0 / rate;
        let left = 90.0 - (t - map_created) * rate;
        // 1.1 s to hear the words and react.
        assert!(
            (left - 1.1 * rate).abs() < 0.3 * rate,
            "at {rate} degrees a second {left} degrees were left"
        );
    }
}

/// At 15 degrees a second a turn around takes twelve seconds: the walker hears by a sound that it goes on, and is not told to turn
/// around again while they do.
#[test]
fn a_slow_turn_around_has_progress_and_is_told_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.heading = std::f64::consts::PI - 0.1;
    walker.stand(0.2).turn(-160.0, 15.0).stand(1.0);
    let told = walker.words().iter().filter(|words| words.starts_with("Turn around")).count();
    assert_eq!(told, 1, "{:?}", walker.words());
    let left: Vec<f64> = walker
        .cues
        .iter()
        .filter_map(|(.., cue)| match cue.kind {
            CueKind::Turning(left) => Some(left.abs()),
            _ => None,
        })
        .collect();
    assert!(left.len() > 15 && left.windows(2).all(|w| w[1] < w[0] + 1e-6), "{left:?}");
}

/// A correction to the same side is still being made while "turn left now" is said: it is not the turn, and the walker hears
/// when to stop turning.
#[test]
fn a_correction_under_way_is_not_taken_for_the_turn() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(27.8, 1.0).turn(35.0, 40.0).stand(1.0).turn(60.0, 40.0).stand(1.0);
    let words = walker.words();
    let told = words.iter().position(|w| w == "Turn left now.").unwrap();
    assert_eq!(words[told + 1..], ["Stop turning. Continue 20 metres to the end."], "{words:?}");
}

/// A corner of two bends, with the next turn a metre after it: who stands between the bends is turned to the leg after the corner,
/// not to the piece between them.
#[test]
fn a_turn_between_two_bends_ends_at_the_leg_after_them() {
    let corners = [[0., 0., 0.], [20., 0., 0.], [21.4, 1.4, 0.], [21.23, 2.4, 0.], [40., 2.4, 0.]];
    let mut walker = ScriptedWalker::new(&corners, default_config());
    walker.go(19.0, 1.0);
    (walker.x, walker.y) = (20.9, 0.9);
    walker.stand(1.5);
    let began = walker.t;
    walker.turn(100.0, 40.0).stand(1.0);
    let stop = walker.cues.iter().find(|c| matches!(c.2.kind, CueKind::StopTurning(_))).unwrap();
    let turned = 40.0 * (stop.0 - began);
    assert!((45.0..65.0).contains(&turned), "{turned} degrees: {:?}", walker.words());
}

#[test]
fn ignored_turn_is_repeated() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(29.5, 1.0).stand(8.0);
    assert_eq!(walker.find("Turn left").len(), 2, "{:#?}", walker.spoken());
}

#[test]
fn progress_every_ten_metres_unless_off() {
    let straight = [[0., 0., 0.], [45., 0., 0.]];
    let mut walker = ScriptedWalker::new(&straight, default_config());
    walker.go(40.5, 0.7);
    let at: Vec<f64> = walker.find("Another").iter().map(|f| f.1.round()).collect();
    assert_eq!(at, [10.0, 20.0, 30.0, 40.0]);
    let mut walker = ScriptedWalker::new(&straight, GuideConfig { progress_m: 0.0, ..default_config() });
    walker.go(40.0, 0.7);
    assert!(walker.find("Another").is_empty());
}

#[test]
fn ticks_only_within_the_cone() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(8.0, 1.0);
    let ticks = walker.count(|k| *k == CueKind::OnCourse);
    assert!((15..=20).contains(&ticks), "{ticks} ticks in 8 s");
    assert_eq!(walker.words().len(), 1);
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.heading = 0.31;
    walker.go(1.0, 1.0);
    assert_eq!(walker.count(|k| *k == CueKind::OnCourse), 0);
}

#[test]
fn aim_error_is_corrected_within_the_corridor() {
    for (sign, side) in [(1.0, "right"), (-1.0, "left")] {
        let mut walker = ScriptedWalker::on_test_route(default_config());
        walker.go(3.0, 1.0);
        walker.heading = sign * 0.35;
        walker.go(2.5, 1.0);
        assert_eq!(walker.words()[1], format!("Bear {side}."));
        assert!(walker.y.abs() < 1.0);
    }
}

#[test]
fn harmless_error_on_a_short_leg_is_not_corrected() {
    // 6 m to a turn, 5 degrees off: half a metre to the side when the turn comes.
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [6., 0., 0.], [6., 20., 0.]], default_config());
    walker.heading = 0.087;
    walker.go(5.0, 1.0);
    assert_eq!(walker.count(|k| matches!(k, CueKind::Adjust(_))), 0, "{:#?}", walker.spoken());
    // The same on a long leg is corrected once, near the edge of the corridor.
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.heading = 0.087;
    walker.go(16.0, 1.0);
    let adjusts = walker.find("Bear right");
    assert!((10.0..14.0).contains(&adjusts[0].1) && walker.y < 1.5, "{adjusts:?}");
}

#[test]
fn missed_end_stops_and_turns_the_walker() {
    for (sign, side) in [(1.0, "right"), (-1.0, "left")] {
        let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [10., 0., 0.]], without_corrections());
        walker.go(6.0, 1.0);
        // Beside the route, so that the end is passed 1.5 m away.
        walker.y = sign * 1.5;
        walker.go(5.0, 1.0);
        let missed = walker.find("the end is");
        assert_eq!(missed.len(), 1, "{:#?}", walker.spoken());
        let words = walker.words();
        let said = words.iter().find(|w| w.contains("the end is")).unwrap();
        assert!(said.starts_with("Stop. ") && said.contains(side), "{said}");
        assert!(!words.iter().any(|w| w.contains("Off the path")), "{words:?}");
    }
}

#[test]
fn blocked_within_a_metre_of_the_end_counts_as_arrived() {
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [10., 0., 0.]], without_corrections());
    walker.go(9.1, 0.4).stand(12.0);
    let arrived = |walker: &ScriptedWalker| walker.count(|k| *k == CueKind::Arrived);
    assert_eq!(arrived(&walker), 1, "0.9 m before the end: {:#?}", walker.spoken());
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [10., 0., 0.]], without_corrections());
    walker.go(8.6, 0.4).stand(30.0);
    assert_eq!(arrived(&walker), 0, "1.4 m before the end: {:#?}", walker.spoken());
}

#[test]
fn repeated_misses_within_reach_count_as_arrived() {
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [10., 0., 0.]], without_corrections());
    walker.go(8.4, 1.0);
    // To and fro in front of an obstacle 0.85 m before the end.
    for _ in 0..4 {
        walker.go(0.75, 0.4).turn(180.0, 60.0).go(0.75, 0.4).turn(180.0, 60.0);
    }
    let missed = walker.find("the end is");
    assert!(missed.len() <= 2, "{:#?}", walker.spoken());
    assert_eq!(walker.count(|k| *k == CueKind::Arrived), 1, "{:#?}", walker.spoken());
}

#[test]
fn backwards_legs_and_speed_limit() {
    let config = GuideConfig { facing: Facing::Backwards, ..default_config() };
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [40., 0., 0.]], config);
    // Facing west, moving east.
    walker.heading = std::f64::consts::PI;
    walker.go(-13.0, -0.4).stand(4.0);
    walker.go(-5.0, -0.8);
    let words = walker.words();
    assert!(words[0].contains("Caution, you will move backwards"), "{words:?}");
    let check = walker.find("Stop. Feel behind you with the cane.");
    assert!((check[0].1 - 12.0).abs() < 0.3, "{check:?}");
    assert!(words.contains(&"Move back 25 metres to the end.".to_owned()), "{words:?}");
    assert!(words.contains(&"Slow down.".to_owned()), "{words:?}");
}

#[test]
fn backwards_step_aside_only_when_it_helps() {
    let config = GuideConfig { facing: Facing::Backwards, ..default_config() };
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [9., 0., 0.]], config);
    // Facing west, moving east, north of the line: it lies to the walker's own left.
    walker.heading = std::f64::consts::PI;
    walker.go(-3.0, -0.4);
    walker.y = 0.7;
    walker.go(-0.4, -0.4).stand(6.0);
    let sides = |walker: &ScriptedWalker| {
        walker.words().into_iter().filter(|w| w.contains("Step back")).collect::<Vec<_>>()
    };
    assert_eq!(sides(&walker)[0], "Stop. Step back and to your left.");
    // Standing across the line, a step to the left hardly approaches it: a turn does.
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [9., 0., 0.]], config);
    walker.heading = std::f64::consts::PI;
    walker.go(-3.0, -0.4);
    walker.y = 0.7;
    walker.heading = (180.0 + 28.0_f64).to_radians();
    walker.go(-0.4, -0.4).stand(6.0);
    assert!(sides(&walker).is_empty() && !walker.find("otate ").is_empty(), "{:?}", walker.words());
    // Beyond the end the line is not beside the walker.
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [9., 0., 0.]], config);
    walker.heading = std::f64::consts::PI;
    walker.go(-7.0, -0.4);
    (walker.x, walker.y) = (9.6, 1.3);
    walker.go(-0.2, -0.4).stand(9.0);
    assert!(sides(&walker).is_empty(), "{:?}", walker.words());
}

#[test]
fn turn_directly_ahead_comes_first_after_a_stop() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(26.0, 1.0);
    walker.confidence = Confidence::Lost;
    walker.go(3.3, 1.0);
    walker.confidence = Confidence::Good;
    walker.stand(2.0);
    assert!(walker.words().iter().any(|w| w == "I found my place. Turn left."), "{:?}", walker.words());
}

#[test]
fn no_distances_without_scale() {
    let phrases = PhraseConfig { metric: false, ..PhraseConfig::default() };
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(29.0, 1.0).stand(1.0).turn(90.0, 40.0).go(8.0, 1.0);
    walker.y += 2.0;
    walker.confidence = Confidence::Lost;
    walker.stand(1.0);
    for (_, _, cue) in &walker.cues {
        if let Some(words) = phrases.words(cue) {
            assert!(!words.chars().any(|c| c.is_ascii_digit()), "{words}");
            assert!(!words.contains("metre"), "{words}");
        }
    }
}

#[test]
fn whoever_is_stopped_where_the_route_ends_has_arrived() {
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [20., 0., 0.]], default_config());
    walker.go(18.0, 1.0);
    walker.confidence = Confidence::Lost;
    walker.go(2.3, 1.0);
    walker.confidence = Confidence::Good;
    walker.stand(2.0);
    assert_eq!(walker.words().last().unwrap(), "Stop. You have arrived. Guidance ends.");
    assert!(walker.find("I found my place").is_empty(), "{:?}", walker.words());
}

#[test]
fn whoever_turns_just_before_the_end_stands_before_he_goes_on() {
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [20., 0., 0.], [20., 3., 0.]], default_config());
    walker.go(18.5, 1.0);
    walker.x = 20.6;
    walker.y = 1.8;
    walker.turn(80.0, 40.0);
    assert!(!walker.find("Stop. Stand still.").is_empty(), "{:?}", walker.words());
    assert!(walker.find("Stop turning").is_empty(), "{:?}", walker.words());
}
