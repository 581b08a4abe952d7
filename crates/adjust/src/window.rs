//! A window of key frames and landmarks, copied out of a map, adjusted, and handed back as changes.

use crate::excerpt::Excerpt;
use crate::pinhole;
use cairn_atlas::{Change, ChangeSet, KeyFrameId, Map, WorldId};
use cairn_solve::{Bundle, BundleSetting, Report};
use cairn_vision::EyeModel;

/// How large a window may be and how long it is solved.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WindowSetting {
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

impl Default for WindowSetting {
    fn default() -> Self {
        Self { key_frames: 16, anchors: 24, iterations: [5, 6], tolerance: 1e-4, right_offset_sigma: 0.2 }
    }
}

/// A copied window.
#[derive(Clone, Debug)]
pub struct Window {
    excerpt: Excerpt,
    bundle: Bundle,
}

/// A window after its solve.
#[derive(Clone, Debug)]
pub struct Settled {
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
    pub fn around(map: &Map, eye: &EyeModel, centre: KeyFrameId, setting: &WindowSetting) -> Option<Self> {
        let mut moving = vec![centre];
        moving.extend(
            map.key_frame(centre)?
                .covisible
                .iter()
                .map(|(id, _)| *id)
                .take(setting.key_frames.saturating_sub(1)),
        );
        Some(Self::of(map, eye, &moving, setting.anchors))
    }

    /// The window in which every key frame of a world moves but its root.
    pub fn whole(map: &Map, eye: &EyeModel, world: WorldId) -> Self {
        let all: Vec<KeyFrameId> = map.key_frames_of(world).map(|k| k.id).collect();
        Self::of(map, eye, &all, 0)
    }

    fn of(map: &Map, eye: &EyeModel, moving: &[KeyFrameId], anchors: usize) -> Self {
        let excerpt = Excerpt::of(map, moving, anchors);
        // The root never moves: it is where the world is.
        let root = moving.first().and_then(|id| map.key_frame(*id)).map(|k| k.world.root());
        let key_frames = &excerpt.key_frames;
        let mut fixed: Vec<bool> =
            (0..key_frames.len()).map(|i| i >= moving.len() || Some(key_frames[i]) == root).collect();
        if !fixed.contains(&true)
            && let Some(oldest) = (0..key_frames.len()).min_by_key(|i| key_frames[*i])
        {
            fixed[oldest] = true;
        }
        let bundle = Bundle {
            camera: pinhole(eye),
            poses: excerpt.poses.clone(),
            fixed,
            points: excerpt.points.clone(),
            observations: excerpt.observations.clone(),
            right_offset: map.right_offset(),
            right_offset_before: map.right_offset(),
            right_offset_sigma: 0.0,
            // A calibration that nothing has refuted.
            right_offset_held: map.right_offset() == 0.0,
            right_offset_pull: 0.0,
            right_offset_information: 0.0,
        };
        Self { excerpt, bundle }
    }

    /// Solves the window: robustly, then without the observations that do not fit. `stop` is asked before each step.
    pub fn solve(mut self, setting: &WindowSetting, mut stop: impl FnMut() -> bool) -> Settled {
        let bundle = &mut self.bundle;
        bundle.right_offset_sigma = setting.right_offset_sigma;
        let [before, after] = setting.iterations;
        let solve = |iterations| BundleSetting { iterations, robust: true, tolerance: setting.tolerance };
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
        for ((id, pose), fixed) in self.excerpt.key_frames.iter().zip(&bundle.poses).zip(&bundle.fixed) {
            if !fixed {
                changes.push(Change::MoveKeyFrame(*id, *pose));
            }
        }
        for (id, point) in self.excerpt.landmarks.iter().zip(&bundle.points) {
            changes.push(Change::MoveLandmark(*id, *point));
        }
        if bundle.right_offset_sigma > 0.0 && !bundle.right_offset_held {
            changes.push(Change::Calibrate(bundle.right_offset));
        }
        changes.extend(self.excerpt.forgotten(&bundle.observations));
        Settled {
            changes: ChangeSet { base: self.excerpt.base, changes },
            report,
            residual_variance: bundle.residual_variance(report.cost_after),
            right_offset_pull: if bundle.right_offset_held { bundle.right_offset_pull } else { 0.0 },
            right_offset_information: bundle.right_offset_information,
        }
    }
}
