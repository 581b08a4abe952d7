//! The map was corrected: the route moves under the walker, who goes on in the odometry frame as if nothing had happened.
//!
//! Input: the corrected plan, and how the route moved near the walker. For [`GuideConfig::ease_s`] the walker is still
//! matched where he would be on the former route, less and less so: his course is led over to the corrected route
//! instead of being judged by it at once. Where that would lead him wrongly meanwhile, the correction counts at once; if
//! it contradicts what he was told, the next cue says so.
//!
//! [`GuideConfig::ease_s`]: crate::GuideConfig::ease_s

use crate::config::GuideConfig;
use crate::cue::{CueKind, First, Next};
use crate::facing::Heading;
use crate::follow::{Follower, Now, Phase, since};
use crate::ground::{Ground, wrap};
use crate::maneuvers::ManeuverPlan;
use cairn_geometry::{Camera, Odom, Pose, Se3};
use cairn_sensor::Stamp;

/// A shift below this is not worth easing, metres and radians.
const NOTHING: f64 = 0.005;
/// A turn of at least this much counts as one when what was announced is compared with what comes, radians.
const TURN_RAD: f64 = 0.7;
/// Metres along the route by which a turn may come sooner or later than the eased route has it.
const ALONG_M: f64 = 0.5;

/// A correction that is being eased in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Easing {
    /// Takes the walker to where he would be on the corrected route if it had not moved relative to him.
    shift: Se3,
    began: Stamp,
}

impl Easing {
    /// What is left of the shift: all of it in the beginning, nothing after `ease_s`, with no step of speed.
    fn left(&self, now: Stamp, ease_s: f64) -> Option<Se3> {
        let t = (now - self.began) / ease_s;
        // Also for a duration of zero or less.
        if !(0.0..1.0).contains(&t) {
            return None;
        }
        let share = 1.0 - t * t * (3.0 - 2.0 * t);
        Some(Se3::exp(&(self.shift.log() * share)))
    }
}

/// What the walker was told last, as far as a correction can contradict it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LastDirections {
    /// What comes next on the route.
    next: Option<Next>,
    /// When he was told to turn or bear, and by how much, radians, positive left.
    turn: Option<(Stamp, f64)>,
}

impl LastDirections {
    /// Takes a cue.
    fn note(&mut self, kind: &CueKind, now: Stamp) {
        use CueKind::*;
        match *kind {
            Start { first: First::Go(ahead), .. }
            | Resume(First::Go(ahead))
            | Clear(First::Go(ahead))
            | Correction(First::Go(ahead))
            | Approach(ahead)
            | StopTurning(ahead)
            | Go { ahead, .. }
            | Progress(ahead)
            | Stopped { ahead, .. } => self.next = Some(ahead.next),
            TurnNow { turn_rad, .. } => *self = Self { next: None, turn: Some((now, turn_rad)) },
            StairsNow(_) | Waypoint => self.next = None,
            Start { first: First::Turn(turn), .. }
            | Resume(First::Turn(turn))
            | Clear(First::Turn(turn))
            | Around(First::Turn(turn))
            | Correction(First::Turn(turn))
            | Rotate(turn)
            | Adjust(turn)
            | WrongWay(turn)
            | OffPath { turn_rad: turn, .. }
            | EndMissed { turn_rad: turn, .. } => self.turn = Some((now, turn)),
            _ => {}
        }
    }
}

/// The corrections of a walk.
#[derive(Clone, Debug, Default)]
pub(crate) struct Corrections {
    easing: Option<Easing>,
    told: LastDirections,
    /// A correction contradicts what was told, and the walker does not know yet.
    due: bool,
    /// The last good pose.
    pose: Option<Pose<Odom, Camera>>,
}

impl Corrections {
    /// A cue is given.
    pub(crate) fn note(&mut self, kind: &CueKind, now: Stamp) {
        self.told.note(kind, now);
    }

    /// A good pose.
    pub(crate) fn take(&mut self, odom_from_camera: Pose<Odom, Camera>) {
        self.pose = Some(odom_from_camera);
    }

    /// The words that follow tell the whole direction anew.
    pub(crate) fn clear(&mut self) {
        (self.easing, self.due, self.told) = (None, false, LastDirections::default());
    }

    /// The poses before say nothing about those to come.
    pub(crate) fn begin_segment(&mut self) {
        (self.easing, self.pose) = (None, None);
    }

