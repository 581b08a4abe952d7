//! What the walker hears: sentences wait for the voice here, start when it is free, and die with their reason.

use crate::age::Ages;
use crate::event::{Event, Said, Sound, rank, turn_of};
use crate::place::Place;
use crate::refused::Refused;
use crate::settings::Setting;
use cairn_guide::{Announcer, AnnouncerConfig, Cue, CueKind, PhraseConfig, Priority};
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use std::collections::VecDeque;

/// A direction that waits for the voice.
struct Direction {
    text: String,
    /// The time of the pose that it is based on.
    pose: Stamp,
    cue: CueKind,
}

/// The voice of a session, and the events that its user interfaces take.
pub(crate) struct Speech {
    phrases: PhraseConfig,
    voice: Announcer,
    /// The text queued last, and the turn it asks for.
    pushed: Option<(String, Option<f64>)>,
    direction: Option<Direction>,
    events: VecDeque<Event>,
    last_words: String,
}

impl Speech {
    pub(crate) fn new(phrases: PhraseConfig, voice: AnnouncerConfig) -> Self {
        Self {
            phrases,
            voice: Announcer::new(voice),
            pushed: None,
            direction: None,
            events: VecDeque::new(),
            last_words: String::new(),
        }
    }

    /// Changes how it is said from now on.
    pub(crate) fn set(&mut self, setting: Setting) {
        match setting {
            Setting::Language(language) => self.phrases.language = language,
            Setting::Unit(unit) => self.phrases.unit = unit,
            Setting::Directions(style) => self.phrases.directions = style,
            Setting::WordsPerMinute(words) => self.voice.set_words_per_minute(words),
        }
    }

    /// The phrases as they are set.
    pub(crate) fn phrases(&self) -> &PhraseConfig {
        &self.phrases
    }

    /// The phrases for a map: with distances only where it is metric.
    pub(crate) fn phrases_for(&self, metric: bool) -> PhraseConfig {
        PhraseConfig { metric: self.phrases.metric && metric, ..self.phrases }
    }

    pub(crate) fn language(&self) -> Language {
        self.phrases.language
    }

    pub(crate) fn text(&self, id: &str) -> String {
        self.language().text(id)
    }

    /// The refusal of a command by a sentence.
    pub(crate) fn refuse(&self, id: &'static str) -> Refused {
        Refused::new(self.language(), id, &[])
    }

    /// The same with a reason in the sentence.
    pub(crate) fn refuse_because(&self, id: &'static str, why: impl ToString) -> Refused {
        Refused::new(self.language(), id, &[("why", (&why.to_string()).into())])
    }

    /// A sentence with a reason in it.
    pub(crate) fn because(&self, id: &str, why: impl ToString) -> String {
        self.language().say(id, &[("why", (&why.to_string()).into())])
    }

    pub(crate) fn say(&mut self, text: &str, priority: Priority, now: Stamp) {
        self.voice.push(text, priority, now);
        self.pushed = Some((text.to_owned(), None));
    }

    /// Says a cue of the guide and queues its earcon, which is heard from the turn it asks for, else from `ahead_rad`;
    /// `place` is that of the pose it is based on.
    pub(crate) fn cue(
        &mut self,
        cue: &Cue,
        ahead_rad: f64,
        place: Option<Place>,
        metric: bool,
        clock: Clock,
    ) {
        let turn = turn_of(cue);
        // Not beneath the words: they are sign enough.
        let is_heard = cue.kind == CueKind::StillHere && self.voice.is_speaking(clock.now);
        if let Some(earcon) = cue.earcon().filter(|_| !is_heard) {
            let bearing_rad = turn.unwrap_or(ahead_rad);
            self.events.push_back(Event::Sound(Sound {
                t_s: clock.elapsed_s(clock.now),
                earcon,
                bearing_rad,
            }));
        }
        if let Some(text) = self.phrases_for(metric).words(cue) {
            self.voice.push(text.clone(), cue.priority(), clock.now);
            if self.voice.waiting() == Some(&text) {
                let place = place.filter(|_| cue.is_direction());
                self.direction =
                    place.map(|place| Direction { text: text.clone(), pose: place.stamp, cue: cue.kind });
            }
            self.pushed = Some((text, turn));
        }
    }

