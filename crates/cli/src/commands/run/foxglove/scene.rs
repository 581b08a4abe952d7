//! What is said of a run, whoever hears it.
//!
//! In the frame `map`: the pose of every tracked frame as it was given; every few seconds the landmarks, key frames and route of
//! the map that the camera is in; the corrected poses at the end. Images with features a few times a second, what the walker
//! hears, what happens to the map. Times are those of the source.

use super::file::McapFile;
use super::live::Live;
use super::topics::{Destination, Topic};
use crate::commands::run::sink::{Ended, Frame, Processed, Sink};
use crate::failure::Failure;
use cairn::Map;
use cairn_atlas::MapId;
use cairn_bag::foxglove::{self, Level};
use cairn_engine::{Engine, FramePose, Output, Phase};
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::{FramePacket, Rig, RigCamera, Stamp};
use cairn_session::{Event, Session, anchor_in_map};
use std::net::SocketAddr;
use std::path::Path;

/// The fixed frame, that of the body, and that of the camera.
const MAP: &str = "map";
const BODY: &str = "body";
const CAMERA: &str = "cam0";

/// Seconds between images, and between views of the map.
const IMAGE_STEP_S: f64 = 0.2;
const MAP_STEP_S: f64 = 5.0;
/// The place of the camera on the body is said again where it differs by this much: with the scale of the map, the arm is known.
const SAME_PLACE: f64 = 1e-6;

/// The messages of a run while it goes on.
pub struct Scene {
    to: Vec<Box<dyn Destination>>,
    camera: RigCamera,
    phase: Option<Phase>,
    map: Option<MapId>,
    body_from_camera: Option<Se3>,
    image_at: Option<Stamp>,
    map_at: Option<Stamp>,
    last: Option<Stamp>,
}

impl Scene {
    /// Begins where messages are requested: in a file, at an address, or both.
    ///
    /// # Errors
    /// When the file cannot be created, or nobody can connect to the address.
    pub fn begin(
        path: Option<&Path>,
        address: Option<SocketAddr>,
        rig: &Rig,
    ) -> Result<Option<Self>, Failure> {
        let mut to: Vec<Box<dyn Destination>> = Vec::new();
        if let Some(path) = path {
            to.push(Box::new(McapFile::begin(path)?));
        }
        if let Some(address) = address {
            to.push(Box::new(Live::begin(address)?));
        }
        let camera = rig.cameras.first().filter(|_| !to.is_empty()).cloned();
        Ok(camera.map(|camera| Self {
            to,
            camera,
            phase: None,
            map: None,
            body_from_camera: None,
            image_at: None,
            map_at: None,
            last: None,
        }))
    }

    /// Gives a message to those who want it; it is made only if there are any.
    fn put(&mut self, topic: Topic, stamp: Stamp, message: impl FnOnce() -> Vec<u8>) {
        let mut wanting = self.to.iter_mut().filter(|to| to.wants(topic)).peekable();
        if wanting.peek().is_some() {
            let message = message();
            wanting.for_each(|to| to.put(topic, stamp, &message));
        }
    }

    fn log(&mut self, stamp: Stamp, level: Level, text: &str) {
        self.put(Topic::Events, stamp, || foxglove::log(stamp.0, level, "cairn", text));
    }

    fn add(&mut self, here: &Processed, done: &Output) {
        let stamp = done.stamp;
        self.to.iter_mut().for_each(|to| to.time(stamp));
        if self.last.replace(stamp).is_none() {
            self.lens(stamp);
        }
        done.status.events.iter().for_each(|event| self.log(stamp, Level::Info, &event.to_string()));
        done.stage_failed().iter().for_each(|cause| self.log(stamp, Level::Warning, cause));
        if self.phase.replace(done.status.phase) != Some(done.status.phase) {
            self.log(stamp, Level::Info, &done.status.phase.to_string());
        }
        let engine = here.session.engine();
        if let Some(pose) = &done.pose {
            self.pose(stamp, pose, engine);
        }
        let due = |last: Option<Stamp>, step_s: f64| last.is_none_or(|last| stamp - last >= step_s);
        if due(self.image_at, IMAGE_STEP_S) {
            self.image(stamp, here.packet, done);
        }
        if self.map.is_some() && due(self.map_at, MAP_STEP_S) {
            self.map_at = Some(stamp);
            let map = Map::of(engine);
            self.map(stamp, &map, |id| map.key_frames(id).map(|(_, pose)| pose.se3).collect());
            self.route(stamp, here.session);
        }
    }

