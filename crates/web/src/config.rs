//! What a server is started with.

use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, OpenMapError, Runner, SensorMode};
use cairn_phrases::Language;
use cairn_sensor::{Rig, Source, SourceError};
use cairn_session::{SessionConfig, Slam};
use cairn_sources::std_host;
use std::path::PathBuf;
use std::sync::Arc;

/// Opens a source that is not the page's camera; returns it with its camera mode and whether its IMU is used.
pub type OpenSource = Box<dyn FnOnce() -> Result<(Box<dyn Source>, SensorMode, bool), SourceError> + Send>;

/// What SLAM is begun with.
pub struct SlamSetup<'a> {
    /// Kind and location of the source.
    pub name: &'a str,
    /// Its rig.
    pub rig: &'a Rig,
    /// Which of its cameras are used.
    pub mode: SensorMode,
    /// Whether its IMU is used.
    pub imu: bool,
    /// Packets a second, about.
    pub rate_hz: f64,
    /// The engine's configuration.
    pub config: &'a Config,
    /// Whether surfaces of its map will be asked for.
    pub dense: bool,
}

/// SLAM, and small differences between the camera of its map and this one.
pub type StartedSlam = Result<(Box<dyn Slam>, Vec<String>), OpenMapError>;

/// Begins SLAM, in a map where there is one; called on the session's thread.
pub type StartSlam = Box<dyn FnMut(&SlamSetup, Option<&MapFile>) -> StartedSlam + Send>;

/// An engine in this process.
pub fn engine_here() -> StartSlam {
    Box::new(|s, map| {
        let runner = Runner::Threaded;
        let (engine, notes) = match map {
            Some(file) => Engine::in_map(s.rig, s.mode, s.rate_hz, runner, s.config, &std_host(), file)?,
            None => (Engine::new(s.rig, s.mode, s.rate_hz, runner, s.config, &std_host())?, Vec::new()),
        };
        Ok((Box::new(engine), notes))
    })
}

/// Is told, a line each, what a person at the terminal should know.
pub type Tell = Arc<dyn Fn(&str) + Send + Sync>;

/// Says a sentence of this language aloud, where the machine can.
pub type Aloud = Arc<dyn Fn(Language, &str) + Send + Sync>;

/// The session's camera.
pub enum CameraSource {
    /// The camera of the page that holds the walk.
    Page {
        /// The calibration; estimated when absent.
        rig: Option<Box<Rig>>,
    },
    /// Another source.
    Source {
        /// Its name, for people.
        name: String,
        /// Opens it; called on the session's thread, may block.
        open: OpenSource,
    },
}

/// The most connections that are of use: a page has up to nine (six of its browser for files, three for the walk).
pub const MOST_CONNECTIONS: usize = 256;

/// Config of a server.
pub struct ServeConfig {
    /// Reachable from the local network, not only from this machine.
    pub lan: bool,
    /// The port; 0 selects a free one.
    pub port: u16,
    /// The folder of the certificate, the access token and the phones, so that a phone asks only once whether to trust it and a
    /// bookmark stays good; without a folder they are new at each start.
    pub keep: Option<PathBuf>,
    /// Makes another access token: bookmarks and phones of before come in no more.
    pub new_key: bool,
    /// The page's certificate is signed by an authority of this machine, which phones are asked to trust; it is kept in
    /// the same folder.
    pub authority: bool,
    /// The folder in which maps and routes are kept for another day; without one, routes are recorded into the session's
    /// folder and the map ends with the session.
    pub routes: Option<PathBuf>,
    /// The access token: that of a server before this one, whose pages come back; else a new one is made.
    pub token: Option<String>,
    /// The file in which it is kept what a server that takes the place of this one goes on with; read at the beginning.
    pub survives: Option<PathBuf>,
    /// The session's camera.
    pub camera: CameraSource,
    /// Makes surfaces of the depth of key frames and shows them on the pages; needs a source with depth.
    pub dense: bool,
    /// Begins SLAM: [`engine_here`], or a process of its own.
    pub slam: StartSlam,
    /// Connections that may be open at a time; half of them are kept for pages that have shown the token.
    pub connections: usize,
    /// The person at the terminal.
    pub tell: Tell,
    /// Says the code by which a phone is paired.
    pub aloud: Aloud,
    /// The engine's config.
    pub config: Config,
    /// The session's config.
    pub session: SessionConfig,
}

impl ServeConfig {
    /// For this machine alone, at any free port, with SLAM in this process; nothing is kept.
    pub fn new(camera: CameraSource) -> Self {
        Self {
            lan: false,
            port: 0,
            keep: None,
            new_key: false,
            authority: false,
            routes: None,
            token: None,
            survives: None,
            camera,
            dense: false,
            slam: engine_here(),
            connections: MOST_CONNECTIONS,
            tell: Arc::new(|_| ()),
            aloud: Arc::new(|_, _| ()),
            config: Config::default(),
            session: SessionConfig::default(),
        }
    }
}
