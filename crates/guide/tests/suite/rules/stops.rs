//! Stops: lost tracking, old poses, hazards, poses that cannot guide.

use super::walker::{ScriptedWalker, default_config};
use cairn_guide::*;

#[test]
fn lost_tracking_stops_and_repeats_with_reason() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(5.0, 1.0);
    walker.confidence = Confidence::Lost;
    let lost_at = walker.t;
    walker.stand(10.0);
    let stops = walker.find("Stop. I lost my place.");
    assert!(stops[0].0 - lost_at < 0.11);
    assert_eq!(stops.len(), 4, "each 3 s: {stops:?}");
    assert_eq!(walker.cues.last().unwrap().2.priority(), Priority::Urgent);
    walker.confidence = Confidence::Good;
    walker.stand(2.0);
    assert_eq!(walker.words().last().unwrap(), "I found my place. Continue 25 metres, then turn left.");
}

#[test]
fn long_loss_asks_the_walker_to_turn() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(5.0, 1.0);
    walker.confidence = Confidence::Lost;
    walker.stand(40.0);
    let look = walker.find("Let me find my place. Turn slightly left.");
    assert_eq!(look.len(), 5, "each 6 s after four stops: {:?}", walker.spoken());
    assert_eq!(walker.find("Stop. I lost my place.").len(), 4);
}

/// Loses tracking for `lost_s`, then has it back for four seconds: the walker stays where he is.
fn lose_and_find(walker: &mut ScriptedWalker, lost_s: f64) {
    walker.confidence = Confidence::Lost;
    walker.stand(lost_s);
    walker.confidence = Confidence::Good;
    walker.stand(4.0);
}

const GIVEN_UP: &str = "Stop. I keep losing my place here and cannot guide you on.";

#[test]
fn tracking_lost_again_and_again_at_one_place_ends_directions_with_the_reason() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(5.0, 1.0);
    lose_and_find(&mut walker, 20.0);
    lose_and_find(&mut walker, 20.0);
    assert!(!walker.words().iter().any(|w| w.starts_with(GIVEN_UP)), "{:?}", walker.words());
    let third = walker.t;
    lose_and_find(&mut walker, 20.0);
    walker.stand(60.0);
    let after: Vec<_> = walker.spoken().into_iter().filter(|said| said.0 > third).collect();
    assert!(after.len() > 2 && after.iter().all(|said| said.2.starts_with(GIVEN_UP)), "{after:?}");
    assert!(after[0].2.contains("It also helps to move backwards"), "{after:?}");
    assert_eq!(walker.guide.state(), GuideState::Stopped(StopReason::CannotRelocalise));
    // Brought farther along the route, the walker is guided again.
    walker.go(4.0, 1.0);
    walker.stand(2.0);
    assert!(!matches!(walker.guide.state(), GuideState::Stopped(_)), "{:?}", walker.guide.state());
}

#[test]
fn looking_round_is_given_up_after_a_minute_and_a_place_found_later_is_taken() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(5.0, 1.0);
    walker.confidence = Confidence::Lost;
    let lost_at = walker.t;
    walker.stand(100.0);
    let look = walker.find("Let me find my place. Turn slightly left.");
    assert!(look.iter().all(|said| said.0 - lost_at < 60.0), "{look:?}");
    assert!(walker.words().last().unwrap().starts_with(GIVEN_UP), "{:?}", walker.words());
    walker.confidence = Confidence::Good;
    walker.stand(2.0);
    assert_eq!(walker.words().last().unwrap(), "I found my place. Continue 25 metres, then turn left.");
}

#[test]
fn stale_pose_stops_guidance() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(5.0, 1.0);
    walker.stale = true;
    let since = walker.t;
    walker.go(8.0, 1.0);
    let after: Vec<_> = walker.spoken().into_iter().filter(|h| h.0 > since).collect();
    assert!((after[0].0 - since - 0.5).abs() < 0.11, "{after:?}");
    assert!(after.iter().all(|h| h.2 == "Stop. No picture from the camera."), "{after:?}");
    assert_eq!(walker.guide.state(), GuideState::Stopped(StopReason::PoseStale));
}

#[test]
fn external_hazards_stop_and_new_reason_is_said_at_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    let obstacle = |ahead_m| StopReason::Obstacle(Obstacle::at(ahead_m, 0.3, false));
    walker.hazard = Some(obstacle(1.2));
    walker.stand(1.0);
    walker.hazard = Some(StopReason::UnknownGround);
    walker.stand(1.0);
    assert_eq!(
        &walker.words()[1..],
        [
            "Stop. Something is in the way, 1 metre ahead, a little to your left.",
            "Stop. I cannot see the ground ahead."
        ]
    );
    // An obstacle that comes nearer is not a new reason.
    let said = walker.words().len();
    for k in 0..10 {
        walker.hazard = Some(obstacle(1.2 - 0.05 * f64::from(k)));
        walker.stand(0.1);
    }
    assert_eq!(walker.words().len(), said + 1, "{:?}", walker.words());
    // There is room to the right, then what was in the way is gone.
    walker.hazard = None;
    walker.guide.detour(Some(-0.6));
    walker.stand(1.5);
    assert!(
        walker.words().last().unwrap().starts_with("There is room beside it. Slow down. Turn slightly right")
    );
    walker.guide.detour(None);
    walker.hazard = Some(obstacle(1.0));
    walker.stand(0.5);
    walker.hazard = None;
    walker.stand(1.5);
    assert!(walker.words().last().unwrap().starts_with("The way is clear."), "{:?}", walker.words());
}

