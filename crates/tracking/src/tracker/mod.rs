//! The tracking stage, frame by frame: predict, match, locate, decide.

mod depth;
mod find;
mod finish;
mod found;
mod lost;
mod regain_scale;
mod scale;
mod static_landmarks;
#[cfg(test)]
mod tests;
mod turning;
mod waiting;

use crate::dense::DenseAligner;
use crate::first_clocks::FirstClocks;
use crate::flow::FlowClocks;
use crate::imu::InertialFilter;
use crate::local_map::LocalMap;
use crate::match_last::Matches;
use crate::odometry::{MotionSource, Odometry, OdometryFilter};
use crate::on_the_spot::SpotWatch;
use crate::parallax::ParallaxWatch;
use crate::reckoning::{DeadReckoning, MeasuredMotion, Reckoned};
use crate::scale::{Pace, PaceComparison, ScaleSupport};
use crate::shutter::{Moving, Shutter, in_camera};
use crate::start::Starter;
use crate::state::{AnchoredPose, KeyFrameRequest, Last, Tracked};
use cairn_atlas::{KeyFrameId, Readout, Snapshot};
use cairn_geometry::{Se3, So3};
use cairn_inertial::Failed;
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use cairn_settings::Settings;
use cairn_vision::{Frame, RectifiedCamera};
pub use found::{DepthPlaced, FoundByDepth};
use nalgebra::SVector;
use std::collections::VecDeque;
use std::sync::Arc;

/// Configuration of tracking.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct TrackerConfig {
    /// Inlier matches needed to accept a pose.
    #[setting(default = 25, range = 6..=10000)]
    pub min_inliers: usize,
    /// Key frames in the local map, at most.
    #[setting(default = 40, range = 1..=10000)]
    pub local_key_frames: usize,
    /// Frames between two key frames, at least.
    #[setting(default = 1, range = 0..=10000)]
    pub min_key_frame_gap: usize,
    /// Seconds without a pose after which a new map begins, if the place has not been recognised by then.
    #[setting(default = 0.5, range = 0.0..=1e4)]
    pub new_map_s: f64,
    /// Standard deviation of the position in metres up to which the IMU may carry the pose (coasting).
    #[setting(default = 1.0, range = 0.0..=100.0)]
    pub coast_sigma: f64,
    /// Longest time in motion for which it may do so, in seconds.
    #[setting(default = 6.0, range = 0.0..=15.0)]
    pub coast_s: f64,
    /// Seconds from the exposure of the first row of an image to that of the last (rolling shutter); negative where the last
    /// row is first, 0 where all are exposed at once. Stamps are those of the middle row.
    #[setting(default = 0.0, range = -0.05..=0.05)]
    pub readout_s: f64,
    /// True to estimate the time above from the images and the motion, whatever is given; the rows of an upright image are
    /// taken for the columns of the sensor.
    #[setting(default = false)]
    pub estimate_readout: bool,
    /// True to find the offset of the IMU's clock and the time above from the first second of pictures, before a map begins; only where
    /// that time is estimated.
    #[setting(default = false)]
    pub clocks_by_flow: bool,
    /// True to take the pose of each frame from its depth image (`--front-end dense`); features still find places again. Without
    /// it the depth image gives the pose where features do not suffice.
    #[setting(default = false)]
    pub dense: bool,
    /// Seconds without a pose after which the place is looked for by the shape of its surfaces, where there is depth and
    /// surfaces are made (`--dense`).
    #[setting(default = 1.0, range = 0.0..=1e4)]
    pub find_by_depth_s: f64,
    /// True where the camera is known to be in the rooms of the map: then their shape alone tells where (a start in a saved map
    /// in the dark). Without it features have to agree, or the camera has to have been tracked near there less than three seconds
    /// before: a room that is not in the map may look like one that is.
    #[setting(default = false)]
    pub find_by_shape_alone: bool,
}

