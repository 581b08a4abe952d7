//! Each rule of the guide, on scripted poses.

use cairn_geometry::{Pose, Se3, So3, Vec3};
use cairn_guide::*;
use cairn_sensor::Stamp;

const STEP: f64 = 0.05;

/// A walker whose motion is scripted by the test.
struct ScriptedWalker {
    guide: Guide,
    t: f64,
    x: f64,
    y: f64,
    heading: f64,
    z: f64,
    confidence: Confidence,
    hazard: Option<StopReason>,
    stale: bool,
    last_pose: (Stamp, f64, f64, f64, f64),
    cues: Vec<(f64, f64, Cue)>,
}

impl ScriptedWalker {
    fn new(corners: &[[f64; 3]], config: GuideConfig) -> Self {
        let line: Vec<Vec3> = corners.iter().map(|c| Vec3::from(*c)).collect();
        let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
        let [x, y, z] = corners[0];
        Self {
            guide: Guide::new(plan, Ground::z_up(), config).unwrap(),
            t: 0.0,
            x,
            y,
            heading: 0.0,
            z,
            confidence: Confidence::Good,
            hazard: None,
            stale: false,
            last_pose: (Stamp(0), x, y, z, 0.0),
            cues: Vec::new(),
        }
    }

    /// On the test route: 30 m east, then 20 m north.
    fn on_test_route(config: GuideConfig) -> Self {
        Self::new(&[[0., 0., 0.], [30., 0., 0.], [30., 20., 0.]], config)
    }

    fn tick(&mut self) {
        self.t += STEP;
        let now = Stamp::from_seconds(self.t);
        if !self.stale {
            self.last_pose = (now, self.x, self.y, self.z, self.heading);
        }
        let (pose_stamp, x, y, z, heading) = self.last_pose;
        let mut pose = camera_pose(x, y, heading, 0.2);
        pose.translation.z = z;
        let input = GuideInput {
            now,
            pose_stamp,
            odom_from_camera: Pose::new(pose),
            confidence: self.confidence,
            speed: None,
            hazard: self.hazard,
        };
        if let Some(cue) = self.guide.step(&input) {
            self.cues.push((self.t, self.x, cue));
        }
    }

    fn stand(&mut self, seconds: f64) -> &mut Self {
        for _ in 0..(seconds / STEP).round() as usize {
            self.tick();
        }
        self
    }

    fn go(&mut self, metres: f64, speed: f64) -> &mut Self {
        for _ in 0..(metres / speed / STEP).round() as usize {
            self.x += speed * STEP * self.heading.cos();
            self.y += speed * STEP * self.heading.sin();
            self.tick();
        }
        self
    }

    fn turn(&mut self, degrees: f64, rate_deg: f64) -> &mut Self {
        for _ in 0..(degrees.abs() / rate_deg / STEP).round() as usize {
            self.heading += (rate_deg * STEP).to_radians() * degrees.signum();
            self.tick();
        }
        self
    }

    /// Time, x and text of everything said, without sounds.
    fn spoken(&self) -> Vec<(f64, f64, String)> {
        let phrases = PhraseConfig::default();
        self.cues.iter().filter_map(|(t, x, c)| phrases.words(c).map(|w| (*t, *x, w))).collect()
    }

    fn words(&self) -> Vec<String> {
        self.spoken().into_iter().map(|h| h.2).collect()
    }

    fn find(&self, part: &str) -> Vec<(f64, f64)> {
        self.spoken().iter().filter(|h| h.2.contains(part)).map(|h| (h.0, h.1)).collect()
    }

    fn count(&self, kind: impl Fn(&CueKind) -> bool) -> usize {
        self.cues.iter().filter(|c| kind(&c.2.kind)).count()
    }
}

fn default_config() -> GuideConfig {
    GuideConfig::default()
}

#[test]
fn words_of_a_route_with_one_turn() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(29.9, 1.0).stand(0.4).turn(90.0, 40.0).go(22.0, 1.0);
    let words = walker.words();
    assert_eq!(words[0], "The route is 50 metres long. Continue 30 metres, then turn left.");
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

/// A config without small corrections, to test the rules behind them.
fn without_corrections() -> GuideConfig {
    GuideConfig { adjust_dwell_s: 1e9, progress_m: 0.0, ..default_config() }
}

#[test]
fn off_path_after_dwell_and_repeated() {
    let mut walker =
        ScriptedWalker::new(&[[0., 0., 0.], [3., 1.2, 0.], [90., 1.2, 0.]], without_corrections());
    // Along the route, then 1.8 m to its right and on in parallel.
    walker.heading = 0.38;
    walker.go(3.2, 1.0);
    walker.heading = 0.0;
    walker.go(3.0, 1.0);
    walker.y -= 1.8;
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
    assert!(after[0].2.contains("It helps to walk backwards"), "{after:?}");
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
    assert_eq!(&walker.words()[said..], ["Stop. I find no way past it."]);
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
fn who_is_too_near_to_something_steps_back() {
    let mut walker = ScriptedWalker::on_test_route(default_config());
    walker.go(2.0, 1.0);
    walker.hazard = Some(StopReason::Obstacle(Obstacle::at(0.6, 0.0, false)));
    walker.guide.step_back(Some(1.0));
    walker.stand(4.0);
    walker.guide.step_back(None);
    walker.stand(3.0);
    let expected = [
        "Stop. Something is in the way, half a metre ahead.",
        "Stop. Step back and to your left.",
        "Stop. Something is in the way, half a metre ahead.",
    ];
    assert_eq!(&walker.words()[1..], expected);
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
    let check = walker.find("Stop. Check behind you.");
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
fn a_walker_joins_on_the_way_and_is_told_how_much_is_left() {
    let mut w = ScriptedWalker::on_test_route(GuideConfig::default());
    // Twelve metres along, a little beside it, facing away from where it leads.
    (w.x, w.y, w.heading) = (12.0, 1.0, std::f64::consts::PI);
    w.stand(1.0);
    assert_eq!(w.words(), ["You are on the route, 40 metres to go. Turn around."]);
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
    let away = "The route is 10 metres away, to your right. I do not know the ground between. Go there, and I will guide you.";
    assert_eq!(words, [away; 3]);
    // He goes there by himself.
    w.turn(-90.0, 45.0).go(9.0, 0.8);
    let words = w.words();
    assert!(words[3..].iter().any(|s| s.starts_with("You are on the route, 40 metres to go.")), "{words:?}");
}
