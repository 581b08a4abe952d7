//! `cairn demo --team N`: robots walk through one simulated world at once, each in two processes (cairn run and cairn
//! team join); one of them is killed in the middle and brought back, and goes on in the map that it had saved.

use crate::commands::team::status::TeamStatus;
use crate::failure::Failure;
use crate::interrupt;
use crate::output::{Output, note};
use crate::outputs::folder;
use cairn_atlas::RobotId;
use cairn_atlas::store::MapFile;
use cairn_files::MIB;
use cairn_geometry::{Se3, umeyama};
use cairn_sensor::Stamp;
use cairn_sim::SimSource;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs::File;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The robot that is killed, when, and after how long it is started again.
const KILLED: RobotId = 2;
const KILLED_AFTER_S: f64 = 8.0;
const AWAY: Duration = Duration::from_secs(3);
/// Until everyone has the same after the walks.
const SETTLE: Duration = Duration::from_secs(90);

/// Where and how a robot walks: seconds of the route that it skips, how long it walks, its speed and camera height.
struct Walk {
    start_s: f64,
    duration_s: f64,
    style: &'static str,
}

const WALKS: [Walk; 4] = [
    Walk { start_s: 0.0, duration_s: 24.0, style: "" },
    Walk { start_s: 6.0, duration_s: 16.0, style: "&speed=1.05&height=1.4" },
    Walk { start_s: 9.0, duration_s: 16.0, style: "&speed=0.95&height=1.35" },
    Walk { start_s: 3.0, duration_s: 16.0, style: "&height=1.45" },
];

impl Walk {
    fn source(&self, seed: u64, from_s: f64) -> String {
        let (start, duration) = (self.start_s + from_s, self.duration_s - from_s);
        let style = self.style;
        format!(
            "sim:demo?seed={seed}&sensor=rgbd&resolution=320x240&rate=10&detail=0.5&start={start}&duration={duration}{style}"
        )
    }

    fn truth(&self, seed: u64) -> Result<BTreeMap<Stamp, Se3>, Failure> {
        let address = self.source(seed, 0.0);
        let fail =
            |e: cairn_sensor::SourceError| Failure::new(&address, e.to_string(), "choose another --seed");
        let source = SimSource::open(&address).map_err(fail)?;
        Ok(cairn_sensor::Source::info(&source).truth.iter().copied().collect())
    }
}

/// A process that does not outlive the demo.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // Ended already is as good.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A robot: its files and its two processes.
struct Robot {
    number: RobotId,
    folder: PathBuf,
    address: String,
    walk: Option<Process>,
    share: Option<Process>,
}

#[derive(Serialize)]
struct RobotReport {
    robot: RobotId,
    key_frames: usize,
    /// Maps of its own: one that was brought back begins another where it does not recognise a place at once.
    own_maps: usize,
    /// Root mean square error of the positions of its key frames in metres, alone where it has one map, and in the atlas
    /// where that is one.
    ate_alone_m: Option<f64>,
    ate_in_atlas_m: Option<f64>,
    status: TeamStatus,
    /// Bytes that it sent, in the mean over the demo.
    sent_kb_per_s: f64,
}

#[derive(Serialize)]
struct Report {
    seconds: f64,
    killed: RobotId,
    /// From the end of the last walk until all had the same atlas.
    settled_after_s: f64,
    same_file_on_all: bool,
    maps: usize,
    /// The same of all in the atlas, where that is one map.
    ate_m: Option<f64>,
    /// As a multiple of that of the best robot alone.
    of_best_alone: Option<f64>,
    robots: Vec<RobotReport>,
}

/// Walks, kills, brings back, and reports.
///
/// # Errors
/// When a process cannot be started or fails, or the robots do not come to the same atlas.
pub fn run(count: u16, seed: u64, out: &Path, overwrite: bool, output: &Output) -> Result<(), Failure> {
    let out = out.join("team");
    if out.exists() && !overwrite {
        return Err(Failure::new(out.display().to_string(), "exists", "give another --out, or --overwrite"));
    }
    for earlier in (1..=WALKS.len()).map(|n| out.join(format!("robot-{n}"))).filter(|f| f.exists()) {
        std::fs::remove_dir_all(&earlier)
            .map_err(|e| Failure::new(earlier.display().to_string(), e.to_string(), "give another --out"))?;
    }
    let began = Instant::now();
    let mut robots = (1..=count).map(|n| Robot::new(n, &out)).collect::<Result<Vec<_>, _>>()?;
    let addresses: Vec<String> = robots.iter().map(|r| r.address.clone()).collect();
    for robot in &mut robots {
        robot.start(seed, 0.0, &addresses)?;
    }
    note(&format!("{count} robots walk, each in two processes"));
    wait(Duration::from_secs_f64(KILLED_AFTER_S))?;
    if let Some(robot) = robots.iter_mut().find(|r| r.number == KILLED) {
        (robot.walk, robot.share) = (None, None);
        note(&format!("robot {KILLED} is killed"));
        wait(AWAY)?;
        robot.start(seed, KILLED_AFTER_S, &addresses)?;
        note(&format!("robot {KILLED} is back and goes on in its saved map"));
    }
    for robot in &mut robots {
        robot.walk_ends()?;
    }
    let walked = Instant::now();
    note("all have walked");
    let statuses = settled(&robots, began)?;
    let settled_after_s = walked.elapsed().as_secs_f64();
    let seconds = began.elapsed().as_secs_f64();
    let report = report(&robots, statuses, seed, (seconds, settled_after_s))?;
    drop(robots);
    output.result(&report, text)
}