    /// The calibration of the images.
    fn lens(&mut self, stamp: Stamp) {
        let camera = self.camera.camera;
        match foxglove::camera_calibration(stamp.0, CAMERA, &camera) {
            Some(message) => self.put(Topic::Calibration, stamp, || message),
            None => {
                let lens = camera.distortion.name();
                let text = format!("no /calibration: Foxglove has no model of a lens that is {lens}");
                self.log(stamp, Level::Warning, &text);
            }
        }
    }

    fn pose(&mut self, stamp: Stamp, pose: &FramePose, engine: &Engine) {
        let (ns, world_from_body) = (stamp.0, pose.world_from_body.se3);
        self.put(Topic::Pose, stamp, || foxglove::pose_in_frame(ns, MAP, &world_from_body));
        self.put(Topic::Tf, stamp, || foxglove::frame_transform(ns, MAP, BODY, &world_from_body));
        let rectified_from_body = engine.front_end().model().body_from_camera.inverse();
        let rectified_from_camera = (rectified_from_body * self.camera.body_from_camera).rotation;
        let world_from_rectified = pose.anchored.world_from_camera;
        let rotation = world_from_rectified.rotation * rectified_from_camera;
        let place = world_from_body.inverse() * Se3::new(rotation, world_from_rectified.translation);
        let same = |before: Se3| {
            let moved = before.inverse() * place;
            moved.translation.norm() < SAME_PLACE && moved.rotation.angle() < SAME_PLACE
        };
        if !self.body_from_camera.is_some_and(same) {
            self.body_from_camera = Some(place);
            self.put(Topic::TfStatic, stamp, || foxglove::frame_transform(ns, BODY, CAMERA, &place));
        }
        let key_frame = engine.snapshot().key_frame(pose.anchored.reference).map(|k| k.map);
        self.map = key_frame.or(self.map);
    }

    fn image(&mut self, stamp: Stamp, packet: &FramePacket, done: &Output) {
        let Some(image) = packet.images.first() else { return };
        self.image_at = Some(stamp);
        self.put(Topic::Image, stamp, || foxglove::raw_image(stamp.0, CAMERA, image));
        self.put(Topic::Features, stamp, || {
            let point = |p: &[f32; 2]| Vec2::new(p[0].into(), p[1].into());
            foxglove::image_points(stamp.0, &done.frame.raw.iter().map(point).collect::<Vec<_>>())
        });
    }

    /// The landmarks of the map that the camera is in, and a path.
    fn map(&mut self, stamp: Stamp, map: &Map, path: impl FnOnce(MapId) -> Vec<Se3>) {
        let Some(id) = self.map.filter(|id| map.maps().any(|there| there == *id)) else { return };
        let points = || foxglove::point_cloud(stamp.0, MAP, map.landmarks(id).map(|l| l.position));
        self.put(Topic::Points, stamp, points);
        self.put(Topic::Path, stamp, || foxglove::poses_in_frame(stamp.0, MAP, &path(id)));
    }

    /// The route that is followed.
    fn route(&mut self, stamp: Stamp, session: &Session) {
        let Some(route) = session.route() else { return };
        let snapshot = session.engine().snapshot();
        self.put(Topic::Route, stamp, || {
            let placed = route.resolve(|anchor| anchor_in_map(&snapshot, anchor));
            let poses: Vec<Se3> = placed.iter().map(|p| p.frame_from_camera).collect();
            foxglove::poses_in_frame(stamp.0, MAP, &poses)
        });
    }
}

impl Sink for Scene {
    fn frame(&mut self, frame: &Frame) {
        if let Some((here, done)) = frame.output() {
            self.add(here, done);
        }
    }

    fn event(&mut self, event: &Event) {
        let Event::Said(said) = event else { return };
        let level = if said.priority == 0 { Level::Warning } else { Level::Info };
        self.put(Topic::Said, said.stamp, || foxglove::log(said.stamp.0, level, "guide", &said.text));
    }

    /// Adds the final map, and the path of all frames.
    fn end(mut self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        if let (Some(here), Some(last)) = (ended.run.here(), self.last) {
            let engine = here.session.engine();
            let path = |_| engine.trajectory().into_iter().map(|(_, pose)| pose).collect();
            self.map(last, &Map::of(engine), path);
        }
        Failure::all(self.to.into_iter().filter_map(|to| to.end().err()))
    }
}
