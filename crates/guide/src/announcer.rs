//! The announcement queue: one voice, urgent messages first, no stale messages, no repetitions.
//!
//! Texts go in with a priority and a time; `poll` returns what the voice must start saying now. How long a
//! text takes is estimated from its word count, so queueing works the same with any sink.

use crate::cue::Priority;
use cairn_sensor::Stamp;
use std::collections::VecDeque;

/// Words a minute at rate 1.
pub const WORDS_PER_MINUTE: f64 = 180.0;
/// Rates of speech: users of screen readers listen at up to 400 words a minute.
pub const RATES: [f64; 2] = [0.1, 400.0 / WORDS_PER_MINUTE];

/// Config of the queue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnnouncerConfig {
    /// Speech rate, of [`RATES`]; 1 is [`WORDS_PER_MINUTE`].
    pub rate: f64,
    /// Volume, 0 to 1; passed on to the sink.
    pub volume: f64,
    /// Normal and low messages that waited longer than this are dropped, seconds.
    pub stale_s: f64,
    /// The same text is not said again within this time, seconds; urgent messages always are.
    pub same_s: f64,
}

impl Default for AnnouncerConfig {
    fn default() -> Self {
        Self { rate: 1.0, volume: 1.0, stale_s: 2.0, same_s: 4.0 }
    }
}

/// An utterance that the voice starts now.
#[derive(Clone, Debug, PartialEq)]
pub struct Utterance {
    /// The text.
    pub text: String,
    /// Its priority.
    pub priority: Priority,
    /// When it starts.
    pub stamp: Stamp,
    /// Estimated duration in seconds.
    pub duration_s: f64,
    /// True when the voice must break off what it is saying.
    pub interrupts: bool,
}

/// The queue.
#[derive(Clone, Debug)]
pub struct Announcer {
    config: AnnouncerConfig,
    speaking: Option<(Priority, Stamp)>,
    waiting: Option<(String, Priority, Stamp)>,
    last: Option<(String, Stamp)>,
    dropped: usize,
    history: VecDeque<Utterance>,
}

/// Estimated seconds that a voice takes for a text at a rate ([`WORDS_PER_MINUTE`] at rate 1).
pub fn speaking_time(text: &str, rate: f64) -> f64 {
    let words = text.split_whitespace().count() as f64;
    let pauses = text.matches(['.', ',']).count() as f64;
    (words * 60.0 / WORDS_PER_MINUTE + 0.1 * pauses) / rate.clamp(RATES[0], RATES[1])
}

impl Announcer {
    /// An empty queue; rate and volume are clamped to their ranges.
    pub fn new(config: AnnouncerConfig) -> Self {
        let config = AnnouncerConfig {
            rate: config.rate.clamp(RATES[0], RATES[1]),
            volume: config.volume.clamp(0.0, 1.0),
            ..config
        };
        Self { config, speaking: None, waiting: None, last: None, dropped: 0, history: VecDeque::new() }
    }

    /// Sets the rate by the words a minute of a voice.
    pub fn set_words_per_minute(&mut self, words: f64) {
        self.config.rate = (words / WORDS_PER_MINUTE).clamp(RATES[0], RATES[1]);
    }

    /// The config in use, after clamping.
    pub fn config(&self) -> &AnnouncerConfig {
        &self.config
    }

    /// Queues a text. It is dropped when it was just said, or when something more urgent is waiting.
    pub fn push(&mut self, text: impl Into<String>, priority: Priority, now: Stamp) {
        let text = text.into();
        let said = self.last.as_ref().is_some_and(|(t, at)| *t == text && now - *at < self.config.same_s);
        let more_urgent =
            self.waiting.as_ref().is_some_and(|(_, p, at)| *p < priority && !self.stale(*p, *at, now));
        if (said && priority != Priority::Urgent) || more_urgent {
            self.dropped += 1;
            return;
        }
        if self.waiting.replace((text, priority, now)).is_some() {
            self.dropped += 1;
        }
    }

    /// Says the last utterance again.
    pub fn repeat(&mut self, now: Stamp) {
        if let Some((text, _)) = self.last.take() {
            self.waiting = Some((text, Priority::High, now));
        }
    }

    /// The text that waits for the voice, if any.
    pub fn waiting(&self) -> Option<&str> {
        self.waiting.as_ref().map(|(text, ..)| text.as_str())
    }

    /// Drops the text that waits: its reason is gone.
    pub fn drop_waiting(&mut self) {
        self.dropped += usize::from(self.waiting.take().is_some());
    }

