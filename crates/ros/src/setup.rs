//! The rig, from the first messages: calibrations from `camera_info`, places of the sensors from `/tf_static`, the rate of
//! the IMU from its stamps. The rules are those of bags (`docs/bags.md`).

use crate::frames::looking_ahead;
use crate::messages::{CameraInfo, Imu, TFMessage};
use crate::options::{Options, Topics};
use cairn::geometry::{Se3, Vec3};
use cairn::sensor::{DepthSensor, ImuNoise, ImuSensor, Rig, RigCamera, RigError, is_registered};
use cairn::sources::Frames;
use cairn_bag::{DecodeError, stereo_left_from_right};
use std::collections::BTreeMap;

/// White noise and random walks of a low-cost MEMS sensor, where nothing better is known.
const USUAL_NOISE: ImuNoise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
/// Readings from which the rate of an IMU is taken.
const READINGS: usize = 60;
/// Readings kept while the node waits for the rest.
const MOST_READINGS: usize = 400;

/// Why there is no rig, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// The numbers contradict each other.
    #[error("the calibration is not possible: {0}")]
    Rig(#[from] RigError),
    /// A file of one camera.
    #[error("the calibration file has one camera, and there are pictures of a right one")]
    NoRight,
    /// A file without depth camera.
    #[error("the calibration file has no depth camera, and there are depth images")]
    NoDepth,
    /// A file without IMU.
    #[error("the calibration file has no IMU, and a topic of one is given; leave it out with --no-imu")]
    NoImu,
    /// The times of an IMU stand still.
    #[error("{0}: its stamps do not go on")]
    Rate(String),
    /// No `camera_info` of a topic has come.
    #[error("{0}: no calibration")]
    NoCalibration(String),
    /// A `camera_info` cannot be used.
    #[error("{topic}: {why}; give --rig FILE")]
    Calibration {
        /// Its topic.
        topic: String,
        /// Why.
        why: DecodeError,
    },
    /// Nobody says where the cameras of a pair are.
    #[error(
        "{left} and {right}: where they are to each other is neither in camera_info (P without a baseline) nor on \
         /tf_static; give --rig FILE"
    )]
    Apart {
        /// Pictures of the left camera.
        left: String,
        /// Pictures of the right camera.
        right: String,
    },
    /// The right camera is the left one.
    #[error("{right} is {by_m:.3} m left of {left}: exchange --image and --right")]
    Exchanged {
        /// Pictures of the camera said to be left.
        left: String,
        /// Pictures of the camera said to be right.
        right: String,
        /// How far it is on the wrong side.
        by_m: f64,
    },
    /// Nobody says where the depth camera is.
    #[error("{topic}: where {frame} is, seen from {from}, is not on /tf_static; give --rig FILE")]
    NotPlaced {
        /// The depth images.
        topic: String,
        /// Their frame.
        frame: String,
        /// The frame of the pictures.
        from: String,
    },
}

/// A sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// The first camera.
    Image,
    /// The right camera.
    Right,
    /// The depth camera.
    Depth,
}

/// What was found out.
#[derive(Clone, Debug)]
pub struct Found {
    /// The rig.
    pub rig: Rig,
    /// The first camera (its optical frame) on the robot.
    pub base_from_camera: Se3,
    /// The upward direction in the robot's frame as the accelerometer saw it, m/s^2.
    pub up: Option<Vec3>,
    /// The frame of the first camera's pictures.
    pub frame: String,
    /// What was assumed or is left out, one line each.
    pub notes: Vec<String>,
}

/// Collects the first messages.
pub struct Setup {
    topics: Topics,
    base_frame: String,
    given_base: Option<Se3>,
    rig: Option<Rig>,
    infos: BTreeMap<Role, CameraInfo>,
    frame_of: BTreeMap<Role, String>,
    tree: Frames,
    imu: Vec<Imu>,
}

