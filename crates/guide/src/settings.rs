//! All settings of a route's life: recorded, cleaned, planned, checked, guided.

use crate::clean::CleanConfig;
use crate::config::GuideConfig;
use crate::maneuvers::ManeuverPlanConfig;
use crate::ready::ReadyConfig;
use crate::recorder::RecorderConfig;
use cairn_settings::Settings;

/// The settings of routes and of guidance along them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct RouteConfig {
    /// How densely a route is recorded.
    #[setting(section)]
    pub recorder: RecorderConfig,
    /// How a recorded route is cleaned: detours cut out, the line simplified.
    #[setting(section)]
    pub clean: CleanConfig,
    /// What counts as a turn, as one corner, as stairs.
    #[setting(section)]
    pub maneuvers: ManeuverPlanConfig,
    /// The check whether the camera will see enough on the way back.
    #[setting(section)]
    pub ready: ReadyConfig,
    /// When the guide says what.
    #[setting(section)]
    pub guide: GuideConfig,
}
