//! Whether the readings contradict the scale of a metric map with one camera, and its correction.
//!
//! Scale is found once, and after that bundle adjustment carries it on from key frame to key frame. Where views have no
//! parallax (a turn on the spot) that can go wrong, and a wrong scale explains itself: an IMU does not measure a constant
//! speed. Every acceleration contradicts it, though. So with each key frame the scale of the last seconds is estimated as
//! in a new map, from the visual poses and the readings alone ([`cairn_inertial::initialise`], which knows neither the
//! map's scale nor its velocities). `(ln scale / sigma)^2` is the increase of chi-square when the scale is held at 1, with
//! one degree of freedom (a Wald test): clearer than the residuals of the links, whose velocities adapt to a wrong
//! scale. Seconds of steady walking do not tell an error of a tenth; those of a longer stretch do.

use crate::initialisation::{CameraAndImu, STATIONARY_M_S};
use crate::recent::adjust_recent;
use cairn_adjust::WindowConfig;
use cairn_atlas::{Atlas, Change, KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_inertial::{Attempt, GateKind, Initial, NavState, Scale};
use cairn_sensor::Stamp;
use std::collections::BTreeSet;

/// Seconds of key frames that are checked with each one.
const CHECK_S: f64 = 3.0;
/// How often they are checked while nothing contradicts the scale, seconds: each takes as long as half a key frame (`phone/b`).
const CHECK_EVERY_S: f64 = 0.25;
/// Seconds of key frames that are checked too, where those say nothing or agree: they tell smaller errors.
const LONG_S: f64 = 10.0;
/// How often that is done while nothing contradicts the scale, seconds: it takes several times as long.
const LONG_EVERY_S: f64 = 0.5;
/// Largest standard deviation of the logarithm of scale that says anything.
const MOST_SIGMA: f64 = 0.1;
/// A contradiction: so many standard deviations, and at least so much of the logarithm. Smaller errors are left to bundle
/// adjustment.
const CONTRADICTS: (f64, f64) = (5.0, 0.05);
/// Readings of [`LONG_S`] that differ by so many standard deviations, and at least so much of the logarithm, are no contradiction, and
/// yet nearer to the truth where metres began roughly: windows believe what is seen, whose errors (lens, readout) are smooth, and let the
/// scale drift by 4 % in 12 m. Of nine newcomers whose lengths were 4.8 % off they leave 2.7 % (`bench run newcomers`).
const DIFFERS: (f64, f64) = (1.0, 0.005);
/// How often the scale follows them, seconds.
const FOLLOWED_EVERY_S: f64 = 2.0;
/// Depth in another unit is wrong by more than this: the smallest factor that is reported of a unit that changes in mid-run.
const OTHER_UNIT: f64 = 1.25;
/// Seconds over which checks must agree on a contradiction before the map is changed.
const AGREED_S: f64 = 0.3;
/// Seconds of key frames that are adjusted after a correction.
const ADJUSTED_S: f64 = 10.0;

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
struct Contradiction {
    since: Stamp,
    log_scale: f64,
}

/// What the readings of the last seconds say of the scale, and those of a longer stretch where they were looked at too.
struct Measured {
    found: Initial,
    long: Option<Initial>,
}

/// What is remembered from check to check.
#[derive(Debug, Default)]
pub(crate) struct ScaleWatch {
    /// The last check, where it contradicted the map.
    contradicted: Option<Contradiction>,
    /// When the scale was checked last, and that of a longer stretch.
    checked: Option<Stamp>,
    checked_long: Option<Stamp>,
    /// Whether the scale follows readings of a longer stretch that differ from it, and when it did last.
    follows: bool,
    followed: Option<Stamp>,
    /// The readings agreed with the unit of depth, which is asked no more.
    depth_agrees: bool,
}

impl ScaleWatch {
    /// Has the scale follow what the readings say: metres begin with one that is known roughly.
    pub fn follow(&mut self) {
        self.follows = true;
    }

    /// Compares the scale of the last key frames of a chain with the readings between them, and corrects it when checks
    /// agree for [`AGREED_S`]; `None` where the readings do not say.
    pub async fn check(
        &mut self,
        atlas: &mut Atlas,
        of: &CameraAndImu<'_>,
        chain: &[KeyFrameId],
        config: &WindowConfig,
    ) -> Option<ScaleCheck> {
        let snapshot = atlas.latest().clone();
        let last = snapshot.key_frame(*chain.last()?)?;
        // Where nothing is seen the poses are those of the readings, and cannot contradict them.
        let is_unseen = last.landmarks.iter().all(Option::is_none);
        if is_unseen || last.motion.as_ref()?.velocity.norm() < STATIONARY_M_S {
            return None;
        }
        let now = last.frame.stamp;
        let Measured { found, long } = self.measured_scale(&snapshot, of, chain, now).await?;
        let verdict = self.judge(now, &found);
        let changes = match verdict {
            ScaleVerdict::Corrected => {
                let long = measured_over(&snapshot, of, chain, LONG_S).await;
                match long.filter(|long| contradicts(long) && agree(long, &found)) {
                    Some(long) => rescaled(&snapshot, chain, &long),
                    None => scaled(&snapshot, chain, &found),
                }
            }
            ScaleVerdict::Agrees => {
                let long = long.filter(|long| self.is_followed(now, long));
                long.map_or_else(Vec::new, |long| followed(&snapshot, of, chain, &long))
            }
            ScaleVerdict::Contradicted => Vec::new(),
        };
        if !changes.is_empty() {
            atlas.commit(changes);
            adjust_recent(atlas, of.camera, of.imu, chain, ADJUSTED_S, config).await;
        }
        Some(ScaleCheck { scale: found.scale, sigma: found.scale_sigma, verdict })
    }

    /// What the readings say of metres that depth or a baseline gives. These are known to a few per cent, so only another unit is a
    /// contradiction; it is not corrected, for every image brings it anew.
    pub async fn check_depth(
        &mut self,
        snapshot: &Snapshot,
        of: &CameraAndImu<'_>,
        chain: &[KeyFrameId],
    ) -> Option<ScaleCheck> {
        let now = snapshot.key_frame(*chain.last()?)?.frame.stamp;
        if self.depth_agrees || self.checked_long.is_some_and(|t| now - t < LONG_EVERY_S) {
            return None;
        }
        self.checked_long = Some(now);
        let attempt = of.attempt_from(snapshot, chain, LONG_S, Scale::Free).await?;
        let found = known_scale(&attempt)?;
        let verdict = match self.judge(now, &found) {
            _ if found.scale.ln().abs() < OTHER_UNIT.ln() => ScaleVerdict::Agrees,
            ScaleVerdict::Corrected => ScaleVerdict::Contradicted,
            // One estimate is none yet, and one that is not sure says nothing.
            _ => return None,
        };
        self.depth_agrees = verdict == ScaleVerdict::Agrees;
        Some(ScaleCheck { scale: found.scale, sigma: found.scale_sigma, verdict })
    }

    /// What the readings of the last seconds say of the scale: of [`CHECK_S`] where these contradict it, else of [`LONG_S`] when
    /// that is due and the shorter ones do not say otherwise.
    async fn measured_scale(
        &mut self,
        snapshot: &Snapshot,
        of: &CameraAndImu<'_>,
        chain: &[KeyFrameId],
        now: Stamp,
    ) -> Option<Measured> {
        let agrees = self.contradicted.is_none();
        if agrees && self.checked.is_some_and(|t| now - t < CHECK_EVERY_S) {
            return None;
        }
        self.checked = Some(now);
        let short = measured_over(snapshot, of, chain, CHECK_S).await;
        let is_due = !agrees || self.checked_long.is_none_or(|t| now - t >= LONG_EVERY_S);
        if short.as_ref().is_some_and(contradicts) || !is_due {
            return short.map(|found| Measured { found, long: None });
        }
        self.checked_long = Some(now);
        let long = measured_over(snapshot, of, chain, LONG_S).await;
        let found = match (&long, short) {
            (Some(long), Some(short)) if !agree(long, &short) => short,
            (Some(long), _) => long.clone(),
            (None, short) => short?,
        };
        Some(Measured { found, long })
    }

    /// Whether the scale is to follow what the readings of a longer stretch say, from now on.
    fn is_followed(&mut self, now: Stamp, long: &Initial) -> bool {
        let is_due = self.followed.is_none_or(|t| now - t >= FOLLOWED_EVERY_S);
        let follows = self.follows && is_due && differs(long);
        if follows {
            self.followed = Some(now);
        }
        follows
    }

    fn judge(&mut self, now: Stamp, found: &Initial) -> ScaleVerdict {
        let log_scale = found.scale.ln();
        if !contradicts(found) {
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
}

/// The scale of the last seconds alone, where it is known well enough to say anything.
async fn measured_over(
    snapshot: &Snapshot,
    of: &CameraAndImu<'_>,
    chain: &[KeyFrameId],
    seconds: f64,
) -> Option<Initial> {
    known_scale(&of.attempt(snapshot, chain, seconds).await?)
}

/// The estimate of an attempt, where it tells the scale.
fn known_scale(attempt: &Attempt) -> Option<Initial> {
    let found = attempt.good_but_for(&[GateKind::ScaleSigma, GateKind::GravitySigma])?;
    (found.scale_sigma <= MOST_SIGMA).then(|| found.clone())
}

/// Whether what was found contradicts a scale of 1.
fn contradicts(found: &Initial) -> bool {
    found.scale.ln().abs() >= (CONTRADICTS.0 * found.scale_sigma).max(CONTRADICTS.1)
}

/// Whether what was found differs from the map's scale.
fn differs(found: &Initial) -> bool {
    found.scale.ln().abs() >= (DIFFERS.0 * found.scale_sigma).max(DIFFERS.1)
}

/// Whether two estimates are of the same scale.
fn agree(a: &Initial, b: &Initial) -> bool {
    (a.scale / b.scale).ln().abs() < 3.0 * a.scale_sigma.hypot(b.scale_sigma)
}

/// The key frames of a chain that an estimate is of.
fn stretch<'a>(chain: &'a [KeyFrameId], found: &Initial) -> &'a [KeyFrameId] {
    &chain[chain.len().saturating_sub(found.states.len())..]
}

/// The velocities that were found.
fn velocities(snapshot: &Snapshot, chain: &[KeyFrameId], found: &Initial) -> Vec<Change> {
    let pairs = stretch(chain, found).iter().zip(&found.states);
    let change = |(id, state): (&KeyFrameId, &NavState)| {
        let k = snapshot.key_frame(*id)?;
        let velocity = k.world_from_camera.rotation.inverse() * state.velocity;
        Some(Change::InertialState(*id, velocity, k.motion.as_ref()?.bias))
    };
    pairs.filter_map(change).collect()
}

/// The key frames since the last one that saw no landmarks, where none of them sees landmarks from before: the readings alone carried
/// the scale there, so that of the map before is another one.
fn since_unseen<'a>(snapshot: &Snapshot, chain: &'a [KeyFrameId]) -> Option<&'a [KeyFrameId]> {
    let seen =
        |id: &KeyFrameId| snapshot.key_frame(*id).is_some_and(|k| k.landmarks.iter().any(Option::is_some));
    let unseen = chain.iter().rposition(|id| !seen(id))?;
    let since = &chain[unseen + 1..];
    let first = since.first()?;
    let of = |id: &KeyFrameId| snapshot.key_frame(*id).into_iter().flat_map(|k| k.landmarks.iter().flatten());
    let mut landmarks = since.iter().flat_map(of).filter_map(|id| snapshot.landmark(*id));
    let is_tied = landmarks.any(|l| l.observations.iter().any(|o| o.key_frame < *first));
    (!is_tied).then_some(since)
}

