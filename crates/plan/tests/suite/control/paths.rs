//! Paths are smooth and kept to, by both followers.

use super::halls::{body, costs, hall, navigator, two_rooms};
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::trial::{SimulatedBody, drive};
use cairn_plan::control::{
    Limits, Mppi, MppiConfig, Navigator, NavigatorConfig, PursuitConfig, ReferencePath, State, Surroundings,
    Twist, moved,
};
use cairn_plan::search::AStar;
use cairn_plan::smooth::{SmoothConfig, clearance_of, smooth};
use cairn_plan::{Cell, DistanceField, Grid, GridFrame, Passable};
use cairn_random::Random;

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

/// Whatever the size of the cells, the radius and the spacing: the smoothed path comes no nearer to obstacles than the path over the grid,
/// or than the radius asked for.
#[test]
fn smoothing_keeps_the_clearance_at_any_spacing() {
    let mut random = Random::new(52);
    let (mut paths, mut narrow) = (0, 0);
    for _ in 0..400 {
        let resolution_m = [0.02, 0.05, 0.1, 1.0][random.below(4)];
        let (w, h) = (10 + random.below(70), 10 + random.below(60));
        let frame = GridFrame::new(w, h, resolution_m, Se2::from_xy_angle(-1.0, 2.0, 0.3)).unwrap();
        let density = [0.01, 0.05, 0.15, 0.3][random.below(4)];
        let field = DistanceField::new(&Grid::filled(frame, ()).map(|()| random.chance(density)));
        let reach_m = [0.0, 1.0, 2.0, 3.5][random.below(4)] * resolution_m;
        let passable = Passable::new(&field.at_least(reach_m));
        let mut some = || frame.cell(random.below(frame.len()));
        let Ok(path) = AStar::new().search(&passable, some(), some()) else { continue };
        let config = SmoothConfig {
            radius_m: reach_m,
            clearance_m: reach_m + [0.0, 3.0][random.below(2)] * resolution_m,
            spacing_m: [0.5, 2.0, 5.0, 12.0][random.below(4)] * resolution_m,
            rounds: [0, 1, 150][random.below(3)],
        };
        let points = path.points(&frame);
        let before = clearance_of(&field, &points);
        let after = smooth(&field, &path.cells, &config);
        let least = before.min(reach_m.max(resolution_m));
        assert!(after.clearance_m >= least - 1e-9, "{} of {least} m: {config:?}", after.clearance_m);
        assert_eq!(after.clearance_m, clearance_of(&field, &after.points));
        assert_eq!((after.points.first(), after.points.last()), (points.first(), points.last()));
        (paths, narrow) = (paths + 1, narrow + usize::from(before < 1.5 * resolution_m));
    }
    assert!(paths > 80 && narrow > 20, "{paths} paths, {narrow} of them narrow");
}

#[test]
fn limits_are_kept_and_arcs_are_exact() {
    let limits = Limits::differential_drive();
    assert!(limits.check().is_ok() && Limits { linear: f64::NAN, ..limits }.check().is_err());
    assert!(Limits { deceleration: 0.0, ..limits }.check().is_err());
    let from = Twist::new(0.5, 0.0);
    let fast = limits.reachable(from, Twist::new(9.0, -9.0), 0.1);
    assert!((fast.linear - 0.6).abs() < 1e-12 && (fast.angular + 0.6).abs() < 1e-12);
    let stop = limits.reachable(from, Twist::new(f64::NAN, 1.0), 0.1);
    assert!((stop.linear - 0.35).abs() < 1e-12, "what is no number is to stop");
    // A quarter of a circle of radius 2.
    let quarter = moved(&Se2::identity(), Twist::new(1.0, 0.5), std::f64::consts::PI);
    assert!((quarter.translation - Vec2::new(2.0, 2.0)).norm() < 1e-12);
    let v = limits.speed_to_stop_within(0.5, 0.1);
    assert!((v * 0.1 + v * v / (2.0 * limits.deceleration) - 0.5).abs() < 1e-12);
}
