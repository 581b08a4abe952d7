//! What the inertial sensor adds to mapping: links between key frames, gravity and scale of a world once they are known,
//! and windows in which what was felt counts too.
//!
//! A world is mapped by eye alone until gravity, scale and biases are found ([`cairn_inertial::initialise`], tried beside
//! the map); it is then levelled, adjusted as a whole with its links, and again as it grows. Nothing is thrown
//! away meanwhile, and if they are never found, mapping by eye goes on.

use crate::clocks::Clocks;
use crate::grow::median_depth;
use cairn_adjust::{ImuModel, Window, WindowConfig, WindowResult};
use cairn_atlas::{
    Atlas, Change, ImuFactor, ImuSegment, InertialState, KeyFrame, KeyFrameId, MapId, Snapshot,
};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::{
    Attempt, Gate, GateKind, InitialiseConfig, Preintegrated, Scale, Seen, SeenPose, initialise,
};
use cairn_sensor::{ImuNoise, ImuSensor, Stamp};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;
use std::sync::Arc;

/// How what is felt is used.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InertialConfig {
    /// Whether the inertial sensor is used, where there is one.
    pub enabled: bool,
    /// What to multiply the sensor's white noise with until more is known: real sensors on real hands are worse than their
    /// data sheets.
    pub noise_times: f64,
    /// Key frames, one felt after the other, that a local adjustment moves.
    pub chain: usize,
    /// Key frames up to which a world is adjusted as a whole with its links.
    pub whole_key_frames: usize,
}

impl Default for InertialConfig {
    fn default() -> Self {
        Self { enabled: false, noise_times: 5.0, chain: 10, whole_key_frames: 2000 }
    }
}

/// Standard deviation of a key frame's direction in a map that was adjusted, pixels; its place is as uncertain as this at
/// the median depth.
const SEEN_PIXELS: f64 = 0.5;
/// Relative standard deviation of the scale of eyes with depth.
const DEPTH_SCALE_SIGMA: f64 = 0.003;
/// Key frames of the last so many seconds are tried.
const TRIED_S: f64 = 20.0;
/// Seconds after the first key frame felt at which a level world is adjusted as a whole again.
const REFINED_S: [f64; 6] = [5.0, 10.0, 15.0, 25.0, 40.0, 60.0];

/// Slower than this the eye stands still, m/s.
const STANDS_M_S: f64 = 0.05;

/// Mapping's share of the inertial sensor.
#[derive(Debug)]
pub(crate) struct Inertial {
    /// As its data sheet has it.
    sheet: ImuNoise,
    imu: ImuModel,
    pub config: InertialConfig,
    clocks: Clocks,
    /// For each level world how often it was adjusted as a whole.
    refined: BTreeMap<MapId, usize>,
}

impl Inertial {
    pub fn new(sensor: &ImuSensor, imu_from_camera: Se3, config: InertialConfig) -> Self {
        let noise = sensor.noise.times([config.noise_times; 2]);
        let imu = ImuModel { imu_from_camera, noise };
        let clocks = Clocks::new(sensor);
        Self { sheet: sensor.noise, imu, config, clocks, refined: BTreeMap::new() }
    }

