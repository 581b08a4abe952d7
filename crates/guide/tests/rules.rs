//! Each rule of the guide, on poses moved by hand.

use cairn_geometry::{Pose, Vec3};
use cairn_guide::trial::camera_pose;
use cairn_guide::*;
use cairn_sensor::Stamp;

const STEP: f64 = 0.05;

/// A walker moved by the test.
struct Hand {
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

impl Hand {
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

    /// On the way of the tests: 30 m east, then 20 m north.
    fn bent(config: GuideConfig) -> Self {
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

    fn resolve(&mut self, seconds: f64) -> &mut Self {
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

    /// Where (time, x) and what, without ticks.
    fn heard(&self) -> Vec<(f64, f64, String)> {
        let phrases = PhraseConfig::default();
        self.cues.iter().filter_map(|(t, x, c)| phrases.words(c).map(|w| (*t, *x, w))).collect()
    }

    fn words(&self) -> Vec<String> {
        self.heard().into_iter().map(|h| h.2).collect()
    }

    fn find(&self, part: &str) -> Vec<(f64, f64)> {
        self.heard().iter().filter(|h| h.2.contains(part)).map(|h| (h.0, h.1)).collect()
    }

    fn count(&self, kind: impl Fn(&CueKind) -> bool) -> usize {
        self.cues.iter().filter(|c| kind(&c.2.kind)).count()
    }
}

fn plain() -> GuideConfig {
    GuideConfig::default()
}

#[test]
fn a_straight_start_a_turn_and_the_end() {
    let mut hand = Hand::bent(plain());
    hand.go(29.9, 1.0).resolve(0.4).turn(90.0, 40.0).go(22.0, 1.0);
    let words = hand.words();
    assert_eq!(words[0], "The way is 50 metres. Continue 30 metres, then turn left.");
    let expected = [
        "20 metres more, then turn left.",
        "10 metres more, then turn left.",
        "In 6 metres, turn left.",
        "Turn left now.",
        "Stop turning. Continue 20 metres to the end.",
        "9 metres more, to the end.",
        "Slow down, 5 metres to the end.",
        "Stop. You have arrived. Guidance ends.",
    ];
    assert_eq!(&words[1..], expected, "{:#?}", hand.heard());
    assert_eq!(hand.guide.state(), GuideState::Arrived);
}

#[test]
fn the_approach_comes_six_metres_ahead_and_earlier_for_the_fast() {
    for (speed, ahead) in [(0.6, 6.0), (1.0, 6.0), (1.5, 7.0)] {
        let mut hand = Hand::bent(plain());
        hand.go(27.0, speed);
        let at = hand.find("In ")[0].1;
        assert!((30.0 - at - ahead).abs() < 0.3, "at {speed} m/s {} m ahead", 30.0 - at);
    }
}

#[test]
fn turn_now_comes_at_two_metres_times_speed_within_its_limits() {
    // 2 m x speed + 0.3 s of reaction; at most a quarter of the segment, at least 0.6 m, plus reaction.
    for (length, speed, ahead) in [(30.0, 1.0, 2.3), (30.0, 0.5, 1.15), (6.0, 1.0, 1.8), (30.0, 0.2, 0.66)] {
        let mut hand = Hand::new(&[[0., 0., 0.], [length, 0., 0.], [length, 20., 0.]], plain());
        hand.go(length - 0.1, speed);
        let at = hand.find("Turn left now")[0].1;
        assert!((length - at - ahead).abs() < 0.15, "{length} m at {speed} m/s: {} m ahead", length - at);
    }
}

#[test]
fn stop_turning_comes_early_by_rate_and_reaction() {
    for rate in [20.0, 40.0] {
        let mut hand = Hand::bent(plain());
        hand.go(29.9, 1.0).resolve(1.2).turn(90.0, rate).resolve(2.0);
        let turned = hand.cues.iter().position(|c| matches!(c.2.kind, CueKind::StopTurning(_))).unwrap();
        let (t, ..) = hand.cues[turned];
        let map_created = hand.t - 2.0 - 90.0 / rate;
        let left = 90.0 - (t - map_created) * rate;
        // 1.1 s of listening and reacting.
        assert!(
            (left - 1.1 * rate).abs() < 0.3 * rate,
            "at {rate} degrees a second {left} degrees were left"
        );
    }
}

#[test]
fn a_turn_that_nobody_follows_is_told_again() {
    let mut hand = Hand::bent(plain());
    hand.go(29.5, 1.0).resolve(8.0);
    assert_eq!(hand.find("Turn left").len(), 2, "{:#?}", hand.heard());
}

#[test]
fn progress_each_ten_metres_and_not_when_turned_off() {
    let straight = [[0., 0., 0.], [45., 0., 0.]];
    let mut hand = Hand::new(&straight, plain());
    hand.go(40.5, 0.7);
    let at: Vec<f64> = hand.find("more").iter().map(|f| f.1.round()).collect();
    assert_eq!(at, [10.0, 20.0, 30.0, 40.0]);
    let mut hand = Hand::new(&straight, GuideConfig { progress_m: None, ..plain() });
    hand.go(40.0, 0.7);
    assert!(hand.find("more").is_empty());
}

#[test]
fn ticks_come_within_the_cone_only() {
    let mut hand = Hand::bent(plain());
    hand.go(8.0, 1.0);
    let ticks = hand.count(|k| *k == CueKind::OnCourse);
    assert!((15..=20).contains(&ticks), "{ticks} ticks in 8 s");
    assert_eq!(hand.words().len(), 1);
    let mut hand = Hand::bent(plain());
    hand.heading = 0.31;
    hand.go(1.0, 1.0);
    assert_eq!(hand.count(|k| *k == CueKind::OnCourse), 0);
}

#[test]
fn a_small_error_of_aim_is_corrected_before_the_corridor_ends() {
    for (sign, side) in [(1.0, "right"), (-1.0, "left")] {
        let mut hand = Hand::bent(plain());
        hand.go(3.0, 1.0);
        hand.heading = sign * 0.35;
        hand.go(2.5, 1.0);
        assert_eq!(hand.words()[1], format!("Bear {side}."));
        assert!(hand.y.abs() < 1.0);
    }
}

#[test]
fn an_error_that_the_leg_outlives_not_is_left_alone() {
    // 6 m to a turn, 5 degrees off: half a metre to the side when the turn comes.
    let mut hand = Hand::new(&[[0., 0., 0.], [6., 0., 0.], [6., 20., 0.]], plain());
    hand.heading = 0.087;
    hand.go(5.0, 1.0);
    assert_eq!(hand.count(|k| matches!(k, CueKind::Adjust(_))), 0, "{:#?}", hand.heard());
    // The same on a long leg is corrected once, near the edge.
    let mut hand = Hand::bent(plain());
    hand.heading = 0.087;
    hand.go(16.0, 1.0);
    let adjusts = hand.find("Bear right");
    assert!((10.0..14.0).contains(&adjusts[0].1) && hand.y < 1.5, "{adjusts:?}");
}

#[test]
fn who_passes_the_end_is_stopped_and_turned_to_it() {
    for (sign, side) in [(1.0, "right"), (-1.0, "left")] {
        let mut hand = Hand::new(&[[0., 0., 0.], [10., 0., 0.]], stern());
        hand.go(6.0, 1.0);
        // Beside the way, so that the end is passed 1.5 m away.
        hand.y = sign * 1.5;
        hand.go(5.0, 1.0);
        let missed = hand.find("the end is");
        assert_eq!(missed.len(), 1, "{:#?}", hand.heard());
        let words = hand.words();
        let said = words.iter().find(|w| w.contains("the end is")).unwrap();
        assert!(said.starts_with("Stop. ") && said.contains(side), "{said}");
        assert!(!words.iter().any(|w| w.contains("Off the path")), "{words:?}");
    }
}

#[test]
fn who_is_held_up_before_the_end_has_arrived() {
    let mut hand = Hand::new(&[[0., 0., 0.], [10., 0., 0.]], stern());
    hand.go(9.1, 0.4).resolve(12.0);
    let arrived = |hand: &Hand| hand.count(|k| *k == CueKind::Arrived);
    assert_eq!(arrived(&hand), 1, "0.9 m before the end: {:#?}", hand.heard());
    let mut hand = Hand::new(&[[0., 0., 0.], [10., 0., 0.]], stern());
    hand.go(8.6, 0.4).resolve(30.0);
    assert_eq!(arrived(&hand), 0, "1.4 m before the end: {:#?}", hand.heard());
}

#[test]
fn who_misses_the_end_time_and_again_has_arrived_within_reach() {
    let mut hand = Hand::new(&[[0., 0., 0.], [10., 0., 0.]], stern());
    hand.go(8.4, 1.0);
    // To and fro before something that stands 0.85 m before it.
    for _ in 0..4 {
        hand.go(0.75, 0.4).turn(180.0, 60.0).go(0.75, 0.4).turn(180.0, 60.0);
    }
    let missed = hand.find("the end is");
    assert!(missed.len() <= 2, "{:#?}", hand.heard());
    assert_eq!(hand.count(|k| *k == CueKind::Arrived), 1, "{:#?}", hand.heard());
}

/// A guide that gives no small corrections, to see the rule behind them.
fn stern() -> GuideConfig {
    GuideConfig { adjust_dwell_s: 1e9, progress_m: None, ..plain() }
}

#[test]
fn off_path_after_its_dwell_then_again() {
    let mut hand = Hand::new(&[[0., 0., 0.], [3., 1.2, 0.], [90., 1.2, 0.]], stern());
    // Along the way, then 1.8 m to its right and on in parallel.
    hand.heading = 0.38;
    hand.go(3.2, 1.0);
    hand.heading = 0.0;
    hand.go(3.0, 1.0);
    hand.y -= 1.8;
    let left_at = hand.t;
    hand.go(20.0, 1.0);
    let off = hand.find("Off the path");
    assert!((off[0].0 - left_at - 2.0).abs() < 0.2, "first after {} s", off[0].0 - left_at);
    assert!((off[1].0 - off[0].0 - 5.0).abs() < 0.2, "again after {} s", off[1].0 - off[0].0);
    let words = &hand.heard().iter().find(|h| h.2.contains("Off")).unwrap().2.clone();
    assert!(words.starts_with("Off the path. Bear left, it is 2 metres away."), "{words}");
}

#[test]
fn off_path_before_the_first_waypoint_is_repeated_after_ten_seconds() {
    let mut hand = Hand::bent(stern());
    hand.go(2.0, 0.5);
    hand.y = -1.8;
    hand.go(11.0, 0.5);
    let off = hand.find("Off the path");
    assert!((off[1].0 - off[0].0 - 10.0).abs() < 0.2, "{off:?}");
}

#[test]
fn off_path_has_hysteresis_and_a_short_excursion_is_forgiven() {
    let mut hand = Hand::bent(stern());
    hand.go(2.0, 0.5);
    hand.y = 1.8;
    hand.go(0.8, 0.5);
    hand.y = 0.5;
    hand.go(1.0, 0.5);
    assert!(hand.find("Off").is_empty(), "an excursion of 1.6 s");
    hand.y = 1.8;
    hand.go(1.5, 0.5);
    assert_eq!(hand.find("Off").len(), 1);
    hand.y = 1.4;
    hand.go(0.5, 0.5);
    assert_eq!(hand.count(|k| *k == CueKind::BackOnPath), 0, "1.4 m is not back yet");
    hand.y = 1.1;
    hand.go(0.5, 0.5);
    assert_eq!(hand.count(|k| *k == CueKind::BackOnPath), 1);
}

#[test]
fn wrong_way_after_two_metres() {
    let mut hand = Hand::bent(plain());
    hand.go(12.0, 1.0);
    hand.heading = std::f64::consts::PI;
    let from = hand.x;
    hand.go(4.0, 1.0);
    let at = hand.find("Wrong way")[0].1;
    assert!((from - at - 2.0).abs() < 0.2, "after {} m", from - at);
    assert!(hand.words().iter().any(|w| w == "Wrong way. Turn around."));
}

#[test]
fn standing_is_reassured_once_and_once_more() {
    let mut hand = Hand::bent(plain());
    hand.go(3.0, 1.0).resolve(60.0);
    let told = hand.find("You are on the path. Continue 25 metres, then turn left.");
    assert_eq!(told.len(), 2, "{:#?}", hand.heard());
    assert!((told[1].0 - told[0].0 - 15.0).abs() < 0.2);
    assert!((told[0].0 - 9.0).abs() < 1.0, "{}", told[0].0);
}

#[test]
fn who_is_held_up_beside_the_path_is_led_straight_back() {
    let mut hand = Hand::bent(stern());
    hand.go(5.0, 1.0);
    // 2.2 m to the left and pointing at the way ahead: a corner between the two.
    (hand.y, hand.heading) = (2.2, -0.46);
    hand.resolve(60.0);
    let turns: Vec<f64> = hand
        .cues
        .iter()
        .filter_map(|(_, _, c)| match c.kind {
            CueKind::Rotate(turn) => Some((hand.heading + turn).to_degrees()),
            _ => None,
        })
        .collect();
    assert!(turns.iter().any(|led| (led + 90.0).abs() < 5.0), "{turns:?} {:#?}", hand.heard());
}

#[test]
fn stairs_are_announced_three_metres_ahead() {
    let mut hand = Hand::new(&[[0., 0., 0.], [20., 0., 0.], [24., 0., 2.5], [40., 0., 2.5]], plain());
    hand.go(19.9, 0.8);
    let near = hand.find("In 3 metres, go upstairs.");
    assert!((20.0 - near[0].1 - 3.0).abs() < 0.2, "{:#?}", hand.heard());
    assert_eq!(hand.find("Stairs now, go upstairs.").len(), 1);
    let turn = Hand::new(&[[0., 0., 0.], [20., 0., 0.], [20., 4., -2.5], [20., 9., -2.5]], plain());
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
fn lost_tracking_stops_at_once_and_repeats_with_the_reason() {
    let mut hand = Hand::bent(plain());
    hand.go(5.0, 1.0);
    hand.confidence = Confidence::Lost;
    let lost_at = hand.t;
    hand.resolve(10.0);
    let stops = hand.find("Stop. Tracking is lost.");
    assert!(stops[0].0 - lost_at < 0.11);
    assert_eq!(stops.len(), 4, "each 3 s: {stops:?}");
    assert_eq!(hand.cues.last().unwrap().2.priority(), Priority::Urgent);
    hand.confidence = Confidence::Good;
    hand.resolve(2.0);
    assert_eq!(hand.words().last().unwrap(), "Tracking is back. Continue 25 metres, then turn left.");
}

#[test]
fn who_stays_lost_is_asked_to_look_round() {
    let mut hand = Hand::bent(plain());
    hand.go(5.0, 1.0);
    hand.confidence = Confidence::Lost;
    hand.resolve(40.0);
    let look = hand.find("Tracking is lost. Turn slightly left.");
    assert_eq!(look.len(), 5, "each 6 s after four stops: {:?}", hand.heard());
    assert_eq!(hand.find("Stop. Tracking is lost.").len(), 4);
}

#[test]
fn a_stale_pose_stops_and_nothing_is_said_from_it() {
    let mut hand = Hand::bent(plain());
    hand.go(5.0, 1.0);
    hand.stale = true;
    let since = hand.t;
    hand.go(8.0, 1.0);
    let after: Vec<_> = hand.heard().into_iter().filter(|h| h.0 > since).collect();
    assert!((after[0].0 - since - 0.5).abs() < 0.11, "{after:?}");
    assert!(after.iter().all(|h| h.2 == "Stop. The camera does not answer."), "{after:?}");
    assert_eq!(hand.guide.state(), GuideState::Stopped(StopReason::PoseStale));
}

#[test]
fn hazards_of_others_stop_and_a_new_reason_is_told_at_once() {
    let mut hand = Hand::bent(plain());
    hand.go(2.0, 1.0);
    hand.hazard = Some(StopReason::Obstacle);
    hand.resolve(1.0);
    hand.hazard = Some(StopReason::UnknownGround);
    hand.resolve(1.0);
    assert_eq!(
        &hand.words()[1..],
        ["Stop. Something is in the way.", "Stop. The ground ahead is not known."]
    );
}

#[test]
fn flickering_confidence_does_not_send_anyone_on() {
    let mut hand = Hand::bent(plain());
    hand.go(2.0, 1.0);
    for _ in 0..20 {
        hand.confidence = Confidence::Lost;
        hand.resolve(0.3);
        hand.confidence = Confidence::Good;
        hand.resolve(0.3);
    }
    assert!(hand.find("Tracking is back").is_empty());
}

#[test]
fn numbers_that_are_not_finite_stop() {
    let mut hand = Hand::bent(plain());
    hand.go(2.0, 1.0);
    hand.x = f64::NAN;
    hand.resolve(1.0);
    assert_eq!(hand.words().last().unwrap(), "Stop. Tracking is lost.");
}

#[test]
fn a_bridged_stretch_is_told_once() {
    let mut hand = Hand::bent(plain());
    hand.go(2.0, 1.0);
    hand.confidence = Confidence::Low;
    hand.go(5.0, 1.0);
    assert_eq!(hand.find("Tracking is weak").len(), 1);
}

#[test]
fn a_corrected_route_keeps_the_walker_where_he_is_on_it() {
    let mut hand = Hand::bent(plain());
    hand.go(28.0, 1.0).turn(90.0, 45.0);
    hand.heading = std::f64::consts::FRAC_PI_2;
    hand.go(2.0, 1.0);
    // The map moved by a metre and turned a little; the walker's odom with it, except for the metre.
    let moved: Vec<Vec3> =
        [[0.5, -1.0, 0.], [29.5, 0.3, 0.], [29.2, 20.3, 0.]].iter().map(|p| Vec3::from(*p)).collect();
    let before = hand.words().len();
    hand.guide
        .correct_route(ManeuverPlan::new(&moved, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap());
    hand.go(3.0, 1.0);
    let after = &hand.words()[before..];
    assert!(!after.iter().any(|w| w.contains("Turn left")), "the turn was told again: {after:?}");
    assert!(hand.guide.place().unwrap().along_m > 30.0);
}

#[test]
fn backwards_has_legs_and_a_speed_limit() {
    let config = GuideConfig { facing: Facing::Backwards, ..plain() };
    let mut hand = Hand::new(&[[0., 0., 0.], [40., 0., 0.]], config);
    // Facing west, going east.
    hand.heading = std::f64::consts::PI;
    hand.go(-13.0, -0.4).resolve(4.0);
    hand.go(-5.0, -0.8);
    let words = hand.words();
    assert!(words[0].contains("Caution, you will move backwards"), "{words:?}");
    let check = hand.find("Stop. Check behind you.");
    assert!((check[0].1 - 12.0).abs() < 0.3, "{check:?}");
    assert!(words.contains(&"Move back 25 metres to the end.".to_owned()), "{words:?}");
    assert!(words.contains(&"Slow down.".to_owned()), "{words:?}");
}

#[test]
fn backwards_a_step_aside_leads_to_the_line_or_is_not_asked_for() {
    let config = GuideConfig { facing: Facing::Backwards, ..plain() };
    let mut hand = Hand::new(&[[0., 0., 0.], [9., 0., 0.]], config);
    // Facing west, going east, north of the line: it lies to the walker's own left.
    hand.heading = std::f64::consts::PI;
    hand.go(-3.0, -0.4);
    hand.y = 0.7;
    hand.go(-0.4, -0.4).resolve(6.0);
    let sides =
        |hand: &Hand| hand.words().into_iter().filter(|w| w.contains("Step back")).collect::<Vec<_>>();
    assert_eq!(sides(&hand)[0], "Stop. Step back and to your left.");
    // Standing across, a step to the left hardly leads there: a turn does.
    let mut hand = Hand::new(&[[0., 0., 0.], [9., 0., 0.]], config);
    hand.heading = std::f64::consts::PI;
    hand.go(-3.0, -0.4);
    hand.y = 0.7;
    hand.heading = (180.0 + 28.0_f64).to_radians();
    hand.go(-0.4, -0.4).resolve(6.0);
    assert!(sides(&hand).is_empty() && !hand.find("otate ").is_empty(), "{:?}", hand.words());
    // Beyond the end the line is not beside him.
    let mut hand = Hand::new(&[[0., 0., 0.], [9., 0., 0.]], config);
    hand.heading = std::f64::consts::PI;
    hand.go(-7.0, -0.4);
    (hand.x, hand.y) = (9.6, 1.3);
    hand.go(-0.2, -0.4).resolve(9.0);
    assert!(sides(&hand).is_empty(), "{:?}", hand.words());
}

#[test]
fn a_turn_right_ahead_is_the_first_thing_after_a_stop() {
    let mut hand = Hand::bent(plain());
    hand.go(26.0, 1.0);
    hand.confidence = Confidence::Lost;
    hand.go(3.3, 1.0);
    hand.confidence = Confidence::Good;
    hand.resolve(2.0);
    assert!(hand.words().iter().any(|w| w == "Tracking is back. Turn left."), "{:?}", hand.words());
}

#[test]
fn without_scale_no_distance_is_said() {
    let phrases = PhraseConfig { metric: false, ..PhraseConfig::default() };
    let mut hand = Hand::bent(plain());
    hand.go(29.0, 1.0).resolve(1.0).turn(90.0, 40.0).go(8.0, 1.0);
    hand.y += 2.0;
    hand.confidence = Confidence::Lost;
    hand.resolve(1.0);
    for (_, _, cue) in &hand.cues {
        if let Some(words) = phrases.words(cue) {
            assert!(!words.chars().any(|c| c.is_ascii_digit()), "{words}");
            assert!(!words.contains("metre"), "{words}");
        }
    }
}
