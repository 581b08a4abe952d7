//! Whether the readings contradict the scale of a metric map with one camera, and its correction.
//!
//! Scale is found once, and after that bundle adjustment carries it on from key frame to key frame. Where views have no
//! parallax (a turn on the spot) that can go wrong, and a wrong scale explains itself: an IMU does not measure a constant
//! speed. Every acceleration contradicts it, though. So with each key frame the scale of the last seconds is estimated as
//! in a new map, from the visual poses and the readings alone ([`cairn_inertial::initialise`], which knows neither the
//! map's scale nor its velocities). `(ln scale / sigma)^2` is the increase of chi-square when the scale is held at 1, with
//! one degree of freedom (a Wald test): clearer than the residuals of the links, whose velocities adapt to a wrong
//! scale.

use crate::inertial::{Inertial, STATIONARY_M_S};
use cairn_adjust::{Window, WindowConfig};
use cairn_atlas::{Atlas, Change, KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_inertial::{Gate, GateKind, Initial};
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;

/// Seconds of key frames that are checked.
const CHECK_S: f64 = 3.0;
/// Largest standard deviation of the logarithm of scale that says anything.
const MOST_SIGMA: f64 = 0.1;
/// A contradiction: so many standard deviations, and at least so much of the logarithm. Smaller errors are left to bundle
/// adjustment.
const CONTRADICTS: (f64, f64) = (5.0, 0.1);
/// Seconds over which checks must agree on a contradiction before the map is changed.
const AGREED_S: f64 = 0.3;
/// Seconds of key frames that are adjusted after a correction, and their greatest number.
const ADJUSTED: (f64, usize) = (10.0, 60);

/// What the readings say of the scale of a metric map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleCheck {
    /// Metres in a metre of the map, over the last seconds.
    pub scale: f64,
    /// Standard deviation of its logarithm.
    pub sigma: f64,
    /// What follows.
    pub verdict: ScaleVerdict,
}

/// The verdict of a [`ScaleCheck`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleVerdict {
    /// The scale agrees with the readings.
    Agrees,
    /// They contradict it.
    Contradicted,
    /// They contradicted it, and the last key frames were scaled and adjusted.
    Corrected,
}

/// When a contradiction was first seen, and the logarithm of scale at that time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contradiction {
    since: Stamp,
    log_scale: f64,
}

impl Inertial {
    /// Compares the scale of the last key frames of a chain with the readings between them, and corrects it when checks
    /// agree for [`AGREED_S`]; `None` where the readings do not say.
    pub fn check_scale(
        &mut self,
        atlas: &mut Atlas,
        camera: &RectifiedCamera,
        chain: &[KeyFrameId],
        config: &WindowConfig,
    ) -> Option<ScaleCheck> {
        let snapshot = atlas.latest().clone();
        let last = snapshot.key_frame(*chain.last()?)?;
        if last.motion.as_ref()?.velocity.norm() < STATIONARY_M_S {
            return None;
        }
        let attempt = self.attempt(&snapshot, camera, chain, CHECK_S)?;
        let found = attempt.found.as_ref()?;
        let is_good = |g: &Gate| g.passed || matches!(g.kind, GateKind::ScaleSigma | GateKind::GravitySigma);
        if !attempt.gates.iter().all(is_good) || found.scale_sigma.is_nan() || found.scale_sigma > MOST_SIGMA
        {
            return None;
        }
        let now = last.frame.stamp;
        let verdict = self.judge(now, found.scale.ln(), found.scale_sigma);
        if verdict == ScaleVerdict::Corrected {
            let stretch = &chain[chain.len().checked_sub(found.states.len())?..];
            atlas.commit(scaled(&snapshot, stretch, found));
            self.adjust_recent(atlas, camera, chain, now, config);
        }
        Some(ScaleCheck { scale: found.scale, sigma: found.scale_sigma, verdict })
    }

    fn judge(&mut self, now: Stamp, log_scale: f64, sigma: f64) -> ScaleVerdict {
        if log_scale.abs() < (CONTRADICTS.0 * sigma).max(CONTRADICTS.1) {
            self.contradicted = None;
            return ScaleVerdict::Agrees;
        }
        match self.contradicted {
            Some(first) if first.log_scale * log_scale > 0.0 => {
                if now - first.since < AGREED_S {
                    return ScaleVerdict::Contradicted;
                }
                self.contradicted = None;
                ScaleVerdict::Corrected
            }
            _ => {
                self.contradicted = Some(Contradiction { since: now, log_scale });
                ScaleVerdict::Contradicted
            }
        }
    }

    /// Adjusts the key frames of the last seconds; those before hold what both see.
    fn adjust_recent(
        &self,
        atlas: &mut Atlas,
        camera: &RectifiedCamera,
        chain: &[KeyFrameId],
        now: Stamp,
        config: &WindowConfig,
    ) {
        let snapshot = atlas.latest().clone();
        let Some(centre) = chain.last() else { return };
        let stamp = |id: &KeyFrameId| snapshot.key_frame(*id).map(|k| k.frame.stamp);
        let recent = chain.iter().rev().filter_map(stamp).take_while(|t| now - *t <= ADJUSTED.0).count();
        let config = WindowConfig { iterations: [8, 6], tolerance: 1e-4, ..*config };
        let count = recent.min(ADJUSTED.1);
        if let Some(window) = Window::inertial_around(&snapshot, camera, &self.imu, *centre, count, &config) {
            atlas.commit(window.solve(&config, || false).changes.changes);
        }
    }
}

/// The changes that scale key frames about the first of them, with the landmarks that no earlier one observes, and give
/// them the velocities that were found.
fn scaled(snapshot: &Snapshot, stretch: &[KeyFrameId], found: &Initial) -> Vec<Change> {
    let Some(first) = stretch.first().and_then(|id| snapshot.key_frame(*id)) else { return Vec::new() };
    let centre = first.world_from_camera.translation;
    let scaled = |p: Vec3| centre + (p - centre) * found.scale;
    let mut changes = Vec::new();
    let mut landmarks = BTreeSet::new();
    for (id, state) in stretch.iter().zip(&found.states) {
        let Some(k) = snapshot.key_frame(*id) else { continue };
        let pose = k.world_from_camera;
        changes.push(Change::MoveKeyFrame(*id, Se3::new(pose.rotation, scaled(pose.translation))));
        if let Some(motion) = &k.motion {
            let velocity = pose.rotation.inverse() * state.velocity;
            changes.push(Change::InertialState(*id, velocity, motion.bias));
        }
        landmarks.extend(k.landmarks.iter().flatten().copied());
    }
    for id in landmarks {
        let Some(landmark) = snapshot.landmark(id) else { continue };
        if landmark.observations.iter().all(|o| o.key_frame >= first.id) {
            changes.push(Change::MoveLandmark(id, scaled(landmark.position)));
        }
    }
    changes
}