/// The changes that scale the whole map, or what of it hangs together: where a long stretch agrees with its end, the error is not of
/// that end.
fn rescaled(snapshot: &Snapshot, chain: &[KeyFrameId], found: &Initial) -> Vec<Change> {
    if let Some(since) = since_unseen(snapshot, chain) {
        return scaled_since(snapshot, since, chain, found);
    }
    let map = chain.last().and_then(|id| snapshot.key_frame(*id)).map(|k| k.map);
    let of_map = |map| [Change::Rescale(map, found.scale), Change::ScaleSigma(map, found.scale_sigma)];
    let mut changes: Vec<Change> = map.map(of_map).into_iter().flatten().collect();
    changes.extend(velocities(snapshot, chain, found));
    changes
}

/// The changes that scale the key frames that an estimate is of.
fn scaled(snapshot: &Snapshot, chain: &[KeyFrameId], found: &Initial) -> Vec<Change> {
    scaled_since(snapshot, stretch(chain, found), chain, found)
}

/// The changes that have the scale follow what was found, with where the camera is on the IMU if that is not known.
fn followed(snapshot: &Snapshot, of: &CameraAndImu, chain: &[KeyFrameId], found: &Initial) -> Vec<Change> {
    let mut changes = scaled(snapshot, chain, found);
    if of.lever_arm_sigma > 0.0 {
        changes.push(Change::LeverArm(found.lever_arm));
    }
    changes
}

