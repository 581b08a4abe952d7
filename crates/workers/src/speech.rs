//! What a session gives to be heard, as a message.

use cairn_guide::Earcon;
use cairn_sensor::Stamp;
use cairn_session::{Event, Said, Sound};
use serde::{Deserialize, Serialize};

const EARCONS: [Earcon; 7] = [
    Earcon::OnCourse,
    Earcon::OffCourse,
    Earcon::Turn,
    Earcon::Turning,
    Earcon::Waypoint,
    Earcon::Arrival,
    Earcon::Stop,
];

/// As [`Event`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Speech {
    /// As [`Said`]; times of the source are ns, the language is its code.
    Words {
        t_s: f64,
        stamp: i64,
        text: String,
        language: String,
        priority: u8,
        interrupts: bool,
        duration_s: f64,
        turn_rad: Option<f64>,
        pose: Option<i64>,
    },
    /// As [`Sound`]; the earcon is its number.
    Sound { t_s: f64, earcon: u8, bearing_rad: f64 },
}

impl Speech {
    pub fn of(event: Event) -> Self {
        match event {
            Event::Said(s) => Self::Words {
                t_s: s.t_s,
                stamp: s.stamp.0,
                text: s.text,
                language: s.language.code().to_owned(),
                priority: s.priority,
                interrupts: s.interrupts,
                duration_s: s.duration_s,
                turn_rad: s.turn_rad,
                pose: s.pose.map(|stamp| stamp.0),
            },
            Event::Sound(s) => Self::Sound {
                t_s: s.t_s,
                earcon: EARCONS.iter().position(|e| *e == s.earcon).unwrap_or(0) as u8,
                bearing_rad: s.bearing_rad,
            },
        }
    }

    /// Back; `None` for an earcon that is none.
    pub fn event(self) -> Option<Event> {
        Some(match self {
            Self::Words { t_s, stamp, text, language, priority, interrupts, duration_s, turn_rad, pose } => {
                Event::Said(Said {
                    t_s,
                    stamp: Stamp(stamp),
                    text,
                    language: language.parse().unwrap_or_default(),
                    priority,
                    interrupts,
                    duration_s,
                    turn_rad,
                    pose: pose.map(Stamp),
                })
            }
            Self::Sound { t_s, earcon, bearing_rad } => {
                Event::Sound(Sound { t_s, earcon: *EARCONS.get(usize::from(earcon))?, bearing_rad })
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_guide::Priority;
    use cairn_phrases::Language;

    #[test]
    fn what_is_heard_comes_back_as_it_was() {
        let words = "Halt.".to_owned();
        let said = Said::plain(words, Language::German, Priority::Urgent, (Stamp(7), 0.5));
        let said = Said { turn_rad: Some(0.25), pose: Some(Stamp(5)), duration_s: 1.5, ..said };
        let sounds = EARCONS.map(|earcon| Event::Sound(Sound { t_s: 1.0, earcon, bearing_rad: -0.5 }));
        for event in sounds.into_iter().chain([Event::Said(said)]) {
            assert_eq!(Speech::of(event.clone()).event(), Some(event));
        }
        assert_eq!(Speech::Sound { t_s: 0.0, earcon: EARCONS.len() as u8, bearing_rad: 0.0 }.event(), None);
    }
}
