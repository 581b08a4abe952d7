//! Simulated worlds with ground truth: the forms of the covariance agree, local updates are exact, the covariance is
//! consistent, mapping works from ranges or bearings alone, robots locate each other, associations are right.

use cairn_filter::angle::wrap;
use cairn_filter::chi2;
use cairn_filter::ekf::{Association, EkfConfig, EkfSlam, FilterError, Hypotheses, Linearisation, Verdict};
use cairn_filter::log::{Sighting, Target, parse_csv};
use cairn_filter::measure::{Kind, Measurement, expected};
use cairn_filter::motion::Motion;
use cairn_filter::run::{align, run};
use cairn_filter::simulate::{Simulated, World};
use cairn_geometry::{Se2, Vec2};
use cairn_random::Random;
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

fn started(config: EkfConfig) -> EkfSlam {
    let mut filter = EkfSlam::new(config);
    filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)).unwrap();
    filter
}

fn driven(simulated: &Simulated, config: EkfConfig) -> EkfSlam {
    let mut filter = started(config);
    for step in &simulated.steps {
        filter.predict(0, &step.motion).unwrap();
        filter.observe(0, &step.sightings).unwrap();
    }
    filter
}

fn world(landmarks: usize, duration_s: f64) -> World {
    World { landmarks, radius_m: 15.0, duration_s, ..World::default() }
}

/// Largest difference of poses, landmarks and their covariances.
fn difference(a: &EkfSlam, b: &EkfSlam) -> f64 {
    let ((pa, ca), (pb, cb)) = (a.pose(0).unwrap(), b.pose(0).unwrap());
    let mut most = (pa - pb).amax().max((ca - cb).amax());
    let (la, lb) = (a.landmarks(), b.landmarks());
    assert_eq!(la.len(), lb.len());
    for (x, y) in la.iter().zip(&lb) {
        assert_eq!(x.label, y.label);
        most = most.max((x.position - y.position).amax()).max((x.covariance - y.covariance).amax());
    }
    most
}

#[test]
fn local_updates_are_those_of_the_whole_filter() {
    // Two laps: landmarks become passive and active again, and the loop closes over passive ones.
    let simulated = world(60, 200.0).drive(5);
    for linearisation in [Linearisation::Latest, Linearisation::First, Linearisation::Invariant] {
        let config = EkfConfig { linearisation, gate_probability: 1.0, ..EkfConfig::default() };
        let whole = driven(&simulated, config);
        let local = driven(&simulated, EkfConfig { local_radius_m: Some(16.0), ..config });
        assert!(local.active_size() < whole.active_size() / 2 + 40, "{}", local.active_size());
        let d = difference(&whole, &local);
        assert!(d < 1e-6, "{linearisation:?}: {d:e}");
    }
}

/// Mean NEES of the pose over runs and the last half of the time.
fn late_nees(world: &World, runs: u64, config: EkfConfig) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..runs {
        let simulated = world.drive(seed);
        let mut filter = started(config);
        for (k, (step, truth)) in simulated.steps.iter().zip(&simulated.truth).enumerate() {
            filter.predict(0, &step.motion).unwrap();
            filter.observe(0, &step.sightings).unwrap();
            if 2 * k > simulated.steps.len() {
                let (pose, covariance) = filter.pose(0).unwrap();
                let mut error: Vector3<f64> = pose - truth;
                error.z = wrap(error.z);
                sum += error.dot(&covariance.cholesky().unwrap().solve(&error));
                count += 1.0;
            }
        }
    }
    sum / count
}

#[test]
fn the_belief_is_honest_and_the_textbook_filter_is_not() {
    let world = World { landmarks: 60, radius_m: 20.0, duration_s: 400.0, ..World::default() };
    let nees = |linearisation| {
        let config = EkfConfig {
            linearisation,
            gate_probability: 1.0,
            local_radius_m: Some(20.0),
            ..EkfConfig::default()
        };
        late_nees(&world, 12, config)
    };
    let (plain, first, invariant) =
        (nees(Linearisation::Latest), nees(Linearisation::First), nees(Linearisation::Invariant));
    // The errors of one run are correlated in time, so the bounds count the runs only.
    let (low, high) = chi2::mean_bounds(0.99, 3, 12);
    println!(
        "NEES late: plain {plain:.2}, first {first:.2}, invariant {invariant:.2}, 99 % band {low:.2} to {high:.2}"
    );
    assert!((low..high).contains(&first), "{first}");
    assert!((low..high).contains(&invariant), "{invariant}");
    assert!(plain > high && plain > 1.5 * invariant, "{plain}");
}

