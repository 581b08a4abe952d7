//! What a session is begun with.

use cairn_guide::{AnnouncerConfig, Facing, PhraseConfig, RouteConfig};
use std::path::PathBuf;

/// Config of a session.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// The folder of the routes.
    pub folder: PathBuf,
    /// The file of the first recording; without it, a free name in the folder.
    pub record_to: Option<PathBuf>,
    /// A description of the image source, for the files.
    pub source: String,
    /// Start recording automatically after this many tracked frames.
    pub auto_record: Option<usize>,
    /// How the camera is mounted relative to the walker, unless a command says otherwise.
    pub facing: Facing,
    /// The map was loaded: routes from files are anchored to it.
    pub map_is_loaded: bool,
    /// Language, unit and form of what is said.
    pub phrases: PhraseConfig,
    /// Rate, volume and queueing of the voice.
    pub announcer: AnnouncerConfig,
    /// How routes are recorded, cleaned and guided.
    pub route: RouteConfig,
}

impl Default for SessionConfig {
    fn default() -> Self {
        Self {
            folder: PathBuf::from("routes"),
            record_to: None,
            source: String::new(),
            auto_record: None,
            facing: Facing::Home,
            map_is_loaded: false,
            phrases: PhraseConfig::default(),
            announcer: AnnouncerConfig::default(),
            route: RouteConfig::default(),
        }
    }
}
