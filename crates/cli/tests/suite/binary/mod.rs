//! The binary as a user sees it: exit codes, one-line errors with a hint, valid JSON.

mod bag;
mod bench;
mod config;
mod demo;
mod doctor;
mod ekf;
mod elsewhere;
mod ends;
mod eval;
mod fleet;
mod foxglove;
mod isolated;
mod map;
mod outputs;
mod page;
mod photogrammetry;
mod plan;
mod rig;
mod ros;
mod route;
mod run;
mod serving;
mod sim;
mod solve;
mod team;
mod view;
mod vocab;
mod walk;

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
fn wrong_usage_exits_with_2_and_help_with_0() {
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
fn every_listed_command_has_help_and_json() {
    let help = stdout(&cairn(&["--help"]));
    // The lines of all groups: a name, and after at least two spaces what it does.
    let listed =
        help.lines().take_while(|line| *line != "Options:").filter_map(|line| line.strip_prefix("  "));
    let names: Vec<&str> = listed.filter_map(|line| line.split_whitespace().next()).collect();
    for name in ["run", "demo", "doctor", "completions", "map", "view", "ekf", "team", "fleet"] {
        assert!(names.contains(&name), "{name}: {help}");
    }
    assert_eq!(names.len(), 22, "{help}");
    for name in names.iter().filter(|name| **name != "help") {
        let output = cairn(&[name, "--help"]);
        assert_eq!(output.status.code(), Some(0), "{name}");
        assert!(stdout(&output).contains("--json"), "{name} --help: {}", stdout(&output));
    }
}

/// A fresh folder for one test.
fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("cairn-cli-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&path).expect("a temporary folder");
    path
}

/// Asserts exit code 1, nothing on stdout, and one line on stderr that contains these words and a hint.
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
