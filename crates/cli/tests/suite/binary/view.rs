//! `cairn view`, which shows maps in a window that is another program: here one that keeps what it is told.

#![cfg(unix)]

use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use cairn_view::{Scene, read_message};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A folder with a copy of this program and, beside it, a window that writes its arguments and what it is told to files.
fn beside_a_window(name: &str) -> PathBuf {
    let folder = folder(name);
    std::fs::copy(env!("CARGO_BIN_EXE_cairn"), folder.join("cairn")).unwrap();
    let window = folder.join("cairn-view");
    let script =
        "#!/bin/sh\nhere=$(dirname \"$0\")\necho \"$@\" > \"$here/arguments\"\nexec cat > \"$here/told\"\n";
    std::fs::write(&window, script).unwrap();
    std::fs::set_permissions(&window, std::fs::Permissions::from_mode(0o755)).unwrap();
    folder
}

/// What the window was told.
fn told(folder: &Path) -> Scene {
    let bytes = std::fs::read(folder.join("told")).unwrap_or_default();
    let (mut from, mut scene) = (&bytes[..], Scene::default());
    // The last message may be on its way.
    while let Ok(Some(message)) = read_message(&mut from) {
        scene.take(&message).unwrap();
    }
    scene
}

/// Ends with the test, also where that fails.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_saved_map_is_shown_with_its_route_its_surface_and_its_columns() {
    let folder = beside_a_window("view");
    let [map, route, bare] =
        ["a.map", "a.route", "bare.map"].map(|n| folder.join(n).to_string_lossy().into_owned());
    let world = "sim:apartment?sensor=rgbd&rate=5&resolution=320x240&seed=1&duration=2.4";
    let done = cairn(&["run", world, "--sensor", "rgbd", "--dense", "--map-out", &map, "--record", &route]);
    assert!(done.status.success(), "{}", stderr(&done));
    let shown = |map: &str, more: &[&str]| {
        let mut command = Command::new(folder.join("cairn"));
        command.args(["view", map, "--json"]).args(more).output().unwrap()
    };
    // With a picture it ends when all is told.
    let picture = ["--picture", "a.png"];
    let done = shown(&map, &[&["--language", "de", "--voxel", "0.05"], &picture[..]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let scene = told(&folder);
    let report = json(&done);
    assert_eq!(std::fs::read_to_string(folder.join("arguments")).unwrap(), "--language de --picture a.png\n");
    assert_eq!((scene.title.as_str(), scene.is_metric, scene.walker), ("a.map", true, None));
    assert_eq!(scene.model.key_frames.len() as u64, report["key_frames"].as_u64().unwrap());
    assert!(scene.model.points.len() > 100 && scene.model.recorded.len() > 3, "{report}");
    assert_eq!(scene.model.up, [0.0, -1.0, 0.0]);
    let blocks: Vec<_> = scene.surface.blocks().collect();
    let triangles: usize = blocks.iter().map(|(_, block)| block.corners.len()).sum();
    assert_eq!(triangles as u64, report["triangles"].as_u64().unwrap());
    assert!(triangles > 2_000, "{report}");
    // Not all was seen by the first key frame.
    assert!(
        blocks.iter().any(|(_, b)| b.born_s == 0.0) && scene.surface.latest_s > 0.3,
        "{}",
        scene.surface.latest_s
    );
    assert!(scene.columns.tiles.len() > 3 && !scene.columns.free().is_empty());
    assert_eq!(scene.columns.axes[2], scene.model.up);
    // A map without depth is shown without; one that is none, and a map that is not in the file, are refused.
    let done = cairn(&["run", world, "--sensor", "rgbd", "--map-out", &bare]);
    assert!(done.status.success(), "{}", stderr(&done));
    let done = shown(&bare, &picture);
    assert_eq!(
        (done.status.code(), json(&done)["triangles"].as_u64()),
        (Some(0), Some(0)),
        "{}",
        stderr(&done)
    );
    assert!(told(&folder).surface.parts.is_empty());
    fails(&["view", &route], &["not a map file"]);
    fails(&["view", &map, "--map", "77"], &["it has no map 77", "it has these: [0"]);
    // Without the window.
    std::fs::remove_file(folder.join("cairn-view")).unwrap();
    let mut command = Command::new(folder.join("cairn"));
    let missing = command.args(["view", &map]).env("PATH", "/nowhere").output().unwrap();
    assert_eq!(missing.status.code(), Some(1));
    let words = "cairn-view is not installed; hint: cargo install --path crates/view --features window";
    assert!(stderr(&missing).contains(words) && stdout(&missing).is_empty(), "{}", stderr(&missing));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_map_that_grows_is_shown_as_it_grows() {
    let folder = beside_a_window("view-live");
    let world = "sim:apartment?sensor=rgbd&rate=5&resolution=320x240&seed=1";
    let data = folder.join("data");
    let log = std::fs::File::create(folder.join("served")).unwrap();
    let mut serve = Command::new(folder.join("cairn"));
    serve.args(["serve", world, "--dense", "--port", "8497", "--data"]).arg(data.join("cairn"));
    let _serve = Running(serve.stdin(Stdio::null()).stdout(log).spawn().unwrap());
    let until = |what: &str, f: &dyn Fn() -> bool| {
        let began = Instant::now();
        while !f() {
            assert!(began.elapsed() < Duration::from_secs(90), "{what}");
            std::thread::sleep(Duration::from_millis(200));
        }
    };
    let address = || {
        let text = std::fs::read_to_string(folder.join("served")).unwrap_or_default();
        text.lines().find(|line| line.starts_with("https://127.0.0.1:8497/#k=")).map(str::to_owned)
    };
    until("no address", &|| address().is_some());
    let url = address().unwrap();
    // Who does not know the certificate does not tell the token; and one with a wrong token is refused.
    let tried = |url: &str, data: &Path| {
        let mut command = Command::new(folder.join("cairn"));
        stderr(&command.args(["view", url]).env("XDG_DATA_HOME", data).output().unwrap())
    };
    let unknown = tried(&url, &folder.join("nothing"));
    assert!(unknown.contains("invalid peer certificate") && unknown.contains("--certificate"), "{unknown}");
    let refused = tried(&format!("{url}0"), &data);
    assert!(refused.contains("key"), "{refused}");
    let mut command = Command::new(folder.join("cairn"));
    let view = command.args(["view", &url]).env("XDG_DATA_HOME", &data).stderr(Stdio::piped());
    let _view = Running(view.spawn().unwrap());
    until("the map does not grow in the window", &|| {
        let scene = told(&folder);
        let has = scene.model.key_frames.len() > 5 && scene.walker.is_some() && scene.is_metric;
        has && scene.surface.blocks().count() > 100 && scene.columns.tiles.len() > 5
    });
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn what_is_not_for_this_kind_of_map_is_wrong_usage() {
    let url = "https://127.0.0.1:1/#k=abc";
    for wrong in [
        &["view", url, "--map", "3"][..],
        &["view", url, "--picture", "a.png"],
        &["view", "a.map", "--certificate", "a.crt"],
        &["view", "https://127.0.0.1:8443/"],
    ] {
        let output = cairn(wrong);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", stderr(&output));
    }
    fails(&["view", url], &["127.0.0.1:1", "start cairn serve there"]);
}
