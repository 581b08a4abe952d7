//! Maps that change, walls that are near, goals and poses that are no use.

use super::halls::{body, costs, hall, navigator, two_rooms};
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::{
    Limits, LimitsError, Navigator, NavigatorConfig, PursuitConfig, Reason, State, Twist,
};
use cairn_plan::search::{NoPath, Place};
use cairn_plan::{Cell, CostConfig, Costmap};

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
    assert_eq!(navigator.step(0.0, &at, Twist::stop(), &costs, None).state, State::Idle);
    let wall = costs.frame().cell_at(Vec2::new(6.0, 5.0)).unwrap();
    for (goal, reason) in [
        (Vec2::new(f64::NAN, 1.0), NoPath::NotFinite(Place::Goal)),
        (Vec2::new(50.0, 1.0), NoPath::Outside(Place::Goal)),
        (Vec2::new(6.0, 5.0), NoPath::Blocked { place: Place::Goal, cell: wall }),
    ] {
        navigator.set_goal(goal);
        let step = navigator.step(0.0, &at, Twist::stop(), &costs, None);
        assert_eq!((step.state, step.reason), (State::NoPath, Some(Reason::NoPath(reason))));
        assert_eq!(step.motion, Twist::stop());
    }
    // The start is inside a wall.
    navigator.set_goal(Vec2::new(11.0, 1.5));
    let in_wall = Se2::from_xy_angle(6.0, 5.0, 0.0);
    let step = navigator.step(0.0, &in_wall, Twist::stop(), &costs, None);
    let blocked = NoPath::Blocked { place: Place::Start, cell: wall };
    assert_eq!((step.state, step.reason), (State::NoPath, Some(Reason::NoPath(blocked))));
    // The pose is not finite while driving: the body slows down, and continues when the pose is valid again.
    navigator.set_goal(Vec2::new(11.0, 1.5));
    navigator.step(0.0, &at, Twist::stop(), &costs, None);
    let moving = Twist::new(0.5, 0.0);
    let step = navigator.step(0.1, &Se2::from_xy_angle(f64::NAN, 0.0, 0.0), moving, &costs, None);
    assert!(step.reason == Some(Reason::PoseInvalid) && step.motion.linear < 0.5);
    assert_eq!(navigator.step(0.2, &at, moving, &costs, None).state, State::Executing);
    // A loop closure: the body is elsewhere, so the old path is dropped.
    let elsewhere = Se2::from_xy_angle(2.0, 3.0, 0.0);
    let step = navigator.step(0.3, &elsewhere, moving, &costs, None);
    assert!(matches!(step.reason, Some(Reason::PoseJumped(m)) if (m - 1.8).abs() < 0.1), "{step:?}");
    assert!((navigator.path().unwrap().at(0.0).0 - elsewhere.translation).norm() < 1e-9);
    // The wheels say nothing of use: it stops as if it had stood.
    for unknown in [Twist::new(f64::NAN, 0.0), Twist::new(0.5, f64::INFINITY)] {
        let step = navigator.step(0.35, &elsewhere, unknown, &costs, None);
        assert_eq!((step.reason, step.motion), (Some(Reason::MotionInvalid), Twist::stop()));
    }
    navigator.cancel();
    assert_eq!(navigator.step(0.4, &elsewhere, moving, &costs, None).state, State::Idle);
    // A body whose limits are no numbers does not move, and is told why.
    for linear in [f64::NAN, -1.0, 0.0] {
        let limits = Limits { linear, ..Limits::differential_drive() };
        let mut navigator = Navigator::new(NavigatorConfig::new(PursuitConfig::new(limits)));
        navigator.set_goal(Vec2::new(11.0, 1.5));
        for k in 0..3 {
            let step = navigator.step(0.1 * f64::from(k), &at, moving, &costs, None);
            assert_eq!((step.reason, step.motion), (Some(Reason::LimitsInvalid(LimitsError)), Twist::stop()));
        }
    }
}
