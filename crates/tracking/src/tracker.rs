//! One frame after another: predict, match, locate, judge.

use crate::decide::{Situation, wants_key_frame};
use crate::inertia::Inertia;
use crate::local_map::LocalMap;
use crate::match_last::{Before, Matches, match_last};
use crate::recover::{candidates, match_key_frame};
use crate::start::Starter;
use crate::state::{Evidence, Offer, Placed, State, Tracked};
use cairn_adjust::{Located, RecogniseSetting, locate, recognise};
use cairn_atlas::{KeyFrameId, LandmarkId, Map};
use cairn_geometry::{Manifold, Se3};
use cairn_inertial::Belief;
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use cairn_solve::PosePrior;
use cairn_vision::{EyeModel, Frame};
use nalgebra::SVector;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

/// How to track.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerSetting {
    /// Matches that must agree for a pose to count.
    pub min_inliers: usize,
    /// Key frames in the local map, at most.
    pub local_key_frames: usize,
    /// Frames between two key frames, at least.
    pub min_key_frame_gap: usize,
    /// Seconds without a pose after which a new world begins, if the place is still not recognised.
    pub new_world_s: f64,
    /// Standard deviation of the place in metres up to which the inertial sensor may carry a pose that is not seen.
    pub coast_sigma: f64,
    /// Seconds for which it may do so at most.
    pub coast_s: f64,
}

