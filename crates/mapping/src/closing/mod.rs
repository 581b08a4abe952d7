//! Closing: places that were seen before are recognised, loops are closed, worlds are merged.
//!
//! In: a snapshot of the map and a key frame in it. Out: changes made on that snapshot, and a verdict on each candidate
//! with its numbers. Nothing is forced: what fails a check is refused and told.

mod adrift;
mod correct;
mod draft;
mod relax;
mod seek;

use crate::grow::median_depth;
use crate::inertial::InertialSetting;
use adrift::adrift;
use cairn_adjust::{
    Feeling, InertialWindow, RecogniseSetting, Recognised, Unlike, Window, WindowSetting, recognise,
};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, Map, WorldId};
use cairn_geometry::{Se3, Sim3, Vec3, YawPose};
use cairn_sensor::ImuSensor;
use cairn_vision::EyeModel;
use draft::Draft;
use relax::relax;
use std::collections::BTreeSet;
use std::fmt;

/// Scale that may have been lost between two visits of one world, and between two worlds, as a logarithm.
const MOST_SCALE: [f64; 2] = [0.7, 2.5];

/// How far two visits may differ on where down is, radians.
const MOST_TILT_RAD: f64 = 0.09;

/// How to close.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CloserSetting {
    /// Whether loops are closed and worlds merged at all.
    pub enabled: bool,
    /// Places compared for each key frame, at most.
    pub candidates: usize,
    /// Matches that must agree.
    pub need: usize,
    /// The drift that is plausible, as a share of the way between the two visits, with metric scale and without.
    pub drift: [f64; 2],
    /// Key frames up to which a world is adjusted as a whole after a loop.
    pub whole_key_frames: usize,
}

impl Default for CloserSetting {
    fn default() -> Self {
        Self { enabled: true, candidates: 3, need: 40, drift: [0.05, 0.05], whole_key_frames: 500 }
    }
}

/// Why a candidate was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// It does not look like the place, or its geometry does not fit.
    Unlike(Unlike),
    /// Too few points have a depth on both sides, or those depths do not agree on one scale.
    Scale {
        /// Points with both depths.
        points: usize,
        /// Median of the scale.
        median: f64,
        /// Spread of it: median absolute deviation of the logarithm.
        spread: f64,
    },
    /// Both places know where down is, and do not agree on it.
    Tilt {
        /// By how much they differ, radians.
        tilt_rad: f64,
    },
    /// The map would have to be off by more than it can have drifted.
    Drift {
        /// By how much it would have to be off, units of the map.
        off: f64,
        /// What is plausible after the way between.
        plausible: f64,
    },
    /// It fits, and waits for another key frame that says the same.
    Alone,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unlike(why) => why.fmt(f),
            Self::Scale { points, median, spread } => {
                write!(f, "{points} points give a scale of {median:.3} with a spread of {spread:.3}")
            }
            Self::Tilt { tilt_rad } => {
                write!(f, "down would be off by {:.1} degrees", tilt_rad.to_degrees())
            }
            Self::Drift { off, plausible } => {
                write!(f, "the map would be off by {off:.2}, {plausible:.2} is plausible")
            }
            Self::Alone => write!(f, "waits for a second key frame that says the same"),
        }
    }
}

/// What a place seen again leads to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Joined {
    /// A loop in one world was closed.
    Loop,
    /// Two worlds became one.
    Merge {
        /// The younger, whose name goes.
        from: WorldId,
        /// The older.
        into: WorldId,
    },
}

/// A candidate that was looked at closely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// The key frame.
    pub key_frame: KeyFrameId,
    /// The earlier key frame that may show the same place.
    pub candidate: KeyFrameId,
    /// What came of it.
    pub result: Result<Accepted, Refusal>,
}

/// The numbers of a place recognised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accepted {
    /// What it led to.
    pub joined: Joined,
    /// Landmarks of the earlier visit that agree.
    pub inliers: usize,
    /// Of so many that should be in view.
    pub expected: usize,
    /// How far the key frame was off, units of the map.
    pub off: f64,
    /// By how much, radians.
    pub off_rad: f64,
    /// Length there for each length here.
    pub scale: f64,
}