impl Setup {
    /// Nothing is known yet but what was given: a rig, and perhaps the place of the camera.
    pub fn new(options: &Options, topics: &Topics, rig: Option<Rig>) -> Self {
        Self {
            topics: topics.clone(),
            base_frame: options.base_frame.clone(),
            given_base: options.given_base_from_camera(),
            rig,
            infos: BTreeMap::new(),
            frame_of: BTreeMap::new(),
            tree: Frames::default(),
            imu: Vec::new(),
        }
    }

    /// A calibration.
    pub fn camera_info(&mut self, role: Role, info: CameraInfo) {
        self.infos.insert(role, info);
    }

    /// The frame that a picture is in.
    pub fn picture(&mut self, role: Role, frame: &str) {
        self.frame_of.insert(role, frame.trim_start_matches('/').to_owned());
    }

    /// Static transforms.
    pub fn static_transforms(&mut self, message: &TFMessage) {
        for t in &message.transforms {
            if let Some(parent_from_child) = t.transform.se3() {
                let name = |text: &str| text.trim_start_matches('/').to_owned();
                self.tree.add(&name(&t.header.frame_id), &name(&t.child_frame_id), parent_from_child);
            }
        }
    }

    /// A reading of the IMU.
    pub fn imu(&mut self, reading: Imu) {
        if self.imu.len() < MOST_READINGS {
            self.imu.push(reading);
        }
    }

    /// What is still waited for, by topic; empty when [`Setup::found`] can be called.
    pub fn missing(&self) -> Vec<&str> {
        let used = |role: &Role| !role_topic(&self.topics, *role, false).is_empty();
        let mut missing = Vec::new();
        for role in [Role::Image, Role::Right, Role::Depth].into_iter().filter(used) {
            if !self.frame_of.contains_key(&role) {
                missing.push(role_topic(&self.topics, role, false));
            }
            if self.rig.is_none() && !self.infos.contains_key(&role) {
                missing.push(role_topic(&self.topics, role, true));
            }
        }
        if let Some(topic) = self.topics.imu.as_deref().filter(|_| self.imu.len() < READINGS) {
            missing.push(topic);
        }
        missing
    }

    /// Whether it is known where the camera is on the robot: that may come a little later than the rest.
    pub fn knows_base(&self) -> bool {
        self.given_base.is_some() || self.base_by_tf().is_some()
    }

    fn base_by_tf(&self) -> Option<Se3> {
        self.tree.between(&self.base_frame, self.frame_of.get(&Role::Image)?)
    }

    /// The rig and its place.
    ///
    /// # Errors
    /// What is wrong with a calibration, and what to do.
    pub fn found(&self) -> Result<Found, SetupError> {
        let mut notes = Vec::new();
        let rig = match &self.rig {
            Some(rig) => self.given_rig(rig.clone())?,
            None => self.rig_of_messages(&mut notes)?,
        };
        rig.validate()?;
        let base_from_camera = self.given_base.or_else(|| self.base_by_tf()).unwrap_or_else(|| {
            notes.push(format!(
                "where the camera is on {}, is not on /tf_static: it is taken to look ahead from its origin; \
                 --base-from-camera X Y Z QX QY QZ QW says otherwise",
                self.base_frame
            ));
            looking_ahead()
        });
        let up = self.up(&rig, &base_from_camera);
        let frame = self.frame_of.get(&Role::Image).cloned().unwrap_or_default();
        Ok(Found { rig, base_from_camera, up, frame, notes })
    }

    /// A rig from a file, with the sensors that have topics.
    fn given_rig(&self, mut rig: Rig) -> Result<Rig, SetupError> {
        let wanted = if self.topics.right.is_some() { 2 } else { 1 };
        if rig.cameras.len() < wanted {
            return Err(SetupError::NoRight);
        }
        rig.cameras.truncate(wanted);
        if self.topics.depth.is_none() {
            rig.depth = None;
        } else if rig.depth.is_none() {
            return Err(SetupError::NoDepth);
        }
        if self.topics.imu.is_none() {
            rig.imu = None;
        } else if rig.imu.is_none() {
            return Err(SetupError::NoImu);
        }
        Ok(rig)
    }