impl Default for TrackerSetting {
    fn default() -> Self {
        Self {
            min_inliers: 25,
            local_key_frames: 40,
            min_key_frame_gap: 1,
            new_world_s: 0.5,
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
/// Frames whose speeds are remembered.
const PACED: usize = 90;
/// What it takes to recognise a place when lost: matches by appearance that agree, and the share of all in the end.
const RECOGNISE_SEED: usize = 12;
const RECOGNISE_SHARE: f64 = 0.4;

/// What is kept of the last frame that had a pose.
#[derive(Debug)]
pub(crate) struct Last {
    pub frame: Arc<Frame>,
    pub landmarks: Vec<Option<LandmarkId>>,
    pub placed: Placed,
}

/// The tracking stage.
#[derive(Debug)]
pub struct Tracker {
    pub(crate) eye: EyeModel,
    pub(crate) features: usize,
    pub(crate) rate_hz: f64,
    pub(crate) setting: TrackerSetting,
    pub(crate) starter: Starter,
    /// Frames seen before there was a map, oldest first.
    pub(crate) waiting: VecDeque<Arc<Frame>>,
    local: LocalMap,
    pub(crate) last: Option<Last>,
    /// Velocity in the eye frame (metres or units a second, radians a second), when the last two frames had a pose.
    pub(crate) velocity: Option<SVector<f64, 6>>,
    /// Speeds of the last frames, units a second.
    pub(crate) speeds: VecDeque<f64>,
    /// The key frame that the last pose hung on and its unit of length then.
    unit: Option<(KeyFrameId, f64)>,
    pub(crate) lost: bool,
    /// Frames since tracking was lost.
    pub(crate) lost_frames: usize,
    /// When the last frame was located.
    pub(crate) located: Option<Stamp>,
    /// When a world was last begun, or the first frame came.
    pub(crate) begun: Option<Stamp>,
    pub(crate) since_key_frame: usize,
    since_recovery: usize,
    pub(crate) inertia: Option<Inertia>,
}

impl Tracker {
    /// A tracker without a map. `features` is what the eye gives at most (thresholds of the start are relative to
    /// it), `rate_hz` the nominal rate of frames.
    pub fn new(eye: EyeModel, features: usize, rate_hz: f64, setting: TrackerSetting) -> Self {
        Self {
            eye,
            features,
            rate_hz,
            setting,
            starter: Starter::default(),
            waiting: VecDeque::new(),
            local: LocalMap::default(),
            last: None,
            velocity: None,
            speeds: VecDeque::new(),
            unit: None,
            lost: false,
            lost_frames: 0,
            located: None,
            begun: None,
            since_key_frame: 0,
            since_recovery: usize::MAX / 2,
            inertia: None,
        }
    }

    /// The same with an inertial sensor, whose white noise is `noise_times` its data sheet's; `imu_from_eye` in metres.
    pub fn feeling(self, sensor: &ImuSensor, imu_from_eye: Se3, noise_times: f64) -> Self {
        Self { inertia: Some(Inertia::new(sensor, imu_from_eye, noise_times)), ..self }
    }

    /// Tells that mapping has begun a world with what was last offered: the last frame stands at key frame `id`.
    pub fn begun(&mut self, map: &Map, id: KeyFrameId) {
        let Some(k) = map.key_frame(id) else { return };
        let placed = Placed::at(k.id, k.world_from_eye);
        self.last = Some(Last { frame: k.frame.clone(), landmarks: k.landmarks.clone(), placed });
        self.lost = false;
        self.lost_frames = 0;
        self.velocity = None;
        self.located = Some(k.frame.stamp);
        self.begun = Some(k.frame.stamp);
        self.since_key_frame = 0;
        if let Some(inertia) = &mut self.inertia {
            inertia.begun(k);
        }
    }

    /// Takes one frame, and the readings of the inertial sensor up to it. `idle` tells whether mapping would take up a key frame at once, `mapping` whether ever. Once
    /// tracking is lost and the place is not recognised, the frame may be offered as the begin of a new world.
    pub fn step(
        &mut self,
        frame: Arc<Frame>,
        imu: &[ImuSample],
        map: &Map,
        idle: bool,
        mapping: bool,
    ) -> Tracked {
        self.begun.get_or_insert(frame.stamp);
        if let Some(inertia) = &mut self.inertia {
            inertia.take(imu, map);
        }
        if map.key_frame_count() == 0 {
            return self.start(frame);
        }
        self.since_key_frame = self.since_key_frame.saturating_add(1);
        self.since_recovery = self.since_recovery.saturating_add(1);
        self.refresh_last(map);
        if let Some(inertia) = &mut self.inertia {
            inertia.refresh(map);
        }
        let earlier = self.look_back(map);
        let mut tracked = self.follow(frame.clone(), map, idle);
        if self.lost && mapping {
            tracked.offer = self.bridge(frame.clone(), map).or_else(|| self.begin_anew(frame, map));
        } else if !self.lost {
            self.starter = Starter::default();
        }
        tracked.earlier = earlier;
        tracked
    }

    /// Finds where a frame is: by motion, by the reference, or by appearance.
    fn follow(&mut self, frame: Arc<Frame>, map: &Map, idle: bool) -> Tracked {
        let felt = self.inertia.as_ref().and_then(|i| i.predict(frame.stamp));
        let coasts = felt.as_ref().is_some_and(|b| self.may_coast(&frame, b));
        // A short gap is bridged by going on as before; after a longer one only appearance tells.
        let first_guess = if self.lost && !self.recent(&frame, BRIDGE_S) && !coasts {
            None
        } else {
            self.by_motion(&frame, map, felt.as_ref()).or_else(|| self.by_reference(&frame, map))
        };
        let carried = felt.clone().filter(|_| coasts);
        let (guess, matches, recovered) = match (first_guess, carried) {
            (Some((pose, matches)), _) => (pose, matches, false),
            // What is felt is good enough to look for the map where it must be.
            (None, Some(belief)) => (belief.world_from_eye, Matches::none(&frame), false),
            (None, None) => match self.relocalise(&frame, map) {
                Ok((pose, matches)) => (pose, matches, true),
                Err(inliers) => return self.miss(frame, map, inliers, felt, idle),
            },
        };
        if recovered {
            self.since_recovery = 0;
            self.velocity = None;
        }
        let felt = felt.filter(|_| !recovered);
        self.finish(frame, map, guess, matches, felt, idle)
    }

    fn start(&mut self, frame: Arc<Frame>) -> Tracked {
        let features = frame.len();
        self.wait(&frame);
        let offered = self.starter.step(&self.eye, &frame, self.features);
        let (state, offer) = match offered.map(|offer| self.with_sense(offer)) {
            Ok(offer) => (State::Starting { have: features, need: 0 }, Some(offer)),
            Err(state) => (state, None),
        };
        self.since_key_frame = 0;
        let evidence = Evidence { features, ..Evidence::default() };
        Tracked {
            stamp: frame.stamp,
            state,
            pose: None,
            evidence,
            offer,
            earlier: Vec::new(),
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
    fn look_back(&mut self, map: &Map) -> Vec<(Stamp, Placed)> {
        let frames = std::mem::take(&mut self.waiting);
        let mut found = Vec::new();
        let (Some(last), false) = (&self.last, frames.is_empty()) else { return found };
        let mut before =
            Last { frame: last.frame.clone(), landmarks: last.landmarks.clone(), placed: last.placed };
        for frame in frames.iter().rev() {
            let known = map.key_frames().find(|k| Arc::ptr_eq(&k.frame, frame));
            let (placed, landmarks) = match known {
                Some(k) => (Placed::at(k.id, k.world_from_eye), k.landmarks.clone()),
                None => {
                    let Some((placed, landmarks)) = self.place_after(&before, frame, map) else { break };
                    found.push((frame.stamp, placed));
                    (placed, landmarks)
                }
            };
            before = Last { frame: frame.clone(), landmarks, placed };
        }
        found
    }

    /// Where a frame stands that was taken next to one whose place is known.
    fn place_after(
        &mut self,
        before: &Last,
        frame: &Frame,
        map: &Map,
    ) -> Option<(Placed, Vec<Option<LandmarkId>>)> {
        let (guess, mut matches) = self.match_from(before, &before.placed.world_from_eye, frame, map)?;
        matches.extra.clear();
        self.local.gather(map, &matches, before.placed.reference, self.setting.local_key_frames);
        self.local.search(map, &self.eye, frame, &guess, 1.0, &mut matches);
        let located = self.locate(map, frame, &guess, &mut matches);
        if located.inliers < self.setting.min_inliers {
            return None;
        }
        let placed = self.place(map, before.placed.reference, located.world_from_eye)?;
        Some((placed, matches.landmarks))
    }

    /// A pose as it hangs on the nearest key frame of those that the local map was gathered around.
    fn place(&self, map: &Map, fallback: KeyFrameId, world_from_eye: Se3) -> Option<Placed> {
        hung(map, self.local.nearest(map, &world_from_eye.translation).unwrap_or(fallback), world_from_eye)
    }

    /// When the last frame has become a key frame, what it shows and where it stands is told by the map.
    fn refresh_last(&mut self, map: &Map) {
        self.refresh_unit(map);
        let Some(newest) = map.newest_key_frame() else { return };
        match &mut self.last {
            Some(last) if Arc::ptr_eq(&last.frame, &newest.frame) => {
                last.landmarks.clone_from(&newest.landmarks);
                last.placed = Placed::at(newest.id, newest.world_from_eye);
            }
            Some(last) => {
                let placed = &mut last.placed;
                if let Some(standing) = map.stand(placed.reference, &placed.reference_from_eye) {
                    placed.world_from_eye = standing;
                }
            }
            // A map that was loaded: where in it the eye is, appearance has to tell.
            None => self.lost = true,
        }
    }

    /// When a loop or a merge has changed the unit of length, speeds are told in the new one.
    fn refresh_unit(&mut self, map: &Map) {
        let Some((id, before)) = self.unit else { return };
        let Some(now) = map.world_from_here(id).map(|here| here.scale).filter(|now| *now != before) else {
            return;
        };
        if let Some(v) = &mut self.velocity {
            v.fixed_rows_mut::<3>(0).scale_mut(now / before);
        }
        self.speeds.iter_mut().for_each(|s| *s *= now / before);
        self.unit = Some((id, now));
    }

    fn locate(&self, map: &Map, frame: &Frame, guess: &Se3, matches: &mut Matches) -> Located {
        self.locate_from(map, frame, guess, None, matches)
    }

    fn locate_from(
        &self,
        map: &Map,
        frame: &Frame,
        guess: &Se3,
        prior: Option<&PosePrior>,
        matches: &mut Matches,
    ) -> Located {
        let located = locate(map, &self.eye, frame, guess, &matches.landmarks, &matches.extra, prior);
        let located = self.led(map, frame, guess, prior, matches, located);
        matches.drop_outliers(&located.outliers);
        located
    }

    /// By what was felt, by the motion of the last two frames, or by standing still when that is not known.
    fn by_motion(&self, frame: &Frame, map: &Map, felt: Option<&Belief>) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let elapsed = frame.stamp - last.frame.stamp;
        let moved = self.velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * elapsed)));
        let guess = felt.map_or(last.placed.world_from_eye * moved, |b| b.world_from_eye);
        self.match_from(last, &guess, frame, map)
    }

    /// Matches with the frame before around a guess, and farther out where the guess was poor.
    fn match_from(&self, last: &Last, guess: &Se3, frame: &Frame, map: &Map) -> Option<(Se3, Matches)> {
        let mut guess = *guess;
        let radius = if self.eye.has_depth() { 7.0 } else { 15.0 };
        let known = last.landmarks.iter().flatten().count();
        let before = Before {
            frame: &last.frame,
            landmarks: &last.landmarks,
            world_from_eye: last.placed.world_from_eye,
        };
        let few = self.need(frame).min(15);
        let mut best: Option<(usize, Se3, Matches)> = None;
        // A good prediction finds most of what was seen; else look farther, then closely from where that leads.
        for radius in [radius, 2.0 * radius, 4.0 * radius, radius] {
            let mut matches = match_last(map, &self.eye, &before, frame, &guess, radius);
            if matches.count() < few {
                continue;
            }
            let located = self.locate(map, frame, &guess, &mut matches);
            if located.inliers >= few.min(12) && best.as_ref().is_none_or(|(n, ..)| located.inliers > *n) {
                guess = located.world_from_eye;
                best = Some((located.inliers, located.world_from_eye, matches));
            }
            if located.inliers * 2 >= known.max(24) {
                break;
            }
        }
        best.map(|(_, pose, matches)| (pose, matches))
    }

    /// By descriptors of the reference key frame, near the last pose.
    fn by_reference(&self, frame: &Frame, map: &Map) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let (reference, _) = map.living(last.placed.reference)?;
        let mut matches = match_key_frame(map.key_frame(reference)?, frame, 0.7);
        if matches.count() < 15 {
            return None;
        }
        let located = self.locate(map, frame, &last.placed.world_from_eye, &mut matches);
        (located.inliers >= 12).then_some((located.world_from_eye, matches))
    }

