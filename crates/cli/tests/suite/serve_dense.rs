//! Surfaces of `cairn serve --isolated --dense`: a process of its own, which is killed and hangs while the walk goes on.
#![cfg(unix)]

use cairn_dense::{BlockKey, SurfaceChange};
use cairn_engine::{Config, SensorMode};
use cairn_sensor::Source;
use cairn_session::{NotTracked, Slam, Surfaces};
use cairn_workers::{RemoteSetup, RemoteSlam, Role, RunEvent};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// What a page would draw.
#[derive(Default)]
struct Drawn {
    submaps: BTreeSet<u32>,
    blocks: BTreeMap<(u32, BlockKey), usize>,
    /// Tiles of columns, and how often all of them began anew.
    tiles: BTreeSet<[i32; 2]>,
    begun: usize,
}

impl Drawn {
    fn take(&mut self, change: SurfaceChange) {
        self.submaps = change.submaps.iter().map(|(number, _)| *number).collect();
        if change.columns.axes.is_some() {
            self.tiles.clear();
            self.begun += 1;
        }
        change.columns.gone.iter().for_each(|at| assert!(self.tiles.remove(at), "{at:?} was not there"));
        self.tiles.extend(change.columns.tiles.iter().map(|tile| tile.at));
        self.blocks.retain(|(number, _), _| self.submaps.contains(number));
        for (number, key, mesh) in change.blocks {
            assert!(self.submaps.contains(&number), "a block of submap {number}, which is not there");
            match mesh.triangles.len() {
                0 => self.blocks.remove(&(number, key)),
                n => self.blocks.insert((number, key), n),
            };
        }
    }

    fn triangles(&self) -> usize {
        self.blocks.values().sum()
    }

    /// Takes what comes until this is so.
    fn until(&mut self, changes: &Receiver<SurfaceChange>, what: &str, is_so: impl Fn(&Self) -> bool) {
        let began = Instant::now();
        while !is_so(self) {
            assert!(began.elapsed() < Duration::from_secs(60), "{what}: {} triangles", self.triangles());
            if let Ok(change) = changes.recv_timeout(Duration::from_millis(100)) {
                self.take(change);
            }
        }
    }
}

/// Processes and what was told of them.
type Heard = Arc<Mutex<(BTreeMap<Role, u32>, Vec<String>)>>;

fn begin(folder: &Path, source: &dyn Source, heard: &Heard) -> RemoteSlam {
    let run_folder = folder.to_owned();
    let command = move |role: Role| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cairn"));
        command.args(["serve", "--isolated", "--worker", role.name(), "--run-folder"]).arg(&run_folder);
        command
    };
    let told = heard.clone();
    let setup = RemoteSetup {
        folder,
        name: "a corridor".into(),
        rig: source.rig(),
        mode: SensorMode::Rgbd,
        imu: false,
        rate_hz: 10.0,
        config: Config::default(),
        dense: true,
        command: Arc::new(command),
        tell: Arc::new(move |what| {
            let mut heard = told.lock().unwrap();
            match what {
                RunEvent::Started { role, id } => drop(heard.0.insert(role, id)),
                what => heard.1.push(format!("{what:?}")),
            }
        }),
    };
    RemoteSlam::begin(setup, None).unwrap().0
}

fn signal(heard: &Heard, role: Role, signal: &str) {
    let id = heard.lock().unwrap().0[&role].to_string();
    assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
}

