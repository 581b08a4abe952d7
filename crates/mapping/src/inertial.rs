//! The inertial part of mapping: IMU factors between key frames, initialisation of gravity, scale and biases,
//! and visual-inertial windows.
//!
//! A map is built from vision alone until gravity, scale and biases are found ([`cairn_inertial::initialise`], run
//! alongside mapping). It is then gravity-aligned and adjusted as a whole with its IMU factors, and adjusted again as
//! it grows. Nothing is discarded meanwhile, and if the initialisation never succeeds, visual mapping goes on.

use crate::by_tracks;
use crate::clocks::Clocks;
use crate::gravity_refinement::{Due, Refined, differs_from_map, estimated_gravity, realigned};
use crate::initialisation::{CameraAndImu, INITIALISATION_S, better_scale};
use crate::recent::{self, Recent, adjust_recent};
use crate::scale_check::{ScaleCheck, ScaleWatch};
use crate::windows;
use cairn_adjust::{Imu, ImuModel, Window, WindowConfig, WindowResult};
use cairn_atlas::{
    Atlas, Change, ImuFactor, ImuSegment, InertialState, KeyFrameId, MapId, Readout, Snapshot,
};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::{Attempt, Gate, GateKind, Initial, Preintegrated, of_data_sheet};
use cairn_sensor::{ImuNoise, ImuSensor, Stamp};
use cairn_settings::Settings;
use cairn_solve::pause;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Configuration of the use of the IMU.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct InertialConfig {
    /// Whether the IMU is used, where there is one.
    #[setting(default = false)]
    pub enabled: bool,
    /// Factor on the IMU's white noise, unless the first metres find it far noisier.
    #[setting(default = 2.0, range = 0.1..=1e3)]
    pub noise_times: f64,
    /// Key frames, linked by IMU factors, that a local bundle adjustment moves.
    #[setting(default = 10, range = 2..=100)]
    pub chain: usize,
    /// Largest map, in key frames, that is adjusted as a whole with its IMU factors; 0: never.
    #[setting(default = 1000, range = 0..=10000)]
    pub whole_key_frames: usize,
    /// Standard deviation in metres of where the rig says that the camera is on the IMU, each axis. Whole maps with IMU factors
    /// estimate it; 0: it is as the rig says.
    #[setting(default = 0.0, range = 0.0..=1.0)]
    pub lever_arm_sigma: f64,
}

impl InertialConfig {
    /// Where the camera is on the IMU: as a map has found, where that is a better estimate of what is stated, else as is stated.
    pub fn mount(&self, stated: Se3, found: Option<&Se3>) -> Se3 {
        let is_better = |found: &&Se3| {
            let off = found.translation - stated.translation;
            off.amax() < MOST_LEVER_ARM_SIGMAS * self.lever_arm_sigma
                && (found.rotation.inverse() * stated.rotation).angle() < SAME_ROTATION_RAD
        };
        found.filter(is_better).copied().unwrap_or(stated)
    }

    /// The IMU, by the noise that is stated for it, with that which adjustments of mapping and of closing begin with.
    pub(crate) fn model(&self, noise: &ImuNoise, imu_from_camera: Se3) -> ImuModel {
        let noise = of_data_sheet(noise).times([self.noise_times; 2]);
        ImuModel { imu_from_camera, noise, others_times: self.noise_times }
    }
}

/// A lever arm that differs by more of its standard deviations from what is stated, or by such a rotation, is of another rig.
const MOST_LEVER_ARM_SIGMAS: f64 = 4.0;
const SAME_ROTATION_RAD: f64 = 1e-3;
/// With the clocks known this well, seconds, nothing waits for their comparison by rotations.
const MOST_OFFSET_SIGMA_S: f64 = 0.002;
/// Within an offset of more than this, seconds, the velocity of a walker is not constant: at 20 ms the bob of his body would be seen
/// 3 % too large. Readings are shifted by it, and what is left is estimated again.
const FAR_OFFSET_S: f64 = 0.004;
/// Where the clocks are known before the first map, metres are taken with a scale known to this, and stated so (`phone/b`: after 2.2 s
/// from its first frame with 9 %). Adjustments with the readings make it better as the walk goes on; without them a map of one who turns
/// soon has no scale at all.
const SOFT_SCALE_SIGMA: f64 = 0.1;

