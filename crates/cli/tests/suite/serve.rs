//! `cairn serve --isolated`: a phone on a simulated walk, as the page behaves, and processes that are killed on the way.
//!
//! `cargo test --release -p cairn-cli --test suite serve:: -- --ignored --nocapture` kills SLAM at many moments and prints the figures of
//! `docs/figures/processes.md`.
#![cfg(unix)]

#[path = "../../../web/tests/suite/network/phone.rs"]
mod phone;

use crate::walked;
use cairn_engine::{Config, SensorMode};
use cairn_random::Random;
use cairn_sensor::{Camera, FramePacket, GrayImage, Rig};
use cairn_session::Slam;
use cairn_trial::PageClock;
use cairn_workers::{RemoteSetup, RemoteSlam, RunEvent};
use phone::{Album, Phone, Walk};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Where the walk begins in the world, and its duration, seconds; there is a corner in it.
const START_S: f64 = 9.5;
const OUT_S: f64 = 9.0;

/// A server in processes.
struct Served {
    child: Child,
    lines: Arc<Mutex<Vec<(Instant, String)>>>,
    data: PathBuf,
    token: String,
    port: u16,
}

impl Served {
    fn start(name: &str, more: &[&str]) -> Self {
        let data = std::env::temp_dir().join(format!("cairn-serve-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&data);
        std::fs::create_dir_all(&data).unwrap();
        let rig = data.join("rig.toml");
        std::fs::write(&rig, cairn_sources::write_rig(&Rig::mono(walked::camera())).unwrap()).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args(["serve", "--isolated", "--json", "--lines", "--port", "0", "--data"])
            .arg(&data)
            .arg("--rig")
            .arg(&rig)
            .args(more)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = Arc::new(Mutex::new(Vec::new()));
        let (err, told) = (child.stderr.take().unwrap(), lines.clone());
        std::thread::spawn(move || {
            for line in BufReader::new(err).lines().map_while(Result::ok) {
                println!("  {line}");
                told.lock().unwrap().push((Instant::now(), line));
            }
        });
        let mut invitation = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let shown: Value = loop {
            assert!(out.read_line(&mut invitation).unwrap() > 0, "no invitation: {invitation}");
            if let Ok(whole) = serde_json::from_str(&invitation) {
                break whole;
            }
        };
        let url = shown["urls"][0].as_str().unwrap();
        let port = url.split(':').nth(2).unwrap().split('/').next().unwrap().parse().unwrap();
        Self { child, lines, data, token: shown["token"].as_str().unwrap().to_owned(), port }
    }

    /// The process that does this at present.
    fn id(&self, role: &str) -> String {
        let began = format!("{role}: process ");
        let lines = self.lines.lock().unwrap();
        let line = lines.iter().rev().find_map(|(_, line)| line.strip_prefix(&began).map(str::to_owned));
        line.unwrap_or_else(|| panic!("no {role} in {lines:?}"))
    }

    fn count(&self, text: &str) -> usize {
        self.lines.lock().unwrap().iter().filter(|(_, line)| line.contains(text)).count()
    }

    fn phone(&self, album: Arc<Album>) -> Phone {
        let mut roots = rustls::RootCertStore::empty();
        roots.add(CertificateDer::from_pem_file(self.data.join("page.pem")).unwrap()).unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let builder =
            rustls::ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
        let tls = Arc::new(builder.unwrap().with_root_certificates(roots).with_no_client_auth());
        let address = ([127, 0, 0, 1], self.port).into();
        Phone::new(PageClock::new(1e9, 1e-5), album, tls, address, self.token.clone())
    }

    /// Ends it as its user does; its shared memory is gone.
    fn quit(mut self) {
        writeln!(self.child.stdin.take().unwrap(), "quit").unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(0));
        assert!(!Path::new("/dev/shm").join(format!("cairn-{}", self.child.id())).exists());
        std::fs::remove_dir_all(&self.data).unwrap();
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // A test that failed leaves none.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The machine to one test alone, since walks are in real time; `None` where it has no shared memory.
fn alone() -> Option<MutexGuard<'static, ()>> {
    static ALONE: Mutex<()> = Mutex::new(());
    let has = Path::new("/dev/shm").is_dir();
    if !has {
        println!("skipped: no /dev/shm on this machine");
    }
    has.then(|| ALONE.lock().unwrap_or_else(PoisonError::into_inner))
}

fn album() -> Arc<Album> {
    let out = walked::route_out(START_S, OUT_S);
    Arc::new(Album::new(out.iter().map(|packet| GrayImage::clone(&packet.images[0])).collect()))
}

fn signal(name: &str, id: &str) -> Instant {
    assert!(Command::new("kill").args([name, id]).status().unwrap().success());
    Instant::now()
}

/// Seconds from an instant to the first of these after it.
fn after(instants: &[Instant], at: Instant) -> Option<f64> {
    instants.iter().find(|i| **i > at).map(|i| (*i - at).as_secs_f64())
}

fn block_on<F: Future>(walk: F) -> F::Output {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(walk)
}

/// The way out, recorded; `meanwhile` is done on the way.
async fn record(served: &Served, phone: &mut Phone, meanwhile: impl FnOnce(&Served)) {
    phone.connect().await;
    // A moving camera starts the map; the recording begins there.
    phone.walk(Walk::To(0), Duration::from_secs(2)).await;
    phone.command("record").await;
    phone.walk(Walk::Out, Duration::from_millis(4500)).await;
    meanwhile(served);
    let out = phone.walk(Walk::Out, Duration::from_secs(30)).await;
    assert!(out.walked >= 1.0, "{out:?}");
    // Whoever it held the walk with may have died.
    let limit = Instant::now() + Duration::from_secs(20);
    while !phone.holds() {
        assert!(Instant::now() < limit, "the phone does not get back: {:#?}", phone.heard_texts);
        phone.walk(Walk::To(phone.at as usize), Duration::from_millis(300)).await;
    }
    phone.command("stop").await;
    phone.walk(Walk::To(phone.at as usize), Duration::from_millis(600)).await;
}

/// Until a direction is given after so many.
async fn directed(phone: &mut Phone, before: usize) {
    let limit = Instant::now() + Duration::from_secs(30);
    while phone.directed.len() <= before {
        assert!(Instant::now() < limit, "no direction: {:#?}", phone.heard_texts);
        phone.walk(Walk::To(0), Duration::from_millis(300)).await;
    }
}

#[test]
fn slam_that_is_killed_or_hangs_costs_neither_the_connection_nor_the_walk() {
    let Some(_alone) = alone() else { return };
    let served = Served::start("killed", &[]);
    let mut phone = served.phone(album());
    block_on(async {
        record(&served, &mut phone, |served| {
            signal("-KILL", &served.id("slam"));
        })
        .await;
        assert_eq!(served.count("slam died"), 1);
        phone.command("guide back").await;
        for (how, limit_s) in [("-KILL", 0.3), ("-STOP", 0.6)] {
            let before = phone.directed.len();
            directed(&mut phone, before).await;
            let at = signal(how, &served.id("slam"));
            let (mut connections, limit) = (0, Instant::now() + Duration::from_secs(15));
            while after(&phone.directed, at).is_none() && Instant::now() < limit {
                connections += phone.walk(Walk::To(0), Duration::from_millis(100)).await.connections;
            }
            let stopped = after(&phone.stopped, at).expect("the phone hears stop");
            let directed = after(&phone.directed, at).expect("guidance goes on");
            println!("slam {how}: stop heard after {stopped:.3} s, a direction after {directed:.3} s");
            assert!(stopped < limit_s, "{how}: stop heard after {stopped} s");
            assert_eq!(connections, 0, "the phone keeps its connection");
        }
        // The walker stood while this test looked: he is told anew where to go.
        phone.command("guide back").await;
        let home = phone.walk(Walk::To(0), Duration::from_secs(40)).await;
        println!("{:#?}", phone.heard_texts);
        assert!(phone.heard_texts.iter().any(|t| t.starts_with("Stop. You have arrived")), "{home:?}");
        assert_eq!(home.connections, 0);
    });
    assert_eq!(served.count("slam died"), 3);
    served.quit();
}

#[test]
fn slam_begins_again_with_another_lens_in_a_map_of_its_own() {
    let Some(_alone) = alone() else { return };
    let folder = std::env::temp_dir().join(format!("cairn-serve-again-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let started = Arc::new(Mutex::new(Vec::new()));
    let begin = |camera: Camera| {
        let (rig, started) = (Rig::mono(camera), started.clone());
        let run_folder = folder.clone();
        let command = move |_| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_cairn"));
            command.args(["serve", "--isolated", "--worker", "slam", "--run-folder"]).arg(&run_folder);
            command
        };
        let setup = RemoteSetup {
            folder: &folder,
            name: "a phone".into(),
            rig: &rig,
            mode: SensorMode::Mono,
            imu: false,
            rate_hz: 10.0,
            config: Config::default(),
            dense: false,
            command: Arc::new(command),
            tell: Arc::new(move |told| {
                if let RunEvent::Started { id, .. } = told {
                    started.lock().unwrap().push(id);
                }
            }),
        };
        RemoteSlam::begin(setup, None).unwrap().0
    };
    let known = walked::camera();
    let guess = Camera { fx: 0.98 * known.fx, fy: 0.98 * known.fy, ..known };
    let packets = walked::route_out(START_S, 3.0);
    // Beside other work an answer may be late.
    let walk = |slam: &mut RemoteSlam, later_s: f64| {
        for packet in &packets {
            let stamp = packet.stamp.plus_seconds(later_s);
            let _ = slam.on_packet(&FramePacket { stamp, ..packet.clone() });
            std::thread::sleep(Duration::from_millis(20));
            slam.look_after();
        }
    };
    let mut slam = begin(guess);
    walk(&mut slam, 0.0);
    assert!(slam.snapshot().key_frame_count() >= 2, "{}", slam.snapshot().key_frame_count());
    slam.end();
    assert!(slam.away().is_some(), "one that has ended has no poses");
    let mut next = begin(known);
    drop(slam);
    assert_eq!(next.snapshot().key_frame_count(), 0, "not in the map of the other lens");
    assert!((next.camera().fx - known.fx).abs() < 1e-9);
    walk(&mut next, 10.0);
    assert!(next.away().is_none() && next.snapshot().key_frame_count() >= 2);
    let ids = started.lock().unwrap().clone();
    assert_eq!(ids.len(), 2);
    assert!(!Path::new(&format!("/proc/{}", ids[0])).exists(), "the first process is gone");
    drop(next);
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn walk_that_is_killed_goes_on_where_it_was() {
    let Some(_alone) = alone() else { return };
    let served = Served::start("walk", &[]);
    let mut phone = served.phone(album());
    block_on(async {
        // In the middle of a recording.
        record(&served, &mut phone, |served| {
            signal("-KILL", &served.id("walk"));
        })
        .await;
        assert_eq!(served.count("walk died: "), 1);
        phone.command("guide back").await;
        directed(&mut phone, 0).await;
        // In the middle of guidance.
        let at = signal("-KILL", &served.id("walk"));
        let home = phone.walk(Walk::To(0), Duration::from_secs(40)).await;
        let directed = after(&phone.directed, at).expect("guidance goes on");
        println!("walk killed: a direction after {directed:.3} s, {} connections", home.connections);
        println!("{:#?}", phone.heard_texts);
        assert!(phone.heard_texts.iter().any(|t| t.starts_with("Stop. You have arrived")), "{home:?}");
        assert!(home.connections >= 1, "the phone came back by itself");
    });
    assert_eq!(served.count("walk died: "), 2);
    let routes: Vec<_> = std::fs::read_dir(served.data.join("routes"))
        .unwrap()
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "route"))
        .collect();
    let [route] = &routes[..] else { panic!("{routes:?}") };
    let route = cairn_guide::Route::load(route).unwrap();
    let gaps = route.points.iter().filter(|p| p.stretch == cairn_guide::Stretch::Gap).count();
    println!("one route of {} points, {gaps} gaps", route.points.len());
    assert!(route.points.len() > 30 && gaps <= 2, "{} points, {gaps} gaps", route.points.len());
    served.quit();
}

/// The figures of `docs/figures/processes.md`: SLAM killed and stopped at random moments of guided walks.
#[test]
#[ignore = "minutes; prints figures"]
fn fifty_deaths_of_slam_on_guided_walks() {
    let served = Served::start("fifty", &[]);
    let mut phone = served.phone(album());
    let mut random = Random::new(7);
    block_on(async {
        record(&served, &mut phone, |_| ()).await;
        for (how, times) in [("-KILL", 50), ("-STOP", 10)] {
            let (mut stops, mut directions, mut connections) = (Vec::new(), Vec::new(), 0);
            for n in 0..times {
                let back = 2.0 * phone.at > phone.album.len() as f64;
                let (line, goal) =
                    if back { ("guide back", 0) } else { ("guide again", phone.album.len() - 1) };
                phone.command("halt").await;
                phone.walk(Walk::To(phone.at as usize), Duration::from_millis(600)).await;
                phone.command(line).await;
                let before = phone.directed.len();
                while phone.directed.len() == before {
                    phone.walk(Walk::To(goal), Duration::from_millis(100)).await;
                }
                phone.walk(Walk::To(goal), Duration::from_millis(random.below(800) as u64)).await;
                let at = signal(how, &served.id("slam"));
                let limit = Instant::now() + Duration::from_secs(10);
                let mut deaths = 0;
                while after(&phone.directed, at).is_none() && Instant::now() < limit {
                    let leg = phone.walk(Walk::To(goal), Duration::from_millis(100)).await;
                    (deaths, connections) = (deaths + leg.connections, connections + leg.connections);
                }
                match (after(&phone.stopped, at), after(&phone.directed, at)) {
                    (Some(stop), Some(direction)) => {
                        stops.push(stop);
                        directions.push(direction);
                    }
                    other => println!("{how} {n}: {other:?}"),
                }
            }
            let words = |s: &mut Vec<f64>| {
                s.sort_by(f64::total_cmp);
                s.last().map_or("-".into(), |last| format!("{:.3}, {last:.3}", s[s.len() / 2]))
            };
            let (n, stop, direction) = (stops.len(), words(&mut stops), words(&mut directions));
            println!(
                "slam {how} {n} times: stop heard {stop} s, a direction {direction} s (median, worst), {connections} connections lost"
            );
        }
        let lines = served.lines.lock().unwrap();
        let again: Vec<&str> =
            lines.iter().filter_map(|(_, l)| l.strip_prefix("slam has a pose again after ")).collect();
        let mut seconds: Vec<f64> = again.iter().filter_map(|l| l.split(' ').next()?.parse().ok()).collect();
        seconds.sort_by(f64::total_cmp);
        let frames: Vec<usize> =
            again.iter().filter_map(|l| l.split(", ").nth(1)?.split(' ').next()?.parse().ok()).collect();
        println!("a pose again: {seconds:?} s, frames without one {frames:?}");
    });
    served.quit();
}
