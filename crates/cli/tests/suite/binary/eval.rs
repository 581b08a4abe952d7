//! `cairn eval`.

use crate::binary::{cairn, fails, folder, json, stdout};

/// A square with five poses per side in TUM format, shifted by `x`, its last pose displaced by `off`.
fn square(x: f64, off: f64) -> String {
    let mut text = String::from("# t x y z qx qy qz qw\n");
    for i in 0..20 {
        let along = f64::from(i % 5);
        let [px, py] = [[along, 0.0], [5.0, along], [5.0 - along, 5.0], [0.0, 5.0 - along]][i as usize / 5];
        let off = if i == 19 { off } else { 0.0 };
        text += &format!("{}.5 {} {} 0 0 0 0 1\n", 100 + i, px + x, py + off);
    }
    text
}

#[test]
fn eval_prints_figures_in_text_and_json() {
    let folder = folder("eval");
    let (truth, guess) = (folder.join("truth.txt"), folder.join("guess.txt"));
    std::fs::write(&truth, square(0.0, 0.0)).unwrap();
    std::fs::write(&guess, square(7.0, 0.1)).unwrap();
    let (truth, guess) = (truth.to_str().unwrap(), guess.to_str().unwrap());
    let result = json(&cairn(&["eval", truth, guess, "--json"]));
    let rmse = result["ate_m"]["rmse"].as_f64().unwrap();
    assert!(rmse > 0.001 && rmse < 0.1 / 20f64.sqrt(), "{result}");
    assert_eq!((&result["pairs"], &result["reference_covered"]), (&20.into(), &1.0.into()));
    let raw = json(&cairn(&["eval", truth, guess, "--align", "none", "--json"]));
    assert!((raw["ate_m"]["mean"].as_f64().unwrap() - 7.0).abs() < 0.01, "{raw}");
    let text = stdout(&cairn(&["eval", truth, guess, "--delta", "2s"]));
    assert!(text.contains(&format!("ATE       {rmse:.6} m RMSE")) && text.contains("over 2s"), "{text}");
    assert_eq!(cairn(&["eval", truth, guess, "--align", "sideways"]).status.code(), Some(2));
    assert_eq!(cairn(&["eval", truth]).status.code(), Some(2));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn eval_reports_errors_in_files() {
    let folder = folder("eval-wrong");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let good = write("good.txt", &square(0.0, 0.0));
    let broken = write("broken.txt", "1 0 0 0 0 0 0 1\n2 0 0 zero 0 0 0 1\n");
    let later = write("later.txt", "900 0 0 0 0 0 0 1\n901 1 0 0 0 0 0 1\n902 1 1 0 0 0 0 1\n");
    fails(&["eval", "/no/truth.txt", &good], &["/no/truth.txt"]);
    fails(&["eval", &good, &broken], &["broken.txt, line 2", "zero"]);
    fails(&["eval", &good, &write("empty.txt", "")], &["empty.txt"]);
    fails(&["eval", &good, &later], &["later.txt", "within 0.01 s", "--max-difference"]);
    fails(&["eval", &good, &good, "--max-difference=-1"], &["--max-difference"]);
    let output = cairn(&["eval", &good, &later, "--json"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(json(&output)["error"]["hint"].is_string());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_a_run_prints_is_the_error_of_its_own_files() {
    let data = std::env::var_os("CAIRN_DATA").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        std::path::PathBuf::from,
    );
    let (euroc, kitti, kitchen) =
        (data.join("euroc-mh01"), data.join("kitti-a"), data.join("7scenes-kitchen"));
    if !euroc.is_dir() {
        assert!(std::env::var("CI").is_err(), "recordings are missing");
        println!("skipped: no folder {}", euroc.display());
        return;
    }
    let folder = folder("eval-run");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let error_of = |evaluated: &serde_json::Value| evaluated["ate_m"]["rmse"].as_f64().unwrap();
    for (recording, sensor, frame, metric) in [
        (&euroc, "mono", "body", false),
        (&euroc, "mono-imu", "body", true),
        (&euroc, "mono-imu", "cam0", true),
        (&euroc, "stereo", "body", true),
        (&euroc, "stereo", "cam0", true),
        (&kitti, "mono", "body", false),
        (&kitchen, "rgbd", "body", true),
    ] {
        let what = format!("{} {sensor} {frame}", recording.display());
        let recording = recording.to_str().unwrap();
        let (last, live, moved) = (path("last.tum"), path("live.tum"), path("moved.tum"));
        let report = json(&cairn(&[
            "run",
            recording,
            "--sensor",
            sensor,
            "--frame",
            frame,
            "--frames",
            "150",
            "--trajectory",
            &last,
            "--live-trajectory",
            &live,
            "--overwrite",
            "--json",
        ]));
        let printed = error_of(&report["accuracy"]);
        let evaluated =
            json(&cairn(&["eval", recording, &last, "--reference-out", &moved, "--overwrite", "--json"]));
        assert!((error_of(&evaluated) - printed).abs() < 1e-6, "{what}: {printed} against {evaluated}");
        assert_eq!(evaluated["align"], if metric { "se3" } else { "sim3" }, "{what}");
        assert_eq!(evaluated["coverage"], report["coverage"], "{what}");
        let told = report["live"]["ate_m"].as_f64().unwrap();
        let evaluated = json(&cairn(&["eval", recording, &live, "--json"]));
        assert!((error_of(&evaluated) - told).abs() < 1e-6, "{what}: live {told} against {evaluated}");
        // Programs that know nothing of the header are given the reference as it was compared.
        let plain = path("plain.tum");
        let text = std::fs::read_to_string(&last).unwrap();
        let at_camera = !metric || frame == "cam0";
        let name = if at_camera { "cam0" } else { "body" };
        assert!(text.starts_with(&format!("# frame: {name}\n")), "{what}: {}", &text[..200]);
        let poses: Vec<&str> = text.lines().filter(|l| !l.starts_with('#')).collect();
        std::fs::write(&plain, poses.join("\n")).unwrap();
        let align = if metric { "se3" } else { "sim3" };
        let evaluated = json(&cairn(&["eval", &moved, &plain, "--align", align, "--json"]));
        assert!((error_of(&evaluated) - printed).abs() < 1e-6, "{what}: {printed} against {evaluated}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