/// With noise of more than this in that of the data sheet a sensor is worse than stated. Below it what the first metres put down to the IMU
/// is what its images err by as well: 2.2 and 3.2 times on `house`, whose noise is exactly as stated, 2.9 to 4.1 in `tumvi_room1` and 3.
const WORSE_THAN_STATED: f64 = 5.0;

/// A map without metres is tried with each key frame for the first of these seconds, and after that as often as it has become longer by
/// this share: an attempt takes the longer the more it looks at, and what a long stretch has not told one key frame more does not tell
/// (`phone/b` without its clocks: 361 attempts in 20 s took half of the processor time).
const EACH_S: f64 = 5.0;
const LONGER: f64 = 0.05;

/// The IMU state of mapping.
#[derive(Debug)]
pub(crate) struct Inertial {
    /// Noise of the data sheet.
    data_sheet: ImuNoise,
    pub imu: ImuModel,
    pub config: InertialConfig,
    clocks: Clocks,
    /// What was done to each map that was gravity-aligned here.
    refined: BTreeMap<MapId, Refined>,
    scale_watch: ScaleWatch,
    /// Whether metres begin with a scale that is known roughly.
    soft_scale: bool,
    /// The map that was tried last, and when.
    tried: Option<(MapId, Stamp)>,
    recent: Recent,
}

impl Inertial {
    pub fn new(sensor: &ImuSensor, imu_from_camera: Se3, config: InertialConfig) -> Self {
        let data_sheet = of_data_sheet(&sensor.noise);
        let imu = config.model(&sensor.noise, imu_from_camera);
        let clocks = Clocks::new(&ImuSensor { noise: data_sheet, ..sensor.clone() });
        let scale_watch = ScaleWatch::default();
        let refined = BTreeMap::new();
        Self {
            data_sheet,
            imu,
            config,
            clocks,
            refined,
            scale_watch,
            soft_scale: false,
            tried: None,
            recent: Recent::default(),
        }
    }

    /// The IMU, mounted as it is known in a map.
    fn imu_in(&self, snapshot: &Snapshot) -> ImuModel {
        let imu_from_camera = snapshot.imu_from_camera().copied().unwrap_or(self.imu.imu_from_camera);
        ImuModel { imu_from_camera, ..self.imu }
    }

    /// What the scale is estimated with.
    fn camera_and_imu<'a>(&self, camera: &'a RectifiedCamera, imu: &'a ImuModel) -> CameraAndImu<'a> {
        let (offset_sigma_s, lever_arm_sigma) = (self.clocks.sigma_s(), self.config.lever_arm_sigma);
        CameraAndImu { camera, imu, offset_sigma_s, lever_arm_sigma }
    }

    /// The motion of a new key frame, with an IMU factor to the previous one of its map where the readings
    /// start there.
    pub fn motion(
        &mut self,
        snapshot: &Snapshot,
        map: MapId,
        stamp: Stamp,
        imu: &ImuSegment,
    ) -> InertialState {
        self.clocks.take(imu);
        let begins = imu.samples.first().map(|s| s.stamp);
        let before = (0..snapshot.next_key_frame_id().index())
            .rev()
            .filter_map(|i| snapshot.key_frame(KeyFrameId::from_index(i)?))
            .find(|k| k.map == map)
            .filter(|k| imu.offset_s != snapshot.imu_offset() || Some(k.stamp) == begins);
        // In the IMU's own clock: the request's segment may have been cut with another offset.
        let imu_factor = before.and_then(|k| {
            let sum = self.clocks.preintegrated(imu.bias, k.stamp, stamp, snapshot.imu_offset())?;
            Some(ImuFactor { since: k.id, sum: Arc::new(sum) })
        });
        InertialState { velocity: imu.velocity, bias: imu.bias, still_sigma: imu.still_sigma, imu_factor }
    }

    /// The changes that leave out readings which earlier key frames were given and which have turned out to be wrong.
    pub fn cut(&mut self, snapshot: &Snapshot, imu: &ImuSegment) -> Vec<Change> {
        let since = imu.unsound_since;
        since.map_or_else(Vec::new, |since| self.clocks.cut(snapshot, since, imu.offset_s))
    }

    /// The motion of a key frame with an IMU factor to a given earlier one.
    pub fn motion_since(&mut self, before: Option<KeyFrameId>, imu: &ImuSegment) -> InertialState {
        self.clocks.take(imu);
        let imu_factor = before.filter(|_| imu.samples.len() > 1).map(|since| ImuFactor {
            since,
            sum: Arc::new(Preintegrated::of(self.data_sheet, imu.bias, imu.samples.clone())),
        });
        InertialState { velocity: imu.velocity, bias: imu.bias, still_sigma: imu.still_sigma, imu_factor }
    }

