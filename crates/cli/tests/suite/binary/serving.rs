//! `cairn serve` on a machine that lacks something: room on the disk, descriptors.
#![cfg(unix)]

use crate::binary::folder;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

const WORLD: &str = "sim:demo?duration=60&resolution=320x240&sensor=rgbd&rate=10";

/// A server with its lines as they come.
struct Served {
    child: Child,
    port: u16,
    lines: Receiver<String>,
}

impl Served {
    /// Begun by a shell that sets limits first.
    fn start(limits: &str, data: &Path) -> Self {
        let program = env!("CARGO_BIN_EXE_cairn");
        let mut child = Command::new("sh")
            .args(["-c", &format!("{limits}; exec \"$0\" \"$@\""), program, "serve", WORLD])
            .args(["--lines", "--json", "--port", "0", "--data"])
            .arg(data)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, lines) = channel();
        let err = child.stderr.take().unwrap();
        std::thread::spawn(move || {
            BufReader::new(err).lines().map_while(Result::ok).for_each(|line| drop(to.send(line)));
        });
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut text = String::new();
        let shown: serde_json::Value = loop {
            assert!(out.read_line(&mut text).unwrap() > 0, "no invitation: {text}");
            if let Ok(whole) = serde_json::from_str(&text) {
                break whole;
            }
        };
        let url = shown["urls"][0].as_str().unwrap();
        let port = url.split(':').nth(2).unwrap().split('/').next().unwrap().parse().unwrap();
        Self { child, port, lines }
    }

    fn ask(&mut self, line: &str) {
        writeln!(self.child.stdin.as_mut().unwrap(), "{line}").unwrap();
    }

    /// The next line with this text.
    #[track_caller]
    fn line(&self, text: &str) -> String {
        let mut before = Vec::new();
        while let Ok(line) = self.lines.recv_timeout(Duration::from_secs(20)) {
            if line.contains(text) {
                return line;
            }
            before.push(line);
        }
        panic!("no '{text}' after {before:?}");
    }

    /// The exit code, within so long.
    #[track_caller]
    fn code(&mut self) -> Option<i32> {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            assert!(began.elapsed() < Duration::from_secs(20), "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // A test that failed leaves none.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn full_disk_under_a_server_is_said_on_the_terminal_at_stop_and_at_the_end() {
    let data = folder("serving-full");
    // No file grows beyond 60 kB, as on a disk that has no room for the map.
    let mut served = Served::start("trap '' XFSZ; ulimit -f 120", &data);
    served.ask("record");
    served.line("the map of the routes is not saved");
    served.ask("stop");
    let stopped = served.line("The map cannot be saved");
    assert!(stopped.starts_with("Recording has ended"), "{stopped}");
    served.line("make room on the disk");
    served.ask("quit");
    let end = served.line("error: ");
    assert!(end.contains("the map of the routes is not saved") && end.contains("make room"), "{end}");
    assert_eq!(served.code(), Some(1));
    std::fs::remove_dir_all(&data).unwrap();
}

#[test]
fn more_connections_than_descriptors_end_no_server_and_keep_nobody_out() {
    let data = folder("serving-flood");
    let mut served = Served::start("ulimit -n 160", &data);
    served.ask("record");
    let connect = || TcpStream::connect(("127.0.0.1", served.port)).unwrap();
    let held: Vec<TcpStream> = (0..300).map(|_| connect()).collect();
    let began = Instant::now();
    // Who comes is answered at once; without TLS with the way to come.
    let mut page = connect();
    page.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    page.write_all(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n").unwrap();
    let mut answer = String::new();
    page.read_to_string(&mut answer).unwrap();
    assert!(answer.contains("https://"), "{answer}");
    assert!(began.elapsed() < Duration::from_secs(3), "{:?}", began.elapsed());
    // The walk goes on meanwhile, and what it writes is whole.
    std::thread::sleep(Duration::from_secs(6));
    served.ask("stop");
    let stopped = served.line("Recording has ended");
    assert!(!stopped.contains("cannot be saved"), "{stopped}");
    served.ask("quit");
    assert_eq!(served.code(), Some(0));
    let routes: Vec<_> = std::fs::read_dir(data.join("routes")).unwrap().map(|f| f.unwrap().path()).collect();
    assert!(routes.iter().any(|path| path.extension().is_some_and(|e| e == "map")), "{routes:?}");
    drop(held);
    std::fs::remove_dir_all(&data).unwrap();
}
