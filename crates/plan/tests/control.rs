//! Simulated drives through halls: the body stays on its path, touches nothing, and gives a reason when it cannot go
//! on.

use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::trial::{SimulatedBody, drive};
use cairn_plan::control::{
    Limits, Motion, Mppi, MppiConfig, Navigator, NavigatorConfig, PursuitConfig, Reason, ReferencePath,
    State, Surroundings, moved,
};
use cairn_plan::costmap::{Detection, DynamicConfig, DynamicLayer};
use cairn_plan::search::{AStar, NoPath, Place};
use cairn_plan::smooth::{SmoothConfig, clearance_of, smooth};
use cairn_plan::{Cell, CostConfig, Costmap, Grid, GridFrame};
use cairn_random::Random;

fn navigator() -> Navigator {
    Navigator::new(NavigatorConfig::new(PursuitConfig::new(Limits::differential_drive())))
}

fn body(x: f64, y: f64, heading: f64, seed: u64) -> SimulatedBody {
    SimulatedBody::new(Se2::from_xy_angle(x, y, heading), Limits::differential_drive(), 0.05, 0.02, 1.0, seed)
}

/// A hall of `w` x `h` metres in cells of 5 cm, with walls around it and boxes (metres: from x, y to x, y) in it.
fn hall(w: f64, h: f64, boxes: &[[f64; 4]]) -> Grid<i8> {
    let frame = GridFrame::new((w * 20.0) as usize, (h * 20.0) as usize, 0.05, Se2::identity()).unwrap();
    let mut map = Grid::filled(frame, 0i8);
    for i in 0..frame.len() {
        let p = frame.centre(frame.cell(i));
        let rim = p.x < 0.1 || p.y < 0.1 || p.x > w - 0.1 || p.y > h - 0.1;
        let inside = |b: &[f64; 4]| p.x > b[0] && p.y > b[1] && p.x < b[2] && p.y < b[3];
        if rim || boxes.iter().any(inside) {
            map.values_mut()[i] = 100;
        }
    }
    map
}

/// Two rooms joined by two doors of 1 m: one at y = 2, one at y = 8.
fn two_rooms() -> Grid<i8> {
    hall(12.0, 10.0, &[[5.9, 0.0, 6.1, 1.5], [5.9, 2.5, 6.1, 7.5], [5.9, 8.5, 6.1, 10.0]])
}

fn costs(map: Grid<i8>) -> Costmap {
    Costmap::new(map, CostConfig::default()).unwrap()
}

#[test]
fn random_routes_are_kept_to_and_touch_nothing() {
    let mut random = Random::new(41);
    let predictive = Some(MppiConfig::new(Limits::differential_drive()));
    let config = *navigator().config();
    let mut navigators = [navigator(), Navigator::new(NavigatorConfig { predictive, ..config })];
    let mut routes = 0;
    while routes < 25 {
        let boxes: Vec<[f64; 4]> = (0..25)
            .map(|_| {
                let (x, y) = (random.uniform(0.0, 19.0), random.uniform(0.0, 14.0));
                [x, y, x + random.uniform(0.2, 2.0), y + random.uniform(0.2, 2.0)]
            })
            .collect();
        let costs = costs(hall(20.0, 15.0, &boxes));
        let passable = costs.passable();
        let mut some = || Vec2::new(random.uniform(1.0, 19.0), random.uniform(1.0, 14.0));
        let (start, goal) = (some(), some());
        let cell = |p| costs.frame().cell_at(p).unwrap();
        if !AStar::new().search(&passable, cell(start), cell(goal)).is_ok_and(|p| p.length > 100.0) {
            continue;
        }
        for navigator in &mut navigators {
            let mut body = body(start.x, start.y, 1.0, routes);
            let drive = drive(navigator, &mut body, goal, &costs, |_| None, 120.0);
            assert_eq!(drive.state, State::Reached, "{drive:?}");
            assert!(
                drive.lateral_rms_m <= 0.05 && drive.clearance_m > 0.0 && drive.to_goal_m < 0.15,
                "{drive:?}"
            );
            assert!(drive.reversals <= 3 && drive.plans == 1, "{drive:?}");
        }
        routes += 1;
    }
}

