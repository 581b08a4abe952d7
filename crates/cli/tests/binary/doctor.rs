//! `cairn doctor`.

use crate::{cairn, json, stderr, stdout};
use std::process::Command;

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