/// Seconds without a pose up to which matches are still searched around the pose predicted by the motion
/// model.
const BRIDGE_S: f64 = 0.6;
/// The tracking stage.
#[derive(Debug)]
pub struct Tracker {
    pub(crate) camera: RectifiedCamera,
    pub(crate) features: usize,
    pub(crate) rate_hz: f64,
    pub(crate) config: TrackerConfig,
    pub(crate) starter: Starter,
    /// Clocks and rows before there is a map, and what was found of them.
    pub(crate) first_clocks: FirstClocks,
    pub(crate) flow: Option<FlowClocks>,
    /// Frames from before there was a map, oldest first.
    pub(crate) waiting: VecDeque<Arc<Frame>>,
    local: LocalMap,
    pub(crate) last: Option<Last>,
    /// Velocity in the camera frame (metres or map units per second, radians per second), when the last two
    /// frames had a pose.
    pub(crate) velocity: Option<SVector<f64, 6>>,
    /// Speeds of the last frames, map units per second.
    pub(crate) pace: Pace,
    /// Whether scale is supported, where neither depth nor an IMU gives it.
    pub(crate) scale_support: ScaleSupport,
    /// Whether there is parallax to observe depth, in the same case.
    pub(crate) parallax: ParallaxWatch,
    /// Whether the camera turns on the spot while the motion sensors carry the pose.
    pub(crate) spot: SpotWatch,
    /// A map whose unit of length was guessed from the walking speed.
    pub(crate) pace_comparison: Option<PaceComparison>,
    /// While rotation alone is tracked: an earlier frame with its orientation, against which it is checked.
    pub(crate) rotation_check: Option<(Arc<Frame>, So3)>,
    /// When the camera was last seen to turn on the spot.
    pub(crate) turned_until: Option<Stamp>,
    /// Poses since scale lost its support, for the frame with which a new map begins.
    pub(crate) unsupported: VecDeque<(Stamp, AnchoredPose)>,
    /// When the places from before that were last looked for.
    looked_for_scale: Option<Stamp>,
    /// The key frame to which the last pose was anchored, and its unit of length at that time.
    unit: Option<(KeyFrameId, f64)>,
    pub(crate) lost: bool,
    /// Frames since tracking was lost.
    pub(crate) lost_frames: usize,
    /// When the last frame was located.
    pub(crate) located: Option<Stamp>,
    /// When the last map was created, or the first frame arrived.
    pub(crate) map_created: Option<Stamp>,
    /// Frame periods since the last key frame request, at the nominal rate: frames that did not come count too.
    pub(crate) since_key_frame: usize,
    /// The same since the place was found again.
    since_recovery: usize,
    /// When the last frame was taken.
    stepped: Option<Stamp>,
    pub(crate) inertial: Option<InertialFilter>,
    /// Motion that is measured by other means than the camera and the IMU.
    pub(crate) reckoning: DeadReckoning,
    /// The pose at which a key frame was asked for last.
    requested_at: Option<(Stamp, AnchoredPose)>,
    /// Aligns depth images where features do not suffice.
    pub(crate) dense: Option<DenseAligner>,
    /// Where a search by depth has found the camera, for the next frame.
    found: Option<FoundByDepth>,
    odometry: OdometryFilter,
    shutter: Shutter,
}

impl Tracker {
    /// A tracker without a map. `features` is the feature budget of the front end (initialisation thresholds
    /// are relative to it), `rate_hz` the nominal frame rate.
    pub fn new(camera: RectifiedCamera, features: usize, rate_hz: f64, config: TrackerConfig) -> Self {
        Self {
            camera,
            features,
            rate_hz,
            config,
            starter: Starter::default(),
            first_clocks: FirstClocks::default(),
            flow: None,
            waiting: VecDeque::new(),
            local: LocalMap::default(),
            last: None,
            velocity: None,
            pace: Pace::default(),
            scale_support: ScaleSupport::default(),
            parallax: ParallaxWatch::default(),
            spot: SpotWatch::default(),
            pace_comparison: None,
            rotation_check: None,
            turned_until: None,
            unsupported: VecDeque::new(),
            looked_for_scale: None,
            unit: None,
            lost: false,
            lost_frames: 0,
            located: None,
            map_created: None,
            since_key_frame: 0,
            since_recovery: usize::MAX / 2,
            stepped: None,
            inertial: None,
            reckoning: DeadReckoning::default(),
            requested_at: None,
            dense: None,
            found: None,
            odometry: OdometryFilter::new(camera),
            shutter: Shutter::new(given_s(&config), size_of(&camera)),
        }
    }