/// Sleeps, unless interrupted.
fn wait(time: Duration) -> Result<(), Failure> {
    let until = Instant::now() + time;
    while Instant::now() < until {
        if interrupt::requested() {
            return Err(Failure::new("the demo", "interrupted", "start it again"));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

impl Robot {
    fn new(number: RobotId, out: &Path) -> Result<Self, Failure> {
        let folder_of = out.join(format!("robot-{number}"));
        folder(&folder_of)?;
        // A free port; taken again a moment later.
        let free = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr());
        let address = free.map_err(|e| Failure::new("127.0.0.1", e.to_string(), "free a port"))?.to_string();
        Ok(Self { number, folder: folder_of, address, walk: None, share: None })
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn start(&mut self, seed: u64, from_s: f64, addresses: &[String]) -> Result<(), Failure> {
        let (own, atlas, number) = (self.file("own.map"), self.file("atlas.map"), self.number.to_string());
        let walk = WALKS.get(usize::from(self.number) - 1).unwrap_or(&WALKS[0]);
        let mut run = self.command("walk.log")?;
        run.args(["run", &walk.source(seed, from_s), "--robot", &number, "--realtime", "--overwrite"]);
        run.args(["--map-every", "4", "--map-out"]).arg(&own);
        // Brought back, it goes on in the map that it had saved.
        if from_s > 0.0 && own.exists() {
            run.arg("--map-in").arg(&own);
        }
        let mut join = self.command("share.log")?;
        join.args(["team", "join"]).arg(&own).args(["--robot", &number, "--team", "demo", "--overwrite"]);
        join.args(["--listen", &self.address, "--out"]).arg(&atlas);
        for other in addresses.iter().filter(|other| **other != self.address) {
            join.args(["--peer", other]);
        }
        let fail =
            |e: std::io::Error| Failure::new("cairn", e.to_string(), "the program cannot start itself");
        self.walk = Some(Process(run.spawn().map_err(fail)?));
        self.share = Some(Process(join.spawn().map_err(fail)?));
        Ok(())
    }

    /// This program again, with its words in a file.
    fn command(&self, log: &str) -> Result<Command, Failure> {
        let path = self.file(log);
        let fail =
            |e: std::io::Error| Failure::new(path.display().to_string(), e.to_string(), "check the folder");
        let log = File::options().create(true).append(true).open(&path).map_err(fail)?;
        let both = log.try_clone().map_err(fail)?;
        let mut command = Command::new(std::env::current_exe().map_err(fail)?);
        command.stdin(Stdio::null()).stdout(both).stderr(log);
        Ok(command)
    }

    fn walk_ends(&mut self) -> Result<(), Failure> {
        while let Some(Process(walk)) = &mut self.walk {
            let log = self.folder.join("walk.log");
            match walk.try_wait() {
                Ok(None) => wait(Duration::from_millis(100))?,
                Ok(Some(status)) if status.success() => self.walk = None,
                ended => {
                    let why = format!("the walk of robot {} failed: {ended:?}", self.number);
                    return Err(Failure::new(log.display().to_string(), why, "look into this file"));
                }
            }
        }
        Ok(())
    }

    fn status(&self) -> Option<TeamStatus> {
        let text = cairn_files::read_text(&self.file("atlas.map.team.json"), 16 * MIB).ok()?;
        serde_json::from_str(&text).ok()
    }
}

/// Waits until all have the same maps, and made their atlas of them.
fn settled(robots: &[Robot], began: Instant) -> Result<Vec<TeamStatus>, Failure> {
    // A status is written at each step: one of before the last save of a map would be outdated.
    wait(Duration::from_secs(2))?;
    let until = Instant::now() + SETTLE;
    loop {
        let statuses: Vec<TeamStatus> = robots.iter().filter_map(Robot::status).collect();
        let done = |s: &TeamStatus| {
            s.digest == statuses[0].digest
                && s.maps.len() == robots.len()
                && s.atlas.as_ref().is_some_and(|atlas| atlas.digest == s.digest)
        };
        if statuses.len() == robots.len() && statuses.iter().all(done) {
            return Ok(statuses);
        }
        if Instant::now() > until {
            let why = format!("no common atlas after {:.0} s", began.elapsed().as_secs_f64());
            return Err(Failure::new("the team", why, "look into share.log of each robot"));
        }
        wait(Duration::from_millis(200))?;
    }
}

fn report(
    robots: &[Robot],
    statuses: Vec<TeamStatus>,
    seed: u64,
    (seconds, settled_after_s): (f64, f64),
) -> Result<Report, Failure> {
    let load = |path: PathBuf| crate::commands::map::open(&path);
    let atlas = load(robots[0].file("atlas.map"))?;
    let bytes: Vec<_> =
        robots.iter().map(|r| cairn_files::read(&r.file("atlas.map"), 1024 * MIB).ok()).collect();
    let maps = atlas.snapshot.maps().count();
    let mut truth = BTreeMap::new();
    for (robot, walk) in robots.iter().zip(&WALKS) {
        truth.insert(robot.number, walk.truth(seed)?);
    }
    let mut reports = Vec::new();
    for (robot, status) in robots.iter().zip(statuses) {
        let own = load(robot.file("own.map"))?;
        let only = [robot.number];
        let sent: u64 = status.sent.iter().map(|s| s.amount.bytes).sum();
        reports.push(RobotReport {
            robot: robot.number,
            key_frames: own.snapshot.key_frame_count(),
            own_maps: own.snapshot.maps().count(),
            ate_alone_m: ate(&own, &truth, &only)?,
            ate_in_atlas_m: ate(&atlas, &truth, &only)?,
            status,
            sent_kb_per_s: sent as f64 / 1000.0 / seconds,
        });
    }
    let best = reports.iter().filter_map(|r| r.ate_alone_m).min_by(f64::total_cmp);
    let all: Vec<RobotId> = robots.iter().map(|r| r.number).collect();
    let ate_m = ate(&atlas, &truth, &all)?;
    Ok(Report {
        seconds,
        killed: KILLED,
        settled_after_s,
        same_file_on_all: bytes.iter().all(|b| b.is_some() && *b == bytes[0]),
        maps,
        ate_m,
        of_best_alone: ate_m.zip(best).map(|(all, best)| all / best),
        robots: reports,
    })
}

/// Root mean square error of the positions of the key frames of some robots, aligned by SE3; `None` where they are in
/// several maps, which have no common frame.
fn ate(
    file: &MapFile,
    truth: &BTreeMap<RobotId, BTreeMap<Stamp, Se3>>,
    robots: &[RobotId],
) -> Result<Option<f64>, Failure> {
    if file.snapshot.maps().count() != 1 {
        return Ok(None);
    }
    let (mut estimated, mut true_ones) = (Vec::new(), Vec::new());
    for k in file.snapshot.key_frames() {
        let robot = file.snapshot.key_frame_name(k.id).robot;
        let body = robots.contains(&robot).then(|| truth.get(&robot)?.get(&k.stamp)).flatten();
        if let Some(body) = body {
            estimated.push(k.world_from_camera.translation);
            true_ones.push((*body * file.about.camera.body_from_camera).translation);
        }
    }
    let why = "its key frames determine no alignment with the truth";
    let fit = umeyama(&true_ones, &estimated, false)
        .map_err(|_| Failure::new(format!("robots {robots:?}"), why, "choose another --seed"))?;
    let squares: f64 = estimated.iter().zip(&true_ones).map(|(e, t)| (fit * *e - *t).norm_squared()).sum();
    Ok(Some((squares / estimated.len() as f64).sqrt()))
}

fn text(r: &Report) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let same = if r.same_file_on_all { "the same file on all" } else { "NOT the same file on all" };
    let _ = writeln!(
        text,
        "team      {} robots in {:.0} s, robot {} killed and brought back; the same maps {:.1} s after the last walk",
        r.robots.len(),
        r.seconds,
        r.killed,
        r.settled_after_s
    );
    if let Some(atlas) = r.robots.first().and_then(|r| r.status.atlas.as_ref()) {
        let maps: Vec<String> = atlas.maps.iter().map(|robots| robots.join(" + ")).collect();
        let _ = writeln!(text, "atlas     {} key frames, {}; {same}", atlas.key_frames, maps.join("; "));
        for why in &atlas.apart {
            let _ = writeln!(text, "apart     {why}");
        }
    }
    match (r.ate_m, r.of_best_alone) {
        (Some(all), Some(times)) => {
            let _ = writeln!(text, "ATE       {all:.3} m of all, {times:.2} times that of the best alone");
        }
        _ => {
            let _ = writeln!(text, "ATE       not of all: there are {} maps", r.maps);
        }
    }
    let metres = |ate: Option<f64>| ate.map_or_else(|| "-".into(), |ate| format!("{ate:.3} m"));
    for robot in &r.robots {
        let _ = writeln!(
            text,
            "robot {}   {} key frames in {} of its own maps; ATE alone {}, in the atlas {}; {:.1} kB/s sent",
            robot.robot,
            robot.key_frames,
            robot.own_maps,
            metres(robot.ate_alone_m),
            metres(robot.ate_in_atlas_m),
            robot.sent_kb_per_s
        );
        let kinds = robot.status.sent.iter().map(|s| format!("{} {} B", s.kind, s.amount.bytes));
        let _ = writeln!(text, "          sent: {}", kinds.collect::<Vec<_>>().join(", "));
    }
    text
}