    /// Takes the offset of the clocks that was found before there was a map.
    pub fn adopt_offset(&mut self, offset_s: f64, sigma_s: f64) {
        self.clocks.adopt(offset_s, sigma_s, 0.0);
        self.soft_scale = true;
        self.scale_watch.follow();
    }

    /// The local window of a gravity-aligned map.
    pub fn window(
        &self,
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        centre: KeyFrameId,
        config: &WindowConfig,
    ) -> Option<Window> {
        let map = snapshot.key_frame(centre)?.map;
        if !snapshot.is_gravity_aligned(map) {
            return None;
        }
        let imu = Imu::new(self.imu).with_chain(self.config.chain);
        Window::of(snapshot, camera).need(imu).around(centre, config)
    }

    /// Adjusts a gravity-aligned map as a whole with its IMU factors; `None` where there are none or it is
    /// too large.
    pub async fn whole(
        &self,
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        map: MapId,
        config: &WindowConfig,
        stop: impl FnMut() -> bool,
    ) -> Option<WindowResult> {
        let few = snapshot.key_frames_of(map).count() <= self.config.whole_key_frames;
        if !few || !snapshot.is_gravity_aligned(map) {
            return None;
        }
        let imu = Imu::new(self.imu).with_lever_arm(self.config.lever_arm_sigma);
        let window = windows::inertial_whole(Window::of(snapshot, camera), imu, map)?;
        Some(window.solve_in_slices(config, stop).await)
    }

    /// Gravity-aligns the map of a key frame when that is possible, or refines it when that is due; returns
    /// the attempt made, and in a gravity-aligned map what the readings say of its scale.
    pub async fn align_or_refine(
        &mut self,
        atlas: &mut Atlas,
        camera: &RectifiedCamera,
        centre: KeyFrameId,
        config: &WindowConfig,
    ) -> (Option<Attempt>, Option<ScaleCheck>) {
        self.update_time_offset(atlas, centre);
        pause().await;
        let snapshot = atlas.latest().clone();
        let aligned = snapshot.key_frame(centre).is_some_and(|k| snapshot.is_gravity_aligned(k.map));
        let (chain, imu) = (chain(&snapshot, centre), self.imu);
        let of = self.camera_and_imu(camera, &imu);
        let check = match camera.has_depth() {
            true => self.scale_watch.check_depth(&snapshot, &of, &chain).await,
            false if aligned => self.scale_watch.check(atlas, &of, &chain, config).await,
            false => None,
        };
        pause().await;
        let now = snapshot.key_frame(centre).map(|k| k.frame.stamp);
        if aligned && !camera.has_depth() && now.is_some_and(|now| self.recent.is_due(now)) {
            adjust_recent(atlas, camera, &self.imu, &chain, recent::SECONDS, config).await;
        }
        (self.align_or_refine_chain(atlas, camera, &chain, config).await, check)
    }

