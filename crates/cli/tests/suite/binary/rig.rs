//! `cairn rig check`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};

const RIG: &str = r#"
[[cameras]]
name = "left"
resolution = [640, 480]
focal = [420.0, 420.0]
centre = [319.5, 239.5]
distortion = { model = "radial-tangential", coefficients = [-0.2, 0.05, 0.0, 0.0] }

[[cameras]]
resolution = [640, 480]
focal = [420.0, 420.0]
centre = [319.5, 239.5]
body_from_camera = { translation_m = [0.12, 0.0, 0.0] }
"#;

#[test]
fn rig_check_summarises_and_rewrites_a_rig() {
    let folder = folder("rig");
    let (path, copy) = (folder.join("rig.toml"), folder.join("copy.toml"));
    std::fs::write(&path, RIG).unwrap();
    let (path, copy) = (path.to_str().unwrap(), copy.to_str().unwrap());
    let text = cairn(&["rig", "check", path, "--write", copy]);
    assert_eq!(text.status.code(), Some(0), "{}", stderr(&text));
    assert!(stdout(&text).contains("baseline 0.1200 m"), "{}", stdout(&text));
    let first = json(&cairn(&["rig", "check", path, "--json"]));
    assert_eq!(first, json(&cairn(&["rig", "check", copy, "--json"])), "what was written is the same rig");
    assert_eq!(first["cameras"][0]["name"], "left");
    let degrees = first["cameras"][1]["field_of_view_deg"][0].as_f64().unwrap();
    assert!((degrees - 2.0 * (319.5f64 / 420.0).atan().to_degrees()).abs() < 1e-6, "{degrees}");
    assert!(first["cameras"][0]["round_trip_px"].as_f64().unwrap() < 1e-6);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn rig_check_rejects_impossible_rigs() {
    let folder = folder("rig-wrong");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    fails(&["rig", "check", "/no/rig.toml"], &["/no/rig.toml"]);
    fails(&["rig", "check", folder.to_str().unwrap()], &["holds no rig"]);
    fails(
        &["rig", "check", &write("nan.toml", &RIG.replace("420.0, 420.0", "nan, 420.0"))],
        &["nan.toml", "NaN"],
    );
    fails(&["rig", "check", &write("line.toml", &RIG.replace("[319.5", "[;"))], &["line.toml, line 6"]);
    fails(&["rig", "check", &write("one.toml", &RIG.replace("0.12", "0.0"))], &["no baseline"]);
    let good = write("good.toml", RIG);
    let nowhere = folder.join("none/out.toml");
    fails(&["rig", "check", &good, "--write", nowhere.to_str().unwrap()], &["none/out.toml"]);
    assert_eq!(cairn(&["rig"]).status.code(), Some(2));
    std::fs::remove_dir_all(&folder).unwrap();
}

const IMU: &str = "
[imu]
rate_hz = 200.0
gyro_noise = 1.7e-4
gyro_walk = 1.9e-5
accel_noise = 2.0e-3
accel_walk = 3.0e-3
";

#[test]
fn rig_check_warns_about_unlikely_imu_parameters() {
    let folder = folder("rig-imu");
    let write = |name: &str, from: &str, to: &str| {
        let path = folder.join(name);
        std::fs::write(&path, RIG.to_owned() + &IMU.replace(from, to)).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let good = json(&cairn(&["rig", "check", &write("good.toml", "", ""), "--json"]));
    assert_eq!(good["warnings"].as_array().unwrap().len(), 0, "{good}");
    let warns = |name: &str, from: &str, to: &str, words: &[&str]| {
        let output = cairn(&["rig", "check", &write(name, from, to)]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let text = stdout(&output);
        assert!(text.contains("warning: ") && words.iter().all(|w| text.contains(w)), "{text}");
    };
    warns("slow.toml", "200.0", "50.0", &["50 samples per second"]);
    warns("noise.toml", "2.0e-3", "0.8", &["accel noise 8e-1"]);
    warns("swapped.toml", "1.7e-4", "9e-3", &["exchanged"]);
    warns("late.toml", "rate_hz", "offset_s = 0.25\nrate_hz", &["+0.250 s"]);
    fails(&["rig", "check", &write("no.toml", "1.9e-5", "7.0")], &["gyro walk 7e0 is impossible"]);
    fails(&["rig", "check", &write("zero.toml", "1.7e-4", "0.0")], &["gyro noise 0 is not a positive"]);
    fails(
        &["rig", "check", &write("ms.toml", "rate_hz", "offset_s = 25.0\nrate_hz")],
        &["is the unit seconds?"],
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn rig_check_examines_a_recording() {
    let folder = folder("rig-with");
    let out = folder.join("walk");
    let made = cairn(&[
        "sim",
        "sim:corridor?resolution=64x48&sensor=mono-imu&start=14&duration=10&rate=5",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let check = |rig: &str| cairn(&["rig", "check", rig, "--with", out.to_str().unwrap(), "--json"]);
    let rig = out.to_str().unwrap();
    let good = json(&check(rig));
    assert_eq!(good["warnings"].as_array().unwrap().len(), 0, "{good}");
    assert!((good["readings"]["rate_hz"].as_f64().unwrap() - 200.0).abs() < 0.5, "{good}");
    // The same recording with a gyroscope in degrees and an accelerometer in g.
    let path = out.join("mav0/imu0/data.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let scaled = text.lines().map(|line| {
        let numbers: Option<Vec<f64>> = line.split(',').map(|f| f.parse().ok()).collect();
        match numbers.as_deref() {
            Some([_, gyro @ .., a, b, c]) if gyro.len() == 3 => {
                let stamp = line.split(',').next().unwrap();
                let gyro: Vec<String> = gyro.iter().map(|g| (g * 57.3).to_string()).collect();
                format!("{stamp},{},{},{},{}\n", gyro.join(","), a / 9.81, b / 9.81, c / 9.81)
            }
            _ => format!("{line}\n"),
        }
    });
    std::fs::write(&path, scaled.collect::<String>()).unwrap();
    let bad = json(&check(rig))["warnings"].to_string();
    assert!(bad.contains("is it in degrees?") && bad.contains("is it in g?"), "{bad}");
    // IMU stamps from another clock.
    let moved = text.lines().map(|line| match line.split_once(',') {
        Some((stamp, rest)) if !line.starts_with('#') => {
            format!("{},{rest}\n", stamp.parse::<i64>().unwrap() + 90_000_000_000)
        }
        _ => format!("{line}\n"),
    });
    std::fs::write(&path, moved.collect::<String>()).unwrap();
    let apart = json(&check(rig))["warnings"].to_string();
    assert!(apart.contains("the clocks are apart"), "{apart}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_calibration_that_states_no_rate_of_the_imu_says_which_is_taken() {
    let folder = folder("rig-rate");
    let out = folder.join("walk");
    let out = out.to_str().unwrap();
    let world = "sim:corridor?resolution=64x48&sensor=mono-imu&start=14&duration=1&rate=5";
    assert_eq!(cairn(&["sim", world, "--out", out]).status.code(), Some(0));
    let file = folder.join("vins.yaml");
    let camera = "%YAML:1.0\nmodel_type: PINHOLE\nimage_width: 64\nimage_height: 48\ndistortion_parameters:\n   k1: 0\n   k2: 0\n   \
                  p1: 0\n   p2: 0\nprojection_parameters:\n   fx: 40\n   fy: 40\n   cx: 31.5\n   cy: 23.5\n";
    let matrix = |rows: &str, cols: &str, data: &str| {
        format!("!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [{data}]\n")
    };
    let rotation = matrix("3", "3", "0, 0, 1, -1, 0, 0, 0, -1, 0");
    let noise = "acc_n: 0.1\ngyr_n: 0.01\nacc_w: 0.001\ngyr_w: 0.0001\n";
    let arm = matrix("3", "1", "0, 0, 0");
    let text = format!("{camera}extrinsicRotation: {rotation}extrinsicTranslation: {arm}{noise}");
    std::fs::write(&file, text).unwrap();
    let file = file.to_str().unwrap();
    let says = "vins.yaml states no rate of the IMU: 200 samples a second are taken";
    let run = cairn(&["run", out, "--rig", file, "--frames", "3"]);
    assert!(stderr(&run).contains(says), "{}", stderr(&run));
    let checked = json(&cairn(&["rig", "check", file, "--json"]));
    assert!(checked["warnings"].to_string().contains("states no rate of the IMU"), "{checked}");
    std::fs::remove_dir_all(&folder).unwrap();
}
