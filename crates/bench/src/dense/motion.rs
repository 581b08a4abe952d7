//! Poses from depth alone: tracking against the field it builds, and registration of submaps without a guess.

use super::Row;
use super::kitchen::{Kitchen, median};
use super::pairs::{error, kitchen_submaps, pairs_overlapping};
use crate::processor::now_ms;
use cairn_dense::{
    Backend, DenseError, RegisterConfig, SurfaceFeatures, TrackConfig, TsdfConfig, TsdfVolume, register,
    track,
};
use cairn_geometry::{Se3, umeyama};

/// Tracking starts at the first true pose, with every frame and with every fifth; each frame is fused where it was found.
pub fn tracking(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let mut rows = Vec::new();
    for every in [1, 5] {
        let mut preparer = kitchen.preparer(Backend::best())?;
        let mut volume = TsdfVolume::new(TsdfConfig::default())?;
        let (mut pose, mut motion) = (Se3::identity(), Se3::identity());
        let (mut found, mut truth, mut ms, mut lost) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for (i, (image, true_pose)) in kitchen.all.iter().step_by(every).enumerate() {
            let start = now_ms();
            let frame = preparer.prepare(image)?;
            if i == 0 {
                pose = *true_pose;
            } else {
                let tracked = track(&volume, frame, &(pose * motion), &TrackConfig::default())?;
                lost += usize::from(!tracked.converged);
                motion = pose.inverse() * tracked.volume_from_camera;
                pose = tracked.volume_from_camera;
            }
            volume.integrate(frame, None, &pose)?;
            ms.push(now_ms() - start);
            found.push(pose.translation);
            truth.push(true_pose.translation);
        }
        let aligned = umeyama(&truth, &found, false).map_err(|e| DenseError::Pose(e.to_string()))?;
        let square: f64 = found.iter().zip(&truth).map(|(f, t)| (aligned * *f - t).norm_squared()).sum();
        let what = |s: &str| format!("tracking by depth, every {every}, 2 cm, {s}");
        rows.push(Row::at_most(what("with integration, median"), median(ms), "ms a frame", 8.0));
        rows.push(Row::at_most(what("ATE"), 100.0 * (square / found.len() as f64).sqrt(), "cm", 2.3));
        rows.push(Row::at_most(what("not converged"), lost as f64, "frames", 0.0));
    }
    Ok(rows)
}

/// Pairs that are registered, and the overlap that they are chosen by.
const PAIRS: usize = 20;
const OVERLAP: f64 = 0.45;

/// Submaps of a second each, turned at random, in pairs of about 45 % overlap: with and without gravity. Right is within
/// 10 cm and 3.5 degrees of the recording's poses. Times are those of the features of both and of the registration.
pub fn registration(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let mut preparer = kitchen.preparer(Backend::best())?;
    let prepared: Vec<_> = kitchen
        .all
        .iter()
        .map(|(d, p)| Ok((preparer.prepare(d)?.clone(), *p)))
        .collect::<Result<_, DenseError>>()?;
    let mut submaps = kitchen_submaps(|n| prepared[n].clone());
    let pairs = pairs_overlapping(&mut submaps, OVERLAP, PAIRS);
    let config = RegisterConfig::default();
    let mut rows = Vec::new();
    for gravity in [false, true] {
        let (mut right, mut wrong, mut ms, mut off_cm) = (0, 0, Vec::new(), Vec::new());
        for &(a, b) in &pairs {
            let (target, source) = (&submaps[a], &submaps[b]);
            let mut best = f64::INFINITY;
            let mut last = None;
            for _ in 0..3 {
                let start = now_ms();
                let features = [
                    SurfaceFeatures::new(&target.tsdf, &config)?,
                    SurfaceFeatures::new(&source.tsdf, &config)?,
                ];
                let [one, two] =
                    [target.surface(&features[0], gravity), source.surface(&features[1], gravity)];
                last = Some(register(&one, &two, &config)?);
                best = best.min(now_ms() - start);
            }
            ms.push(best);
            let Some(found) = last.filter(|r| r.accepted()) else { continue };
            let [cm, degrees] = error(&found, target, source);
            off_cm.push(cm);
            if cm < 10.0 && degrees < 3.5 { right += 1 } else { wrong += 1 }
        }
        let known = if gravity { "gravity known" } else { "any rotation" };
        let what = |s: &str| format!("registration, {known}, {s}");
        let most = ms.iter().copied().fold(0.0, f64::max);
        rows.push(Row::at_most(what("median"), median(ms), "ms", 40.0));
        rows.push(Row::at_most(what("longest"), most, "ms", 40.0));
        rows.push(Row::at_least(what("right"), f64::from(right), "of 20", PAIRS as f64));
        rows.push(Row::at_most(what("accepted at a wrong place"), f64::from(wrong), "of 20", 0.0));
        rows.push(Row::told(what("median error"), median(off_cm), "cm"));
    }
    Ok(rows)
}
