//! The rules for output files of all commands but `cairn run`.

use super::{LONG, WORLD, misused, names, text};
use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A map of a few frames.
fn saved_map(folder: &Path, name: &str) -> PathBuf {
    let map = folder.join(name);
    let output = cairn(&["run", WORLD, "--map-out", text(&map)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    map
}

#[test]
fn the_rules_hold_for_maps_and_meshes() {
    let folder = folder("outputs-commands");
    let (a, b) = (saved_map(&folder, "a.map"), saved_map(&folder, "b.map"));
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let before = std::fs::read(&a).unwrap();

    let merge =
        |out: &str| ["map", "merge", text(&a), text(&b), "--overwrite", "--out", out].map(str::to_owned);
    let merged = |out: &str| {
        let arguments = merge(out);
        cairn(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    misused(&["map", "merge", text(&a), text(&b), "--out", text(&a), "--overwrite"], &["a map to merge"]);
    let both = file("both.map");
    assert_eq!(merged(&both).status.code(), Some(0));
    fails(&["map", "merge", text(&a), text(&b), "--out", &both], &["both.map: it exists already"]);
    assert_eq!(merged(&both).status.code(), Some(0));

    let points = file("points.ply");
    let export = ["map", "export", text(&a), "--points", &points];
    misused(&[&export[..], &["--trajectory", &points]].concat(), &["the same file"]);
    misused(&["map", "export", text(&a), "--overwrite", "--points", text(&a)], &["--points", "the map"]);
    assert_eq!(cairn(&export).status.code(), Some(0));
    fails(&export, &["points.ply: it exists already"]);
    assert_eq!(cairn(&[&export[..], &["--overwrite"]].concat()).status.code(), Some(0));
    // A folder that is missing for the routes does not keep the points from being written.
    std::fs::remove_file(&points).unwrap();
    let with_route = file("with-route.map");
    let record = ["run", WORLD, "--map-out", &with_route, "--record", &file("home.route")];
    assert_eq!(cairn(&record).status.code(), Some(0));
    let nowhere = file("nowhere");
    fails(&["map", "export", &with_route, "--points", &points, "--routes", &nowhere], &["home.route"]);
    assert!(Path::new(&points).exists());

    let mesh = file("mesh.ply");
    let arguments = ["mesh", WORLD, "--every", "5", "--voxel", "0.1", "--out", &mesh];
    assert_eq!(cairn(&arguments).status.code(), Some(0));
    fails(&arguments, &["mesh.ply: it exists already"]);
    assert_eq!(cairn(&[&arguments[..], &["--overwrite"]].concat()).status.code(), Some(0));
    misused(&["mesh", WORLD, "--poses", &mesh, "--overwrite", "--out", &mesh], &["--poses"]);
    fails(&["mesh", LONG, "--out", "/no/folder/mesh.ply"], &["make the folder first"]);
    assert_eq!(std::fs::read(&a).unwrap(), before);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_rules_hold_for_plans_logs_and_simulated_recordings() {
    let folder = folder("outputs-others");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (yaml, image, log) = (file("room.yaml"), file("room.png"), file("walk_DR.txt"));
    std::fs::write(&yaml, "image: room.png\n").unwrap();
    for name in [&image, &log, &file("walk_TD.txt")] {
        std::fs::write(name, "something").unwrap();
    }
    let plan = ["plan", &yaml, "--from", "0,0", "--to", "1,1", "--overwrite", "--out", &image];
    misused(&plan, &["--out", "the image of the map"]);
    misused(&["ekf", &log, "--overwrite", "--out", &log], &["--out", "the log"]);
    misused(&["ekf", &log, "--overwrite", "--out", &file("walk_TD.txt")], &["second file of the log"]);
    fails(&["ekf", &log, "--out", &image], &["room.png: it exists already"]);
    fails(&["ekf", &log, "--out", "/no/folder/page.html"], &["make the folder first"]);
    fails(&["sim", "demo?duration=600", "--out", text(&folder)], &["is not empty"]);
    assert_eq!(std::fs::read_to_string(&image).unwrap(), "something");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A g2o graph of three poses.
const GRAPH: &str = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1.1 0 0\nVERTEX_SE2 2 2.1 0.1 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n";

/// Asserts the rules for one command that reads `input` and writes by `option`: it refuses an existing file, its own
/// input, a folder that is not there, a device; it writes through a link; with --overwrite it replaces.
#[cfg(unix)]
#[track_caller]
fn obeys_the_rules(folder: &Path, command: &[&str], option: &str, input: &Path, named: &str) {
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (out, soft) = (file("out-new"), file("out-soft"));
    let with = |path: &str, more: &[&str]| -> Vec<String> {
        [command, &[option, path], more].concat().iter().map(|a| (*a).to_owned()).collect()
    };
    let run = |arguments: &[String]| cairn(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let fails_with = |arguments: Vec<String>, words: &[&str]| {
        fails(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), words);
    };
    fails_with(with("/no/folder/out", &[]), &["/no/folder/out", "make the folder first"]);
    fails_with(with("/dev/null", &[]), &["a device or a pipe"]);
    let before = std::fs::read(input).unwrap();
    let own = with(text(input), &["--overwrite"]);
    misused(&own.iter().map(String::as_str).collect::<Vec<_>>(), &[option, named]);
    assert_eq!(std::fs::read(input).unwrap(), before);
    let output = run(&with(&out, &[]));
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", stderr(&output));
    let written = std::fs::read(&out).unwrap();
    assert!(!written.is_empty());
    fails_with(with(&out, &[]), &["out-new: it exists already", "--overwrite"]);
    std::fs::write(&out, "of before").unwrap();
    std::os::unix::fs::symlink(&out, &soft).unwrap();
    let output = run(&with(&soft, &["--overwrite"]));
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", stderr(&output));
    assert!(Path::new(&soft).is_symlink(), "{command:?} replaces the link");
    assert_eq!(std::fs::read(&out).unwrap(), written, "{command:?}");
    std::fs::remove_file(&soft).unwrap();
    std::fs::remove_file(&out).unwrap();
}

#[cfg(unix)]
#[test]
fn the_rules_hold_for_solvers_rigs_routes_and_vocabularies() {
    let folder = folder("outputs-rest");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let graph = file("graph.g2o");
    std::fs::write(&graph, GRAPH).unwrap();
    obeys_the_rules(&folder, &["solve", "graph", &graph], "--out", Path::new(&graph), "the graph");

    let rig = file("rig.toml");
    std::fs::write(
        &rig,
        "[[cameras]]\nresolution = [320, 240]\nfocal = [200.0, 200.0]\ncentre = [160.0, 120.0]\n",
    )
    .unwrap();
    obeys_the_rules(&folder, &["rig", "check", &rig], "--write", Path::new(&rig), "the calibration");

    let route = file("home.route");
    assert_eq!(cairn(&["run", WORLD, "--record", &route]).status.code(), Some(0));
    obeys_the_rules(&folder, &["route", "show", &route], "--out", Path::new(&route), "the route");

    let recording = file("recording");
    let written = cairn(&["sim", "demo?duration=0.3&resolution=320x240&sensor=stereo", "--out", &recording]);
    assert_eq!(written.status.code(), Some(0));
    let images = folder.join("recording/mav0/cam0/data");
    let image = std::fs::read_dir(&images).unwrap().next().unwrap().unwrap().path();
    let train = ["vocab", "train", text(&images), text(&image), "--branching", "4", "--depth", "2"];
    obeys_the_rules(&folder, &train, "--out", &image, "an image");

    // A folder of images is read with a rig for them, and its files are no outputs.
    let into = file("recording/mav0/cam0/data/new.json");
    let existing = text(&image);
    misused(
        &["run", text(&images), "--rig", &rig, "--overwrite", "--report", existing],
        &["folder of the source"],
    );
    assert!(!Path::new(&into).exists());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn maps_and_routes_are_not_replaced_by_other_files() {
    let folder = folder("outputs-kinds");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (map, route) = (file("a.map"), file("a.route"));
    let output = cairn(&["run", WORLD, "--map-out", &map, "--record", &route]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for (path, kind) in [(&map, "a saved map"), (&route, "a recorded route")] {
        let before = std::fs::read(path).unwrap();
        for option in ["--trajectory", "--report", "--events"] {
            fails(&["run", LONG, "--overwrite", option, path], &[kind, "another kind of file"]);
        }
        assert_eq!(&std::fs::read(path).unwrap(), &before);
    }
    fails(&["run", LONG, "--overwrite", "--map-out", &route], &["a recorded route"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_rules_hold_for_the_demo() {
    let folder = folder("outputs-demo");
    let out = folder.join("demo");
    let arguments = ["demo", "--metres", "5", "--out", text(&out)];
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("demo.json"), "of before").unwrap();
    let began = Instant::now();
    fails(&arguments, &["demo.json: it exists already", "--overwrite"]);
    assert!(began.elapsed() < Duration::from_secs(1));
    assert_eq!(names(&out), ["demo.json"]);
    std::fs::remove_dir_all(&out).unwrap();
    // A file is in the way of the folder.
    std::fs::write(&out, "a file").unwrap();
    fails(&arguments, &["demo"]);
    std::fs::remove_file(&out).unwrap();
    // An earlier route is replaced only where the user says so.
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("demo.route"), "of before").unwrap();
    fails(&arguments, &["demo.route: it exists already"]);
    let output = cairn(&[&arguments[..], &["--overwrite"]].concat());
    assert!(stdout(&output).contains("report.html"), "{}", stderr(&output));
    assert!(std::fs::read_to_string(out.join("demo.route")).unwrap().contains("\"crc\""));
    assert_eq!(names(&out).len(), 7, "{:?}", names(&out));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_folder_that_cannot_be_written_is_told_before_serving() {
    if cfg!(target_os = "linux") {
        let began = Instant::now();
        fails(&["serve", "--port", "0", "--routes", "/proc/routes"], &["/proc/routes"]);
        assert!(began.elapsed() < Duration::from_secs(1));
    }
}

#[test]
fn damaged_maps_are_repaired_into_a_new_file() {
    let folder = folder("outputs-repair");
    let map = saved_map(&folder, "a.map");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (whole, damaged, repaired) =
        (std::fs::read(&map).unwrap(), file("damaged.map"), file("repaired.map"));
    std::fs::write(&damaged, &whole[..whole.len() - 100]).unwrap();
    fails(&["map", "info", &damaged], &["cairn map repair"]);
    misused(&["map", "repair", &damaged, "--overwrite", "--out", &damaged], &["the damaged map"]);
    let output = cairn(&["map", "repair", &damaged, "--out", &repaired, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = json(&output);
    assert!(!report["lost"].as_array().unwrap().is_empty() && report["key_frames"].as_u64().unwrap() > 0);
    assert_eq!(cairn(&["map", "check", &repaired]).status.code(), Some(0));
    assert_eq!(cairn(&["map", "check", &damaged]).status.code(), Some(1), "the damaged file is as it was");
    fails(&["map", "repair", &damaged, "--out", &repaired], &["it exists already"]);
    std::fs::write(&damaged, "no map at all").unwrap();
    fails(&["map", "repair", &damaged, "--out", &file("none.map")], &["not a map file"]);
    assert!(!Path::new(&file("none.map")).exists());
    let same = json(&cairn(&["map", "repair", text(&map), "--out", &file("same.map"), "--json"]));
    assert_eq!(same["lost"].as_array().map(Vec::len), Some(0));
    assert_eq!(std::fs::read(file("same.map")).unwrap(), whole);
    std::fs::remove_dir_all(&folder).unwrap();
}
