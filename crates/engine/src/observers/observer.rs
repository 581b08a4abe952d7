//! What an observer of frames is told.

use crate::mapping::Mapping;
use crate::output::Output;
use cairn_atlas::{MapId, Snapshot};
use cairn_sensor::{FramePacket, Stamp};
use cairn_tracking::{AnchoredPose, Tracked, Tracker};
use cairn_vision::Frame;

/// Does what follows from a frame, without a say in its pose.
pub(crate) trait Observer {
    /// The front end refused a packet; why.
    fn refused(&mut self, _packet: &FramePacket, _why: &str) {}

    /// A frame was tracked; mapping does not know of it yet.
    fn tracked(&mut self, _frame: &TrackedFrame) {}

    /// A frame is done; the output is that of the observers before this one.
    fn done(&mut self, _frame: &mut DoneFrame, _output: &mut Output) {}

    /// A stage failed after the last frame; why.
    fn failed(&mut self, _why: &str) {}
}

/// A frame that was tracked.
pub(crate) struct TrackedFrame<'a> {
    pub packet: &'a FramePacket,
    pub frame: &'a Frame,
    pub tracked: &'a Tracked,
    pub tracker: &'a Tracker,
    /// The map it was tracked in.
    pub snapshot: &'a Snapshot,
    /// Whether mapping will be asked to make it a key frame.
    pub key_frame_requested: bool,
}

/// A frame that is done.
pub(crate) struct DoneFrame<'a> {
    pub packet: &'a FramePacket,
    /// What it was tracked with.
    pub input: TrackingInput,
    /// Poses of frames from before the initialisation, as tracking found them: time and pose.
    pub earlier: Vec<(Stamp, AnchoredPose)>,
    /// The first frame of the pair that began a map.
    pub first_of_pair: Option<(Stamp, AnchoredPose)>,
    /// Version of the map after this frame created one, if it did.
    pub map_created: Option<u64>,
    /// The latest map.
    pub snapshot: &'a Snapshot,
    /// The map of the pose in it.
    pub map: Option<MapId>,
    /// Whether the unit of length of the pose rests on anything.
    pub scale_supported: bool,
    /// Why a stage failed since the last packet.
    pub stage_failed: Option<String>,
    pub mapping: &'a mut Mapping,
}

/// What the result of tracking depends on besides the images.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TrackingInput {
    /// Version of the map.
    pub version: u64,
    /// Whether mapping was idle.
    pub idle: bool,
}
