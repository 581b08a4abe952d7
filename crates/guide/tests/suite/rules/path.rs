//! Beside the path: off it, the wrong way, standing, stairs, joining on the way.

use super::walker::{ScriptedWalker, default_config, without_corrections};
use cairn_guide::*;

#[test]
fn off_path_after_dwell_and_repeated() {
    let mut walker =
        ScriptedWalker::new(&[[0., 0., 0.], [3., 1.2, 0.], [90., 1.2, 0.]], without_corrections());
    // Along the route, then 1.8 m to its right and on in parallel.
    walker.heading = 0.38;
    walker.go(3.2, 1.0);
    walker.heading = 0.0;
    walker.go(3.0, 1.0);
    // As fast as somebody may be pushed aside: a pose that jumps is not believed at once.
    for _ in 0..12 {
        walker.y -= 0.15;
        walker.tick();
    }
    let left_at = walker.t;
    walker.go(20.0, 1.0);
    let off = walker.find("Off the path");
    assert!((off[0].0 - left_at - 2.0).abs() < 0.2, "first after {} s", off[0].0 - left_at);
    assert!((off[1].0 - off[0].0 - 5.0).abs() < 0.2, "again after {} s", off[1].0 - off[0].0);
    let words = &walker.spoken().iter().find(|h| h.2.contains("Off")).unwrap().2.clone();
    assert!(words.starts_with("Off the path. Bear left, it is 2 metres away."), "{words}");
}

#[test]
fn off_path_before_first_waypoint_repeats_after_ten_seconds() {
    let mut walker = ScriptedWalker::on_test_route(without_corrections());
    walker.go(2.0, 0.5);
    walker.y = -1.8;
    walker.go(11.0, 0.5);
    let off = walker.find("Off the path");
    assert!((off[1].0 - off[0].0 - 10.0).abs() < 0.2, "{off:?}");
}

#[test]
fn off_path_hysteresis_and_short_excursions() {
    let mut walker = ScriptedWalker::on_test_route(without_corrections());
    walker.go(2.0, 0.5);
    walker.y = 1.8;
    walker.go(0.8, 0.5);
    walker.y = 0.5;
    walker.go(1.0, 0.5);
    assert!(walker.find("Off").is_empty(), "an excursion of 1.6 s");
    walker.y = 1.8;
    walker.go(1.5, 0.5);
    assert_eq!(walker.find("Off").len(), 1);
    walker.y = 1.4;
    walker.go(0.5, 0.5);
    assert_eq!(walker.count(|k| *k == CueKind::BackOnPath), 0, "1.4 m is not back yet");
    walker.y = 1.1;
    walker.go(0.5, 0.5);
    assert_eq!(walker.count(|k| *k == CueKind::BackOnPath), 1);
}

/// Whoever comes back to the last leg from beside it would pass the end: they are turned to it once they are inside, not while the
/// route still lies to the other side.
#[test]
fn a_walker_who_returns_is_not_turned_away_from_the_route_outside_of_it() {
    let mut walker = ScriptedWalker::new(&[[0., 0., 0.], [30., 0., 0.]], default_config());
    (walker.x, walker.y, walker.heading) = (14.0, -4.2, 0.5);
    while walker.y < -1.55 {
        walker.go(0.06, 1.2);
    }
    assert_eq!(walker.count(|k| matches!(k, CueKind::Adjust(_))), 0, "{:?}", walker.words());
    walker.go(4.0, 1.2);
    assert!(!walker.find("Bear right").is_empty(), "{:?}", walker.words());
}

#[test]
fn wrong_way_after_two_metres() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(12.0, 1.0);
    walker.heading = std::f64::consts::PI;
    let from = walker.x;
    walker.go(4.0, 1.0);
    let at = walker.find("Wrong way")[0].1;
    assert!((from - at - 2.0).abs() < 0.2, "after {} m", from - at);
    assert!(walker.words().iter().any(|w| w == "Wrong way. Turn around."));
}

#[test]
fn standing_walker_is_reassured_twice() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(3.0, 1.0).stand(60.0);
    let told = walker.find("You are on the path. Continue 25 metres, then turn left.");
    assert_eq!(told.len(), 2, "{:#?}", walker.spoken());
    assert!((told[1].0 - told[0].0 - 15.0).abs() < 0.2);
    assert!((told[0].0 - 9.0).abs() < 1.0, "{}", told[0].0);
}

#[test]
fn walker_stuck_beside_the_path_is_led_straight_back() {
    let mut walker = ScriptedWalker::on_test_route(without_corrections());
    walker.go(5.0, 1.0);
    // 2.2 m to the left and facing the route ahead, with a corner between the two.
    (walker.y, walker.heading) = (2.2, -0.46);
    walker.stand(60.0);
    let turns: Vec<f64> = walker
        .cues
        .iter()
        .filter_map(|(_, _, c)| match c.kind {
            CueKind::Rotate(turn) => Some((walker.heading + turn).to_degrees()),
            _ => None,
        })
        .collect();
    assert!(turns.iter().any(|led| (led + 90.0).abs() < 5.0), "{turns:?} {:#?}", walker.spoken());
}

#[test]
fn stairs_are_announced_three_metres_ahead() {
    let mut walker =
        ScriptedWalker::new(&[[0., 0., 0.], [20., 0., 0.], [24., 0., 2.5], [40., 0., 2.5]], default_config());
    walker.go(19.9, 0.8);
    let near = walker.find("In 3 metres, go upstairs.");
    assert!((20.0 - near[0].1 - 3.0).abs() < 0.2, "{:#?}", walker.spoken());
    assert_eq!(walker.find("Stairs now, go upstairs.").len(), 1);
    let turn = ScriptedWalker::new(
        &[[0., 0., 0.], [20., 0., 0.], [20., 4., -2.5], [20., 9., -2.5]],
        default_config(),
    );
    let next = turn.guide.plan().maneuvers()[0];
    assert_eq!((next.stairs, next.turn_rad > 1.5), (Some(Stairs::Down), true));
    let mut turn = turn;
    turn.go(19.0, 0.8);
    assert!(
        turn.words().iter().any(|w| w == "In 3 metres, turn left and go downstairs."),
        "{:?}",
        turn.words()
    );
}

#[test]
fn a_walker_joins_on_the_way_and_is_told_how_much_is_left() {
    let mut w = ScriptedWalker::on_test_route(GuideConfig::default());
    // Twelve metres along, a little beside it, facing away from where it leads.
    (w.x, w.y, w.heading) = (12.0, 1.0, std::f64::consts::PI);
    w.stand(1.0);
    assert_eq!(w.words(), ["Turn around. You are on the route, 40 metres to go."]);
    w.turn(180.0, 45.0).go(20.0, 0.8);
    assert_eq!(w.count(|k| matches!(k, CueKind::Start { .. } | CueKind::Away { .. })), 1);
    assert_eq!(w.find("Turn left now").len(), 1, "{:?}", w.words());
}

#[test]
fn a_walker_who_is_not_on_the_route_is_not_led_across_unknown_ground() {
    let mut w = ScriptedWalker::on_test_route(GuideConfig::default());
    (w.x, w.y) = (10.0, 12.0);
    w.stand(30.0);
    let words = w.words();
    let away = "The route is 10 metres away, to your right. I do not know the ground between. Ask for help to reach it.";
    assert_eq!(words, [away; 3]);
    // He goes there by himself.
    w.turn(-90.0, 45.0).go(9.0, 0.8);
    let words = w.words();
    assert!(words[3..].iter().any(|s| s.ends_with("You are on the route, 40 metres to go.")), "{words:?}");
}
