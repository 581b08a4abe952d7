//! One frame after another: predict, match, locate, judge.

use crate::decide::{Situation, wants_key_frame};
use crate::imu::InertialFilter;
use crate::local_map::LocalMap;
use crate::match_last::{Before, Matches, match_last};
use crate::recover::{candidates, match_key_frame};
use crate::scale::{Pace, PaceComparison, ScaleSupport};
use crate::start::Starter;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, State, Tracked};
use cairn_adjust::{Located, RecogniseConfig, locate, recognise};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Manifold, Se3};
use cairn_inertial::NavEstimate;
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use cairn_solve::PosePrior;
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::SVector;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

/// How to track.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerConfig {
    /// Matches that must agree for a pose to count.
    pub min_inliers: usize,
    /// Key frames in the local map, at most.
    pub local_key_frames: usize,
    /// Frames between two key frames, at least.
    pub min_key_frame_gap: usize,
    /// Seconds without a pose after which a new world begins, if the place is still not recognised.
    pub new_map_s: f64,
    /// Standard deviation of the place in metres up to which the inertial sensor may carry a pose that is not seen.
    pub coast_sigma: f64,
    /// Seconds for which it may do so at most.
    pub coast_s: f64,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            min_inliers: 25,
            local_key_frames: 40,
            min_key_frame_gap: 1,
            new_map_s: 0.5,
            coast_sigma: 1.0,
            coast_s: 6.0,
        }
    }
}

/// Frames kept while there is no map, so that they get their pose afterwards.
const WAITING: usize = 64;

/// Matches that must agree where the inertial sensor tells the pose too.
const NEED_FELT: usize = 15;
/// Seconds without a pose after which matches are still sought where the motion before leads.
const BRIDGE_S: f64 = 0.6;
/// What it takes to recognise a place when lost: matches by appearance that agree, and the share of all in the end.
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
    /// Frames seen before there was a map, oldest first.
    pub(crate) waiting: VecDeque<Arc<Frame>>,
    local: LocalMap,
    pub(crate) last: Option<Last>,
    /// Velocity in the eye frame (metres or units a second, radians a second), when the last two frames had a pose.
    pub(crate) velocity: Option<SVector<f64, 6>>,
    /// How fast the walker goes, units a second.
    pub(crate) pace: Pace,
    /// What scale rests on, where neither depth nor an inertial sensor gives it.
    pub(crate) scale_support: ScaleSupport,
    /// A map whose unit of length was guessed.
    pub(crate) pace_comparison: Option<PaceComparison>,
    /// Poses since scale lost its support, for the frame with which a new map begins.
    pub(crate) unsupported: VecDeque<(Stamp, AnchoredPose)>,
    /// The key frame that the last pose anchored_at on and its unit of length then.
    unit: Option<(KeyFrameId, f64)>,
    pub(crate) lost: bool,
    /// Frames since tracking was lost.
    pub(crate) lost_frames: usize,
    /// When the last frame was located.
    pub(crate) located: Option<Stamp>,
    /// When a world was last begun, or the first frame came.
    pub(crate) map_created: Option<Stamp>,
    pub(crate) since_key_frame: usize,
    since_recovery: usize,
    pub(crate) inertial: Option<InertialFilter>,
}