/// The changes that scale the key frames of a stretch about the first of them, with the landmarks that no earlier one observes,
/// and give the last of the chain the velocities that were found.
fn scaled_since(
    snapshot: &Snapshot,
    stretch: &[KeyFrameId],
    chain: &[KeyFrameId],
    found: &Initial,
) -> Vec<Change> {
    let Some(first) = stretch.first().and_then(|id| snapshot.key_frame(*id)) else { return Vec::new() };
    let centre = first.world_from_camera.translation;
    let scaled = |p: Vec3| centre + (p - centre) * found.scale;
    let mut changes = velocities(snapshot, chain, found);
    let mut landmarks = BTreeSet::new();
    for id in stretch {
        let Some(k) = snapshot.key_frame(*id) else { continue };
        let pose = k.world_from_camera;
        changes.push(Change::MoveKeyFrame(*id, Se3::new(pose.rotation, scaled(pose.translation))));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_walk::{NOISE, STEP_S, ToAndFro, position};
    use crate::synthetic::mono;
    use cairn_adjust::ImuModel;
    use cairn_solve::to_end;

    /// Checks with each key frame of the last two seconds: after how many seconds a contradiction was told and put right, and
    /// the scale of those seconds at the end.
    fn checked(factor: f64) -> (Option<f64>, Option<f64>, f64) {
        let count = 33;
        let (mut atlas, ids) = ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor }.map(count);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let camera = mono();
        let of = CameraAndImu { camera: &camera, imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        let mut watch = ScaleWatch::default();
        let (mut told, mut corrected) = (None, None);
        for n in count - 8..count {
            let chain = &ids[..=n];
            let check = to_end(watch.check(&mut atlas, &of, chain, &WindowConfig::default()));
            let seconds = STEP_S * (n + 8 - count) as f64;
            match check.map(|c| c.verdict) {
                Some(ScaleVerdict::Agrees) | None => {}
                Some(verdict) => {
                    told.get_or_insert(seconds);
                    if verdict == ScaleVerdict::Corrected {
                        corrected.get_or_insert(seconds);
                        break;
                    }
                }
            }
        }
        let place = |n: usize| atlas.latest().key_frame(ids[n]).unwrap().world_from_camera.translation;
        let last = corrected.map_or(count - 1, |s| count - 8 + (s / STEP_S) as usize);
        let truth = position(STEP_S * last as f64) - position(STEP_S * (last - 8) as f64);
        (told, corrected, (place(last) - place(last - 8)).norm() / truth.norm())
    }

    #[test]
    fn check_notices_a_corrupted_scale_within_two_seconds_and_puts_it_right() {
        for factor in [0.3, 1.1, 3.0] {
            let (told, corrected, scale) = checked(factor);
            assert!(told.is_some_and(|s| s <= 1.0), "{factor}: told after {told:?} s");
            assert!(corrected.is_some_and(|s| s <= 2.0), "{factor}: put right after {corrected:?} s");
            assert!((scale - 1.0).abs() < 0.02, "{factor}: {scale} after it was put right");
        }
    }

    /// What was mapped after a stretch without landmarks has a scale of its own, whatever the last ten seconds say.
    #[test]
    fn check_does_not_scale_what_lies_before_a_stretch_without_landmarks() {
        let (count, unseen) = (90, 40);
        let (mut atlas, ids) =
            ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor: 1.0 }.map_but_for(count, Some(unseen));
        let since = since_unseen(atlas.latest(), &ids).expect("nothing is seen across it").to_vec();
        assert_eq!(since, &ids[unseen + 1..]);
        let place =
            |atlas: &Atlas, n: usize| atlas.latest().key_frame(ids[n]).unwrap().world_from_camera.translation;
        let centre = place(&atlas, unseen + 1);
        let doubled = |p: Vec3| centre + (p - centre) * 2.0;
        let wrong = |id: &KeyFrameId| {
            let pose = atlas.latest().key_frame(*id).unwrap().world_from_camera;
            Change::MoveKeyFrame(*id, Se3::new(pose.rotation, doubled(pose.translation)))
        };
        let mut changes: Vec<Change> = since.iter().map(wrong).collect();
        let new = atlas.latest().landmarks().filter(|l| l.observations[0].key_frame >= since[0]);
        changes.extend(new.map(|l| Change::MoveLandmark(l.id, doubled(l.position))));
        atlas.commit(changes);
        let before = place(&atlas, 30) - place(&atlas, 0);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let camera = mono();
        let of = CameraAndImu { camera: &camera, imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        let long =
            to_end(measured_over(atlas.latest(), &of, &ids, LONG_S)).expect("ten seconds tell the scale");
        assert!(contradicts(&long), "{}", long.scale);
        let snapshot = atlas.latest().clone();
        atlas.commit(rescaled(&snapshot, &ids, &long));
        let truly = |n: usize| position(STEP_S * n as f64);
        let found = (place(&atlas, count - 1) - place(&atlas, count - 17)).norm();
        let scale = found / (truly(count - 1) - truly(count - 17)).norm();
        assert!((scale - 1.0).abs() < 0.05, "{scale} of what was wrong");
        let after = place(&atlas, 30) - place(&atlas, 0);
        assert!((after - before).norm() < 1e-6, "{before} {after}");
    }

    /// Three per cent are no contradiction; where metres began roughly, the readings take of them what windows do not bring back that see
    /// again what was seen before, and a map whose scale is right stays as it is.
    #[test]
    fn a_scale_that_is_a_little_off_follows_the_readings() {
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let camera = mono();
        let of = CameraAndImu { camera: &camera, imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        for (factor, follows, within) in
            [(1.0, true, 0.0..0.003), (1.03, true, 0.0..0.024), (1.03, false, 0.028..0.032)]
        {
            let (mut atlas, ids) = ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor }.map(70);
            let mut watch = ScaleWatch { follows, ..ScaleWatch::default() };
            let before = atlas.latest().version();
            for n in 8..70 {
                let check = to_end(watch.check(&mut atlas, &of, &ids[..=n], &WindowConfig::default()));
                assert!(check.is_none_or(|c| c.verdict == ScaleVerdict::Agrees), "{check:?}");
            }
            let place = |n: usize| atlas.latest().key_frame(ids[n]).unwrap().world_from_camera.translation;
            let truth = position(STEP_S * 69.0) - position(STEP_S * 61.0);
            let off = ((place(69) - place(61)).norm() / truth.norm() - 1.0).abs();
            assert!(within.contains(&off), "{factor}, {follows}: {off}");
            assert_eq!(atlas.latest().version() > before, follows && factor != 1.0, "{factor}, {follows}");
        }
    }

    #[test]
    fn a_lever_arm_that_is_not_known_follows_with_the_scale() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor: 1.03 }.map(40);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let arms = |lever_arm_sigma: f64| {
            let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma };
            let found = to_end(measured_over(atlas.latest(), &of, &ids, LONG_S)).expect("a scale");
            let changes = followed(atlas.latest(), &of, &ids, &found);
            let arms = changes.into_iter().filter_map(|change| match change {
                Change::LeverArm(arm) => Some(arm.norm()),
                _ => None,
            });
            (arms.collect::<Vec<_>>(), found.scale_sigma)
        };
        let ((known, sure), (unknown, unsure)) = (arms(0.0), arms(0.04));
        assert!(known.is_empty() && unknown.len() == 1 && unknown[0] < 0.02, "{unknown:?}");
        assert!(unsure > sure, "{unsure} {sure}");
    }

    /// While nothing is seen the readings carry the pose: what they say of the scale says nothing of the map before.
    #[test]
    fn check_says_nothing_while_the_newest_key_frame_sees_nothing() {
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let (camera, count) = (mono(), 40);
        let of = CameraAndImu { camera: &camera, imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        for unseen in [None, Some(count - 1)] {
            let (mut atlas, ids) =
                ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor: 1.2 }.map_but_for(count, unseen);
            let version = atlas.latest().version();
            let mut watch = ScaleWatch::default();
            let told = to_end(watch.check(&mut atlas, &of, &ids, &WindowConfig::default()));
            assert_eq!(told.map(|c| c.verdict), unseen.is_none().then_some(ScaleVerdict::Contradicted));
            assert_eq!(atlas.latest().version(), version);
        }
    }

    #[test]
    fn depth_in_another_unit_is_told_with_its_factor_and_depth_that_agrees_is_asked_no_more() {
        for factor in [0.2, 0.5, 10.0, 1.0, 1.1] {
            let (atlas, ids) = ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor }.map(48);
            let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
            let camera = mono();
            let of = CameraAndImu { camera: &camera, imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
            let mut watch = ScaleWatch::default();
            let checks = (24..48).filter_map(|n| to_end(watch.check_depth(atlas.latest(), &of, &ids[..=n])));
            let checks: Vec<ScaleCheck> = checks.collect();
            let last = checks.last().expect("a check");
            assert!((last.scale * factor).ln().abs() < 0.05, "{factor}: {last:?}");
            let wrong = factor.ln().abs() > OTHER_UNIT.ln();
            let verdict = if wrong { ScaleVerdict::Contradicted } else { ScaleVerdict::Agrees };
            assert!(checks.iter().all(|c| c.verdict == verdict), "{factor}: {checks:?}");
            assert_eq!(checks.len() == 1, !wrong, "{factor}: {checks:?}");
        }
    }

    #[test]
    fn check_leaves_a_right_scale_alone() {
        let (told, corrected, scale) = checked(1.0);
        assert_eq!((told, corrected), (None, None));
        assert!((scale - 1.0).abs() < 1e-6, "{scale}");
    }

    /// A map in which a metre has so many units, and what the readings of its last seconds say.
    fn measured(factor: f64) -> (Atlas, Vec<KeyFrameId>, Initial) {
        let (atlas, ids) = ToAndFro { turn_rad: 0.3, tilt_rad: 0.0, factor }.map(33);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        let found = to_end(measured_over(atlas.latest(), &of, &ids, CHECK_S)).expect("a scale");
        (atlas, ids, found)
    }

    #[test]
    fn agree_is_said_of_estimates_within_three_standard_deviations() {
        let (.., found) = measured(1.0);
        let other = |scale, scale_sigma| Initial { scale, scale_sigma, ..found.clone() };
        assert!(agree(&other(1.0, 0.01), &other(1.04, 0.01)));
        assert!(!agree(&other(1.0, 0.01), &other(1.05, 0.01)));
        assert!(!agree(&other(2.0, 0.1), &other(1.0, 0.1)));
    }

    #[test]
    fn scaled_scales_the_last_key_frames_about_the_first_of_them_with_their_landmarks() {
        let (mut atlas, ids, found) = measured(2.0);
        let before = atlas.latest().clone();
        let last = stretch(&ids, &found);
        assert!(last.len() < ids.len() && (found.scale - 0.5).abs() < 0.02, "{}", found.scale);
        assert_eq!(atlas.commit(scaled(&before, &ids, &found)).dropped, 0);
        let place = |s: &Snapshot, id: KeyFrameId| s.key_frame(id).unwrap().world_from_camera.translation;
        let centre = place(&before, last[0]);
        for id in &ids {
            let expected = match last.contains(id) {
                true => centre + (place(&before, *id) - centre) * found.scale,
                false => place(&before, *id),
            };
            assert!((place(atlas.latest(), *id) - expected).norm() < 1e-9);
        }
        let (mut moved, mut held) = (0, 0);
        for l in before.landmarks() {
            let own = l.observations.iter().all(|o| o.key_frame >= last[0]);
            let expected = if own { centre + (l.position - centre) * found.scale } else { l.position };
            assert!((atlas.latest().landmark(l.id).unwrap().position - expected).norm() < 1e-9);
            if own { moved += 1 } else { held += 1 }
        }
        assert!(moved > 20 && held > 20, "{moved} {held}");
    }

    #[test]
    fn velocities_are_those_found_along_the_axes_of_each_camera() {
        let (atlas, ids, found) = measured(2.0);
        let changes = velocities(atlas.latest(), &ids, &found);
        assert_eq!(changes.len(), found.states.len());
        for change in &changes {
            let Change::InertialState(id, velocity, _) = change else { panic!("{change:?}") };
            let t = STEP_S * ids.iter().position(|i| i == id).unwrap() as f64;
            let speed = (position(t + 1e-3) - position(t - 1e-3)).norm() / 2e-3;
            assert!((velocity.norm() - speed).abs() < 0.03, "{} m/s of {speed}", velocity.norm());
        }
    }
}
