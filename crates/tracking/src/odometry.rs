//! Odometry: the motion of the body as observed from frame to frame, in a frame of its own that map corrections do
//! not move (REP 105: `odom`; the map's frame is `world` here).
//!
//! Input: the pose of each frame, anchored to a key frame, and the snapshot it was tracked in. Output: [`Odometry`],
//! the pose in `odom` and the similarity `world_from_odom`, which takes it to the pose in the map.
//!
//! The pose in `odom` is the product of the motions between consecutive frames, each taken within one snapshot. The
//! previous frame is resolved relative to its key frame, so a correction that moves key frames (a loop closure, a
//! merge, gravity alignment) moves both ends of the motion. A correction can also move landmarks relative to key
//! frames. This is detected with the landmarks that both frames show: both poses are computed from these alone, and
//! where the resulting motion differs visibly in the image, it is used instead. Where the map gives no motion (it was
//! found again after coasting, or another map continues), the IMU does, or else the previous velocity.
//!
//! The unit of length of `odom` is that of the map when the segment began; changes of the map's unit since then are
//! in the scale of `world_from_odom`. A [`Odometry::segment`] ends where the motion is not known.

use crate::state::{AnchoredPose, State};
use cairn_adjust::locate;
use cairn_atlas::{KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::{Body, Odom, Pose, Se3, Sim3, Similarity, Vec3, World};
use cairn_sensor::Stamp;
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::SVector;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Landmarks that two frames must share for the motion between them to be computed from these.
const COMMON: usize = 12;
/// Two motions count as equal when points differ by less than this in the image, root mean square, pixels.
const SAME_PX: f64 = 0.5;
/// Seconds since the last measured motion up to which the velocity is extrapolated.
const EXTRAPOLATED_S: f64 = 0.3;

/// How the motion since the last frame with a pose was obtained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum MotionSource {
    /// It is not known: a new segment begins with this frame.
    None,
    /// Measured against the map.
    Map,
    /// Integrated from the IMU.
    Imu,
    /// Measured by other means ([`crate::MeasuredMotion`]), where the map gives none.
    Measured,
    /// The rotation is measured between images, the position is held (see [`State::RotationOnly`]).
    RotationOnly,
    /// Extrapolated from the previous velocity, for up to 0.3 s.
    Velocity,
}

/// The pose in the odometry frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odometry {
    /// The number of the segment, from 0. Poses of one segment are continuous; the relative pose of two segments is
    /// not known. A segment begins with the first pose, with the first pose after a loss during which the motion was
    /// not observed, and with a map whose unit of length was guessed.
    pub segment: u32,
    /// How the motion since the last frame with a pose was obtained.
    pub source: MotionSource,
    /// Pose of the body. Its unit of length is that of the map when the segment began: metres where that was metric,
    /// and for a rig with depth. Until the map is metric, the body is placed at the first camera.
    pub odom_from_body: Pose<Odom, Body>,
    /// Transforms the pose in `odom` to that in the map. It contains the corrections of the map, so it may jump. Its
    /// scale is 1 until the map's unit of length changes.
    pub world_from_odom: Similarity<World, Odom>,
}

/// A frame with a pose.
#[derive(Clone, Debug)]
struct PosedFrame {
    frame: Arc<Frame>,
    landmarks: Vec<Option<LandmarkId>>,
    anchored: AnchoredPose,
    is_tracked: bool,
    /// Version of the snapshot, and the scale of the reference key frame in it.
    version: u64,
    unit: f64,
}

/// The camera's motion between two frames, in the map's unit.
#[derive(Clone, Copy, Debug)]
struct RelativeMotion {
    last_from_now: Se3,
    source: MotionSource,
    elapsed_s: f64,
}

/// Accumulates the odometry of one tracker.
#[derive(Clone, Debug)]
pub(crate) struct OdometryFilter {
    camera: RectifiedCamera,
    /// The last frame with a pose, and its odometry.
    last: Option<(PosedFrame, Odometry)>,
    /// Frames without a pose since then.
    missed: usize,
    /// The length of a unit of `odom` in the map's unit.
    scale: f64,
    /// Velocity of the camera along its own axes, in units of `odom` per second and radians per second, and when it was
    /// measured.
    velocity: Option<(Stamp, SVector<f64, 6>)>,
}

impl OdometryFilter {
    pub fn new(camera: RectifiedCamera) -> Self {
        Self { camera, last: None, missed: 0, scale: 1.0, velocity: None }
    }

    /// The odometry of the last frame; `None` when that has no pose.
    pub fn current(&self) -> Option<Odometry> {
        self.last.as_ref().filter(|_| self.missed == 0).map(|(_, odometry)| *odometry)
    }

    /// The stamp of the last frame, when that had a pose.
    pub fn last_stamp(&self) -> Option<Stamp> {
        self.last.as_ref().filter(|_| self.missed == 0).map(|(last, _)| last.frame.stamp)
    }

