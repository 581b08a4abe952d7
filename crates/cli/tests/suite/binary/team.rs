//! `cairn team`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use serde_json::Value;
use std::process::Command;

/// A walk around a block of 24 steps, with loops across.
fn block() -> String {
    let mut lines: Vec<String> = (0..24)
        .map(|k| {
            let turn = if k % 6 == 5 { std::f64::consts::FRAC_PI_2 } else { 0.01 };
            format!("EDGE_SE2 {k} {} 1 0 {turn} 100 0 0 100 0 400", k + 1)
        })
        .collect();
    let across = ["0 24 0.1 0.05 0.1", "3 12 2 6.1 3.1", "5 9 1 2.9 1.6", "4 16 -2 6.1 3.1"];
    lines.extend(across.map(|e| format!("EDGE_SE2 {e} 10 0 0 10 0 40")));
    lines.join("\n")
}

#[test]
fn a_graph_is_split_and_agreed_on() {
    let folder = folder("team-split");
    let file = folder.join("block.g2o");
    std::fs::write(&file, block()).unwrap();
    let file = file.to_str().unwrap();
    let agreed = json(&cairn(&["team", "graph", file, "--robots", "3", "--exchanges", "8", "--json"]));
    assert_eq!(agreed["robots"].as_array().unwrap().len(), 3);
    assert_eq!(agreed["exchanges"].as_array().unwrap().len(), 8);
    assert_eq!(agreed["poses"], 25);
    assert!(agreed["exchanges"][7]["above"].as_f64().unwrap() < 1e-6, "{agreed}");
    assert!(agreed["robots"][0]["sent"].as_u64().unwrap() > 100, "{agreed}");
    assert_eq!(agreed["reached"].as_array().unwrap().len(), 3, "{agreed}");
    let text = stdout(&cairn(&["team", "graph", file, "--robots", "3", "--loss", "0.3", "--late", "0.2"]));
    assert!(text.starts_with("team        3 robots, 25 poses in the plane"), "{text}");
}

/// The block of 25 poses as three robots know it, with the robot in the upper byte of each id.
fn shared_block() -> [String; 3] {
    let id = |k: u64| ((u64::from(b'a') + k / 9) << 56) | k;
    let mut texts = [0, 1, 2].map(|_| String::new());
    for k in 0..25 {
        texts[k as usize / 9] += &format!("VERTEX_SE2 {} 0 0 0\n", id(k));
    }
    for line in block().lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let ends = [1, 2].map(|at| words[at].parse::<u64>().unwrap());
        let edge = format!("EDGE_SE2 {} {} {}\n", id(ends[0]), id(ends[1]), words[3..].join(" "));
        let robots = ends.map(|k| k as usize / 9);
        texts[robots[0]] += &edge;
        if robots[1] != robots[0] {
            texts[robots[1]] += &edge;
        }
    }
    texts
}