/// What closing has to say of a key frame.
#[derive(Clone, Debug, Default)]
pub struct Closed {
    /// To commit, made on the snapshot that was given.
    pub changes: Vec<Change>,
    /// Of each candidate.
    pub verdicts: Vec<Verdict>,
    /// A key frame in the world that was joined and should be adjusted as a whole when there is time.
    pub joined: Option<KeyFrameId>,
}

/// What drifts, and so may be corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Freedom {
    /// Place and heading: down and scale are known.
    Level,
    /// Place and direction.
    Metric,
    /// Place, direction and scale.
    Similar,
}

/// Where a key frame stands, with the down that its own world knows.
fn level(here: &KeyFrame, world_from_here: &Sim3) -> Result<Sim3, Refusal> {
    let turn = world_from_here.rotation * here.world_from_eye.rotation.inverse();
    let tilt_rad = (turn * Vec3::z()).angle(&Vec3::z());
    if tilt_rad > MOST_TILT_RAD {
        return Err(Refusal::Tilt { tilt_rad });
    }
    let heading = YawPose::split(&Se3::new(turn, Vec3::zeros())).0.rotation();
    let rotation = heading * here.world_from_eye.rotation;
    Ok(Sim3::new(rotation, world_from_here.translation, world_from_here.scale))
}

/// A place seen again that waits for a second opinion.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    key_frame: KeyFrameId,
    old: KeyFrameId,
    /// Moves what is believed to where the earlier visit puts it.
    shift: Sim3,
}

/// The closing stage.
#[derive(Debug)]
pub struct Closer {
    eye: EyeModel,
    setting: CloserSetting,
    window: WindowSetting,
    /// The inertial sensor, and the key frames up to which a world is adjusted as a whole with what was felt.
    felt: Option<(Feeling, usize)>,
    pending: Option<Hypothesis>,
}

impl Closer {
    /// A closer for one eye; `window` is how mapping adjusts its windows.
    pub fn new(eye: EyeModel, setting: CloserSetting, window: WindowSetting) -> Self {
        Self { eye, setting, window, felt: None, pending: None }
    }

    /// The same with an inertial sensor; `imu_from_eye` in metres.
    pub fn feeling(self, sensor: &ImuSensor, imu_from_eye: Se3, setting: InertialSetting) -> Self {
        let feeling = Feeling { imu_from_eye, noise: sensor.noise.times([setting.noise_times; 2]) };
        Self { felt: Some((feeling, setting.whole_key_frames)), ..self }
    }

