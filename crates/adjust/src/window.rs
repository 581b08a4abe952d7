//! A window of key frames and landmarks, copied out of a map, adjusted, and handed back as changes: visual, or with IMU
//! factors in a gravity-aligned map.

use crate::aligned::AlignedFactors;
use crate::imu::{self, ImuModel};
use crate::links::{Both, LinkFactors};
use crate::motion::MotionLinks;
use crate::pinhole;
use crate::subproblem::Subproblem;
use cairn_atlas::{Change, ChangeSet, KeyFrame, KeyFrameId, MapId, Readout, Snapshot};
use cairn_geometry::Vec3;
use cairn_inertial::{ImuFactors, LevelPrior, MotionFreedom};
use cairn_settings::Settings;
use cairn_solve::{Bundle, BundleConfig, CalibrationError, Factors, Freedom, Report};
use cairn_vision::RectifiedCamera;
use std::mem::take;

/// Standard deviation by which the readout time of the rows may be another one from window to window, seconds: windows share
/// most of what they are of, and it is told anew by each.
const READOUT_WALK_S: f64 = 0.001;

/// Standard deviation of the tilt of a gravity-aligned map before it is adjusted as a whole, where no readings lead to its root, radians:
/// what an initialisation or a recognised place leaves.
const LEVEL_BEFORE_RAD: f64 = 0.01;

/// Pixels, at the level of a landmark's true size, by which its corner is found inside the thing, as a standard deviation of all landmarks.
const OFF_PX: f64 = 2.0;
/// The same in windows with depth, where each observation counts by itself. With two there, maps of simulated walks got better still, and
/// KITTI stereo worse (0.059 m in place of 0.026 m): its disparity error comes out by a fourth smaller.
const OFF_IN_WINDOW_PX: f64 = 1.0;

/// How the errors of the corner of a landmark belong together.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Corner {
    /// Each observation by itself.
    Alone,
    /// It is off to the same side wherever it is seen: of n observations the variance of each is n times that, so that all together say no
    /// more than one.
    Shared,
}

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
#[derive(Clone, Debug)]
pub struct Window {
    subproblem: Subproblem,
    bundle: Bundle,
    /// Weights of the observations by their level alone; empty where they have no other ones.
    by_level: Vec<f64>,
    imu: Option<ImuFactors>,
    link_factors: LinkFactors,
    /// The readout time of the rows as the map has it.
    readout: Readout,
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

impl Window {
    /// The window around a key frame: it and the key frames that share most landmarks with it move, and so do all landmarks
    /// they observe; other key frames that observe those landmarks hold them in place. `None` for an unknown key frame.
    pub fn around(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        centre: KeyFrameId,
        config: &WindowConfig,
    ) -> Option<Self> {
        Self::linked_around(snapshot, camera, centre, config, &MotionLinks::default())
    }

    /// As [`Window::around`], with the motions that other sensors measured between key frames.
    pub fn linked_around(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        centre: KeyFrameId,
        config: &WindowConfig,
        links: &MotionLinks,
    ) -> Option<Self> {
        let covisible = snapshot.key_frame(centre)?.covisible.iter().map(|(id, _)| *id);
        let mut moving = vec![centre];
        moving.extend(covisible.take(config.key_frames.saturating_sub(1)));
        let mut subproblem = Subproblem::of(snapshot, &moving, config.anchors);
        let motion = links.factors(snapshot, &mut subproblem);
        let links = LinkFactors { motion, ..LinkFactors::default() };
        Some(Self::visual(snapshot, camera, subproblem, links))
    }

    /// The window in which every key frame of a map moves but its root, with the poses of key frames relative to others that the map has.
    pub fn whole(snapshot: &Snapshot, camera: &RectifiedCamera, map: MapId) -> Self {
        Self::linked_whole(snapshot, camera, map, &MotionLinks::default())
    }

