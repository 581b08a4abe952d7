//! `cairn ekf`.

use crate::binary::{cairn, fails, folder, json, stdout};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const STEP_S: f64 = 0.1;
const BEACONS: [(f64, f64); 5] = [(3.0, 2.5), (9.0, -2.0), (12.0, 2.0), (8.0, 6.0), (13.0, 8.0)];

/// A log of a robot that drives and turns as told, at 0.5 m/s and 0.5 rad/s, and sees all beacons.
fn log(legs: &[(f64, f64)]) -> String {
    let mut text = "0,noise,way,0.01\n0,noise,turn_by_way,0.01\n0,noise,turn_by_root,0.01\n".to_owned();
    text += "0,noise,range_m,0.05\n0,noise,bearing_rad,0.02\n";
    let (mut x, mut y, mut angle, mut t) = (0.0, 0.0, 0.0f64, 0.0);
    for (way, turn) in legs {
        let steps = (way / (0.5 * STEP_S)).max(turn.abs() / (0.5 * STEP_S)).ceil();
        for _ in 0..steps as usize {
            (x, y) = (x + way / steps * angle.cos(), y + way / steps * angle.sin());
            angle += turn / steps;
            t += STEP_S;
            writeln!(text, "{t:.1},travel,{},{}", way / steps, turn / steps).unwrap();
            for (k, (bx, by)) in BEACONS.iter().enumerate() {
                let (dx, dy): (f64, f64) = (bx - x, by - y);
                let bearing = (dy.atan2(dx) - angle).sin().atan2((dy.atan2(dx) - angle).cos());
                writeln!(text, "{t:.1},range_bearing,{k},{},{bearing}", dx.hypot(dy)).unwrap();
            }
        }
    }
    text
}

