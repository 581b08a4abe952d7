//! A window of key frames and landmarks, copied out of a map with whatever factors are added, adjusted, and handed back as changes.

use crate::factor::{Judgement, WindowFactors};
use crate::subproblem::Subproblem;
use crate::{calibration, corner, pinhole};
use cairn_atlas::{Change, ChangeSet, KeyFrameId, MapId, Readout, Snapshot};
use cairn_settings::Settings;
use cairn_solve::{Bundle, BundleConfig, Factors, Freedom, Moves, Report, pause, to_end};
use cairn_vision::RectifiedCamera;
use std::mem::take;

/// How large a window may be and how long it is solved.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct WindowConfig {
    /// Key frames that a local bundle adjustment moves, at most.
    #[setting(default = 16, range = 2..=1000)]
    pub key_frames: usize,
    /// Fixed key frames that also observe its landmarks, at most.
    #[setting(default = 24, range = 1..=10000)]
    pub anchors: usize,
    /// Maximum number of steps before outliers are left out, and after.
    #[setting(default = [5, 6], range = 1..=1000)]
    pub iterations: [usize; 2],
    /// Converged when a step lowers the cost by less than this part of it.
    #[setting(default = 1e-4, range = 0.0..=1.0)]
    pub tolerance: f64,
    /// Standard deviation in pixels of the disparity error of the stereo calibration, which windows estimate around
    /// the map's value; 0 keeps that value. While the map's value is zero, windows report where it would move, and
    /// leave it.
    #[setting(default = 0.2, range = 0.0..=5.0)]
    pub right_offset_sigma: f64,
    /// True to keep key frames where tracking found them and to move landmarks only. So it is where depth gives the poses
    /// (`tracker.dense`), which then know more than features do.
    #[setting(default = false)]
    pub hold_poses: bool,
}

/// A copied window.
pub struct Window {
    subproblem: Subproblem,
    bundle: Bundle,
    factors: Vec<Box<dyn WindowFactors>>,
    /// The readout time of the rows as the map has it.
    readout: Readout,
}

/// A window to which factors are added before it is copied.
pub struct WindowBuilder<'a> {
    snapshot: &'a Snapshot,
    camera: &'a RectifiedCamera,
    factors: Vec<Box<dyn WindowFactors>>,
    /// Of each kind of factors, whether there is no window without.
    needed: Vec<bool>,
    joined: bool,
}

/// A window after its solve.
#[derive(Clone, Debug)]
pub struct WindowResult {
    /// What to commit: moved key frames and landmarks, motions, and outlier observations to be removed.
    pub changes: ChangeSet,
    /// Report of the last solve.
    pub report: Report,
    /// Variance of the residuals of observations, in units of what their weights say.
    pub residual_variance: f64,
    /// How far the disparity error would have moved where it was held, pixels.
    pub right_offset_pull: f64,
    /// Information on the estimated disparity error, 1/px^2; 0 where it was not estimated.
    pub right_offset_information: f64,
}

impl<'a> WindowBuilder<'a> {
    /// With a kind of factors; where the window has none of them it is solved without.
    // The word of factor graphs, with which nothing is summed.
    #[allow(clippy::should_implement_trait)]
    pub fn add(self, factors: impl WindowFactors + 'static) -> Self {
        self.with(Box::new(factors), false)
    }

    /// With a kind of factors without which there is no window.
    pub fn need(self, factors: impl WindowFactors + 'static) -> Self {
        self.with(Box::new(factors), true)
    }

    fn with(mut self, factors: Box<dyn WindowFactors>, needed: bool) -> Self {
        self.factors.push(factors);
        self.needed.push(needed);
        self
    }

    /// Of maps that are joined: observations count less whose feature is of another size than the landmark has there. In a window with
    /// depth they do in any case.
    pub fn joined(self) -> Self {
        Self { joined: true, ..self }
    }

