//! The level of a gravity-aligned map: when it is looked at, and how the map is turned.
//!
//! A walk straight on tells the sum of gravity and of the accelerometer's bias only; a turn tells them apart. So the level of
//! a new map is looked at after turns, until the readings have told it.

use crate::initialisation::{CameraAndImu, INITIALISATION_S, STATIONARY_M_S};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Manifold, Sim3, Vec3};
use cairn_inertial::{GateKind, Gravity, Initial};
use cairn_sensor::Stamp;
use std::f64::consts::{PI, TAU};

/// Seconds after the first key frame of the chain at which a gravity-aligned map is adjusted as a whole
/// again.
const REFINE_AT_S: [f64; 6] = [5.0, 10.0, 15.0, 25.0, 40.0, 60.0];

/// Standard deviation of the direction of gravity by white noise, radians, up to which a map is turned to it, and how many of them it
/// must be off. Poses of a map that was built with a wrong level err together, so that errors are ten times that.
const GRAVITY: (f64, f64) = (0.0006, 5.0);
/// Until the last of them, and until its level is known, it is looked at too where the camera has turned by so much, with so
/// many seconds between two looks until it is known: what of the readings is the accelerometer's bias and what is gravity is
/// told by a turn alone.
const CHECK_AFTER: (f64, f64) = (0.7, 0.5);

/// How far a gravity-aligned map has been refined.
#[derive(Clone, Copy, Debug)]
pub struct Refined {
    /// How many times of [`REFINE_AT_S`] have passed.
    times: usize,
    level: GravityCheck,
}

/// What is known of the level of a map.
#[derive(Clone, Copy, Debug, Default)]
struct GravityCheck {
    /// Whether the readings have told it once.
    known: bool,
    /// Heading of the camera from which turns count, and when the level was looked at last.
    since: Option<(f64, Stamp)>,
    /// When the camera had turned far enough for a look that has not told the level yet.
    turned: Option<Stamp>,
}

impl GravityCheck {
    /// Whether it is time to look at it with a key frame.
    fn due(&mut self, heading: f64, now: Stamp) -> bool {
        if self.turned.take_if(|at| now - *at > INITIALISATION_S).is_some() {
            self.since = None;
        }
        let (from, looked) = *self.since.get_or_insert((heading, now));
        let turned = ((heading - from + PI).rem_euclid(TAU) - PI).abs() >= CHECK_AFTER.0;
        if turned && self.turned.is_none() {
            self.turned = Some(now);
        }
        self.turned.is_some() && now - looked >= CHECK_AFTER.1
    }

    /// Notes what a look told.
    fn looked(&mut self, heading: f64, now: Stamp, told: bool) {
        let from = self.since.map_or(heading, |(from, _)| from);
        self.since = Some((if told { heading } else { from }, now));
        self.known |= told;
        if told {
            self.turned = None;
        }
    }
}

impl Default for Refined {
    /// A map that was aligned elsewhere is refined already.
    fn default() -> Self {
        let level = GravityCheck { known: true, ..GravityCheck::default() };
        Self { times: REFINE_AT_S.len(), level }
    }
}

/// What a gravity-aligned map is due for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// It is adjusted as a whole.
    Whole,
    /// Likewise, if it is not level.
    IfGravityDiffers,
}

impl Refined {
    /// A map that was aligned just now, so many seconds after its first key frame.
    pub fn of_age(seconds: f64) -> Self {
        let times = REFINE_AT_S.iter().filter(|due| seconds >= **due).count();
        Self { times, level: GravityCheck::default() }
    }

    /// Notes whether the readings up to a key frame told the level.
    pub fn looked(&mut self, last: &KeyFrame, told: bool) {
        self.level.looked(heading(last), last.frame.stamp, told);
    }

    /// What is due with a new key frame, so many seconds after the first.
    pub fn due(&mut self, last: &KeyFrame, seconds: f64) -> Option<Due> {
        // A stationary camera adds no information, and a correction of the map must not enter its IMU factors as
        // motion.
        let stationary = last.motion.as_ref().is_none_or(|m| m.velocity.norm() < STATIONARY_M_S);
        if stationary {
            return None;
        }
        let due_s = REFINE_AT_S.get(self.times);
        if due_s.is_none() && self.level.known {
            return None;
        }
        let turned = self.level.due(heading(last), last.frame.stamp);
        if due_s.is_some_and(|due_s| seconds >= *due_s) {
            self.times += 1;
            return Some(Due::Whole);
        }
        turned.then_some(Due::IfGravityDiffers)
    }
}

/// Gravity, biases and velocities of the last seconds of a gravity-aligned map from its visual poses and the readings alone,
/// where they tell gravity well. Bundle adjustment moves a whole map with small steps only, which take many iterations to
/// turn it.
pub async fn estimated_gravity(
    of: &CameraAndImu<'_>,
    snapshot: &Snapshot,
    chain: &[KeyFrameId],
) -> Option<Initial> {
    let attempt = of.attempt(snapshot, chain, INITIALISATION_S).await?;
    let found = attempt.good_but_for(&[GateKind::ScaleSigma])?;
    (found.gravity_noise_sigma() <= GRAVITY.0).then(|| found.clone())
}

/// Whether gravity was found otherwise than the map has it.
pub fn differs_from_map(found: &Initial) -> bool {
    Gravity::level().local(&found.gravity).norm() > GRAVITY.1 * found.gravity_noise_sigma()
}