    /// Adds a frame without a pose.
    pub fn miss(&mut self) {
        self.missed += 1;
    }

    /// Adds a frame with its pose in a snapshot, and the landmark that each feature shows. `other_motion` is the
    /// camera's motion since the previous frame by another source than the map, in metres.
    pub fn step(
        &mut self,
        snapshot: &Snapshot,
        frame: &Arc<Frame>,
        state: State,
        anchored: AnchoredPose,
        landmarks: Vec<Option<LandmarkId>>,
        other_motion: Option<(Se3, MotionSource)>,
    ) {
        let Some(now) = PosedFrame::at(snapshot, frame, state, anchored, landmarks) else {
            return self.miss();
        };
        let last = self.last.take();
        let motion =
            last.as_ref().and_then(|(last, _)| self.motion(snapshot, last, &now, state, other_motion));
        let odometry = match (last, motion) {
            (Some((_, before)), Some(motion)) => self.go_on(snapshot, &before, &now, &motion),
            (last, _) => self.begin(snapshot, last.map(|(_, before)| before), &now),
        };
        self.missed = 0;
        self.last = Some((now, odometry));
    }

    /// Mapping created a map in which the last frame is this key frame. The pose in `odom` stays, if the frame had
    /// one; a new segment begins where the map's unit of length was guessed.
    pub fn map_created(&mut self, snapshot: &Snapshot, id: KeyFrameId) {
        let Some(k) = snapshot.key_frame(id) else { return };
        let anchored = AnchoredPose::at(id, k.world_from_camera);
        let Some(now) =
            PosedFrame::at(snapshot, &k.frame.shared(), State::Tracking, anchored, k.landmarks.clone())
        else {
            return;
        };
        let odometry = match self.last.take() {
            Some((last, before)) if self.missed == 0 => {
                if self.is_metric(snapshot, &now) && self.is_metric(snapshot, &last) {
                    self.at(snapshot, &now, &before)
                } else {
                    (self.scale, self.velocity) = (1.0, None);
                    let (segment, source) = (before.segment + 1, MotionSource::None);
                    self.at(snapshot, &now, &Odometry { segment, source, ..before })
                }
            }
            last => self.begin(snapshot, last.map(|(_, before)| before), &now),
        };
        self.missed = 0;
        self.last = Some((now, odometry));
    }

    /// The motion from the last frame with a pose to this one; `None` where it is not known. Also applies a change of
    /// the map's unit of length.
    fn motion(
        &mut self,
        snapshot: &Snapshot,
        last: &PosedFrame,
        now: &PosedFrame,
        state: State,
        other_motion: Option<(Se3, MotionSource)>,
    ) -> Option<RelativeMotion> {
        let here = snapshot.world_from_here(last.anchored.reference)?;
        self.scale *= here.scale / last.unit;
        let elapsed_s = now.frame.stamp - last.frame.stamp;
        let known = |last_from_now, source| Some(RelativeMotion { last_from_now, source, elapsed_s });
        let before = here.transform_pose(&last.anchored.reference_from_camera);
        let resolved = before.inverse() * now.anchored.world_from_camera;
        let gap = self.missed > 0;
        if last.is_tracked && now.is_tracked && self.map(snapshot, last) == self.map(snapshot, now) {
            if !gap && last.version == now.version {
                return known(resolved, MotionSource::Map);
            }
            if let Some(shared) = self.shared_motion(snapshot, last, now, &before, &resolved) {
                return known(shared, MotionSource::Map);
            }
        }
        if gap {
            return None;
        }
        if let State::RotationOnly { .. } = state {
            return known(Se3::new(resolved.rotation, Vec3::zeros()), MotionSource::RotationOnly);
        }
        if let Some((motion, source)) = other_motion.filter(|_| self.is_metric(snapshot, last)) {
            return known(motion, source);
        }
        let (_, velocity) = self.velocity.filter(|(at, _)| now.frame.stamp - *at <= EXTRAPOLATED_S)?;
        let mut motion = Se3::exp(&(velocity * elapsed_s));
        motion.translation *= self.scale;
        known(motion, MotionSource::Velocity)
    }

