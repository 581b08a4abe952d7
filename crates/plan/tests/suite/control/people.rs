//! People in the way: let pass, waited for, gone around, and at last given up.

use super::halls::{body, costs, hall, navigator, two_rooms};
use cairn_geometry::Vec2;
use cairn_plan::control::{Navigator, NavigatorConfig, Reason, State};
use cairn_plan::costmap::{Detection, DynamicConfig, DynamicLayer};

/// Detections of people at one time.
fn people(layer: &mut DynamicLayer, time_s: f64, at: &[Vec2]) {
    let seen: Vec<Detection> = at.iter().map(|&position| Detection { position, radius_m: 0.3 }).collect();
    layer.observe(time_s, &seen);
}

#[test]
fn someone_who_crosses_is_let_pass() {
    let costs = costs(hall(12.0, 5.0, &[]));
    let mut layer = DynamicLayer::new(DynamicConfig::default());
    let at = |t: f64| Vec2::new(6.0, 0.6 + 0.8 * (t - 3.0));
    let (mut body, mut nearest) = (body(1.0, 2.5, 0.0, 5), f64::INFINITY);
    let mut navigator = navigator();
    navigator.set_goal(Vec2::new(11.0, 2.5));
    let (mut time_s, mut slowest) = (0.0, 1.0f64);
    while navigator.state() != State::Reached {
        let person = (3.0..8.4).contains(&time_s).then(|| at(time_s));
        people(&mut layer, time_s, person.as_slice());
        let step = navigator.step(time_s, &body.odometry, body.motion, &costs, Some(&layer));
        body.go(step.motion, 0.05, |truth| {
            if let Some(person) = person {
                nearest = f64::min(nearest, (truth.translation - person).norm() - 0.5);
            }
        });
        time_s += 0.05;
        slowest = if (3.0..8.0).contains(&time_s) { slowest.min(body.motion.linear) } else { slowest };
        assert!(time_s < 40.0 && navigator.state() != State::NoPath, "{step:?}");
    }
    assert!(nearest > 0.05, "{nearest} m from the person");
    assert!(slowest < 0.6, "it slowed down for the person: {slowest} m/s");
}

#[test]
fn someone_who_stays_in_the_door_is_gone_around() {
    let costs = costs(two_rooms());
    let mut layer = DynamicLayer::new(DynamicConfig::default());
    let person = Vec2::new(6.0, 2.0);
    let mut body = body(1.0, 1.5, 0.0, 6);
    let mut navigator = navigator();
    navigator.set_goal(Vec2::new(11.0, 1.5));
    let (mut time_s, mut reasons, mut through) = (0.0, Vec::new(), 0.0);
    while navigator.state() != State::Reached {
        people(&mut layer, time_s, &[person]);
        let step = navigator.step(time_s, &body.odometry, body.motion, &costs, Some(&layer));
        if let Some(reason) = step.reason {
            let name = reason.to_string();
            if reasons.last() != Some(&name) {
                reasons.push(name);
            }
        }
        body.go(step.motion, 0.05, |truth| {
            let gap = (truth.translation - person).norm() - 0.5;
            assert!(gap > 0.05, "{gap} m from the person");
            if (truth.translation.x - 6.0).abs() < 0.1 {
                through = truth.translation.y;
            }
        });
        time_s += 0.05;
        assert!(time_s < 90.0 && navigator.state() != State::NoPath, "{step:?} {reasons:?}");
    }
    assert!(through > 7.0, "through the other door: y = {through}");
    for word in ["a new goal", "that moves", "turning", "backing up", "around"] {
        assert!(reasons.iter().any(|r| r.contains(word)), "{word} is missing in {reasons:?}");
    }
}

/// Someone stops in a door before the body for 3 s and then goes back: the body neither backs up before him nor drives
/// through the other door.
#[test]
fn someone_who_stops_in_the_door_and_leaves_is_waited_for() {
    let costs = costs(two_rooms());
    let mut layer = DynamicLayer::new(DynamicConfig::default());
    let mut body = body(1.0, 1.5, 0.0, 6);
    let mut navigator = navigator();
    navigator.set_goal(Vec2::new(11.0, 1.5));
    let (mut time_s, mut met_s, mut through, mut least) = (0.0, None, 0.0, 0.0f64);
    while navigator.state() != State::Reached {
        let left_s = met_s.map_or(0.0, |met_s: f64| (time_s - met_s - 3.0).max(0.0));
        let person = Vec2::new(6.0, 2.0) + Vec2::new(0.3, 0.7) * left_s;
        people(&mut layer, time_s, if left_s < 3.0 { std::slice::from_ref(&person) } else { &[] });
        let step = navigator.step(time_s, &body.odometry, body.motion, &costs, Some(&layer));
        if step.state == State::Blocked {
            met_s = met_s.or(Some(time_s));
        }
        least = least.min(step.motion.linear);
        body.go(step.motion, 0.05, |truth| {
            if (truth.translation.x - 6.0).abs() < 0.1 {
                through = truth.translation.y;
            }
        });
        time_s += 0.05;
        assert!(time_s < 30.0 && navigator.state() != State::NoPath, "{step:?}");
    }
    assert!(met_s.is_some(), "nobody was met");
    assert!((1.5..2.5).contains(&through), "through the door: y = {through}");
    assert!(least > -1e-6, "backed up: {least} m/s");
}