#[test]
fn that_no_way_past_is_found_is_said_at_once_and_seldom_again() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.hazard = Some(StopReason::Obstacle(Obstacle::at(1.2, 0.3, false)));
    walker.stand(1.0);
    let said = walker.words().len();
    walker.hazard = Some(StopReason::NoWayPast);
    walker.stand(0.2);
    assert_eq!(&walker.words()[said..], ["Stop. I cannot find a way past it."]);
    walker.stand(15.0);
    assert_eq!(walker.words().len(), said + 1, "{:?}", walker.words());
    walker.stand(4.0);
    assert_eq!(walker.words().len(), said + 2, "{:?}", walker.words());
    walker.hazard = None;
    walker.stand(1.5);
    assert!(walker.words().last().unwrap().starts_with("The way is clear."), "{:?}", walker.words());
}

#[test]
fn nobody_is_sent_where_it_is_not_free() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.hazard = Some(StopReason::Obstacle(Obstacle::at(1.2, 0.0, false)));
    walker.stand(1.0);
    // Only between 25 and 35 degrees to his left.
    let free = (0..72).map(|k| if (5..=7).contains(&k) { 3.0 } else { 1.0 }).collect();
    walker.hazard = None;
    walker.guide.free_way(Some(FreeWay::new(free, 2.0)));
    walker.guide.detour(Some(0.5));
    walker.stand(2.5);
    let begins = walker.words().len();
    // He bears by less than he should, and by too little to be sent on.
    walker.turn(15.0, 30.0).stand(1.0);
    assert!(!walker.guide.goes_on());
    walker.stand(1.2).turn(13.5, 30.0).stand(1.0);
    assert!(walker.guide.goes_on());
    let words = walker.words();
    assert_eq!(words[begins - 1], "There is room beside it. Slow down. Bear left.", "{words:?}");
    let expected =
        ["Stop. Stand still.", "Bear left.", "Stop. Stand still.", "Continue 30 metres, then turn left."];
    assert_eq!(&words[begins..], expected, "{words:?}");
}

#[test]
fn who_is_told_to_make_a_step_hears_no_stop_while_he_makes_it() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.hazard = Some(StopReason::Obstacle(Obstacle::at(0.6, 0.0, false)));
    walker.guide.take_step(Some(Step::BackAside(1.0)));
    let stop = "Stop. Something is in the way, half a metre ahead.";
    let back = "Stop. Step back and to your left.";
    // "Stop" would cut the step short.
    walker.stand(6.0);
    assert_eq!(&walker.words()[1..], [stop, back]);
    // He has not made it: once more.
    walker.stand(2.0);
    assert_eq!(&walker.words()[1..], [stop, back, back]);
    // It is made, and the next is said as soon as it is known.
    walker.guide.take_step(None);
    walker.stand(1.2);
    walker.guide.take_step(Some(Step::Aside(-1.0)));
    walker.stand(0.3);
    let small = "Take a small step to your right.";
    assert_eq!(&walker.words()[1..], [stop, back, back, small]);
    walker.guide.take_step(None);
    walker.stand(2.5);
    assert_eq!(walker.words().len(), 5);
    walker.stand(1.0);
    assert_eq!(&walker.words()[1..], [stop, back, back, small, stop]);
}

#[test]
fn who_walks_elsewhere_than_a_step_leads_hears_stop_at_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.hazard = Some(StopReason::Obstacle(Obstacle::at(0.6, 0.0, false)));
    walker.guide.take_step(Some(Step::Aside(1.0)));
    walker.stand(2.0);
    let (stop, small) =
        ("Stop. Something is in the way, half a metre ahead.", "Take a small step to your left.");
    assert_eq!(&walker.words()[1..], [stop, small]);
    walker.guide.take_step(None);
    walker.guide.went_astray();
    walker.go(0.2, 1.0);
    assert_eq!(&walker.words()[1..], [stop, small, stop]);
    walker.stand(2.0);
    assert_eq!(&walker.words()[1..], [stop, small, stop]);
    walker.stand(1.5);
    assert_eq!(&walker.words()[1..], [stop, small, stop, stop]);
}

#[test]
fn flickering_confidence_does_not_resume() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    for _ in 0..20 {
        walker.confidence = Confidence::Lost;
        walker.stand(0.3);
        walker.confidence = Confidence::Good;
        walker.stand(0.3);
    }
    assert!(walker.find("I found my place").is_empty());
}

#[test]
fn non_finite_pose_stops() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.x = f64::NAN;
    walker.stand(1.0);
    assert_eq!(walker.words().last().unwrap(), "Stop. I lost my place.");
}

