#![doc = include_str!("../README.md")]

mod announcer;
mod clean;
mod config;
mod correction;
mod cue;
mod ending;
mod facing;
mod ground;
mod guide;
mod info;
mod listener;
mod losses;
mod maneuvers;
mod matcher;
mod motion;
mod moving;
mod notes;
mod phrases;
mod ready;
mod recorder;
mod route;
mod steer;
mod store;
mod tracks;
pub mod trial;
mod turning;
pub mod walker;

pub use announcer::{Announcer, AnnouncerConfig, Utterance, WORDS_PER_MINUTE, speaking_time};
pub use clean::{CleanConfig, CleanedRoute, Cut, clean, clean_line, largest_distance, length};
pub use config::GuideConfig;
pub use cue::{Ahead, Cue, CueKind, Earcon, First, Next, Obstacle, Priority, StopReason};
pub use facing::{Facing, Heading};
pub use ground::{Ground, cross, direction, heading_of, wrap};
pub use guide::{Guide, GuideError, GuideInput, GuideState};
pub use info::{RouteDrawing, RouteInfo, survey};
pub use maneuvers::{Maneuver, ManeuverPlan, ManeuverPlanConfig, ManeuverPlanError, Stairs, Travel};
pub use matcher::{Match, Matcher, MatcherConfig};
pub use notes::{Lies, RouteNote};
pub use phrases::{Direction, DirectionStyle, PhraseConfig, Side, Unit, clock_hour, reason_words};
pub use ready::{Readiness, ReadyConfig, ReadyStretch, pose_back, ready, ready_words};
pub use recorder::{RecordInput, Recorder, RecorderConfig, RecorderEvent};
pub use route::{Anchor, Confidence, PlacedPoint, Route, RouteHeader, RoutePoint, Stretch};
pub use store::{Durable, RouteError, RouteWriter};
pub use walker::Walker;

pub use cairn_phrases::Language;
