//! Loop closing and map merging: places seen before are recognised, loops are closed, maps are merged.
//!
//! Input: a snapshot and one of its key frames. Output: changes to that snapshot, and a verdict on each candidate
//! with its numbers. A candidate that fails a check is refused and reported.

mod candidates;
mod correct;
mod draft;
mod hypothesis;
mod join;
mod relax;
mod relocation_prior;
mod scales;
#[cfg(test)]
mod tests;
mod verdict;
mod visits;

use crate::depth_views::DepthViews;
use crate::inertial::InertialConfig;
use crate::triangulation::median_depth;
use crate::windows;
use cairn_adjust::{
    Imu, ImuModel, MotionLinks, RecogniseConfig, Recognised, View, Window, WindowBuilder, WindowConfig,
    recognise,
};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3};
use cairn_sensor::ImuSensor;
use cairn_settings::Settings;
use cairn_solve::{pause, to_end};
use cairn_vision::RectifiedCamera;
use draft::Draft;
use hypothesis::Hypothesis;
pub use join::{
    Adjust, Agreement, Apart, INDEPENDENT_M, INDEPENDENT_RAD, Junction, MapComparison, MapJoin, SAME_PLACE_M,
    SAME_WAY_COS, Seam, Support,
};
use relax::{Freedom, Loop, relax};
use relocation_prior::{prior_displacement, prior_rotation};
pub use scales::{FusedScales, ScaleConflict};
use std::collections::BTreeSet;
pub use verdict::{Accepted, Closed, Joined, Refusal, Verdict};
use visits::{Visits, metre_in_map_units, with_gravity_of};

/// Configuration of loop closing and map merging.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct CloserConfig {
    /// Whether loops are closed and maps merged at all.
    #[setting(default = true)]
    pub enabled: bool,
    /// Candidate places compared for each key frame, at most.
    #[setting(default = 3, range = 1..=100)]
    pub candidates: usize,
    /// Inlier matches needed to accept a place.
    #[setting(default = 40, range = 10..=10000)]
    pub need: usize,
    /// The plausible drift as a share of the distance travelled between the two visits, with metric scale and
    /// without.
    #[setting(default = [0.05, 0.05], range = 0.0..=10.0)]
    pub drift: [f64; 2],
    /// Largest map, in key frames, that is adjusted as a whole after a loop; 0: never.
    #[setting(default = 1000, range = 0..=10000)]
    pub whole_key_frames: usize,
}

/// The closing stage.
#[derive(Debug)]
pub struct Closer {
    camera: RectifiedCamera,
    config: CloserConfig,
    window: WindowConfig,
    /// The IMU, and the largest map in key frames that is adjusted as a whole with IMU factors.
    imu: Option<(ImuModel, usize)>,
    pending: Option<Hypothesis>,
    links: MotionLinks,
    depth_views: Option<DepthViews>,
}

/// By how much the pose of features may differ from that of depth, metres and radians: where depth was not registered to the
/// picture exactly (7-Scenes: 0.06 m and 0.06 rad in a kitchen).
const HELD_M: f64 = 0.1;
const HELD_RAD: f64 = 0.1;

impl Closer {
    /// A closer for a camera; `window` is the configuration of mapping's windows.
    pub fn new(camera: RectifiedCamera, config: CloserConfig, window: WindowConfig) -> Self {
        let links = MotionLinks::default();
        Self { camera, config, window, imu: None, pending: None, links, depth_views: None }
    }