    /// The window around a key frame: it and the key frames that share most landmarks with it move, and so do all landmarks
    /// they observe; other key frames that observe those landmarks hold them in place. `None` for an unknown key frame.
    pub fn around(self, centre: KeyFrameId, config: &WindowConfig) -> Option<Window> {
        let k = self.snapshot.key_frame(centre)?;
        let chains = self.factors.iter().map(|f| f.chain(self.snapshot, centre));
        let chains = chains.collect::<Option<Vec<_>>>()?;
        let mut moving = vec![centre];
        for id in chains.iter().flat_map(|chain| &chain.moving) {
            if !moving.contains(id) {
                moving.push(*id);
            }
        }
        let stays = |id: &KeyFrameId| chains.iter().any(|chain| chain.before == Some(*id));
        let shared = k.covisible.iter().map(|(id, _)| *id).filter(|id| !stays(id));
        for id in shared.take(config.key_frames) {
            if moving.len() < config.key_frames && !moving.contains(&id) {
                moving.push(id);
            }
        }
        self.of((k.map, Some(centre)), &moving, config.anchors)
    }

    /// The window in which every key frame of a map moves but its root. `None` for an unknown map.
    pub fn whole(self, map: MapId) -> Option<Window> {
        let all: Vec<KeyFrameId> = self.snapshot.key_frames_of(map).map(|k| k.id).collect();
        if all.is_empty() { None } else { self.of((map, None), &all, 0) }
    }

    fn of(
        mut self,
        about: (MapId, Option<KeyFrameId>),
        moving: &[KeyFrameId],
        anchors: usize,
    ) -> Option<Window> {
        let snapshot = self.snapshot;
        let mut subproblem = Subproblem::of(snapshot, about, moving, anchors);
        let frames = &mut subproblem.frames;
        self.factors.iter_mut().for_each(|f| f.choose(snapshot, frames));
        frames.fix_one();
        for (factors, needed) in self.factors.iter_mut().zip(&self.needed) {
            if factors.bind(snapshot, frames) == 0 && *needed {
                return None;
            }
        }
        let mut bundle = bundle(snapshot, self.camera, &mut subproblem);
        let Subproblem { frames, landmarks, .. } = &subproblem;
        corner::weigh(&mut bundle, snapshot, &frames.key_frames, landmarks, self.joined);
        Some(Window { subproblem, bundle, factors: self.factors, readout: snapshot.readout() })
    }
}

impl Window {
    /// Begins one of a map: `Window::of(snapshot, camera).add(factors).around(key_frame, &config)`.
    pub fn of<'a>(snapshot: &'a Snapshot, camera: &'a RectifiedCamera) -> WindowBuilder<'a> {
        WindowBuilder { snapshot, camera, factors: Vec::new(), needed: Vec::new(), joined: false }
    }

    /// How many factors it has beside observations that relate several variables.
    pub fn links(&self) -> usize {
        let mut links = 0;
        self.factors.scopes(&mut |scope| links += usize::from(scope.len() > 1));
        links
    }

    /// Solves the window: robustly, then without the outliers. `stop` is asked before each step.
    pub fn solve(self, config: &WindowConfig, stop: impl FnMut() -> bool) -> WindowResult {
        to_end(self.solve_in_slices(config, stop))
    }

    /// The same, with a pause after each part of a step.
    pub async fn solve_in_slices(
        mut self,
        config: &WindowConfig,
        mut stop: impl FnMut() -> bool,
    ) -> WindowResult {
        pause().await;
        if config.hold_poses {
            self.bundle.freedom.fill(Freedom::Fixed);
        }
        // Of several rigs each has an error of its own: that which was found stays.
        let several = self.bundle.own_cameras.iter().any(Option::is_some);
        for c in self.bundle.calibrations.iter_mut().filter(|c| c.moves == Moves::Disparity) {
            c.sigma = if several { 0.0 } else { config.right_offset_sigma };
        }
        let has_factors = !Factors::is_empty(self.factors.as_slice());
        let before = has_factors.then(|| self.bundle.clone());
        let mut report = self.adjust(config, &mut stop).await;
        if let Some(before) = before {
            self.judge(&before, config, &mut report, &mut stop).await;
        }
        let cost = match Factors::is_empty(self.factors.as_slice()) {
            true => report.cost_after,
            false => self.bundle.observation_cost(true),
        };
        pause().await;
        self.leave_out_outliers();
        let disparity = self.bundle.calibrations.iter().find(|c| c.moves == Moves::Disparity);
        WindowResult {
            changes: ChangeSet { base: self.subproblem.base, changes: self.changes() },
            report,
            residual_variance: self.bundle.residual_variance(cost),
            right_offset_pull: disparity.filter(|c| c.held).map_or(0.0, |c| c.pull),
            right_offset_information: disparity.map_or(0.0, |c| c.information),
        }
    }