    fn rig_of_messages(&self, notes: &mut Vec<String>) -> Result<Rig, SetupError> {
        let left = self.calibrated(Role::Image)?;
        let camera =
            |name: &str, camera, body_from_camera| RigCamera { name: name.into(), camera, body_from_camera };
        let mut cameras = vec![camera("cam0", left.camera, Se3::identity())];
        if self.topics.right.is_some() {
            let right = self.calibrated(Role::Right)?;
            cameras.push(camera("cam1", right.camera, self.pair(&left, &right)?));
        }
        let depth = match self.topics.depth.is_some() {
            true => Some(self.depth(&left)?),
            false => None,
        };
        let mut rig = Rig { cameras, depth, imu: None };
        if let Some(topic) = &self.topics.imu {
            match self.imu_place(&left.frame) {
                // The frame of the body is that of the IMU.
                Some(left_from_imu) => {
                    let body_from_left = left_from_imu.inverse();
                    rig.cameras.iter_mut().for_each(|c| c.body_from_camera = body_from_left * c.body_from_camera);
                    rig.depth.iter_mut().for_each(|d| d.body_from_depth = body_from_left * d.body_from_depth);
                    let rate_hz = rate_hz(&self.imu).ok_or_else(|| SetupError::Rate(topic.clone()))?;
                    let body_from_imu = Se3::identity();
                    rig.imu = Some(ImuSensor { body_from_imu, rate_hz, noise: USUAL_NOISE, offset_s: 0.0 });
                    notes.push(format!("{topic}: {rate_hz:.0} Hz; the noise of a low-cost IMU is assumed"));
                }
                None => notes.push(format!(
                    "{topic} is not used: where its frame is, seen from {}, is not on /tf_static; give --rig FILE",
                    left.frame
                )),
            }
        }
        Ok(rig)
    }

    /// `left_from_imu`.
    fn imu_place(&self, left: &str) -> Option<Se3> {
        let frame = self.imu.last()?.header.frame_id.trim_start_matches('/');
        self.tree.between(left, frame).filter(|_| frame != left)
    }

    fn calibrated(&self, role: Role) -> Result<Calibrated, SetupError> {
        let topic = role_topic(&self.topics, role, false);
        let said = role_topic(&self.topics, role, true);
        let info = self.infos.get(&role).ok_or_else(|| SetupError::NoCalibration(said.to_owned()))?;
        let info = bag_info(info);
        let rectified = topic.contains("image_rect") && info.p[0] != 0.0;
        let camera =
            info.camera(rectified).map_err(|why| SetupError::Calibration { topic: said.to_owned(), why })?;
        let frame = self.frame_of.get(&role).cloned().unwrap_or_default();
        Ok(Calibrated { topic: topic.to_owned(), frame, info, camera, rectified })
    }

    /// `left_from_right`.
    fn pair(&self, left: &Calibrated, right: &Calibrated) -> Result<Se3, SetupError> {
        let rectified = left.rectified && right.rectified;
        let by_info = stereo_left_from_right(&left.info, &right.info, rectified);
        let by_info = by_info.map_err(|why| SetupError::Calibration { topic: right.topic.clone(), why })?;
        let by_tf = || self.tree.between(&left.frame, &right.frame).filter(|_| left.frame != right.frame);
        let found = by_info
            .or_else(by_tf)
            .ok_or_else(|| SetupError::Apart { left: left.topic.clone(), right: right.topic.clone() })?;
        match found.translation.x > 0.0 {
            true => Ok(found),
            false => Err(SetupError::Exchanged {
                left: left.topic.clone(),
                right: right.topic.clone(),
                by_m: -found.translation.x,
            }),
        }
    }

