//! The layout of a file, version 5: its parts, and what they hold.
//!
//! Parts hold columns (see `wire.rs`). Key frames and landmarks refer to each other by row: the index in
//! their part, which is in order of creation. A row that may be missing is counted from 1, and 0 means none.
//!
//! | part | what |
//! |---|---|
//! | about | how the map was made; counts; calibration |
//! | worlds | roots of the maps and their priors |
//! | key frames | poses, units, parents, loops, covisible neighbours |
//! | motion | since version 2: which maps are gravity-aligned; velocities and biases of key frames that have
//! an inertial state |
//! | gone | parents of removed key frames, and their poses there |
//! | landmarks | ids, positions, and which observation gave the descriptor |
//! | words | words of each key frame, by the vocabulary that made them |
//! | robots | since version 4: which robot created which key frames and landmarks |
//! | cameras | in version 5: the cameras of key frames that are not the atlas's; which key frame has which |
//! | descriptors | which descriptors the features have; in files without it, those of the first release |
//! | scales | how well the unit of length of maps is known (`scales.rs`); only where that was stated |
//! | imu | how the camera is mounted on the IMU of the readings, and which key frames stand still (`scales.rs`); only where the first is known |
//! | readings 0, 1, .. | IMU readings between key frames (`readings.rs`); only where there are any |
//! | relative poses 0, 1, .. | poses of key frames relative to earlier ones, as depth measured them (`relative_poses.rs`); only where there are any |
//! | shown | what of the features is needed before they are read: the landmarks that they show; level, angle and descriptor of each
//! landmark. A file without it, of an earlier program, is read whole |
//! | features 0, 1, .. | features and the landmarks they show, of 64 key frames each |
//! | attached/NAME | what the map does not know: recorded routes, depth of key frames (`depth.rs`) |
//!
//! Words are used as stored when this program has the vocabulary that made them, else computed again.
//! Observations, normals and ranges of landmarks are derived from these when a map is loaded, and where features are read, their
//! descriptors.

use super::about::About;
use crate::Snapshot;
use std::collections::BTreeMap;

/// The newest format version; versions from 1 to this are read. It is written where key frames have several cameras, which
/// programs that know only version 4 cannot use; all other maps are version 4.
pub const VERSION: u32 = 5;
/// The version of a map whose key frames all have the camera of the atlas.
pub(super) const ONE_CAMERA: u32 = 4;
/// The part that tells which key frame has which camera.
pub(super) const CAMERAS: &str = "cameras";
/// Prefix of the names of attached parts, which mean nothing to the map.
pub(super) const ATTACHED: &str = "attached/";
/// The part that tells what the bits of descriptors mean.
pub(super) const DESCRIPTORS: &str = "descriptors";
/// The part that makes it possible to leave features in the file.
pub(super) const SHOWN: &str = "shown";
/// The part that tells how well units of length are known.
pub(super) const SCALES: &str = "scales";
/// The part that tells how the camera is mounted on the IMU.
pub(super) const IMU: &str = "imu";
/// Beginning of the names of the parts of features.
pub(super) const FEATURES: &str = "features ";
/// Beginning of the names of the parts of IMU readings.
pub(super) const READINGS: &str = "readings ";
/// Beginning of the names of the parts of relative poses.
pub(super) const RELATIVE_POSES: &str = "relative poses ";
/// Key frames in one part of features.
pub(super) const CHUNK: usize = 64;
/// No observation has the landmark's descriptor.
pub(super) const NO_PICK: u32 = u32::MAX;

/// The content of a file: the maps, how they were made, and attached data.
#[derive(Clone, Debug)]
pub struct MapFile {
    /// The snapshot with all its maps.
    pub snapshot: Snapshot,
    /// How it was made.
    pub about: About,
    /// Attached data by name, recorded routes for example; kept as they are.
    pub attached: BTreeMap<String, Vec<u8>>,
}
