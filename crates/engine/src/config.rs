//! Everything that can be set, with defaults that need no tuning.

use cairn_mapping::MapperSetting;
use cairn_tracking::TrackerSetting;
use cairn_vision::EyeSetting;

/// The settings of every stage.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// Features, stereo, depth.
    pub eye: EyeSetting,
    /// Tracking.
    pub tracker: TrackerSetting,
    /// Mapping.
    pub mapper: MapperSetting,
}
