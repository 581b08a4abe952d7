//! Where the robot is on the ground: the engine's poses, laid onto the plane it drives on and checked by its wheels.
//!
//! The ground frame is the robot's own frame where it was switched on. Each map of the engine's atlas has a frame of its
//! own, which lies on the ground by the pose that the wheels carried on when the map began: the first one by the camera's
//! place on the robot. Where two maps are merged, the key frames of the later one belong to the earlier one from then on.
//!
//! The wheels measure the motion from frame to frame to a few per cent. A tracked pose that has moved otherwise, although
//! no loop was closed, is not used: the wheels carry the pose on instead.

use super::TrialError;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_engine::{Config, Engine, Runner, SensorMode};
use cairn_geometry::{Se2, Se3, So3, Vec3};
use cairn_sensor::{FramePacket, Rig};
use std::collections::BTreeMap;

/// A tracked pose may differ from that of the wheels by this from frame to frame, metres and radians,
const STEP_M: f64 = 0.04;
const STEP_RAD: f64 = 0.03;
/// and by this share of the way that they carried the pose on: three times their error.
const WHEELS: f64 = 0.06;
/// After so many refused frames the map is believed again.
const REFUSED: usize = 40;

/// The pose of the robot after a frame.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// Pose of the robot on the ground.
    pub ground_from_body: Se2,
    /// The key frame it is anchored to, with that key frame's pose on the ground; `None` where the frame was not tracked.
    pub key: Option<(KeyFrameId, Se2)>,
}

/// Tracks the robot with the engine.
pub struct Localiser {
    engine: Engine,
    body_from_camera: Se3,
    ground_from_map: BTreeMap<MapId, Se3>,
    ground_from_body: Se2,
    /// Frames in a row that were not tracked.
    missed: usize,
    /// Way and turn by the wheels alone since the last pose that was used, as metres.
    unsure_m: f64,
    /// Frames in a row whose tracked pose was refused.
    refused_running: usize,
    /// Milliseconds from image to pose, frame by frame.
    pub step_ms: Vec<f64>,
    /// Frames that were not tracked.
    pub lost: usize,
    /// Frames whose tracked pose was not that of the wheels.
    pub refused: usize,
    /// Loops and merges that were accepted.
    pub loops: usize,
}

impl Localiser {
    /// For a rig with a depth camera.
    ///
    /// # Errors
    /// When the rig has no camera or does not serve RGB-D.
    pub fn new(rig: &Rig, rate_hz: f64) -> Result<Self, TrialError> {
        let camera = rig.cameras.first().ok_or(TrialError::Rig("it has no camera".into()))?;
        let engine = Engine::new(rig, SensorMode::Rgbd, rate_hz, Runner::Lockstep, &Config::default())
            .map_err(|e| TrialError::Rig(e.to_string()))?;
        Ok(Self {
            engine,
            body_from_camera: camera.body_from_camera,
            ground_from_map: BTreeMap::new(),
            ground_from_body: Se2::identity(),
            missed: 0,
            step_ms: Vec::new(),
            lost: 0,
            refused: 0,
            unsure_m: 0.0,
            refused_running: 0,
            loops: 0,
        })
    }

    /// Takes a frame, and what the wheels measured since the one before.
    ///
    /// # Errors
    /// When the images do not fit the rig, or a stage of the engine died.
    pub fn step(&mut self, packet: &FramePacket, wheels: Se2) -> Result<Located, TrialError> {
        let output = self.engine.on_packet(packet).map_err(|e| TrialError::Engine(e.to_string()))?;
        if let Some(why) = output.stage_failed {
            return Err(TrialError::Engine(why));
        }
        self.step_ms.push(output.extract_ms + output.track_ms);
        let closed = output.verdicts.iter().filter(|v| v.result.is_ok()).count();
        self.loops += closed;
        self.ground_from_body = self.ground_from_body * wheels;
        self.unsure_m += wheels.translation.norm() + wheels.rotation.log().abs();
        let Some(anchored) = output.anchored else {
            self.lost += 1;
            self.missed += 1;
            return Ok(Located { ground_from_body: self.ground_from_body, key: None });
        };
        let snapshot = self.engine.snapshot();
        let Some(map) = map_of(&snapshot, anchored.reference) else {
            return Ok(Located { ground_from_body: self.ground_from_body, key: None });
        };
        let body = over_ground(&self.ground_from_body);
        let camera = body * self.body_from_camera;
        let lies = self.ground_from_map.entry(map).or_insert(camera * anchored.world_from_camera.inverse());
        let pose = on_ground(&(*lies * anchored.world_from_camera * self.body_from_camera.inverse()));
        if closed == 0 && !self.agrees(&pose) && self.refused_running < REFUSED {
            self.refused += 1;
            self.refused_running += 1;
            self.missed += 1;
            return Ok(Located { ground_from_body: self.ground_from_body, key: None });
        }
        (self.missed, self.refused_running, self.unsure_m) = (0, 0, 0.0);
        self.ground_from_body = pose;
        let key = self.pose_of(&snapshot, anchored.reference);
        Ok(Located { ground_from_body: pose, key: key.map(|k| (anchored.reference, k)) })
    }

    /// Whether a tracked pose is where the wheels say, as exactly as they can.
    fn agrees(&self, pose: &Se2) -> bool {
        let off = self.ground_from_body.inverse() * *pose;
        let slack = WHEELS * self.unsure_m;
        off.translation.norm() < STEP_M + slack && off.rotation.log().abs() < STEP_RAD + slack
    }

    /// For how many frames in a row the robot was not tracked.
    pub fn missed(&self) -> usize {
        self.missed
    }

    /// The pose on the ground of the robot when it saw this key frame, by the present map.
    pub fn key_pose(&self, id: KeyFrameId) -> Option<Se2> {
        self.pose_of(&self.engine.snapshot(), id)
    }

    fn pose_of(&self, snapshot: &Snapshot, id: KeyFrameId) -> Option<Se2> {
        let ground_from_map = self.ground_from_map.get(&map_of(snapshot, id)?)?;
        let body = *ground_from_map * snapshot.world_from_camera(id)? * self.body_from_camera.inverse();
        Some(on_ground(&body))
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }
}

fn map_of(snapshot: &Snapshot, id: KeyFrameId) -> Option<MapId> {
    let (ancestor, _) = snapshot.surviving_ancestor(id)?;
    Some(snapshot.key_frame(ancestor)?.map)
}

/// A pose of the robot in space, seen from above.
fn on_ground(body: &Se3) -> Se2 {
    let ahead = body.rotation * Vec3::x();
    Se2::from_xy_angle(body.translation.x, body.translation.y, ahead.y.atan2(ahead.x))
}

/// A pose on the floor in three dimensions.
pub(super) fn over_ground(pose: &Se2) -> Se3 {
    let turn = So3::exp(&Vec3::new(0.0, 0.0, pose.rotation.log()));
    Se3::new(turn, Vec3::new(pose.translation.x, pose.translation.y, 0.0))
}
