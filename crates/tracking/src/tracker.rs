//! The tracking stage, frame by frame: predict, match, locate, decide.

use crate::decide::{Situation, wants_key_frame};
use crate::imu::InertialFilter;
use crate::local_map::LocalMap;
use crate::match_last::{Before, Matches, match_last};
use crate::odometry::{MotionSource, Odometry, OdometryFilter};
use crate::parallax::ParallaxWatch;
use crate::reckoning::{DeadReckoning, MeasuredMotion, Reckoned};
use crate::recover::{candidates, match_key_frame};
use crate::scale::{Pace, PaceComparison, ScaleSupport};
use crate::shutter::{Moving, Shutter, in_camera};
use crate::start::Starter;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, State, Tracked};
use cairn_adjust::{Located, RecogniseConfig, locate, recognise};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Manifold, Se3, So3};
use cairn_inertial::NavEstimate;
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use cairn_settings::Settings;
use cairn_solve::PosePrior;
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::SVector;
use std::collections::{BTreeSet, VecDeque};
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
    /// True to estimate the time above from the images and the motion, beginning with the value given.
    #[setting(default = false)]
    pub estimate_readout: bool,
}

/// Frames buffered while there is no map, so that they get their poses afterwards.
const WAITING: usize = 64;

/// Inlier matches needed where the IMU constrains the pose too.
const MIN_INLIERS_WITH_IMU: usize = 15;
/// Seconds without a pose up to which matches are still searched around the pose predicted by the motion
/// model.
const BRIDGE_S: f64 = 0.6;
/// Needed to relocalise: seed matches by appearance that agree, and the share of expected landmarks that
/// agree in the end.
const RECOGNISE_SEED: usize = 12;
const RECOGNISE_SHARE: f64 = 0.4;

/// What is kept of the last frame that had a pose.
#[derive(Debug)]
pub(crate) struct Last {
    pub frame: Arc<Frame>,
    pub landmarks: Vec<Option<LandmarkId>>,
    pub anchored: AnchoredPose,
}

