//! Whether a route is ready to be walked back: checked before leaving, stretch by stretch.
//!
//! The map contains the views of the way out. On the way home the camera may look the other way, where the map has
//! fewer landmarks. The guide has no map: the caller provides how many landmarks are in view from a pose.

use crate::facing::Facing;
use crate::ground::Ground;
use crate::phrases::PhraseConfig;
use crate::route::{PlacedPoint, Stretch};
use cairn_geometry::{Se3, So3};
use cairn_settings::Settings;

/// How reliable tracking will be on a stretch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Readiness {
    /// Too few mapped landmarks will be in view, or the stretch is a gap in the recording.
    Stop,
    /// Enough landmarks to relocalise, not enough to rely on.
    Reduced,
    /// Enough landmarks are in view for reliable tracking in walking direction.
    TwoWay,
}

/// The limits of the classes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct ReadyConfig {
    /// Landmarks in view from which on a pose can be found at all.
    #[setting(default = 30, range = 0..=100_000)]
    pub least: usize,
    /// Landmarks in view from which on tracking is reliable.
    #[setting(default = 80, range = 0..=100_000)]
    pub enough: usize,
    /// Spacing of the checks along the route, metres.
    #[setting(default = 2.0, range = 0.01..=100.0)]
    pub stretch_m: f64,
}

/// From this share of its length on, the whole route is said to be affected.
const WHOLE: f64 = 0.9;

/// A stretch of the route as recorded, from its start. Metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadyStretch {
    /// Where it begins, metres from the start of the recording.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// The smallest number of landmarks in view of the poses checked.
    pub seen: usize,
    /// The class that follows from it.
    pub readiness: Readiness,
}

/// The pose that a camera will have on the way back at the place where it had `frame_from_camera` on the way out:
/// rotated by half a turn about the vertical for a walker who faces home, unchanged for the other two.
pub fn pose_back(frame_from_camera: &Se3, ground: &Ground, facing: Facing) -> Se3 {
    match facing {
        Facing::Home => {
            let half = So3::exp(&(ground.up() * std::f64::consts::PI));
            Se3::new(half * frame_from_camera.rotation, frame_from_camera.translation)
        }
        Facing::Back | Facing::Backwards => *frame_from_camera,
    }
}

/// Checks a resolved route with the views that the camera will have on the way back. `seen` returns how many
/// landmarks are in view from a pose; lengths are multiplied by `metres_per_unit`. Neighbouring stretches of the same
/// class are merged.
pub fn ready(
    points: &[PlacedPoint],
    metres_per_unit: f64,
    ground: &Ground,
    facing: Facing,
    config: &ReadyConfig,
    seen: impl Fn(&Se3) -> usize,
) -> Vec<ReadyStretch> {
    let mut out: Vec<ReadyStretch> = Vec::new();
    let (mut at_m, mut asked_m) = (0.0, f64::NEG_INFINITY);
    for (k, p) in points.iter().enumerate() {
        let step = k.checked_sub(1).map_or(0.0, |b| {
            (p.frame_from_camera.translation - points[b].frame_from_camera.translation).norm()
        });
        let before = at_m;
        at_m += step * metres_per_unit;
        let gap = p.stretch == Stretch::Gap;
        if at_m - asked_m < config.stretch_m && !gap && k + 1 < points.len() {
            continue;
        }
        let count = if gap { 0 } else { seen(&pose_back(&p.frame_from_camera, ground, facing)) };
        let readiness = match count {
            n if n >= config.enough => Readiness::TwoWay,
            n if n >= config.least => Readiness::Reduced,
            _ => Readiness::Stop,
        };
        let from_m = if asked_m.is_finite() { asked_m.min(before) } else { 0.0 };
        match out.last_mut().filter(|l| l.readiness == readiness) {
            Some(last) => (last.to_m, last.seen) = (at_m, last.seen.min(count)),
            None => out.push(ReadyStretch { from_m, to_m: at_m, seen: count, readiness }),
        }
        asked_m = at_m;
    }
    out
}

