//! The rig of a bag: from `camera_info` and `tf_static`, or from what the RealSense SDK recorded.
//!
//! The body is the IMU's frame, without an IMU the first camera's. A stereo pair is placed by its own calibration (the
//! baseline in `P`, the rotations `R`), else by the transforms; depth and the IMU by the transforms.

use super::frames::Frames;
use super::realsense::{Recorder, stream};
use super::topics::{Chosen, namespace};
use crate::bag_reader::{BagReader, ImuTopics, median_step_ns};
use crate::rig::CalibrationError;
use cairn_bag::{CameraInfo, MessageKind, static_transforms, stereo_left_from_right};
use cairn_geometry::Se3;
use cairn_sensor::{DepthSensor, ImuNoise, ImuSensor, Rig, RigCamera, SourceError, is_registered};

/// Noise of a phone's IMU, for one whose calibration is not in the bag.
const USUAL_NOISE: ImuNoise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };

const GIVE_RIG: &str = "give its calibration with --rig FILE";

/// The rig, and what of it was assumed. Without extrinsics of the IMU that is left out, which `skipped` tells.
pub fn of(
    shown: &str,
    bag: &mut BagReader,
    chosen: &mut Chosen,
    recorder: Option<Recorder>,
    skipped: &mut Vec<String>,
) -> Result<(Rig, Vec<String>), SourceError> {
    let mut assumed = Vec::new();
    let scene = Scene::of(bag, recorder, skipped);
    let left = scene.camera(shown, bag, chosen.cameras.first().copied(), chosen.info[0])?;
    let mut cameras = vec![rig_camera("cam0", &left, Se3::identity())];
    if let Some(&topic) = chosen.cameras.get(1) {
        let right = scene.camera(shown, bag, Some(topic), chosen.info[1])?;
        let left_from_right = scene.pair(shown, &left, &right)?;
        cameras.push(rig_camera("cam1", &right, left_from_right));
        skipped.extend(scene.recorder.as_ref().and_then(|r| r.doubt()));
    }
    let depth = match chosen.depth {
        Some(topic) => Some(scene.depth(shown, bag, &left, topic, chosen.info[2])?),
        None => None,
    };
    let mut rig = Rig { cameras, depth, imu: None };
    let left_from_imu = scene.imu(bag, chosen, &left);
    if let Some(place) = left_from_imu {
        match place {
            Ok(left_from_imu) => {
                let body_from_left = left_from_imu.inverse();
                rig.cameras.iter_mut().for_each(|c| c.body_from_camera = body_from_left * c.body_from_camera);
                rig.depth.iter_mut().for_each(|d| d.body_from_depth = body_from_left * d.body_from_depth);
                rig.imu = Some(ImuSensor {
                    body_from_imu: Se3::identity(),
                    rate_hz: rate_hz(bag, chosen),
                    noise: USUAL_NOISE,
                    offset_s: 0.0,
                });
                assumed.push("the noise of the IMU is that of a phone's".into());
            }
            Err(why) => {
                chosen.imu = ImuTopics::None;
                skipped.push(format!("the IMU is not used: {why}; {GIVE_RIG}"));
            }
        }
    }
    Ok((rig, assumed))
}

fn rig_camera(name: &str, calibrated: &Calibrated, body_from_camera: Se3) -> RigCamera {
    RigCamera { name: name.into(), camera: calibrated.camera, body_from_camera }
}

fn rate_hz(bag: &BagReader, chosen: &Chosen) -> f64 {
    let (ImuTopics::One(topic) | ImuTopics::Split { gyro: topic, .. }) = chosen.imu else { return 0.0 };
    let entries = bag.topics().get(topic).map_or(&[][..], |t| &t.entries);
    let step = median_step_ns(entries.iter().map(|e| e.stamp_ns));
    if step == 0 { 0.0 } else { 1e9 / step as f64 }
}

/// A camera with its calibration.
struct Calibrated {
    name: String,
    frame: String,
    info: CameraInfo,
    camera: cairn_sensor::Camera,
    rectified: bool,
}

/// The transforms of a bag.
struct Scene {
    frames: Frames,
    recorder: Option<Recorder>,
}

impl Scene {
    fn of(bag: &mut BagReader, recorder: Option<Recorder>, skipped: &mut Vec<String>) -> Self {
        if let Some(recorder) = recorder {
            return Self { frames: recorder.frames.clone(), recorder: Some(recorder) };
        }
        let mut frames = Frames::default();
        for topic in 0..bag.topics().len() {
            let Some(about) = bag.topics().get(topic) else { continue };
            if !about.name.ends_with("tf_static") {
                continue;
            }
            let (name, format, count) = (about.name.clone(), about.format, about.entries.len());
            for number in 0..count {
                let bytes = bag.message(topic, number);
                match bytes.and_then(|b| Ok(static_transforms(format, &b)?)) {
                    Ok(transforms) => {
                        transforms.iter().for_each(|t| frames.add(&t.parent, &t.child, t.parent_from_child));
                    }
                    Err(e) => skipped.push(format!("{name}: {e}")),
                }
            }
        }
        Self { frames, recorder: None }
    }