    /// As [`Window::whole`], with the motions that other sensors measured between key frames which no landmark relates.
    pub fn linked_whole(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        map: MapId,
        links: &MotionLinks,
    ) -> Self {
        let all: Vec<KeyFrameId> = snapshot.key_frames_of(map).map(|k| k.id).collect();
        let mut subproblem = Subproblem::of(snapshot, &all, 0);
        let motion = links.factors(snapshot, &mut subproblem);
        let motion = motion.of_unrelated(snapshot, &subproblem.key_frames);
        let aligned = AlignedFactors::of(snapshot, &subproblem);
        Self::visual(snapshot, camera, subproblem, LinkFactors { motion, aligned })
    }

    /// The window with IMU factors around a key frame of a gravity-aligned map: the last `chain` key frames up to it, one
    /// linked to the next, and those that share most landmarks with it move. The key frame before the chain keeps its pose
    /// and velocity, and other key frames hold the landmarks. `None` for an unknown key frame.
    pub fn inertial_around(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        model: &ImuModel,
        centre: KeyFrameId,
        chain: usize,
        config: &WindowConfig,
    ) -> Option<Self> {
        let mut moving = Vec::new();
        let mut next = Some(centre);
        while let Some(id) = next.filter(|_| moving.len() < chain) {
            moving.push(id);
            next = imu::before(snapshot.key_frame(id)?);
        }
        let shared =
            snapshot.key_frame(centre)?.covisible.iter().map(|(id, _)| *id).filter(|id| Some(*id) != next);
        for id in shared.take(config.key_frames) {
            if moving.len() < config.key_frames && !moving.contains(&id) {
                moving.push(id);
            }
        }
        let root = snapshot.key_frame(centre)?.map.root();
        let mut subproblem = Subproblem::of(snapshot, &moving, config.anchors);
        // The key frame before the chain bounds velocity and biases, whether it observes the same landmarks or not.
        if let Some(id) = next.filter(|id| !subproblem.key_frames.contains(id)) {
            subproblem.poses.push(snapshot.key_frame(id)?.world_from_camera);
            subproblem.key_frames.push(id);
        }
        let moves = subproblem.moving;
        Some(Self::inertial(snapshot, camera, model, subproblem, |slot, k| match k.motion {
            // Its biases may still change.
            Some(_) if Some(k.id) == next => (Freedom::Fixed, MotionFreedom::Biases),
            _ if slot >= moves => (Freedom::Fixed, MotionFreedom::Fixed),
            _ if k.id == root => (Freedom::Fixed, MotionFreedom::Free),
            Some(_) => (Freedom::Free, MotionFreedom::Free),
            None => (Freedom::Free, MotionFreedom::Fixed),
        }))
    }

    /// The window with IMU factors in which every key frame of a gravity-aligned map moves; its root keeps its position and
    /// heading. Where no readings lead to the root, as in a map that another rig goes on with or is joined to, what the map knew of which
    /// way is up counts beside links elsewhere: of a few links a bias of the accelerometer cannot be told from a tilt.
    /// With the poses of key frames relative to others that the map has.
    pub fn inertial_whole(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        model: &ImuModel,
        map: MapId,
    ) -> Self {
        let all: Vec<KeyFrameId> = snapshot.key_frames_of(map).map(|k| k.id).collect();
        let linked = imu::linked(snapshot, map);
        let subproblem = Subproblem::of(snapshot, &all, 0);
        let root = snapshot.key_frame(map.root()).filter(|k| !linked.contains(&k.id));
        let level_prior = root.and_then(|k| {
            let frame = all.iter().position(|id| *id == k.id)?;
            let up = k.world_from_camera.rotation.inverse() * Vec3::z();
            Some(LevelPrior { frame, up, sigma: LEVEL_BEFORE_RAD })
        });
        let aligned = AlignedFactors::of(snapshot, &subproblem);
        let mut window =
            Self::inertial(snapshot, camera, model, subproblem, |_, k| match linked.contains(&k.id) {
                true if k.id == map.root() => (Freedom::Tilt(Vec3::z()), MotionFreedom::Free),
                true => (Freedom::Free, MotionFreedom::Free),
                false if k.id == map.root() => (Freedom::Tilt(Vec3::z()), MotionFreedom::Fixed),
                false => (Freedom::Free, MotionFreedom::Fixed),
            });
        if let Some(imu) = &mut window.imu {
            imu.level_prior = level_prior;
        }
        window.link_factors.aligned = aligned;
        window
    }

