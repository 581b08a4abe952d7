//! `cairn fleet`: a build in this process, a tile fetched from it and used, and what is told where something is missing.

use crate::binary::{cairn, folder, json, stderr};
use std::process::Command;

fn record(to: &std::path::Path, options: &str) {
    let world = format!("demo?seed=11&sensor=rgbd&resolution=320x240&focal=210&rate=10&{options}");
    let output = cairn(&["sim", &world, "--out", to.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn a_walk_is_built_fetched_by_place_and_localised_in() {
    let root = folder("fleet");
    let path = |name: &str| root.join(name).to_str().unwrap().to_owned();
    record(&root.join("recordings/a"), "duration=5");
    record(&root.join("recordings/b"), "start=1&duration=5&height=1.4");
    let build = || {
        cairn(&[
            "fleet",
            "build",
            &path("recordings"),
            "--out",
            &path("store"),
            "--overlap",
            "2",
            "--in-order",
            "--json",
        ])
    };
    let first = build();
    assert!(first.status.success(), "{}", stderr(&first));
    let first = json(&first);
    assert_eq!((&first["recordings"], first["atlases"].as_array().unwrap().len()), (&2.into(), 1), "{first}");
    let again = json(&build());
    assert_eq!(first["digest"], again["digest"]);
    assert_eq!(again["costs"][0]["reused"], 2);

    record(&root.join("c"), "start=2&duration=3&height=1.35");
    let fetch = |query: &str, out: &str| {
        cairn(&["fleet", "fetch", &path("store"), query, "--out", &path(out), "--json"])
    };
    let fetched = fetch(&path("c"), "tile.map");
    assert!(fetched.status.success(), "{}", stderr(&fetched));
    assert!(json(&fetched)["evidence"]["tracked"][0].as_u64().unwrap() > 15, "{}", json(&fetched));
    let run = cairn(&["run", &path("c"), "--map-in", &path("tile.map"), "--json"]);
    assert!(run.status.success(), "{}", stderr(&run));
    let image = std::fs::read_dir(root.join("c/rgb")).unwrap().next().unwrap().unwrap().path();
    let by_image = fetch(image.to_str().unwrap(), "other.map");
    assert!(json(&by_image)["evidence"]["seen"]["landmarks"].as_u64().unwrap() >= 25, "{}", json(&by_image));
    assert_eq!(json(&by_image)["tile"]["map"], json(&fetched)["tile"]["map"]);
    // Of another house, both the walk and an image of it are of an unknown place.
    let world = "demo?seed=12&sensor=rgbd&resolution=320x240&focal=210&rate=10&duration=3";
    assert!(cairn(&["sim", world, "--out", &path("d")]).status.success());
    let other = std::fs::read_dir(root.join("d/rgb")).unwrap().next().unwrap().unwrap().path();
    for query in [path("d"), other.to_str().unwrap().to_owned()] {
        let unknown = fetch(&query, "unknown.map");
        assert_eq!(unknown.status.code(), Some(3), "{}", stderr(&unknown));
        assert!(stderr(&unknown).contains("unknown place: at most"), "{}", stderr(&unknown));
        assert!(!root.join("unknown.map").exists());
    }
    let refused = fetch(&path("c"), "tile.map");
    assert!(!refused.status.success() && stderr(&refused).contains("--overwrite"), "{}", stderr(&refused));
    std::fs::remove_dir_all(&root).unwrap();
}

/// A driver that is left alone ends when its input does, as that of the Python package: this one says so.
#[cfg(unix)]
#[test]
fn a_driver_ends_with_the_program_that_started_it() {
    use std::os::unix::fs::PermissionsExt;
    let root = folder("fleet-killed");
    let (python, began, ended) = (root.join("python"), root.join("began"), root.join("ended"));
    let script = format!(
        "#!/bin/sh\n[ \"$1\" = -c ] && exit 0\necho >{}\ncat >/dev/null\necho >{}\n",
        began.display(),
        ended.display()
    );
    std::fs::write(&python, script).unwrap();
    std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mut build = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["fleet", "build", root.to_str().unwrap(), "--out", root.join("store").to_str().unwrap()])
        .env("CAIRN_PYTHON", &python)
        .spawn()
        .unwrap();
    let appears = |path: &std::path::Path, seconds: u32| {
        (0..20 * seconds).any(|_| {
            path.exists() || {
                std::thread::sleep(std::time::Duration::from_millis(50));
                false
            }
        })
    };
    assert!(appears(&began, 20), "the driver was not started");
    assert!(!appears(&ended, 1), "it ended while its program waits for it");
    build.kill().unwrap();
    build.wait().unwrap();
    assert!(appears(&ended, 20), "it goes on alone");
    std::fs::remove_dir_all(&root).unwrap();
}

#[test]
fn what_is_missing_is_told_with_a_cure() {
    let root = folder("fleet-missing");
    let (from, store) = (root.to_str().unwrap(), root.join("store"));
    let build = |python: &str| {
        let arguments = ["fleet", "build", from, "--out", store.to_str().unwrap()];
        Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args(arguments)
            .env("CAIRN_PYTHON", python)
            .output()
            .unwrap()
    };
    for python in ["/nowhere/python", "false"] {
        let output = build(python);
        assert_eq!(output.status.code(), Some(1));
        let said = stderr(&output);
        assert!(
            said.contains(python) && said.contains("pip install ray") && said.contains("--in-order"),
            "{said}"
        );
    }
    let no_store = cairn(&["fleet", "fetch", from, from, "--out", "x.map"]);
    assert!(!no_store.status.success());
    #[cfg(not(feature = "s3"))]
    {
        let output =
            cairn(&["fleet", "build", "s3://bucket/walks", "--out", store.to_str().unwrap(), "--in-order"]);
        assert!(stderr(&output).contains("this build has no S3"), "{}", stderr(&output));
        assert!(stderr(&output).contains("--features s3"), "{}", stderr(&output));
    }
    std::fs::remove_dir_all(&root).unwrap();
}
