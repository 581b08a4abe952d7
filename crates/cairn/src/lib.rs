#![doc = include_str!("../README.md")]
//!
//! # Quick start
//!
//! Track a source, save the map, and localise in it. `sim:demo` is a simulated world; a folder of a recording, a
//! video file or `camera:0` work the same.
//!
//! ```
//! use cairn::{Slam, open};
//!
//! let walk = "sim:demo?sensor=rgbd&resolution=320x240&rate=10&duration=3&detail=0.3";
//! let mut source = open(walk)?;
//! let mut slam = Slam::for_source(&*source).build()?;
//! while let Some(frame) = source.next_packet()? {
//!     let output = slam.track(&frame)?;
//!     println!("{} {:?} {:?}", output.stamp, output.state, output.world_from_body());
//! }
//! slam.finish();
//! let accuracy = slam.accuracy(&source.info().truth)?;
//! assert!(accuracy.reference_covered > 0.9 && accuracy.ate_m.rmse < 0.05);
//!
//! let file = std::env::temp_dir().join("cairn-quick-start.map");
//! slam.save(&file)?;
//! let mut source = open(walk)?;
//! let mut again = Slam::for_source(&*source).localize_in(Slam::load_map(&file)?).build()?;
//! let frame = source.next_packet()?.ok_or("the source is empty")?;
//! assert!(again.track(&frame)?.pose.is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The folder `examples/` has a program each for: a EuRoC folder ([`open`]), a camera of your own
//! ([`Slam::track_images`]), saving and relocalising ([`Slam::save`], [`Builder::localize_in`]), following the map's
//! changes ([`Slam::changes`]), recording and guiding ([`Slam::record`], [`Slam::guide_home`]), pose graphs
//! ([`solve::graph`]), and a factor of your own ([`adjust::WindowFactors`]).
//!
//! # Map of the crates
//!
//! Each crate is a module here and imports only from lower floors of this table (`ARCHITECTURE.md` has the path of a frame through them).
//!
//! | floor | module | what is in it |
//! |---|---|---|
//! | 1 | [`geometry`] | SO2, SE2, SO3, SE3, Sim3, poses typed by their frames, alignment, trajectories |
//! | 2 | [`sensor`] | stamps, images, IMU samples, rigs, lenses, the `Source` trait, merging of streams |
//! | 2 | [`solve`] | nonlinear least squares: pose-only and bundle adjustment, pose graphs, RANSAC, g2o and BAL |
//! | 2 | [`eval`] | absolute and relative trajectory error, coverage, trajectory files, plots |
//! | 3 | [`vision`] | features, descriptors, matching, stereo, bags of words, two-view geometry |
//! | 3 | [`sim`] | simulated worlds with exact ground truth, and walkers in them |
//! | 4 | [`sources`] | recordings, video, live streams and simulated worlds opened by address |
//! | 4 | [`atlas`] | key frames, landmarks, maps, change sets, map files |
//! | 4 | [`filter`] | EKF-SLAM in the plane from odometry, ranges and bearings; robust smoothing of a log |
//! | 5 | [`adjust`] | windows of a map, and the factors that are added to them |
//! | 5 | [`dense`] | TSDF and occupancy submaps, meshes, dense tracking, columns and obstacles |
//! | 5 | [`plan`] | occupancy grids, distance fields, costmaps, path search, path following |
//! | 5 | [`guide`] | route recorder, cleaning, maneuvers, cues, phrases |
//! | 7 | [`team`] | several robots, one pose graph: distributed optimisation, rejection of false loops, messages |
//! | 8 | [`engine`] | tracking, mapping and loop closing wired together; configuration, status, journal |
//! | 10 | [`session`] | one walk: engine, recorder and guide behind commands |
//! | 12 | this one | [`Slam`], [`Map`], [`Changes`], [`MapEvents`], [`Error`] |
//!
//! Between them lie the stages of the engine, which a user meets only through it: `cairn-inertial` (IMU
//! preintegration), `cairn-tracking`, `cairn-mapping`; and beside
//! them `cairn-voice` and `cairn-web`, the faces of the command line.

mod accuracy;
mod agree;
mod builder;
mod changes;
mod error;
mod events;
mod map;
mod merge;
mod overlaps;
mod reach;
mod shared;
mod slam;
pub mod team_scale;
mod walk;

pub use accuracy::{accuracy, accuracy_of};
pub use agree::{AgreeError, AgreedUpdate, AgreeingMap, MapGraphError, graph_of_map};
pub use builder::{Builder, sensor_mode_of};
#[doc(no_inline)]
pub use cairn_mapping::{Agreement, Apart, Junction, MapComparison, MapJoin, Seam, Support};
pub use changes::Changes;
pub use error::{Error, FrameError};
pub use events::{MapEvent, MapEvents};
pub use map::{Map, ROUTE_PREFIX, map_file, routes_of};
pub use merge::{
    Attempt, FileComparison, MapOfFile, MergeError, MergedMaps, compare_files, merge_maps, merge_maps_where,
};
pub use overlaps::MapOverlaps;
pub use reach::{MapWords, WordsError, in_reach, words_of_map};
pub use shared::{OwnMapError, SharedAtlas, TeamAtlas, own_map, own_part, shared_atlas};
pub use slam::Slam;

#[doc(no_inline)]
pub use cairn_engine::{
    Config, FramePose, MotionSource, Odometry, Output, SensorMode, StageEvent, State, Timings,
};
#[doc(no_inline)]
pub use cairn_sensor::{Clock, FramePacket, GrayImage, Host, ImuSample, Rig, Source, Stamp};

pub use cairn_adjust as adjust;
pub use cairn_atlas as atlas;
pub use cairn_dense as dense;
pub use cairn_engine as engine;
pub use cairn_eval as eval;
pub use cairn_filter as filter;
pub use cairn_geometry as geometry;
pub use cairn_guide as guide;
pub use cairn_plan as plan;
pub use cairn_sensor as sensor;
pub use cairn_session as session;
pub use cairn_sim as sim;
pub use cairn_solve as solve;
pub use cairn_sources as sources;
pub use cairn_team as team;
pub use cairn_vision as vision;

/// Opens a source by its address: the folder of a recording (EuRoC, TUM-VI, TUM RGB-D, KITTI, 7-Scenes), a video file,
/// `camera:0`, a network stream, or a simulated world such as `sim:demo`. [`sources::open`] takes options: a rig, a
/// start, a number of frames.
///
/// # Errors
/// [`Error::Source`] when it does not exist, is of an unknown kind, or cannot be read; it says what to do.
pub fn open(address: &str) -> Result<Box<dyn Source>, Error> {
    Ok(sources::open(address, sources::OpenOptions::default())?)
}
