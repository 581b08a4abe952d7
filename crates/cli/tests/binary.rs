//! The binary as a user meets it: exit codes, one-line errors that name the cure, JSON that is JSON.

use serde_json::Value;
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
