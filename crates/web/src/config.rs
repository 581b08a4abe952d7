//! What a server is started with.

use cairn_engine::{Config, SensorMode};
use cairn_sensor::{Rig, Source, SourceError};
use cairn_session::SessionConfig;
use std::path::PathBuf;

/// Opens a source that is not the page's camera; returns it with its camera mode and whether its IMU is used.
pub type OpenSource = Box<dyn FnOnce() -> Result<(Box<dyn Source>, SensorMode, bool), SourceError> + Send>;

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

/// Config of a server.
pub struct ServeConfig {
    /// Reachable from the local network, not only from this machine.
    pub lan: bool,
    /// The port; 0 selects a free one.
    pub port: u16,
    /// The folder of the certificate, so that a phone asks only once whether to trust it; without a folder there is a
    /// new certificate at each start.
    pub keep: Option<PathBuf>,
    /// The folder in which maps and routes are kept for another day; without one, routes are recorded into the session's
    /// folder and the map ends with the session.
    pub routes: Option<PathBuf>,
    /// The session's camera.
    pub camera: CameraSource,
    /// The engine's config.
    pub config: Config,
    /// The session's config.
    pub session: SessionConfig,
}