#[test]
fn weak_tracking_is_said_once() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.confidence = Confidence::Low;
    walker.go(5.0, 1.0);
    assert_eq!(walker.find("I cannot see well").len(), 1);
}

#[test]
fn nobody_is_guided_far_without_the_map_in_view() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.confidence = Confidence::Low;
    walker.go(1.8, 1.0);
    assert!(walker.find("Stop").is_empty(), "{:?}", walker.words());
    let until = walker.t;
    walker.go(6.0, 1.0);
    let stops = walker.find("I lost my place");
    assert!((0.1..0.4).contains(&(stops[0].0 - until)), "{stops:?}");
    // Nothing but stop is said, and no direction, until the map is in view again for a while.
    let words = walker.words();
    assert!(words.iter().skip_while(|w| !w.starts_with("Stop")).all(|w| w.starts_with("Stop")), "{words:?}");
    walker.confidence = Confidence::Good;
    walker.stand(1.5);
    assert!(!walker.words().last().unwrap().starts_with("Stop"), "{:?}", walker.words());
}

#[test]
fn a_pose_that_runs_away_guides_nobody() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0).go(6.0, 2.2);
    assert!(walker.find("I lost my place").is_empty(), "a fast walker: {:?}", walker.words());
    let until = walker.t;
    walker.go(40.0, 8.0);
    let stops = walker.find("I lost my place");
    assert!((0.4..1.0).contains(&(stops[0].0 - until)), "{stops:?}");
    let words = walker.words();
    assert!(words.iter().skip_while(|w| !w.starts_with("Stop")).all(|w| w.starts_with("Stop")), "{words:?}");
}

#[test]
fn a_turn_on_the_spot_needs_no_map_in_view() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(28.0, 1.0);
    walker.confidence = Confidence::Low;
    walker.turn(90.0, 25.0);
    assert!(walker.find("I lost my place").is_empty(), "{:?}", walker.words());
    walker.heading = std::f64::consts::FRAC_PI_2;
    walker.go(3.0, 1.0);
    assert_eq!(walker.find("I lost my place").len(), 1, "{:?}", walker.words());
}

const TO_AND_FRO: &str = "Stop. I keep leading you back and forth here and cannot guide you on. Ask for help";

/// With good tracking a walker goes some metres along the route, turns round and comes back, again and again: whatever leads him so.
#[test]
fn one_who_is_led_to_and_fro_is_stopped_with_what_helps() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(8.0, 0.8);
    let mut stopped = None;
    for _ in 0..6 {
        walker.turn(180.0, 60.0).go(4.0, 0.8).turn(180.0, 60.0).go(4.0, 0.8);
        stopped = stopped.or(walker.find(TO_AND_FRO).first().copied());
    }
    let (at_s, _) = stopped.expect("told that this leads nowhere");
    assert!((30.0..60.0).contains(&at_s), "after {at_s} s");
    let after: Vec<_> = walker.spoken().into_iter().filter(|said| said.0 >= at_s).collect();
    assert!(after.len() > 1 && after.iter().all(|said| said.2.starts_with(TO_AND_FRO)), "{after:?}");
    assert!(after.windows(2).all(|w| w[1].0 - w[0].0 > 15.0), "not again and again: {after:?}");
    assert_eq!(walker.guide.state(), GuideState::Stopped(StopReason::ToAndFro));
    // Somebody leads him on: there he is guided again.
    walker.go(5.0, 0.8);
    walker.stand(2.0);
    assert!(!matches!(walker.guide.state(), GuideState::Stopped(_)), "{:?}", walker.guide.state());
    let words = walker.words();
    assert!(words.last().unwrap().starts_with("I found my place."), "{words:?}");
}

#[test]
fn one_mistake_and_a_long_stop_are_not_to_and_fro() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(8.0, 0.8).turn(180.0, 60.0).go(5.0, 0.8).turn(180.0, 60.0).go(2.0, 0.8);
    walker.stand(120.0).go(20.0, 0.8);
    assert!(walker.find("to and fro").is_empty(), "{:?}", walker.words());
}

#[test]
fn whoever_is_stopped_or_waits_hears_something_every_three_seconds() {
    let quiet_s = |walker: &ScriptedWalker| {
        let times: Vec<f64> = walker.cues.iter().map(|cue| cue.0).chain([walker.t]).collect();
        times.windows(2).map(|pair| pair[1] - pair[0]).fold(times[0], f64::max)
    };
    // The first pose does not come.
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.confidence = Confidence::Lost;
    walker.stand(30.0);
    assert!(quiet_s(&walker) <= 3.1 && walker.words().len() > 2, "{:#?}", walker.cues);
    // It is given up to find his place.
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.stand(0.1).confidence = Confidence::Lost;
    walker.stand(200.0);
    assert_eq!(walker.guide.state(), GuideState::Stopped(StopReason::CannotRelocalise));
    assert!(quiet_s(&walker) <= 3.1, "{:#?}", walker.cues);
    // He is not on the route.
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.y = 20.0;
    walker.stand(60.0);
    assert!(quiet_s(&walker) <= 3.1 && walker.words()[0].contains("away"), "{:#?}", walker.cues);
}