    /// Adds an IMU; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, config: InertialConfig) -> Self {
        Self { imu: Some((config.model(&sensor.noise, imu_from_camera), config.whole_key_frames)), ..self }
    }

    /// Adds the IMUs whose readings a snapshot holds, where it is known how cameras are mounted on them.
    pub fn with_imu_of(self, snapshot: &Snapshot, config: InertialConfig) -> Self {
        let noise = |k: &KeyFrame| Some(*k.motion.as_ref()?.imu_factor.as_ref()?.sum.noise());
        let mut of_atlas = snapshot.key_frames().filter(|k| k.other_camera.is_none()).filter_map(noise);
        let mut of_others = snapshot
            .key_frames()
            .filter_map(|k| noise(k).zip(k.other_camera.as_ref().and_then(|other| other.imu_from_camera)));
        // Where the atlas's camera has none, its place in the model is that of another one, and nothing refers to it.
        let of = match of_atlas.next() {
            Some(noise) => snapshot.imu_from_camera().map(|mount| (noise, *mount)),
            None => of_others.next(),
        };
        let model = of.map(|(noise, mount)| config.model(&noise, mount));
        Self { imu: model.map(|model| (model, config.whole_key_frames)), ..self }
    }

    /// Adds the motions that other sensors measured between key frames.
    pub fn with_motion_links(self, links: MotionLinks) -> Self {
        Self { links, ..self }
    }

    /// Adds the depth of key frames: before a whole map is adjusted, it is aligned.
    pub fn with_depth_views(self, depth_views: DepthViews) -> Self {
        Self { depth_views: Some(depth_views), ..self }
    }

    /// Checks whether a key frame shows a place seen before, and closes the loop or merges the maps if so.
    pub fn step(&mut self, snapshot: &Snapshot, id: KeyFrameId) -> Closed {
        to_end(self.step_in_slices(snapshot, id))
    }

    /// The same, with pauses between and within the candidates.
    pub async fn step_in_slices(&mut self, snapshot: &Snapshot, id: KeyFrameId) -> Closed {
        let mut closed = Closed::default();
        if self.depth_views.as_ref().is_some_and(|views| views.is_held(id)) {
            (self.window.hold_poses, self.depth_views) = (true, None);
        }
        if let Some(views) = &self.depth_views {
            views.drop_removed(snapshot);
        }
        let Some(here) = snapshot.key_frame(id).filter(|_| self.config.enabled) else { return closed };
        let (reach, most) = (self.reach(snapshot, here), self.config.candidates);
        for old in candidates::candidates(snapshot, &self.camera, here, reach, most) {
            pause().await;
            let judged = self.judge(snapshot, here, old);
            pause().await;
            let result = match judged {
                Ok((place, world_from_here, scales)) => {
                    let joined = self.join(snapshot, here, &place, &world_from_here, scales);
                    let (changes, accepted) = joined.await;
                    closed.changes = changes;
                    closed.joined = Some(id);
                    Ok(accepted)
                }
                Err(refusal) => Err(refusal),
            };
            closed.verdicts.push(Verdict { key_frame: id, candidate: old, result });
            if result.is_ok() {
                break;
            }
        }
        closed
    }

    /// Runs all checks of one candidate; returns the recognised place, the pose of the key frame there, and how the scales of two maps
    /// with metres fit.
    fn judge(
        &mut self,
        snapshot: &Snapshot,
        here: &KeyFrame,
        old: KeyFrameId,
    ) -> Result<(Recognised, Sim3, Option<FusedScales>), Refusal> {
        let known: BTreeSet<_> = here.landmarks.iter().flatten().copied().collect();
        let config = RecogniseConfig { seed: self.config.need / 2, need: self.config.need, share: 0.5 };
        let seed = here.id.index() as u64;
        let view = View::of(&self.camera, here);
        let place = recognise(snapshot, &view, old, &known, &config, seed).map_err(Refusal::MatchFailure)?;
        let visits = self.visits(snapshot, here, old);
        let ratio = visits.depth_ratio(&place);
        let scale = visits.scale(&ratio, self.config.need)?;
        let scales = visits.fused_scales(&ratio, self.config.need)?;
        let scale = scales.map_or(scale, |scales| scales.ratio());
        let there = place.world_from_camera;
        let mut world_from_here = Sim3::new(there.rotation, there.translation, scale);
        if visits.freedom() == Freedom::AlignGravity {
            world_from_here = with_gravity_of(here, &world_from_here)?;
        }
        let shift = world_from_here * Sim3::from(here.world_from_camera).inverse();
        let plausible = visits.plausible_drift(self.config.drift);
        let off = (there.translation - here.world_from_camera.translation).norm();
        let there = snapshot.key_frame(old).map_or(here.map, |k| k.map);
        let same_map = there == here.map;
        let plausible =
            if same_map { plausible } else { plausible + prior_displacement(snapshot, here, there, scale) };
        if off > plausible {
            return Err(Refusal::Drift { off, plausible });
        }
        let prior_rad = if same_map { 0.0 } else { prior_rotation(snapshot, here, there) };
        let (off_rad, plausible_rad) = (shift.rotation.angle(), visits.plausible_turn_rad() + prior_rad);
        if off_rad > plausible_rad {
            return Err(Refusal::Turned { off_rad, plausible_rad });
        }
        if same_map && visits.contradicts_motion(&self.links, &place.world_from_camera) {
            return Err(Refusal::Measured { off, off_rad });
        }
        if self.window.hold_poses && same_map && off < HELD_M && off_rad < HELD_RAD {
            return Err(Refusal::Held { off, off_rad });
        }
        // A small correction, well within the drift, needs no confirmation; a large one, or a merge, does.
        let is_small = same_map && off < 0.2 * plausible;
        let confirmed = self.pending.is_some_and(|p| p.agrees(snapshot, here, old, &shift));
        if !is_small && !confirmed {
            self.pending = Some(Hypothesis { key_frame: here.id, old, shift });
            return Err(Refusal::Alone);
        }
        self.pending = None;
        Ok((place, world_from_here, scales))
    }

    /// A key frame and an earlier one.
    fn visits<'a>(&'a self, snapshot: &'a Snapshot, here: &'a KeyFrame, old: KeyFrameId) -> Visits<'a> {
        Visits { snapshot, camera: &self.camera, here, old }
    }

    /// Distance within which a key frame is a candidate by its estimated position alone.
    fn reach(&self, snapshot: &Snapshot, here: &KeyFrame) -> f64 {
        let camera = here.camera(&self.camera);
        match camera.has_depth() {
            true => camera.close_depth / 3.0,
            false => median_depth(snapshot, here).unwrap_or(0.0),
        }
    }

    /// Closes the loop or merges the maps, then fuses the landmarks, then adjusts around the key frame.
    async fn join(
        &self,
        snapshot: &Snapshot,
        here: &KeyFrame,
        place: &Recognised,
        world_from_here: &Sim3,
        scales: Option<FusedScales>,
    ) -> (Vec<Change>, Accepted) {
        let mut draft = Draft::new(snapshot);
        let before = Sim3::from(here.world_from_camera);
        let shift = *world_from_here * before.inverse();
        let off = (world_from_here.translation - here.world_from_camera.translation).norm();
        let off_rad = shift.rotation.angle();
        let there = snapshot.key_frame(place.old).map_or(here.map, |k| k.map);
        let joined = if there == here.map {
            let freedom = self.visits(snapshot, here, place.old).freedom();
            let metre_in_map_units = metre_in_map_units(snapshot, here, freedom);
            let found = Loop { here: here.id, old: place.old, world_from_here: *world_from_here };
            draft.push(relax(snapshot, here.map, &[found], None, metre_in_map_units, freedom, |_| false));
            draft.push(vec![Change::Link(here.id, place.old)]);
            Joined::Loop
        } else {
            let (from, into) = (here.map.max(there), here.map.min(there));
            correct::merge(&mut draft, here, place.old, &shift);
            if let Some(scales) = scales {
                let unit = if into == there { scales.there } else { scales.here };
                draft.push(scales.after_merge(snapshot, [there, here.map], into, unit));
            }
            Joined::Merge { from, into }
        };
        pause().await;
        correct::fuse(&mut draft, &self.camera, &[(here.id, place)]);
        pause().await;
        let config =
            WindowConfig { key_frames: 2 * self.window.key_frames, right_offset_sigma: 0.0, ..self.window };
        let window = Window::of(draft.snapshot(), &self.camera).add(self.links.factors());
        if let Some(window) = window.around(here.id, &config) {
            draft.push(window.solve_in_slices(&config, || false).await.changes.changes);
        }
        let accepted = Accepted {
            joined,
            inliers: place.inliers,
            expected: place.expected,
            off,
            off_rad,
            scale: world_from_here.scale,
        };
        (draft.into_changes(), accepted)
    }

    /// Adjusts a map as a whole. `stop` is called before each step; once it has returned true, no changes are
    /// returned.
    pub fn adjust_whole(&self, snapshot: &Snapshot, map: MapId, stop: impl FnMut() -> bool) -> Vec<Change> {
        to_end(self.adjust_whole_in_slices(snapshot, map, stop))
    }

    /// The same in slices.
    pub async fn adjust_whole_in_slices(
        &self,
        snapshot: &Snapshot,
        map: MapId,
        stop: impl FnMut() -> bool,
    ) -> Vec<Change> {
        self.adjust_whole_with(snapshot, map, |window| window, stop).await
    }

    /// The same with a window of which more is said.
    async fn adjust_whole_with(
        &self,
        snapshot: &Snapshot,
        map: MapId,
        with: impl Fn(WindowBuilder) -> WindowBuilder,
        mut stop: impl FnMut() -> bool,
    ) -> Vec<Change> {
        let count = snapshot.key_frames_of(map).count();
        if !(3..=self.config.whole_key_frames).contains(&count) {
            return Vec::new();
        }
        let window = WindowConfig { iterations: [10, 10], ..self.window };
        let mut stopped = false;
        let mut stop_requested = || {
            stopped |= stop();
            stopped
        };
        let mut draft = Draft::new(snapshot);
        if let Some(views) = &self.depth_views {
            draft.push(views.measure(snapshot, map, &mut stop_requested));
        }
        let snapshot = draft.snapshot();
        let imu = self.imu.filter(|(_, most)| count <= *most && snapshot.is_gravity_aligned(map));
        let of = || with(Window::of(snapshot, &self.camera));
        let imu = imu.and_then(|(imu, _)| windows::inertial_whole(of(), Imu::new(imu), map));
        let whole = imu.or_else(|| windows::whole(of(), &self.links, map));
        let mut changes = Vec::new();
        if let Some(whole) = whole {
            changes = whole.solve_in_slices(&window, stop_requested).await.changes.changes;
        }
        let mut all = draft.into_changes();
        all.extend(changes);
        if stopped { Vec::new() } else { all }
    }
}
