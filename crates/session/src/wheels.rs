//! A wheeled robot among beacons as what tracks for a session: EKF-SLAM in the plane in place of the visual engine.
//!
//! In: motions of the wheels with the sightings of beacons at their end, as they come; packets, of which only the time counts. Out: the
//! robot's pose. The odometry frame is that of the wheels alone, which nothing corrects; `world_from_odom` holds what the beacons tell. The
//! map has one key frame, where the robot was switched on: the frame of the filter. Its camera looks ahead from the axle.

use crate::slam::{NotTracked, Slam};
use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_engine::{
    AnchoredPose, Evidence, FramePose, MotionSource, Odometry, Output, Phase, Scale, SensorMode, State,
    Status, Timings,
};
use cairn_filter::ekf::{EkfConfig, EkfSlam, FilterError};
use cairn_filter::log::Step;
use cairn_geometry::{Mat3, Pose, Se2, Se3, Sim3, Similarity, So3, Vec3};
use cairn_sensor::{FramePacket, Stamp};
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::Matrix3;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Standard deviation of the position, in metres, up to which the pose is good: half the width of a narrow passage.
const GOOD_M: f64 = 0.4;
/// Beyond this the place is not known.
const KNOWN_M: f64 = 2.0;

/// A robot with wheels that sees beacons.
pub struct Wheels {
    filter: EkfSlam,
    robot: usize,
    /// Steps that no packet has reached yet, in order of time.
    due: VecDeque<Step>,
    /// By the wheels alone.
    odom_from_body: Se2,
    /// When the pose was last good.
    good: Option<Stamp>,
    atlas: Atlas,
    start: KeyFrameId,
    camera: RectifiedCamera,
    status: Status,
}

impl Wheels {
    /// Switched on, with nothing mapped.
    ///
    /// # Errors
    /// When the filter cannot begin.
    pub fn new(config: EkfConfig) -> Result<Self, FilterError> {
        let mut filter = EkfSlam::new(config);
        // The start defines the frame of the map, so it is known, except for a small variance against rounding.
        let robot = filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12))?;
        let ahead = Mat3::from_columns(&[-Vec3::y(), -Vec3::z(), Vec3::x()]);
        let body_from_camera = Se3::new(So3::from_matrix(&ahead), Vec3::zeros());
        let camera = RectifiedCamera {
            fx: 200.0,
            fy: 200.0,
            cx: 160.0,
            cy: 120.0,
            baseline_fx: 0.0,
            bounds: [0.0, 0.0, 320.0, 240.0],
            close_depth: 0.0,
            body_from_camera,
        };
        let mut atlas = Atlas::new(Snapshot::new());
        let start = atlas.latest().next_key_frame_id();
        let key_frame = KeyFrame::new(start, Arc::new(Frame::default()), body_from_camera, None);
        atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
        let level: Vec<MapId> = atlas.latest().maps().map(|(map, _)| map).collect();
        // Lengths of wheels and ranges are metres, and the floor is level.
        atlas.commit(level.into_iter().map(|map| Change::AlignGravity(map, Sim3::identity())).collect());
        let due = VecDeque::new();
        let (odom_from_body, status) = (Se2::identity(), Status::default());
        Ok(Self { filter, robot, due, odom_from_body, good: None, atlas, start, camera, status })
    }

    /// Takes a motion and what was seen at its end; its time is that of the packets. It counts from the first packet at or after it.
    pub fn measured(&mut self, step: Step) {
        let later = self.due.partition_point(|s| s.time_s <= step.time_s);
        self.due.insert(later, step);
    }

    /// The filter: its beacons, and how certain it is.
    pub fn filter(&self) -> &EkfSlam {
        &self.filter
    }

    /// Filters what was measured until then. A motion that is no motion is left out; the next one counts.
    fn filter_until(&mut self, now: Stamp) -> Result<(), FilterError> {
        while self.due.front().is_some_and(|s| Stamp::from_seconds(s.time_s) <= now) {
            let Some(step) = self.due.pop_front() else { break };
            self.filter.predict(self.robot, &step.motion)?;
            self.odom_from_body = self.odom_from_body * step.motion.before_from_after;
            self.filter.observe(self.robot, &step.sightings)?;
        }
        Ok(())
    }

    /// The state of tracking at a standard deviation of the position.
    fn state(&mut self, now: Stamp, sigma: f64) -> State {
        if sigma <= GOOD_M {
            self.good = Some(now);
            return State::Tracking;
        }
        match self.good {
            Some(good) if sigma <= KNOWN_M => State::Coasting { since_s: now - good, sigma },
            _ => State::Lost { inliers: 0, need: 1 },
        }
    }
}

