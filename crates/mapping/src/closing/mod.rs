//! Loop closing and map merging: places seen before are recognised, loops are closed, maps are merged.
//!
//! Input: a snapshot and one of its key frames. Output: changes to that snapshot, and a verdict on each candidate
//! with its numbers. A candidate that fails a check is refused and reported.

mod candidates;
mod correct;
mod draft;
mod join;
mod relax;
mod relocation_prior;
#[cfg(test)]
mod tests;

use crate::inertial::InertialConfig;
use crate::triangulation::median_depth;
use cairn_adjust::{
    ImuModel, MatchFailure, MotionLinks, RecogniseConfig, Recognised, View, Window, WindowConfig,
    has_parallax, recognise,
};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, Vec3, YawPose};
use cairn_sensor::ImuSensor;
use cairn_settings::Settings;
use cairn_vision::RectifiedCamera;
use draft::Draft;
pub use join::{Agreement, Apart, Junction, MapComparison, MapJoin, Seam, Support};
use relax::{Freedom, Loop, relax};
use relocation_prior::{prior_displacement, prior_rotation};
use std::collections::BTreeSet;
use std::fmt;

/// Largest logarithm of the scale change between two visits of one map, and between two maps.
const MAX_LOG_SCALE: [f64; 2] = [0.7, 2.5];

/// Largest angle between the gravity directions of two visits, radians.
const MAX_TILT_RAD: f64 = 0.09;

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

/// Why a candidate was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// The appearance or the geometry does not match.
    MatchFailure(MatchFailure),
    /// Too few points have a depth on both sides, or those depths do not agree on one scale.
    Scale {
        /// Points with both depths.
        points: usize,
        /// Median of the scale.
        median: f64,
        /// Its spread: median absolute deviation of the logarithm.
        spread: f64,
    },
    /// Both maps are gravity-aligned, and their gravity directions disagree.
    Tilt {
        /// Angle between them, radians.
        tilt_rad: f64,
    },
    /// The correction is larger than the plausible drift.
    Drift {
        /// The correction, map units.
        off: f64,
        /// The plausible drift over the distance travelled in between, map units.
        plausible: f64,
    },
    /// The correction rotates the camera by more than can have drifted: rooms that look similar from several sides.
    Turned {
        /// The rotation, radians.
        off_rad: f64,
        /// The plausible drift, radians.
        plausible_rad: f64,
    },
    /// Other sensors measured a motion since the earlier visit that it contradicts: what was recognised has moved meanwhile.
    Measured {
        /// The correction, metres.
        off: f64,
        /// The rotation, radians.
        off_rad: f64,
    },
    /// Depth gives the poses (`mapper.window.hold_poses`), and the correction is no larger than features may differ from it by
    /// an error of the calibration.
    Held {
        /// The correction, metres.
        off: f64,
        /// The rotation, radians.
        off_rad: f64,
    },
    /// All checks passed; waits for confirmation by another key frame.
    Alone,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MatchFailure(why) => why.fmt(f),
            Self::Scale { points, median, spread } => {
                write!(f, "{points} points give a scale of {median:.3} with a spread of {spread:.3}")
            }
            Self::Tilt { tilt_rad } => {
                write!(f, "the gravity directions differ by {:.1} degrees", tilt_rad.to_degrees())
            }
            Self::Held { off, off_rad } => write!(
                f,
                "the correction would be {off:.2} m and {:.1} degrees: features may differ from depth by as much",
                off_rad.to_degrees()
            ),
            Self::Measured { off, off_rad } => write!(
                f,
                "the correction would be {off:.2} m and {:.1} degrees, against the motion measured since",
                off_rad.to_degrees()
            ),
            Self::Drift { off, plausible } => {
                write!(f, "the correction would be {off:.2}, at most {plausible:.2} is plausible")
            }
            Self::Turned { off_rad, plausible_rad } => write!(
                f,
                "the correction would turn by {:.0} degrees, at most {:.0} is plausible",
                off_rad.to_degrees(),
                plausible_rad.to_degrees()
            ),
            Self::Alone => write!(f, "waits for confirmation by a second key frame"),
        }
    }
}

