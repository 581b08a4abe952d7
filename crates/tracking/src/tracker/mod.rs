//! The tracking stage, frame by frame: predict, match, locate, check, decide.

mod begin;
mod find;
mod finish;
mod found;
mod locator;
mod lost;
mod regain_scale;
mod scale;
mod static_landmarks;
#[cfg(test)]
mod tests;
mod turning;
mod waiting;

use crate::clock::FrameClock;
use crate::config::TrackerConfig;
use crate::dense::DenseAligner;
use crate::hint::{HintOutcome, Hinted, PlaceHint};
use crate::imu::InertialFilter;
use crate::mode::Mode;
use crate::odometry::{Odometry, OdometryFilter};
use crate::on_the_spot::SpotWatch;
use crate::priors::{InertialPrior, MeasuredMotion, MotionPriors};
use crate::setup::Setup;
use crate::shutter::{Shutter, in_camera};
use crate::state::{AnchoredPose, Last, Tracked};
use cairn_atlas::{KeyFrameId, Readout, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_inertial::Failed;
use cairn_sensor::{DepthImage, DepthSensor, GrayImage, ImuSample, ImuSensor, Stamp};
use cairn_vision::{Frame, RectifiedCamera};
pub use found::{DepthPlaced, FoundByDepth};
pub(crate) use locator::Candidate;
use locator::Locator;
use scale::UnitOfLength;
use std::sync::Arc;
use waiting::MapStart;

/// Seconds without a pose up to which matches are still searched around the pose predicted by the motion
/// model.
const BRIDGE_S: f64 = 0.6;
/// Longest blank view, in seconds, across which the motion model guesses where a new map begins.
const BLANK_S: f64 = 1.0;

/// The tracking stage.
#[derive(Debug)]
pub struct Tracker {
    pub(crate) setup: Setup,
    pub(crate) clock: FrameClock,
    mode: Mode,
    /// The last frame that had a pose.
    pub(crate) last: Option<Last>,
    pub(crate) priors: MotionPriors,
    locator: Locator,
    /// The unit of length, where neither depth nor an IMU gives it.
    pub(crate) unit: UnitOfLength,
    /// Whether the camera turns on the spot while the motion sensors carry the pose.
    spot: SpotWatch,
    /// The frames from which a map may begin.
    start: MapStart,
    /// Where a search by depth has found the camera, for the next frame.
    found: Option<FoundByDepth>,
    /// Where the camera is said to be.
    hinted: Hinted,
    odometry: OdometryFilter,
    shutter: Shutter,
}

/// The frame that is tracked, the map, and whether mapping would process a key frame at once.
#[derive(Clone, Copy)]
pub(crate) struct Now<'a> {
    pub frame: &'a Arc<Frame>,
    pub snapshot: &'a Snapshot,
    pub idle: bool,
}

/// Features have not given the pose of a frame: so many matches agreed. `is_final` where nothing else can give it either.
pub(crate) struct Miss {
    inliers: usize,
    is_final: bool,
}

impl Tracker {
    /// A tracker without a map. `features` is the feature budget of the front end (initialisation thresholds
    /// are relative to it), `rate_hz` the nominal frame rate.
    pub fn new(camera: RectifiedCamera, features: usize, rate_hz: f64, config: TrackerConfig) -> Self {
        let setup = Setup { camera, features, rate_hz, config };
        Self {
            setup,
            clock: FrameClock::new(rate_hz),
            mode: Mode::Starting,
            last: None,
            priors: MotionPriors::default(),
            locator: Locator::new(setup),
            unit: UnitOfLength::new(setup),
            spot: SpotWatch::default(),
            start: MapStart::new(setup),
            found: None,
            hinted: Hinted::default(),
            odometry: OdometryFilter::new(camera),
            shutter: Shutter::new(setup.given_readout_s(), setup.image_size()),
        }
    }

    /// Adds an IMU; `imu_from_camera` in metres.
    pub fn with_imu(mut self, sensor: &ImuSensor, imu_from_camera: Se3) -> Self {
        let config = &self.setup.config;
        let mut filter = InertialFilter::new(sensor, imu_from_camera);
        filter.standing_m_s = config.motion.standing_m_s;
        self.priors.inertial = Some(InertialPrior::new(filter, (config.coast_sigma, config.coast_s)));
        self
    }

    /// Adds the depth sensor, mounted at `camera_from_depth`: where features do not suffice, its images carry the pose.
    pub fn with_depth(mut self, sensor: &DepthSensor, camera_from_depth: Se3) -> Self {
        let config = &self.setup.config;
        self.priors.depth = DenseAligner::new(sensor, camera_from_depth, config.coast_sigma, config.dense);
        self
    }

