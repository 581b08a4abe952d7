//! Real logs, and others drawn from them: the filter still reaches its figures.

use crate::drawn::{drawn, first_seed};
use crate::textbook::textbook;
use cairn_filter::batch::BatchConfig;
use cairn_filter::ekf::{Association, EkfConfig};
use cairn_filter::joint::joint;
use cairn_filter::log::{Format, Log, Noise, load};
use cairn_filter::run::{Run, align, position_rmse, run};
use cairn_geometry::Se2;
use std::path::PathBuf;

fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("CAIRN_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let path = root.join("ekf").join(name);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn mrclam() -> Option<Vec<Log>> {
    let folder = data("mrclam1")?;
    Some((1..=3).map(|r| load(&folder, Some(r)).unwrap().1).collect())
}

fn landmark_error(log: &Log, run: &Run) -> (Se2, f64) {
    let (transform, rmse, pairs) = align(&log.surveyed, &run.named()).unwrap();
    assert_eq!(pairs, 15);
    (transform, rmse)
}

#[test]
fn mrclam_is_mapped_and_smoothed() {
    let Some(logs) = mrclam() else { return };
    let (mut landmarks, mut positions, mut smoothed) = (0.0, 0.0, 0.0);
    for log in &logs {
        assert!(log.notes.iter().any(|n| n.contains("11 and 17")), "the swap is mended: {:?}", log.notes);
        let found = run(log, 0, &EkfConfig::default()).unwrap();
        let (transform, rmse) = landmark_error(log, &found);
        let (smooth, report) = found.smoothed(log, 0, &BatchConfig::default()).unwrap();
        assert!(report.cost_after < report.cost_before);
        let (smooth_to, smooth_rmse, _) = align(&log.surveyed, &smooth.landmarks).unwrap();
        landmarks += rmse / 3.0;
        smoothed += smooth_rmse / 3.0;
        positions += position_rmse(&found.poses, &transform, &smooth.poses[0], &smooth_to) / 3.0;
    }
    println!(
        "landmarks {landmarks:.4} m, live positions {positions:.4} m, smoothed landmarks {smoothed:.4} m"
    );
    assert!(landmarks <= 0.065 && positions <= 0.15 && smoothed <= 0.05);
}

#[test]
fn mrclam_is_mapped_without_labels() {
    let Some(logs) = mrclam() else { return };
    let config = EkfConfig { association: Association::Deferred, ..EkfConfig::default() };
    let [mut mean, mut positions] = [0.0; 2];
    for log in &logs {
        let found = run(log, 0, &config).unwrap();
        let (onto, rmse, pairs) = align(&log.surveyed, &found.named()).unwrap();
        let labelled = run(log, 0, &EkfConfig::default()).unwrap();
        let (smooth, _) = labelled.smoothed(log, 0, &BatchConfig::default()).unwrap();
        let (smooth_onto, ..) = align(&log.surveyed, &smooth.landmarks).unwrap();
        let position = position_rmse(&found.poses, &onto, &smooth.poses[0], &smooth_onto);
        positions += position / 3.0;
        let wrong = found.wrong_associations.unwrap();
        println!(
            "{}: {:.1} % wrong, {pairs} landmarks, {rmse:.3} m, live positions {position:.3} m",
            found.robot,
            100.0 * wrong
        );
        assert!(wrong <= 0.005 && pairs >= 14, "{}: {wrong}, {pairs}", found.robot);
        mean += rmse / 3.0;
    }
    assert!(mean <= 0.065 && positions <= 0.155, "{mean:.3} m, {positions:.3} m");
}

#[test]
fn deferred_associations_do_not_hang_on_the_gate() {
    let Some(logs) = mrclam() else { return };
    // 2.5 minutes of another world; what is wrong there is told, since it is no goal reached: `docs/ekf.md`, limits.
    let log = drawn(&logs[0], 0, 0.1, first_seed());
    let [narrow, wide] = [0.95, 0.999].map(|gate_probability| {
        let association = Association::Deferred;
        run(&log, 0, &EkfConfig { association, gate_probability, ..EkfConfig::default() }).unwrap()
    });
    println!("{}: {:.1} % wrong", log.name, 100.0 * narrow.wrong_associations.unwrap());
    assert!(narrow.counts.taken > 50 && narrow.counts == wide.counts);
    assert_eq!((narrow.poses, narrow.landmarks), (wide.poses, wide.landmarks));
}

#[test]
fn mrclam_diverges_at_no_gate() {
    let Some(logs) = mrclam() else { return };
    for gate in [3.0, 5.0, 7.0, 9.0, 11.0, 14.0] {
        let config = EkfConfig::default().with_gate_of_two(gate);
        let rmse: f64 =
            logs.iter().map(|log| landmark_error(log, &run(log, 0, &config).unwrap()).1 / 3.0).sum();
        assert!(rmse <= 0.065, "gate {gate}: {rmse:.3} m");
    }
}

#[test]
fn innovations_of_real_logs_are_as_large_as_they_are_believed() {
    let Some(mut logs) = mrclam() else { return };
    for name in ["victoria_park.txt", "Plaza1_DR.txt"] {
        logs.extend(data(name).map(|path| load(&path, None).unwrap().1));
    }
    for log in &logs {
        let config = EkfConfig { gate_probability: log.gate_probability, ..EkfConfig::default() };
        let found = run(log, 0, &config).unwrap();
        println!("{} {}: NIS {:.2} a degree of freedom", log.name, found.robot, found.nis_per_dof);
        assert!((0.8..=1.2).contains(&found.nis_per_dof), "{}: {}", found.robot, found.nis_per_dof);
    }
}

