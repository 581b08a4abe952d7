//! `--mcap`: the run as an MCAP file with Foxglove's schemas, for viewers and for tools that read ROS 2 recordings.
//!
//! In the frame `map`: `/pose` and `/tf` of every tracked frame as it was given, `/points` (the landmarks) every few seconds,
//! `/path` (the corrected poses) at the end. `/image` with `/features` a few times a second, `/said` what the walker hears,
//! `/events` what happens to the map. Times are those of the source.

use super::sink::{Ended, Frame, Sink};
use crate::failure::Failure;
use cairn_bag::foxglove::{self, Level};
use cairn_bag::{Channel, McapWriter};
use cairn_engine::{Engine, Output, Phase};
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::{FramePacket, Stamp};
use cairn_session::Event;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

/// The fixed frame, and that of the body.
const MAP: &str = "map";
const BODY: &str = "body";
const CAMERA: &str = "cam0";

/// Seconds between images, and between the landmarks.
const IMAGE_STEP_S: f64 = 0.2;
const POINTS_STEP_S: f64 = 5.0;

/// The file while the run goes on.
pub struct Recording {
    path: PathBuf,
    to: McapWriter<BufWriter<File>>,
    channels: Channels,
    phase: Option<Phase>,
    image_at: Option<Stamp>,
    points_at: Option<Stamp>,
    last: Stamp,
    failed: Option<io::Error>,
}

struct Channels {
    pose: Channel,
    tf: Channel,
    path: Channel,
    points: Channel,
    image: Channel,
    features: Channel,
    said: Channel,
    events: Channel,
}

impl Recording {
    /// Creates the file if one is requested.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn begin(path: Option<&Path>) -> Result<Option<Self>, Failure> {
        let Some(path) = path else { return Ok(None) };
        let fail = |e: io::Error| {
            Failure::new(path.display().to_string(), e.to_string(), "check that its folder is writable")
        };
        let mut to = McapWriter::new(BufWriter::new(File::create(path).map_err(fail)?)).map_err(fail)?;
        let channels = Channels {
            pose: to.channel("/pose", &foxglove::POSE_IN_FRAME),
            tf: to.channel("/tf", &foxglove::FRAME_TRANSFORM),
            path: to.channel("/path", &foxglove::POSES_IN_FRAME),
            points: to.channel("/points", &foxglove::POINT_CLOUD),
            image: to.channel("/image", &foxglove::RAW_IMAGE),
            features: to.channel("/features", &foxglove::IMAGE_ANNOTATIONS),
            said: to.channel("/said", &foxglove::LOG),
            events: to.channel("/events", &foxglove::LOG),
        };
        let path = path.to_owned();
        let (phase, image_at, points_at, last) = (None, None, None, Stamp::default());
        Ok(Some(Self { path, to, channels, phase, image_at, points_at, last, failed: None }))
    }

    /// Adds a message; after a failure, which is told at the end, nothing more is written.
    fn put(&mut self, channel: Channel, stamp: Stamp, message: &[u8]) {
        if self.failed.is_none() {
            self.failed = self.to.message(channel, stamp.0, message).err();
        }
    }

    fn add(&mut self, packet: &FramePacket, done: &Output, engine: &Engine) {
        let (stamp, ns) = (done.stamp, done.stamp.0);
        self.last = stamp;
        let mut say = |level: Level, text: &str| {
            let message = foxglove::log(ns, level, "cairn", text);
            self.put(self.channels.events, stamp, &message);
        };
        done.status.events.iter().for_each(|event| say(Level::Info, &event.to_string()));
        done.stage_failed().iter().for_each(|cause| say(Level::Warning, cause));
        if self.phase.replace(done.status.phase) != Some(done.status.phase) {
            let message = foxglove::log(ns, Level::Info, "cairn", &done.status.phase.to_string());
            self.put(self.channels.events, stamp, &message);
        }
        if let Some(pose) = done.world_from_body() {
            self.put(self.channels.pose, stamp, &foxglove::pose_in_frame(ns, MAP, &pose.se3));
            self.put(self.channels.tf, stamp, &foxglove::frame_transform(ns, MAP, BODY, &pose.se3));
        }
        let due = |last: Option<Stamp>, step_s: f64| last.is_none_or(|last| stamp - last >= step_s);
        if let Some(image) = packet.images.first().filter(|_| due(self.image_at, IMAGE_STEP_S)) {
            self.image_at = Some(stamp);
            self.put(self.channels.image, stamp, &foxglove::raw_image(ns, CAMERA, image));
            let points: Vec<Vec2> =
                done.frame.raw.iter().map(|p| Vec2::new(f64::from(p[0]), f64::from(p[1]))).collect();
            self.put(self.channels.features, stamp, &foxglove::image_points(ns, &points));
        }
        if due(self.points_at, POINTS_STEP_S) {
            self.points(stamp, engine);
        }
    }

    fn points(&mut self, stamp: Stamp, engine: &Engine) {
        self.points_at = Some(stamp);
        let snapshot = engine.snapshot();
        let message = foxglove::point_cloud(stamp.0, MAP, snapshot.landmarks().map(|l| l.position));
        self.put(self.channels.points, stamp, &message);
    }
}

impl Sink for Recording {
    fn frame(&mut self, frame: &Frame) {
        if let Some((here, done)) = frame.output() {
            self.add(here.packet, done, here.session.engine());
        }
    }

    fn event(&mut self, event: &Event) {
        let Event::Said(said) = event else { return };
        let level = if said.priority == 0 { Level::Warning } else { Level::Info };
        self.put(self.channels.said, said.stamp, &foxglove::log(said.stamp.0, level, "guide", &said.text));
    }

    /// Adds the final map and path.
    fn end(mut self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        if let Some(here) = ended.run.here() {
            let (engine, last) = (here.session.engine(), self.last);
            self.points(last, engine);
            let poses: Vec<Se3> = engine.trajectory().into_iter().map(|(_, pose)| pose).collect();
            self.put(self.channels.path, last, &foxglove::poses_in_frame(last.0, MAP, &poses));
        }
        let ended = match self.failed {
            Some(e) => Err(e),
            None => self.to.finish().map(drop),
        };
        ended.map_err(|e| {
            Failure::new(self.path.display().to_string(), e.to_string(), "free some space on the disk")
        })
    }
}