#[test]
fn someone_on_foot_is_led_at_walking_pace() {
    let costs = costs(two_rooms());
    let limits = Limits::walking_pace();
    let mut navigator = Navigator::new(NavigatorConfig::new(PursuitConfig::new(limits)));
    let start = Se2::from_xy_angle(1.0, 8.0, 2.0);
    let mut body = SimulatedBody::new(start, limits, 0.3, 0.05, 1.0, 9);
    let mut config = *navigator.config();
    config.pursuit.delay_s = 0.3;
    navigator = Navigator::new(config);
    let drive = drive(&mut navigator, &mut body, Vec2::new(11.0, 1.0), &costs, |_| None, 120.0);
    assert_eq!(drive.state, State::Reached, "{drive:?}");
    assert!(drive.clearance_m > 0.0 && drive.lateral_rms_m < 0.1, "{drive:?}");
    assert!(drive.length_m / drive.seconds < 0.8, "{drive:?}");
}

#[test]
fn path_integral_control_keeps_to_a_path_too() {
    let costs = costs(two_rooms());
    let cells = AStar::new().search(&costs.passable(), Cell::new(30, 100), Cell::new(200, 20)).unwrap().cells;
    let path = ReferencePath::new(&smooth(costs.field(), &cells, &SmoothConfig::default()).points).unwrap();
    let (at, direction) = path.at(0.0);
    let mut body = body(at.x, at.y, direction.y.atan2(direction.x), 3);
    let mut mppi = Mppi::new(MppiConfig::new(Limits::differential_drive()));
    let radius_m = costs.config().touch_m(0.05);
    let around = Surroundings { field: costs.field(), moving: None, radius_m };
    let (mut least, mut sum, mut count, mut along_m, mut seconds) = (f64::INFINITY, 0.0, 0.0, 0.0, 0.0);
    loop {
        let step = mppi.step(&body.odometry, body.motion, &path, &around);
        if step.reached && body.motion.linear < 0.02 {
            break;
        }
        body.go(step.motion, 0.05, |truth| {
            least = costs.field().distance_to_square_m(truth.translation).min(least);
            let at = path.project(truth.translation, along_m - 0.3, along_m + 1.0);
            (along_m, sum, count) = (at.along_m, sum + at.lateral_m.powi(2), count + 1.0);
        });
        seconds += 0.05;
        assert!(seconds < 40.0, "not there: {step:?}");
    }
    let rms = f64::sqrt(sum / count);
    println!("{rms:.3} m RMS, {seconds:.1} s for {:.1} m, {:.3} m to walls", path.length_m(), least - 0.2);
    assert!(rms < 0.06 && least > 0.2, "{rms} m RMS, {least} m");
}

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

#[test]
fn a_door_that_closes_means_another_way_or_none() {
    for other_open in [true, false] {
        let mut costs = costs(two_rooms());
        let close = |costs: &mut Costmap, from: u32| {
            let cells: Vec<(Cell, i8)> =
                (0..80).map(|k| (Cell::new(118 + k % 4, from + k / 4), 100)).collect();
            assert!(costs.update(&cells) > 0);
        };
        if !other_open {
            close(&mut costs, 150);
        }
        let mut body = body(1.0, 1.5, 0.0, 7);
        let mut navigator = navigator();
        navigator.set_goal(Vec2::new(11.0, 1.5));
        let (mut time_s, mut replanned) = (0.0, None);
        let last = loop {
            if (time_s - 2.0f64).abs() < 0.01 {
                close(&mut costs, 30);
            }
            let step = navigator.step(time_s, &body.odometry, body.motion, &costs, None);
            replanned = replanned.or(step.reason.filter(|r| matches!(r, Reason::MapChanged(_))));
            body.go(step.motion, 0.05, |truth| {
                let clear = costs.field().distance_to_square_m(truth.translation) - 0.2;
                assert!(clear > 0.0, "touched: {clear} m");
            });
            time_s += 0.05;
            assert!(time_s < 60.0, "{step:?}");
            if matches!(step.state, State::Reached | State::NoPath) {
                break step;
            }
        };
        assert!(replanned.is_some(), "the changed map was not noticed");
        if other_open {
            assert_eq!(last.state, State::Reached);
        } else {
            assert!(matches!(last.reason, Some(Reason::NoPath(NoPath::Unreachable { .. }))), "{last:?}");
        }
    }
}