    /// A line that still waits is not said any more: its reason is gone.
    pub(crate) fn withdraw(&mut self, id: &str) {
        if self.waiting() == Some(&self.text(id)) {
            self.drop_waiting();
        }
    }

    /// Whether nothing is being said or waits to be.
    pub(crate) fn is_free(&self, now: Stamp) -> bool {
        !self.voice.is_speaking(now) && self.voice.waiting().is_none()
    }

    pub(crate) fn waiting(&self) -> Option<&str> {
        self.voice.waiting()
    }

    pub(crate) fn drop_waiting(&mut self) {
        self.voice.drop_waiting();
    }

    pub(crate) fn is_speaking(&self, now: Stamp) -> bool {
        self.voice.is_speaking(now)
    }

    /// Says the last utterance again.
    pub(crate) fn repeat(&mut self, now: Stamp) {
        self.voice.repeat(now);
    }

    /// The last utterance; empty before the first.
    pub(crate) fn last_words(&self) -> &str {
        &self.last_words
    }

    /// Starts what waits, if the voice is free. A direction whose pose has become too old is dropped; returns its cue,
    /// so that the guide gives it again from a new pose.
    pub(crate) fn speak(&mut self, ages: &Ages, clock: Clock) -> Option<CueKind> {
        let dropped = self.drop_old_direction(ages);
        let Some(u) = self.voice.poll(clock.now) else { return dropped };
        let turn_rad = self.pushed.as_ref().filter(|(t, _)| *t == u.text).and_then(|(_, turn)| *turn);
        let pose = self.direction.take_if(|direction| direction.text == u.text).map(|d| d.pose);
        self.last_words.clone_from(&u.text);
        self.events.push_back(Event::Said(Said {
            t_s: clock.elapsed_s(u.stamp),
            stamp: u.stamp,
            priority: rank(u.priority),
            interrupts: u.interrupts,
            duration_s: u.duration_s,
            language: self.language(),
            text: u.text,
            turn_rad,
            pose,
        }));
        dropped
    }

    fn drop_old_direction(&mut self, ages: &Ages) -> Option<CueKind> {
        let direction = self.direction.take()?;
        if self.waiting() != Some(&direction.text) {
            return None;
        }
        if !ages.of(Some(direction.pose)).is_stale() {
            self.direction = Some(direction);
            return None;
        }
        self.drop_waiting();
        Some(direction.cue)
    }

    /// The events since the last call, in order.
    pub(crate) fn take_events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }
}

/// The time now, in the clock of the source, and when the session began.
#[derive(Clone, Copy)]
pub(crate) struct Clock {
    pub(crate) now: Stamp,
    pub(crate) began: Option<Stamp>,
}

impl Clock {
    /// Seconds from the beginning of the session to a time.
    pub(crate) fn elapsed_s(self, t: Stamp) -> f64 {
        self.began.map_or(0.0, |began| t - began)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_waiting_line_dies_with_its_reason() {
        let mut speech = Speech::new(PhraseConfig::default(), AnnouncerConfig::default());
        let clock = Clock { now: Stamp::default(), began: None };
        speech.say(&speech.text("walk-mapping-failed"), Priority::Urgent, clock.now);
        speech.speak(&Ages::default(), clock);
        speech.say(&speech.text("walk-no-picture"), Priority::High, clock.now);
        speech.withdraw("walk-lost");
        assert!(speech.waiting().is_some());
        speech.withdraw("walk-no-picture");
        assert_eq!(speech.waiting(), None);
        assert_eq!(speech.take_events().len(), 1);
        speech.set(Setting::WordsPerMinute(90.0));
        assert_eq!(speech.voice.config().rate, 0.5);
        speech.set(Setting::WordsPerMinute(400.0));
        assert_eq!(180.0 * speech.voice.config().rate, 400.0);
    }
}