    /// The motion of a new key frame, linked to the one before in its world where the readings begin there.
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
            .filter(|k| imu.offset_s != snapshot.imu_offset() || Some(k.frame.stamp) == begins);
        // In the sensor's own clock: what was offered may have been cut for another offset.
        let imu_factor = before.and_then(|k| {
            let sum = self.clocks.preintegrated(imu.bias, k.frame.stamp, stamp, snapshot.imu_offset())?;
            Some(ImuFactor { since: k.id, sum: Arc::new(sum) })
        });
        InertialState { velocity: imu.velocity, bias: imu.bias, imu_factor }
    }

    /// The same, linked to a key frame that is known.
    pub fn motion_since(&mut self, before: Option<KeyFrameId>, imu: &ImuSegment) -> InertialState {
        self.clocks.take(imu);
        let imu_factor = before.filter(|_| imu.samples.len() > 1).map(|since| ImuFactor {
            since,
            sum: Arc::new(Preintegrated::of(self.sheet, imu.bias, imu.samples.clone())),
        });
        InertialState { velocity: imu.velocity, bias: imu.bias, imu_factor }
    }

    /// The local window of a level world.
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
        let chain = self.config.chain;
        let window = Window::inertial_around(snapshot, camera, &self.imu, centre, chain, config)?;
        (window.links() > 0).then_some(window)
    }

    /// Adjusts a level world as a whole with its links; nothing where there are none or it is too large.
    pub fn whole(
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
        let window = Window::inertial_whole(snapshot, camera, &self.imu, map);
        (window.links() > 0).then(|| window.solve(config, stop))
    }

    /// Levels the world of a key frame when that can be done, or refines it when that is due; what was tried.
    pub fn final_adjustment(
        &mut self,
        atlas: &mut Atlas,
        camera: &RectifiedCamera,
        centre: KeyFrameId,
        config: &WindowConfig,
    ) -> Option<Attempt> {
        self.tell_time(atlas, centre);
        let snapshot = atlas.latest().clone();
        let map = snapshot.key_frame(centre)?.map;
        let chain = chain(&snapshot, centre);
        let (first, last) = (snapshot.key_frame(*chain.first()?)?, snapshot.key_frame(centre)?);
        let seconds = last.frame.stamp - first.frame.stamp;
        let mut tried = None;
        if snapshot.is_gravity_aligned(map) {
            let times = self.refined.entry(map).or_insert(REFINED_S.len());
            // Who stands still learns nothing new, and shall not feel the map move.
            let stands = last.motion.as_ref().is_none_or(|m| m.velocity.norm() < STANDS_M_S);
            if stands || REFINED_S.get(*times).is_none_or(|due| seconds < *due) {
                return None;
            }
            *times += 1;
        } else {
            let mut attempt = self.attempt(&snapshot, camera, &chain)?;
            let compared = f64::from(u8::from(self.clocks.final_result()));
            attempt.gates.push(Gate::new(GateKind::Clocks, compared, 1.0));
            let found = attempt.accepted().cloned();
            tried = Some(attempt);
            let Some(found) = found else { return tried };
            let found_times = found.noise_times.map(|t| t.max(self.config.noise_times));
            self.clocks.turned();
            self.imu.noise = self.sheet.times(found_times);
            let about = snapshot.world_from_camera(map.root())?.translation;
            atlas.commit(self.level(&snapshot, map, &chain, &found, camera.has_depth(), about));
            self.refined.insert(map, REFINED_S.iter().filter(|due| seconds >= **due).count());
        }
        let config = WindowConfig { iterations: [8, 6], tolerance: 1e-4, ..*config };
        if let Some(final_result) = self.whole(atlas.latest(), camera, map, &config, || false) {
            atlas.commit(final_result.changes.changes);
        }
        tried
    }

    /// Looks for the offset of the clocks, and cuts anew what was felt when it is found. Where the sensor is late, the last
    /// readings up to a key frame come with the next one.
    fn tell_time(&mut self, atlas: &mut Atlas, centre: KeyFrameId) {
        let snapshot = atlas.latest().clone();
        let known = snapshot.imu_offset();
        let chain = chain(&snapshot, centre);
        if let Some(offset) = self.clocks.look(&self.imu.imu_from_camera.rotation, known) {
            let mut changes = vec![Change::ImuOffset(offset)];
            changes.extend(self.clocks.cut(&snapshot, &chain, offset));
            atlas.commit(changes);
        } else if known < 0.0 {
            let late = &chain[chain.len().saturating_sub(3)..chain.len().saturating_sub(1).max(1)];
            atlas.commit(self.clocks.cut(&snapshot, late, known));
        }
    }

    fn attempt(
        &self,
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        chain: &[KeyFrameId],
    ) -> Option<Attempt> {
        let frames: Vec<&KeyFrame> = chain.iter().filter_map(|id| snapshot.key_frame(*id)).collect();
        let last = frames.last()?.frame.stamp;
        let frames: Vec<&KeyFrame> = frames.into_iter().filter(|k| last - k.frame.stamp <= TRIED_S).collect();
        let poses: Vec<SeenPose> = frames
            .iter()
            .map(|k| SeenPose { stamp: k.frame.stamp, world_from_camera: k.world_from_camera })
            .collect();
        let links: Option<Vec<Preintegrated>> = frames
            .iter()
            .skip(1)
            .map(|k| Some((*k.motion.as_ref()?.imu_factor.as_ref()?.sum).clone()))
            .collect();
        let rotation_sigma = SEEN_PIXELS / camera.fx;
        let position_sigma = rotation_sigma * median_depth(snapshot, frames.last()?)?;
        let seen = Seen { poses: &poses, rotation_sigma, position_sigma };
        let scale = match camera.has_depth() {
            true => Scale::Known { sigma: DEPTH_SCALE_SIGMA },
            false => Scale::Free,
        };
        // The library raises the noise itself, from the data sheet's on.
        let config = InitialiseConfig { noise_times: 1.0, ..InitialiseConfig::default() };
        Some(initialise(&seen, &links?, &self.imu.imu_from_camera, scale, &config))
    }

    /// The changes that level a world about a place that stays.
    fn level(
        &self,
        snapshot: &Snapshot,
        map: MapId,
        chain: &[KeyFrameId],
        found: &cairn_inertial::Initial,
        metric: bool,
        about: Vec3,
    ) -> Vec<Change> {
        let turn = found.metric_from_map();
        let scale = if metric { 1.0 } else { turn.scale };
        let shift = about - turn.rotation * about * scale;
        let mut changes = vec![Change::AlignGravity(map, Sim3::new(turn.rotation, shift, scale))];
        let last = chain.last().and_then(|id| snapshot.key_frame(*id)).map(|k| k.frame.stamp);
        let tried = |id: &&KeyFrameId| {
            snapshot
                .key_frame(**id)
                .zip(last)
                .is_some_and(|(k, last): (_, Stamp)| last - k.frame.stamp <= TRIED_S)
        };
        for (id, state) in chain.iter().filter(tried).zip(&found.states) {
            let world_from_camera = state.world_from_imu * self.imu.imu_from_camera;
            let velocity = world_from_camera.rotation.inverse() * state.velocity;
            changes.push(Change::InertialState(*id, velocity, found.bias));
        }
        changes
    }
}

/// Key frames one felt after the other up to one, oldest first.
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
