//! The configuration of all stages, with defaults that need no tuning; read from TOML, printed with comments.

use cairn_mapping::{CloserConfig, InertialConfig, MapperConfig};
use cairn_sensor::Rig;
use cairn_tracking::TrackerConfig;
use cairn_vision::FrontEndConfig;
use serde::{Deserialize, Serialize};

/// The configuration of every stage. Entries missing in a TOML file keep their defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The robot (phone, person) after which new key frames and landmarks are named, also in a map of others: with numbers of
    /// their own, maps and routes can be brought together without renaming anything.
    pub robot: u16,
    /// Feature extraction, stereo matching, depth.
    pub front_end: FrontEndConfig,
    /// Tracking.
    pub tracker: TrackerConfig,
    /// Mapping.
    pub mapper: MapperConfig,
    /// Loop closing and map merging.
    pub closer: CloserConfig,
    /// The IMU, where there is one.
    pub inertial: InertialConfig,
}

impl Default for Config {
    /// The number of features follows from the image size.
    fn default() -> Self {
        let mut front_end = FrontEndConfig::default();
        front_end.orb.features = 0;
        Self {
            robot: 0,
            front_end,
            tracker: TrackerConfig::default(),
            mapper: MapperConfig::default(),
            closer: CloserConfig::default(),
            inertial: InertialConfig::default(),
        }
    }
}

/// Why a text is not a valid configuration.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{why}", line.map(|l| format!("line {l}: ")).unwrap_or_default())]
pub struct ConfigError {
    /// Line, counted from one, where it is known.
    pub line: Option<usize>,
    /// What is wrong.
    pub why: String,
}

/// Pixels of the image per feature: 1,024 features at 640x480, 1,203 at 752x480, 1,512 at 1226x370.
const PIXELS_A_FEATURE: usize = 300;

/// The default configuration with a comment at each entry.
const DEFAULT_TOML: &str = include_str!("default.toml");

impl Config {
    /// The front end's configuration for a rig: without an explicit number of features, it follows from the
    /// size of the first camera's image.
    pub(crate) fn front_end_for(&self, rig: &Rig) -> FrontEndConfig {
        let mut front_end = self.front_end;
        if let (0, Some(first)) = (front_end.orb.features, rig.cameras.first()) {
            front_end.orb.features =
                (first.camera.width * first.camera.height / PIXELS_A_FEATURE).clamp(500, 2000);
        }
        front_end
    }

