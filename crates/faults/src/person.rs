//! The walker: the one of the trials, who follows the words, and who now and then is late, deaf, or goes elsewhere.

use crate::scenario::{Fault, Scenario};
use crate::spells::{Since, Spells};
use cairn_phrases::Language;
use cairn_random::Random;
use cairn_sensor::Stamp;
use cairn_trial::Walker;

/// Who is guided.
pub(crate) struct Person {
    walker: Walker,
    language: Language,
    random: Random,
    calm: Stamp,
    late: bool,
    other_side: bool,
    deaf: bool,
    stands: Option<Spells>,
    wanders: Option<Spells>,
    does: Does,
    /// What will be heard later.
    later: Vec<(Stamp, String)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Does {
    AsTold,
    Stands,
    Wanders,
}

/// "Stop", "go on", "turn left", "turn right".
fn own_words(language: Language) -> [&'static str; 4] {
    match language {
        Language::English => ["Stop.", "Continue 5 metres.", "Turn left.", "Turn right."],
        Language::Spanish => ["Alto.", "Continúe 5 metros.", "Gire a la izquierda.", "Gire a la derecha."],
        Language::German => ["Halt.", "5 Meter weitergehen.", "Links drehen.", "Rechts drehen."],
    }
}

fn with_other_side(text: &str, language: Language) -> String {
    let [left, right] = match language {
        Language::English => ["left", "right"],
        Language::Spanish => ["izquierda", "derecha"],
        Language::German => ["inks", "echts"],
    };
    text.replace(left, "\u{1}").replace(right, left).replace('\u{1}', right)
}

impl Person {
    /// Standing at a place with a heading.
    pub fn new(
        scenario: &Scenario,
        at: (f64, f64, f64),
        language: Language,
        begins: Stamp,
        calm: Stamp,
    ) -> Self {
        let mut random = scenario.random(1020);
        let faults = scenario.faults;
        let spells = |fault: Fault, rests_s, lasts_s| {
            let random = || scenario.random(fault as u64);
            faults.has(fault).then(|| Spells::new(random(), begins, calm, rests_s, lasts_s))
        };
        Self {
            walker: Walker::new(random.bits(), at).with_language(language),
            language,
            random,
            calm,
            late: faults.has(Fault::Late),
            other_side: faults.has(Fault::OtherSide),
            deaf: faults.has(Fault::Deaf),
            stands: spells(Fault::StandsStill, [5.0, 40.0], [2.0, 25.0]),
            wanders: spells(Fault::WandersOff, [5.0, 40.0], [2.0, 8.0]),
            does: Does::AsTold,
            later: Vec::new(),
        }
    }

    /// The walker as of now: x, y in metres, heading in radians.
    pub fn pose(&self) -> (f64, f64, f64) {
        self.walker.pose()
    }

    /// The voice begins to say this now.
    pub fn hear(&mut self, text: &str, now: Stamp) {
        let fails = now < self.calm;
        if self.deaf && fails && self.random.chance(0.15) {
            return;
        }
        let swaps = self.other_side && fails && self.random.chance(0.15);
        let text = if swaps { with_other_side(text, self.language) } else { text.to_owned() };
        let delay_s = if self.late && fails { self.random.uniform(0.0, 1.5) } else { 0.0 };
        self.later.push((now.plus_seconds(delay_s), text));
        self.listen(now);
    }

    fn listen(&mut self, now: Stamp) {
        let (due, later): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.later).into_iter().partition(|(at, _)| *at <= now);
        self.later = later;
        for (_, text) in due.iter().filter(|_| self.does == Does::AsTold) {
            self.walker.hear(text, now);
        }
    }

    /// Goes on for so many seconds.
    pub fn step(&mut self, dt: f64, now: Stamp) {
        self.listen(now);
        let [stop, on, left, right] = own_words(self.language);
        let does = match (self.wanders.since(now), self.stands.since(now)) {
            (Some(_), _) => Does::Wanders,
            (None, Some(_)) => Does::Stands,
            (None, None) => Does::AsTold,
        };
        if does != self.does {
            self.does = does;
            match does {
                Does::Stands => self.walker.hear(stop, now),
                // They go on by themselves, or wait for the next words.
                Does::AsTold if self.random.chance(0.5) => self.walker.hear(on, now),
                Does::AsTold => self.walker.hear(stop, now),
                Does::Wanders => {
                    let turn = [left, right][self.random.below(2)];
                    self.walker.hear(&format!("{turn} {on}"), now);
                }
            }
        }
        self.walker.step(dt, now);
    }
}