#[test]
fn innovations_are_as_large_as_they_are_believed() {
    let simulated = world(40, 300.0).drive(9);
    let mut filter = started(EkfConfig { gate_probability: 1.0, ..EkfConfig::default() });
    let (mut nis, mut dofs) = (0.0, 0);
    for step in &simulated.steps {
        filter.predict(0, &step.motion).unwrap();
        for verdict in filter.observe(0, &step.sightings).unwrap() {
            if let Verdict::Taken { nis: n, dof, .. } = verdict {
                (nis, dofs) = (nis + n, dofs + dof);
            }
        }
    }
    let (low, high) = chi2::mean_bounds(0.999, 1, dofs);
    let mean = nis / dofs as f64;
    assert!((low..high).contains(&mean), "{mean} not in {low}..{high}");
}

/// Root mean square distance of the aligned landmarks from the truth, and the number of landmarks.
fn map_error(filter: &EkfSlam, simulated: &Simulated) -> (f64, usize) {
    let truth: BTreeMap<u32, Vec2> = (0..).zip(simulated.landmarks.iter().copied()).collect();
    let found: BTreeMap<u32, Vec2> =
        filter.landmarks().iter().map(|l| (l.label.unwrap(), l.position)).collect();
    let (_, rmse, pairs) = align(&truth, &found).unwrap();
    (rmse, pairs)
}

#[test]
fn ranges_alone_and_bearings_alone_place_landmarks() {
    for kind in [Kind::Range, Kind::Bearing] {
        let world = World {
            kind,
            landmarks: 12,
            radius_m: 8.0,
            duration_s: 120.0,
            reach_m: 12.0,
            ..World::default()
        };
        for seed in 0..4 {
            let simulated = world.drive(seed);
            let filter = driven(&simulated, EkfConfig::default());
            let (off_m, count) = map_error(&filter, &simulated);
            assert!(count >= 11 && off_m < 0.5, "{kind:?} {seed}: {count} landmarks, {off_m:.2} m");
            for l in filter.landmarks() {
                let d = l.position - simulated.landmarks[l.label.unwrap() as usize];
                let nees = d.dot(&l.covariance.cholesky().unwrap().solve(&d));
                assert!(nees < 40.0, "{kind:?} {seed}: {nees}");
            }
        }
    }
}