    async fn align_or_refine_chain(
        &mut self,
        atlas: &mut Atlas,
        camera: &RectifiedCamera,
        chain: &[KeyFrameId],
        config: &WindowConfig,
    ) -> Option<Attempt> {
        let snapshot = atlas.latest().clone();
        let (first, last) = (snapshot.key_frame(*chain.first()?)?, snapshot.key_frame(*chain.last()?)?);
        let (map, seconds) = (last.map, last.frame.stamp - first.frame.stamp);
        let centre_point = snapshot.world_from_camera(map.root())?.translation;
        let imu = self.imu;
        let of = self.camera_and_imu(camera, &imu);
        let guessed = if self.soft_scale { by_tracks::GUESSED } else { 0.0 };
        let (mut attempt_made, mut better_sigma) = (None, None);
        if snapshot.is_gravity_aligned(map) {
            let refined = self.refined.entry(map).or_default();
            let due = refined.due(last, seconds)?;
            let told = estimated_gravity(&of, &snapshot, chain).await;
            refined.looked(last, told.is_some());
            better_sigma = told
                .as_ref()
                .filter(|_| !camera.has_depth())
                .and_then(|f| better_scale(&snapshot, map, f, guessed));
            let better = told.filter(differs_from_map);
            if due == Due::IfGravityDiffers && better.is_none() {
                return None;
            }
            if let Some(found) = better {
                atlas.commit(realigned(&snapshot, map, chain, &found, centre_point));
            }
        } else if self.soft_scale && self.take_metres_by_tracks(atlas, camera, map, chain).await {
            self.refined.insert(map, Refined::of_age(seconds));
        } else {
            if !self.is_due(map, last.frame.stamp, seconds) {
                return None;
            }
            let mut attempt = of.attempt(&snapshot, chain, INITIALISATION_S).await?;
            if let Some(found) = attempt.found.as_ref().filter(|f| is_far_offset(f)) {
                // The poses were taken along their velocities for so long, as if it did not change.
                atlas.commit(self.shifted_clocks(&snapshot, chain, snapshot.imu_offset() + found.offset_s));
                attempt = of.attempt(atlas.latest(), chain, INITIALISATION_S).await?;
            }
            let snapshot = atlas.latest().clone();
            let known = attempt.found.as_ref().is_some_and(|f| f.offset_sigma_s <= MOST_OFFSET_SIGMA_S);
            let compared = f64::from(u8::from(known || self.clocks.is_decided()));
            attempt.gates.push(Gate::new(GateKind::Clocks, compared, 1.0));
            if self.soft_scale {
                soften(&mut attempt);
            }
            let found = attempt.accepted().cloned();
            attempt_made = Some(attempt);
            let Some(found) = found else { return attempt_made };
            let stated = self.config.noise_times;
            let noise_times = found.noise_times.map(|t| if t > WORSE_THAN_STATED { t } else { stated });
            self.clocks.clear_rotations();
            self.imu.noise = self.data_sheet.times(noise_times);
            atlas.commit(self.settle_clocks(&snapshot, chain, &found));
            atlas.commit(self.align_gravity(&snapshot, map, chain, &found, camera.has_depth(), centre_point));
            if !camera.has_depth() {
                atlas.commit(vec![Change::ScaleSigma(map, found.scale_sigma.hypot(guessed))]);
            }
            self.refined.insert(map, Refined::of_age(seconds));
        }
        let config = WindowConfig { iterations: [8, 6], tolerance: 1e-4, ..*config };
        let snapshot = atlas.latest().clone();
        if let Some(result) = self.whole(&snapshot, camera, map, &config, || false).await {
            atlas.commit(result.changes.changes);
            atlas.commit(better_sigma.into_iter().collect());
        }
        attempt_made
    }

    /// Whether a map without metres that has lasted for so many seconds is tried now.
    fn is_due(&mut self, map: MapId, now: Stamp, seconds: f64) -> bool {
        let longer_s = if seconds > EACH_S { LONGER * seconds.min(INITIALISATION_S) } else { 0.0 };
        let is_due = self.tried.is_none_or(|(tried, at)| tried != map || now - at >= longer_s);
        self.tried = if is_due { Some((map, now)) } else { self.tried };
        is_due
    }

    /// Gives a map metres by its tracks, where these tell them.
    async fn take_metres_by_tracks(
        &mut self,
        atlas: &mut Atlas,
        camera: &RectifiedCamera,
        map: MapId,
        chain: &[KeyFrameId],
    ) -> bool {
        let snapshot = atlas.latest().clone();
        let imu = self.imu_in(&snapshot);
        let of = self.camera_and_imu(camera, &imu);
        let found = by_tracks::motion_of(&snapshot, &of, chain).await;
        let Some(found) = found.filter(|found| !camera.has_depth() && found.is_good) else { return false };
        atlas.commit(found.changes(&snapshot, map, &imu.imu_from_camera));
        let (known, [offset_s, sigma_s]) = (snapshot.imu_offset(), found.motion.offset_s);
        if let Some(offset_s) = self.clocks.adopt(known + offset_s, sigma_s, known) {
            atlas.commit(self.shifted_clocks(&snapshot, chain, offset_s));
        }
        let [longer_s, sigma_s] = found.motion.readout_s;
        let seconds = (snapshot.readout().seconds + longer_s).clamp(-Readout::MOST_S, Readout::MOST_S);
        atlas.commit(vec![Change::Readout(Readout { seconds, sigma_s })]);
        self.clocks.clear_rotations();
        true
    }