    /// The motion between two frames by the landmarks that both show; or `resolved`, the motion between their poses,
    /// where the difference is not visible. `None` where they share too few.
    fn shared_motion(
        &self,
        snapshot: &Snapshot,
        last: &PosedFrame,
        now: &PosedFrame,
        before: &Se3,
        resolved: &Se3,
    ) -> Option<Se3> {
        // Once the frame is a key frame, its landmarks are looked up in the map, which knows those that were fused.
        let as_key_frame = snapshot.newest_key_frame().filter(|k| k.frame.is(&last.frame));
        let last_landmarks = as_key_frame.map_or(&last.landmarks, |k| &k.landmarks);
        let alive = |landmarks: &[Option<LandmarkId>]| -> BTreeSet<LandmarkId> {
            landmarks.iter().flatten().copied().filter(|id| snapshot.landmark(*id).is_some()).collect()
        };
        let shared: BTreeSet<LandmarkId> =
            alive(last_landmarks).intersection(&alive(&now.landmarks)).copied().collect();
        if shared.len() < COMMON {
            return None;
        }
        let pose = |frame: &Frame, guess: &Se3, landmarks: &[Option<LandmarkId>]| {
            let matches: Vec<_> = landmarks.iter().map(|id| id.filter(|id| shared.contains(id))).collect();
            let found = locate(snapshot, &self.camera, frame, guess, &matches, &[], None);
            (found.inliers >= COMMON).then_some(found.world_from_camera)
        };
        let world_from_now = pose(&now.frame, &now.anchored.world_from_camera, &now.landmarks)?;
        let motion = pose(&last.frame, before, last_landmarks)?.inverse() * world_from_now;
        let apart = motion.inverse() * *resolved;
        let seen: Vec<Vec3> = (shared.iter().filter_map(|id| snapshot.landmark(*id)))
            .map(|landmark| world_from_now.inverse() * landmark.position)
            .collect();
        Some(if self.looks_the_same(&apart, &seen) { *resolved } else { motion })
    }

    /// Whether points in the camera frame keep their place in the image when they are moved.
    fn looks_the_same(&self, moved: &Se3, points: &[Vec3]) -> bool {
        let (mut sum, mut count) = (0.0, 0.0);
        for p in points {
            let Some((a, b)) = self.camera.project(p).zip(self.camera.project(&(*moved * *p))) else {
                continue;
            };
            sum += (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
            count += 1.0;
        }
        sum <= SAME_PX * SAME_PX * count
    }

    /// The next pose of a segment.
    fn go_on(
        &mut self,
        snapshot: &Snapshot,
        before: &Odometry,
        now: &PosedFrame,
        motion: &RelativeMotion,
    ) -> Odometry {
        let mut camera = motion.last_from_now;
        if motion.source != MotionSource::Velocity && motion.elapsed_s > 0.0 {
            let in_odom = Se3::new(camera.rotation, camera.translation / self.scale);
            self.velocity = Some((now.frame.stamp, in_odom.log() / motion.elapsed_s));
        }
        let camera_from_body = self.camera.world_from_body(&Se3::identity(), self.is_metric(snapshot, now));
        camera = camera_from_body.inverse() * camera * camera_from_body;
        camera.translation /= self.scale;
        let odom_from_body = Pose::new(before.odom_from_body.se3 * camera);
        self.at(snapshot, now, &Odometry { odom_from_body, source: motion.source, ..*before })
    }

    /// The first pose of a segment, placed where the previous segment predicts it, in the map's unit.
    fn begin(&mut self, snapshot: &Snapshot, before: Option<Odometry>, now: &PosedFrame) -> Odometry {
        (self.scale, self.velocity) = (1.0, None);
        let world_from_odom = before.map_or(Similarity::new(Sim3::identity()), |b| b.world_from_odom);
        let odom_from_body = world_from_odom.inverse().then(&self.world_from_body(snapshot, now));
        let segment = before.map_or(0, |b| b.segment + 1);
        let source = MotionSource::None;
        self.at(snapshot, now, &Odometry { segment, source, odom_from_body, world_from_odom })
    }

    /// `odometry` with the similarity that transforms it to the pose in the map.
    fn at(&self, snapshot: &Snapshot, now: &PosedFrame, odometry: &Odometry) -> Odometry {
        let world_from_body = self.world_from_body(snapshot, now);
        let world_from_odom = Similarity::between(&world_from_body, &odometry.odom_from_body, self.scale);
        Odometry { world_from_odom, ..*odometry }
    }

    fn world_from_body(&self, snapshot: &Snapshot, now: &PosedFrame) -> Pose<World, Body> {
        let metric = self.is_metric(snapshot, now);
        Pose::new(self.camera.world_from_body(&now.anchored.world_from_camera, metric))
    }

    fn map(&self, snapshot: &Snapshot, placed: &PosedFrame) -> Option<MapId> {
        let (id, _) = snapshot.surviving_ancestor(placed.anchored.reference)?;
        Some(snapshot.key_frame(id)?.map)
    }

    fn is_metric(&self, snapshot: &Snapshot, placed: &PosedFrame) -> bool {
        self.map(snapshot, placed).is_some_and(|map| snapshot.is_metric_in(map, &self.camera))
    }
}

impl PosedFrame {
    fn at(
        snapshot: &Snapshot,
        frame: &Arc<Frame>,
        state: State,
        anchored: AnchoredPose,
        landmarks: Vec<Option<LandmarkId>>,
    ) -> Option<Self> {
        let unit = snapshot.world_from_here(anchored.reference)?.scale;
        let (frame, version, is_tracked) = (frame.clone(), snapshot.version(), state == State::Tracking);
        Some(Self { frame, landmarks, anchored, is_tracked, version, unit })
    }
}