/// Live positions off smoothing of the same log, each aligned to the survey, root mean square in metres: of the filter, and of the filter
/// of a textbook with this noise.
fn live_errors(log: &Log, noise: &Noise) -> [f64; 2] {
    let found = run(log, 0, &EkfConfig::default()).unwrap();
    let (smooth, _) = found.smoothed(log, 0, &BatchConfig::default()).unwrap();
    let (smooth_to, ..) = align(&log.surveyed, &smooth.landmarks).unwrap();
    let (poses, map) = textbook(log, 0, noise);
    let (own_to, book_to) = (align(&log.surveyed, &found.named()), align(&log.surveyed, &map));
    let off = |poses: &[_], to: Option<(Se2, f64, usize)>| {
        to.map_or(f64::INFINITY, |(to, ..)| position_rmse(poses, &to, &smooth.poses[0], &smooth_to))
    };
    [off(&found.poses, own_to), off(&poses, book_to)]
}

#[test]
fn live_positions_are_no_worse_than_those_of_a_textbook() {
    let Some(logs) = mrclam() else { return };
    let seed = first_seed();
    let others = logs.iter().flat_map(|log| (seed..seed + 2).map(|s| drawn(log, 0, 0.5, s)));
    let others: Vec<Log> = others.collect();
    let mut sums = [0.0; 2];
    for log in logs.iter().chain(&others) {
        let [own, book] = live_errors(log, &Noise::mrclam());
        println!(
            "{} {}: live {:.1} cm, textbook {:.1} cm",
            log.name,
            log.robots[0].name,
            100.0 * own,
            100.0 * book
        );
        sums = [sums[0] + own, sums[1] + book];
        // Of fifteen drawn logs two were worse, by at most 30 %.
        let most = if log.name == "MRCLAM" { 1.0 } else { 1.4 };
        assert!(own <= most * book, "{}: {own:.3} m, textbook {book:.3} m", log.name);
    }
    assert!(sums[0] <= 0.85 * sums[1], "{sums:?}");
}

#[test]
fn several_robots_give_one_map_that_is_no_worse_than_the_best_of_them() {
    let Some(path) = data("mrclam1") else { return };
    let (_, log) = load(&path, None).unwrap();
    let runs: Vec<Run> = (0..3).map(|k| run(&log, k, &EkfConfig::default()).unwrap()).collect();
    let alone = runs.iter().enumerate().map(|(k, r)| {
        let (smooth, _) = r.smoothed(&log, k, &BatchConfig::default()).unwrap();
        align(&log.surveyed, &smooth.landmarks).unwrap().1
    });
    let best = alone.fold(f64::INFINITY, f64::min);
    let config = BatchConfig { iterations: 200, ..BatchConfig::default() };
    let together = joint(&log, &runs, &config).unwrap().unwrap();
    let (_, rmse, pairs) = align(&log.surveyed, &together.smoothed.landmarks).unwrap();
    println!(
        "best alone {best:.4} m, together {rmse:.4} m, {} sightings of each other, {:?}",
        together.mutual, together.report
    );
    assert_eq!((together.robots.as_slice(), pairs), ([0, 1, 2].as_slice(), 15));
    assert!(together.report.converged && together.mutual > 1000 && rmse <= 1.2 * best, "{rmse} {best}");
}

#[test]
fn victoria_park_is_near_its_smoothed_map() {
    let Some(path) = data("victoria_park.txt") else { return };
    let (format, log) = load(&path, None).unwrap();
    assert_eq!(format, Format::Victoria);
    let config = EkfConfig {
        gate_probability: log.gate_probability,
        local_radius_m: Some(60.0),
        ..EkfConfig::default()
    };
    let found = run(&log, 0, &config).unwrap();
    let (smooth, report) = found.smoothed(&log, 0, &BatchConfig::default()).unwrap();
    let (_, apart, pairs) = align(&smooth.landmarks, &found.named()).unwrap();
    println!("{pairs} landmarks, {apart:.3} m from smoothing");
    assert!(report.converged && pairs == 151 && apart <= 0.5);
}

#[test]
fn plaza_finds_its_beacons_by_ranges_alone() {
    let Some(path) = data("Plaza1_TD.txt") else { return };
    let (format, log) = load(&path, None).unwrap();
    assert_eq!(format, Format::Plaza);
    let found = run(&log, 0, &EkfConfig::default()).unwrap();
    let (smooth, report) = found.smoothed(&log, 0, &BatchConfig::default()).unwrap();
    let (_, apart, pairs) = align(&smooth.landmarks, &found.named()).unwrap();
    println!("{pairs} beacons, {apart:.3} m from smoothing");
    assert!(report.converged && pairs == 4 && apart < 0.3);
}

#[test]
fn runs_are_the_same_every_time() {
    let Some(logs) = mrclam() else { return };
    let once = run(&logs[1], 0, &EkfConfig::default()).unwrap();
    let again = run(&logs[1], 0, &EkfConfig::default()).unwrap();
    assert_eq!(once.poses, again.poses);
    assert_eq!(once.landmarks, again.landmarks);
}

#[test]
fn what_is_no_log_is_told() {
    let missing = load(std::path::Path::new("/nowhere/log.csv"), None).unwrap_err();
    assert!(missing.to_string().starts_with("/nowhere/log.csv: "), "{missing}");
    let folder = load(std::path::Path::new(env!("CARGO_MANIFEST_DIR")), None).unwrap_err();
    assert!(folder.to_string().contains("a folder without Barcodes.dat"), "{folder}");
    let other = load(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml"), None).unwrap_err();
    assert!(other.to_string().contains("no log that is known"), "{other}");
}