    /// Estimates the time offset, and recomputes the IMU factors once it is found. Where the IMU is late, the last
    /// readings before a key frame arrive with the next one.
    fn update_time_offset(&mut self, atlas: &mut Atlas, centre: KeyFrameId) {
        let snapshot = atlas.latest().clone();
        let known = snapshot.imu_offset();
        let chain = chain(&snapshot, centre);
        if let Some(offset) = self.clocks.estimate(&self.imu.imu_from_camera.rotation, known) {
            atlas.commit(self.shifted_clocks(&snapshot, &chain, offset));
        } else if known < 0.0 {
            let late = &chain[chain.len().saturating_sub(3)..chain.len().saturating_sub(1).max(1)];
            atlas.commit(self.clocks.recompute_factors(&snapshot, late, known));
        }
    }

    /// The changes that take over the clocks' offset found with the scale.
    fn settle_clocks(&mut self, snapshot: &Snapshot, chain: &[KeyFrameId], found: &Initial) -> Vec<Change> {
        let known = snapshot.imu_offset();
        match self.clocks.adopt(known + found.offset_s, found.offset_sigma_s, known) {
            Some(offset) => self.shifted_clocks(snapshot, chain, offset),
            None => Vec::new(),
        }
    }

    /// The changes to another offset of the clocks, in seconds.
    fn shifted_clocks(&self, snapshot: &Snapshot, chain: &[KeyFrameId], offset_s: f64) -> Vec<Change> {
        let mut changes = vec![Change::ImuOffset(offset_s)];
        changes.extend(self.clocks.recompute_factors(snapshot, chain, offset_s));
        changes
    }

    /// The changes that gravity-align a map about a fixed point.
    fn align_gravity(
        &self,
        snapshot: &Snapshot,
        map: MapId,
        chain: &[KeyFrameId],
        found: &Initial,
        metric: bool,
        centre_point: Vec3,
    ) -> Vec<Change> {
        let turn = found.metric_from_map();
        let scale = if metric { 1.0 } else { turn.scale };
        let shift = centre_point - turn.rotation * centre_point * scale;
        let mut changes = vec![Change::AlignGravity(map, Sim3::new(turn.rotation, shift, scale))];
        let last = chain.last().and_then(|id| snapshot.key_frame(*id)).map(|k| k.stamp);
        let imu_from_camera = self.imu_in(snapshot).imu_from_camera;
        let recent = |id: &&KeyFrameId| {
            snapshot
                .key_frame(**id)
                .zip(last)
                .is_some_and(|(k, last): (_, Stamp)| last - k.stamp <= INITIALISATION_S)
        };
        for (id, state) in chain.iter().filter(recent).zip(&found.states) {
            let world_from_camera = state.world_from_imu * imu_from_camera;
            let velocity = world_from_camera.rotation.inverse() * state.velocity;
            changes.push(Change::InertialState(*id, velocity, found.bias));
        }
        changes
    }
}

/// Takes a scale that is known to [`SOFT_SCALE_SIGMA`].
fn soften(attempt: &mut Attempt) {
    for gate in attempt.gates.iter_mut().filter(|gate| gate.kind == GateKind::ScaleSigma) {
        *gate = Gate::new(gate.kind, gate.value, gate.bound.max(SOFT_SCALE_SIGMA));
    }
}

/// Whether the clocks are so far apart that the change of the velocity within that time counts, and this is known.
fn is_far_offset(found: &Initial) -> bool {
    found.offset_sigma_s <= MOST_OFFSET_SIGMA_S && found.offset_s.abs() > FAR_OFFSET_S
}