impl Tracker {
    /// A tracker without a map. `features` is what the eye gives at most (thresholds of the start are relative to
    /// it), `rate_hz` the nominal rate of frames.
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
            pace_comparison: None,
            unsupported: VecDeque::new(),
            unit: None,
            lost: false,
            lost_frames: 0,
            located: None,
            map_created: None,
            since_key_frame: 0,
            since_recovery: usize::MAX / 2,
            inertial: None,
        }
    }

    /// The same with an inertial sensor, whose white noise is `noise_times` its data sheet's; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, noise_times: f64) -> Self {
        Self { inertial: Some(InertialFilter::new(sensor, imu_from_camera, noise_times)), ..self }
    }

    /// Tells that mapping has begun a world with what was last offered: the last frame stands at key frame `id`.
    pub fn map_created(&mut self, snapshot: &Snapshot, id: KeyFrameId) {
        let Some(k) = snapshot.key_frame(id) else { return };
        let anchored = AnchoredPose::at(k.id, k.world_from_camera);
        self.last = Some(Last { frame: k.frame.clone(), landmarks: k.landmarks.clone(), anchored });
        self.lost = false;
        self.lost_frames = 0;
        self.velocity = None;
        self.scale_support = ScaleSupport::default();
        self.unsupported.clear();
        let guessed = !self.camera.has_depth() && !snapshot.is_gravity_aligned(k.map);
        let prior = snapshot.maps().find(|(id, _)| *id == k.map).is_some_and(|(_, prior)| prior.is_some());
        self.pace_comparison = (self.pace.walking().filter(|_| guessed && prior))
            .map(|(pace, _)| PaceComparison { map: k.map, pace, done: 0 });
        self.pace = Pace::default();
        self.located = Some(k.frame.stamp);
        self.map_created = Some(k.frame.stamp);
        self.since_key_frame = 0;
        if let Some(inertial) = &mut self.inertial {
            inertial.map_created(k);
        }
    }

    /// Takes one frame, and the readings of the inertial sensor up to it. `idle` tells whether mapping would take up a key frame at once, `mapping` whether ever. Once
    /// tracking is lost and the place is not recognised, the frame may be offered as the begin of a new world.
    pub fn step(
        &mut self,
        frame: Arc<Frame>,
        imu: &[ImuSample],
        snapshot: &Snapshot,
        idle: bool,
        mapping: bool,
    ) -> Tracked {
        self.map_created.get_or_insert(frame.stamp);
        if let Some(inertial) = &mut self.inertial {
            inertial.take(imu, snapshot);
        }
        if snapshot.key_frame_count() == 0 {
            return self.start(frame);
        }
        self.since_key_frame = self.since_key_frame.saturating_add(1);
        self.since_recovery = self.since_recovery.saturating_add(1);
        self.refresh_last(snapshot);
        if let Some(inertial) = &mut self.inertial {
            inertial.refresh(snapshot);
        }
        let earlier = self.look_back(snapshot);
        let mut tracked = self.follow(frame.clone(), snapshot, idle);
        if self.lost && mapping {
            tracked.request =
                self.bridge(frame.clone(), snapshot).or_else(|| self.begin_anew(frame, snapshot));
        } else if self.scale_support.is_lost() && mapping {
            tracked.request = self.begin_with_own_scale(frame, snapshot).or(tracked.request);
        } else if !self.lost {
            self.starter = Starter::default();
        }
        tracked.earlier = earlier;
        tracked
    }

    /// Finds where a frame is: by motion, by the reference, or by appearance.
    fn follow(&mut self, frame: Arc<Frame>, snapshot: &Snapshot, idle: bool) -> Tracked {
        let predicted = self.inertial.as_ref().and_then(|i| i.predict(frame.stamp));
        let coasts = predicted.as_ref().is_some_and(|b| self.may_coast(&frame, b));
        // A short gap is bridged by going on as before; after a longer one only appearance tells.
        let first_guess = if self.lost && !self.recent(&frame, BRIDGE_S) && !coasts {
            None
        } else {
            self.by_motion(&frame, snapshot, predicted.as_ref())
                .or_else(|| self.by_reference(&frame, snapshot))
        };
        let carried = predicted.clone().filter(|_| coasts);
        let (guess, matches, recovered) = match (first_guess, carried) {
            (Some((pose, matches)), _) => (pose, matches, false),
            // What is felt is good enough to look for the map where it must be.
            (None, Some(belief)) => (belief.world_from_camera, Matches::none(&frame), false),
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

    fn start(&mut self, frame: Arc<Frame>) -> Tracked {
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

    /// Keeps a frame that may get its pose later.
    pub(crate) fn wait(&mut self, frame: &Arc<Frame>) {
        if self.waiting.len() == WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(frame.clone());
    }

    /// Poses of the frames before the start, from the youngest back, as far as they can be tracked.
    fn look_back(&mut self, snapshot: &Snapshot) -> Vec<(Stamp, AnchoredPose)> {
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
                    let Some((anchored, landmarks)) = self.place_after(&before, frame, snapshot) else {
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

    /// Where a frame stands that was taken next to one whose place is known.
    fn place_after(
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
        let anchored = self.place(snapshot, before.anchored.reference, located.world_from_camera)?;
        Some((anchored, matches.landmarks))
    }

    /// A pose as it hangs on the nearest key frame of those that the local map was gathered around.
    fn place(
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

    /// When the last frame has become a key frame, what it shows and where it stands is told by the map.
    fn refresh_last(&mut self, snapshot: &Snapshot) {
        self.refresh_unit(snapshot);
        let Some(newest) = snapshot.newest_key_frame() else { return };
        match &mut self.last {
            Some(last) if Arc::ptr_eq(&last.frame, &newest.frame) => {
                last.landmarks.clone_from(&newest.landmarks);
                last.anchored = AnchoredPose::at(newest.id, newest.world_from_camera);
            }
            Some(last) => {
                let anchored = &mut last.anchored;
                if let Some(standing) = snapshot.resolve(anchored.reference, &anchored.reference_from_camera)
                {
                    anchored.world_from_camera = standing;
                }
            }
            // A map that was loaded: where in it the eye is, appearance has to tell.
            None => self.lost = true,
        }
    }

    /// When a loop or a merge has changed the unit of length, speeds are told in the new one.
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

    /// By what was felt, by the motion of the last two frames, or by standing still when that is not known.
    fn by_motion(
        &self,
        frame: &Frame,
        snapshot: &Snapshot,
        predicted: Option<&NavEstimate>,
    ) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let elapsed = frame.stamp - last.frame.stamp;
        let moved = self.velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * elapsed)));
        let guess = predicted.map_or(last.anchored.world_from_camera * moved, |b| b.world_from_camera);
        self.match_from(last, &guess, frame, snapshot)
    }

    /// Matches with the frame before around a guess, and farther out where the guess was poor.
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
        // A good prediction finds most of what was seen; else look farther, then closely from where that leads.
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

    /// By descriptors of the reference key frame, near the last pose.
    fn by_reference(&self, frame: &Frame, snapshot: &Snapshot) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let (reference, _) = snapshot.surviving_ancestor(last.anchored.reference)?;
        let mut matches = match_key_frame(snapshot.key_frame(reference)?, frame, 0.7);
        if matches.count() < 15 {
            return None;
        }
        let located = self.locate(snapshot, frame, &last.anchored.world_from_camera, &mut matches);
        (located.inliers >= 12).then_some((located.world_from_camera, matches))
    }

    /// Looks for the place among earlier key frames; the best count of agreeing landmarks when none is recognised.
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

    /// Matches with the local map, settles the pose and decides what the frame is good for.
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
        // Few of those expected were found: the guess was poor. DescriptorQuery again from the better pose.
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
            // What is felt speaks for the pose too.
            (Some(_), _) => self.need(&frame).min(NEED_FELT),
            (None, true) => self.config.min_inliers * 3 / 2,
            (None, false) => self.need(&frame),
        };
        if located.inliers < need {
            return self.miss(frame, snapshot, located.inliers, predicted, idle);
        }
        let world_from_camera = located.world_from_camera;
        let Some(anchored) = self.place(snapshot, fallback, world_from_camera) else {
            return self.lose(frame, located.inliers);
        };
        if self.inertial.as_mut().is_some_and(|i| i.wants_turns(frame.stamp)) {
            // What was felt has its part in the pose; the clocks are compared with what was seen alone.
            let alone = prior.as_ref().and_then(|p| seen_alone(&located, p)).unwrap_or(world_from_camera);
            if let Some(inertial) = &mut self.inertial {
                inertial.turned(frame.stamp, alone.rotation);
            }
        }
        if let Some(inertial) = &mut self.inertial {
            inertial.seen(snapshot, frame.stamp, &anchored, predicted.as_ref(), &located.information);
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
        self.watch_scale(frame.stamp, snapshot, &matches, anchored);
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
            turned_rad: anchored.reference_from_camera.rotation.angle(),
            since: self.since_key_frame,
            stands: self.inertial.as_ref().is_some_and(|i| i.stands(frame.stamp)),
            since_s: self.inertial.as_ref().and_then(|i| i.unoffered(frame.stamp)),
            idle,
        };
        let request = wants_key_frame(&situation, self.rate_hz, self.config.min_key_frame_gap).then(|| {
            self.since_key_frame = 0;
            let anchored = anchored_at(snapshot, reference, world_from_camera).unwrap_or(anchored);
            let imu = self.inertial.as_mut().map(|i| i.sense(frame.stamp));
            KeyFrameRequest::Next {
                frame: frame.clone(),
                landmarks: matches.landmarks.clone(),
                anchored,
                imu,
                orientation_only: self.scale_support.is_lost(),
                rescale: self.due_rescale(snapshot, reference),
            }
        });
        let found: std::collections::BTreeSet<LandmarkId> =
            matches.landmarks.iter().flatten().copied().collect();
        let evidence =
            Evidence { features: frame.len(), expected: expected.len(), matched, inliers: located.inliers };
        let stamp = frame.stamp;
        self.last = Some(Last { frame, landmarks: matches.landmarks, anchored });
        let seen = expected.into_iter().map(|id| (id, found.contains(&id))).collect();
        Tracked {
            stamp,
            state: State::Tracking,
            pose: Some(anchored),
            evidence,
            request,
            earlier: Vec::new(),
            scale_supported: !self.scale_support.is_lost(),
            seen,
        }
    }

    /// Matches that must agree in a frame: of a blank wall's few features a good share will do, where each has depth.
    pub(crate) fn need(&self, frame: &Frame) -> usize {
        let least = if self.camera.has_depth() { 10 } else { 15 };
        self.config.min_inliers.min((frame.len() / 4).max(least))
    }

    /// Whether so little time has passed since the last pose that motion goes on as it was.
    pub(crate) fn recent(&self, frame: &Frame, seconds: f64) -> bool {
        self.located.is_none_or(|t| frame.stamp - t < seconds)
    }
}

/// Where the eye would be without what was believed before: at the solution the pull of both is in balance.
fn seen_alone(located: &Located, prior: &PosePrior) -> Option<Se3> {
    let pull = prior.information * prior.world_from_camera.local(&located.world_from_camera);
    let own = (located.information - prior.information).cholesky()?;
    Some(located.world_from_camera.retract(&own.solve(&pull)))
}

/// A pose that hangs on a key frame.
pub(crate) fn anchored_at(
    snapshot: &Snapshot,
    reference: KeyFrameId,
    world_from_camera: Se3,
) -> Option<AnchoredPose> {
    let reference_from_camera = snapshot.anchor(reference, &world_from_camera)?;
    Some(AnchoredPose { reference, reference_from_camera, world_from_camera })
}
