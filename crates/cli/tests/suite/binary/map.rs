//! `cairn map`, and saving and loading maps with `cairn run`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// 1.5 s of the demo world at low resolution, to keep tests short.
const WORLD: &str = "sim:demo?duration=1.5&resolution=320x240&sensor=rgbd";

/// Runs on the simulated world and saves the map; returns the path of the map.
fn save_map(folder: &Path, name: &str, more: &[&str]) -> String {
    let path = folder.join(name).to_str().unwrap().to_owned();
    let arguments = [&["run", WORLD, "--map-out", &path][..], more].concat();
    let output = cairn(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    path
}

#[test]
fn saved_map_info_check_export_and_relocalization() {
    let folder = folder("map");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let route = path("home.route");
    let map = save_map(&folder, "a.map", &["--record", &route]);
    assert_eq!(stdout(&cairn(&["map", "check", &map])).lines().count(), 1);

    let info = json(&cairn(&["map", "info", &map, "--json"]))["maps"][0].clone();
    assert_eq!((&info["sensor"], &info["metric"]), (&"rgbd".into(), &true.into()), "{info}");
    let (key_frames, landmarks) = (info["key_frames"].as_u64().unwrap(), info["landmarks"].as_u64().unwrap());
    assert!(key_frames >= 2 && landmarks > 100 && info["maps"].as_array().unwrap().len() == 1, "{info}");
    assert_eq!(info["routes"][0]["name"], "home", "{info}");
    let recorded = json(&cairn(&["route", "info", &route, "--json"]));
    assert_eq!(info["routes"][0]["points"], recorded["points"], "the route is saved in the map");
    let text = stdout(&cairn(&["map", "info", &map]));
    assert!(text.contains("made with rgbd") && text.contains("route     home"), "{text}");

    let (points, trajectory) = (path("points.ply"), path("key.tum"));
    let done = cairn(&["map", "export", &map, "--points", &points, "--trajectory", &trajectory, "--json"]);
    assert_eq!(json(&done)["landmarks"].as_u64(), Some(landmarks));
    let ply = std::fs::read_to_string(&points).unwrap();
    assert!(ply.starts_with("ply\nformat ascii") && ply.contains(&format!("element vertex {landmarks}\n")));
    assert_eq!(ply.lines().skip_while(|l| *l != "end_header").count() as u64, landmarks + 1);
    let tum = std::fs::read_to_string(&trajectory).unwrap();
    assert_eq!(tum.lines().filter(|l| !l.starts_with('#')).count() as u64, key_frames);

    let routes = path("routes");
    std::fs::create_dir(&routes).unwrap();
    assert_eq!(cairn(&["map", "export", &map, "--routes", &routes]).status.code(), Some(0));
    assert_eq!(std::fs::read(path("routes/home.route")).unwrap(), std::fs::read(&route).unwrap());
    fails(&["map", "export", &map, "--routes", &routes], &["home.route", "exists"]);

    let before = std::fs::read(&map).unwrap();
    let again = json(&cairn(&["run", WORLD, "--map-in", &map, "--localize-only", "--json"]));
    assert_eq!(
        (&again["keyframes"], &again["landmarks"]),
        (&key_frames.into(), &landmarks.into()),
        "{again}"
    );
    assert!(again["tracked"].as_u64().unwrap() >= 30, "the place was not recognised: {again}");
    assert!(again["accuracy"]["ate_m"]["rmse"].as_f64().unwrap() < 0.02, "{again}");
    assert_eq!(std::fs::read(&map).unwrap(), before, "the map is unchanged");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn mismatching_and_damaged_maps_are_reported() {
    let folder = folder("map-wrong");
    let map = save_map(&folder, "a.map", &["--frames", "5"]);
    fails(
        &["run", WORLD, "--map-in", &map, "--sensor", "mono"],
        &["a.map", "made with rgbd", "with gravity"],
    );
    let mono = save_map(&folder, "mono.map", &["--sensor", "mono"]);
    fails(&["run", WORLD, "--map-in", &mono, "--sensor", "rgbd"], &["mono.map", "made with mono", "metres"]);
    fails(&["run", WORLD, "--map-in", "/no/such.map"], &["/no/such.map", "check the path"]);
    fails(&["run", WORLD, "--map-out", "/no/such/a.map"], &["make the folder first"]);
    fails(&["map", "export", &map], &["nothing to write"]);
    fails(&["map", "export", &map, "--points", "x.ply", "--map", "7"], &["no map 7", "these: [0]"]);
    for wrong in
        [&["run", WORLD, "--localize-only"][..], &["map", "info"], &["map", "merge", &map, "--out", "x"]]
    {
        assert_eq!(cairn(wrong).status.code(), Some(2), "{wrong:?}");
    }

    // Damaged: every command names the part, and check also lists the intact ones.
    let mut bytes = std::fs::read(&map).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&map, &bytes).unwrap();
    for command in [&["map", "info", &map][..], &["run", WORLD, "--map-in", &map]] {
        fails(command, &["a.map", "part 'features 0'", "altered"]);
    }
    let check = cairn(&["map", "check", &map]);
    let text = stdout(&check);
    assert_eq!(check.status.code(), Some(1), "{text}");
    assert!(
        text.contains("bad ") && text.lines().any(|l| l.contains("landmarks") && l.ends_with("whole")),
        "{text}"
    );
    std::fs::write(&map, b"something else").unwrap();
    fails(&["map", "info", &map], &["a.map", "not a map file", "--map-out"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A map of a depth camera goes on with a stereo pair of another image size, which is chosen without being asked for.
#[test]
fn a_map_is_continued_by_another_camera() {
    let folder = folder("map-other-camera");
    let (map, both) = (save_map(&folder, "a.map", &[]), folder.join("both.map"));
    let both = both.to_str().unwrap();
    let other = "sim:demo?duration=3&resolution=400x300&sensor=stereo";
    let output = cairn(&["run", other, "--map-in", &map, "--map-out", both, "--json"]);
    let warned = stderr(&output);
    assert!(warned.contains("made with rgbd") && warned.contains("keep their camera"), "{warned}");
    let run = json(&output);
    assert!(run["accuracy"]["ate_m"]["rmse"].as_f64().unwrap() < 0.02, "{run}");
    let info = |map: &str| json(&cairn(&["map", "info", map, "--json"]))["maps"][0].clone();
    let (before, after) = (info(&map), info(both));
    assert_eq!(after["sensor"], "stereo", "{after}");
    assert_eq!(after["maps"].as_array().unwrap().len(), 1, "{after}");
    assert!(after["key_frames"].as_u64() > before["key_frames"].as_u64(), "{before} {after}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn merged_file_has_both_maps_and_routes() {
    let folder = folder("map-merge");
    let route = |n: &str| folder.join(n).join("home.route").to_str().unwrap().to_owned();
    for n in ["one", "two"] {
        std::fs::create_dir(folder.join(n)).unwrap();
    }
    let a = save_map(&folder, "a.map", &["--record", &route("one")]);
    let b = save_map(&folder, "b.map", &["--record", &route("two"), "--frames", "25"]);
    let both = folder.join("both.map").to_str().unwrap().to_owned();
    let merged = json(&cairn(&["map", "merge", &a, &b, "--out", &both, "--json"]));
    assert_eq!((&merged["maps"], &merged["routes"]), (&2.into(), &2.into()), "{merged}");
    let infos = json(&cairn(&["map", "info", &a, &b, &both, "--json"]));
    let of = |i: usize, what: &str| infos["maps"][i][what].clone();
    let count = |i: usize, what: &str| of(i, what).as_u64().unwrap();
    for what in ["key_frames", "landmarks", "observations"] {
        assert_eq!(count(0, what) + count(1, what), count(2, what), "{what}");
    }
    // The second route is anchored to the key frames of the second map, so its length is unchanged.
    let length = |i: usize, route: usize| of(i, "routes")[route]["length_m"].as_f64().unwrap();
    assert_eq!(of(2, "routes")[1]["name"], "home-2");
    assert!((length(2, 1) - length(1, 0)).abs() < 1e-6 && length(1, 0) > 0.3, "{infos}");
    assert_eq!(
        of(2, "maps")[1]["root"],
        of(0, "key_frames").as_u64().unwrap() + of(0, "removed_key_frames").as_u64().unwrap()
    );
    assert_eq!(cairn(&["map", "check", &a, &b, &both]).status.code(), Some(0));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Two robots walk the same corridor: one map, and the routes of both are what they were, without any renumbering.
#[test]
fn maps_of_two_robots_become_one_and_keep_their_routes() {
    let folder = folder("map-join");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let walk = |robot: &str, more: &str| {
        let world =
            format!("sim:demo?seed=5&resolution=320x240&sensor=rgbd&rate=10&detail=0.5&duration=9&{more}");
        let (map, route) = (path(&format!("{robot}.map")), path(&format!("{robot}.route")));
        let done = cairn(&["run", &world, "--robot", robot, "--map-out", &map, "--record", &route]);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        map
    };
    let (a, b, both) = (walk("1", "start=0"), walk("2", "start=1&height=1.4"), path("both.map"));
    let merged = json(&cairn(&["map", "merge", &a, &b, "--out", &both, "--json"]));
    let joined = &merged["joined"][0];
    assert_eq!((&merged["maps"], merged["notes"].as_array().unwrap().len()), (&1.into(), 0), "{merged}");
    assert!(joined["seams"].as_u64() >= Some(5) && joined["covered"] == joined["shown"], "{merged}");
    assert!((joined["scale"].as_f64().unwrap() - 1.0).abs() < 1e-9 && joined["rms"].as_f64() < Some(0.1));
    let infos = json(&cairn(&["map", "info", &a, &b, &both, "--json"]));
    let infos = infos["maps"].as_array().unwrap();
    assert_eq!(infos[2]["robots"]["2"], infos[1]["key_frames"], "{}", infos[2]);
    let length = |map: usize, route: usize| infos[map]["routes"][route]["length_m"].as_f64().unwrap();
    assert!((length(2, 1) / length(1, 0) - 1.0).abs() < 0.02, "{} {}", length(2, 1), length(1, 0));
    let routes = path("routes");
    std::fs::create_dir(&routes).unwrap();
    assert_eq!(cairn(&["map", "export", &both, "--routes", &routes]).status.code(), Some(0));
    for name in ["1.route", "2.route"] {
        assert_eq!(
            std::fs::read(folder.join("routes").join(name)).unwrap(),
            std::fs::read(path(name)).unwrap()
        );
    }
    let text = stdout(&cairn(&["map", "merge", &a, &b, "--out", &both, "--overwrite"]));
    assert!(text.contains("joined    ") && text.contains("seams agree") && text.contains(" rms "), "{text}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The route with every key frame number far beyond those of the map.
fn anchored_elsewhere(text: &str) -> String {
    text.replace("\"seq\":", "\"seq\":4000")
}

/// A route as builds without checksums wrote it, so that it can be edited.
fn without_checksums(text: &str) -> String {
    let lines = text.lines().map(|line| match line.rsplit_once(",\"crc\":") {
        Some((content, _)) => format!("{content}}}\n"),
        None => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
fn recording_continues_in_the_map_of_the_route() {
    let folder = folder("map-record");
    let route = folder.join("walk.route").to_str().unwrap().to_owned();
    let map = save_map(&folder, "a.map", &["--record", &route, "--frames", "15"]);
    let points = |route: &str| json(&cairn(&["route", "info", route, "--json"]))["points"].as_u64().unwrap();
    let before = points(&route);
    let on = save_map(&folder, "b.map", &["--map-in", &map, "--record", &route, "--start", "0.8"]);
    assert!(points(&route) > before, "nothing was added to {before} points");
    assert_eq!(
        json(&cairn(&["map", "info", &on, "--json"]))["maps"][0]["routes"][0]["points"],
        points(&route)
    );
    // A route of another map is left unchanged.
    let text = std::fs::read_to_string(&route).unwrap();
    let far = anchored_elsewhere(&without_checksums(&text));
    std::fs::write(&route, &far).unwrap();
    fails(
        &["run", WORLD, "--map-in", &map, "--record", &route],
        &["walk.route", "none of the key frames", "--map-in"],
    );
    assert_eq!(std::fs::read_to_string(&route).unwrap(), far);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Starts a long run and returns when `ready` holds.
#[cfg(unix)]
fn running(more: &[&str], ready: impl Fn() -> bool) -> std::process::Child {
    let world = "sim:demo?duration=600&resolution=320x240&sensor=rgbd";
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args([&["run", world][..], more].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while !ready() {
        let runs = began.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none();
        assert!(runs, "the run ended or took too long");
        std::thread::sleep(Duration::from_millis(20));
    }
    child
}

#[cfg(unix)]
#[test]
fn interrupted_run_saves_map_and_route() {
    let folder = folder("map-interrupt");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (map, route) = (path("a.map"), path("walk.route"));
    let child = running(&["--map-out", &map, "--record", &route], || {
        std::fs::read_to_string(&route).is_ok_and(|text| text.lines().count() > 3)
    });
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("interrupted"), "{}", stderr(&output));
    let info = json(&cairn(&["map", "info", &map, "--json"]));
    assert!(info["maps"][0]["routes"][0]["points"].as_u64().unwrap() >= 3, "{info}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(unix)]
#[test]
fn killed_run_leaves_the_last_saved_map() {
    let folder = folder("map-kill");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (map, route) = (path("a.map"), path("walk.route"));
    let more = ["--map-out", &map, "--record", &route, "--map-every", "0.5"];
    let mut child = running(&more, || Path::new(&map).exists());
    child.kill().unwrap();
    child.wait().unwrap();
    let info = json(&cairn(&["map", "info", &map, "--json"]));
    assert!(info["maps"][0]["key_frames"].as_u64().unwrap() >= 1, "{info}");
    // Recording continues in that map, although the last points are anchored to key frames that were not saved.
    let points = || json(&cairn(&["route", "info", &route, "--json"]))["points"].as_u64().unwrap();
    let before = points();
    let stamps = || std::fs::read_to_string(&route).unwrap().lines().filter(|l| l.contains("\"t\":")).count();
    assert!(stamps() as u64 - before <= 1, "at most the last line was torn");
    let text = without_checksums(&std::fs::read_to_string(&route).unwrap());
    std::fs::write(&route, &text).unwrap();
    let stray = text.lines().last().unwrap().replacen("\"seq\":", "\"seq\":90", 1);
    let stray = stray.replacen("\"t\":", "\"t\":9", 1);
    std::fs::write(&route, std::fs::read_to_string(&route).unwrap() + &stray + "\n").unwrap();
    assert_eq!(points(), before + 1);
    let output = cairn(&["run", WORLD, "--map-in", &map, "--record", &route]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = std::fs::read_to_string(&route).unwrap();
    assert!(!text.contains("\"seq\":90") && points() == before + 1, "{text}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Number of depth images in a saved map.
fn depth_images(map: &str) -> u64 {
    json(&cairn(&["map", "info", map, "--json"]))["maps"][0]["depth"]["images"].as_u64().unwrap_or(0)
}

#[test]
fn depth_is_saved_meshed_continued_and_merged() {
    let folder = folder("map-depth");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let live = path("live.ply");
    let map = save_map(&folder, "a.map", &["--dense", "--mesh", &live]);
    let images = depth_images(&map);
    assert!(images >= 2, "{images}");
    let text = stdout(&cairn(&["map", "info", &map]));
    assert!(text.contains(&format!("depth     {images} images in ")), "{text}");
    assert_eq!(stdout(&cairn(&["map", "check", &map])).lines().count(), 1);

    // The mesh of the saved map is that of the run which saved it, to the last byte.
    let mesh = path("a.ply");
    let made = json(&cairn(&["mesh", &map, "--out", &mesh, "--json"]));
    assert_eq!((made["images"].as_u64(), made["lost"].as_u64()), (Some(images), Some(0)), "{made}");
    assert!(std::fs::read(&mesh).unwrap() == std::fs::read(&live).unwrap(), "{made}");
    let coarse = json(&cairn(&["mesh", &map, "--out", &path("a.glb"), "--voxel-m", "0.1", "--json"]));
    assert!(coarse["vertices"].as_u64().unwrap() < made["vertices"].as_u64().unwrap() / 4, "{coarse}");
    let least = |m| {
        json(&cairn(&["mesh", &map, "--out", &path("e.ply"), "--drop-isolated", m, "--overwrite", "--json"]))
    };
    let [all, large, none] = ["0", "0.5", "1000"].map(least);
    let vertices = |r: &serde_json::Value| r["vertices"].as_u64().unwrap();
    assert!(vertices(&all) == vertices(&made) && all["isolated"] == 0, "{all}");
    assert!(vertices(&large) > 9 * vertices(&made) / 10, "{large} of {made}");
    assert!(vertices(&none) == 0 && none["isolated"].as_u64() > large["isolated"].as_u64(), "{none}");
    let misused = cairn(&["mesh", &map, "--out", &path("f.ply"), "--drop-isolated=-1"]);
    assert_eq!(misused.status.code(), Some(2), "{}", stderr(&misused));
    assert!(stderr(&misused).contains("--drop-isolated: is not a length"), "{}", stderr(&misused));
    fails(&["mesh", &map, "--out", &mesh], &["a.ply: it exists already"]);
    let heights = path("a.pgm");
    json(&cairn(&["mesh", &map, "--out", &heights, "--json"]));
    let bytes = std::fs::read(&heights).unwrap();
    assert!(bytes.starts_with(b"P5\n# height_m = 0.001 * (pixel - 1) + "), "{:?}", &bytes[..60]);

    // In colour, in the run and in the map.
    let has_colours = |file: &str| {
        let head = std::fs::read(file).unwrap();
        String::from_utf8_lossy(&head[..head.len().min(500)]).contains("property uchar red")
    };
    assert!(!has_colours(&mesh));
    let coloured = save_map(&folder, "c.map", &["--dense", "--colour", "--mesh", &path("c.ply")]);
    json(&cairn(&["mesh", &coloured, "--out", &path("d.ply"), "--json"]));
    assert!(has_colours(&path("c.ply")));
    assert!(std::fs::read(path("c.ply")).unwrap() == std::fs::read(path("d.ply")).unwrap());
    let alone = cairn(&["run", "sim:demo?duration=1&resolution=320x240&sensor=rgbd", "--colour"]);
    assert!(stderr(&alone).contains("--colour: colours are those of surfaces"), "{}", stderr(&alone));

    let misused = cairn(&["mesh", &map, "--out", &path("b.ply"), "--every", "2"]);
    assert_eq!(misused.status.code(), Some(2), "{}", stderr(&misused));
    assert!(stderr(&misused).contains("a saved map has its own poses"), "{}", stderr(&misused));

    // Continued, the depth goes on without being asked for; other sensors leave it as it is.
    let longer = "sim:demo?duration=6&resolution=320x240&sensor=rgbd";
    let more = path("more.map");
    let on = cairn(&["run", longer, "--map-in", &map, "--map-out", &more, "--start", "1", "--json"]);
    let (before, after) = (made["vertices"].as_u64().unwrap(), json(&on)["keyframes"].as_u64().unwrap());
    assert!(depth_images(&more) > images, "{} images, {after} key frames", depth_images(&more));
    let whole = json(&cairn(&["mesh", &more, "--out", &path("more.ply"), "--json"]));
    assert_eq!((whole["images"].as_u64(), whole["lost"].as_u64()), (Some(depth_images(&more)), Some(0)));
    assert!(whole["vertices"].as_u64().unwrap() > before, "{whole} after {before}");

    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_ground_of_a_map_with_depth_is_a_grid() {
    let folder = folder("map-ground");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (map, tum, yaml) = (path("a.map"), path("a.tum"), path("ground.yaml"));
    let world = "sim:demo?duration=9&resolution=320x240&sensor=rgbd&rate=10";
    let done = cairn(&["run", world, "--dense", "--map-out", &map]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    json(&cairn(&["map", "export", &map, "--grid", &yaml, "--trajectory", &tum, "--json"]));
    let (grid, _) = cairn_plan::map_server::load(Path::new(&yaml)).unwrap();
    let count = |value: i8| grid.values().iter().filter(|v| **v == value).count();
    // A corridor of some metres: walls on both sides, ground between them.
    assert!(count(100) > 150 && count(0) > 1000, "{} occupied, {} free", count(100), count(0));
    // The map begins with y down and nearly level, so that its x and z are those of the ground. The camera sees the ground ahead of it.
    let text = std::fs::read_to_string(&tum).unwrap();
    let numbers = |line: &str| line.split_whitespace().map(|v| v.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let walked: Vec<i8> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(numbers)
        .filter(|v| v[3] > 2.5)
        .map(|v| {
            grid.frame()
                .cell_at(cairn_geometry::Vec2::new(v[1], v[3]))
                .and_then(|c| grid.get(c))
                .unwrap_or(-1)
        })
        .collect();
    assert!(
        walked.len() >= 3 && walked.iter().all(|v| *v == 0),
        "not free where the camera went: {walked:?}"
    );

    let without = save_map(&folder, "without.map", &["--frames", "5"]);
    fails(
        &["map", "export", &without, "--grid", &path("b.yaml")],
        &["without.map: the map carries no depth", "--camera-height"],
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Two walks along one corridor, whose key frames have the same names: all depth stands in one surface.
#[test]
fn depth_of_merged_maps_is_one_surface() {
    let folder = folder("map-depth-join");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let walk = |name: &str, more: &str| {
        let world =
            format!("sim:demo?seed=5&resolution=320x240&sensor=rgbd&rate=10&detail=0.5&duration=9&{more}");
        let map = path(name);
        let done = cairn(&["run", &world, "--dense", "--map-out", &map]);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        map
    };
    let (a, b, both) = (walk("a.map", "start=0"), walk("b.map", "start=1&height=1.4"), path("both.map"));
    let merged = json(&cairn(&["map", "merge", &a, &b, "--out", &both, "--json"]));
    assert_eq!((&merged["maps"], merged["notes"].as_array().unwrap().len()), (&1.into(), 1), "{merged}");
    let surface = |map: &str| {
        let made =
            json(&cairn(&["mesh", map, "--out", &path("x.ply"), "--voxel", "0.05", "--overwrite", "--json"]));
        assert_eq!((made["lost"].as_u64(), made["other_maps"].as_u64()), (Some(0), Some(0)), "{made}");
        (made["images"].as_u64().unwrap(), made["vertices"].as_f64().unwrap())
    };
    let (one, two, all) = (surface(&a), surface(&b), surface(&both));
    assert_eq!(all.0, one.0 + two.0);
    let share = all.1 / one.1.max(two.1);
    assert!((0.85..1.25).contains(&share), "doubled or lost: {} of {} and {} vertices", all.1, one.1, two.1);
    // So is the ground: what one walk saw is there, and walls are not twice as thick.
    let ground = |map: &str| {
        let yaml = path("ground.yaml");
        json(&cairn(&["map", "export", map, "--grid", &yaml, "--overwrite", "--json"]));
        let (grid, _) = cairn_plan::map_server::load(Path::new(&yaml)).unwrap();
        [0, 100].map(|value| grid.values().iter().filter(|v| **v == value).count())
    };
    let ([free_a, walls_a], [free_b, walls_b], [free, walls]) = (ground(&a), ground(&b), ground(&both));
    println!("free {free_a}, {free_b}, both {free}; occupied {walls_a}, {walls_b}, both {walls}");
    assert!(20 * free > 19 * free_a.max(free_b), "{free} free of {free_a} and {free_b}");
    assert!(10 * walls < 14 * walls_a.max(walls_b), "{walls} occupied of {walls_a} and {walls_b}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn maps_without_depth_and_with_damaged_depth_are_told() {
    let folder = folder("map-depth-wrong");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let out = path("x.ply");
    let without = save_map(&folder, "without.map", &["--frames", "5"]);
    fails(&["mesh", &without, "--out", &out], &["without.map: the map carries no depth", "--dense"]);
    let mono = "sim:demo?duration=1&resolution=320x240&sensor=mono";
    let misused = cairn(&["run", mono, "--dense"]);
    assert_eq!(misused.status.code(), Some(2), "{}", stderr(&misused));
    assert!(stderr(&misused).contains("--dense: surfaces need depth"), "{}", stderr(&misused));

    let map = save_map(&folder, "a.map", &["--dense"]);
    let whole = std::fs::read(&map).unwrap();
    for (name, bytes) in [
        ("short.map", whole[..whole.len() - 5000].to_vec()),
        ("flipped.map", {
            let mut bytes = whole.clone();
            let at = bytes.len() - 5000;
            bytes[at] ^= 16;
            bytes
        }),
    ] {
        let damaged = path(name);
        std::fs::write(&damaged, bytes).unwrap();
        fails(&["mesh", &damaged, "--out", &out], &[name, "cairn map repair"]);
        fails(&["run", WORLD, "--map-in", &damaged], &[name]);
        let checked = cairn(&["map", "check", &damaged]);
        assert!(stdout(&checked).contains("attached/depth/"), "{}", stdout(&checked));
        let mended = path("mended.map");
        let repaired = cairn(&["map", "repair", &damaged, "--out", &mended, "--overwrite", "--json"]);
        let lost = json(&repaired)["lost"].to_string();
        assert!(lost.contains("attached/depth/"), "{lost}");
        assert!(depth_images(&mended) < depth_images(&map));
        assert_eq!(
            json(&repaired)["landmarks"],
            json(&cairn(&["map", "info", &map, "--json"]))["maps"][0]["landmarks"]
        );
    }
    assert!(!Path::new(&out).exists());
    std::fs::remove_dir_all(&folder).unwrap();
}

/// What `cairn run` doubts of a recording is said by `cairn mesh` too: of the recording, and of a map that was made from it.
#[test]
fn a_mesh_says_what_is_doubtful_of_its_depth_and_takes_no_poses_without_metres() {
    let folder = folder("mesh-doubts");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let recording = path("hall");
    let world = "apartment?duration=3&sensor=rgbd&rate=10";
    let written = cairn(&["sim", world, "--layout", "tum", "--out", &recording]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let sound = cairn(&["mesh", &recording, "--out", &path("sound.ply")]);
    assert_eq!((sound.status.code(), stderr(&sound)), (Some(0), String::new()));
    // Without its calibration, and with depth in millimetres where a fifth of one is usual.
    for name in ["camchain.yaml", "rig.toml"] {
        let _ = std::fs::remove_file(folder.join("hall").join(name));
    }
    for file in std::fs::read_dir(folder.join("hall/depth")).unwrap() {
        let file = file.unwrap().path();
        let mut reader = png::Decoder::new(std::fs::File::open(&file).map(std::io::BufReader::new).unwrap())
            .read_info()
            .unwrap();
        let mut data = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut data).unwrap();
        data.chunks_exact_mut(2).for_each(|p| {
            let value = u16::from_be_bytes([p[0], p[1]]) / 5;
            p.copy_from_slice(&value.to_be_bytes());
        });
        let info = reader.info();
        let mut encoder = png::Encoder::new(std::fs::File::create(&file).unwrap(), info.width, info.height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&data).unwrap();
    }
    let doubts = ["no calibration", "five times too small"];
    let (map, live, mono) = (path("a.map"), path("a.tum"), path("mono.tum"));
    let run = ["run", &recording, "--dense", "--map-out", &map, "--trajectory", &live];
    let ran = cairn(&run);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    // The lens that is assumed is not this one either.
    let problem = "times too small: check the unit of depth";
    assert!(stdout(&ran).contains(problem), "{}", stdout(&ran));
    let meshes = [
        cairn(&["mesh", &recording, "--out", &path("b.ply")]),
        cairn(&["mesh", &recording, "--poses", &live, "--out", &path("c.ply")]),
        cairn(&["mesh", &map, "--out", &path("d.ply")]),
    ];
    for mesh in &meshes {
        assert_eq!(mesh.status.code(), Some(0), "{}", stderr(mesh));
        doubts.iter().for_each(|doubt| assert!(stderr(mesh).contains(doubt), "{doubt}: {}", stderr(mesh)));
    }
    let info = stdout(&cairn(&["map", "info", &map]));
    doubts.iter().for_each(|doubt| assert!(info.contains(doubt), "{doubt}: {info}"));
    // Poses of one camera have a unit of their own.
    let ran = cairn(&["run", &recording, "--sensor", "mono", "--trajectory", &mono]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let refused = cairn(&["mesh", &recording, "--poses", &mono, "--out", &path("e.ply")]);
    let told = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{told}");
    assert!(told.contains("mono.tum") && told.contains("those of depth are metres"), "{told}");
    std::fs::remove_dir_all(&folder).unwrap();
}
