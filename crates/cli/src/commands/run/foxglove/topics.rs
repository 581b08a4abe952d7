//! The topics of a run, and what takes their messages.

use crate::failure::Failure;
use cairn_bag::foxglove::{self, Schema};
use cairn_sensor::Stamp;

/// A topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    Pose,
    Tf,
    TfStatic,
    Path,
    Points,
    Route,
    Image,
    Calibration,
    Features,
    Said,
    Events,
}

impl Topic {
    /// All of them; the index of one is its number.
    pub const ALL: [Self; 11] = [
        Self::Pose,
        Self::Tf,
        Self::TfStatic,
        Self::Path,
        Self::Points,
        Self::Route,
        Self::Image,
        Self::Calibration,
        Self::Features,
        Self::Said,
        Self::Events,
    ];

    /// Its name, and the type of its messages.
    pub fn channel(self) -> (&'static str, &'static Schema) {
        match self {
            Self::Pose => ("/pose", &foxglove::POSE_IN_FRAME),
            Self::Tf => ("/tf", &foxglove::FRAME_TRANSFORM),
            Self::TfStatic => ("/tf_static", &foxglove::FRAME_TRANSFORM),
            Self::Path => ("/path", &foxglove::POSES_IN_FRAME),
            Self::Points => ("/points", &foxglove::POINT_CLOUD),
            Self::Route => ("/route", &foxglove::POSES_IN_FRAME),
            Self::Image => ("/image", &foxglove::RAW_IMAGE),
            Self::Calibration => ("/calibration", &foxglove::CAMERA_CALIBRATION),
            Self::Features => ("/features", &foxglove::IMAGE_ANNOTATIONS),
            Self::Said => ("/said", &foxglove::LOG),
            Self::Events => ("/events", &foxglove::LOG),
        }
    }

    /// Whether who comes later gets the last message at once: its next one may be long in coming.
    pub fn is_kept(self) -> bool {
        matches!(
            self,
            Self::Tf | Self::TfStatic | Self::Path | Self::Points | Self::Route | Self::Calibration
        )
    }
}

/// Where messages go.
pub trait Destination {
    /// Whether messages of a topic are taken now.
    fn wants(&self, topic: Topic) -> bool;
    /// Takes a message; what fails is reported at the end.
    fn put(&mut self, topic: Topic, stamp: Stamp, message: &[u8]);
    /// The run has come to this time.
    fn time(&mut self, _: Stamp) {}
    /// There are no more messages.
    ///
    /// # Errors
    /// When they are not all where they should be.
    fn end(self: Box<Self>) -> Result<(), Failure>;
}
