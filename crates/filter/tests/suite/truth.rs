//! Logs with true poses: a run is judged by them, and noise that the log does not say is estimated.

use cairn_filter::ekf::EkfConfig;
use cairn_filter::log::{Target, parse_csv};
use cairn_filter::run::run;
use cairn_filter::simulate::{Simulated, World};
use cairn_filter::truth::judge;
use cairn_geometry::Se2;

/// A drive of a simulated world as a csv with its truth: range, bearing and the motion that the wheels told.
fn told_with_truth(simulated: &Simulated) -> String {
    let mut text = "0,truth,0,0,0\n0,travel,0,0\n".to_owned();
    for (step, truth) in simulated.steps.iter().zip(&simulated.truth) {
        let (t, m) = (step.time_s, &step.motion.before_from_after);
        // Along the arc, whose chord is the translation.
        let half = 0.5 * m.rotation.log();
        let way = m.translation.norm() * if half.abs() < 1e-9 { 1.0 } else { half / half.sin() };
        text += &format!("{t},truth,{},{},{}\n{t},travel,{way},{}\n", truth.x, truth.y, truth.z, 2.0 * half);
        for s in &step.sightings {
            let (Target::Landmark(label), z) = (s.target, s.measurement.value()) else { continue };
            text += &format!("{t},range_bearing,{label},{},{}\n", z.x, z.y);
        }
    }
    text
}

#[test]
fn a_log_with_true_poses_is_judged_by_them() {
    let world = World { landmarks: 40, radius_m: 15.0, duration_s: 200.0, ..World::default() };
    let simulated = world.drive(8);
    let log = parse_csv("told.csv", &told_with_truth(&simulated)).unwrap();
    assert_eq!(log.truth.len(), simulated.truth.len() + 1);
    let found = run(&log, 0, &EkfConfig::default()).unwrap();
    let judged = judge(&log.truth, &found).unwrap();
    println!("{judged:?}, NIS {:.2}", found.nis_per_dof);
    assert_eq!(found.poses.len(), simulated.truth.len());
    let squared: f64 =
        found.poses.iter().zip(&simulated.truth).map(|(p, t)| (p - t).xy().norm_squared()).sum();
    let off = (squared / simulated.truth.len() as f64).sqrt();
    // With the guess in place of the noise that the innovations tell the aligned positions are 0.89 m off.
    assert!(!log.noise_known && judged.ate_m.unwrap() <= off.min(0.15), "{judged:?} {off}");
    assert!(judged.nees.unwrap() > 0.0, "{judged:?}");
    assert_eq!(judged.poses, found.poses.len());
    // A truth elsewhere and turned is the same; one of another time is none.
    let moved = Se2::from_xy_angle(5.0, -3.0, 2.0);
    let elsewhere: Vec<(f64, Se2)> = log.truth.iter().map(|(t, p)| (*t, moved * *p)).collect();
    let again = judge(&elsewhere, &found).unwrap();
    assert!((again.ate_m.unwrap() - judged.ate_m.unwrap()).abs() < 1e-9);
    assert!((again.nees.unwrap() - judged.nees.unwrap()).abs() < 1e-6);
    assert!(judge(&[(1e6, moved)], &found).is_none());
}
