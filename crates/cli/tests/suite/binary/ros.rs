//! `cairn ros`, which becomes another program.

#![cfg(unix)]

use crate::binary::{folder, stderr, stdout};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

#[test]
fn the_node_gets_all_arguments_and_is_missed_with_a_hint() {
    let folder = folder("ros");
    // A copy: what is built beside the program itself is not looked at.
    let copy = folder.join("cairn");
    std::fs::copy(env!("CARGO_BIN_EXE_cairn"), &copy).unwrap();
    let run = |path: &Path| -> Output {
        let mut command = Command::new(&copy);
        command.args(["ros", "--camera", "stereo", "--ros-args", "-r", "odom:=/vo", "--help-me"]);
        command.env("PATH", path).output().unwrap()
    };
    let missing = run(Path::new("/nowhere"));
    let words = stderr(&missing);
    assert_eq!(missing.status.code(), Some(1), "{words}");
    assert!(words.contains("cairn-ros is not installed; hint: cargo install --path crates/ros"), "{words}");
    for place in [folder.join("elsewhere"), folder.clone()] {
        std::fs::create_dir_all(&place).unwrap();
        let node = place.join("cairn-ros");
        std::fs::write(&node, "#!/bin/sh\necho \"$@\"\nexit 7\n").unwrap();
        std::fs::set_permissions(&node, std::fs::Permissions::from_mode(0o755)).unwrap();
        let output = run(&place);
        assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
        assert_eq!(stdout(&output), "--camera stereo --ros-args -r odom:=/vo --help-me\n");
    }
    std::fs::remove_dir_all(folder).unwrap();
}