    fn depth(&self, left: &Calibrated) -> Result<DepthSensor, SetupError> {
        let depth = self.calibrated(Role::Depth)?;
        let place = match depth.frame == left.frame {
            true => Some(Se3::identity()),
            false => self.tree.between(&left.frame, &depth.frame),
        };
        let left_from_depth = place.ok_or_else(|| {
            let (frame, from) = (depth.frame.clone(), left.frame.clone());
            SetupError::NotPlaced { topic: depth.topic.clone(), frame, from }
        })?;
        let registered = is_registered(&left.camera, &depth.camera, &left_from_depth);
        let camera = if registered { left.camera } else { depth.camera };
        // REP 118: 16-bit depth is in millimetres; metres become millimetres when they are read.
        Ok(DepthSensor { camera, body_from_depth: left_from_depth, metres_per_unit: 0.001, registered })
    }

    /// Mean of the accelerometer over the readings so far, in the robot's axes.
    fn up(&self, rig: &Rig, base_from_camera: &Se3) -> Option<Vec3> {
        let imu = rig.imu.as_ref()?;
        let sum: Vec3 = self.imu.iter().map(|m| m.linear_acceleration.vector()).sum();
        let body_from_camera = rig.cameras.first()?.body_from_camera;
        let base_from_imu =
            base_from_camera.rotation * body_from_camera.rotation.inverse() * imu.body_from_imu.rotation;
        let up = base_from_imu * (sum / self.imu.len().max(1) as f64);
        up.iter().all(|v| v.is_finite()).then_some(up)
    }
}

/// A camera with its calibration.
struct Calibrated {
    topic: String,
    frame: String,
    info: cairn_bag::CameraInfo,
    camera: cairn::sensor::Camera,
    rectified: bool,
}

fn role_topic(topics: &Topics, role: Role, info: bool) -> &str {
    let pair = match role {
        Role::Image => Some((&topics.image, &topics.image_info)),
        Role::Right => topics.right.as_ref().map(|(a, b)| (a, b)),
        Role::Depth => topics.depth.as_ref().map(|(a, b)| (a, b)),
    };
    pair.map_or("", |(topic, of_info)| if info { of_info } else { topic })
}

fn bag_info(info: &CameraInfo) -> cairn_bag::CameraInfo {
    cairn_bag::CameraInfo {
        header: cairn_bag::Header {
            stamp_ns: info.header.stamp.stamp().0,
            frame_id: info.header.frame_id.clone(),
        },
        height: info.height,
        width: info.width,
        model: info.distortion_model.clone(),
        d: info.d.clone(),
        k: info.k,
        r: info.r,
        p: info.p,
    }
}