/// Key frames linked by IMU factors up to one, oldest first.
fn chain(snapshot: &Snapshot, last: KeyFrameId) -> Vec<KeyFrameId> {
    let mut chain = vec![last];
    let mut at = last;
    while let Some(imu) =
        snapshot.key_frame(at).and_then(|k| k.motion.as_ref()).and_then(|m| m.imu_factor.as_ref())
    {
        at = imu.since;
        chain.push(at);
    }
    chain.reverse();
    chain
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_walk::{NOISE, STEP_S, ToAndFro, position};
    use crate::synthetic::mono;
    use cairn_geometry::So3;
    use cairn_solve::to_end;

    /// The tilt of a map that was made `tilt_rad` from level, of a walk that turns so far to either side, after every key frame
    /// has been looked at.
    fn tilt_after(turn_rad: f64, tilt_rad: f64, refined: Refined) -> f64 {
        let (mut atlas, ids) = ToAndFro { turn_rad, tilt_rad, factor: 1.0 }.map(60);
        let before = atlas.latest().key_frame(ids[0]).unwrap().world_from_camera.rotation;
        let sensor =
            ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise: NOISE, offset_s: 0.0 };
        let config = InertialConfig { enabled: true, ..InertialConfig::default() };
        let mut inertial = Inertial::new(&sensor, Se3::identity(), config);
        inertial.refined.insert(MapId(ids[0]), refined);
        for n in 2..ids.len() {
            to_end(inertial.align_or_refine_chain(&mut atlas, &mono(), &ids[..=n], &WindowConfig::default()));
        }
        let after = atlas.latest().key_frame(ids[0]).unwrap().world_from_camera.rotation;
        let turned = (after * before.inverse()).log();
        (turned.xy() + nalgebra::Vector2::x() * tilt_rad).norm()
    }

    /// Before and after the last adjustment as a whole.
    const AGES_S: [f64; 2] = [50.0, 70.0];

    #[test]
    fn a_turn_levels_a_map_whose_tilt_was_taken_for_a_bias() {
        for age in AGES_S {
            let left = tilt_after(0.8, 0.02, Refined::of_age(age));
            assert!(left < 0.002, "{left} rad of 0.02, {age} s");
        }
        let left = tilt_after(0.8, 0.0, Refined::of_age(AGES_S[0]));
        assert!(left < 1e-4, "{left} rad though it was level");
    }

    #[test]
    fn without_a_turn_nobody_knows() {
        let left = tilt_after(0.1, 0.02, Refined::of_age(AGES_S[0]));
        assert!((left - 0.02).abs() < 1e-9, "{left} rad of 0.02");
    }

    #[test]
    fn an_old_map_whose_level_is_known_is_left_alone() {
        let left = tilt_after(0.8, 0.02, Refined::default());
        assert!((left - 0.02).abs() < 1e-9, "{left} rad of 0.02");
    }

    fn inertial() -> Inertial {
        let sensor =
            ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise: NOISE, offset_s: 0.0 };
        let config = InertialConfig { enabled: true, ..InertialConfig::default() };
        Inertial::new(&sensor, Se3::identity(), config)
    }

    #[test]
    fn window_and_whole_have_imu_factors_in_a_gravity_aligned_map_alone() {
        let walk = ToAndFro { turn_rad: 0.5, tilt_rad: 0.0, factor: 1.0 };
        let (inertial, config) = (inertial(), WindowConfig::default());
        let (aligned, ids) = walk.map(12);
        let window = inertial.window(aligned.latest(), &mono(), ids[11], &config).expect("a window");
        assert!(window.links() > 5, "{}", window.links());
        let map = MapId(ids[0]);
        assert!(to_end(inertial.whole(aligned.latest(), &mono(), map, &config, || false)).is_some());
        let (vision, ids) = walk.map_of_vision(12);
        assert!(inertial.window(vision.latest(), &mono(), ids[11], &config).is_none());
        assert!(to_end(inertial.whole(vision.latest(), &mono(), map, &config, || false)).is_none());
        let few = InertialConfig { whole_key_frames: 11, ..inertial.config };
        let few = Inertial { config: few, ..inertial };
        let large = to_end(few.whole(aligned.latest(), &mono(), map, &config, || false));
        assert!(large.is_none(), "it is too large");
    }

    #[test]
    fn whole_puts_a_key_frame_back_to_where_its_readings_say() {
        let (mut atlas, ids) = ToAndFro { turn_rad: 0.5, tilt_rad: 0.0, factor: 1.0 }.map(12);
        let truth = atlas.latest().key_frame(ids[6]).unwrap().world_from_camera;
        let wrong = Se3::new(truth.rotation, truth.translation + Vec3::new(0.03, -0.02, 0.02));
        atlas.commit(vec![Change::MoveKeyFrame(ids[6], wrong)]);
        let config = WindowConfig { iterations: [20, 10], tolerance: 1e-6, ..WindowConfig::default() };
        let inertial = inertial();
        let whole = to_end(inertial.whole(atlas.latest(), &mono(), MapId(ids[0]), &config, || false));
        let result = whole.unwrap();
        atlas.commit(result.changes.changes);
        let off = (atlas.latest().key_frame(ids[6]).unwrap().world_from_camera.translation
            - truth.translation)
            .norm();
        assert!(off < 2e-3, "{off} m");
    }

    #[test]
    fn align_or_refine_gives_a_map_of_vision_metres_and_gravity_and_its_motions_velocities() {
        let (mut atlas, ids) = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 2.0 }.map_of_vision(60);
        let mut inertial = inertial();
        inertial.clocks.adopt(0.0, 1e-4, 0.0);
        let root = MapId(ids[0]);
        let mut aligned_with = None;
        for n in 2..ids.len() {
            to_end(inertial.align_or_refine(&mut atlas, &mono(), ids[n], &WindowConfig::default()));
            if atlas.latest().is_gravity_aligned(root) {
                aligned_with = Some(n);
                break;
            }
        }
        let n = aligned_with.expect("never aligned");
        let k = |i: usize| atlas.latest().key_frame(ids[i]).unwrap();
        let far = |i: usize| (k(i).world_from_camera.translation - k(0).world_from_camera.translation).norm();
        let truth = (position(STEP_S * 8.0) - position(0.0)).norm();
        assert!((far(8) / truth - 1.0).abs() < 0.03, "{} m of {truth}", far(8));
        // y of the camera is down.
        let down = k(0).world_from_camera.rotation * Vec3::y();
        assert!(down.angle(&-Vec3::z()) < 0.01, "{down:?}");
        let t = STEP_S * n as f64;
        let speed = (position(t + 1e-3) - position(t - 1e-3)).norm() / 2e-3;
        let found = k(n).motion.as_ref().unwrap().velocity.norm();
        assert!((found - speed).abs() < 0.05, "{found} m/s of {speed}");
    }

    #[test]
    fn align_or_refine_estimates_again_with_readings_shifted_by_an_offset_that_is_far() {
        let walk = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 2.0 };
        let (mut atlas, ids) = walk.map_of_vision(60);
        let mut inertial = inertial();
        (1..ids.len()).for_each(|n| inertial.clocks.take(&walk.segment(n, -0.03)));
        atlas.commit(inertial.clocks.recompute_factors(atlas.latest(), &ids, 0.0));
        let of = CameraAndImu {
            camera: &mono(),
            imu: &inertial.imu,
            offset_sigma_s: inertial.clocks.sigma_s(),
            lever_arm_sigma: 0.0,
        };
        let first = to_end(of.attempt(atlas.latest(), &ids, INITIALISATION_S)).unwrap().found.unwrap();
        let (camera, config) = (mono(), WindowConfig::default());
        let attempt = to_end(inertial.align_or_refine_chain(&mut atlas, &camera, &ids, &config));
        let again = attempt.unwrap().found.unwrap();
        let off = [&first, &again].map(|found| (2.0 * found.scale).ln().abs());
        let left = (atlas.latest().imu_offset() - 0.03).abs();
        println!("scale off by {off:?}, offset {} at first, then {left} s off", first.offset_s);
        assert!(is_far_offset(&first) && off[1] < 0.5 * off[0], "{off:?}");
        assert!(left < 1e-3, "{left} s");
    }

    #[test]
    fn align_gravity_turns_and_scales_about_the_fixed_point() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 2.0 }.map_of_vision(48);
        let inertial = inertial();
        let of =
            CameraAndImu { camera: &mono(), imu: &inertial.imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        let found = to_end(of.attempt(atlas.latest(), &ids, INITIALISATION_S)).unwrap().found.unwrap();
        let (map, centre) = (MapId(ids[0]), Vec3::new(0.5, -0.2, 1.0));
        for metric in [false, true] {
            let changes = inertial.align_gravity(atlas.latest(), map, &ids, &found, metric, centre);
            let Change::AlignGravity(of, turn) = &changes[0] else { panic!("{:?}", changes[0]) };
            assert_eq!(*of, map);
            assert!((*turn * centre - centre).norm() < 1e-9);
            let scale = if metric { 1.0 } else { 0.5 };
            assert!((turn.scale / scale - 1.0).abs() < 0.02, "{}", turn.scale);
            assert!((turn.rotation * Vec3::y()).angle(&-Vec3::z()) < 0.01);
            assert_eq!(changes.len(), 1 + ids.len(), "and a velocity for each key frame");
        }
    }

    #[test]
    fn a_map_knows_the_lever_arm_of_its_own_rig_better() {
        let stated = Se3::new(So3::identity(), Vec3::new(0.01, 0.0, 0.0));
        let found =
            |by: Vec3, turned: f64| Se3::new(So3::exp(&(Vec3::z() * turned)), stated.translation + by);
        let unknown = InertialConfig { lever_arm_sigma: 0.04, ..InertialConfig::default() };
        let near = found(Vec3::new(0.05, -0.07, 0.0), 0.0);
        assert_eq!(unknown.mount(stated, Some(&near)), near);
        assert_eq!(InertialConfig::default().mount(stated, Some(&near)), stated, "it is as stated");
        for of_another in [None, Some(found(Vec3::x() * 0.2, 0.0)), Some(found(Vec3::zeros(), 0.01))] {
            assert_eq!(unknown.mount(stated, of_another.as_ref()), stated);
        }
    }

    #[test]
    fn a_scale_known_to_ten_per_cent_is_taken_where_it_may_be_rough() {
        let gates = |sigma| {
            vec![Gate::new(GateKind::ScaleSigma, sigma, 0.03), Gate::new(GateKind::GyroBias, 0.5, 0.3)]
        };
        let failed = |sigma| {
            let mut attempt = Attempt { gates: gates(sigma), found: None };
            soften(&mut attempt);
            attempt.failed().map(|gate| gate.kind).collect::<Vec<_>>()
        };
        assert_eq!(failed(0.09), [GateKind::GyroBias], "nothing else is softened");
        assert_eq!(failed(0.11), [GateKind::ScaleSigma, GateKind::GyroBias]);
    }

    #[test]
    fn a_map_without_metres_is_tried_with_each_key_frame_at_first_and_later_as_it_gets_longer() {
        let mut inertial = inertial();
        let mut tried = |map: u32, from_s: f64, to_s: f64| {
            let times = (0..).map(|n| from_s + 0.06 * f64::from(n)).take_while(|t| *t < to_s);
            let map = MapId(KeyFrameId::from_index(map as usize).unwrap());
            times.filter(|t| inertial.is_due(map, Stamp::from_seconds(*t), *t)).count()
        };
        assert_eq!(tried(0, 0.0, 4.99), 84, "each of them");
        let later = tried(0, 5.0, 20.0);
        assert!((20..35).contains(&later), "{later} of 250");
        assert_eq!(tried(0, 100.0, 110.0), 10, "once a second");
        assert_eq!(tried(1, 110.0, 110.1), 1, "another map at once");
    }

    #[test]
    fn chain_is_what_factors_link_up_to_a_key_frame() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.5, tilt_rad: 0.0, factor: 1.0 }.map(6);
        assert_eq!(chain(atlas.latest(), ids[4]), ids[..=4]);
        assert_eq!(chain(atlas.latest(), ids[0]), [ids[0]]);
    }

    #[test]
    fn update_time_offset_finds_late_readings_and_makes_the_factors_anew() {
        let walk = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 1.0 };
        let (mut atlas, ids) = walk.map_of_vision(40);
        let mut inertial = inertial();
        let before = atlas.latest().clone();
        for n in 1..ids.len() {
            inertial.clocks.take(&walk.segment(n, -0.02));
            inertial.update_time_offset(&mut atlas, ids[n]);
        }
        let offset = atlas.latest().imu_offset();
        assert!((offset - 0.02).abs() < 2e-3, "{offset} s");
        let sum = |s: &Snapshot| {
            s.key_frame(ids[4]).unwrap().motion.as_ref().unwrap().imu_factor.clone().unwrap().sum
        };
        assert!(!Arc::ptr_eq(&sum(&before), &sum(atlas.latest())), "factors from before it was known");
    }

    #[test]
    fn settle_clocks_takes_over_an_offset_that_was_found_with_the_scale() {
        let walk = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 1.0 };
        let (atlas, ids) = walk.map_of_vision(40);
        let mut inertial = inertial();
        (1..ids.len()).for_each(|n| inertial.clocks.take(&walk.segment(n, 0.0)));
        let of =
            CameraAndImu { camera: &mono(), imu: &inertial.imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        let found = to_end(of.attempt(atlas.latest(), &ids, INITIALISATION_S)).unwrap().found.unwrap();
        let exact = Initial { offset_s: 0.0, offset_sigma_s: 1e-3, ..found.clone() };
        assert!(inertial.settle_clocks(atlas.latest(), &ids, &exact).is_empty());
        let late = Initial { offset_s: 0.01, offset_sigma_s: 1e-3, ..found };
        let changes = inertial.settle_clocks(atlas.latest(), &ids, &late);
        assert!(
            matches!(changes[0], Change::ImuOffset(offset) if (offset - 0.01).abs() < 1e-12),
            "{:?}",
            changes[0]
        );
        assert!(changes.len() > 30 && changes[1..].iter().all(|c| matches!(c, Change::ImuFactor(..))));
    }
}
