//! The demo on a shortened route, end to end: images, map, route, announcements, walker.

use super::{cairn, fails, folder, json, stderr, stdout};

/// Rendering and tracking several hundred frames takes minutes without optimisation.
fn too_slow() -> bool {
    let slow = cfg!(debug_assertions);
    if slow {
        println!("skipped: the demo is tested with --release");
    }
    slow
}

#[test]
fn walker_is_guided_back_and_report_lists_announcements() {
    if too_slow() {
        return;
    }
    let out = folder("demo");
    let out_name = out.to_str().unwrap();
    let output = cairn(&["demo", "--metres", "17", "--seed", "1", "--out", out_name, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(output.stderr.is_empty(), "no terminal, no progress: {}", stderr(&output));
    let result = json(&output);
    let number = |name: &str| result[name].as_f64().unwrap_or(f64::NAN);
    assert_eq!(result["arrived"], true, "{result:#}");
    assert!(number("arrival_error_m") <= 1.0 && number("walked_home_m") > 14.0, "{result:#}");
    assert!((number("cleaned_m") - 17.0).abs() < 1.0 && number("turns") == 1.0, "{result:#}");
    assert!(number("ate_m") < 0.2 && number("coverage") > 0.99, "{result:#}");
    let said: Vec<&str> =
        result["said"].as_array().unwrap().iter().filter_map(|line| line["words"].as_str()).collect();
    assert_eq!(said[0], "Guidance begins.");
    assert!(
        said[1].starts_with("Turn around. ") && said.iter().any(|w| w.contains("Turn right now")),
        "{said:?}"
    );
    assert_eq!(said.last(), Some(&"Stop. You have arrived. Guidance ends."));

    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let report = read("report.html");
    assert!(said.iter().all(|words| report.contains(words)), "the report lists every announcement");
    assert!(report.contains("<svg") && !report.contains("<script") && !report.contains("src="));
    assert!(read("plan.svg").contains("</svg>"));
    assert_eq!(read("transcript.txt").lines().count(), said.len());

    // The written files agree with the figures.
    let path = |name: &str| out.join(name).to_str().unwrap().to_owned();
    let evaluated = json(&cairn(&["eval", &path("truth.tum"), &path("estimate.tum"), "--json"]));
    let ate_m = evaluated["ate_m"]["rmse"].as_f64().unwrap();
    assert!((ate_m - number("ate_m")).abs() < 1e-6, "{ate_m}");
    let route = stdout(&cairn(&["route", "info", &path("demo.route")]));
    assert!(route.contains("1 turns"), "{route}");
    std::fs::remove_dir_all(out).unwrap();
}

#[test]
fn one_camera_after_a_turn_stops_with_the_reason_and_misleads_nobody() {
    if too_slow() {
        return;
    }
    let out = folder("demo-mono-turn");
    let args = [
        "demo",
        "--sensor",
        "mono",
        "--metres",
        "12",
        "--seed",
        "1",
        "--out",
        out.to_str().unwrap(),
        "--json",
    ];
    let output = cairn(&args);
    let result: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("demo.json")).unwrap()).unwrap();
    assert_eq!((&result["misled"], &result["metric"]), (&false.into(), &false.into()), "{result:#}");
    // Turned about on the spot, nothing seen before is in view: its scale is unknown, so there are no directions.
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let reason = result["stopped"].as_str().unwrap_or_default();
    assert!(reason.starts_with("I cannot judge distances"), "{result:#}");
    let said: Vec<&str> =
        result["said"].as_array().unwrap().iter().filter_map(|line| line["words"].as_str()).collect();
    let stop = said.iter().position(|words| words.starts_with("Stop. I cannot judge distances"));
    let after = &said[stop.expect("it is said")..];
    assert!(after.iter().all(|words| words.starts_with("Stop.")), "no direction after that: {after:?}");
    std::fs::remove_dir_all(out).unwrap();
}

/// By seed 6 the walker stood forever after his turn, before scale was regained where the old view comes back.
#[test]
fn one_camera_leads_home_backwards_or_looking_back_and_with_an_imu_facing_home() {
    if too_slow() {
        return;
    }
    for [sensor, facing, metres, seed] in
        [["mono", "backwards", "14", "1"], ["mono", "back", "10", "6"], ["mono-imu", "home", "14", "1"]]
    {
        let out = folder(&format!("demo-{sensor}-{facing}"));
        let args = ["--sensor", sensor, "--facing", facing, "--metres", metres, "--seed", seed, "--json"];
        let args = [&["demo"], &args[..]].concat();
        let output = cairn(&[&args[..], &["--out", out.to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(0), "{sensor}: {}", stderr(&output));
        let result = json(&output);
        assert_eq!(result["arrived"], true, "{result:#}");
        assert_eq!((&result["misled"], &result["metric"]), (&false.into(), &(sensor == "mono-imu").into()));
        std::fs::remove_dir_all(out).unwrap();
    }
}

#[test]
fn impossible_folder_and_wrong_arguments_are_errors() {
    let file = folder("demo-file").join("file");
    std::fs::write(&file, "").unwrap();
    fails(&["demo", "--out", file.join("inside").to_str().unwrap()], &["inside", "--out"]);
    for wrong in [&["--metres", "2"][..], &["--metres", "nan"], &["--seeds", "0"], &["--facing", "up"]] {
        let output = cairn(&[&["demo"], wrong].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
    }
}
