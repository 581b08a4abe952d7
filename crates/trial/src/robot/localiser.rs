//! Where the robot is on the ground: the engine's poses, laid onto the plane it drives on, with its wheels beside them.
//!
//! The ground frame is the robot's own frame where it was switched on. Each map of the engine's atlas has a frame of its
//! own, which lies on the ground by the pose that the wheels carried on when the map began: the first one by the camera's
//! place on the robot. Where two maps are merged, the key frames of the later one belong to the earlier one from then on.
//!
//! The wheels measure the motion from frame to frame to a few per cent. The engine is told of it: it searches around the
//! motion measured, takes no pose that contradicts it, and goes on by it in front of a plain wall. Where all the same it gives
//! no pose, or one that the wheels cannot have reached, the wheels carry the robot on from the last pose that was good, and
//! what is seen meanwhile belongs to the key frame of that pose. A map that goes on contradicting the wheels, in the same way
//! for some seconds, was corrected or found again, and is believed.

use super::TrialError;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_engine::{AnchoredPose, Config, Engine, Host, MeasuredMotion, Runner, SensorMode, State};
use cairn_geometry::{Se2, Se3, So3, Vec3};
use cairn_sensor::{FramePacket, Rig};
use std::collections::BTreeMap;

/// Errors of the wheels: a share of the way and the turn, and from frame to frame, metres and radians.
const WHEELS: f64 = 0.02;
const WHEELS_FLOOR: f64 = 0.001;
/// A tracked pose may differ from that of the wheels by this from frame to frame, metres and radians,
const STEP_M: f64 = 0.06;
const STEP_RAD: f64 = 0.04;
/// and by so many of their standard deviations since the last pose that was used.
const SIGMAS: f64 = 4.0;
/// A map that moved against the wheels all at once, and has agreed with them for so many frames since, was corrected.
const AGREED: usize = 15;
/// By the wheels alone the robot drives on up to these standard deviations, metres and radians.
const UNSURE_M: f64 = 0.15;
const UNSURE_RAD: f64 = 0.12;
/// With fewer landmarks found the robot looks at little more than a plain wall.
const LITTLE_SEEN: usize = 45;

/// The pose of the robot after a frame.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// Pose of the robot on the ground.
    pub ground_from_body: Se2,
    /// The key frame it is anchored to, with that key frame's pose on the ground; `None` before the first map.
    pub key: Option<(KeyFrameId, Se2)>,
    /// Whether the pose is certain enough to drive by.
    pub is_sure: bool,
    /// Whether so little is seen that tracking may be lost.
    pub sees_little: bool,
}

/// Tracks the robot with the engine.
pub struct Localiser {
    engine: Engine,
    body_from_camera: Se3,
    ground_from_map: BTreeMap<MapId, Se3>,
    ground_from_body: Se2,
    /// The key frame of the last pose that was used.
    anchor: Option<KeyFrameId>,
    /// Variance of the wheels' way and turn since then, m^2 and rad^2.
    variance: [f64; 2],
    /// The refused pose of the frame before, and for how many frames such poses have moved as the wheels did.
    refused_before: Option<Se2>,
    agreed: usize,
    /// A loop or a merge was accepted with the frame before: its pose was not yet corrected, the next one is.
    is_corrected: bool,
    /// Milliseconds from image to pose, frame by frame.
    pub step_ms: Vec<f64>,
    /// Frames that were not tracked.
    pub lost: usize,
    /// Frames whose pose the engine carried on by the wheels.
    pub coasted: usize,
    /// Frames whose tracked pose was not that of the wheels.
    pub refused: usize,
    /// Loops and merges that were accepted.
    pub loops: usize,
}

