//! What the page of a phone does with the words that come: it has one voice, drops directions that are too old by its own clock,
//! and says stop itself where nothing comes. After `web/src/page/app.js` and `senses.js`.

use cairn_guide::speaking_time;
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use cairn_trial::{Lateness, STALE_MS};
use std::time::{Duration, Instant};

/// After this time without a message the connection counts as lost, seconds; after this one it is there again.
const GONE_S: f64 = 3.0;
const THERE_S: f64 = 1.5;
/// "Stop" is repeated while its reason lasts, seconds.
const AGAIN_S: f64 = 3.0;
/// The same text is not said again within this time, and what waited longer is not said, seconds.
const SAME_S: f64 = 1.5;
const WAIT_S: f64 = 2.0;

/// A sentence for the voice.
#[derive(Clone, Debug)]
pub(crate) struct Sentence {
    pub text: String,
    /// 0 is urgent.
    pub priority: u8,
    pub interrupts: bool,
    /// The time of the pose, where it is a direction.
    pub pose: Option<Stamp>,
    /// Why the page itself says it.
    own: Option<Own>,
}

impl Sentence {
    /// What the server says.
    pub fn of(said: &cairn_session::Said) -> Self {
        let (text, priority, interrupts, pose) =
            (said.text.clone(), said.priority, said.interrupts, said.pose);
        Self { text, priority, interrupts, pose, own: None }
    }

    fn is_old(&self, now: Stamp) -> bool {
        self.pose.is_some_and(|pose| 1e3 * (now - pose) > STALE_MS)
    }

    fn stop(own: Own, language: Language) -> Self {
        let id = match own {
            Own::Late => "page-pictures-late",
            Own::Gone => "page-connection-lost-stop",
        };
        Self { text: language.text(id), priority: 0, interrupts: true, pose: None, own: Some(own) }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Own {
    Late,
    Gone,
}

/// One voice.
#[derive(Default)]
struct Voice {
    speaking: Option<(Option<Own>, Stamp)>,
    waiting: Option<(Sentence, Stamp)>,
    said: Option<(String, Stamp)>,
    urgent: Option<Stamp>,
    /// What began to be said and was not taken yet.
    begun: Vec<Sentence>,
}

impl Voice {
    fn say(&mut self, sentence: Sentence, now: Stamp) {
        self.speaking = self.speaking.filter(|(_, until)| now < *until);
        if self.said.as_ref().is_some_and(|(text, at)| *text == sentence.text && now - *at < SAME_S) {
            return;
        }
        self.said = Some((sentence.text.clone(), now));
        if sentence.priority == 0 {
            self.urgent = Some(now);
        }
        let replaces =
            |(before, at): &(Sentence, Stamp)| sentence.priority <= before.priority || now - *at > WAIT_S;
        if sentence.interrupts || sentence.priority == 0 || self.speaking.is_none() {
            self.speak(sentence, now);
        } else if self.waiting.as_ref().is_none_or(replaces) {
            self.waiting = Some((sentence, now));
        }
    }

    fn speak(&mut self, sentence: Sentence, now: Stamp) {
        self.speaking = Some((sentence.own, now.plus_seconds(speaking_time(&sentence.text, 1.0))));
        self.waiting = None;
        self.begun.push(sentence);
    }

    /// Says what waits, where the voice is free. True where it has become too old.
    fn next(&mut self, now: Stamp) -> bool {
        self.speaking = self.speaking.filter(|(_, until)| now < *until);
        if self.speaking.is_some() {
            return false;
        }
        let Some((sentence, _)) = self.waiting.take().filter(|(_, at)| now - *at <= WAIT_S) else {
            return false;
        };
        let is_old = sentence.is_old(now);
        if !is_old {
            self.speak(sentence, now);
        }
        is_old
    }

    fn drop(&mut self, own: Own) {
        self.waiting.take_if(|(sentence, _)| sentence.own == Some(own));
        self.speaking = self.speaking.filter(|(by, _)| *by != Some(own));
    }
}

/// The page.
pub(crate) struct Page {
    language: Language,
    voice: Voice,
    late: Lateness,
    guiding: bool,
    /// The newest picture with a pose.
    pictured: Option<Stamp>,
    /// When the last message came.
    heard: Option<Stamp>,
    gone_said: Option<Stamp>,
    is_gone: bool,
    began: Instant,
}

impl Page {
    /// Just opened.
    pub fn new(language: Language) -> Self {
        Self {
            language,
            voice: Voice::default(),
            late: Lateness::default(),
            guiding: false,
            pictured: None,
            heard: None,
            gone_said: None,
            is_gone: false,
            // Only differences to it matter.
            began: Instant::now(),
        }
    }

    /// A status came.
    pub fn status(&mut self, pictured: Option<Stamp>, guiding: bool, now: Stamp) {
        self.heard = Some(now);
        self.pictured = self.pictured.max(pictured);
        self.guiding = guiding;
    }

    /// Words came. True where the server has to hear that they come too late.
    pub fn said(&mut self, sentence: Sentence, now: Stamp) -> bool {
        self.heard = Some(now);
        if sentence.is_old(now) {
            return self.became_late(now);
        }
        if !(self.late.is_late() && sentence.pose.is_some()) {
            self.voice.say(sentence, now);
        }
        false
    }

    fn became_late(&mut self, now: Stamp) -> bool {
        let begins = self.late.begin();
        let rest_s = if begins { AGAIN_S } else { AGAIN_S + 0.5 };
        if self.voice.urgent.is_none_or(|at| now - at >= rest_s) {
            self.voice.say(Sentence::stop(Own::Late, self.language), now);
        }
        begins
    }

    /// A tenth of a second has passed. What the server has to hear of lateness, if anything.
    pub fn look(&mut self, now: Stamp) -> Option<bool> {
        let waited = self.voice.next(now);
        let silence_s = self.heard.map_or(0.0, |heard| now - heard);
        if silence_s > GONE_S {
            self.is_gone = true;
        } else if silence_s < THERE_S && std::mem::take(&mut self.is_gone) {
            self.voice.drop(Own::Gone);
        }
        if self.is_gone && self.gone_said.is_none_or(|at| now - at >= AGAIN_S) {
            self.gone_said = Some(now);
            self.voice.say(Sentence::stop(Own::Gone, self.language), now);
        }
        let age_ms = self.pictured.map(|pictured| 1e3 * (now - pictured));
        if waited || self.guiding && age_ms.is_some_and(|age| age > STALE_MS) {
            return self.became_late(now).then_some(true);
        }
        let clock = self.began + Duration::from_nanos(now.0.max(0) as u64);
        let ends = self.late.ends(age_ms, clock);
        if ends {
            self.voice.drop(Own::Late);
        }
        ends.then_some(false)
    }

    /// What began to be said since the last call.
    pub fn begun(&mut self) -> Vec<Sentence> {
        std::mem::take(&mut self.voice.begun)
    }
}