/// Root mean square error of the position on a way of 48 m, out and back around a corner, among beacons that tell ranges alone.
fn off_among_beacons(seed: u64) -> f64 {
    let beacons = [(3, 3), (6, -3), (10, 2), (15, -1), (15, 5), (9, 8), (14, 11), (10, 13)];
    let beacons: Vec<Vec2> = beacons.map(|(x, y)| Vec2::new(f64::from(x), f64::from(y))).to_vec();
    let (wheels, dt, mut random) = (World::default().velocity, 0.1, Random::new(seed));
    let (mut filter, mut truth) = (started(EkfConfig::default()), Se2::identity());
    let (mut sum, mut count) = (0.0, 0.0);
    for goal in [(12.0, 0.0), (12.0, 12.0), (12.0, 0.0), (0.0, 0.0)].map(|(x, y)| Vec2::new(x, y)) {
        while (goal - truth.translation).norm() > 0.3 {
            let ahead = truth.inverse() * goal;
            let bearing = ahead.y.atan2(ahead.x);
            let (speed, turn) = (if bearing.abs() > 0.5 { 0.0 } else { 0.6 }, bearing.clamp(-0.6, 0.6));
            truth = truth * wheels.motion(speed, turn, dt).before_from_after;
            let mut noisy = |deviation: f64| deviation / dt.sqrt() * random.standard_normal();
            let measured = wheels.motion(speed + noisy(wheels.speed), turn + noisy(wheels.turn), dt);
            let at = Vector3::new(truth.translation.x, truth.translation.y, truth.rotation.log());
            let mut sightings = Vec::new();
            for (label, beacon) in (0..).zip(&beacons) {
                let range = (beacon - at.xy()).norm();
                if range < 9.0 {
                    let range = (range + 0.05 * random.standard_normal()).max(0.0);
                    let measurement = Measurement::range(range, 0.05).unwrap();
                    sightings.push(Sighting { target: Target::Landmark(label), measurement });
                }
            }
            filter.predict(0, &measured).unwrap();
            filter.observe(0, &sightings).unwrap();
            sum += (filter.pose(0).unwrap().0 - at).xy().norm_squared();
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

#[test]
fn beacons_beside_a_straight_way_are_not_put_on_the_wrong_side_of_it() {
    // The wheels believe that the way bends. Poses that are taken to be exact would tell the side of a beacon by that.
    let off_m: Vec<f64> = (0..40).map(off_among_beacons).collect();
    let most = off_m.iter().fold(0.0, |a: f64, b| a.max(*b));
    println!("RMS at most {most:.2} m");
    assert!(most < 1.5, "{off_m:.2?}");
}

#[test]
fn unlabelled_sightings_find_their_landmarks() {
    for association in [Association::Nearest, Association::Joint] {
        let world =
            World { landmarks: 20, radius_m: 10.0, margin_m: 5.0, duration_s: 130.0, ..World::default() };
        let mut simulated = world.drive(2);
        let truth: Vec<Vec<Target>> =
            simulated.steps.iter().map(|s| s.sightings.iter().map(|x| x.target).collect()).collect();
        simulated.steps.iter_mut().flat_map(|s| &mut s.sightings).for_each(|s| s.target = Target::Unlabelled);
        let mut filter = started(EkfConfig { association, gate_probability: 0.99, ..EkfConfig::default() });
        let (mut labels, mut wrong, mut all) = (BTreeMap::new(), 0, 0);
        for (step, truth) in simulated.steps.iter().zip(&truth) {
            filter.predict(0, &step.motion).unwrap();
            for (verdict, target) in filter.observe(0, &step.sightings).unwrap().iter().zip(truth) {
                match verdict {
                    Verdict::New { landmark } => drop(labels.insert(*landmark, *target)),
                    Verdict::Taken { landmark: Some(id), .. } => {
                        all += 1;
                        wrong += usize::from(labels[id] != *target);
                    }
                    _ => {}
                }
            }
        }
        let confirmed = filter.landmarks().iter().filter(|l| l.confirmed).count();
        assert!(wrong * 50 <= all && all > 1000, "{association:?}: {wrong} of {all}");
        assert!((18..=23).contains(&confirmed), "{association:?}: {confirmed}");
    }
}

#[test]
fn joint_compatibility_keeps_what_single_gates_confuse() {
    // A row of posts 1 m apart, and a pose that is off by 0.6 m along it: each post taken alone is nearest to its
    // neighbour.
    let mut filter = started(EkfConfig { association: Association::Joint, ..EkfConfig::default() });
    let posts = [1.0, 2.0, 3.0, 4.6].map(|x| Vector3::new(x, 2.0, 0.0));
    let seen = |from: &Vector3<f64>| -> Vec<Sighting> {
        let see = |p: &Vector3<f64>| {
            let z = expected(Kind::RangeBearing, from, p);
            let measurement = Measurement::range_bearing(z.x, z.y, 0.02, 0.01).unwrap();
            Sighting { target: Target::Unlabelled, measurement }
        };
        posts.iter().map(see).collect()
    };
    for _ in 0..3 {
        filter.observe(0, &seen(&Vector3::zeros())).unwrap();
    }
    let slip = Matrix3::from_diagonal(&Vector3::new(0.3, 1e-4, 1e-4));
    filter.predict(0, &Motion { before_from_after: Se2::identity(), covariance: slip }).unwrap();
    let verdicts = filter.observe(0, &seen(&Vector3::new(0.6, 0.0, 0.0))).unwrap();
    let found: Vec<u32> = verdicts
        .iter()
        .map(|v| match v {
            Verdict::Taken { landmark: Some(id), .. } => id.0,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(found, [0, 1, 2, 3]);
    assert!((filter.pose(0).unwrap().0.x - 0.6).abs() < 0.05);
}

#[test]
fn a_decision_that_is_not_certain_waits_for_what_is_seen_later() {
    // The same row and slip, but the second post is seen alone at first: it is nearest to where the first one should be.
    let posts = [1.0, 2.0, 3.0, 4.6].map(|x| Vector3::new(x, 2.0, 0.0));
    let seen = |from: &Vector3<f64>, which: &[usize]| -> Vec<Sighting> {
        let see = |k: &usize| {
            let z = expected(Kind::RangeBearing, from, &posts[*k]);
            let measurement = Measurement::range_bearing(z.x, z.y, 0.02, 0.01).unwrap();
            Sighting { target: Target::Unlabelled, measurement }
        };
        which.iter().map(see).collect()
    };
    let drive = |association| {
        let mut filter = Hypotheses::new(EkfConfig { association, ..EkfConfig::default() });
        filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)).unwrap();
        let observe = |filter: &mut Hypotheses, seen: Vec<Sighting>| {
            filter.observe(0, &seen, None).unwrap();
        };
        for _ in 0..3 {
            observe(&mut filter, seen(&Vector3::zeros(), &[0, 1, 2, 3]));
        }
        let slip = Matrix3::from_diagonal(&Vector3::new(0.3, 1e-4, 1e-4));
        let slip = Motion { before_from_after: Se2::identity(), covariance: slip };
        filter.predict(0, &slip, None).unwrap();
        let at = Vector3::new(0.6, 0.0, 0.0);
        observe(&mut filter, seen(&at, &[1]));
        let early = (filter.count(), filter.pose(0).unwrap().0.x);
        observe(&mut filter, seen(&at, &[0, 1, 2, 3]));
        observe(&mut filter, seen(&at, &[0, 1, 2, 3]));
        (early, filter)
    };
    let (_, at_once) = drive(Association::Joint);
    assert!((at_once.pose(0).unwrap().0.x + 0.4).abs() < 0.1, "nothing is hard here");
    let ((followed, x), deferred) = drive(Association::Deferred);
    assert!(followed > 1 && (x + 0.4).abs() < 0.1, "{followed} followed, the nearest first: {x}");
    assert!((deferred.pose(0).unwrap().0.x - 0.6).abs() < 0.05, "{:?}", deferred.pose(0));
    assert_eq!(deferred.count(), 1, "decided");
    let labels: Vec<Vec<Option<u32>>> = deferred
        .verdicts()
        .map(|of| {
            let label = |v: &Verdict| match v {
                Verdict::Taken { landmark, .. } => landmark.map(|id| id.0),
                Verdict::New { landmark } => Some(landmark.0),
                _ => None,
            };
            of.iter().map(label).collect()
        })
        .collect();
    let all = [0, 1, 2, 3].map(Some).to_vec();
    assert_eq!(labels, [all.clone(), all.clone(), all.clone(), vec![Some(1)], all.clone(), all]);
    let mut nobody =
        Hypotheses::new(EkfConfig { association: Association::Deferred, ..EkfConfig::default() });
    let still = Motion::identity();
    assert_eq!(nobody.observe(0, &[], None), Err(FilterError::NoRobot(0)));
    assert_eq!(nobody.predict(0, &still, None), Err(FilterError::NoRobot(0)));
    let one = seen(&Vector3::zeros(), &[0]);
    assert_eq!(nobody.observe(0, &one, Some(&[])), Err(FilterError::Measurements(1, 0)));
}

#[test]
fn without_labels_the_map_has_its_own_noise() {
    let posts = [1.0, 2.5, 4.0].map(|x| Vector3::new(x, 2.0, 0.0));
    let seen = |deviation: f64| -> Vec<Sighting> {
        let see = |post: &Vector3<f64>| {
            let z = expected(Kind::RangeBearing, &Vector3::zeros(), post);
            let measurement = Measurement::range_bearing(z.x, z.y, deviation, 0.5 * deviation).unwrap();
            Sighting { target: Target::Unlabelled, measurement }
        };
        posts.iter().map(see).collect()
    };
    for association in [Association::Nearest, Association::Joint, Association::Deferred] {
        let mut filter = Hypotheses::new(EkfConfig { association, ..EkfConfig::default() });
        filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12)).unwrap();
        let mapping: Vec<Measurement> = seen(0.2).iter().map(|s| s.measurement).collect();
        for _ in 0..4 {
            filter.observe(0, &seen(0.02), Some(&mapping)).unwrap();
        }
        let (map, associated) = (filter.landmarks(), filter.best().landmarks());
        assert_eq!(map.len(), 3);
        for (m, a) in map.iter().zip(&associated) {
            assert_eq!((m.id, m.confirmed, m.label, m.seen), (a.id, a.confirmed, a.label, a.seen));
            // Four sightings from a known place: a quarter of the variance of one.
            let ratio = m.covariance.trace() / a.covariance.trace();
            assert!((ratio - 100.0).abs() < 2.0, "{association:?}: {ratio}");
        }
    }
}

#[test]
fn robots_that_see_each_other_know_where_both_are() {
    let mut filter = started(EkfConfig::default());
    let wide = Matrix3::from_diagonal(&Vector3::new(0.3, 0.3, 0.05));
    let truth = Se2::from_xy_angle(3.0, 1.0, 2.0);
    assert_eq!(filter.add_robot(&Se2::from_xy_angle(3.4, 0.7, 2.1), &wide), Ok(1));
    let covariance = Matrix3::from_diagonal(&Vector3::new(1e-4, 1e-4, 1e-4));
    let pose = Measurement::relative_pose(&truth, &covariance).unwrap();
    let see = |measurement, robot| [Sighting { target: Target::Robot(robot), measurement }];
    assert!(matches!(
        filter.observe(0, &see(pose, 1)).unwrap()[0],
        Verdict::Taken { landmark: None, dof: 3, .. }
    ));
    let (found, p) = filter.pose(1).unwrap();
    assert!((found - Vector3::new(3.0, 1.0, 2.0)).norm() < 0.01 && p.diagonal().amax() < 2e-4);
    // The second robot sees the first one too, by range and bearing.
    let z = expected(Kind::RangeBearing, &Vector3::new(3.0, 1.0, 2.0), &Vector3::zeros());
    let back = Measurement::range_bearing(z.x, z.y, 0.05, 0.02).unwrap();
    assert!(matches!(filter.observe(1, &see(back, 0)).unwrap()[0], Verdict::Taken { .. }));
    assert_eq!(filter.observe(0, &see(back, 0)).unwrap()[0], Verdict::Unusable, "oneself");
    assert_eq!(filter.observe(0, &see(back, 7)).unwrap()[0], Verdict::Unusable, "a stranger");
}

#[test]
fn a_slip_of_the_wheels_is_recovered_from() {
    let mut simulated = world(40, 200.0).drive(4);
    // For half a second the wheels turned while the robot was pushed aside: 1.5 m and 20 degrees.
    let k = simulated.steps.len() / 2;
    let pushed = simulated.steps[k].motion;
    simulated.steps[k].motion =
        Motion { before_from_after: pushed.before_from_after * Se2::from_xy_angle(0.5, 1.4, 0.35), ..pushed };
    for gate in [3.0, 5.99, 14.0] {
        let with = driven(&simulated, EkfConfig::default().with_gate_of_two(gate));
        let never = EkfConfig { recovery_fraction: 2.0, ..EkfConfig::default().with_gate_of_two(gate) };
        let without = driven(&simulated, never);
        let truth = simulated.truth.last().unwrap();
        let off = |f: &EkfSlam| (f.pose(0).unwrap().0 - truth).xy().norm();
        println!("gate {gate}: {:.2} m, without recovery {:.2} m", off(&with), off(&without));
        assert!(with.recoveries() > 0 && off(&with) < 0.8, "gate {gate}: {:.2} m", off(&with));
        assert!(off(&without) < 0.8, "gate {gate}: outliers still pull: {:.2} m", off(&without));
    }
}

#[test]
fn a_landmark_that_is_carried_away_is_found_again() {
    let mut filter = started(EkfConfig::default());
    let see = |x: f64, label: u32, random: &mut Random| Sighting {
        target: Target::Landmark(label),
        measurement: Measurement::range_bearing(
            x + 0.02 * random.standard_normal(),
            0.1 * f64::from(label),
            0.03,
            0.01,
        )
        .unwrap(),
    };
    let mut random = Random::new(1);
    for k in 0..60 {
        let carried = if k < 20 { 5.0 } else { 8.0 };
        let sightings = [
            see(4.0, 1, &mut random),
            see(6.0, 2, &mut random),
            see(7.0, 4, &mut random),
            see(carried, 3, &mut random),
        ];
        filter.observe(0, &sightings).unwrap();
    }
    assert!((filter.labelled(3).unwrap().position.norm() - 8.0).abs() < 0.05);
    assert!((filter.labelled(1).unwrap().position.norm() - 4.0).abs() < 0.05);
    assert_eq!(filter.landmarks().len(), 4);
}

#[test]
fn nonsense_is_refused_and_changes_nothing() {
    let mut filter = started(EkfConfig::default());
    let nan =
        Motion { before_from_after: Se2::from_xy_angle(f64::NAN, 0.0, 0.0), covariance: Matrix3::zeros() };
    assert_eq!(filter.predict(0, &nan), Err(FilterError::NotFinite));
    let negative = Motion { covariance: -Matrix3::identity(), ..Motion::identity() };
    assert_eq!(filter.predict(0, &negative), Err(FilterError::NotFinite));
    assert_eq!(filter.predict(3, &Motion::identity()), Err(FilterError::NoRobot(3)));
    assert_eq!(filter.observe(3, &[]), Err(FilterError::NoRobot(3)));
    let wrong = Matrix3::new(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    assert_eq!(filter.add_robot(&Se2::identity(), &wrong), Err(FilterError::NotFinite));
    assert_eq!(filter.pose(0).unwrap().0, Vector3::zeros());
    // A landmark at the robot's own position has no direction.
    let here = Measurement::range_bearing(0.0, 0.0, 0.1, 0.1).unwrap();
    let sighting = [Sighting { target: Target::Landmark(1), measurement: here }];
    filter.observe(0, &sighting).unwrap();
    assert_eq!(filter.observe(0, &sighting).unwrap(), [Verdict::Unusable]);
}

/// A drive of 10 s in a circle, told as velocities ten times a second; the robot then goes on as it pleases for 50 s without a
/// word of it, and sees three landmarks all the time.
fn drive_whose_odometry_ends(speed_after: f64, turn_after: f64) -> (String, Se2) {
    let landmarks = [Vec2::new(8.0, 3.0), Vec2::new(2.0, -4.0), Vec2::new(-3.0, 6.0)];
    let (mut pose, mut text) = (Se2::identity(), String::new());
    for k in 0..600 {
        let time_s = 0.1 * f64::from(k);
        let (speed, turn) = if k < 100 { (1.0, 0.2) } else { (speed_after, turn_after) };
        if k < 100 {
            text += &format!("{time_s},velocity,{speed},{turn}\n");
        }
        if k % 5 == 0 {
            for (label, l) in landmarks.iter().enumerate() {
                let seen = pose.inverse() * *l;
                text += &format!("{time_s},range_bearing,{label},{},{}\n", seen.norm(), seen.y.atan2(seen.x));
            }
        }
        pose = pose * Se2::from_xy_angle(0.1 * speed, 0.0, 0.1 * turn);
    }
    (text, pose)
}

#[test]
fn a_velocity_that_was_given_last_is_not_believed_for_ever() {
    // What is wrong for the second in which the last velocity is still believed stays in the map: 0.04 and 0.40 m here.
    for (speed, turn, bound) in [(0.0, 0.0, 0.1), (0.6, -0.1, 0.5)] {
        let (text, truth) = drive_whose_odometry_ends(speed, turn);
        let log = parse_csv("ends.csv", &text).unwrap();
        let spans = log.robots[0].without_odometry();
        assert!(matches!(spans[..], [(from, to)] if (10.0..12.0).contains(&from) && to > 59.0), "{spans:?}");
        let found = run(&log, 0, &EkfConfig::default()).unwrap();
        let last = found.poses.last().unwrap();
        let off = (last.xy() - truth.translation).norm();
        println!("{speed} m/s afterwards: {off:.3} m off, {:?}", found.counts);
        assert!(off < bound, "{off} m off at {speed} m/s");
    }
    // Velocities that are given only when they change last as long as it takes.
    let (text, _) = drive_whose_odometry_ends(1.0, 0.2);
    let changes: String = text
        .lines()
        .filter(|l| !l.contains("velocity") || l.starts_with("0,"))
        .map(|l| format!("{l}\n"))
        .collect();
    assert!(parse_csv("changes.csv", &changes).unwrap().robots[0].without_odometry().is_empty());
}
