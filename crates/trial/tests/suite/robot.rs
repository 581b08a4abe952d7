//! The robot's trial: the judge, the household, and a drive of the first seconds judged by the truth.

use cairn_engine::Host;
use cairn_geometry::Vec2;
use cairn_trial::robot::{Household, Judge, RobotConfig, Touched, Trial};

fn config(seed: u64) -> RobotConfig {
    let mut config = RobotConfig::new(seed);
    config.sim.options.detail = 0.1;
    config
}

#[test]
fn the_judge_counts_each_touch_once_and_tells_what_was_touched() {
    let household = Household::new(&RobotConfig { people: 0, ..config(3) });
    let start = household.start().translation;
    let mut judge = Judge::new(0.2);
    let to_wall = household.to_wall_m(start);
    assert!(to_wall > 0.6, "{to_wall} m");
    // Sideways into the wall of the corridor, along it, and back.
    let wall = |share: f64| start + Vec2::new(0.0, share);
    for k in 0..100 {
        judge.see(f64::from(k), wall(-0.01 * f64::from(k)), 0.1, &household);
    }
    for k in 0..100 {
        judge.see(100.0 + f64::from(k), wall(-0.99 + 0.01 * f64::from(k)), 0.1, &household);
    }
    assert_eq!(judge.collisions.len(), 1, "{:?}", judge.collisions);
    assert_eq!(judge.collisions[0].with, Touched::Wall);
    assert!(judge.wall_clearance_m < 0.0 && (judge.driven_m - 1.98).abs() < 0.02, "{}", judge.driven_m);
}

#[test]
fn people_walk_stop_for_a_robot_and_turn_back() {
    let mut household = Household::new(&config(3));
    let far = Vec2::new(-100.0, 0.0);
    let place = |h: &Household| h.figures()[0].at;
    let before = place(&household);
    for _ in 0..10 {
        household.step(0.1, far);
    }
    let after = place(&household);
    assert!(
        (0.4..1.0).contains(&(after - before).norm()),
        "a second of walking: {}",
        (after - before).norm()
    );
    // A robot stands 0.6 m ahead.
    let ahead = (after - before).normalize();
    let robot = after + ahead * 0.6;
    for _ in 0..25 {
        household.step(0.1, robot);
    }
    assert_eq!(place(&household), after, "waits");
    for _ in 0..15 {
        household.step(0.1, robot);
    }
    assert!((place(&household) - after).dot(&ahead) < -0.1, "turns back");
}

#[test]
fn a_door_closes_only_where_nobody_stands() {
    let mut household = Household::new(&RobotConfig { people: 0, ..config(3) });
    let (a, b) = household.world().doors()[0];
    let middle = (a + b) / 2.0;
    assert!(!household.close_door(middle));
    assert!(household.to_wall_m(middle) > 0.4);
    assert!(household.close_door(middle + Vec2::new(0.0, -1.5)));
    assert_eq!(household.to_wall_m(middle), 0.0);
}

/// Occupied cells lie at true walls, and what is called free is.
#[test]
fn the_first_seconds_give_a_true_map_without_a_touch() {
    let mut config = RobotConfig::new(1);
    (config.explore_s, config.goal_s) = (40.0, 2.0);
    let end = Trial::new(config, &Host::bare()).unwrap().run(|_| ()).unwrap();
    assert!(end.collisions.is_empty(), "{:?}", end.collisions);
    assert!(end.known > 0.25 && end.driven_m > 5.0, "{} known, {} m driven", end.known, end.driven_m);
    assert!(end.position_error_m[0] < 0.06, "{:?} m", end.position_error_m);
    let map = end.map.unwrap();
    let (mut at_walls, mut occupied, mut in_walls, mut free) = (0, 0, 0, 0);
    for (i, value) in map.values().iter().enumerate() {
        let at = map.frame().centre(map.frame().cell(i));
        let to_wall = end
            .world
            .plan()
            .iter()
            .map(|(a, b)| {
                let along = ((at - a).dot(&(b - a)) / (b - a).norm_squared().max(1e-12)).clamp(0.0, 1.0);
                (at - a - (b - a) * along).norm()
            })
            .fold(f64::INFINITY, f64::min);
        match value {
            100 => {
                occupied += 1;
                at_walls += usize::from(to_wall < 0.15);
            }
            0 => {
                free += 1;
                // Footprints are rectangles; what stands on legs or hangs over is not everywhere so deep.
                in_walls += usize::from(!end.world.is_free(at.x, at.y) && to_wall > 0.15);
            }
            _ => {}
        }
    }
    assert!(occupied > 200 && at_walls * 100 >= occupied * 93, "{at_walls} of {occupied} at walls");
    assert!(free > 2000 && in_walls * 100 <= free, "{in_walls} of {free} free cells lie in obstacles");
    // No time for any goal: each says why.
    assert!(end.goals.iter().all(|g| !g.reached && g.reason.is_some()), "{:?}", end.goals);
}
