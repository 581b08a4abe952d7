//! Where the robot is on the ground: the engine's poses, laid onto the plane it drives on.
//!
//! The ground frame is the robot's own frame where it was switched on. The engine's map begins at the first camera, whose
//! pose on the robot is known, so the two frames differ by a constant. Between tracked frames the wheels carry the pose on.

use super::TrialError;
use cairn_atlas::KeyFrameId;
use cairn_engine::{Config, Engine, Runner, SensorMode};
use cairn_geometry::{Se2, Se3};
use cairn_sensor::{FramePacket, Rig};

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
    ground_from_world: Option<Se3>,
    ground_from_body: Se2,
    /// Frames in a row that were not tracked.
    missed: usize,
    /// Milliseconds from image to pose, frame by frame.
    pub step_ms: Vec<f64>,
    /// Frames that were not tracked.
    pub lost: usize,
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
            ground_from_world: None,
            ground_from_body: Se2::identity(),
            missed: 0,
            step_ms: Vec::new(),
            lost: 0,
            loops: 0,
        })
    }

    /// Takes a frame, and what the wheels measured since the one before.
    ///
    /// # Errors
    /// When the images do not fit the rig, or a stage of the engine died.
    pub fn step(&mut self, packet: &FramePacket, wheels: Se2) -> Result<Located, TrialError> {
        let output = self.engine.on_packet(packet).map_err(|e| TrialError::Engine(e.to_string()))?;
        if let Some(why) = output.died {
            return Err(TrialError::Engine(why));
        }
        self.step_ms.push(output.extract_ms + output.track_ms);
        self.loops += output.verdicts.iter().filter(|v| v.result.is_ok()).count();
        self.ground_from_body = self.ground_from_body * wheels;
        let Some(anchored) = output.anchored else {
            self.lost += 1;
            self.missed += 1;
            return Ok(Located { ground_from_body: self.ground_from_body, key: None });
        };
        self.missed = 0;
        if self.ground_from_world.is_none() {
            self.ground_from_world = Some(self.body_from_camera * anchored.world_from_camera.inverse());
        }
        let key = self.key_pose(anchored.reference);
        if let Some(pose) = self.on_ground(&anchored.world_from_camera) {
            self.ground_from_body = pose;
        }
        Ok(Located { ground_from_body: self.ground_from_body, key: key.map(|k| (anchored.reference, k)) })
    }

    /// For how many frames in a row the robot was not tracked.
    pub fn missed(&self) -> usize {
        self.missed
    }

    /// The pose on the ground of the robot when it saw this key frame, by the present map.
    pub fn key_pose(&self, id: KeyFrameId) -> Option<Se2> {
        self.on_ground(&self.engine.snapshot().world_from_camera(id)?)
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    fn on_ground(&self, world_from_camera: &Se3) -> Option<Se2> {
        let body = self.ground_from_world? * *world_from_camera * self.body_from_camera.inverse();
        let ahead = body.rotation * cairn_geometry::Vec3::x();
        Some(Se2::from_xy_angle(body.translation.x, body.translation.y, ahead.y.atan2(ahead.x)))
    }
}
