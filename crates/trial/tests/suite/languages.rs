//! What the guide says, as a listener of each language understands it.

use cairn_guide::{
    Cue, CueKind, DirectionStyle, Facing, First, Language, Next, PhraseConfig, Side, Stairs, Step, Unit,
    UpcomingManeuver,
};
use cairn_sensor::Stamp;
use cairn_trial::side_of;

/// Every turn is to the same side in every language, unit and form, as a listener of that language hears it.
#[test]
fn sides_are_the_same_in_every_language() {
    let ahead = UpcomingManeuver { distance_m: 6.1, next: Next::End, then: None };
    for degrees in (-150..=150).step_by(15).filter(|d: &i32| d.abs() > 15) {
        let a = f64::from(degrees).to_radians();
        let off = |turn_rad, on_spot| CueKind::OffPath { distance_m: 2.0, bearing_rad: a, turn_rad, on_spot };
        for kind in [
            CueKind::TurnNow { turn_rad: a, stairs: None },
            CueKind::TurnNow { turn_rad: a, stairs: Some(Stairs::Up) },
            CueKind::Start { total_m: 20.0, left_m: 20.0, first: First::Turn(a) },
            CueKind::Resume(First::Turn(a)),
            CueKind::Correction(First::Turn(a)),
            CueKind::Clear(First::Turn(a)),
            CueKind::Around(First::Turn(a)),
            CueKind::Rotate(a),
            CueKind::Adjust(a),
            off(a, true),
            off(a, false),
            CueKind::WrongWay(a),
            CueKind::Step(Step::BackAside(a)),
            CueKind::Step(Step::Aside(a)),
            CueKind::EndMissed { distance_m: 1.0, turn_rad: a },
            CueKind::LookRound(a),
            CueKind::Go { ahead, check: false },
            off(0.0, false),
        ] {
            for facing in [Facing::Home, Facing::Backwards] {
                for style in [DirectionStyle::Words, DirectionStyle::Clock, DirectionStyle::Degrees] {
                    for (language, metric) in Language::ALL.into_iter().flat_map(|l| [(l, true), (l, false)])
                    {
                        let config =
                            PhraseConfig { language, directions: style, metric, unit: Unit::Steps(0.65) };
                        let text = config.words(&Cue { stamp: Stamp(0), facing, kind }).unwrap();
                        let turns =
                            !matches!(kind, CueKind::Go { .. } | CueKind::OffPath { turn_rad: 0.0, .. });
                        assert_eq!(
                            side_of(&text, language),
                            turns.then_some(Side::of(a)),
                            "{degrees}: {text}"
                        );
                        assert!(
                            !text.contains("guide-") && !text.contains(['{', '$']) && !text.contains("  "),
                            "{text}"
                        );
                    }
                }
            }
        }
    }
}