    /// The same for maps that are joined, where observations count less whose feature is of another size than the landmark has there. In a
    /// window with depth they do from the start; a few key frames of one camera have little else that tells how far they are apart.
    ///
    /// A corner is found inside the thing that it is the corner of, by about a pixel of its level. Where the level grows as the camera
    /// comes near, that is one place on the thing; where it does not, the place wanders, things seem to grow too fast, and the way past
    /// them becomes too long. It wanders to the same side in all images, so that more of them do not tell more. Without depth they have to:
    /// there is nothing else.
    pub fn weighed_by_size(self, snapshot: &Snapshot) -> Self {
        let corner = if self.has_depth() { Corner::Shared } else { Corner::Alone };
        self.weighed(snapshot, OFF_PX, corner)
    }

    fn weighed_where_depth(self, snapshot: &Snapshot) -> Self {
        if self.has_depth() { self.weighed(snapshot, OFF_IN_WINDOW_PX, Corner::Alone) } else { self }
    }

    fn has_depth(&self) -> bool {
        self.bundle.observations.iter().any(|o| !o.pixel[2].is_nan())
    }

    /// With the variance of observations, a pixel of their level squared, greater by the square of `off_px` times the relative error of
    /// their size.
    fn weighed(mut self, snapshot: &Snapshot, off_px: f64, corner: Corner) -> Self {
        let Self { subproblem, bundle, by_level, .. } = &mut self;
        let observations = &mut bundle.observations;
        if by_level.is_empty() {
            *by_level = observations.iter().map(|o| o.weight).collect();
        }
        let mut shared_by = vec![1.0; bundle.points.len()];
        if corner == Corner::Shared {
            shared_by.fill(0.0);
            observations.iter().for_each(|o| shared_by[o.point as usize] += 1.0);
        }
        let landmarks = subproblem.landmarks.iter().map(|id| snapshot.landmark(*id).map(|l| l.max_distance));
        let farthest: Vec<Option<f64>> = landmarks.collect();
        let key_frames = subproblem.key_frames.iter().map(|id| snapshot.key_frame(*id));
        let focal_ratios: Vec<f64> = key_frames.map(|k| k.map_or(1.0, KeyFrame::focal_ratio)).collect();
        for (o, by_level) in observations.iter_mut().zip(by_level) {
            let (point, pose) = (o.point as usize, o.pose as usize);
            let distance = (bundle.points[point] - bundle.poses[pose].translation).norm();
            let expected = farthest[point].unwrap_or(0.0) * focal_ratios[pose] / distance;
            // An observation weighs as the inverse square of the scale of its level.
            let off = off_px * (expected * by_level.sqrt() - 1.0);
            let variance = 1.0 + off * off * shared_by[point];
            o.weight = if expected > 0.0 && variance.is_finite() { *by_level / variance } else { *by_level };
        }
        self
    }

    /// How many IMU links it has.
    pub fn links(&self) -> usize {
        self.imu.as_ref().map_or(0, |imu| imu.links.len())
    }

    /// The root of the map stays, or else, where no key frame would be fixed, the oldest one: something must fix the gauge.
    fn visual(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        mut subproblem: Subproblem,
        mut link_factors: LinkFactors,
    ) -> Self {
        let key_frames = &subproblem.key_frames;
        let root = key_frames.first().and_then(|id| snapshot.key_frame(*id)).map(|k| k.map.root());
        let stays = |i: usize| i >= subproblem.moving || Some(key_frames[i]) == root;
        let mut freedom: Vec<Freedom> =
            (0..key_frames.len()).map(|i| if stays(i) { Freedom::Fixed } else { Freedom::Free }).collect();
        if !freedom.contains(&Freedom::Fixed)
            && let Some(oldest) = (0..key_frames.len()).min_by_key(|i| key_frames[*i])
        {
            freedom[oldest] = Freedom::Fixed;
        }
        link_factors.keep_free(&freedom);
        let bundle = bundle(snapshot, camera, &mut subproblem, freedom);
        let readout = snapshot.readout();
        Self { subproblem, bundle, by_level: Vec::new(), imu: None, link_factors, readout }
            .weighed_where_depth(snapshot)
    }