/// The result of recognising a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Joined {
    /// A loop in one map was closed.
    Loop,
    /// Two maps became one.
    Merge {
        /// The younger, whose id is retired.
        from: MapId,
        /// The older.
        into: MapId,
    },
}

/// A candidate that was verified, and the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// The key frame.
    pub key_frame: KeyFrameId,
    /// The earlier key frame that may show the same place.
    pub candidate: KeyFrameId,
    /// The numbers when accepted, or why it was refused.
    pub result: Result<Accepted, Refusal>,
}

/// The numbers of an accepted candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accepted {
    /// What was joined.
    pub joined: Joined,
    /// Landmarks of the earlier visit that are inliers.
    pub inliers: usize,
    /// Landmarks of the earlier visit that should be in view.
    pub expected: usize,
    /// Distance by which the key frame was corrected, map units.
    pub off: f64,
    /// Angle by which it was corrected, radians.
    pub off_rad: f64,
    /// Scale: length in the earlier map for each length here.
    pub scale: f64,
}

/// The result of closing for one key frame.
#[derive(Clone, Debug, Default)]
pub struct Closed {
    /// The changes to commit, made on the given snapshot.
    pub changes: Vec<Change>,
    /// The verdict on each candidate.
    pub verdicts: Vec<Verdict>,
    /// A key frame of the map that was corrected and should be adjusted as a whole when there is time.
    pub joined: Option<KeyFrameId>,
}

/// The recognised pose of a key frame, with roll and pitch taken from its own gravity-aligned map.
fn with_gravity_of(here: &KeyFrame, world_from_here: &Sim3) -> Result<Sim3, Refusal> {
    let turn = world_from_here.rotation * here.world_from_camera.rotation.inverse();
    let tilt_rad = (turn * Vec3::z()).angle(&Vec3::z());
    if tilt_rad > MAX_TILT_RAD {
        return Err(Refusal::Tilt { tilt_rad });
    }
    let heading = YawPose::split(&Se3::new(turn, Vec3::zeros())).0.rotation();
    let rotation = heading * here.world_from_camera.rotation;
    Ok(Sim3::new(rotation, world_from_here.translation, world_from_here.scale))
}

/// A recognised place that waits for confirmation.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    key_frame: KeyFrameId,
    old: KeyFrameId,
    /// Correction from the current estimate to the pose relative to the earlier visit.
    shift: Sim3,
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
}

/// Plausible drift of the orientation in radians: a constant part, and its growth for each key frame in between.
const TURNED_RAD: [f64; 2] = [0.35, 5e-4];

/// By how much the pose of features may differ from that of depth, metres and radians: where depth was not registered to the
/// picture exactly (7-Scenes: 0.06 m and 0.06 rad in a kitchen).
const HELD_M: f64 = 0.1;
const HELD_RAD: f64 = 0.1;

impl Closer {
    /// A closer for a camera; `window` is the configuration of mapping's windows.
    pub fn new(camera: RectifiedCamera, config: CloserConfig, window: WindowConfig) -> Self {
        Self { camera, config, window, imu: None, pending: None, links: MotionLinks::default() }
    }

    /// Adds an IMU; `imu_from_camera` in metres.
    pub fn with_imu(self, sensor: &ImuSensor, imu_from_camera: Se3, config: InertialConfig) -> Self {
        let imu = ImuModel { imu_from_camera, noise: sensor.noise.times([config.noise_times; 2]) };
        Self { imu: Some((imu, config.whole_key_frames)), ..self }
    }

    /// Adds the motions that other sensors measured between key frames.
    pub fn with_motion_links(self, links: MotionLinks) -> Self {
        Self { links, ..self }
    }

