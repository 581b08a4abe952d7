//! A window of key frames and landmarks, copied out of a map, adjusted, and handed back as changes.

use crate::pinhole;
use crate::subproblem::Subproblem;
use cairn_atlas::{Change, ChangeSet, KeyFrameId, MapId, Snapshot};
use cairn_solve::{Bundle, BundleConfig, Report};
use cairn_vision::RectifiedCamera;

/// How large a window may be and how long it is solved.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WindowConfig {
    /// Key frames that move, at most.
    pub key_frames: usize,
    /// Key frames that stay but are seen from, at most.
    pub anchors: usize,
    /// Steps before outliers are left out, and after.
    pub iterations: [usize; 2],
    /// Stop when a step lowers the cost by less than this part.
    pub tolerance: f64,
    /// Standard deviation in pixels of a disparity error of the stereo calibration, which windows look for, around what the map
    /// has found; 0: that stays. As long as the map has found none, windows tell where it would move, and leave it.
    pub right_offset_sigma: f64,
}

impl Default for WindowConfig {
    fn default() -> Self {
        Self { key_frames: 16, anchors: 24, iterations: [5, 6], tolerance: 1e-4, right_offset_sigma: 0.2 }
    }
}

/// A copied window.
#[derive(Clone, Debug)]
pub struct Window {
    subproblem: Subproblem,
    bundle: Bundle,
}

/// A window after its solve.
#[derive(Clone, Debug)]
pub struct WindowResult {
    /// What to commit: moved key frames and landmarks, observations that do not fit forgotten.
    pub changes: ChangeSet,
    /// Of the last solve.
    pub report: Report,
    /// Variance of the residuals, in units of what their weights say.
    pub residual_variance: f64,
    /// Where it was held, how far the disparity error would have moved, pixels.
    pub right_offset_pull: f64,
    /// Information of the disparity error that was found, 1/px^2; 0 where it was not looked for.
    pub right_offset_information: f64,
}

impl Window {
    /// The window around a key frame: it and the key frames that share most landmarks with it move, and so do
    /// all landmarks they show; other key frames that see those landmarks hold them in place.
    pub fn around(
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        centre: KeyFrameId,
        config: &WindowConfig,
    ) -> Option<Self> {
        let mut moving = vec![centre];
        moving.extend(
            snapshot
                .key_frame(centre)?
                .covisible
                .iter()
                .map(|(id, _)| *id)
                .take(config.key_frames.saturating_sub(1)),
        );
        Some(Self::of(snapshot, camera, &moving, config.anchors))
    }

    /// The window in which every key frame of a world moves but its root.
    pub fn whole(snapshot: &Snapshot, camera: &RectifiedCamera, map: MapId) -> Self {
        let all: Vec<KeyFrameId> = snapshot.key_frames_of(map).map(|k| k.id).collect();
        Self::of(snapshot, camera, &all, 0)
    }

    fn of(snapshot: &Snapshot, camera: &RectifiedCamera, moving: &[KeyFrameId], anchors: usize) -> Self {
        let subproblem = Subproblem::of(snapshot, moving, anchors);
        // The root never moves: it is where the world is.
        let root = moving.first().and_then(|id| snapshot.key_frame(*id)).map(|k| k.map.root());
        let key_frames = &subproblem.key_frames;
        let mut fixed: Vec<bool> =
            (0..key_frames.len()).map(|i| i >= moving.len() || Some(key_frames[i]) == root).collect();
        if !fixed.contains(&true)
            && let Some(oldest) = (0..key_frames.len()).min_by_key(|i| key_frames[*i])
        {
            fixed[oldest] = true;
        }
        let bundle = Bundle {
            camera: pinhole(camera),
            poses: subproblem.poses.clone(),
            fixed,
            points: subproblem.points.clone(),
            observations: subproblem.observations.clone(),
            right_offset: snapshot.right_offset(),
            right_offset_before: snapshot.right_offset(),
            right_offset_sigma: 0.0,
            // A calibration that nothing has refuted.
            right_offset_held: snapshot.right_offset() == 0.0,
            right_offset_pull: 0.0,
            right_offset_information: 0.0,
        };
        Self { subproblem, bundle }
    }

    /// Solves the window: robustly, then without the observations that do not fit. `stop` is asked before each step.
    pub fn solve(mut self, config: &WindowConfig, mut stop: impl FnMut() -> bool) -> WindowResult {
        let bundle = &mut self.bundle;
        bundle.right_offset_sigma = config.right_offset_sigma;
        let [before, after] = config.iterations;
        let solve = |iterations| BundleConfig { iterations, robust: true, tolerance: config.tolerance };
        let mut report = bundle.solve(&solve(before), &mut stop);
        let judge = |bundle: &mut Bundle| {
            for i in 0..bundle.observations.len() {
                let o = bundle.observations[i];
                if bundle.chi2(&o) > Bundle::bound(&o) {
                    bundle.observations[i].weight = 0.0;
                }
            }
        };
        if after > 0 && !stop() {
            judge(bundle);
            let first = report.cost_before;
            report = bundle.solve(&solve(after), &mut stop);
            report.cost_before = first;
        }
        judge(bundle);
        let mut changes = Vec::new();
        for ((id, pose), fixed) in self.subproblem.key_frames.iter().zip(&bundle.poses).zip(&bundle.fixed) {
            if !fixed {
                changes.push(Change::MoveKeyFrame(*id, *pose));
            }
        }
        for (id, point) in self.subproblem.landmarks.iter().zip(&bundle.points) {
            changes.push(Change::MoveLandmark(*id, *point));
        }
        if bundle.right_offset_sigma > 0.0 && !bundle.right_offset_held {
            changes.push(Change::Calibrate(bundle.right_offset));
        }
        changes.extend(self.subproblem.forgotten(&bundle.observations));
        WindowResult {
            changes: ChangeSet { base: self.subproblem.base, changes },
            report,
            residual_variance: bundle.residual_variance(report.cost_after),
            right_offset_pull: if bundle.right_offset_held { bundle.right_offset_pull } else { 0.0 },
            right_offset_information: bundle.right_offset_information,
        }
    }
}