    /// Adds an IMU, whose white noise is `noise_times` that of its data sheet; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, noise_times: f64) -> Self {
        Self { inertial: Some(InertialFilter::new(sensor, imu_from_camera, noise_times)), ..self }
    }

    /// Columns and rows of the raw image, for a rolling shutter; without them, they are taken from the bounds of the rectified
    /// one.
    pub fn with_size(self, size: [usize; 2]) -> Self {
        let shutter = Shutter::new(given_s(&self.config), size);
        Self { shutter, ..self }
    }

    /// The readout time of the camera's rows (its standard deviation is zero where it is given).
    pub fn readout(&self, snapshot: &Snapshot) -> Readout {
        self.shutter.readout(snapshot)
    }

    /// Reports that mapping has created a map from the last request: the last frame is now key frame `id`.
    pub fn map_created(&mut self, snapshot: &Snapshot, id: KeyFrameId) {
        let Some(k) = snapshot.key_frame(id) else { return };
        let anchored = AnchoredPose::at(k.id, k.world_from_camera);
        self.last = Some(Last { frame: k.frame.shared(), landmarks: k.landmarks.clone(), anchored });
        self.lost = false;
        self.lost_frames = 0;
        self.velocity = None;
        self.start_pace(snapshot, k);
        self.located = Some(k.stamp);
        self.map_created = Some(k.stamp);
        self.since_key_frame = 0;
        self.reckoning.restart(true);
        if let Some(inertial) = &mut self.inertial {
            inertial.map_created(k);
        }
        self.odometry.map_created(snapshot, id);
        self.dense_map_created(snapshot, k.stamp, anchored);
    }

    /// The camera was at the newest key frame a moment ago, when another tracker followed it: it is looked for there first. Nothing
    /// where that was too long before `now` to tell where it is.
    pub fn resume(&mut self, snapshot: &Snapshot, now: Stamp) {
        let newest = snapshot.newest_key_frame().filter(|k| (0.0..BRIDGE_S).contains(&(now - k.stamp)));
        let Some(k) = newest else { return };
        let anchored = AnchoredPose::at(k.id, k.world_from_camera);
        self.last = Some(Last { frame: k.frame.shared(), landmarks: k.landmarks.clone(), anchored });
        (self.lost, self.located) = (true, Some(k.stamp));
    }

    /// What is wrong with the readings of the IMU, and since when; `None` while they are believed. With how many were left out one by
    /// one.
    pub fn imu_fault(&self) -> (Option<Failed>, usize) {
        self.inertial.as_ref().map_or((None, 0), |i| (i.fault(), i.refused()))
    }

    /// The odometry of the last frame; `None` when that has no pose.
    pub fn odometry(&self) -> Option<Odometry> {
        self.odometry.current()
    }

    /// What other sensors measured of the motion up to the frame that is tracked next; to be told before each
    /// [`Tracker::step`]. It counts for cameras with depth, whose unit of length is the metre; together with an IMU it
    /// carries the pose where the IMU does not.
    pub fn motion_measured(&mut self, motion: Option<&MeasuredMotion>) {
        let camera_from_body = self.camera.world_from_body(&Se3::identity(), true);
        self.reckoning.measured(motion.filter(|_| self.camera.has_depth()), &camera_from_body);
    }

    /// Tracks one frame, with the IMU readings up to it. `idle` says whether mapping would process a key
    /// frame at once, `mapping` whether it takes key frames at all. Once tracking is lost and the place is
    /// not recognised, the result may request a new map that begins with this frame.
    pub fn step(
        &mut self,
        frame: Arc<Frame>,
        imu: &[ImuSample],
        snapshot: &Snapshot,
        idle: bool,
        mapping: bool,
    ) -> Tracked {
        self.map_created.get_or_insert(frame.stamp);
        let periods = self.periods_since_last(frame.stamp);
        self.reckoning.advance();
        if let Some(inertial) = &mut self.inertial {
            let flow = self.flow.filter(|_| snapshot.key_frame_count() == 0);
            inertial.take(imu, flow.map_or(snapshot.imu_offset(), |flow| flow.offset_s[0]));
        }
        if snapshot.key_frame_count() == 0 {
            let frame = self.at_middle_row(frame, snapshot);
            return self.start(frame, snapshot);
        }
        self.since_key_frame = self.since_key_frame.saturating_add(periods);
        self.since_recovery = self.since_recovery.saturating_add(periods);
        self.refresh_last(snapshot);
        if let Some(inertial) = &mut self.inertial {
            inertial.refresh(snapshot);
        }
        let earlier = self.track_waiting_frames(snapshot);
        let frame = self.at_middle_row(frame, snapshot);
        let imu_motion = (self.inertial.as_ref().zip(self.odometry.last_stamp()))
            .and_then(|(inertial, last)| inertial.moved(last, frame.stamp));
        let other_motion = (imu_motion.map(|motion| (motion, MotionSource::Imu)))
            .or(self.reckoning.step().map(|motion| (motion, MotionSource::Measured)));
        let before = self.begin_where_found(&frame, snapshot);
        let mut tracked = self.track(frame.clone(), snapshot, idle);
        if let Some(before) = before {
            self.keep_or_put_back(before, &frame, &mut tracked);
        }
        let other_motion = self.aligned_motion().or(other_motion);
        self.follow(&frame, snapshot, &tracked, other_motion);
        self.remember_depth(snapshot, &tracked);
        if self.lost && mapping {
            tracked.request =
                self.bridge(frame.clone(), snapshot).or_else(|| self.begin_new_map(frame, snapshot));
        } else if self.scale_support.is_lost() && mapping {
            tracked.request = self.begin_with_own_scale(frame, snapshot).or(tracked.request);
        } else if !self.lost {
            self.starter = Starter::default();
        }
        tracked.earlier = earlier;
        self.restart_motion_at(snapshot, &mut tracked);
        tracked
    }

    /// Frame periods at the nominal rate since the last frame, at least one: where a machine is too slow for every picture, what
    /// is to happen after so many happens in time all the same.
    pub(crate) fn periods_since_last(&mut self, stamp: Stamp) -> usize {
        let since_s = self.stepped.replace(stamp).map_or(0.0, |last| stamp - last);
        ((since_s * self.rate_hz).round() as usize).max(1)
    }

    /// Gives a key frame that is asked for the motion measured since the one before it, which counts from there on.
    fn restart_motion_at(&mut self, snapshot: &Snapshot, tracked: &mut Tracked) {
        let carried = self.carried_by_depth(snapshot, tracked);
        let Some(request) = &mut tracked.request else { return };
        let stamp = match request {
            KeyFrameRequest::First { frame, .. } | KeyFrameRequest::Next { frame, .. } => frame.stamp,
            KeyFrameRequest::Pair { second, .. } => second.stamp,
        };
        let since = self.reckoning.restart_at_key_frame(stamp);
        let turned = self.requested_at.and_then(|(before, _)| self.turned_since(before, stamp));
        if let KeyFrameRequest::Next { anchored, motion, .. } = request {
            *motion = since.or(carried).or(turned);
            self.requested_at = Some((stamp, *anchored));
        } else {
            self.requested_at = None;
        }
    }

    /// Whether the pose can be reached by the motion measured since the last key frame was asked for: from frame to frame tracking may
    /// creep along with what moves, by less than its noise.
    fn agrees_since_request(&self, snapshot: &Snapshot, world_from_camera: &Se3) -> bool {
        let (Some((_, at)), Some(motion)) = (self.requested_at, self.reckoning.since_key_frame()) else {
            return true;
        };
        let before = snapshot.resolve(at.reference, &at.reference_from_camera);
        before.is_none_or(|before| motion.agrees(&(before.inverse() * *world_from_camera)))
    }

    /// The frame as it would be if all rows were exposed with the middle one.
    fn at_middle_row(&mut self, mut frame: Arc<Frame>, snapshot: &Snapshot) -> Arc<Frame> {
        if self.shutter.is_global() {
            return frame;
        }
        let known = !self.lost && self.recent(&frame, BRIDGE_S);
        let predicted = self.inertial.as_ref().filter(|_| known).and_then(|i| i.predict(frame.stamp));
        let last_motion = self.velocity.filter(|_| known);
        let turning = (self.inertial.as_ref().and_then(|i| i.turning(frame.stamp)))
            .or(last_motion.map(|v| v.fixed_rows::<3>(3).into_owned()));
        let velocity = (predicted.as_ref().map(|p| p.world_from_camera.rotation.inverse() * p.velocity))
            .or(last_motion.map(|v| v.fixed_rows::<3>(0).into_owned()));
        let moving = Moving { turning: turning.unwrap_or_default(), velocity: velocity.unwrap_or_default() };
        let last = self.last.as_ref().filter(|_| known);
        let pose = predicted.map(|p| p.world_from_camera).or(last.map(|l| l.anchored.world_from_camera));
        let seen = last.into_iter().flat_map(|l| l.landmarks.iter().flatten());
        let points = seen.filter_map(|id| snapshot.landmark(*id)).map(|l| l.position);
        let points = in_camera(&pose.unwrap_or_default(), points);
        // What no map knows yet.
        let flow = self.flow.filter(|_| snapshot.key_frame_count() == 0);
        let readout_s = flow.map_or(self.shutter.readout(snapshot).seconds, |flow| flow.readout_s[0]);
        self.shutter.correct(Arc::make_mut(&mut frame), &self.camera, readout_s, &moving, points);
        frame
    }

    /// Finds the pose of a frame: by the motion model, by the reference key frame, or by relocalisation.
    fn track(&mut self, frame: Arc<Frame>, snapshot: &Snapshot, idle: bool) -> Tracked {
        let mut predicted = self.inertial.as_ref().and_then(|i| i.predict(frame.stamp));
        if self.dense.as_ref().is_some_and(DenseAligner::is_active) {
            predicted = self.align(&frame, snapshot, predicted);
        }
        let reckoned = self.reckoned().filter(|_| predicted.is_none());
        let can_coast = predicted.as_ref().is_some_and(|b| self.may_coast(&frame, b))
            || reckoned.is_some_and(|r| r.may_coast());
        // A short gap is bridged by the motion model; after a longer one only appearance can find the pose.
        let first_guess = if self.lost && !self.recent(&frame, BRIDGE_S) && !can_coast {
            None
        } else {
            self.by_motion(&frame, snapshot, predicted.as_ref())
                .or_else(|| self.by_own_motion(&frame, snapshot, predicted.as_ref()))
                .or_else(|| self.by_reference(&frame, snapshot))
        };
        let (predicted, reckoned) = match &first_guess {
            Some((pose, matches)) if self.contradicts_depth(pose, matches) => self.without_depth(&frame),
            _ => (predicted, reckoned),
        };
        let carried =
            predicted.as_ref().map(|b| b.world_from_camera).or(reckoned.map(|r| r.world_from_camera));
        let carried = carried.filter(|_| can_coast);
        let (guess, matches, recovered) = match (first_guess, carried) {
            (Some((pose, matches)), _) => (pose, matches, false),
            // The prediction is accurate enough to search for the map around it.
            (None, Some(carried)) => (carried, Matches::none(&frame), false),
            (None, None) => match self.relocalise(&frame, snapshot) {
                Ok((pose, matches)) => (pose, matches, true),
                Err(inliers) => return self.miss(frame, snapshot, inliers, predicted, idle),
            },
        };
        let (guess, matches, recovered) = match self.regain_scale(&frame, snapshot, &guess) {
            Some((pose, matches)) => (pose, matches, true),
            None => (guess, matches, recovered),
        };
        if recovered {
            self.since_recovery = 0;
            self.velocity = None;
        }
        let predicted = predicted.filter(|_| !recovered);
        self.finish(frame, snapshot, guess, matches, predicted, idle)
    }

    /// Adds the pose of a frame to the odometry.
    fn follow(
        &mut self,
        frame: &Arc<Frame>,
        snapshot: &Snapshot,
        tracked: &Tracked,
        other_motion: Option<(Se3, MotionSource)>,
    ) {
        let Some(anchored) = tracked.pose else { return self.odometry.miss() };
        let last = self.last.as_ref().filter(|last| Arc::ptr_eq(&last.frame, frame));
        let landmarks = last.map_or_else(Vec::new, |last| last.landmarks.clone());
        self.odometry.step(snapshot, frame, tracked.state, anchored, landmarks, other_motion);
    }

    /// When the last frame has become a key frame, its landmarks and pose are taken from the map.
    pub(crate) fn refresh_last(&mut self, snapshot: &Snapshot) {
        self.refresh_unit(snapshot);
        let Some(newest) = snapshot.newest_key_frame() else { return };
        match &mut self.last {
            Some(last) if newest.frame.is(&last.frame) => {
                last.landmarks.clone_from(&newest.landmarks);
                last.anchored = AnchoredPose::at(newest.id, newest.world_from_camera);
            }
            Some(last) => {
                let anchored = &mut last.anchored;
                if let Some(resolved) = snapshot.resolve(anchored.reference, &anchored.reference_from_camera)
                {
                    anchored.world_from_camera = resolved;
                }
            }
            // A map that was loaded: the camera has to be relocalised in it first.
            None => self.lost = true,
        }
    }

    /// When a loop closure or a map merge has changed the unit of length, speeds are converted to the new
    /// one.
    fn refresh_unit(&mut self, snapshot: &Snapshot) {
        let Some((id, before)) = self.unit else { return };
        let Some(now) = snapshot.world_from_here(id).map(|here| here.scale).filter(|now| *now != before)
        else {
            return;
        };
        if let Some(v) = &mut self.velocity {
            v.fixed_rows_mut::<3>(0).scale_mut(now / before);
        }
        self.pace.rescale(now / before);
        self.unit = Some((id, now));
    }

    /// The pose by the shape of the surface, else by dead reckoning from the last one that is kept.
    pub(crate) fn reckoned(&self) -> Option<Reckoned> {
        let aligned = self.dense.as_ref().and_then(|dense| dense.aligned());
        if let Some(aligned) = aligned {
            return Some(aligned.reckoned);
        }
        self.reckoning.pose(&self.last.as_ref()?.anchored.world_from_camera)
    }

    /// Inlier matches required in a frame: of the few features of a blank wall a good share is enough, where each has
    /// depth.
    pub(crate) fn need(&self, frame: &Frame) -> usize {
        let least = if self.camera.has_depth() { 10 } else { 15 };
        self.config.min_inliers.min((frame.len() / 4).max(least))
    }

    /// Inlier matches required where the place has just been found again.
    pub(crate) fn recovered_need(&self) -> usize {
        self.config.min_inliers * 3 / 2
    }

    /// Whether so little time has passed since the last pose that constant velocity still holds.
    pub(crate) fn recent(&self, frame: &Frame, seconds: f64) -> bool {
        self.located.is_none_or(|t| frame.stamp - t < seconds)
    }
}

/// The readout time that is given; `None` where it is to be estimated.
fn given_s(config: &TrackerConfig) -> Option<f64> {
    (!config.estimate_readout).then_some(config.readout_s)
}

/// Columns and rows of the image, by the bounds of its rectified pixels.
fn size_of(camera: &RectifiedCamera) -> [usize; 2] {
    [0, 1].map(|i| (camera.bounds[i + 2] - camera.bounds[i]).round().max(1.0) as usize)
}