/// Someone steps to and fro before the body, which creeps up to him each time: it does not wait anew for ever.
#[test]
fn someone_who_steps_to_and_fro_uses_up_the_patience() {
    let costs = costs(hall(12.0, 1.4, &[]));
    let seconds_before_giving_up = |patience_s: f64| {
        let mut layer = DynamicLayer::new(DynamicConfig::default());
        let mut body = body(1.0, 0.7, 0.0, 6);
        let config = NavigatorConfig { patience_s, ..*navigator().config() };
        let mut navigator = Navigator::new(config);
        navigator.set_goal(Vec2::new(11.0, 0.7));
        let (mut time_s, mut met_s) = (0.0, None);
        while time_s < 60.0 {
            // He steps back for a second, and comes again as near as people do.
            let away_m = if time_s % 3.5 > 2.5 { 0.4 } else { 0.0 };
            let near_m = (body.truth.translation.x + 0.9).min(5.4);
            let person = Vec2::new(f64::max(5.0 + away_m, near_m), 0.7);
            people(&mut layer, time_s, &[person]);
            let step = navigator.step(time_s, &body.odometry, body.motion, &costs, Some(&layer));
            if step.state == State::Blocked {
                met_s = met_s.or(Some(time_s));
            }
            if step.state == State::NoPath {
                assert!(matches!(step.reason, Some(Reason::GivenUp(_))), "{step:?}");
                return time_s - met_s.unwrap();
            }
            body.go(step.motion, 0.05, |_| ());
            time_s += 0.05;
        }
        f64::INFINITY
    };
    let (short_s, long_s) = (seconds_before_giving_up(8.0), seconds_before_giving_up(60.0));
    assert!(short_s < 10.0 && long_s > 20.0, "{short_s} and {long_s} s");
}

/// Someone stays in the way: the body waits for him, then backs up once in each round of recovery. After each round that is allowed it plans again; the
/// round after the last one ends in giving up.
#[test]
fn recovery_has_as_many_rounds_as_are_allowed() {
    let costs = costs(hall(12.0, 1.4, &[]));
    for rounds in [1, 2] {
        let mut layer = DynamicLayer::new(DynamicConfig::default());
        let mut body = body(1.0, 0.7, 0.0, 6);
        let config = NavigatorConfig { attempts: rounds, patience_s: 60.0, ..*navigator().config() };
        let mut navigator = Navigator::new(config);
        navigator.set_goal(Vec2::new(11.0, 0.7));
        let person = Vec2::new(5.0, 0.7);
        let (mut time_s, mut met_s, mut backed, mut backs) = (0.0, None, 0, false);
        let mut first_s = None;
        let last = loop {
            people(&mut layer, time_s, &[person]);
            let step = navigator.step(time_s, &body.odometry, body.motion, &costs, Some(&layer));
            if step.state == State::Blocked {
                met_s = met_s.or(Some(time_s));
            }
            if step.motion.linear < -0.01 && !backs {
                backed += 1;
                first_s = first_s.or(Some(time_s));
            }
            backs = step.motion.linear < -0.01;
            let before = body.truth.translation.x;
            body.go(step.motion, 0.05, |truth| {
                assert!((truth.translation - person).norm() > 0.4, "touched: {}", truth.translation);
            });
            assert!(before - body.truth.translation.x < 0.05, "faster backwards than it may");
            time_s += 0.05;
            assert!(time_s < 120.0, "{step:?}");
            if matches!(step.state, State::NoPath | State::Reached) {
                break step;
            }
        };
        assert_eq!(last.reason, Some(Reason::GivenUp(rounds)));
        assert_eq!(backed, rounds + 1, "times backed up");
        let waited_s = first_s.unwrap() - met_s.unwrap();
        assert!(waited_s >= config.passing_s, "backed up after {waited_s} s");
    }
}

/// The way through the other door takes longer than has been waited: the body still waits at its own. Once it has waited as
/// long, it goes round.
#[test]
fn a_way_around_is_taken_when_waiting_has_taken_as_long() {
    let costs = costs(two_rooms());
    let mut layer = DynamicLayer::new(DynamicConfig::default());
    let mut body = body(1.0, 1.5, 0.0, 6);
    let mut navigator = navigator();
    navigator.set_goal(Vec2::new(11.0, 1.5));
    let (mut time_s, mut met_s, mut round_s) = (0.0, None, None);
    while round_s.is_none() {
        people(&mut layer, time_s, &[Vec2::new(6.0, 2.0)]);
        let step = navigator.step(time_s, &body.odometry, body.motion, &costs, Some(&layer));
        if step.state == State::Blocked {
            met_s = met_s.or(Some(time_s));
        }
        let leads_round = navigator.path().is_some_and(|p| p.points().iter().any(|at| at.y > 7.0));
        round_s = leads_round.then_some(time_s);
        body.go(step.motion, 0.05, |_| ());
        time_s += 0.05;
        assert!(time_s < 60.0 && navigator.state() != State::NoPath, "{step:?}");
    }
    let waited_s = round_s.unwrap() - met_s.unwrap();
    let path = navigator.path().unwrap();
    let longer_m = path.length_m() - (Vec2::new(11.0, 1.5) - path.at(0.0).0).norm();
    let longer_s = longer_m / navigator.config().pursuit.limits.linear;
    assert!(longer_s > 5.0 && waited_s > 0.9 * longer_s, "{longer_s} s longer, after {waited_s} s");
}
