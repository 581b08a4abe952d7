//! `cairn doctor`.

use crate::binary::{cairn, json, stderr, stdout};
use std::process::Command;

#[test]
fn doctor_text_and_json_agree() {
    let text = cairn(&["doctor"]);
    assert_eq!(text.status.code(), Some(0), "{}", stderr(&text));
    assert!(stdout(&text).contains("cores"), "{}", stdout(&text));
    let report = json(&cairn(&["doctor", "--json"]));
    assert!(report["cores"].as_u64().is_some_and(|n| n >= 1), "{report}");
    assert!(stdout(&text).contains(report["version"].as_str().expect("a version")));
}

#[test]
fn doctor_reports_the_given_data_folder() {
    let output = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["doctor", "--json"])
        .env("CAIRN_DATA", "/nowhere/at/all")
        .output()
        .expect("the binary starts");
    let report = json(&output);
    assert_eq!(report["data"]["path"], "/nowhere/at/all");
    assert_eq!(report["data"]["present"], false);
}
