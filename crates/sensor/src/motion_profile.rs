//! What carries the camera can do: how fast it gets on and turns, and how slowly it moves when it stands.

use cairn_settings::Settings;

/// The motion of what carries the camera, with the defaults of a walker. Tracking takes from it how far a camera can have got
/// unseen, and the guide whether a walker stands.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct MotionProfile {
    /// The greatest speed that is assumed while nothing is seen, m/s.
    #[setting(default = 1.5, range = 0.01..=100.0)]
    pub fastest_m_s: f64,
    /// The fastest turning that is assumed while nothing is seen, rad/s.
    #[setting(default = 1.5, range = 0.01..=20.0)]
    pub fastest_turn_rad_s: f64,
    /// Slower than this counts as standing, m/s.
    #[setting(default = 0.15, range = 0.0..=10.0)]
    pub standing_m_s: f64,
}