    /// Columns and rows of the raw image, for a rolling shutter; without them, they are taken from the bounds of the rectified
    /// one.
    pub fn with_size(self, size: [usize; 2]) -> Self {
        let shutter = Shutter::new(self.setup.given_readout_s(), size);
        Self { shutter, ..self }
    }

    /// The readout time of the camera's rows (its standard deviation is zero where it is given).
    pub fn readout(&self, snapshot: &Snapshot) -> Readout {
        self.shutter.readout(snapshot)
    }

    /// What is wrong with the readings of the IMU, and since when; `None` while they are believed. With how many were left out one by
    /// one.
    pub fn imu_fault(&self) -> (Option<Failed>, usize) {
        self.priors.inertial.as_ref().map_or((None, 0), |i| (i.filter.fault(), i.filter.refused()))
    }

    /// The odometry of the last frame; `None` when that has no pose.
    pub fn odometry(&self) -> Option<Odometry> {
        self.odometry.current()
    }

    /// The direction against gravity in the camera, where the IMU and a map that is aligned with gravity tell it.
    pub fn up(&self, stamp: Stamp) -> Option<Vec3> {
        self.priors.inertial.as_ref()?.up(stamp)
    }

    /// Reports that mapping has created a map from the last request: the last frame is now key frame `id`.
    pub fn map_created(&mut self, snapshot: &Snapshot, id: KeyFrameId) {
        let Some(k) = snapshot.key_frame(id) else { return };
        let anchored = AnchoredPose::at(k.id, k.world_from_camera);
        self.last = Some(Last { frame: k.frame.shared(), landmarks: k.landmarks.clone(), anchored });
        self.mode = Mode::Tracking;
        self.clock.begin_map(k.stamp);
        self.unit.map_created(snapshot, k);
        self.odometry.map_created(snapshot, id);
        self.priors.map_created(snapshot, k, anchored);
    }

    /// The camera was at the newest key frame a moment ago, when another tracker followed it: it is looked for there first. Nothing
    /// where that was too long before `now` to tell where it is.
    pub fn resume(&mut self, snapshot: &Snapshot, now: Stamp) {
        let newest = snapshot.newest_key_frame().filter(|k| (0.0..BRIDGE_S).contains(&(now - k.stamp)));
        let Some(k) = newest else { return };
        let anchored = AnchoredPose::at(k.id, k.world_from_camera);
        self.last = Some(Last { frame: k.frame.shared(), landmarks: k.landmarks.clone(), anchored });
        self.mode.unplace();
        self.clock.located = Some(k.stamp);
    }

    /// What other sensors measured of the motion up to the frame that is tracked next; to be told before each
    /// [`Tracker::step`]. It counts for cameras with depth, whose unit of length is the metre; together with an IMU it
    /// carries the pose where the IMU does not.
    pub fn motion_measured(&mut self, motion: Option<&MeasuredMotion>) {
        let camera = &self.setup.camera;
        let camera_from_body = camera.world_from_body(&Se3::identity(), true);
        self.priors.measured.measured(motion.filter(|_| camera.has_depth()), &camera_from_body);
    }

    /// The depth image of the frame that is tracked next, and the gray image where it shows the same pixels; to be told before each
    /// [`Tracker::step`].
    pub fn depth_seen(&mut self, image: Option<Arc<DepthImage>>, gray: Option<Arc<GrayImage>>) {
        if let Some(depth) = &mut self.priors.depth {
            depth.next(image, gray);
        }
    }

    /// From the next frame on the pose is that of the depth, as with [`TrackerConfig::dense`].
    pub fn take_poses_from_depth(&mut self) {
        self.priors.depth.iter_mut().for_each(DenseAligner::become_front_end);
    }

    /// Where the camera is said to be, in place of an earlier hint: looked for there from the next frame on, until an image confirms it
    /// or some seconds have passed. Until then no other place is recognised.
    pub fn hint(&mut self, hint: PlaceHint) {
        self.hinted.give(hint);
    }

    /// What has become of the last hint; `None` where there was none.
    pub fn hint_outcome(&self) -> Option<HintOutcome> {
        self.hinted.outcome()
    }

