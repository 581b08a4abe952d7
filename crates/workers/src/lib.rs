#![cfg(unix)]
#![doc = include_str!("../README.md")]

mod anchored;
mod backoff;
pub mod capture;
pub mod dense;
pub mod depth_log;
pub mod guide;
pub mod journal;
mod limits;
pub mod message;
pub mod pixels;
mod process;
mod remote;
mod remote_dense;
mod respawn;
pub mod ring;
mod run_folder;
mod seen;
mod shown;
pub mod slam;
mod speech;
mod supervision;
mod supervisor;
mod surfaces;
mod worker;

pub use journal::JournalError;
pub use limits::{die_with_parent, limit_memory, raise_open_files};
pub use process::Start;
pub use remote::{RemoteSetup, RemoteSlam};
pub use respawn::respawn;
pub use run_folder::{RunFolder, SHARED_MEMORY, remove_abandoned};
pub use supervision::{Death, EventSink, RunEvent, Supervised, Supervision};
pub use supervisor::supervise;

use cairn_engine::SensorMode;
use cairn_sensor::Rig;
use message::{Failure, Opened};
use std::path::Path;

/// What a worker does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Reads the source.
    Capture,
    /// Tracks and maps.
    Slam,
    /// Makes surfaces.
    Dense,
    /// Guides along a route.
    Guide,
    /// Serves the page of a walk: its session, with recording and guide.
    Walk,
}

impl Role {
    /// Its name, also on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Capture => "capture",
            Self::Slam => "slam",
            Self::Dense => "dense",
            Self::Guide => "guide",
            Self::Walk => "walk",
        }
    }

    /// The role of this name.
    pub fn named(name: &str) -> Option<Self> {
        let all = [Self::Capture, Self::Slam, Self::Dense, Self::Guide, Self::Walk];
        all.into_iter().find(|role| role.name() == name)
    }
}

/// Why a supervised run failed.
#[derive(Debug, thiserror::Error)]
pub enum SuperviseError {
    /// A process cannot be started.
    #[error("the process for {} cannot be started: {why}", role.name())]
    Start {
        /// What it should do.
        role: Role,
        /// The system's reason.
        why: String,
    },
    /// A worker cannot go on, and starting it again would not help.
    #[error(transparent)]
    Worker(#[from] Failure),
    /// A process dies again and again before it does anything.
    #[error("the process for {} died {times} times in a row: {how}", role.name())]
    CrashLoop {
        /// What it should do.
        role: Role,
        /// How it died last.
        how: String,
        /// How often.
        times: usize,
    },
    /// The map at the end cannot be read.
    #[error(transparent)]
    Map(#[from] cairn_atlas::store::StoreError),
    /// It was asked to end before the source was open.
    #[error("interrupted before the source was open")]
    Interrupted,
}

/// The rig of a source, read back from its text. Each process has a file of its own: none reads what another is writing.
fn rig_of(folder: &Path, opened: &Opened) -> Result<Rig, Failure> {
    let path = folder.join(format!("rig-{}.toml", std::process::id()));
    let cure = "free some shared memory, or run without --isolated";
    std::fs::write(&path, &opened.rig).map_err(|e| Failure::new(path.display().to_string(), e, cure))?;
    Ok(cairn_sources::read_rig(&path)?)
}

/// The name of sensors on the command line; [`mode_of`] reads it back.
fn sensor_name(mode: SensorMode, imu: bool) -> String {
    let cameras = match mode {
        SensorMode::Mono => "mono",
        SensorMode::Stereo => "stereo",
        SensorMode::Rgbd => "rgbd",
    };
    format!("{cameras}{}", if imu { "-imu" } else { "" })
}

/// The camera mode of a name on the command line, and whether the IMU is used.
fn mode_of(sensor: &str) -> Result<(SensorMode, bool), Failure> {
    let (cameras, imu) = sensor.strip_suffix("-imu").map_or((sensor, false), |cameras| (cameras, true));
    let mode = match cameras {
        "mono" => SensorMode::Mono,
        "stereo" => SensorMode::Stereo,
        "rgbd" => SensorMode::Rgbd,
        _ => {
            return Err(Failure::new("the sensors", format!("'{sensor}' is unknown"), "start the run again"));
        }
    };
    Ok((mode, imu))
}