/// The tracking stage.
#[derive(Debug)]
pub struct Tracker {
    pub(crate) camera: RectifiedCamera,
    pub(crate) features: usize,
    pub(crate) rate_hz: f64,
    pub(crate) config: TrackerConfig,
    pub(crate) starter: Starter,
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
    /// A map whose unit of length was guessed from the walking speed.
    pub(crate) pace_comparison: Option<PaceComparison>,
    /// While rotation alone is tracked: an earlier frame with its orientation, against which it is checked.
    pub(crate) rotation_check: Option<(Arc<Frame>, So3)>,
    /// When the camera was last seen to turn on the spot.
    pub(crate) turned_until: Option<Stamp>,
    /// Poses since scale lost its support, for the frame with which a new map begins.
    pub(crate) unsupported: VecDeque<(Stamp, AnchoredPose)>,
    /// The key frame to which the last pose was anchored, and its unit of length at that time.
    unit: Option<(KeyFrameId, f64)>,
    pub(crate) lost: bool,
    /// Frames since tracking was lost.
    pub(crate) lost_frames: usize,
    /// When the last frame was located.
    pub(crate) located: Option<Stamp>,
    /// When the last map was created, or the first frame arrived.
    pub(crate) map_created: Option<Stamp>,
    pub(crate) since_key_frame: usize,
    since_recovery: usize,
    pub(crate) inertial: Option<InertialFilter>,
    /// Motion that is measured by other means than the camera and the IMU.
    pub(crate) reckoning: DeadReckoning,
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
            waiting: VecDeque::new(),
            local: LocalMap::default(),
            last: None,
            velocity: None,
            pace: Pace::default(),
            scale_support: ScaleSupport::default(),
            parallax: ParallaxWatch::default(),
            pace_comparison: None,
            rotation_check: None,
            turned_until: None,
            unsupported: VecDeque::new(),
            unit: None,
            lost: false,
            lost_frames: 0,
            located: None,
            map_created: None,
            since_key_frame: 0,
            since_recovery: usize::MAX / 2,
            inertial: None,
            reckoning: DeadReckoning::default(),
            odometry: OdometryFilter::new(camera),
            shutter: Shutter::new(config.readout_s, config.estimate_readout, rows_of(&camera)),
        }
    }

    /// Adds an IMU, whose white noise is `noise_times` that of its data sheet; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, noise_times: f64) -> Self {
        Self { inertial: Some(InertialFilter::new(sensor, imu_from_camera, noise_times)), ..self }
    }

    /// The rows of the raw image, for a rolling shutter; without them, they are taken from the bounds of the rectified one.
    pub fn with_rows(self, rows: usize) -> Self {
        let shutter = Shutter::new(self.config.readout_s, self.config.estimate_readout, rows);
        Self { shutter, ..self }
    }

    /// The readout time of the camera's rows in seconds, and its standard deviation (zero where it is given).
    pub fn readout_s(&self) -> [f64; 2] {
        self.shutter.readout_s()
    }

    /// Reports that mapping has created a map from the last request: the last frame is now key frame `id`.
    pub fn map_created(&mut self, snapshot: &Snapshot, id: KeyFrameId) {
        let Some(k) = snapshot.key_frame(id) else { return };
        let anchored = AnchoredPose::at(k.id, k.world_from_camera);
        self.last = Some(Last { frame: k.frame.clone(), landmarks: k.landmarks.clone(), anchored });
        self.lost = false;
        self.lost_frames = 0;
        self.velocity = None;
        self.start_pace(snapshot, k);
        self.located = Some(k.frame.stamp);
        self.map_created = Some(k.frame.stamp);
        self.since_key_frame = 0;
        self.reckoning.restart(true);
        if let Some(inertial) = &mut self.inertial {
            inertial.map_created(k);
        }
        self.odometry.map_created(snapshot, id);
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
        self.reckoning.advance();
        if let Some(inertial) = &mut self.inertial {
            inertial.take(imu, snapshot);
        }
        if snapshot.key_frame_count() == 0 {
            let frame = self.at_middle_row(frame, snapshot);
            return self.start(frame);
        }
        self.since_key_frame = self.since_key_frame.saturating_add(1);
        self.since_recovery = self.since_recovery.saturating_add(1);
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
        let mut tracked = self.track(frame.clone(), snapshot, idle);
        self.follow(&frame, snapshot, &tracked, other_motion);
        if self.lost && mapping {
            tracked.request =
                self.bridge(frame.clone(), snapshot).or_else(|| self.begin_new_map(frame, snapshot));
        } else if self.scale_support.is_lost() && mapping {
            tracked.request = self.begin_with_own_scale(frame, snapshot).or(tracked.request);
        } else if !self.lost {
            self.starter = Starter::default();
        }
        tracked.earlier = earlier;
        tracked
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
        self.shutter.correct(Arc::make_mut(&mut frame), &self.camera, &moving, points);
        frame
    }

    /// Learns the readout time from a pose that the camera alone gave.
    fn learn_readout(&mut self, frame: &Frame, snapshot: &Snapshot, matches: &Matches, pose: &Se3) {
        let camera_from_world = pose.inverse();
        let octaves = snapshot.octaves();
        let found = matches.landmarks.iter().enumerate().filter_map(|(i, id)| {
            let p = camera_from_world * snapshot.landmark((*id)?)?.position;
            Some((i, p, octaves.scale(frame.octave[i])))
        });
        self.shutter.learn(frame, &self.camera, found);
    }

    /// Finds the pose of a frame: by the motion model, by the reference key frame, or by relocalisation.
    fn track(&mut self, frame: Arc<Frame>, snapshot: &Snapshot, idle: bool) -> Tracked {
        let predicted = self.inertial.as_ref().and_then(|i| i.predict(frame.stamp));
        let reckoned = self.reckoned().filter(|_| predicted.is_none());
        let can_coast = predicted.as_ref().is_some_and(|b| self.may_coast(&frame, b))
            || reckoned.is_some_and(|r| r.may_coast());
        // A short gap is bridged by the motion model; after a longer one only appearance can find the pose.
        let first_guess = if self.lost && !self.recent(&frame, BRIDGE_S) && !can_coast {
            None
        } else {
            self.by_motion(&frame, snapshot, predicted.as_ref())
                .or_else(|| self.by_reference(&frame, snapshot))
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

    fn start(&mut self, frame: Arc<Frame>) -> Tracked {
        self.odometry.miss();
        let features = frame.len();
        self.wait(&frame);
        let submitted = self.starter.step(&self.camera, &frame, self.features);
        let (state, request) = match submitted.map(|request| self.with_imu_segment(request)) {
            Ok(request) => (State::Starting { have: features, need: 0 }, Some(request)),
            Err(state) => (state, None),
        };
        self.since_key_frame = 0;
        let evidence = Evidence { features, ..Evidence::default() };
        Tracked {
            stamp: frame.stamp,
            state,
            pose: None,
            evidence,
            request,
            earlier: Vec::new(),
            scale_supported: true,
            seen: Vec::new(),
        }
    }

    /// Buffers a frame that may get its pose later.
    pub(crate) fn wait(&mut self, frame: &Arc<Frame>) {
        if self.waiting.len() == WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(frame.clone());
    }

    /// Poses of the frames from before the initialisation, newest to oldest, as far as they can be tracked.
    fn track_waiting_frames(&mut self, snapshot: &Snapshot) -> Vec<(Stamp, AnchoredPose)> {
        let frames = std::mem::take(&mut self.waiting);
        let mut found = Vec::new();
        let (Some(last), false) = (&self.last, frames.is_empty()) else { return found };
        let mut before =
            Last { frame: last.frame.clone(), landmarks: last.landmarks.clone(), anchored: last.anchored };
        for frame in frames.iter().rev() {
            let known = snapshot.key_frames().find(|k| Arc::ptr_eq(&k.frame, frame));
            let (anchored, landmarks) = match known {
                Some(k) => (AnchoredPose::at(k.id, k.world_from_camera), k.landmarks.clone()),
                None => {
                    let Some((anchored, landmarks)) = self.track_next_to(&before, frame, snapshot) else {
                        break;
                    };
                    found.push((frame.stamp, anchored));
                    (anchored, landmarks)
                }
            };
            before = Last { frame: frame.clone(), landmarks, anchored };
        }
        found
    }

    /// The pose of a frame taken next to one whose pose is known.
    fn track_next_to(
        &mut self,
        before: &Last,
        frame: &Frame,
        snapshot: &Snapshot,
    ) -> Option<(AnchoredPose, Vec<Option<LandmarkId>>)> {
        let (guess, mut matches) =
            self.match_from(before, &before.anchored.world_from_camera, frame, snapshot)?;
        matches.extra.clear();
        self.local.gather(snapshot, &matches, before.anchored.reference, self.config.local_key_frames);
        self.local.search(snapshot, &self.camera, frame, &guess, 1.0, &mut matches);
        let located = self.locate(snapshot, frame, &guess, &mut matches);
        if located.inliers < self.config.min_inliers {
            return None;
        }
        let anchored = self.anchor_nearest(snapshot, before.anchored.reference, located.world_from_camera)?;
        Some((anchored, matches.landmarks))
    }

    /// A pose anchored to the nearest of the key frames that the local map was collected around.
    fn anchor_nearest(
        &self,
        snapshot: &Snapshot,
        fallback: KeyFrameId,
        world_from_camera: Se3,
    ) -> Option<AnchoredPose> {
        anchored_at(
            snapshot,
            self.local.nearest(snapshot, &world_from_camera.translation).unwrap_or(fallback),
            world_from_camera,
        )
    }

    /// When the last frame has become a key frame, its landmarks and pose are taken from the map.
    pub(crate) fn refresh_last(&mut self, snapshot: &Snapshot) {
        self.refresh_unit(snapshot);
        let Some(newest) = snapshot.newest_key_frame() else { return };
        match &mut self.last {
            Some(last) if Arc::ptr_eq(&last.frame, &newest.frame) => {
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

    fn locate(&self, snapshot: &Snapshot, frame: &Frame, guess: &Se3, matches: &mut Matches) -> Located {
        self.locate_from(snapshot, frame, guess, None, matches)
    }

    fn locate_from(
        &self,
        snapshot: &Snapshot,
        frame: &Frame,
        guess: &Se3,
        prior: Option<&PosePrior>,
        matches: &mut Matches,
    ) -> Located {
        let located = locate(snapshot, &self.camera, frame, guess, &matches.landmarks, &matches.extra, prior);
        let located = self.gated(snapshot, frame, guess, prior, matches, located);
        matches.drop_outliers(&located.outliers);
        located
    }

    /// Predicts by the IMU, else by a measured motion, else by constant velocity, else by the last pose, and matches around
    /// that.
    pub(crate) fn by_motion(
        &self,
        frame: &Frame,
        snapshot: &Snapshot,
        predicted: Option<&NavEstimate>,
    ) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let elapsed = frame.stamp - last.frame.stamp;
        let moved = self.velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * elapsed)));
        let reckoned = self.reckoned().map(|r| r.world_from_camera);
        let guess = predicted.map(|b| b.world_from_camera).or(reckoned);
        let guess = guess.unwrap_or(last.anchored.world_from_camera * moved);
        self.match_from(last, &guess, frame, snapshot)
    }

    /// Matches with the previous frame around a guess, and farther out where the guess was poor.
    fn match_from(
        &self,
        last: &Last,
        guess: &Se3,
        frame: &Frame,
        snapshot: &Snapshot,
    ) -> Option<(Se3, Matches)> {
        let mut guess = *guess;
        let radius = if self.camera.has_depth() { 7.0 } else { 15.0 };
        let known = last.landmarks.iter().flatten().count();
        let before = Before {
            frame: &last.frame,
            landmarks: &last.landmarks,
            world_from_camera: last.anchored.world_from_camera,
        };
        let few = self.need(frame).min(15);
        let mut best: Option<(usize, Se3, Matches)> = None;
        // A good prediction finds most of what was seen; else search farther, then closely around the
        // resulting pose.
        for radius in [radius, 2.0 * radius, 4.0 * radius, radius] {
            let mut matches = match_last(snapshot, &self.camera, &before, frame, &guess, radius);
            if matches.count() < few {
                continue;
            }
            let located = self.locate(snapshot, frame, &guess, &mut matches);
            if located.inliers >= few.min(12) && best.as_ref().is_none_or(|(n, ..)| located.inliers > *n) {
                guess = located.world_from_camera;
                best = Some((located.inliers, located.world_from_camera, matches));
            }
            if located.inliers * 2 >= known.max(24) {
                break;
            }
        }
        best.map(|(_, pose, matches)| (pose, matches))
    }

    /// Matches by the descriptors of the reference key frame, near the last pose.
    pub(crate) fn by_reference(&self, frame: &Frame, snapshot: &Snapshot) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let (reference, _) = snapshot.surviving_ancestor(last.anchored.reference)?;
        let mut matches = match_key_frame(snapshot.key_frame(reference)?, frame, 0.7);
        if matches.count() < 15 {
            return None;
        }
        let located = self.locate(snapshot, frame, &last.anchored.world_from_camera, &mut matches);
        (located.inliers >= 12).then_some((located.world_from_camera, matches))
    }

    /// Relocalises among earlier key frames; the best inlier count when no place is recognised.
    fn relocalise(&mut self, frame: &Frame, snapshot: &Snapshot) -> Result<(Se3, Matches), usize> {
        let last = self.last.as_ref().map(|l| l.anchored.world_from_camera.translation);
        let config =
            RecogniseConfig { seed: RECOGNISE_SEED, need: self.config.min_inliers, share: RECOGNISE_SHARE };
        let mut best = 0;
        for id in candidates(snapshot, frame, last, self.lost_frames) {
            match recognise(
                snapshot,
                &self.camera,
                frame,
                id,
                &BTreeSet::new(),
                &config,
                frame.stamp.0 as u64,
            ) {
                Ok(place) if !self.reaches(snapshot, id, &place.world_from_camera, frame.stamp) => {}
                Ok(place) => {
                    let matches = Matches { landmarks: place.landmarks, extra: Vec::new() };
                    return Ok((place.world_from_camera, matches));
                }
                Err(why) => best = best.max(why.agreed()),
            }
        }
        Err(best)
    }

    /// Matches with the local map, optimises the pose and decides whether the frame becomes a key frame.
    fn finish(
        &mut self,
        frame: Arc<Frame>,
        snapshot: &Snapshot,
        guess: Se3,
        mut matches: Matches,
        predicted: Option<NavEstimate>,
        idle: bool,
    ) -> Tracked {
        let Some(newest) = snapshot.newest_key_frame().map(|k| k.id) else { return self.lose(frame, 0) };
        let prior = predicted.as_ref().and_then(|b| {
            Some(PosePrior { world_from_camera: b.world_from_camera, information: b.pose_information()? })
        });
        let reckoned = self.reckoned().filter(|r| prior.is_none() && r.may_coast());
        let prior = prior.or(reckoned.map(|r| r.prior()));
        let prior = prior.or_else(|| self.parallax.position_prior(snapshot, &guess));
        let fallback = self
            .last
            .as_ref()
            .and_then(|l| snapshot.surviving_ancestor(l.anchored.reference))
            .map_or(newest, |(id, _)| id);
        matches.extra.clear();
        self.local.gather(snapshot, &matches, fallback, self.config.local_key_frames);
        let factor = match self.since_recovery {
            0..=2 => 5.0,
            _ if matches.count() == 0 => 5.0,
            _ => 1.0,
        };
        let mut expected = self.local.search(snapshot, &self.camera, &frame, &guess, factor, &mut matches);
        let mut matched = matches.count();
        let mut located = self.locate_from(snapshot, &frame, &guess, prior.as_ref(), &mut matches);
        // Few of the expected landmarks were found: the guess was poor. Search again from the better pose.
        if located.inliers * 3 < expected.len() {
            expected = self.local.search(
                snapshot,
                &self.camera,
                &frame,
                &located.world_from_camera,
                1.0,
                &mut matches,
            );
            matched = matches.count();
            located =
                self.locate_from(snapshot, &frame, &located.world_from_camera, prior.as_ref(), &mut matches);
        }
        let need = match (&prior, self.since_recovery < 30) {
            // The prior constrains the pose too: from the IMU, or that the camera turns on the spot.
            (Some(_), _) => self.need(&frame).min(MIN_INLIERS_WITH_IMU),
            (None, true) => self.config.min_inliers * 3 / 2,
            (None, false) => self.need(&frame),
        };
        if located.inliers < need {
            return self.miss(frame, snapshot, located.inliers, predicted, idle);
        }
        let world_from_camera = located.world_from_camera;
        self.learn_readout(&frame, snapshot, &matches, &world_from_camera);
        if reckoned.is_some_and(|r| !r.agrees(&world_from_camera)) {
            return self.miss(frame, snapshot, located.inliers, predicted, idle);
        }
        let Some(anchored) = self.anchor_nearest(snapshot, fallback, world_from_camera) else {
            return self.lose(frame, located.inliers);
        };
        if self.inertial.as_mut().is_some_and(|i| i.wants_rotations(frame.stamp)) {
            // The IMU prior is part of the pose; the time offset must be estimated from vision alone.
            let alone = prior.as_ref().and_then(|p| without_prior(&located, p)).unwrap_or(world_from_camera);
            if let Some(inertial) = &mut self.inertial {
                inertial.add_rotation(frame.stamp, alone.rotation);
            }
        }
        if let Some(inertial) = &mut self.inertial {
            inertial.update(snapshot, frame.stamp, &anchored, predicted.as_ref(), &located.information);
        }
        let reference = self.local.reference.unwrap_or(fallback);
        self.velocity = match &self.last {
            Some(last) if self.recent(&frame, BRIDGE_S) && frame.stamp > last.frame.stamp => Some(
                last.anchored.world_from_camera.local(&world_from_camera) / (frame.stamp - last.frame.stamp),
            ),
            _ => None,
        };
        if let Some(v) = self.velocity.filter(|_| !self.scale_support.is_lost()) {
            self.pace.push(v.fixed_rows::<3>(0).norm());
        }
        self.unit = snapshot.world_from_here(anchored.reference).map(|here| (anchored.reference, here.scale));
        self.watch_scale(&frame, snapshot, &matches, anchored);
        self.lost = false;
        self.lost_frames = 0;
        self.located = Some(frame.stamp);
        let situation = Situation {
            snapshot,
            camera: &self.camera,
            frame: &frame,
            matches: &matches,
            inliers: located.inliers,
            need,
            reference,
            rotated_rad: anchored.reference_from_camera.rotation.angle(),
            since: self.since_key_frame,
            stationary: self.inertial.as_ref().is_some_and(|i| i.is_stationary(frame.stamp)),
            since_s: self.inertial.as_ref().and_then(|i| i.seconds_since_request(frame.stamp)),
            idle,
        };
        let request = wants_key_frame(&situation, self.rate_hz, self.config.min_key_frame_gap).then(|| {
            self.since_key_frame = 0;
            let anchored = anchored_at(snapshot, reference, world_from_camera).unwrap_or(anchored);
            let imu = self.inertial.as_mut().map(|i| i.take_segment(frame.stamp));
            KeyFrameRequest::Next {
                frame: frame.clone(),
                landmarks: matches.landmarks.clone(),
                anchored,
                imu,
                orientation_only: self.scale_support.is_lost() || self.parallax.is_turning(),
                rescale: self.due_rescale(snapshot, reference),
            }
        });
        let found: std::collections::BTreeSet<LandmarkId> =
            matches.landmarks.iter().flatten().copied().collect();
        let evidence =
            Evidence { features: frame.len(), expected: expected.len(), matched, inliers: located.inliers };
        let stamp = frame.stamp;
        self.last = Some(Last { frame, landmarks: matches.landmarks, anchored });
        self.reckoning.restart(true);
        let seen = expected.into_iter().map(|id| (id, found.contains(&id))).collect();
        Tracked {
            stamp,
            state: State::Tracking,
            pose: Some(anchored),
            evidence,
            request,
            earlier: Vec::new(),
            scale_supported: self.is_scale_supported(),
            seen,
        }
    }

    /// The pose by dead reckoning from the last one that is kept.
    pub(crate) fn reckoned(&self) -> Option<Reckoned> {
        self.reckoning.pose(&self.last.as_ref()?.anchored.world_from_camera)
    }

    /// Inlier matches required in a frame: of the few features of a blank wall a good share is enough, where each has
    /// depth.
    pub(crate) fn need(&self, frame: &Frame) -> usize {
        let least = if self.camera.has_depth() { 10 } else { 15 };
        self.config.min_inliers.min((frame.len() / 4).max(least))
    }

    /// Whether so little time has passed since the last pose that constant velocity still holds.
    pub(crate) fn recent(&self, frame: &Frame, seconds: f64) -> bool {
        self.located.is_none_or(|t| frame.stamp - t < seconds)
    }
}

/// Rows of the image, by the bounds of its rectified pixels.
fn rows_of(camera: &RectifiedCamera) -> usize {
    (camera.bounds[3] - camera.bounds[1]).round().max(1.0) as usize
}

/// The pose without the prior: at the solution the gradients of the prior and of the observations cancel.
fn without_prior(located: &Located, prior: &PosePrior) -> Option<Se3> {
    let gradient = prior.information * prior.world_from_camera.local(&located.world_from_camera);
    let own = (located.information - prior.information).cholesky()?;
    Some(located.world_from_camera.retract(&own.solve(&gradient)))
}

/// A pose anchored to a key frame.
pub(crate) fn anchored_at(
    snapshot: &Snapshot,
    reference: KeyFrameId,
    world_from_camera: Se3,
) -> Option<AnchoredPose> {
    let reference_from_camera = snapshot.anchor(reference, &world_from_camera)?;
    Some(AnchoredPose { reference, reference_from_camera, world_from_camera })
}
