//! Runs every example, and checks what it prints. `cargo test` builds the examples of the package beforehand.

use std::path::PathBuf;
use std::process::Command;

/// Each example with its arguments, and what it must print.
const EXAMPLES: [(&str, &[&str], &str); 7] = [
    ("track_euroc", &[], ""),
    ("own_camera", &[], "121 frames tracked"),
    ("save_load_relocalise", &[], "unchanged true"),
    ("map_changes", &[], "equal: true"),
    ("record_and_guide", &[], "arrived   true"),
    ("own_factor", &[], "scale     "),
    ("solve_pose_graph", &[], "Converged"),
];

/// `target/PROFILE/examples`, from the path of this test in `target/PROFILE/deps`.
fn folder() -> PathBuf {
    let test = std::env::current_exe().expect("the test has a path");
    let profile = test.parent().and_then(|deps| deps.parent()).expect("target/PROFILE/deps");
    profile.join("examples")
}

/// The standard output of an example, which must end well.
fn run(name: &str, arguments: &[&str]) -> String {
    let program = folder().join(name).with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.exists(), "{} is not built: cargo build --examples, in this profile", program.display());
    let output = Command::new(&program).args(arguments).output().expect("it starts");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{name}: {}\n{out}{err}", output.status);
    out.into_owned()
}

fn recording() -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from).join("euroc-mh01")
}

#[test]
fn every_example_is_in_the_list() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/examples");
    let files = std::fs::read_dir(folder).expect("examples").map(|e| e.expect("an entry").path());
    let mut found: Vec<String> =
        files.filter_map(|p| Some(p.file_stem()?.to_string_lossy().into_owned())).collect();
    found.sort();
    let mut listed = EXAMPLES.map(|(name, ..)| name);
    listed.sort_unstable();
    assert_eq!(found, listed);
}

#[test]
fn examples_in_simulated_worlds_print_what_they_promise() {
    for (name, arguments, prints) in EXAMPLES.iter().filter(|(name, ..)| *name != "track_euroc") {
        let out = run(name, arguments);
        println!("== {name}\n{out}");
        assert!(out.contains(prints), "{name} does not print \"{prints}\":\n{out}");
    }
}

#[test]
fn euroc_example_tracks_the_recording() {
    let folder = recording();
    if !folder.is_dir() {
        println!("skipped: there is no recording in {}", folder.display());
        assert!(run("track_euroc", &["no such folder"]).starts_with("skipped: "));
        return;
    }
    let out = run("track_euroc", &[&folder.display().to_string(), "100"]);
    println!("{out}");
    assert!(out.contains("frames    100, 100 tracked"), "{out}");
    let ate = out.lines().find_map(|line| line.strip_prefix("ATE")).expect("the recording has truth");
    let metres: f64 = ate.split_whitespace().next().and_then(|word| word.parse().ok()).expect("a number");
    assert!(metres < 0.05, "{out}");
}
