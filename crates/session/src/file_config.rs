//! What a configuration file can set: every stage of the engine, and everything about routes and guidance.

use cairn_engine::{Config, ConfigError};
use cairn_guide::RouteConfig;
use cairn_settings::Settings;

/// The contents of a configuration file, as `cairn config` prints it. Entries that a file leaves out keep their defaults.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct FileConfig {
    /// The engine.
    #[setting(flatten)]
    #[serde(flatten)]
    pub engine: Config,
    /// Routes and guidance.
    #[setting(flatten)]
    #[serde(flatten)]
    pub route: RouteConfig,
}

impl FileConfig {
    /// Reads a configuration from TOML.
    ///
    /// # Errors
    /// [`ConfigError`] for invalid TOML, unknown names and numbers out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let mut config: Self = cairn_settings::from_toml(text)?;
        config.engine.check()?;
        config.route.guide.motion = config.engine.tracker.motion;
        Ok(config)
    }

    /// The default configuration as TOML, with help and range at each entry.
    pub fn default_toml() -> String {
        format!(
            "# Cairn's configuration: every entry with its default. A file needs only what it changes.\n\n{}",
            cairn_settings::to_toml(&Self::default())
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::MotionProfile;

    #[test]
    fn the_printed_configuration_is_the_default() {
        assert_eq!(FileConfig::from_toml(&FileConfig::default_toml()).unwrap(), FileConfig::default());
    }

    #[test]
    fn every_setting_of_engine_and_guide_can_be_set() {
        let text = "[tracker]\nmin_inliers = 30\n[guide]\nprogress_m = 20\n[guide.matcher]\nahead_m = 5\n[clean]\ncut_detours = false\n";
        let config = FileConfig::from_toml(text).unwrap();
        assert_eq!((config.engine.tracker.min_inliers, config.route.guide.progress_m), (30, 20.0));
        assert_eq!((config.route.guide.matcher.ahead_m, config.route.clean.cut_detours), (5.0, false));
    }

    #[test]
    fn what_the_walker_can_do_is_set_once_for_tracking_and_guidance() {
        let config = FileConfig::from_toml("[tracker.motion]\nstanding_m_s = 0.05\n").unwrap();
        let profile = MotionProfile { standing_m_s: 0.05, ..MotionProfile::default() };
        assert_eq!((config.engine.tracker.motion, config.route.guide.motion), (profile, profile));
    }

    #[test]
    fn an_old_picture_cannot_be_allowed() {
        let error = FileConfig::from_toml("[guide]\nstale_s = 2.0\n").unwrap_err();
        assert_eq!(error.to_string(), "line 2: guide.stale_s is 2, it must lie between 0.1 and 0.5");
    }
}