    /// Looks whether a key frame shows a place that was seen before, and joins what is the same.
    pub fn step(&mut self, map: &Map, id: KeyFrameId) -> Closed {
        let mut closed = Closed::default();
        let Some(here) = map.key_frame(id).filter(|_| self.setting.enabled) else { return closed };
        for old in seek::candidates(map, here, self.reach(map, here), self.setting.candidates) {
            let judged = self.judge(map, here, old);
            let result = match judged {
                Ok((place, world_from_here)) => {
                    let (changes, accepted) = self.join(map, here, &place, &world_from_here);
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

    /// All checks of one candidate; the place and where the key frame stands there.
    fn judge(&mut self, map: &Map, here: &KeyFrame, old: KeyFrameId) -> Result<(Recognised, Sim3), Refusal> {
        let known: BTreeSet<_> = here.landmarks.iter().flatten().copied().collect();
        let setting = RecogniseSetting { seed: self.setting.need / 2, need: self.setting.need, share: 0.5 };
        let seed = here.id.index() as u64;
        let place =
            recognise(map, &self.eye, &here.frame, old, &known, &setting, seed).map_err(Refusal::Unlike)?;
        let scale = self.scale(map, here, &place)?;
        let there = place.world_from_eye;
        let mut world_from_here = Sim3::new(there.rotation, there.translation, scale);
        if self.freedom(map, here, old) == Freedom::Level {
            world_from_here = level(here, &world_from_here)?;
        }
        let shift = world_from_here * Sim3::from(here.world_from_eye).inverse();
        let plausible = self.plausible(map, here, old);
        let off = (there.translation - here.world_from_eye.translation).norm();
        let there = map.key_frame(old).map_or(here.world, |k| k.world);
        let same_world = there == here.world;
        let plausible = if same_world { plausible } else { plausible + adrift(map, here, there, scale) };
        if off > plausible {
            return Err(Refusal::Drift { off, plausible });
        }
        // A small correction, well within the drift, is no news; a large one, or a merge, is asked twice.
        let small = same_world && off < 0.2 * plausible;
        let seconded = self.pending.is_some_and(|p| self.agrees(map, &p, here, old, &shift));
        if !small && !seconded {
            self.pending = Some(Hypothesis { key_frame: here.id, old, shift });
            return Err(Refusal::Alone);
        }
        self.pending = None;
        Ok((place, world_from_here))
    }

    /// What may be off between two visits.
    fn freedom(&self, map: &Map, here: &KeyFrame, old: KeyFrameId) -> Freedom {
        let level = map.key_frame(old).is_some_and(|k| map.is_level(k.world) && map.is_level(here.world));
        match (level, self.eye.has_depth()) {
            (true, _) => Freedom::Level,
            (false, true) => Freedom::Metric,
            (false, false) => Freedom::Similar,
        }
    }

    /// How near a key frame must be believed to be looked at for its place alone.
    fn reach(&self, map: &Map, here: &KeyFrame) -> f64 {
        match self.eye.has_depth() {
            true => self.eye.close_depth / 3.0,
            false => median_depth(map, here).unwrap_or(0.0),
        }
    }

    /// Length in the earlier world for each length here, by the depths of the points that both know.
    fn scale(&self, map: &Map, here: &KeyFrame, place: &Recognised) -> Result<f64, Refusal> {
        let (eye_from_here, eye_from_there) = (here.world_from_eye.inverse(), place.world_from_eye.inverse());
        let both = here.landmarks.iter().zip(&place.landmarks).filter_map(|(mine, theirs)| {
            let mine = eye_from_here * map.landmark((*mine)?)?.position;
            let theirs = eye_from_there * map.landmark((*theirs)?)?.position;
            (mine.z > 0.0 && theirs.z > 0.0).then(|| (theirs.z / mine.z).ln())
        });
        let mut logs: Vec<f64> = both.collect();
        let points = logs.len();
        let (median, spread) = median_and_spread(&mut logs);
        let metric = self.freedom(map, here, place.old) != Freedom::Similar;
        let merging = map.key_frame(place.old).is_some_and(|k| k.world != here.world);
        let most = MOST_SCALE[usize::from(merging)];
        let refusal = Refusal::Scale { points, median: median.exp(), spread };
        if points < self.setting.need / 4 {
            // With depth, a view that shares no points yet still has its scale.
            return if metric { Ok(1.0) } else { Err(refusal) };
        }
        // What the inertial sensor told of scale is good to some percent.
        let most_metric = if self.eye.has_depth() { 0.1 } else { 0.2 };
        match metric {
            true if median.abs() < most_metric => Ok(1.0),
            false if spread < 0.15 && median.abs() < most => Ok(median.exp()),
            _ => Err(refusal),
        }
    }

    /// How far a key frame may be off after the way since an earlier one.
    fn plausible(&self, map: &Map, here: &KeyFrame, old: KeyFrameId) -> f64 {
        // In order of birth: from one world to the next the tie leads on.
        let since: Vec<Se3> = map
            .key_frames()
            .filter(|k| k.id >= old.min(here.id) && k.id <= here.id.max(old))
            .map(|k| k.world_from_eye)
            .collect();
        let way: f64 = since.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).sum();
        let [with, without] = self.setting.drift;
        match self.freedom(map, here, old) != Freedom::Similar {
            true => 0.5 + with * way,
            false => 0.3 * median_depth(map, here).unwrap_or(0.0) + without * way,
        }
    }

    /// Whether an earlier hypothesis said the same: another key frame, near this one in time, was to be moved alike.
    fn agrees(&self, map: &Map, p: &Hypothesis, here: &KeyFrame, old: KeyFrameId, shift: &Sim3) -> bool {
        let world = |id| map.key_frame(id).map(|k| k.world);
        if p.key_frame == here.id || world(p.old) != world(old) || world(p.key_frame) != Some(here.world) {
            return false;
        }
        if here.id.index().abs_diff(p.key_frame.index()) > 8 {
            return false;
        }
        let (a, b) = (*shift * here.world_from_eye.translation, p.shift * here.world_from_eye.translation);
        let turned = (shift.rotation.inverse() * p.shift.rotation).angle();
        let depth = median_depth(map, here).unwrap_or(0.0);
        (a - b).norm() < 0.1 * depth * shift.scale
            && turned < 0.1
            && (shift.scale / p.shift.scale).ln().abs() < 0.15
    }

    /// Joins what is the same: the worlds or the two ends of the loop, then the landmarks, then adjusts around.
    fn join(
        &self,
        map: &Map,
        here: &KeyFrame,
        place: &Recognised,
        world_from_here: &Sim3,
    ) -> (Vec<Change>, Accepted) {
        let mut draft = Draft::new(map);
        let before = Sim3::from(here.world_from_eye);
        let shift = *world_from_here * before.inverse();
        let off = (world_from_here.translation - here.world_from_eye.translation).norm();
        let off_rad = shift.rotation.angle();
        let there = map.key_frame(place.old).map_or(here.world, |k| k.world);
        let joined = if there == here.world {
            let freedom = self.freedom(map, here, place.old);
            let metre = match freedom {
                Freedom::Similar => 0.25 * median_depth(map, here).unwrap_or(0.0),
                _ => 1.0,
            };
            draft.push(relax(map, here, place.old, world_from_here, metre, freedom));
            draft.push(vec![Change::Link(here.id, place.old)]);
            Joined::Loop
        } else {
            let (from, into) = (here.world.max(there), here.world.min(there));
            correct::merge(&mut draft, here, place.old, &shift);
            Joined::Merge { from, into }
        };
        correct::fuse(&mut draft, &self.eye, here.id, place);
        let weld =
            WindowSetting { key_frames: 2 * self.window.key_frames, right_offset_sigma: 0.0, ..self.window };
        if let Some(window) = Window::around(draft.map(), &self.eye, here.id, &weld) {
            draft.push(window.solve(&weld, || false).changes.changes);
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

    /// Adjusts a world as a whole. `stop` is asked before each step; nothing is handed back when it said true.
    pub fn adjust_whole(&self, map: &Map, world: WorldId, mut stop: impl FnMut() -> bool) -> Vec<Change> {
        let count = map.key_frames_of(world).count();
        if !(3..=self.setting.whole_key_frames).contains(&count) {
            return Vec::new();
        }
        let window = WindowSetting { iterations: [10, 10], ..self.window };
        let mut stopped = false;
        let asked = || {
            stopped |= stop();
            stopped
        };
        let felt = self.felt.filter(|(_, most)| count <= *most && map.is_level(world));
        let felt = felt.map(|(feeling, _)| InertialWindow::whole(map, &self.eye, &feeling, world));
        let settled = match felt.filter(|w| w.links() > 0) {
            Some(felt) => felt.solve(&window, asked),
            None => Window::whole(map, &self.eye, world).solve(&window, asked),
        };
        if stopped { Vec::new() } else { settled.changes.changes }
    }
}

/// Median and median absolute deviation; zeros for nothing.
fn median_and_spread(values: &mut [f64]) -> (f64, f64) {
    if values.is_empty() {
        return (0.0, 0.0);
    }
    let middle = values.len() / 2;
    let median = *values.select_nth_unstable_by(middle, f64::total_cmp).1;
    values.iter_mut().for_each(|v| *v = (*v - median).abs());
    (median, *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
