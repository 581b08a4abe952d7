//! Commands during a run: scripts, lines, voices, the start of the page.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

/// Seven seconds of the demo world at low resolution.
const WORLD: &str = "sim:demo?duration=7&resolution=320x240&sensor=rgbd&rate=10";

#[test]
fn script_records_and_guides() {
    let folder = folder("script");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let script = "tracked 5 record\nat 5.5 stop\nat 5.5 guide back # and off we go\nat 6.8 halt\n";
    std::fs::write(path("walk.script"), script).unwrap();
    let run = || cairn(&["run", WORLD, "--script", &path("walk.script"), "--routes", &path("routes")]);
    let (first, second) = (stdout(&run()), stdout(&run()));
    assert!(first.contains("0:00.4  Recording."), "{first}");
    assert!(first.contains("0:05.5  Recording has ended, 4 metres."), "{first}");
    assert!(first.contains("Guidance has ended."), "{first}");
    let announcements =
        |text: &str| text.lines().filter(|l| l.starts_with("0:")).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(announcements(&first), announcements(&second), "lockstep is deterministic");
    // The second run did not overwrite the route of the first.
    for n in 1..=2 {
        let info = json(&cairn(&["route", "info", &path(&format!("routes/route-000{n}.route")), "--json"]));
        assert!(info["points"].as_u64().unwrap() > 30, "{info}");
    }
    std::fs::write(path("wrong.script"), "at 5 record\nat noon stop\n").unwrap();
    fails(&["run", WORLD, "--script", &path("wrong.script")], &["wrong.script, line 2", "not a number"]);
    // A route recorded in another run belongs to another map.
    fails(
        &["run", WORLD, "--guide", &path("routes/route-0001.route")],
        &["route-0001.route", "with another camera or on another map"],
    );
    fails(&["run", WORLD, "--guide", &path("none.route")], &["none.route", "cannot be read"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn commands_are_read_from_standard_input() {
    let folder = folder("lines");
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["run", WORLD, "--realtime", "--lines", "--routes", folder.to_str().unwrap(), "--json"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut words = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    writeln!(input, "fly").unwrap();
    assert!(words.any(|l| l.contains("\"fly\" is not a command")), "the invalid command was not reported");
    writeln!(input, "record").unwrap();
    assert!(words.any(|l| l.contains("Recording.")), "nothing was recorded");
    std::thread::sleep(std::time::Duration::from_secs(2));
    writeln!(input, "quit").unwrap();
    drop(words);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(json(&output)["frames"].as_u64().unwrap() < 69, "quit did not end the run");
    let info = json(&cairn(&["route", "info", folder.join("route-0001.route").to_str().unwrap(), "--json"]));
    assert!(info["points"].as_u64().unwrap() > 5, "{info}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn unavailable_voices_are_reported_before_the_run() {
    let wrong = cairn(&["run", WORLD, "--say", "loud"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("text, speech, wav:FILE or none"), "{}", stderr(&wrong));
    let without_espeak = |how: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args(["run", WORLD, "--frames", "2", "--say", how])
            .env("PATH", "/nowhere")
            .output()
            .unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    for how in ["speech", "wav:/tmp/x.wav"] {
        let (code, text) = without_espeak(how);
        assert!(code == Some(1) && text.contains("apt install espeak-ng"), "{text}");
    }
}

#[test]
fn serve_prints_its_address_and_reports_a_taken_port() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let data = std::env::temp_dir().join(format!("cairn-serve-{}", std::process::id()));
    let data_text = data.to_str().unwrap();
    fails(&["serve", "--port", &port, "--data", data_text], &[&format!("port {port}"), "another --port"]);
    drop(taken);
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["serve", "--port", &port, "--lan", "--lines", "--data", data_text])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    let url = lines.find(|l| l.starts_with("https://")).unwrap();
    assert!(url.contains(&format!(":{port}/#k=")) && url.len() > 50, "{url}");
    // Routes of one folder have one writer.
    fails(
        &["serve", "--port", "0", "--data", data_text],
        &["another program keeps its routes there", "--data"],
    );
    // It quits on command, although no image has arrived.
    writeln!(child.stdin.take().unwrap(), "quit").unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    std::fs::remove_dir_all(&data).unwrap();
}
