//! What is built: from which recordings, into which store, how.

use crate::FleetError;
use cairn::Config;
use serde::{Deserialize, Serialize};

/// A build; every task needs it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// Where the recordings are: each folder, bag or file of video directly below this address is one.
    pub recordings: String,
    /// The store.
    pub store: String,
    /// Entries of a configuration that differ from the defaults, as TOML.
    #[serde(default)]
    pub config: String,
    /// Two maps become one only where they overlap over this many metres: more than a room, which may have a copy. With 0 all that agree do.
    pub overlap_m: f64,
    /// Edge of the cubes into which the atlas is cut, metres.
    pub tile_m: f64,
    /// How far beyond its cube a tile has key frames, metres.
    pub margin_m: f64,
    /// Shards of the index of places; maps fall into them by their digest.
    pub shards: usize,
}

/// Shards, at most: pairs of shards are tasks.
const MOST_SHARDS: usize = 4096;

impl Job {
    /// With the usual numbers.
    pub fn new(recordings: &str, store: &str) -> Self {
        Self {
            recordings: recordings.to_owned(),
            store: store.to_owned(),
            config: String::new(),
            overlap_m: 5.0,
            tile_m: 20.0,
            margin_m: 4.0,
            shards: 1,
        }
    }

    /// Checks the numbers, and reads the configuration.
    pub(crate) fn checked(&self) -> Result<Config, FleetError> {
        if !(self.tile_m.is_finite() && self.tile_m > 0.0) {
            return Err(FleetError::new(
                "tile",
                format!("{} m is no size", self.tile_m),
                "give metres above 0",
            ));
        }
        if !(self.margin_m.is_finite() && self.margin_m >= 0.0) {
            let why = format!("{} m is no distance", self.margin_m);
            return Err(FleetError::new("margin", why, "give metres, 0 or more"));
        }
        if !(self.overlap_m.is_finite() && self.overlap_m >= 0.0) {
            let why = format!("{} m is no distance", self.overlap_m);
            return Err(FleetError::new("overlap", why, "give metres, 0 or more"));
        }
        if !(1..=MOST_SHARDS).contains(&self.shards) {
            let cure = format!("give 1 to {MOST_SHARDS}");
            return Err(FleetError::new("shards", format!("{} is out of range", self.shards), cure));
        }
        Config::from_toml(&self.config)
            .map_err(|e| FleetError::new("configuration", e, "cairn config prints all entries"))
    }
}