    /// Looks for the place among earlier key frames; the best count of agreeing landmarks when none is recognised.
    fn relocalise(&mut self, frame: &Frame, map: &Map) -> Result<(Se3, Matches), usize> {
        let last = self.last.as_ref().map(|l| l.placed.world_from_eye.translation);
        let setting =
            RecogniseSetting { seed: RECOGNISE_SEED, need: self.setting.min_inliers, share: RECOGNISE_SHARE };
        let mut best = 0;
        for id in candidates(map, frame, last, self.lost_frames) {
            match recognise(map, &self.eye, frame, id, &BTreeSet::new(), &setting, frame.stamp.0 as u64) {
                Ok(place) if !self.reaches(map, id, &place.world_from_eye, frame.stamp) => {}
                Ok(place) => {
                    let matches = Matches { landmarks: place.landmarks, extra: Vec::new() };
                    return Ok((place.world_from_eye, matches));
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
        map: &Map,
        guess: Se3,
        mut matches: Matches,
        felt: Option<Belief>,
        idle: bool,
    ) -> Tracked {
        let Some(newest) = map.newest_key_frame().map(|k| k.id) else { return self.lose(frame, 0) };
        let prior = felt.as_ref().and_then(|b| {
            Some(PosePrior { world_from_eye: b.world_from_eye, information: b.pose_information()? })
        });
        let fallback =
            self.last.as_ref().and_then(|l| map.living(l.placed.reference)).map_or(newest, |(id, _)| id);
        matches.extra.clear();
        self.local.gather(map, &matches, fallback, self.setting.local_key_frames);
        let factor = match self.since_recovery {
            0..=2 => 5.0,
            _ if matches.count() == 0 => 5.0,
            _ => 1.0,
        };
        let mut expected = self.local.search(map, &self.eye, &frame, &guess, factor, &mut matches);
        let mut matched = matches.count();
        let mut located = self.locate_from(map, &frame, &guess, prior.as_ref(), &mut matches);
        // Few of those expected were found: the guess was poor. Look again from the better pose.
        if located.inliers * 3 < expected.len() {
            expected = self.local.search(map, &self.eye, &frame, &located.world_from_eye, 1.0, &mut matches);
            matched = matches.count();
            located = self.locate_from(map, &frame, &located.world_from_eye, prior.as_ref(), &mut matches);
        }
        let need = match (&prior, self.since_recovery < 30) {
            // What is felt speaks for the pose too.
            (Some(_), _) => self.need(&frame).min(NEED_FELT),
            (None, true) => self.setting.min_inliers * 3 / 2,
            (None, false) => self.need(&frame),
        };
        if located.inliers < need {
            return self.miss(frame, map, located.inliers, felt, idle);
        }
        let world_from_eye = located.world_from_eye;
        let Some(placed) = self.place(map, fallback, world_from_eye) else {
            return self.lose(frame, located.inliers);
        };
        if self.inertia.as_mut().is_some_and(|i| i.wants_turns(frame.stamp)) {
            // What was felt has its part in the pose; the clocks are compared with what was seen alone.
            let alone = prior.as_ref().and_then(|p| seen_alone(&located, p)).unwrap_or(world_from_eye);
            if let Some(inertia) = &mut self.inertia {
                inertia.turned(frame.stamp, alone.rotation);
            }
        }
        if let Some(inertia) = &mut self.inertia {
            inertia.seen(map, frame.stamp, &placed, felt.as_ref(), &located.information);
        }
        let reference = self.local.reference.unwrap_or(fallback);
        self.velocity = match &self.last {
            Some(last) if self.recent(&frame, BRIDGE_S) && frame.stamp > last.frame.stamp => {
                Some(last.placed.world_from_eye.local(&world_from_eye) / (frame.stamp - last.frame.stamp))
            }
            _ => None,
        };
        if let Some(v) = &self.velocity {
            if self.speeds.len() == PACED {
                self.speeds.pop_front();
            }
            self.speeds.push_back(v.fixed_rows::<3>(0).norm());
        }
        self.unit = map.world_from_here(placed.reference).map(|here| (placed.reference, here.scale));
        self.lost = false;
        self.lost_frames = 0;
        self.located = Some(frame.stamp);
        let situation = Situation {
            map,
            eye: &self.eye,
            frame: &frame,
            matches: &matches,
            inliers: located.inliers,
            need,
            reference,
            turned_rad: placed.reference_from_eye.rotation.angle(),
            since: self.since_key_frame,
            stands: self.inertia.as_ref().is_some_and(|i| i.stands(frame.stamp)),
            since_s: self.inertia.as_ref().and_then(|i| i.unoffered(frame.stamp)),
            idle,
        };
        let offer = wants_key_frame(&situation, self.rate_hz, self.setting.min_key_frame_gap).then(|| {
            self.since_key_frame = 0;
            let placed = hung(map, reference, world_from_eye).unwrap_or(placed);
            let sensed = self.inertia.as_mut().map(|i| i.sense(frame.stamp));
            Offer::Next { frame: frame.clone(), landmarks: matches.landmarks.clone(), placed, sensed }
        });
        let found: std::collections::BTreeSet<LandmarkId> =
            matches.landmarks.iter().flatten().copied().collect();
        let evidence =
            Evidence { features: frame.len(), expected: expected.len(), matched, inliers: located.inliers };
        let stamp = frame.stamp;
        self.last = Some(Last { frame, landmarks: matches.landmarks, placed });
        let seen = expected.into_iter().map(|id| (id, found.contains(&id))).collect();
        Tracked {
            stamp,
            state: State::Tracking,
            pose: Some(placed),
            evidence,
            offer,
            earlier: Vec::new(),
            seen,
        }
    }

    /// Matches that must agree in a frame: of a blank wall's few features a good share will do, where each has depth.
    pub(crate) fn need(&self, frame: &Frame) -> usize {
        let least = if self.eye.has_depth() { 10 } else { 15 };
        self.setting.min_inliers.min((frame.len() / 4).max(least))
    }

    /// Whether so little time has passed since the last pose that motion goes on as it was.
    pub(crate) fn recent(&self, frame: &Frame, seconds: f64) -> bool {
        self.located.is_none_or(|t| frame.stamp - t < seconds)
    }
}

/// Where the eye would be without what was believed before: at the solution the pull of both is in balance.
fn seen_alone(located: &Located, prior: &PosePrior) -> Option<Se3> {
    let pull = prior.information * prior.world_from_eye.local(&located.world_from_eye);
    let own = (located.information - prior.information).cholesky()?;
    Some(located.world_from_eye.retract(&own.solve(&pull)))
}

/// A pose that hangs on a key frame.
pub(crate) fn hung(map: &Map, reference: KeyFrameId, world_from_eye: Se3) -> Option<Placed> {
    let reference_from_eye = map.hang(reference, &world_from_eye)?;
    Some(Placed { reference, reference_from_eye, world_from_eye })
}