#[test]
fn a_robot_of_a_log_records_a_route_and_is_guided_home_along_it() {
    let folder = folder("ekf-walk");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    // 10 m ahead, to the left, 6 m; then around and back, past the start.
    let turn = (0.0, FRAC_PI_2);
    let legs = [(10.0, 0.0), turn, (6.0, 0.0), turn, turn, (6.0, 0.0), (0.0, -FRAC_PI_2), (11.0, 0.0)];
    std::fs::write(path("log.csv"), log(&legs)).unwrap();
    // It has driven 16 m after 35.2 s.
    std::fs::write(path("script"), "at 1 record\nat 35 stop\nat 35.5 guide home\narrived quit\n").unwrap();
    let (csv, script, routes) = (path("log.csv"), path("script"), path("routes"));
    let arguments = ["ekf", &csv, "--script", &script, "--routes", &routes];
    let walked = json(&cairn(&[&arguments[..], &["--json"]].concat()));
    assert_eq!((&walked["arrived"], &walked["beacons"]), (&true.into(), &5.into()), "{walked}");
    assert!(walked["tracked"] == walked["steps"] && walked["steps"].as_u64() > Some(500), "{walked}");
    let said: Vec<&str> =
        walked["said"].as_array().unwrap().iter().map(|s| s["text"].as_str().unwrap()).collect();
    let says = |words: &str| said.iter().any(|s| s.contains(words));
    // It has begun to turn when guidance begins, and has most of it before it.
    assert!(says("Turn sharp left") && says("then turn right") && says("You have arrived"), "{said:?}");
    let route = &walked["routes"][0];
    let (file, metres) = (route["file"].as_str().unwrap(), route["metres"].as_f64().unwrap());
    assert!(Path::new(file).starts_with(&routes) && (15.0..16.2).contains(&metres), "{route}");
    // The file is one of routes like any other.
    let info = json(&cairn(&["route", "info", file, "--json"]));
    assert!((info["length_m"].as_f64().unwrap() - metres).abs() < 0.01, "{info}");
    let text = stdout(&cairn(&[&arguments[..], &["--language", "de"]].concat()));
    assert!(text.contains("Sie sind am Ziel"), "{text}");

    std::fs::write(path("wrong"), "at 1 dance\n").unwrap();
    fails(&["ekf", &csv, "--script", &path("wrong")], &["wrong, line 1"]);
    fails(&["ekf", &csv, "--script", &path("none")], &["none"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_robot_of_a_real_log_records_a_route() {
    let data = std::env::var_os("CAIRN_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let log = data.join("ekf/mrclam1");
    if !log.exists() {
        println!("skipped: {} is missing", log.display());
        return;
    }
    let folder = folder("ekf-real");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    std::fs::write(path("script"), "at 60 record\nat 300 stop\nat 301 guide home\nat 600 quit\n").unwrap();
    let arguments = ["ekf", log.to_str().unwrap(), "--robot", "1", "--script", &path("script")];
    let walked = json(&cairn(&[&arguments[..], &["--routes", &path("routes"), "--json"]].concat()));
    let metres = walked["routes"][0]["metres"].as_f64().unwrap();
    // As far as the wheels turned, from the file itself: time, speed, turn.
    let text = std::fs::read_to_string(log.join("Robot1_Odometry.dat")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let rows: Vec<Vec<f64>> = lines
        .map(|line| line.split_whitespace().map(|v| v.parse().unwrap()).collect::<Vec<f64>>())
        .filter(|row| row.len() == 3)
        .collect();
    let recorded = |row: &[f64]| (60.0..300.0).contains(&(row[0] - rows[0][0]));
    let driven: f64 =
        rows.windows(2).filter(|w| recorded(&w[0])).map(|w| w[0][1].abs() * (w[1][0] - w[0][0])).sum();
    assert!(driven > 10.0 && (metres / driven - 1.0).abs() < 0.05, "{metres} of {driven} m: {walked}");
    assert!(walked["beacons"].as_u64().unwrap() >= 13, "{walked}");
    assert!(walked["said"].as_array().unwrap().len() > 3, "{walked}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_log_in_other_units_or_signs_is_doubted() {
    let folder = folder("ekf-units");
    let csv = folder.join("log.csv");
    let right = log(&[(10.0, 0.3), (3.0, FRAC_PI_2), (8.0, 0.2), (3.0, FRAC_PI_2), (9.0, -0.4)]);
    let without_noise = |text: &str| -> String {
        text.lines().filter(|line| !line.contains(",noise,")).map(|line| format!("{line}\n")).collect()
    };
    // The numbers of a line are TIME, kind, then its own.
    let changed = |kind: &str, column: usize, by: f64| -> String {
        let line = |line: &str| {
            let mut words: Vec<String> = line.split(',').map(str::to_owned).collect();
            if words[1] == kind {
                words[column] = (words[column].parse::<f64>().unwrap() * by).to_string();
            }
            words.join(",") + "\n"
        };
        right.lines().map(line).collect()
    };
    let told = |text: &str| {
        std::fs::write(&csv, text).unwrap();
        let notes = json(&cairn(&["ekf", csv.to_str().unwrap(), "--json"]))["notes"].to_string();
        notes.contains("contradict each other")
    };
    assert!(!told(&right) && !told(&without_noise(&right)));
    let degrees = 1.0_f64.to_degrees();
    for (kind, column, by) in [
        ("range_bearing", 4, degrees),
        ("range_bearing", 4, -1.0),
        ("range_bearing", 3, 1000.0),
        ("travel", 3, degrees),
        ("travel", 3, -1.0),
        ("travel", 2, 100.0),
    ] {
        assert!(told(&changed(kind, column, by)), "{kind} {column} times {by}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn files_of_mrclam_that_break_off_are_read_to_there_and_it_is_said() {
    let folder = folder("ekf-torn");
    let path = |name: &str| folder.join(name);
    let write = |name: &str, text: &str| std::fs::write(path(name), text).unwrap();
    let (mut odometry, mut sightings) = (String::new(), String::new());
    // Straight ahead at 0.2 m/s for a minute, three landmarks always in sight.
    for k in 0..600 {
        let (t, x) = (0.1 * f64::from(k), 0.02 * f64::from(k));
        writeln!(odometry, "{t:.3}\t0.2\t0.0").unwrap();
        for (barcode, landmark) in [(16, (4.0, 3.0)), (28, (8.0, -2.0)), (32, (14.0, 1.0))] {
            let (dx, dy): (f64, f64) = (landmark.0 - x, landmark.1);
            writeln!(sightings, "{t:.3}\t{barcode}\t{:.4}\t{:.4}", dx.hypot(dy), dy.atan2(dx)).unwrap();
        }
    }
    write("Barcodes.dat", "1 5\n6 16\n7 28\n8 32\n");
    let robot = |odometry: &str, sightings: &str| {
        write("Robot1_Odometry.dat", odometry);
        write("Robot1_Measurement.dat", sightings);
        let output = cairn(&["ekf", folder.to_str().unwrap(), "--json"]);
        let notes =
            json(&output)["notes"].as_array().unwrap().iter().map(ToString::to_string).collect::<Vec<_>>();
        notes.join("; ")
    };
    assert_eq!(robot(&odometry, &sightings), "");
    // Before and in the last value of a line.
    let cut = |text: &str, part: f64| text[..(text.len() as f64 * part) as usize].rfind('\t').unwrap();
    let torn = robot(&odometry[..cut(&odometry, 0.5)], &sightings);
    assert!(
        torn.contains("Robot1_Odometry.dat: breaks off in line") && torn.contains("without odometry"),
        "{torn}"
    );
    let torn = robot(&odometry, &sightings[..cut(&sightings, 0.5)]);
    assert!(torn.contains("Robot1_Measurement.dat: breaks off in line 9"), "{torn}");
    assert!(torn.contains("no sighting after 30.0 s of 59.9 s"), "{torn}");
    // A line in the middle that lacks a value is no torn end.
    write("Robot1_Odometry.dat", &odometry.replacen("\t0.0\n", "\n", 1));
    fails(
        &["ekf", folder.to_str().unwrap()],
        &["Robot1_Odometry.dat, line 1", "angular velocity is missing"],
    );
    std::fs::remove_dir_all(&folder).unwrap();
}