    fn inertial(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        model: &ImuModel,
        mut subproblem: Subproblem,
        freedom: impl Fn(usize, &KeyFrame) -> (Freedom, MotionFreedom),
    ) -> Self {
        let of = |(slot, id): (usize, &KeyFrameId)| match snapshot.key_frame(*id) {
            Some(k) => freedom(slot, k),
            None => (Freedom::Fixed, MotionFreedom::Fixed),
        };
        let (poses, motions): (Vec<Freedom>, Vec<MotionFreedom>) =
            subproblem.key_frames.iter().enumerate().map(of).unzip();
        let imu = imu::factors(snapshot, model, &subproblem, &poses, &motions);
        let bundle = bundle(snapshot, camera, &mut subproblem, poses);
        let link_factors = LinkFactors::default();
        let readout = snapshot.readout();
        Self { subproblem, bundle, by_level: Vec::new(), imu: Some(imu), link_factors, readout }
            .weighed_where_depth(snapshot)
    }

    /// Solves the window: robustly, then without the outliers. `stop` is asked before each step.
    pub fn solve(mut self, config: &WindowConfig, mut stop: impl FnMut() -> bool) -> WindowResult {
        if config.hold_poses {
            self.bundle.freedom.fill(Freedom::Fixed);
        }
        // Of several rigs each has an error of its own: that which was found stays.
        let several = self.bundle.own_cameras.iter().any(Option::is_some);
        self.bundle.calibration_error.sigma = if several { 0.0 } else { config.right_offset_sigma };
        if !self.bundle.slopes.is_empty() {
            // What is estimated is what has to be added to the map's value.
            let sigma = self.readout.sigma_s.hypot(READOUT_WALK_S).min(Readout::default().sigma_s);
            self.bundle.calibration_error = CalibrationError { sigma, ..CalibrationError::default() };
        }
        let is_linked = !self.link_factors.motion.is_empty() || self.links() > 0;
        let before = is_linked.then(|| self.bundle.clone());
        let motions_before = self.imu.as_ref().map(|imu| imu.motions.clone());
        let mut report = self.adjust(config, &mut stop);
        if let (Some(imu), Some(before), Some(motions)) = (&mut self.imu, &before, motions_before)
            && imu::leave_out_contradicted(imu, &self.bundle.poses)
        {
            // Readings are a witness, not the judge.
            imu.motions = motions;
            self.bundle = before.clone();
            report = self.adjust(config, &mut stop);
        }
        // Observations of something that moves outvoted the measured motion: the poses were right, and landmarks follow.
        if let Some(before) = before
            && !self.link_factors.motion.is_empty()
            && self.link_factors.motion.newly_contradicted(&before.poses, &self.bundle.poses)
        {
            self.bundle = before;
            self.bundle.freedom.fill(Freedom::Fixed);
            self.link_factors = LinkFactors::default();
            report = self.adjust(config, &mut stop);
        }
        let cost = match self.imu.is_none() && self.link_factors.is_empty() {
            true => report.cost_after,
            false => self.bundle.observation_cost(true),
        };
        self.leave_out_outliers();
        let is_stereo = self.bundle.slopes.is_empty();
        let right_offset = Some(self.bundle.calibration_error).filter(|_| is_stereo).unwrap_or_default();
        WindowResult {
            changes: ChangeSet { base: self.subproblem.base, changes: self.changes() },
            report,
            residual_variance: self.bundle.residual_variance(cost),
            right_offset_pull: if right_offset.held { right_offset.pull } else { 0.0 },
            right_offset_information: right_offset.information,
        }
    }

