//! Layering: every crate depends only on crates of lower floors, checked with `cargo metadata`.
//!
//! Normal, build and dev dependencies all count. A crate that is not in the table fails the test, so that a new
//! crate is assigned a floor (here and in ARCHITECTURE.md) first.

use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Each floor with its packages; ARCHITECTURE.md has the same table.
const FLOORS: &[(u8, &[&str])] = &[
    (0, &["cairn-random", "cairn-settings-derive"]),
    (1, &["cairn-files", "cairn-geometry", "cairn-phrases", "cairn-rerun", "cairn-settings"]),
    (2, &["cairn-solve", "cairn-sensor", "cairn-eval", "cairn-view"]),
    (3, &["cairn-vision", "cairn-sim", "cairn-inertial", "cairn-bag"]),
    (4, &["cairn-sources", "cairn-atlas", "cairn-filter"]),
    (5, &["cairn-adjust", "cairn-dense", "cairn-plan", "cairn-guide"]),
    (6, &["cairn-tracking", "cairn-mapping", "cairn-lens", "cairn-voice"]),
    (7, &["cairn-team"]),
    (8, &["cairn-engine", "cairn-wire"]),
    (9, &["cairn-trial"]),
    (10, &["cairn-session"]),
    (11, &["cairn-phone", "cairn-web", "cairn-workers"]),
    (12, &["cairn"]),
    (13, &["cairn-fleet"]),
    (14, &["cairn-cli", "cairn-faults", "cairn-house", "cairn-python", "cairn-ros", "bench"]),
];

fn workspace_root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// Each package of the workspace with its dependencies inside the workspace.
fn packages() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1", "--offline"])
        .current_dir(workspace_root())
        .output()
        .expect("cargo metadata starts");
    assert!(output.status.success(), "cargo metadata: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata gives JSON");
    let of = |package: &Value| {
        let name = package["name"].as_str().expect("a package has a name").to_owned();
        let inside = package["dependencies"].as_array().expect("a package lists dependencies").iter();
        // Path dependencies are those inside the workspace; a crate that names itself sets its own features for its tests.
        let inside = inside.filter(|d| d["path"].is_string() && d["name"] != package["name"]);
        (name, inside.filter_map(|d| d["name"].as_str().map(str::to_owned)).collect())
    };
    metadata["packages"].as_array().expect("packages").iter().map(of).collect()
}

fn floor_of(package: &str) -> Option<u8> {
    FLOORS.iter().find(|(_, names)| names.contains(&package)).map(|&(floor, _)| floor)
}

/// Violations of the rule, one line each.
fn violations(packages: &BTreeMap<String, Vec<String>>) -> Vec<String> {
    let mut lines = Vec::new();
    for (name, dependencies) in packages {
        let Some(floor) = floor_of(name) else {
            lines.push(format!("{name} has no floor: add it to the table"));
            continue;
        };
        for dependency in dependencies {
            match floor_of(dependency) {
                Some(below) if below < floor => {}
                Some(other) => {
                    lines.push(format!("{name} (floor {floor}) imports {dependency} (floor {other})"));
                }
                None => lines.push(format!("{name} imports {dependency}, which has no floor")),
            }
        }
    }
    lines
}

#[test]
fn every_crate_imports_only_from_lower_floors() {
    let packages = packages();
    assert!(packages.contains_key("cairn-geometry"), "metadata found no workspace: {packages:?}");
    let lines = violations(&packages);
    assert!(lines.is_empty(), "{}", lines.join("\n"));
}

#[test]
fn sibling_unknown_and_upward_imports_are_violations() {
    let wrong = |name: &str, dependency: &str| {
        violations(&BTreeMap::from([(name.to_owned(), vec![dependency.to_owned()])])).len()
    };
    assert_eq!(wrong("cairn-sensor", "cairn-geometry"), 0);
    assert_eq!(wrong("cairn-sensor", "cairn-eval"), 1, "same floor");
    assert_eq!(wrong("cairn-sensor", "cairn-engine"), 1, "upwards");
    assert_eq!(wrong("cairn-sensor", "cairn-utils"), 1, "unknown dependency");
    assert_eq!(wrong("cairn-utils", "cairn-geometry"), 1, "unknown crate");
}

/// Crates that run in a terminal, on a page and in a simulator on virtual time: they are given a clock and threads
/// (`cairn_sensor::Host`).
const GIVEN_A_HOST: &[&str] = &[
    "geometry", "phrases", "solve", "sensor", "vision", "inertial", "atlas", "adjust", "dense", "guide",
    "plan", "tracking", "mapping", "lens", "team", "engine",
];

/// Lines of a source, up to its tests, that take time or a thread from the standard library; threads that end with the call
/// that began them (`thread::scope`) only divide work, and are not among them.
fn taken_from_the_machine(source: &str) -> Vec<&str> {
    let taken = ["Instant::now", "SystemTime::now", "thread::spawn", "thread::Builder", "thread::sleep"];
    let code = source.lines().take_while(|line| line.trim() != "#[cfg(test)]");
    code.filter(|line| taken.iter().any(|word| line.contains(word))).collect()
}

#[test]
fn clocks_and_threads_come_from_the_host() {
    let mut files = 0;
    for name in GIVEN_A_HOST {
        let mut folders = vec![workspace_root().join("crates").join(name).join("src")];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).expect("a folder of sources") {
                let path = entry.expect("an entry").path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|e| e == "rs") {
                    files += 1;
                    let source = std::fs::read_to_string(&path).expect("a source file");
                    let lines = taken_from_the_machine(&source);
                    assert!(lines.is_empty(), "{}: {lines:?}", path.display());
                }
            }
        }
    }
    assert!(files > 200, "only {files} files were read");
    let both =
        "let a = Instant::now();\nstd::thread::spawn(work);\n#[cfg(test)]\nmod tests { Instant::now() }";
    assert_eq!(taken_from_the_machine(both).len(), 2);
}

#[test]
fn architecture_page_has_the_same_floors() {
    let page = std::fs::read_to_string(workspace_root().join("ARCHITECTURE.md")).expect("ARCHITECTURE.md");
    for (floor, names) in FLOORS {
        let rows: String = page.lines().filter(|line| line.starts_with(&format!("| {floor} |"))).collect();
        assert!(!rows.is_empty(), "ARCHITECTURE.md has no row for floor {floor}");
        for name in *names {
            let folder = name.strip_prefix("cairn-").unwrap_or(name);
            assert!(
                rows.contains(&format!("`{folder}`")),
                "floor {floor} in ARCHITECTURE.md does not name {folder}: {rows}"
            );
        }
    }
}

#[test]
fn facade_page_has_the_same_floors() {
    let page = std::fs::read_to_string(workspace_root().join("crates/cairn/src/lib.rs")).expect("the facade");
    let mut seen = 0;
    for line in page.lines().filter_map(|line| line.strip_prefix("//! | ")) {
        let mut cells = line.split(" | ");
        let (Some(Ok(floor)), Some(module)) = (cells.next().map(str::parse::<u8>), cells.next()) else {
            continue;
        };
        let package = match module {
            "this one" => "cairn".to_owned(),
            module => format!("cairn-{}", module.trim_matches(|c| "[`]".contains(c))),
        };
        assert_eq!(floor_of(&package), Some(floor), "{line}");
        seen += 1;
    }
    assert!(seen > 10, "only {seen} modules were found");
}