/// One over the median step of the stamps.
fn rate_hz(readings: &[Imu]) -> Option<f64> {
    let stamps = readings.windows(2).map(|w| w[1].header.stamp.stamp().0 - w[0].header.stamp.stamp().0);
    let mut steps: Vec<i64> = stamps.filter(|step| *step > 0).collect();
    steps.sort_unstable();
    let median = *steps.get(steps.len() / 2)?;
    Some(1e9 / median as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, Quaternion, Transform, TransformStamped, Vector3};
    use cairn::Stamp;

    fn setup(line: &str) -> Setup {
        let words = format!("cairn-ros {line}");
        let options = Options::parse_arguments(words.split_whitespace().map(String::from)).unwrap();
        Setup::new(&options, &options.topics().unwrap(), None)
    }

    fn info(baseline_m: f64) -> CameraInfo {
        let (fx, k) = (400.0, [400.0, 0.0, 320.0, 0.0, 400.0, 240.0, 0.0, 0.0, 1.0]);
        let p = [fx, 0.0, 320.0, -fx * baseline_m, 0.0, fx, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let distortion_model = "plumb_bob".to_owned();
        CameraInfo {
            width: 640,
            height: 480,
            distortion_model,
            d: vec![0.0; 5],
            k,
            r,
            p,
            ..CameraInfo::default()
        }
    }

    fn transform(parent: &str, child: &str, x: f64) -> TFMessage {
        let transform = Transform {
            translation: Vector3 { x, y: 0.0, z: 0.0 },
            rotation: Quaternion { w: 1.0, ..Quaternion::default() },
        };
        let header = Header::new(Stamp(0), parent);
        TFMessage { transforms: vec![TransformStamped { header, child_frame_id: child.into(), transform }] }
    }

    fn reading(k: i64) -> Imu {
        let linear_acceleration = Vector3 { x: 0.0, y: -9.8, z: 0.0 };
        Imu { header: Header::new(Stamp(k * 5_000_000), "imu"), linear_acceleration, ..Imu::default() }
    }

    #[test]
    fn a_pair_by_camera_info_and_an_imu_by_tf() {
        let mut setup = setup("--camera stereo --imu /imu");
        let missing = [
            "/camera/left/image_raw",
            "/camera/left/camera_info",
            "/camera/right/image_raw",
            "/camera/right/camera_info",
            "/imu",
        ];
        assert_eq!(setup.missing(), missing);
        setup.camera_info(Role::Image, info(0.0));
        setup.camera_info(Role::Right, info(0.12));
        setup.picture(Role::Image, "/left");
        setup.picture(Role::Right, "right");
        (0..100).for_each(|k| setup.imu(reading(k)));
        assert!(setup.missing().is_empty() && !setup.knows_base());
        // The IMU's place is not known: it is left out, and said so.
        let found = setup.found().unwrap();
        assert!(
            found.rig.imu.is_none() && found.notes.iter().any(|n| n.contains("/imu is not used")),
            "{:?}",
            found.notes
        );
        assert!((found.rig.cameras[1].body_from_camera.translation.x - 0.12).abs() < 1e-9);
        setup.static_transforms(&transform("left", "imu", 0.05));
        setup.static_transforms(&transform("base_link", "left", 0.3));
        assert!(setup.knows_base());
        let found = setup.found().unwrap();
        let imu = found.rig.imu.as_ref().unwrap();
        assert!((imu.rate_hz - 200.0).abs() < 1e-6);
        assert!((found.rig.cameras[0].body_from_camera.translation.x + 0.05).abs() < 1e-9);
        assert!((found.base_from_camera.translation.x - 0.3).abs() < 1e-9);
        assert!((found.up.unwrap() - Vec3::new(0.0, -9.8, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn what_cannot_be_is_said_with_a_cure() {
        let mut setup = setup("--camera stereo");
        for (role, frame, baseline) in [(Role::Image, "left", 0.12), (Role::Right, "right", 0.0)] {
            setup.camera_info(role, info(baseline));
            setup.picture(role, frame);
        }
        assert!(setup.found().unwrap_err().to_string().contains("exchange --image and --right"));
        setup.camera_info(Role::Image, info(0.0));
        assert!(setup.found().unwrap_err().to_string().contains("/tf_static"));
        setup.camera_info(Role::Image, CameraInfo::default());
        assert!(setup.found().unwrap_err().to_string().contains("--rig"));
        let mut nan = info(0.0);
        nan.k[0] = f64::NAN;
        setup.camera_info(Role::Image, nan);
        assert!(setup.found().is_err());
        setup.static_transforms(&transform("left", "right", f64::NAN));
        assert!(setup.tree.between("left", "right").is_none());
    }

    #[test]
    fn aligned_depth_is_registered_and_another_is_not() {
        let mut setup = setup("--camera realsense-rgbd");
        for role in [Role::Image, Role::Depth] {
            setup.camera_info(role, info(0.0));
            setup.picture(role, "colour");
        }
        assert!(setup.found().unwrap().rig.depth.unwrap().registered);
        setup.picture(Role::Depth, "depth");
        assert!(setup.found().unwrap_err().to_string().contains("/tf_static"));
        setup.static_transforms(&transform("colour", "depth", -0.015));
        let depth = setup.found().unwrap().rig.depth.unwrap();
        assert!(!depth.registered && (depth.body_from_depth.translation.x + 0.015).abs() < 1e-9);
    }
}