    /// Robustly, then without the outliers.
    fn adjust(&mut self, config: &WindowConfig, stop: &mut impl FnMut() -> bool) -> Report {
        let [before, after] = config.iterations;
        let mut report = self.minimise(config, before, stop);
        if after > 0 && !stop() {
            self.leave_out_outliers();
            let first = report.cost_before;
            report = self.minimise(config, after, stop);
            report.cost_before = first;
        }
        report
    }

    fn minimise(
        &mut self,
        config: &WindowConfig,
        iterations: usize,
        stop: &mut impl FnMut() -> bool,
    ) -> Report {
        // With links even scale may be weakly determined: the first step is damped less.
        let first_damping = if self.imu.is_some() { 1e-6 } else { 1e-5 };
        let config = BundleConfig { iterations, robust: true, tolerance: config.tolerance, first_damping };
        let mut links = self.link_factors.all();
        match &mut self.imu {
            Some(imu) => self.bundle.solve_with(&mut Both(imu, &mut links), &config, stop),
            None => self.bundle.solve_with(&mut links, &config, stop),
        }
    }

    fn leave_out_outliers(&mut self) {
        for i in 0..self.bundle.observations.len() {
            let o = self.bundle.observations[i];
            if self.bundle.chi2_of(i) > Bundle::bound(&o) {
                self.bundle.observations[i].weight = 0.0;
            }
        }
        self.link_factors.aligned.leave_out_outliers(&self.bundle.poses);
    }

    fn changes(&self) -> Vec<Change> {
        let (bundle, subproblem) = (&self.bundle, &self.subproblem);
        let mut changes = Vec::new();
        for (slot, id) in subproblem.key_frames.iter().enumerate() {
            if bundle.freedom[slot] != Freedom::Fixed {
                changes.push(Change::MoveKeyFrame(*id, bundle.poses[slot]));
            }
            if let Some(imu) = &self.imu
                && slot < subproblem.moving
                && imu.motions[slot].freedom == MotionFreedom::Free
            {
                let motion = &imu.motions[slot];
                let velocity = bundle.poses[slot].rotation.inverse() * motion.velocity;
                changes.push(Change::InertialState(*id, velocity, motion.bias));
            }
        }
        for (id, point) in subproblem.landmarks.iter().zip(&bundle.points) {
            changes.push(Change::MoveLandmark(*id, *point));
        }
        let CalibrationError { value, information, .. } = bundle.calibration_error;
        if !bundle.slopes.is_empty() && information > 0.0 {
            let seconds = (self.readout.seconds + value).clamp(-Readout::MOST_S, Readout::MOST_S);
            changes.push(Change::Readout(Readout { seconds, sigma_s: information.sqrt().recip() }));
        } else if bundle.slopes.is_empty()
            && bundle.calibration_error.sigma > 0.0
            && !bundle.calibration_error.held
        {
            changes.push(Change::Calibrate(value));
        }
        changes.extend(subproblem.forgotten(&bundle.observations));
        changes
    }
}

/// The bundle of a subproblem, which hands over its poses, points and observations.
fn bundle(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    subproblem: &mut Subproblem,
    freedom: Vec<Freedom>,
) -> Bundle {
    let offset = snapshot.right_offset();
    let calibration_error = CalibrationError {
        value: offset,
        prior: offset,
        // A calibration that nothing has refuted is kept.
        held: offset == 0.0,
        ..CalibrationError::default()
    };
    let own = |id: &KeyFrameId| {
        let k = snapshot.key_frame(*id)?;
        k.other_camera.as_ref().map(|other| pinhole(&other.camera))
    };
    let mixed = snapshot.other_cameras().next().is_some();
    let own_cameras = if mixed { subproblem.key_frames.iter().map(own).collect() } else { Vec::new() };
    Bundle {
        camera: pinhole(camera),
        own_cameras,
        poses: take(&mut subproblem.poses),
        freedom,
        points: take(&mut subproblem.points),
        observations: take(&mut subproblem.observations),
        calibration_error,
        slopes: take(&mut subproblem.slopes),
    }
}