/// What is said about it before leaving, to help deciding: that the route will be recognised, or how much of it may not
/// be, and whether another way of carrying the camera would help. `with_camera_back` are the stretches as they would be
/// with the camera facing back, where that is another way.
pub fn ready_words(
    stretches: &[ReadyStretch],
    with_camera_back: Option<&[ReadyStretch]>,
    phrases: &PhraseConfig,
) -> String {
    let text = |id: &str| phrases.language.text(id);
    let any = |which: Readiness| stretches.iter().any(|s| s.readiness == which);
    let (worst, ids, all) = match (any(Readiness::Stop), any(Readiness::Reduced)) {
        _ if stretches.is_empty() => return text("ready-none"),
        (false, false) => return text("ready-all"),
        (false, true) => (Readiness::Reduced, ["ready-hard", "ready-hard-unmeasured"], "ready-hard-all"),
        (true, _) => (Readiness::Stop, ["ready-unseen", "ready-unseen-unmeasured"], "ready-unseen-all"),
    };
    let length = |of: &mut dyn Iterator<Item = &ReadyStretch>| of.map(|s| s.to_m - s.from_m).sum::<f64>();
    let affected_m = length(&mut stretches.iter().filter(|s| s.readiness == worst));
    let whole = affected_m >= WHOLE * length(&mut stretches.iter());
    let words = if whole { text(all) } else { phrases.measured(ids, affected_m, &[]) };
    let helps = with_camera_back.is_some_and(|s| s.iter().all(|s| s.readiness == Readiness::TwoWay));
    if helps { format!("{words} {}", text("ready-camera-back")) } else { words }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::camera_pose;

    /// Ten metres along x, looking along it, with a gap before the given point.
    fn walk(gap_at: Option<usize>) -> Vec<PlacedPoint> {
        (0..=100)
            .map(|k| PlacedPoint {
                stamp: cairn_sensor::Stamp(k as i64 * 100_000_000),
                anchored: true,
                frame_from_camera: camera_pose(0.1 * k as f64, 0.0, 0.0, 0.2),
                stretch: if Some(k) == gap_at { Stretch::Gap } else { Stretch::Tracked },
            })
            .collect()
    }

    fn check(facing: Facing, gap_at: Option<usize>) -> Vec<ReadyStretch> {
        let ground = Ground::z_up();
        // A map with landmarks towards +x everywhere, and towards -x from 6 m on.
        let seen = |pose: &Se3| {
            let forward = (pose.rotation * cairn_geometry::Vec3::z()).x > 0.0;
            if forward || pose.translation.x > 6.05 { 100 } else { 40 }
        };
        ready(&walk(gap_at), 1.0, &ground, facing, &ReadyConfig::default(), seen)
    }

    #[test]
    fn same_camera_direction_is_ready() {
        for facing in [Facing::Back, Facing::Backwards] {
            let s = check(facing, None);
            assert_eq!((s.len(), s[0].readiness), (1, Readiness::TwoWay));
            assert!((s[0].to_m - 10.0).abs() < 1e-9);
            assert_eq!(
                ready_words(&s, None, &PhraseConfig::default()),
                "I should recognise this whole route."
            );
        }
    }

    #[test]
    fn facing_home_checks_the_opposite_views() {
        let s = check(Facing::Home, None);
        assert_eq!(
            s.iter().map(|s| s.readiness).collect::<Vec<_>>(),
            [Readiness::Reduced, Readiness::TwoWay]
        );
        assert!((s[0].to_m - 6.0).abs() < 0.15, "{s:?}");
        let words = ready_words(&s, None, &PhraseConfig::default());
        assert_eq!(words, "About 6 metres of this route will be hard for me to recognise.");
        // One thing that helps deciding: with the camera facing back the same route is ready.
        let words = ready_words(&s, Some(&check(Facing::Back, None)), &PhraseConfig::default());
        assert!(words.ends_with("With the camera facing back, I should recognise it."), "{words}");
        let unseen = |to_m| [ReadyStretch { from_m: 0.0, to_m, seen: 3, readiness: Readiness::Stop }, s[1]];
        let words = ready_words(&unseen(100.0), None, &PhraseConfig::default());
        assert!(words.starts_with("I have not seen this route from this direction. "), "{words}");
        let words =
            ready_words(&unseen(6.0), None, &PhraseConfig { metric: false, ..PhraseConfig::default() });
        assert!(words.starts_with("I have not seen part of this route from this direction. "), "{words}");
    }

    #[test]
    fn gap_is_not_ready_and_empty_route_has_no_stretches() {
        let s = check(Facing::Back, Some(70));
        assert!(s.iter().any(|s| s.readiness == Readiness::Stop), "{s:?}");
        assert!(
            ready_words(&s, None, &PhraseConfig::default()).contains("of this route from this direction.")
        );
        let none = ready(&[], 1.0, &Ground::z_up(), Facing::Home, &ReadyConfig::default(), |_| 0);
        assert_eq!(ready_words(&none, None, &PhraseConfig::default()), "There is no route yet.");
    }

    #[test]
    fn pose_back_reverses_heading_and_keeps_tilt() {
        let out = camera_pose(1.0, 2.0, 0.4, 0.3);
        let ground = Ground::z_up();
        let back = pose_back(&out, &ground, Facing::Home);
        let turned = ground.heading(&back).unwrap() - ground.heading(&out).unwrap();
        assert!((turned.abs() - std::f64::consts::PI).abs() < 1e-9);
        let tilt = |p: &Se3| (p.rotation * cairn_geometry::Vec3::z()).z;
        assert!(
            (tilt(&back) - tilt(&out)).abs() < 1e-9 && (back.translation - out.translation).norm() == 0.0
        );
    }
}