impl Slam for Wheels {
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        let refused = |e: FilterError| NotTracked::Refused(e.to_string());
        self.filter_until(packet.stamp).map_err(refused)?;
        let (pose, covariance) =
            self.filter.pose(self.robot).ok_or(FilterError::NoRobot(self.robot)).map_err(refused)?;
        let sigma = (covariance[(0, 0)] + covariance[(1, 1)]).max(0.0).sqrt();
        let state = self.state(packet.stamp, sigma);
        let is_known = !matches!(state, State::Lost { .. });
        let world_from_body = over_ground(&Se2::from_xy_angle(pose.x, pose.y, pose.z));
        let odom_from_body = over_ground(&self.odom_from_body);
        let world_from_odom = world_from_body * odom_from_body.inverse();
        let world_from_camera = world_from_body * self.camera.body_from_camera;
        let start_from_camera = self.camera.body_from_camera.inverse() * world_from_camera;
        let beacons = self.filter.landmarks().len();
        let phase = match state {
            State::Tracking => Phase::Tracking,
            State::Coasting { .. } => Phase::Coasting,
            _ => Phase::Lost,
        };
        let first = self.status.frames == 0;
        self.status = Status {
            phase,
            frames: self.status.frames + 1,
            sequence: self.status.sequence + u64::from(is_known),
            valid: is_known,
            map: Some(0),
            initialised: true,
            metric: true,
            points: beacons,
            ..Status::default()
        };
        let map = self.atlas.latest().maps().next().map(|(map, _)| map);
        let mut frame = Frame::default();
        frame.stamp = packet.stamp;
        Ok(Output {
            stamp: packet.stamp,
            frame: Arc::new(frame),
            state,
            pose: map.filter(|_| is_known).map(|map| FramePose {
                world_from_body: Pose::new(world_from_body),
                odometry: Odometry {
                    segment: 0,
                    source: if first { MotionSource::None } else { MotionSource::Measured },
                    odom_from_body: Pose::new(odom_from_body),
                    world_from_odom: Similarity::new(Sim3::from(world_from_odom)),
                },
                anchored: AnchoredPose {
                    reference: self.start,
                    reference_from_camera: start_from_camera,
                    world_from_camera,
                },
                // The filter's covariance is of the position in the plane, and counts the error of the beacons in.
                covariance: None,
                scale: Scale { map, metric: true, sigma_log: 0.0, supported: true },
            }),
            evidence: Evidence { features: beacons, ..Evidence::default() },
            key_frame_requested: false,
            events: Vec::new(),
            timings: Timings::default(),
            status: self.status.clone(),
        })
    }

    fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(self.atlas.latest())
    }

    fn camera(&self) -> &RectifiedCamera {
        &self.camera
    }

    fn status(&self) -> &Status {
        &self.status
    }

    fn is_visual(&self) -> bool {
        false
    }

    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        let about = About { program: program.to_owned(), sensor: SensorMode::Mono, camera: self.camera };
        MapFile { snapshot: (**self.atlas.latest()).clone(), about, attached }
    }
}

/// A pose on the floor in three dimensions.
fn over_ground(pose: &Se2) -> Se3 {
    let turn = So3::exp(&Vec3::new(0.0, 0.0, pose.rotation.log()));
    Se3::new(turn, Vec3::new(pose.translation.x, pose.translation.y, 0.0))
}