/// The changes that turn a metric map about a fixed point so that gravity is as found, and give its key frames the velocities
/// and biases that belong to it.
pub fn realigned(
    snapshot: &Snapshot,
    map: MapId,
    chain: &[KeyFrameId],
    found: &Initial,
    centre_point: Vec3,
) -> Vec<Change> {
    let turn = found.gravity.world_from_level.inverse();
    let mut changes =
        vec![Change::AlignGravity(map, Sim3::new(turn, centre_point - turn * centre_point, 1.0))];
    let (earlier, stretch) = chain.split_at(chain.len().saturating_sub(found.states.len()));
    for id in earlier {
        if let Some(motion) = snapshot.key_frame(*id).and_then(|k| k.motion.as_ref()) {
            changes.push(Change::InertialState(*id, motion.velocity, found.bias));
        }
    }
    for (id, state) in stretch.iter().zip(&found.states) {
        let Some(k) = snapshot.key_frame(*id) else { continue };
        let velocity = k.world_from_camera.rotation.inverse() * state.velocity / found.scale;
        changes.push(Change::InertialState(*id, velocity, found.bias));
    }
    changes
}

/// Angle of the camera's axis about the vertical, radians, in a gravity-aligned map.
fn heading(k: &KeyFrame) -> f64 {
    let ahead = k.world_from_camera.rotation * Vec3::z();
    ahead.y.atan2(ahead.x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_walk::{NOISE, ToAndFro};
    use crate::synthetic::mono;
    use cairn_adjust::ImuModel;
    use cairn_atlas::Atlas;
    use cairn_geometry::Se3;
    use cairn_solve::to_end;

    #[test]
    fn after_a_turn_the_level_is_looked_at_until_it_is_told_or_the_turn_is_too_old() {
        let mut level = GravityCheck::default();
        let at = |seconds: f64| Stamp((seconds * 1e9) as i64);
        let looks = |level: &mut GravityCheck, heading: f64, from: f64, to: f64, told: bool| {
            let times = (0..).map(|n| from + 0.25 * f64::from(n)).take_while(|t| *t < to);
            let due = |t: &f64| {
                let due = level.due(heading, at(*t));
                if due {
                    level.looked(heading, at(*t), told);
                }
                due
            };
            times.filter(due).count()
        };
        assert_eq!(looks(&mut level, 0.0, 0.0, 10.0, false), 0);
        assert_eq!(looks(&mut level, 0.8, 10.0, 13.0, false), 6, "each half second");
        assert_eq!(looks(&mut level, 0.8, 13.0, 20.0, true), 1, "until it is told");
        assert_eq!(looks(&mut level, 1.6, 20.0, 60.0, false), 41, "or the turn is too old");
    }

    /// What the readings tell of a map that was made so far from level.
    fn told(tilt_rad: f64) -> (Atlas, Vec<KeyFrameId>, Option<Initial>) {
        let (atlas, ids) = ToAndFro { turn_rad: 0.8, tilt_rad, factor: 1.0 }.map(60);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.0, lever_arm_sigma: 0.0 };
        let found = to_end(estimated_gravity(&of, atlas.latest(), &ids));
        (atlas, ids, found)
    }

    #[test]
    fn is_better_level_only_where_gravity_lies_otherwise() {
        let found = |tilt_rad| told(tilt_rad).2.expect("a level");
        assert!(differs_from_map(&found(0.02)) && !differs_from_map(&found(0.0)));
    }

    #[test]
    fn levelled_turns_the_map_about_the_fixed_point_and_gives_the_velocities_found() {
        let (mut atlas, ids, found) = told(0.02);
        let before = atlas.latest().clone();
        let centre = before.key_frame(ids[7]).unwrap().world_from_camera.translation;
        let found = found.expect("a level");
        assert_eq!(atlas.commit(realigned(&before, MapId(ids[0]), &ids, &found, centre)).dropped, 0);
        let (was, is) = (before.key_frame(ids[7]).unwrap(), atlas.latest().key_frame(ids[7]).unwrap());
        assert!((is.world_from_camera.translation - centre).norm() < 1e-9);
        let turned = (is.world_from_camera.rotation * was.world_from_camera.rotation.inverse()).log();
        assert!((turned - Vec3::x() * -0.02).norm() < 0.002, "{turned:?}");
        let velocity = |k: &KeyFrame| k.motion.as_ref().unwrap().velocity;
        assert!((velocity(is) - velocity(was)).norm() < 0.02, "{:?} {:?}", velocity(is), velocity(was));
        assert!(
            ids.iter()
                .all(|id| atlas.latest().key_frame(*id).unwrap().motion.as_ref().unwrap().bias == found.bias)
        );
    }

    #[test]
    fn looked_ends_the_looks_at_a_map_once_the_level_was_told() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 1.0 }.map(60);
        let due = |told: bool| {
            let mut refined = Refined::of_age(70.0);
            let frames = ids.iter().filter_map(|id| atlas.latest().key_frame(*id));
            let due = |k: &&KeyFrame| {
                let due = refined.due(k, 70.0).is_some();
                if due {
                    refined.looked(k, told);
                }
                due
            };
            frames.filter(due).count()
        };
        assert_eq!(due(true), 1);
        assert!(due(false) > 3, "{}", due(false));
    }
}
