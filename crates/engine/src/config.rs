//! The configuration of all stages, with defaults that need no tuning; read from TOML, printed with comments.

use cairn_mapping::{CloserConfig, InertialConfig, MapperConfig};
use cairn_sensor::Rig;
use cairn_settings::{Settings, SettingsError as ConfigError};
use cairn_tracking::TrackerConfig;
use cairn_vision::FrontEndConfig;
use serde::{Deserialize, Serialize};

/// The configuration of every stage. Entries missing in a TOML file keep their defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Settings)]
pub struct Config {
    /// The robot (phone, person) after which new key frames and landmarks are named, also in a map of others: give each its
    /// own where maps shall be merged, so that nothing has to be renamed.
    #[setting(default = 0, range = 0..=65_535)]
    pub robot: u16,
    /// Feature extraction, stereo matching, depth.
    #[setting(section, default = features_by_size())]
    pub front_end: FrontEndConfig,
    /// Tracking.
    #[setting(section)]
    pub tracker: TrackerConfig,
    /// Mapping.
    #[setting(section)]
    pub mapper: MapperConfig,
    /// Loop closing and map merging.
    #[setting(section)]
    pub closer: CloserConfig,
    /// The IMU, where there is one.
    #[setting(section)]
    pub inertial: InertialConfig,
}

/// The number of features follows from the image size.
fn features_by_size() -> FrontEndConfig {
    let mut front_end = FrontEndConfig::default();
    front_end.orb.features = 0;
    front_end
}

/// Pixels of the image per feature: 1,024 features at 640x480, 1,203 at 752x480, 1,512 at 1226x370.
const PIXELS_A_FEATURE: usize = 300;

/// Standard deviation of where a phone has its camera on its motion sensors, each axis, metres: browsers do not tell, and a phone is 7 cm
/// wide and 15 cm long. Simulated phones have them 3 cm apart on each axis.
const PHONE_LEVER_ARM_M: f64 = 0.04;

impl Config {
    /// Expects what is unknown of a phone with motion sensors: it exposes row after row, each type with a time of its own, and stamps
    /// pictures and motion with different clocks. Of one whose rig nobody states it is not known either where the camera is on the IMU.
    pub fn expect_phone(&mut self, is_calibrated: bool) {
        self.tracker.estimate_readout |= self.tracker.readout_s == 0.0;
        self.tracker.clocks_by_flow |= !is_calibrated;
        if !is_calibrated && self.inertial.lever_arm_sigma == 0.0 {
            self.inertial.lever_arm_sigma = PHONE_LEVER_ARM_M;
        }
    }

    /// The front end's configuration for a rig: without an explicit number of features, it follows from the
    /// size of the first camera's image.
    pub fn front_end_for(&self, rig: &Rig) -> FrontEndConfig {
        let mut front_end = self.front_end;
        if let (0, Some(first)) = (front_end.orb.features, rig.cameras.first()) {
            front_end.orb.features =
                (first.camera.width * first.camera.height / PIXELS_A_FEATURE).clamp(500, 2000);
        }
        front_end
    }

    /// The default configuration as TOML, with help and range at each entry.
    pub fn default_toml() -> String {
        cairn_settings::to_toml(&Self::default())
    }

    /// Reads a configuration from TOML.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] for invalid TOML, unknown names and numbers out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = cairn_settings::from_toml(text)?;
        config.check()?;
        Ok(config)
    }

    /// Checks that every number lies in its valid range.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] naming the first entry out of range, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        cairn_settings::check(self)?;
        let (low, high) = (self.front_end.orb.fast_low, self.front_end.orb.fast_high);
        if low > high {
            let why = format!("front_end.orb.fast_low is {low}, it must not be above fast_high, {high}");
            return Err(ConfigError { line: None, why });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_toml_is_complete() {
        assert_eq!(Config::from_toml(&Config::default_toml()).unwrap(), Config::default());
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
        assert!(error("[front_end.orb]\nfast_low = 30\n").why.contains("must not be above fast_high, 20"));
        assert!(error("[front_end.orb]\nfactor = nan\n").why.contains("front_end.orb.factor is NaN"));
        assert!(
            error("[mapper.window]\niterations = [0, 5]\n").why.contains("mapper.window.iterations is 0")
        );
        assert!(error("[tracker]\nrate_hz = 5.0\n").why.contains("rate_hz"), "the source defines the rate");
    }
}