#[test]
fn surfaces_that_are_killed_or_hang_come_again_and_the_walk_does_not_notice() {
    if !Path::new("/dev/shm").is_dir() {
        println!("skipped: no /dev/shm on this machine");
        return;
    }
    let folder = PathBuf::from(format!("/dev/shm/cairn-test-serve-dense-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let address = "sim:corridor?sensor=rgbd&seed=1&rate=10&resolution=320x240&duration=16";
    let mut source = cairn_sources::open(address, cairn_sources::OpenOptions::default()).unwrap();
    let heard = Heard::default();
    let mut slam = begin(&folder, &*source, &heard);
    let config = cairn_dense::SubmapConfig::default();
    let Surfaces::Elsewhere { changes, wanted } = slam.surfaces(source.rig(), config).unwrap() else {
        panic!("surfaces are made in this process")
    };
    let (mut drawn, mut late) = (Drawn::default(), 0);
    let mut walk = |slam: &mut RemoteSlam, drawn: &mut Drawn, packets: usize| {
        for _ in 0..packets {
            let packet = source.next_packet().unwrap().expect("a packet");
            match slam.on_packet(&packet) {
                Ok(output) => assert!(output.pose.is_some(), "no pose"),
                // Beside other work an answer may be late.
                Err(NotTracked::Away(why)) => {
                    assert!(why.contains("late"), "{why}");
                    late += 1;
                }
                Err(why) => panic!("{why}"),
            }
            std::thread::sleep(Duration::from_millis(20));
            slam.look_after();
            changes.try_iter().for_each(|change| drawn.take(change));
        }
    };
    // Nothing is meshed until somebody wants to see it; then all that was seen so far comes.
    walk(&mut slam, &mut drawn, 50);
    assert!(drawn.submaps.is_empty() && changes.try_recv().is_err(), "nobody wants surfaces");
    wanted.any.store(true, Ordering::Relaxed);
    drawn.until(&changes, "the first surface", |d| d.triangles() > 5_000);
    assert!(drawn.tiles.is_empty(), "nobody wants columns");
    wanted.columns.store(true, Ordering::Relaxed);
    drawn.until(&changes, "the first columns", |d| d.tiles.len() > 10);
    let (before, first) = (drawn.triangles(), drawn.submaps.clone());
    // Killed: the walk goes on, nothing that is drawn goes away, and then all of it comes from the next process.
    signal(&heard, Role::Dense, "-KILL");
    walk(&mut slam, &mut drawn, 30);
    let is_next = |d: &Drawn| !d.submaps.is_empty() && d.submaps.is_disjoint(&first);
    drawn.until(&changes, "the surface of the next process", is_next);
    drawn.until(&changes, "all of it", |d| d.triangles() as f64 > 0.9 * before as f64);
    drawn.until(&changes, "the columns of the next process", |d| d.begun == 2 && d.tiles.len() > 10);
    // SLAM killed: surfaces follow what the next one writes.
    let grown = drawn.triangles();
    signal(&heard, Role::Slam, "-KILL");
    let began = Instant::now();
    while slam.away().is_some() || began.elapsed() < Duration::from_millis(500) {
        assert!(began.elapsed() < Duration::from_secs(60), "{:?}", slam.away());
        slam.look_after();
        std::thread::sleep(Duration::from_millis(20));
    }
    walk(&mut slam, &mut drawn, 40);
    drawn.until(&changes, "what was seen since", |d| d.triangles() > grown + 1_000);
    // One that hangs is found out.
    let second = drawn.submaps.clone();
    signal(&heard, Role::Dense, "-STOP");
    let is_other = |d: &Drawn| !d.submaps.is_empty() && d.submaps.is_disjoint(&second);
    drawn.until(&changes, "the surface after the one that hung", is_other);
    assert_eq!(slam.snapshot().maps().count(), 1);
    let told = heard.lock().unwrap().1.clone();
    let died = |role: &str| told.iter().filter(|t| t.contains("Died(") && t.contains(role)).count();
    assert_eq!((died("Dense"), died("Slam")), (2, 1), "{told:#?}");
    // With the session's map its surfaces end.
    let id = heard.lock().unwrap().0[&Role::Dense];
    drop(slam);
    let began = Instant::now();
    while changes.recv_timeout(Duration::from_millis(100))
        != Err(std::sync::mpsc::RecvTimeoutError::Disconnected)
    {
        assert!(began.elapsed() < Duration::from_secs(10), "surfaces go on without a map");
    }
    assert!(!Path::new(&format!("/proc/{id}")).exists(), "its process is gone");
    let _ = std::fs::remove_dir_all(&folder);
    println!("{late} answers were late");
}
