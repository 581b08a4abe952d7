//! `cairn serve --isolated`: the page with its walk in one process, SLAM in another, under a supervisor.
//!
//! The same command line runs them all. The supervisor adds `--worker walk` and the folder of the run, the process of the walk
//! adds `--worker slam`, and with `--dense` one more with `--worker dense`. What must survive the walk lies in that folder: the access token and the port, so that the phone
//! comes back, and the journal of the map.

use crate::failure::Failure;
use crate::processes::{folder_in, line, this_program};
use crate::{interrupt, terminal};
use cairn_dense::SubmapConfig;
use cairn_engine::{Config, DenseMapper, Runner};
use cairn_session::{Command, Slam};
use cairn_web::{Remote, Server, StartSlam};
use cairn_workers::{RemoteSetup, RemoteSlam, Role, dense, respawn};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval of the signs of life.
const BEAT: Duration = Duration::from_millis(100);
/// A session that takes no step for so long is stuck. It may write a large map meanwhile.
const STUCK: Duration = Duration::from_secs(10);
/// Pages that nothing is sent to for so long are stuck: nobody hears what the guide says.
const MUTE: Duration = Duration::from_secs(1);

/// By what pages find a server again.
#[derive(Serialize, Deserialize)]
pub struct Serving {
    /// The access token.
    pub token: String,
    /// The port.
    pub port: u16,
}

/// Serves in processes, in a folder under `parent`, until the one with the page ends by itself; gives its exit code.
///
/// # Errors
/// When a process cannot be started, or dies again and again.
pub fn supervise(parent: &Path) -> Result<i32, Failure> {
    let folder = folder_in(parent)?;
    interrupt::in_order();
    let quit = folder.path().join(QUIT);
    // Without the file the page goes on; a second signal ends it.
    interrupt::at_request(move || drop(std::fs::write(&quit, "")));
    let mode = terminal::Mode::now();
    let command = || {
        mode.restore();
        let mut command = this_program(Role::Walk);
        command.arg("--run-folder").arg(folder.path());
        command
    };
    let alive = folder.path().join(ALIVE);
    let ended = respawn(Role::Walk, command, &alive, &mut |told| {
        line(&told).iter().for_each(|line| eprintln!("{line}"));
    });
    mode.restore();
    ended.map_err(|e| {
        Failure::new("the page", e.to_string(), "serve without --isolated to see where it fails")
    })
}

const ALIVE: &str = "alive";
const QUIT: &str = "quit";
const SERVING: &str = "serving.json";

/// How a process of the walk before this one was reached.
pub fn before(folder: &Path) -> Option<Serving> {
    let text = std::fs::read_to_string(folder.join(SERVING)).ok()?;
    serde_json::from_str(&text).ok()
}

/// Ties the walk to its supervisor: signs of life, an end where it is asked for, and how pages find the next one.
///
/// # Errors
/// When nothing can be written into the folder.
pub fn tie(folder: &Path, server: &Server) -> Result<(), Failure> {
    let serving = Serving { token: server.invitation().token.clone(), port: server.address().port() };
    let failed = |e: &dyn std::fmt::Display| {
        Failure::new(folder.display().to_string(), e.to_string(), "free some shared memory")
    };
    let text = serde_json::to_string(&serving).map_err(|e| failed(&e))?;
    std::fs::write(folder.join(SERVING), text).map_err(|e| failed(&e))?;
    let (remote, folder) = (server.remote(), folder.to_owned());
    let beats = std::thread::Builder::new().name("cairn-beats".into()).spawn(move || beat(&remote, &folder));
    beats.map(drop).map_err(|e| failed(&e))
}

fn beat(remote: &Remote, folder: &Path) {
    let mut progress = Progress::new(Instant::now());
    loop {
        if progress.goes_on(remote.steps(), remote.turns(), Instant::now()) {
            // A sign that cannot be written is missed, and this process started again.
            let _ = std::fs::write(folder.join(ALIVE), "");
        }
        if folder.join(QUIT).exists() {
            remote.command(Command::Quit);
        }
        std::thread::sleep(BEAT);
    }
}

/// When the session and the pages have last done something.
struct Progress {
    steps: (Option<u64>, Instant),
    turns: (u64, Instant),
}

impl Progress {
    fn new(now: Instant) -> Self {
        Self { steps: (None, now), turns: (0, now) }
    }

    /// Whether neither is stuck. A session that does not run takes no steps.
    fn goes_on(&mut self, steps: Option<u64>, turns: u64, now: Instant) -> bool {
        if steps != self.steps.0 || steps.is_none() {
            self.steps = (steps, now);
        }
        if turns != self.turns.0 {
            self.turns = (turns, now);
        }
        now.duration_since(self.steps.1) < STUCK && now.duration_since(self.turns.1) < MUTE
    }
}

/// SLAM as a process of its own.
pub fn slam_elsewhere(folder: PathBuf) -> StartSlam {
    Box::new(move |s, map| {
        let setup = RemoteSetup {
            folder: &folder,
            name: s.name.to_owned(),
            rig: s.rig,
            mode: s.mode,
            imu: s.imu,
            rate_hz: s.rate_hz,
            config: s.config.clone(),
            dense: s.dense,
            command: Arc::new(this_program),
            tell: Arc::new(|told| line(&told).iter().for_each(|line| eprintln!("{line}"))),
        };
        let (slam, notes) = RemoteSlam::begin(setup, map)?;
        Ok((Box::new(slam) as Box<dyn Slam>, notes))
    })
}

/// Does the work of SLAM for the walk that has started this process.
pub fn work(config: &Config) {
    cairn_workers::slam::run(std::io::stdin(), std::io::stdout(), config, Runner::Threaded);
}

/// Makes surfaces for the walk that has started this process.
pub fn surfaces() {
    type Never = fn(&mut DenseMapper, bool) -> Result<Vec<u8>, cairn_workers::message::Failure>;
    dense::run(std::io::stdin(), std::io::stdout(), || {
        let (config, saved) = (SubmapConfig::default(), Vec::new());
        Ok(dense::Work::<Never> { config, saved, surface: None })
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_whose_pages_or_whose_session_hang_gives_no_sign_of_life() {
        let began = Instant::now();
        let at = |s: f64| began + Duration::from_secs_f64(s);
        let mut progress = Progress::new(began);
        // Before the first picture there is no session.
        assert!((0..300).all(|k| progress.goes_on(None, k, at(0.1 * k as f64))));
        assert!((300..400).all(|k| progress.goes_on(Some(k), k, at(0.1 * k as f64))));
        // The session goes on, and nobody hears it.
        assert!(progress.goes_on(Some(400), 399, at(40.8)));
        assert!(!progress.goes_on(Some(410), 399, at(41.0)));
        assert!(progress.goes_on(Some(411), 412, at(41.1)), "it was late, no more");
        // The pages go on, and the session does not.
        assert!(progress.goes_on(Some(411), 500, at(51.0)) && !progress.goes_on(Some(411), 501, at(51.2)));
    }
}
