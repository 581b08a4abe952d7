//! Whether a way is ready to be walked back: asked before leaving, stretch by stretch.
//!
//! A map knows the views of the way out. On the way home the camera may look the other way, where the map knows
//! less. The guide has no map: who has one says how many landmarks it would see from a pose.

use crate::facing::Facing;
use crate::ground::Ground;
use crate::phrases::PhraseConfig;
use crate::route::{PlacedPoint, Stretch};
use cairn_geometry::{Se3, So3};

/// How far a stretch can be relied on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Readiness {
    /// Nothing that the map knows will be in view, or nobody knows where the stretch leads.
    Stop,
    /// Enough to find the walker, not enough to rely on.
    Reduced,
    /// The map sees this stretch both ways.
    TwoWay,
}

/// What counts as ready.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadyConfig {
    /// Landmarks in view from which on a pose can be found at all.
    pub least: usize,
    /// Landmarks in view from which on it can be relied on.
    pub enough: usize,
    /// Length of the stretches that are looked at, metres.
    pub stretch_m: f64,
}

impl Default for ReadyConfig {
    fn default() -> Self {
        Self { least: 30, enough: 80, stretch_m: 2.0 }
    }
}

/// A stretch of the way as recorded, from its start. Metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadyStretch {
    /// Where it begins.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// Landmarks in view, the fewest of the poses looked at.
    pub seen: usize,
    /// What that means.
    pub readiness: Readiness,
}

/// The pose a camera will have on the way back where it stood at `frame_from_camera` on the way out: turned half
/// round about the vertical for a walker who turns round with it, as it was for the two others.
pub fn pose_back(frame_from_camera: &Se3, ground: &Ground, facing: Facing) -> Se3 {
    match facing {
        Facing::Home => {
            let half = So3::exp(&(ground.up() * std::f64::consts::PI));
            Se3::new(half * frame_from_camera.rotation, frame_from_camera.translation)
        }
        Facing::Back | Facing::Backwards => *frame_from_camera,
    }
}

/// Looks at each stretch of a placed way as the camera will on the way back. `seen` says how many landmarks the
/// map would see from a pose; lengths are multiplied by `metres_per_unit`. Neighbours alike are put together.
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

/// What is said of it before leaving: "two-way ready", or how much is not, in metres of the whole.
pub fn ready_words(stretches: &[ReadyStretch], phrases: &PhraseConfig) -> String {
    let metres = |which: Readiness| {
        stretches.iter().filter(|s| s.readiness == which).map(|s| s.to_m - s.from_m).sum::<f64>()
    };
    let told = |m: f64, what: &str| match phrases.metric {
        true => format!(" {} {what}.", phrases.distance(m)),
        false => format!(" A part {what}."),
    };
    let any = |which: Readiness| stretches.iter().any(|s| s.readiness == which);
    match (any(Readiness::Stop), any(Readiness::Reduced)) {
        _ if stretches.is_empty() => "The way is not known.".into(),
        (false, false) => "The way is two-way ready.".into(),
        (false, true) => {
            format!("The way is reduced.{}", told(metres(Readiness::Reduced), "can be seen poorly"))
        }
        (true, _) => format!(
            "The way has stops.{} Guidance may stop there.",
            told(metres(Readiness::Stop), "can not be seen from this side")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::camera_pose;

    /// Ten metres along x, looking along it; seven of them before a gap where asked.
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

    fn look(facing: Facing, gap_at: Option<usize>) -> Vec<ReadyStretch> {
        let ground = Ground::z_up();
        // A map that knows what lies towards +x everywhere, and what lies towards -x from 6 m on.
        let seen = |pose: &Se3| {
            let forward = (pose.rotation * cairn_geometry::Vec3::z()).x > 0.0;
            if forward || pose.translation.x > 6.05 { 100 } else { 40 }
        };
        ready(&walk(gap_at), 1.0, &ground, facing, &ReadyConfig::default(), seen)
    }

    #[test]
    fn a_camera_that_looks_as_on_the_way_out_is_two_way_ready() {
        for facing in [Facing::Back, Facing::Backwards] {
            let s = look(facing, None);
            assert_eq!((s.len(), s[0].readiness), (1, Readiness::TwoWay));
            assert!((s[0].to_m - 10.0).abs() < 1e-9);
            assert_eq!(ready_words(&s, &PhraseConfig::default()), "The way is two-way ready.");
        }
    }

    #[test]
    fn facing_home_the_map_is_asked_the_other_way() {
        let s = look(Facing::Home, None);
        assert_eq!(
            s.iter().map(|s| s.readiness).collect::<Vec<_>>(),
            [Readiness::Reduced, Readiness::TwoWay]
        );
        assert!((s[0].to_m - 6.0).abs() < 0.15, "{s:?}");
        let words = ready_words(&s, &PhraseConfig::default());
        assert_eq!(words, "The way is reduced. 6 metres can be seen poorly.");
    }

    #[test]
    fn a_gap_is_a_stop_and_nothing_is_nothing() {
        let s = look(Facing::Back, Some(70));
        assert!(s.iter().any(|s| s.readiness == Readiness::Stop), "{s:?}");
        assert!(ready_words(&s, &PhraseConfig::default()).starts_with("The way has stops."));
        let none = ready(&[], 1.0, &Ground::z_up(), Facing::Home, &ReadyConfig::default(), |_| 0);
        assert_eq!(ready_words(&none, &PhraseConfig::default()), "The way is not known.");
    }

    #[test]
    fn the_way_back_looks_back_level_as_before() {
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