    /// Checks whether a key frame shows a place seen before, and closes the loop or merges the maps if so.
    pub fn step(&mut self, snapshot: &Snapshot, id: KeyFrameId) -> Closed {
        let mut closed = Closed::default();
        let Some(here) = snapshot.key_frame(id).filter(|_| self.config.enabled) else { return closed };
        for old in candidates::candidates(snapshot, here, self.reach(snapshot, here), self.config.candidates)
        {
            let judged = self.judge(snapshot, here, old);
            let result = match judged {
                Ok((place, world_from_here)) => {
                    let (changes, accepted) = self.join(snapshot, here, &place, &world_from_here);
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

    /// Runs all checks of one candidate; returns the recognised place and the pose of the key frame there.
    fn judge(
        &mut self,
        snapshot: &Snapshot,
        here: &KeyFrame,
        old: KeyFrameId,
    ) -> Result<(Recognised, Sim3), Refusal> {
        let known: BTreeSet<_> = here.landmarks.iter().flatten().copied().collect();
        let config = RecogniseConfig { seed: self.config.need / 2, need: self.config.need, share: 0.5 };
        let seed = here.id.index() as u64;
        let view = View::of(&self.camera, here);
        let place = recognise(snapshot, &view, old, &known, &config, seed).map_err(Refusal::MatchFailure)?;
        let scale = self.scale(snapshot, here, &place)?;
        let there = place.world_from_camera;
        let mut world_from_here = Sim3::new(there.rotation, there.translation, scale);
        if self.freedom(snapshot, here, old) == Freedom::AlignGravity {
            world_from_here = with_gravity_of(here, &world_from_here)?;
        }
        let shift = world_from_here * Sim3::from(here.world_from_camera).inverse();
        let plausible = self.plausible(snapshot, here, old);
        let off = (there.translation - here.world_from_camera.translation).norm();
        let there = snapshot.key_frame(old).map_or(here.map, |k| k.map);
        let same_map = there == here.map;
        let plausible =
            if same_map { plausible } else { plausible + prior_displacement(snapshot, here, there, scale) };
        if off > plausible {
            return Err(Refusal::Drift { off, plausible });
        }
        let between = here.id.index().abs_diff(old.index());
        let drift_rad = TURNED_RAD[0] + TURNED_RAD[1] * between as f64;
        let prior_rad = if same_map { 0.0 } else { prior_rotation(snapshot, here, there) };
        let (off_rad, plausible_rad) = (shift.rotation.angle(), drift_rad + prior_rad);
        if off_rad > plausible_rad {
            return Err(Refusal::Turned { off_rad, plausible_rad });
        }
        if same_map && self.is_measured_otherwise(snapshot, here, old, &place.world_from_camera) {
            return Err(Refusal::Measured { off, off_rad });
        }
        if self.window.hold_poses && same_map && off < HELD_M && off_rad < HELD_RAD {
            return Err(Refusal::Held { off, off_rad });
        }
        // A small correction, well within the drift, needs no confirmation; a large one, or a merge, does.
        let is_small = same_map && off < 0.2 * plausible;
        let confirmed = self.pending.is_some_and(|p| self.agrees(snapshot, &p, here, old, &shift));
        if !is_small && !confirmed {
            self.pending = Some(Hypothesis { key_frame: here.id, old, shift });
            return Err(Refusal::Alone);
        }
        self.pending = None;
        Ok((place, world_from_here))
    }

    /// Whether the motion measured since an earlier key frame contradicts a pose relative to it. A person who was seen there and is seen
    /// here looks the same.
    fn is_measured_otherwise(
        &self,
        snapshot: &Snapshot,
        here: &KeyFrame,
        old: KeyFrameId,
        world_from_here: &Se3,
    ) -> bool {
        let measured = self.links.between(old, here.id).zip(snapshot.key_frame(old));
        measured.is_some_and(|(motion, old)| {
            !motion.agrees(&(old.world_from_camera.inverse() * *world_from_here))
        })
    }

    /// The degrees of freedom that may have drifted between two visits.
    fn freedom(&self, snapshot: &Snapshot, here: &KeyFrame, old: KeyFrameId) -> Freedom {
        let maps = [Some(here.map), snapshot.key_frame(old).map(|k| k.map)];
        let both = |has: &dyn Fn(MapId) -> bool| maps.iter().all(|map| map.is_some_and(has));
        let metric = both(&|map| snapshot.is_metric_in(map, &self.camera));
        match (both(&|map| snapshot.is_gravity_aligned(map)), metric) {
            (true, _) => Freedom::AlignGravity,
            (false, true) => Freedom::Metric,
            (false, false) => Freedom::Similar,
        }
    }

    /// Distance within which a key frame is a candidate by its estimated position alone.
    fn reach(&self, snapshot: &Snapshot, here: &KeyFrame) -> f64 {
        let camera = here.camera(&self.camera);
        match camera.has_depth() {
            true => camera.close_depth / 3.0,
            false => median_depth(snapshot, here).unwrap_or(0.0),
        }
    }

    /// Scale (length in the earlier map for each length here), by the depths of the points known in both.
    fn scale(&self, snapshot: &Snapshot, here: &KeyFrame, place: &Recognised) -> Result<f64, Refusal> {
        let (camera_from_here, camera_from_there) =
            (here.world_from_camera.inverse(), place.world_from_camera.inverse());
        let metric = self.freedom(snapshot, here, place.old) != Freedom::Similar;
        // A depth that was assumed while a monocular camera turned on the spot gives no information on scale.
        let seen = |id: &Option<LandmarkId>| {
            snapshot.landmark((*id)?).filter(|l| metric || has_parallax(snapshot, l, None))
        };
        let both = here.landmarks.iter().zip(&place.landmarks).filter_map(|(mine, theirs)| {
            let mine = camera_from_here * seen(mine)?.position;
            let theirs = camera_from_there * seen(theirs)?.position;
            (mine.z > 0.0 && theirs.z > 0.0).then(|| (theirs.z / mine.z).ln())
        });
        let mut logs: Vec<f64> = both.collect();
        let points = logs.len();
        let (median, spread) = median_and_spread(&mut logs);
        let merging = snapshot.key_frame(place.old).is_some_and(|k| k.map != here.map);
        let most = MAX_LOG_SCALE[usize::from(merging)];
        let refusal = Refusal::Scale { points, median: median.exp(), spread };
        if points < self.config.need / 4 {
            // With depth, the scale is known even for a view that shares no points yet.
            return if metric { Ok(1.0) } else { Err(refusal) };
        }
        // A scale estimated with the IMU is accurate to a few percent.
        let there = snapshot.key_frame(place.old).unwrap_or(here);
        let depth = [here, there].iter().all(|k| k.camera(&self.camera).has_depth());
        let most_metric = if depth { 0.1 } else { 0.2 };
        match metric {
            true if median.abs() < most_metric => Ok(1.0),
            false if spread < 0.15 && median.abs() < most => Ok(median.exp()),
            _ => Err(refusal),
        }
    }

    /// The plausible drift of a key frame over the distance travelled since an earlier one.
    fn plausible(&self, snapshot: &Snapshot, here: &KeyFrame, old: KeyFrameId) -> f64 {
        // In order of creation: a map prior relates each map to the previous one.
        let since: Vec<Se3> = snapshot
            .key_frames()
            .filter(|k| k.id >= old.min(here.id) && k.id <= here.id.max(old))
            .map(|k| k.world_from_camera)
            .collect();
        let travelled: f64 = since.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).sum();
        let [with, without] = self.config.drift;
        match self.freedom(snapshot, here, old) != Freedom::Similar {
            true => 0.5 + with * travelled,
            false => 0.3 * median_depth(snapshot, here).unwrap_or(0.0) + without * travelled,
        }
    }

    /// Whether the pending hypothesis agrees: another key frame, near this one in time, needs the same
    /// correction.
    fn agrees(
        &self,
        snapshot: &Snapshot,
        p: &Hypothesis,
        here: &KeyFrame,
        old: KeyFrameId,
        shift: &Sim3,
    ) -> bool {
        let map = |id| snapshot.key_frame(id).map(|k| k.map);
        if p.key_frame == here.id || map(p.old) != map(old) || map(p.key_frame) != Some(here.map) {
            return false;
        }
        if here.id.index().abs_diff(p.key_frame.index()) > 8 {
            return false;
        }
        let (a, b) =
            (*shift * here.world_from_camera.translation, p.shift * here.world_from_camera.translation);
        let turned = (shift.rotation.inverse() * p.shift.rotation).angle();
        let depth = median_depth(snapshot, here).unwrap_or(0.0);
        (a - b).norm() < 0.1 * depth * shift.scale
            && turned < 0.1
            && (shift.scale / p.shift.scale).ln().abs() < 0.15
    }

    /// Closes the loop or merges the maps, then fuses the landmarks, then adjusts around the key frame.
    fn join(
        &self,
        snapshot: &Snapshot,
        here: &KeyFrame,
        place: &Recognised,
        world_from_here: &Sim3,
    ) -> (Vec<Change>, Accepted) {
        let mut draft = Draft::new(snapshot);
        let before = Sim3::from(here.world_from_camera);
        let shift = *world_from_here * before.inverse();
        let off = (world_from_here.translation - here.world_from_camera.translation).norm();
        let off_rad = shift.rotation.angle();
        let there = snapshot.key_frame(place.old).map_or(here.map, |k| k.map);
        let joined = if there == here.map {
            let freedom = self.freedom(snapshot, here, place.old);
            let metre_in_map_units = metre_in_map_units(snapshot, here, freedom);
            let found = Loop { here: here.id, old: place.old, world_from_here: *world_from_here };
            draft.push(relax(snapshot, here.map, &[found], None, metre_in_map_units, freedom, |_| false));
            draft.push(vec![Change::Link(here.id, place.old)]);
            Joined::Loop
        } else {
            let (from, into) = (here.map.max(there), here.map.min(there));
            correct::merge(&mut draft, here, place.old, &shift);
            Joined::Merge { from, into }
        };
        correct::fuse(&mut draft, &self.camera, here.id, place);
        let config =
            WindowConfig { key_frames: 2 * self.window.key_frames, right_offset_sigma: 0.0, ..self.window };
        if let Some(window) = Window::around(draft.snapshot(), &self.camera, here.id, &config) {
            draft.push(window.solve(&config, || false).changes.changes);
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
    pub fn adjust_whole(
        &self,
        snapshot: &Snapshot,
        map: MapId,
        mut stop: impl FnMut() -> bool,
    ) -> Vec<Change> {
        let count = snapshot.key_frames_of(map).count();
        if !(3..=self.config.whole_key_frames).contains(&count) {
            return Vec::new();
        }
        let window = WindowConfig { iterations: [10, 10], ..self.window };
        let mut stopped = false;
        let stop_requested = || {
            stopped |= stop();
            stopped
        };
        let imu = self.imu.filter(|(_, most)| count <= *most && snapshot.is_gravity_aligned(map));
        let imu = imu.map(|(imu, _)| Window::inertial_whole(snapshot, &self.camera, &imu, map));
        let result = match imu.filter(|w| w.links() > 0) {
            Some(imu) => imu.solve(&window, stop_requested),
            None => Window::whole(snapshot, &self.camera, map).solve(&window, stop_requested),
        };
        if stopped { Vec::new() } else { result.changes.changes }
    }
}

/// A metre in units of the map of a key frame; where these are unknown, a fourth of the median depth stands for it.
fn metre_in_map_units(snapshot: &Snapshot, here: &KeyFrame, freedom: Freedom) -> f64 {
    match freedom {
        Freedom::Similar => 0.25 * median_depth(snapshot, here).unwrap_or(0.0),
        _ => 1.0,
    }
}

/// Median and median absolute deviation; zeros for an empty slice.
fn median_and_spread(values: &mut [f64]) -> (f64, f64) {
    if values.is_empty() {
        return (0.0, 0.0);
    }
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable_by(middle, f64::total_cmp).1;
    values.iter_mut().for_each(|v| *v = (*v - median).abs());
    (median, *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