    /// The default configuration as TOML, with a comment at each entry.
    pub fn default_toml() -> &'static str {
        DEFAULT_TOML
    }

    /// Reads a configuration from TOML.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] for invalid TOML, unknown names and numbers out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let mut config: Self = toml::from_str(text).map_err(|e| {
            let line = e.span().map(|s| 1 + text[..s.start.min(text.len())].matches('\n').count());
            ConfigError { line, why: e.message().to_owned() }
        })?;
        // Where a part of the front end's configuration is given, the rest of it takes the front end's own
        // defaults, which have a fixed number of features.
        let features = |table: &toml::Table| table.get("front_end")?.get("orb")?.get("features").cloned();
        if toml::from_str(text).ok().as_ref().and_then(features).is_none() {
            config.front_end.orb.features = Self::default().front_end.orb.features;
        }
        config.check()?;
        Ok(config)
    }

    /// Checks that every number lies in its valid range.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] naming the first entry out of range, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let (orb, stereo, depth) = (&self.front_end.orb, &self.front_end.stereo, &self.front_end.depth);
        let (tracker, mapper, closer) = (&self.tracker, &self.mapper, &self.closer);
        let inertial = &self.inertial;
        let ranges = [
            // Frames index their features with 16 bits; a quarter of that leaves room for every caller.
            ("front_end.orb.features", orb.features as f64, 0.0, 16_000.0),
            ("front_end.orb.levels", orb.levels as f64, 1.0, 16.0),
            ("front_end.orb.factor", orb.factor, 1.05, 1.6),
            ("front_end.orb.fast_high", f64::from(orb.fast_high), 1.0, 255.0),
            ("front_end.orb.fast_low", f64::from(orb.fast_low), 1.0, f64::from(orb.fast_high)),
            ("front_end.stereo.max_hamming", f64::from(stereo.max_hamming), 0.0, 256.0),
            ("front_end.stereo.row_tolerance", stereo.row_tolerance, 0.5, 100.0),
            ("mapper.window.right_offset_sigma", mapper.window.right_offset_sigma, 0.0, 5.0),
            ("front_end.stereo.min_depth_baselines", stereo.min_depth_baselines, 0.1, 100.0),
            ("front_end.stereo.min_disparity", stereo.min_disparity, 0.0, 100.0),
            ("front_end.stereo.close_baselines", stereo.close_baselines, 1.0, 1e4),
            ("front_end.stereo.max_shift", stereo.max_shift, 0.1, 20.0),
            ("front_end.stereo.min_correlation", f64::from(stereo.min_correlation), -1.0, 1.0),
            ("front_end.stereo.max_over_median", f64::from(stereo.max_over_median), 1.0, 1e4),
            ("front_end.stereo.max_sigma", f64::from(stereo.max_sigma), 1e-3, 100.0),
            ("front_end.stereo.borrow_correlation", f64::from(stereo.borrow_correlation), -1.0, 2.0),
            ("front_end.depth.virtual_baseline", depth.virtual_baseline, 1e-3, 10.0),
            ("front_end.depth.close_depth", depth.close_depth, 0.1, 1e3),
            ("front_end.depth.max_depth", depth.max_depth, 0.1, 1e3),
            ("front_end.depth.edge_spread", f64::from(depth.edge_spread), 0.0, 10.0),
            ("tracker.min_inliers", tracker.min_inliers as f64, 6.0, 1e4),
            ("tracker.local_key_frames", tracker.local_key_frames as f64, 1.0, 1e4),
            ("tracker.min_key_frame_gap", tracker.min_key_frame_gap as f64, 0.0, 1e4),
            ("tracker.new_map_s", tracker.new_map_s, 0.0, 1e4),
            ("tracker.coast_sigma", tracker.coast_sigma, 0.0, 100.0),
            ("tracker.coast_s", tracker.coast_s, 0.0, 15.0),
            ("inertial.noise_times", inertial.noise_times, 0.1, 1e3),
            ("inertial.chain", inertial.chain as f64, 2.0, 100.0),
            ("inertial.whole_key_frames", inertial.whole_key_frames as f64, 0.0, 1e4),
            ("mapper.grow_neighbours", mapper.grow_neighbours as f64, 1.0, 1e3),
            ("mapper.fuse_neighbours", mapper.fuse_neighbours as f64, 0.0, 1e3),
            ("mapper.redundant_share", mapper.redundant_share, 0.1, 1.0),
            ("mapper.final_adjustment_key_frames", mapper.final_adjustment_key_frames as f64, 0.0, 1e4),
            ("mapper.depth_points", mapper.depth_points as f64, 0.0, 1e5),
            ("mapper.window.key_frames", mapper.window.key_frames as f64, 2.0, 1e3),
            ("mapper.window.anchors", mapper.window.anchors as f64, 1.0, 1e4),
            ("mapper.window.iterations[0]", mapper.window.iterations[0] as f64, 1.0, 1e3),
            ("mapper.window.iterations[1]", mapper.window.iterations[1] as f64, 1.0, 1e3),
            ("mapper.window.tolerance", mapper.window.tolerance, 0.0, 1.0),
            ("closer.candidates", closer.candidates as f64, 1.0, 100.0),
            ("closer.need", closer.need as f64, 10.0, 1e4),
            ("closer.drift[0]", closer.drift[0], 0.0, 10.0),
            ("closer.drift[1]", closer.drift[1], 0.0, 10.0),
            ("closer.whole_key_frames", closer.whole_key_frames as f64, 0.0, 1e4),
        ];
        for (name, value, low, high) in ranges {
            // Not a number is outside every range.
            if !(low..=high).contains(&value) {
                let why = format!("{name} is {value}, it must lie between {low} and {high}");
                return Err(ConfigError { line: None, why });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_toml_is_complete() {
        assert_eq!(Config::from_toml(Config::default_toml()).unwrap(), Config::default());
        assert_eq!(Config::from_toml("").unwrap(), Config::default());
        let printed: toml::Table = Config::default_toml().parse().unwrap();
        let whole = toml::Table::try_from(Config::default()).unwrap();
        assert_eq!(printed.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>());
        let mut names = Vec::new();
        for (name, value) in &whole {
            leaves(name, value, &mut names);
        }
        let mut shown = Vec::new();
        for (name, value) in &printed {
            leaves(name, value, &mut shown);
        }
        assert_eq!(names, shown);
    }

    fn leaves(path: &str, value: &toml::Value, out: &mut Vec<String>) {
        match value {
            toml::Value::Table(table) => {
                table.iter().for_each(|(k, v)| leaves(&format!("{path}.{k}"), v, out))
            }
            _ => out.push(path.to_owned()),
        }
    }

    #[test]
    fn default_toml_comments_every_entry() {
        let mut before = "";
        for line in Config::default_toml().lines() {
            if line.contains(" = ") && !line.starts_with('#') {
                assert!(before.starts_with("# "), "no comment above: {line}");
            }
            before = line;
        }
    }

    #[test]
    fn missing_entries_keep_their_defaults() {
        let config = Config::from_toml("[front_end.orb]\nfeatures = 700\n").unwrap();
        assert_eq!(config.front_end.orb.features, 700);
        assert_eq!(config.front_end.orb.levels, Config::default().front_end.orb.levels);
        assert_eq!(config.tracker, Config::default().tracker);
    }

    #[test]
    fn explicit_default_changes_nothing() {
        let mut part = String::new();
        for line in Config::default_toml().lines().filter(|l| !l.starts_with('#') && !l.is_empty()) {
            if line.starts_with('[') {
                part = line.to_owned();
            } else {
                let alone = Config::from_toml(&format!("{part}\n{line}\n")).unwrap();
                assert_eq!(alone, Config::default(), "{part} {line}");
            }
        }
    }

    #[test]
    fn invalid_configurations_are_refused() {
        let error = |text: &str| Config::from_toml(text).unwrap_err();
        assert_eq!(error("[front_end.orb]\nfeatures = \"many\"\n").line, Some(2));
        assert!(error("[front_end]\nfeetures = 3\n").why.contains("feetures"));
        assert!(error("[front_end.orb]\nfeatures = 70000\n").why.contains("front_end.orb.features is 70000"));
        assert!(error("[front_end.orb]\nfactor = nan\n").why.contains("front_end.orb.factor is NaN"));
        assert!(error("[mapper.window]\niterations = [0, 5]\n").why.contains("iterations[0]"));
        assert!(error("[tracker]\nrate_hz = 5.0\n").why.contains("rate_hz"), "the source defines the rate");
    }
}