impl Localiser {
    /// For a rig with a depth camera, with the clock of a host.
    ///
    /// # Errors
    /// When the rig has no camera or does not serve RGB-D.
    pub fn new(rig: &Rig, rate_hz: f64, host: &Host) -> Result<Self, TrialError> {
        let camera = rig.cameras.first().ok_or(TrialError::Rig("it has no camera".into()))?;
        let engine = Engine::new(rig, SensorMode::Rgbd, rate_hz, Runner::Lockstep, &Config::default(), host)
            .map_err(|e| TrialError::Rig(e.to_string()))?;
        Ok(Self {
            engine,
            body_from_camera: camera.body_from_camera,
            ground_from_map: BTreeMap::new(),
            ground_from_body: Se2::identity(),
            anchor: None,
            variance: [0.0; 2],
            refused_before: None,
            agreed: 0,
            is_corrected: false,
            step_ms: Vec::new(),
            lost: 0,
            coasted: 0,
            refused: 0,
            loops: 0,
        })
    }

    /// Takes a frame, and what the wheels measured since the one before.
    ///
    /// # Errors
    /// When the images do not fit the rig, or a stage of the engine died.
    pub fn step(&mut self, packet: &FramePacket, wheels: Se2) -> Result<Located, TrialError> {
        let sigma =
            [wheels.translation.norm(), wheels.rotation.log().abs()].map(|v| WHEELS * v + WHEELS_FLOOR);
        self.engine.motion_measured(&MeasuredMotion {
            last_from_now: over_ground(&wheels),
            sigma_m: sigma[0],
            sigma_rad: sigma[1],
        });
        let output = self.engine.on_packet(packet).map_err(|e| TrialError::Engine(e.to_string()))?;
        if let Some(why) = output.stage_failed() {
            return Err(TrialError::Engine(why.to_owned()));
        }
        self.step_ms.push(output.timings.step_ms());
        let closed = output.verdicts().filter(|v| v.result.is_ok()).count();
        self.loops += closed;
        self.ground_from_body = self.ground_from_body * wheels;
        (0..2).for_each(|i| self.variance[i] += sigma[i] * sigma[i]);
        let snapshot = self.engine.snapshot();
        let is_tracked = output.state == State::Tracking;
        match output.pose {
            None => self.lost += 1,
            Some(pose) => self.take(&snapshot, &pose.anchored, is_tracked, wheels),
        }
        self.is_corrected = closed > 0;
        let key = self.anchor.and_then(|id| Some((id, self.pose_of(&snapshot, id)?)));
        Ok(Located {
            ground_from_body: self.ground_from_body,
            key,
            is_sure: self.variance[0].sqrt() < UNSURE_M && self.variance[1].sqrt() < UNSURE_RAD,
            sees_little: output.evidence.inliers < LITTLE_SEEN,
        })
    }

    /// Takes a pose of the engine, where it is where the wheels say.
    fn take(&mut self, snapshot: &Snapshot, anchored: &AnchoredPose, is_tracked: bool, wheels: Se2) {
        let Some(map) = map_of(snapshot, anchored.reference) else { return };
        let camera = over_ground(&self.ground_from_body) * self.body_from_camera;
        let lies = self.ground_from_map.entry(map).or_insert(camera * anchored.world_from_camera.inverse());
        let pose = on_ground(&(*lies * anchored.world_from_camera * self.body_from_camera.inverse()));
        let near = |from: &Se2, sigmas: [f64; 2]| {
            let off = from.inverse() * pose;
            off.translation.norm() < STEP_M + SIGMAS * sigmas[0]
                && off.rotation.log().abs() < STEP_RAD + SIGMAS * sigmas[1]
        };
        let sigmas = self.variance.map(f64::sqrt);
        let moved_alike = self.refused_before.is_some_and(|before| near(&(before * wheels), [0.0; 2]));
        self.agreed = if moved_alike && is_tracked { self.agreed + 1 } else { 0 };
        if !self.is_corrected && self.agreed < AGREED && !near(&self.ground_from_body, sigmas) {
            self.refused += 1;
            self.refused_before = Some(pose);
            return;
        }
        (self.refused_before, self.agreed) = (None, 0);
        (self.ground_from_body, self.anchor) = (pose, Some(anchored.reference));
        if is_tracked {
            self.variance = [0.0; 2];
        } else {
            self.coasted += 1;
        }
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