    /// What the voice must start saying now, if anything.
    pub fn poll(&mut self, now: Stamp) -> Option<Utterance> {
        if self.speaking.is_some_and(|(_, until)| until <= now) {
            self.speaking = None;
        }
        let (_, priority, since) = self.waiting.as_ref()?;
        if self.stale(*priority, *since, now) {
            self.waiting = None;
            self.dropped += 1;
            return None;
        }
        let interrupts = match self.speaking {
            Some((current, _)) if *priority > Priority::High || *priority > current => return None,
            other => other.is_some(),
        };
        let (text, priority, _) = self.waiting.take()?;
        let duration_s = speaking_time(&text, self.config.rate);
        self.speaking = Some((priority, now.plus_seconds(duration_s)));
        self.last = Some((text.clone(), now));
        let utterance = Utterance { text, priority, stamp: now, duration_s, interrupts };
        self.history.push_back(utterance.clone());
        if self.history.len() > 100 {
            self.history.pop_front();
        }
        Some(utterance)
    }

    /// True while the voice is speaking.
    pub fn is_speaking(&self, now: Stamp) -> bool {
        self.speaking.is_some_and(|(_, until)| until > now)
    }

    /// How many texts were never said: stale, repeated, or displaced by more urgent ones.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// The last hundred utterances, oldest first.
    pub fn history(&self) -> impl Iterator<Item = &Utterance> {
        self.history.iter()
    }

    fn stale(&self, priority: Priority, since: Stamp, now: Stamp) -> bool {
        priority >= Priority::Normal && now - since > self.config.stale_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> Stamp {
        Stamp::from_seconds(s)
    }

    fn said(a: &mut Announcer, s: f64) -> Option<(String, bool)> {
        a.poll(at(s)).map(|u| (u.text, u.interrupts))
    }

    #[test]
    fn urgent_and_high_interrupt_normal_and_low_wait() {
        let mut a = Announcer::new(AnnouncerConfig::default());
        a.push("Continue 12 metres, then turn left.", Priority::Normal, at(0.0));
        assert!(said(&mut a, 0.0).is_some());
        a.push("Ten metres more.", Priority::Low, at(0.5));
        assert_eq!(said(&mut a, 0.5), None);
        a.push("Turn left now.", Priority::High, at(0.6));
        assert_eq!(said(&mut a, 0.6), Some(("Turn left now.".into(), true)));
        a.push("Stop. Tracking is lost.", Priority::Urgent, at(0.7));
        assert_eq!(said(&mut a, 0.7), Some(("Stop. Tracking is lost.".into(), true)));
        // Only urgent messages interrupt urgent messages.
        a.push("Bear left.", Priority::High, at(0.8));
        assert_eq!(said(&mut a, 0.8), None);
        assert_eq!(said(&mut a, 2.5), Some(("Bear left.".into(), false)));
    }

    #[test]
    fn at_most_one_waits_and_stale_texts_are_dropped() {
        let mut a = Announcer::new(AnnouncerConfig::default());
        a.push("one two three four five six seven eight nine", Priority::Normal, at(0.0));
        assert!(said(&mut a, 0.0).is_some());
        a.push("second", Priority::Normal, at(0.1));
        a.push("third", Priority::Low, at(0.2));
        a.push("fourth", Priority::Normal, at(0.3));
        assert_eq!(said(&mut a, 2.2), None, "still speaking");
        assert_eq!(said(&mut a, 3.1), None, "waited too long");
        a.push("fifth", Priority::Normal, at(3.2));
        assert_eq!(said(&mut a, 3.2), Some(("fifth".into(), false)));
        assert_eq!(a.dropped(), 3);
    }

    #[test]
    fn repetitions_are_dropped_except_urgent_and_on_request() {
        let mut a = Announcer::new(AnnouncerConfig::default());
        a.push("Bear left.", Priority::High, at(0.0));
        assert!(said(&mut a, 0.0).is_some());
        a.push("Bear left.", Priority::High, at(2.0));
        assert_eq!(said(&mut a, 2.0), None);
        a.repeat(at(2.5));
        assert_eq!(said(&mut a, 2.5).unwrap().0, "Bear left.");
        for k in 0..3 {
            let t = 5.0 + 3.0 * k as f64;
            a.push("Stop. Tracking is lost.", Priority::Urgent, at(t));
            assert!(said(&mut a, t).is_some());
        }
        assert_eq!(a.history().count(), 5);
    }

    #[test]
    fn rate_and_volume_are_clamped() {
        let a = Announcer::new(AnnouncerConfig { rate: 9.0, volume: -1.0, ..Default::default() });
        assert_eq!((a.config().rate, a.config().volume), (RATES[1], 0.0));
        assert!(speaking_time("one two three", 2.0) < speaking_time("one two three", 1.0));
    }
}
