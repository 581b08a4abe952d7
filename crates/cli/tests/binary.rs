//! The binary as a user meets it: exit codes, one-line errors that name the cure, JSON that is JSON.

use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Output};

fn cairn(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cairn")).args(arguments).output().expect("the binary starts")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[track_caller]
fn json(output: &Output) -> Value {
    let text = stdout(output);
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("stdout is not JSON ({e}): {text}"))
}

#[test]
fn wrong_usage_is_code_2_and_help_is_code_0() {
    for wrong in [&[][..], &["fly"], &["doctor", "--wings"]] {
        let output = cairn(wrong);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
        assert!(stderr(&output).contains("Usage"), "{wrong:?}: {}", stderr(&output));
    }
    for right in [&["--help"][..], &["--version"], &["doctor", "--help"]] {
        let output = cairn(right);
        assert_eq!(output.status.code(), Some(0), "{right:?}");
        assert!(output.stderr.is_empty(), "{right:?}");
    }
}

#[test]
fn every_command_in_the_help_has_help_with_json() {
    let help = stdout(&cairn(&["--help"]));
    let listed =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names: Vec<&str> = listed.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.contains(&"doctor"), "{help}");
    for name in names.iter().filter(|name| **name != "help") {
        let output = cairn(&[name, "--help"]);
        assert_eq!(output.status.code(), Some(0), "{name}");
        assert!(stdout(&output).contains("--json"), "{name} --help: {}", stdout(&output));
    }
}

#[test]
fn doctor_tells_the_same_in_text_and_json() {
    let text = cairn(&["doctor"]);
    assert_eq!(text.status.code(), Some(0), "{}", stderr(&text));
    assert!(stdout(&text).contains("cores"), "{}", stdout(&text));
    let report = json(&cairn(&["doctor", "--json"]));
    assert!(report["cores"].as_u64().is_some_and(|n| n >= 1), "{report}");
    assert!(stdout(&text).contains(report["version"].as_str().expect("a version")));
}

#[test]
fn doctor_names_the_data_folder_it_was_given() {
    let output = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["doctor", "--json"])
        .env("CAIRN_DATA", "/nowhere/at/all")
        .output()
        .expect("the binary starts");
    let report = json(&output);
    assert_eq!(report["data"]["path"], "/nowhere/at/all");
    assert_eq!(report["data"]["present"], false);
}

/// A fresh folder for one test.
fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("cairn-cli-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&path).expect("a temporary folder");
    path
}

/// Code 1, nothing on stdout, and one line on stderr that names the file, holds these words, and ends in a hint.
#[track_caller]
fn fails(arguments: &[&str], words: &[&str]) {
    let output = cairn(arguments);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {text}");
    assert!(output.stdout.is_empty(), "{arguments:?}: {}", stdout(&output));
    assert_eq!(text.lines().count(), 1, "{arguments:?}: {text}");
    assert!(text.starts_with("error: ") && text.contains("; hint: "), "{arguments:?}: {text}");
    for word in words {
        assert!(text.contains(word), "{arguments:?}: no '{word}' in: {text}");
    }
}

/// A square of five poses a side, in TUM form, moved by `x` and with its last pose off by `off`.
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
    assert_eq!((&result["pairs"], &result["coverage"]), (&20.into(), &1.0.into()));
    let raw = json(&cairn(&["eval", truth, guess, "--align", "none", "--json"]));
    assert!((raw["ate_m"]["mean"].as_f64().unwrap() - 7.0).abs() < 0.01, "{raw}");
    let text = stdout(&cairn(&["eval", truth, guess, "--delta", "2s"]));
    assert!(text.contains(&format!("ATE       {rmse:.6} m RMSE")) && text.contains("over 2s"), "{text}");
    assert_eq!(cairn(&["eval", truth, guess, "--align", "sideways"]).status.code(), Some(2));
    assert_eq!(cairn(&["eval", truth]).status.code(), Some(2));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn eval_tells_what_is_wrong_with_a_file() {
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
fn rig_check_says_what_a_rig_is_and_writes_it_back() {
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
fn rig_check_refuses_what_can_not_be() {
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