    /// The calibration of the images on a topic.
    fn camera(
        &self,
        shown: &str,
        bag: &mut BagReader,
        topic: Option<usize>,
        info: Option<usize>,
    ) -> Result<Calibrated, SourceError> {
        let name = topic.and_then(|i| bag.topics().get(i)).map_or(String::new(), |t| t.name.clone());
        let fail = |why: String| {
            let cure = format!(
                "{GIVE_RIG}, or name its camera_info with --topic left-info=TOPIC (right-info, depth-info)"
            );
            SourceError::new(shown, format!("{name}: {why}"), cure)
        };
        let topic = topic.ok_or_else(|| fail("there are no images".into()))?;
        let first = bag.first_image(topic).map_err(|e| fail(e.to_string()))?;
        let of_recorder = self.recorder.as_ref().and_then(|r| r.intrinsics(stream(&name)));
        let info = match (of_recorder, info.or_else(|| self.info_of(bag, &name, &first.frame))) {
            (Some(info), _) => info.clone(),
            (None, Some(from)) => bag.camera_info(from).map_err(|e| fail(e.to_string()))?,
            (None, None) => return Err(fail("the bag has no camera_info for it".into())),
        };
        // "image_rect" is rectified, "image_rect_raw" of RealSense's node is so by the device: K says the same there.
        let rectified = name.contains("image_rect") && info.p[0] != 0.0;
        let camera = info.camera(rectified).map_err(|e| fail(e.to_string()))?;
        let frame = match self.recorder {
            Some(_) => stream(&name).to_owned(),
            None => first.frame,
        };
        Ok(Calibrated { name, frame, info, camera, rectified })
    }

    /// The topic of a camera's calibration: in its namespace, else the only one of its frame.
    fn info_of(&self, bag: &mut BagReader, name: &str, frame: &str) -> Option<usize> {
        let path = match self.recorder {
            Some(_) => format!("{}/info/camera_info", stream(name)),
            None => format!("{}/camera_info", namespace(name)),
        };
        let infos: Vec<usize> = (0..bag.topics().len())
            .filter(|i| {
                let topic = bag.topics().get(*i);
                topic.is_some_and(|t| t.message_kind() == MessageKind::CameraInfo && !t.entries.is_empty())
            })
            .collect();
        if let Some(i) = infos.iter().find(|i| bag.topics().get(**i).is_some_and(|t| t.name == path)) {
            return Some(*i);
        }
        if self.recorder.is_some() {
            return None;
        }
        let mut of_frame = infos.into_iter().filter(|i| {
            let info = bag.camera_info(*i);
            info.is_ok_and(|info| info.header.frame_id.trim_start_matches('/') == frame && !frame.is_empty())
        });
        match (of_frame.next(), of_frame.next()) {
            (Some(one), None) => Some(one),
            _ => None,
        }
    }

    fn pair(&self, shown: &str, left: &Calibrated, right: &Calibrated) -> Result<Se3, SourceError> {
        let fail = |why: String, cure: &str| {
            SourceError::new(shown, format!("{} and {}: {why}", left.name, right.name), cure)
        };
        let rectified = left.rectified && right.rectified;
        let by_info = stereo_left_from_right(&left.info, &right.info, rectified);
        let by_info = by_info.map_err(|e| fail(e.to_string(), GIVE_RIG))?;
        let found = by_info.or_else(|| self.frames.between(&left.frame, &right.frame));
        let found = found.filter(|_| by_info.is_some() || left.frame != right.frame).ok_or_else(|| {
            let why = "where they are to each other is neither in their camera_info (P without a baseline) nor in tf_static";
            fail(why.into(), GIVE_RIG)
        })?;
        if found.translation.x <= 0.0 {
            let why = format!("the right camera is {:.3} m left of the left one", -found.translation.x);
            return Err(fail(why, "exchange them: --topic left=TOPIC --topic right=TOPIC"));
        }
        Ok(found)
    }

    fn depth(
        &self,
        shown: &str,
        bag: &mut BagReader,
        left: &Calibrated,
        topic: usize,
        info: Option<usize>,
    ) -> Result<DepthSensor, SourceError> {
        let depth = self.camera(shown, bag, Some(topic), info)?;
        let place = match depth.frame == left.frame {
            true => Some(Se3::identity()),
            false => self.frames.between(&left.frame, &depth.frame),
        };
        let left_from_depth = place.ok_or_else(|| {
            let why = format!("where {} is, seen from {}, is not in tf_static", depth.frame, left.frame);
            SourceError::new(shown, format!("{}: {why}", depth.name), GIVE_RIG)
        })?;
        let metres_per_unit = match &self.recorder {
            Some(recorder) => recorder.depth_unit(shown, &depth.name)?,
            // REP 118; metres become millimetres when they are read.
            None => 0.001,
        };
        let registered = is_registered(&left.camera, &depth.camera, &left_from_depth);
        let camera = if registered { left.camera } else { depth.camera };
        Ok(DepthSensor { camera, body_from_depth: left_from_depth, metres_per_unit, registered })
    }

    /// `left_from_imu`; `None` without an IMU, an error where its place is unknown.
    fn imu(
        &self,
        bag: &mut BagReader,
        chosen: &Chosen,
        left: &Calibrated,
    ) -> Option<Result<Se3, CalibrationError>> {
        let unknown = |why: String| Err(CalibrationError(why));
        let (ImuTopics::One(topic) | ImuTopics::Split { gyro: topic, .. }) = chosen.imu else { return None };
        let name = bag.topics().get(topic).map_or(String::new(), |t| t.name.clone());
        let frame = match self.recorder {
            Some(_) => Some(stream(&name).to_owned()),
            None => bag.imu_frame(topic).filter(|frame| !frame.is_empty()),
        };
        let Some(frame) = frame else { return Some(unknown(format!("{name} names no frame"))) };
        let place = self.frames.between(&left.frame, &frame);
        let place = place.filter(|_| frame != left.frame);
        let nowhere = || unknown(format!("where {frame} is, seen from {}, is not in tf_static", left.frame));
        Some(place.map_or_else(nowhere, Ok))
    }
}