    /// Asks each kind of factors what it says of the poses, and solves again where one contradicts them.
    async fn judge(
        &mut self,
        before: &Bundle,
        config: &WindowConfig,
        report: &mut Report,
        stop: &mut impl FnMut() -> bool,
    ) {
        for kind in 0..self.factors.len() {
            let judgement = self.factors[kind].judge(&before.poses, &self.bundle.poses);
            if judgement == Judgement::Agrees {
                continue;
            }
            self.bundle = before.clone();
            if judgement == Judgement::PosesWereRight {
                self.bundle.freedom.fill(Freedom::Fixed);
                self.factors.clear();
            }
            *report = self.adjust(config, stop).await;
            if self.factors.is_empty() {
                return;
            }
        }
    }

    /// Robustly, then without the outliers.
    async fn adjust(&mut self, config: &WindowConfig, stop: &mut impl FnMut() -> bool) -> Report {
        let [before, after] = config.iterations;
        let mut report = self.minimise(config, before, stop).await;
        if after > 0 && !stop() {
            self.leave_out_outliers();
            let first = report.cost_before;
            report = self.minimise(config, after, stop).await;
            report.cost_before = first;
        }
        report
    }

    async fn minimise(
        &mut self,
        config: &WindowConfig,
        iterations: usize,
        stop: &mut impl FnMut() -> bool,
    ) -> Report {
        let first_damping = self.factors.iter().map(|f| f.first_damping()).fold(1e-5, f64::min);
        let config = BundleConfig { iterations, robust: true, tolerance: config.tolerance, first_damping };
        self.bundle.solve_in_slices(self.factors.as_mut_slice(), &config, stop).await
    }

    fn leave_out_outliers(&mut self) {
        for i in 0..self.bundle.observations.len() {
            let o = self.bundle.observations[i];
            if self.bundle.chi2_of(i) > Bundle::bound(&o) {
                self.bundle.observations[i].weight = 0.0;
            }
        }
        self.factors.iter_mut().for_each(|f| f.leave_out_outliers(&self.bundle.poses));
    }

    fn changes(&self) -> Vec<Change> {
        let (bundle, Subproblem { frames, landmarks, .. }) = (&self.bundle, &self.subproblem);
        let mut changes = Vec::new();
        for (slot, id) in frames.key_frames.iter().enumerate() {
            if bundle.freedom[slot] != Freedom::Fixed {
                changes.push(Change::MoveKeyFrame(*id, bundle.poses[slot]));
            }
        }
        changes.extend(self.factors.iter().flat_map(|f| f.changes(frames, &bundle.poses)));
        let moved = landmarks.iter().zip(&bundle.points);
        changes.extend(moved.map(|(id, point)| Change::MoveLandmark(*id, *point)));
        changes.extend(calibration::changes(&self.readout, &bundle.calibrations));
        changes.extend(self.subproblem.forgotten(&bundle.observations));
        changes
    }
}

/// The bundle of a subproblem, which hands over its points and observations.
fn bundle(snapshot: &Snapshot, camera: &RectifiedCamera, subproblem: &mut Subproblem) -> Bundle {
    let Subproblem { frames, points, observations, slopes, .. } = subproblem;
    let own = |id: &KeyFrameId| {
        let k = snapshot.key_frame(*id)?;
        k.other_camera.as_ref().map(|other| pinhole(&other.camera))
    };
    let mixed = snapshot.other_cameras().next().is_some();
    let own_cameras = if mixed { frames.key_frames.iter().map(own).collect() } else { Vec::new() };
    Bundle {
        camera: pinhole(camera),
        own_cameras,
        poses: frames.poses.clone(),
        freedom: frames.freedom.clone(),
        points: take(points),
        observations: take(observations),
        calibrations: calibration::variables(snapshot, take(slopes)),
    }
}