/// A map that was laid again shows walls nearer than the body's radius, in front of it or beside it: it drives away from them first.
#[test]
fn a_body_too_near_to_a_wall_drives_out_and_on() {
    for (x, y, heading, radius_m) in [
        (5.85, 5.0, 0.0, 0.2),
        (5.84, 5.0, 1.6, 0.2),
        (0.14, 0.14, -2.3, 0.2),
        (6.13, 3.0, 3.1, 0.2),
        (5.85, 5.0, 0.0, 0.4),
    ] {
        let costs = Costmap::new(two_rooms(), CostConfig { radius_m, ..CostConfig::default() }).unwrap();
        let mut body = body(x, y, heading, 11);
        let to_wall = |at: Vec2| costs.field().distance_m(costs.frame().cell_at(at).unwrap()).unwrap();
        let least = to_wall(Vec2::new(x, y));
        assert!(least < 0.15, "{least} m");
        let mut navigator = navigator();
        navigator.set_goal(if radius_m > 0.3 { Vec2::new(2.0, 7.0) } else { Vec2::new(11.0, 8.0) });
        let (mut time_s, mut plans) = (0.0, 0);
        while navigator.state() != State::Reached {
            let step = navigator.step(time_s, &body.odometry, body.motion, &costs, None);
            plans += usize::from(step.state == State::Planning);
            body.go(step.motion, 0.05, |truth| {
                assert!(
                    to_wall(truth.translation) > least - 1e-9,
                    "from ({x}, {y}): nearer to the wall at {truth:?}"
                );
            });
            time_s += 0.05;
            assert!(time_s < 60.0 && navigator.state() != State::NoPath, "from ({x}, {y}): {step:?}");
        }
        assert!(plans <= 2, "from ({x}, {y}): {plans} plans");
    }
}

#[test]
fn a_wall_that_comes_up_close_stops_the_body_in_time() {
    let mut costs = costs(hall(12.0, 3.0, &[]));
    let mut body = body(1.0, 1.5, 0.0, 8);
    let mut navigator = navigator();
    navigator.set_goal(Vec2::new(11.0, 1.5));
    let (mut time_s, mut seen) = (0.0, false);
    while time_s < 20.0 && navigator.state() != State::NoPath {
        if !seen && body.truth.translation.x > 4.0 {
            // 0.5 m of braking distance and the stop distance of 0.1 m are left.
            let at = ((body.truth.translation.x + 0.2 + 0.55) * 20.0) as u32;
            let cells: Vec<(Cell, i8)> = (0..60).map(|y| (Cell::new(at, y), 100)).collect();
            costs.update(&cells);
            assert!(body.motion.linear > 0.9, "{} m/s", body.motion.linear);
            seen = true;
        }
        let step = navigator.step(time_s, &body.odometry, body.motion, &costs, None);
        body.go(step.motion, 0.05, |truth| {
            let clear = costs.field().distance_to_square_m(truth.translation) - 0.2;
            assert!(clear > 0.0, "touched: {clear} m");
        });
        time_s += 0.05;
    }
    assert!(seen && navigator.state() == State::NoPath);
}