#[test]
fn three_processes_agree_on_a_graph_that_none_of_them_knows_whole() {
    let folder = folder("team-agree");
    let path = |name: String| folder.join(name).to_str().unwrap().to_owned();
    let texts = shared_block();
    let hub = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut running = Vec::new();
    for (n, text) in texts.iter().enumerate() {
        let (own, out) = (path(format!("{n}.g2o")), path(format!("agreed-{n}.g2o")));
        std::fs::write(&own, text).unwrap();
        let mut agree = Command::new(env!("CARGO_BIN_EXE_cairn"));
        agree.args(["team", "agree", &own, "--out", &out, "--believe-all", "--json", "--for", "12"]);
        // All know the address of the first one only.
        let address = if n == 0 {
            ["--listen", &hub].map(str::to_owned).to_vec()
        } else {
            ["--listen", "127.0.0.1:0", "--peer", &hub].map(str::to_owned).to_vec()
        };
        agree.args(address).stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        running.push(agree.spawn().expect("the binary starts"));
    }
    for (n, process) in running.into_iter().enumerate() {
        let agreed = json(&process.wait_with_output().unwrap());
        assert_eq!(agreed["agreed_with"].as_array().unwrap().len(), 2, "{n}: {agreed}");
        assert_eq!(
            (&agreed["settled"], &agreed["refused"]),
            (&Value::Bool(true), &0.into()),
            "{n}: {agreed}"
        );
        assert!(agreed["sent_bytes"].as_u64().unwrap() < 50_000, "{n}: {agreed}");
    }
    // The poses as agreed with all measurements: one solver finds nothing to improve.
    let vertices = (0..3).map(|n| std::fs::read_to_string(path(format!("agreed-{n}.g2o"))).unwrap());
    let vertices: Vec<String> = vertices
        .flat_map(|text| {
            text.lines().filter(|l| l.starts_with("VERTEX")).map(str::to_owned).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(vertices.len(), 25);
    let mut edges: Vec<&str> =
        texts.iter().flat_map(|t| t.lines()).filter(|l| l.starts_with("EDGE")).collect();
    edges.sort_unstable();
    edges.dedup();
    let whole = path("whole.g2o".into());
    std::fs::write(&whole, format!("{}\n{}\n", vertices.join("\n"), edges.join("\n"))).unwrap();
    let solved = json(&cairn(&["solve", "graph", &whole, "--init", "file", "--json"]));
    let [before, after] =
        ["chi2_before", "chi2_after"].map(|key| solved[key].as_f64().unwrap_or_else(|| panic!("{solved}")));
    assert!(before / after - 1.0 < 1e-6, "{before} as agreed, {after} at the optimum");
    // A graph whose ids name no robot is refused.
    let plain = path("plain.g2o".into());
    std::fs::write(&plain, "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n")
        .unwrap();
    fails(
        &["team", "agree", &plain, "--out", &path("never.g2o".into())],
        &["plain.g2o", "does not name its robot"],
    );
}

/// Two robots with a saved map each agree on poses, without either map leaving its process.
#[test]
fn two_processes_agree_on_the_pose_graph_of_their_maps() {
    let folder = folder("team-agree-maps");
    let path = |name: String| folder.join(name).to_str().unwrap().to_owned();
    let walks = ["duration=12", "start=4&duration=10&speed=1.05&height=1.4"];
    let mut bytes = 0;
    for (robot, walk) in (1..).zip(walks) {
        let source = format!("sim:demo?resolution=320x240&rate=10&detail=0.5&sensor=rgbd&seed=5&{walk}");
        let map = path(format!("{robot}.map"));
        json(&cairn(&["run", &source, "--robot", &robot.to_string(), "--map-out", &map, "--json"]));
        bytes += std::fs::metadata(&map).unwrap().len();
    }
    let first = path("1.map".into());
    let out = path("never.g2o".into());
    fails(&["team", "agree", &first, "--out", &out], &["--robot", "a map needs the number of its robot"]);
    fails(&["team", "agree", &first, "--robot", "7", "--out", &out], &["no key frame of robot 7"]);
    let hub = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut running = Vec::new();
    for robot in 1..=2 {
        let [map, out, poses] = ["map", "g2o", "tum"].map(|kind| path(format!("{robot}.{kind}")));
        let mut agree = Command::new(env!("CARGO_BIN_EXE_cairn"));
        agree.args(["team", "agree", &map, "--robot", &robot.to_string(), "--out", &out]);
        agree.args(["--trajectory", &poses, "--json", "--for", "25"]);
        let address = match robot {
            1 => ["--listen", &hub].map(str::to_owned).to_vec(),
            _ => ["--listen", "127.0.0.1:0", "--peer", &hub].map(str::to_owned).to_vec(),
        };
        agree.args(address).stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
        running.push(agree.spawn().expect("the binary starts"));
    }
    let agreed: Vec<Value> =
        running.into_iter().map(|process| json(&process.wait_with_output().unwrap())).collect();
    let sent: u64 = agreed.iter().map(|agreed| agreed["sent_bytes"].as_u64().unwrap()).sum();
    for (n, agreed) in agreed.iter().enumerate() {
        assert_eq!((&agreed["settled"], &agreed["refused"]), (&Value::Bool(true), &0.into()), "{agreed}");
        assert_eq!(agreed["agreed_with"], serde_json::json!([2 - n]), "{agreed}");
        assert!(agreed["loops"].as_u64().unwrap() >= 3 && agreed["rejected"] == 0, "{agreed}");
        let poses = std::fs::read_to_string(path(format!("{}.tum", n + 1))).unwrap();
        let lines = poses.lines().filter(|line| !line.starts_with('#')).count();
        assert_eq!(agreed["poses"].as_u64().unwrap() as usize, lines, "{agreed}");
    }
    assert!(agreed[1]["sent_bytes_of"]["places"].is_null() && sent < bytes / 4, "{sent} of {bytes} B");
    // The number of a robot in a graph is that of its vertices.
    let graph = path("1.g2o".into());
    fails(&["team", "agree", &graph, "--robot", "1", "--out", &out], &["--robot", "belongs to a saved map"]);
}

#[test]
fn what_is_no_team_is_said_in_one_line() {
    let folder = folder("team-wrong");
    let file = folder.join("block.g2o");
    std::fs::write(&file, block()).unwrap();
    let name = file.to_str().unwrap();
    for wrong in [&["team", "graph", name][..], &["team", "graph", name, name, "--robots", "2"]] {
        let output = cairn(wrong);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}: {}", stderr(&output));
    }
    fails(&["team", "graph", name, "--robots", "99"], &["99 robots cannot share 25 poses"]);
    let empty = folder.join("empty");
    std::fs::create_dir_all(&empty).unwrap();
    fails(&["team", "graph", empty.to_str().unwrap()], &["no .g2o file"]);
    let other = folder.join("other.g2o");
    std::fs::write(&other, "EDGE_SE2 0 1 oops").unwrap();
    fails(&["team", "graph", name, other.to_str().unwrap()], &["other.g2o, line 1"]);
    // Edges alone say whose poses they are of nobody.
    fails(&["team", "graph", name, name], &["vertex 0 is in none of the texts"]);
}

/// The model is made of what was measured, and is compared with a run: one that sent half of what the model says is told so.
#[test]
fn costs_are_measured_and_scaled_and_checked() {
    let folder = folder("team-scale");
    let (demo, svg) = (folder.join("demo.json"), folder.join("scale.svg"));
    let robot = |n: u16| serde_json::json!({ "robot": n, "key_frames": 40, "sent_kb_per_s": 50.0 });
    let run = serde_json::json!({ "seconds": 30.0, "robots": [robot(1), robot(2), robot(3)] });
    std::fs::write(&demo, run.to_string()).unwrap();
    let paths = [demo.to_str().unwrap(), svg.to_str().unwrap()];
    let r =
        json(&cairn(&["team", "scale", "--json", "--group", "5", "--check", paths[0], "--svg", paths[1]]));
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{v} in {r}"));
    let costs = &r["costs"];
    assert!((50..300).contains(&costs["key_frames"].as_u64().unwrap()), "{costs}");
    let (map, words) = (number(&costs["map_bytes"]), number(&costs["words_bytes"]));
    assert!((5e3..1e5).contains(&map) && (100.0..1026.0).contains(&words), "{costs}");
    let again = number(&costs["sent_again"]);
    assert!((1.0..3.0).contains(&again), "{costs}");
    let rows = r["table"].as_array().unwrap();
    assert_eq!(rows.len(), 24);
    let row = |robots: u64, key_frames: f64| {
        let found = rows.iter().find(|row| row["robots"] == robots && row["key_frames"] == key_frames);
        &found.unwrap_or_else(|| panic!("no row of {robots} robots"))["load"]
    };
    // In groups of five, maps cost a hundred robots what they cost ten, and words eleven times as much.
    let maps = |robots| number(&row(robots, 1e4)["bandwidth_maps"]);
    assert_eq!(maps(10), maps(100));
    let words = |robots| number(&row(robots, 1e4)["bandwidth_words"]);
    assert!((words(100) / words(10) - 11.0).abs() < 1e-6);
    assert!(number(&row(2, 1e6)["memory"]) > 5.0 * number(&row(2, 1e5)["memory"]));
    // 120 key frames to two others each, in 30 s.
    let check = &r["check"];
    let predicted = number(&check["predicted_kb_per_s"]);
    let each = 120.0 * 2.0 * (map * again + number(&costs["words_bytes"])) / 30.0 / 3.0 / 1e3;
    assert!(predicted >= each && predicted < each + 1.0, "{check}, {each} without what robots say they have");
    assert_eq!(number(&check["measured_kb_per_s"]), 50.0);
    assert!(std::fs::read_to_string(&svg).unwrap().contains("bandwidth"));
    fails(&["team", "scale", "--check", paths[1]], &["scale.svg", "cairn demo --team 4 --json"]);
    assert_eq!(cairn(&["team", "scale", "--memory", "-1"]).status.code(), Some(2));
}

/// A process that does not outlive its test.
struct Running(std::process::Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn two_robots_share_their_maps_and_come_to_the_same_file() {
    let folder = folder("team-join");
    let path = |name: String| folder.join(name).to_str().unwrap().to_owned();
    let free = || std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let address = [free(), free()];
    let mut running = Vec::new();
    for n in [1, 2] {
        let (own, out, robot) = (path(format!("own-{n}.map")), path(format!("all-{n}.map")), n.to_string());
        let world = format!("sim:demo?seed={n}&sensor=rgbd&resolution=320x240&rate=10&detail=0.5&duration=4");
        let walked = cairn(&["run", &world, "--robot", &robot, "--map-out", &own]);
        assert!(walked.status.success(), "{}", stderr(&walked));
        let arguments = ["team", "join", &own, "--robot", &robot, "--team", "test", "--out", &out];
        let mut join = Command::new(env!("CARGO_BIN_EXE_cairn"));
        // Two houses: the robots want each other's maps only because they want all.
        join.args(arguments).args(["--all", "--listen", &address[n - 1], "--peer", &address[2 - n]]);
        join.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        running.push(Running(join.spawn().expect("the binary starts")));
    }
    let status =
        |n: usize| json_if_there(&cairn(&["team", "status", &path(format!("all-{n}.map")), "--json"]));
    let until = std::time::Instant::now() + std::time::Duration::from_secs(50);
    loop {
        let [Some(a), Some(b)] = [status(1), status(2)] else {
            assert!(std::time::Instant::now() < until, "no status");
            std::thread::sleep(std::time::Duration::from_millis(200));
            continue;
        };
        let made = |s: &Value| s["atlas"]["digest"] == s["digest"];
        if a["digest"] == b["digest"] && a["maps"].as_array().unwrap().len() == 2 && made(&a) && made(&b) {
            // Nothing is joined, and that is said.
            assert_eq!(a["atlas"]["maps"].as_array().unwrap().len(), 2, "{a}");
            assert_eq!(a["refused"], 0);
            break;
        }
        assert!(std::time::Instant::now() < until, "{a} {b}");
        std::thread::sleep(std::time::Duration::from_millis(200));
    }
    drop(running);
    let bytes = [1, 2].map(|n| std::fs::read(path(format!("all-{n}.map"))).unwrap());
    assert!(bytes[0] == bytes[1], "different files of the same maps");
    let text = stdout(&cairn(&["team", "status", &path("all-1.map".into())]));
    assert!(
        text.starts_with("robot     1, hears 2") && text.contains("received  block from robot 2"),
        "{text}"
    );
}

#[test]
fn a_run_shares_its_map_while_it_walks() {
    let folder = folder("team-run");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let free = || std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let (base, walker) = (free(), free());
    let mut join = Command::new(env!("CARGO_BIN_EXE_cairn"));
    join.args(["team", "join", &path("none.map"), "--robot", "9", "--team", "t", "--out", &path("base.map")]);
    join.args(["--all", "--listen", &base, "--for", "40"]);
    join.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
    let base_station = Running(join.spawn().expect("the binary starts"));
    let world = "sim:demo?seed=3&sensor=rgbd&resolution=320x240&rate=10&detail=0.5&duration=6";
    let run = ["run", world, "--realtime", "--map-every", "1", "--robot", "4", "--map-out", &path("own.map")];
    let team = ["--team", "t", "--listen", &walker, "--peer", &base, "--team-map", &path("all.map")];
    let walked = cairn(&[&run[..], &team].concat());
    assert!(walked.status.success(), "{}", stderr(&walked));
    let status = json(&cairn(&["team", "status", &path("all.map"), "--json"]));
    // It saved several times, and stayed until the base station had the last map.
    let version = status["maps"][0]["version"].as_u64().unwrap();
    assert!(version >= 3 && status["reached"][0] == 9, "{status}");
    let until = std::time::Instant::now() + std::time::Duration::from_secs(20);
    loop {
        let there = json_if_there(&cairn(&["team", "status", &path("base.map"), "--json"]));
        if there.is_some_and(|s| s["maps"] == status["maps"] && s["atlas"]["key_frames"].as_u64() > Some(1)) {
            break;
        }
        assert!(std::time::Instant::now() < until, "the base station has not got the map");
        std::thread::sleep(std::time::Duration::from_millis(200));
    }
    drop(base_station);
    // The pieces of earlier versions were not sent again.
    let sent = status["sent"].as_array().unwrap().iter().find(|s| s["kind"] == "block").unwrap();
    let bytes = std::fs::metadata(path("own.map")).unwrap().len();
    assert!(
        sent["bytes"].as_u64().unwrap() < 3 * bytes,
        "{sent} for a map of {bytes} bytes, {version} times"
    );
    // What is missing is usage.
    let alone = cairn(&["run", world, "--peer", &base]);
    assert_eq!(alone.status.code(), Some(2), "{}", stderr(&alone));
    assert_eq!(cairn(&["run", world, "--team", "t"]).status.code(), Some(2));
}

fn json_if_there(output: &std::process::Output) -> Option<Value> {
    output.status.success().then(|| json(output))
}

#[test]
fn what_cannot_be_shared_is_said_in_one_line() {
    let folder = folder("team-join-wrong");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (own, out) = (path("own.map"), path("all.map"));
    fails(&["team", "status", &out], &["all.map.team.json"]);
    let onto_itself = cairn(&["team", "join", &own, "--robot", "1", "--out", &own, "--for", "0"]);
    assert_eq!(onto_itself.status.code(), Some(2), "{}", stderr(&onto_itself));
    assert!(stderr(&onto_itself).contains("is the same file as MAP"), "{}", stderr(&onto_itself));
    let join = ["team", "join", &own, "--robot", "1", "--out", &out, "--for", "0"];
    fails(&[&join[..], &["--listen", "127.0.0.1:99999"]].concat(), &["--listen 127.0.0.1:99999"]);
    std::fs::write(path("secret"), "short").unwrap();
    fails(&[&join[..], &["--secret", &path("secret")]].concat(), &["it has 5 bytes"]);
    std::fs::write(path("own.map.robot-key"), "no key").unwrap();
    fails(&join, &["own.map.robot-key", "a key has 32 bytes"]);
}