    /// A search by depth has found where the camera is; to be told before [`Tracker::step`]. Used if tracking is lost.
    pub fn found_by_depth(&mut self, found: FoundByDepth) {
        self.found = Some(found);
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
        let periods = self.clock.step(frame.stamp);
        let flow = self.start.flow.filter(|_| snapshot.key_frame_count() == 0);
        self.priors.take(imu, flow.map_or(snapshot.imu_offset(), |flow| flow.offset_s[0]));
        if snapshot.key_frame_count() == 0 {
            let frame = self.at_middle_row(frame, snapshot);
            return self.begin_first_map(frame, snapshot);
        }
        self.clock.advance(periods);
        self.refresh(snapshot);
        let earlier = self.start.track_back(&mut self.locator, self.last.as_ref(), snapshot);
        let frame = self.at_middle_row(frame, snapshot);
        let now = Now { frame: &frame, snapshot, idle };
        self.priors.measure(self.odometry.last_stamp(), frame.stamp);
        let before = self.begin_where_found(&now);
        let mut tracked = self.track(&now);
        if let Some(before) = before {
            self.keep_or_put_back(before, &now, &mut tracked);
        }
        self.follow(&now, &tracked);
        self.decide(&now, mapping, &mut tracked);
        tracked.earlier = earlier;
        self.priors.restart_at_request(snapshot, &mut tracked, self.start.flow.is_some());
        tracked
    }

    /// Finds the pose of a frame.
    fn track(&mut self, now: &Now) -> Tracked {
        self.priors.begin(now.snapshot, self.last.as_ref(), now.frame.stamp);
        let found = self.match_features(now);
        let found = found.and_then(|matches| self.locate(now, matches));
        let found = found.and_then(|candidate| self.check(now, candidate));
        match found.or_else(|miss| self.find_without_readings(now, miss)) {
            Ok(located) => self.accept(now, located),
            Err(miss) => self.miss(now, miss),
        }
    }

    /// Adds the pose of a frame to the odometry, and remembers its depth.
    fn follow(&mut self, now: &Now, tracked: &Tracked) {
        match tracked.pose {
            Some(anchored) => {
                let last = self.last.as_ref().filter(|last| Arc::ptr_eq(&last.frame, now.frame));
                let landmarks = last.map_or_else(Vec::new, |last| last.landmarks.clone());
                let (state, motion) = (tracked.state, self.priors.relative());
                self.odometry.step(now.snapshot, now.frame, state, anchored, landmarks, motion);
            }
            None => self.odometry.miss(),
        }
        let (is_elsewhere, enough) = (self.clock.since_recovery == 0, self.setup.config.min_inliers);
        self.priors.remember_depth(now.snapshot, tracked, is_elsewhere, enough);
    }

    /// Decides whether a map begins with the frame: where tracking or the unit of length is lost.
    fn decide(&mut self, now: &Now, mapping: bool, tracked: &mut Tracked) {
        match (self.mode.is_lost(), mapping) {
            (true, true) => tracked.request = self.begin_new_map(now),
            (true, false) => {}
            (false, true) if self.unit.is_lost() => {
                tracked.request = self.begin_with_own_scale(now).or(tracked.request.take());
            }
            (false, _) => self.start.abandon(),
        }
    }

    /// Follows the changes of the map. When the last frame has become a key frame, its landmarks and pose are taken from there.
    pub(crate) fn refresh(&mut self, snapshot: &Snapshot) {
        let rescaled = self.unit.refresh(snapshot);
        self.priors.refresh(snapshot, rescaled);
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
            None => self.mode.unplace(),
        }
    }

    /// The frame as it would be if all rows were exposed with the middle one.
    fn at_middle_row(&mut self, mut frame: Arc<Frame>, snapshot: &Snapshot) -> Arc<Frame> {
        if self.shutter.is_global() {
            return frame;
        }
        let is_recent = !self.mode.is_lost() && self.clock.is_recent(frame.stamp, BRIDGE_S);
        let (predicted, moving) = self.priors.moving(frame.stamp, is_recent);
        let last = self.last.as_ref().filter(|_| is_recent);
        let pose = predicted.or(last.map(|l| l.anchored.world_from_camera));
        let seen = last.into_iter().flat_map(|l| l.landmarks.iter().flatten());
        let points = seen.filter_map(|id| snapshot.landmark(*id)).map(|l| l.position);
        let points = in_camera(&pose.unwrap_or_default(), points);
        // What no map knows yet.
        let flow = self.start.flow.filter(|_| snapshot.key_frame_count() == 0);
        let readout_s = flow.map_or(self.shutter.readout(snapshot).seconds, |flow| flow.readout_s[0]);
        self.shutter.correct(Arc::make_mut(&mut frame), &self.setup.camera, readout_s, &moving, points);
        frame
    }
}