#[test]
fn bad_goals_and_poses_have_their_reasons() {
    let costs = costs(two_rooms());
    let at = Se2::from_xy_angle(1.0, 1.5, 0.0);
    let mut navigator = navigator();
    assert_eq!(navigator.step(0.0, &at, Motion::stop(), &costs, None).state, State::Idle);
    let wall = costs.frame().cell_at(Vec2::new(6.0, 5.0)).unwrap();
    for (goal, reason) in [
        (Vec2::new(f64::NAN, 1.0), NoPath::NotFinite(Place::Goal)),
        (Vec2::new(50.0, 1.0), NoPath::Outside(Place::Goal)),
        (Vec2::new(6.0, 5.0), NoPath::Blocked { place: Place::Goal, cell: wall }),
    ] {
        navigator.set_goal(goal);
        let step = navigator.step(0.0, &at, Motion::stop(), &costs, None);
        assert_eq!((step.state, step.reason), (State::NoPath, Some(Reason::NoPath(reason))));
        assert_eq!(step.motion, Motion::stop());
    }
    // The start is inside a wall.
    navigator.set_goal(Vec2::new(11.0, 1.5));
    let in_wall = Se2::from_xy_angle(6.0, 5.0, 0.0);
    let step = navigator.step(0.0, &in_wall, Motion::stop(), &costs, None);
    let blocked = NoPath::Blocked { place: Place::Start, cell: wall };
    assert_eq!((step.state, step.reason), (State::NoPath, Some(Reason::NoPath(blocked))));
    // The pose is not finite while driving: the body slows down, and continues when the pose is valid again.
    navigator.set_goal(Vec2::new(11.0, 1.5));
    navigator.step(0.0, &at, Motion::stop(), &costs, None);
    let moving = Motion::new(0.5, 0.0);
    let step = navigator.step(0.1, &Se2::from_xy_angle(f64::NAN, 0.0, 0.0), moving, &costs, None);
    assert!(step.reason == Some(Reason::PoseInvalid) && step.motion.linear < 0.5);
    assert_eq!(navigator.step(0.2, &at, moving, &costs, None).state, State::Executing);
    // A loop closure: the body is elsewhere, so the old path is dropped.
    let elsewhere = Se2::from_xy_angle(2.0, 3.0, 0.0);
    let step = navigator.step(0.3, &elsewhere, moving, &costs, None);
    assert!(matches!(step.reason, Some(Reason::PoseJumped(m)) if (m - 1.8).abs() < 0.1), "{step:?}");
    assert!((navigator.path().unwrap().at(0.0).0 - elsewhere.translation).norm() < 1e-9);
    navigator.cancel();
    assert_eq!(navigator.step(0.4, &elsewhere, moving, &costs, None).state, State::Idle);
}

#[test]
fn smoothing_shortens_and_keeps_the_clearance() {
    let mut random = Random::new(51);
    let mut shorter = 0;
    for _ in 0..40 {
        let boxes: Vec<[f64; 4]> = (0..20)
            .map(|_| {
                let (x, y) = (random.uniform(0.0, 14.0), random.uniform(0.0, 9.0));
                [x, y, x + random.uniform(0.1, 1.5), y + random.uniform(0.1, 1.5)]
            })
            .collect();
        let costs = costs(hall(15.0, 10.0, &boxes));
        let mut some =
            || costs.frame().cell_at(Vec2::new(random.uniform(0.5, 14.5), random.uniform(0.5, 9.5))).unwrap();
        let Ok(path) = AStar::new().search(&costs.passable(), some(), some()) else { continue };
        let config = SmoothConfig { radius_m: 0.285, clearance_m: 0.5, ..SmoothConfig::default() };
        let before = clearance_of(costs.field(), &path.points(costs.frame()));
        let after = smooth(costs.field(), &path.cells, &config);
        assert!(after.clearance_m >= before.min(0.285) - 1e-9, "{} m, before {before} m", after.clearance_m);
        assert_eq!(after.points.first(), path.points(costs.frame()).first());
        assert_eq!(after.points.last(), path.points(costs.frame()).last());
        shorter += usize::from(after.length_m < path.length_m(costs.frame()));
    }
    assert!(shorter > 20, "{shorter}");
}

#[test]
fn limits_are_kept_and_arcs_are_exact() {
    let limits = Limits::differential_drive();
    assert!(limits.check().is_ok() && Limits { linear: f64::NAN, ..limits }.check().is_err());
    assert!(Limits { deceleration: 0.0, ..limits }.check().is_err());
    let from = Motion::new(0.5, 0.0);
    let fast = limits.reachable(from, Motion::new(9.0, -9.0), 0.1);
    assert!((fast.linear - 0.6).abs() < 1e-12 && (fast.angular + 0.6).abs() < 1e-12);
    let stop = limits.reachable(from, Motion::new(f64::NAN, 1.0), 0.1);
    assert!((stop.linear - 0.35).abs() < 1e-12, "what is no number is to stop");
    // A quarter of a circle of radius 2.
    let quarter = moved(&Se2::identity(), Motion::new(1.0, 0.5), std::f64::consts::PI);
    assert!((quarter.translation - Vec2::new(2.0, 2.0)).norm() < 1e-12);
    let v = limits.speed_to_stop_within(0.5, 0.1);
    assert!((v * 0.1 + v * v / (2.0 * limits.deceleration) - 0.5).abs() < 1e-12);
}
