#![doc = include_str!("../README.md")]

mod age;
mod command;
mod config;
mod disk;
mod drawn;
mod drive;
mod dwell;
mod event;
mod file_config;
mod guidance;
#[cfg(test)]
mod guidance_tests;
mod inbox;
mod learning;
pub mod lens_watch;
mod library;
mod obstacles;
mod place;
mod ready;
mod recording;
mod reference_path;
mod refused;
mod route_guide;
mod route_metres;
mod route_recorder;
mod scale_basis;
mod script;
mod session;
mod settings;
mod slam;
mod speech;
mod status;
#[cfg(test)]
#[path = "../../adjust/tests/suite/common/mod.rs"]
mod synthetic;
mod take_me;
mod view;
mod walk_state;
mod wheels;

pub use age::Age;
pub use command::{Command, CommandError, KEYS, Key, RouteChoice, help, key_of};
pub use config::SessionConfig;
pub use disk::{Disk, Medium, OwnDisk, PatientFile, Trouble};
pub use drawn::Drawn;
pub use drive::{Clock, Ended, Observer, drive};
pub use event::{Event, Said, Sound, earcon_name, rank, turn_of};
pub use file_config::FileConfig;
pub use inbox::{Inbox, Item, feed};
pub use learning::LensKnowledge;
pub use library::{
    KeepError, Kept, LONGEST_NAME, LibraryCamera, LibraryError, MOST_KEY_FRAMES, MOST_ROUTES, MapKeeper,
    RouteEntry, RouteListed, RoutesLock, WallClock, WallTime, routes_in,
};
pub use ready::{landmarks_in_view, readiness};
pub use reference_path::{ReferencePath, anchor_in_map, unit_of};
pub use refused::Refused;
pub use route_guide::{RouteGuide, TrackedPlace};
pub use route_recorder::RouteRecorder;
pub use script::{Script, ScriptError, When};
pub use session::{NotSaved, Session};
pub use settings::{STEP_M, STEPS_M, Setting, SettingError, WORDS_PER_MINUTE};
pub use slam::{DepthWanted, NotTracked, Slam, Surfaces};
pub use status::{GuidingStatus, RecordingStatus, RouteStatus, SessionStatus, View};
pub use take_me::{Destination, NoWay, Planned, WalkedRoutes};
pub use walk_state::WalkState;
pub use wheels::Wheels;