    /// Replaces the plan by a corrected one. `moved` is the motion of the route near the walker, in the odometry frame.
    pub(crate) fn correct(
        &mut self,
        follower: &mut Follower,
        ground: &Ground,
        plan: ManeuverPlan,
        moved: &Se3,
        now: Stamp,
        is_halted: bool,
    ) {
        let left =
            self.easing.and_then(|e| e.left(now, follower.config.ease_s)).unwrap_or_else(Se3::identity);
        let former = self.pose.and_then(|pose| now_at(follower, ground, &Pose::new(left * pose.se3), now));
        let former_turn = former.map(|former| former.walker.turn_to(follower.aim(&former)));
        follower.replace_plan(plan);
        self.easing = None;
        let shift = *moved * left;
        let is_under_way = !is_halted && !matches!(follower.phase, Phase::Begin | Phase::Done);
        let Some(pose) = self.pose.filter(|_| is_under_way && shift.is_finite()) else { return };
        if shift.translation.norm() < NOTHING && shift.rotation.angle() < NOTHING {
            return;
        }
        let here = |pose: &Se3| now_at(follower, ground, &Pose::new(*pose), now);
        let (Some(eased), Some(truly)) = (here(&(shift * pose.se3)), here(&pose.se3)) else { return };
        let contradicted = self.is_contradicted(follower, former_turn, &truly);
        if contradicted || misleads(follower, &eased, &truly) {
            self.due |= contradicted;
            follower.matcher.place(truly.at.along_m);
        } else {
            self.easing = Some(Easing { shift, began: now });
        }
    }

    /// The walker's heading as he is matched to the route: moved by what is left of a correction.
    pub(crate) fn eased(
        &mut self,
        config: &GuideConfig,
        ground: &Ground,
        pose: &Pose<Odom, Camera>,
        now: Stamp,
    ) -> Option<Heading> {
        let Some(easing) = self.easing else { return config.facing.heading(ground, pose) };
        let left = easing.left(now, config.ease_s);
        if left.is_none() {
            self.easing = None;
        }
        config.facing.heading(ground, &left.map_or(*pose, |left| Pose::new(left * pose.se3)))
    }

    /// The cue for a correction that contradicts what was told.
    pub(crate) fn cue(&mut self, follower: &mut Follower, now: &Now) -> Option<CueKind> {
        if !std::mem::take(&mut self.due) {
            return None;
        }
        let turn = now.walker.turn_to(follower.aim(now));
        if turn.abs().to_degrees() < follower.config.turn_tolerance_deg {
            follower.set_out(now);
            return Some(CueKind::Correction(First::Go(follower.ahead(now))));
        }
        follower.turn_on_spot(now);
        Some(CueKind::Correction(First::Turn(turn)))
    }

    /// Whether the corrected route contradicts what the walker was told: another turn than was announced, or the other
    /// side than he was just sent to and than the former route (a turn by `former_turn`) still asks for.
    fn is_contradicted(&self, follower: &Follower, former_turn: Option<f64>, truly: &Now) -> bool {
        let is_turn = |next: &Next| matches!(next, Next::Turn { turn_rad, .. } if turn_rad.abs() >= TURN_RAD);
        let comes = follower.ahead(truly).next;
        let another = match (self.told.next, comes) {
            (Some(Next::Turn { turn_rad: a, .. }), Next::Turn { turn_rad: b, .. }) => {
                a * b < 0.0 && a.abs() >= TURN_RAD && b.abs() >= TURN_RAD
            }
            (Some(told), comes) => is_turn(&told) || is_turn(&comes),
            (None, _) => false,
        };
        let following = matches!(follower.phase, Phase::Turning(_));
        let turn = truly.walker.turn_to(follower.aim(truly));
        let against =
            |turn: f64, told: f64| turn * told < 0.0 && turn.abs().to_degrees() > follower.config.adjust_deg;
        let other_side = self.told.turn.is_some_and(|(at, told)| {
            let fresh = following || since(Some(at), truly.stamp) < follower.config.adjust_again_s;
            fresh && against(turn, told) && !former_turn.is_some_and(|former| against(former, told))
        });
        another || other_side
    }
}

/// What a step would start from at this pose.
fn now_at(follower: &Follower, ground: &Ground, pose: &Pose<Odom, Camera>, now: Stamp) -> Option<Now> {
    let walker = follower.config.facing.heading(ground, pose)?;
    let at = follower.matcher.clone().update(&follower.plan, &walker.position, now);
    Some(Now { stamp: now, walker, at, speed: follower.motion.speed() })
}

/// Whether the walker would be led wrongly while a correction is eased in: he is off the path and would not be told,
/// his aim lies elsewhere, or a turn or the end comes sooner or later than the eased route has it.
fn misleads(follower: &Follower, eased: &Now, truly: &Now) -> bool {
    let s = &follower.config;
    let wide = if follower.backwards() { s.backwards_off_m } else { s.off_m };
    let off = truly.at.cross_m.abs() > wide && eased.at.cross_m.abs() <= wide;
    let aim = |now: &Now| now.walker.turn_to(follower.aim(now));
    let elsewhere = wrap(aim(truly) - aim(eased)).abs().to_degrees() > s.turn_tolerance_deg;
    let rest_m = follower.next_at_m() - truly.at.along_m;
    let soon = rest_m < (s.ease_s + s.turn_now_s) * truly.speed;
    off || elsewhere || soon && (truly.at.along_m - eased.at.along_m).abs() > ALONG_M
}
