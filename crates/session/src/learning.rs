//! Learning a phone that nobody calibrated: no route is recorded before its lens, the length of a metre and the clock of its
//! motion sensors are known. A wrong focal length makes distances wrong by as much, and clocks apart spoil both.
//!
//! In: what is known of the lens, and after each frame what the map knows of scale and clocks. Out: whether a route may be
//! recorded, what helps until then, and what the walker is to hear, which counts as said once it was spoken.

use cairn_phrases::Language;
use cairn_sensor::Stamp;

/// The phone is known once lengths have been metres for so long, and the clocks have stayed within so many seconds of each
/// other. Of twenty simulated phones none had a metre off by a tenth for more than 2 s once there was one (figures/phone-imu.md), and
/// the offset of the clocks came out within 3 ms of the true one (figures/demo.md). An offset that was estimated once may be off by 10 ms
/// for seconds (`bench run newcomers`): where it was not found again it has to last twice as long.
const STEADY_S: f64 = 4.0;
const FOUND_ONCE_S: f64 = 8.0;
const SAME_CLOCK_S: f64 = 0.006;

/// What is known of the lens of a camera that nobody calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensKnowledge {
    /// The images are read with a guess.
    Guessed,
    /// The images are read with a guess, and without motion sensors it stays one.
    WithoutMotion,
    /// Another lens was found than the images are read with, while a route hangs on the map: what is recorded until it is
    /// used has wrong distances.
    FoundForLater,
    /// The images are read with the lens that was found.
    Found,
}

impl LensKnowledge {
    /// What is known as images begin to be read with a lens. A lens that is certain needs no motion sensors: it is that of a calibrated
    /// camera, there is nothing to be learned, and lengths without metres are told as such.
    pub fn of(is_certain: bool, has_motion: bool) -> Option<Self> {
        match (is_certain, has_motion) {
            (true, true) => Some(Self::Found),
            (true, false) => None,
            (false, true) => Some(Self::Guessed),
            (false, false) => Some(Self::WithoutMotion),
        }
    }
}

/// What a frame says about scale and clocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub now: Stamp,
    /// Lengths are metres.
    pub metric: bool,
    /// The motion sensors' clock against that of the images, seconds; `None` without motion sensors.
    pub offset_s: Option<f64>,
    /// The motion sensors contradict the length of a metre.
    pub is_contradicted: bool,
}

/// What is known of the phone, and what its walker has heard of it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Learning {
    /// Nothing for a calibrated camera, which has nothing to be learned.
    pub lens: Option<LensKnowledge>,
    /// Since when nothing has changed, and the offset of the clocks then.
    since: Option<(Stamp, Option<f64>)>,
    /// The offset of the clocks has been estimated anew since then, and was the same; or there is none.
    is_same_again: bool,
    is_steady: bool,
    /// The sentence that was spoken last.
    spoken: Option<&'static str>,
    /// The walker waits for word that it is known.
    is_awaited: bool,
}

impl Learning {
    /// Whether the images are read with a lens that is a guess, or is known to be another.
    pub fn reads_with_guess(&self) -> bool {
        self.lens.is_some_and(|lens| lens != LensKnowledge::Found)
    }

    /// Takes a frame.
    pub fn see(&mut self, seen: Seen) {
        let is_same = |(_, before): &(Stamp, Option<f64>)| match (*before, seen.offset_s) {
            (Some(before), Some(now)) => (now - before).abs() <= SAME_CLOCK_S,
            (before, now) => before == now,
        };
        let counts = seen.metric && !seen.is_contradicted;
        let kept = self.since.filter(is_same).filter(|_| counts);
        let is_again = kept.is_some_and(|(_, before)| self.is_same_again || before != seen.offset_s);
        self.is_same_again = is_again || seen.offset_s.is_none();
        self.since = kept.or(counts.then_some((seen.now, seen.offset_s)));
        let steady_s = if self.is_same_again { STEADY_S } else { FOUND_ONCE_S };
        self.is_steady |= self.since.is_some_and(|(since, _)| seen.now - since >= steady_s);
    }

    /// Another map begins, with another lens.
    pub fn begins_again(&mut self) {
        (self.since, self.is_same_again, self.is_steady) = (None, false, false);
    }

    /// What the walker is to do before a route can be recorded: the id of a sentence; `None` where one can.
    pub fn what_helps(&self) -> Option<&'static str> {
        match self.lens? {
            LensKnowledge::Guessed => Some("walk-learn"),
            LensKnowledge::WithoutMotion => Some("walk-learn-no-motion"),
            LensKnowledge::FoundForLater => Some("walk-learn-again"),
            LensKnowledge::Found => (!self.is_steady).then_some("walk-learn-move"),
        }
    }

    /// The walker asked for what cannot be done yet, and was told what helps.
    pub fn is_awaited(&mut self) {
        self.is_awaited = true;
    }

    /// The sentence that the walker is to hear now.
    pub fn news(&self) -> Option<&'static str> {
        let due = match (self.what_helps(), self.lens?) {
            (None, _) => self.is_awaited.then_some("walk-ready"),
            (Some(_), LensKnowledge::Found) => None,
            (helps, _) => helps,
        };
        due.filter(|due| self.spoken != Some(due))
    }

    /// Whether the walker need not hear the end of this sentence, because of what they are to hear now.
    pub fn is_moot(&self, said: &str, language: Language) -> bool {
        let asked = ["walk-learn", "walk-learn-move", "walk-learn-again"];
        self.news() == Some("walk-ready") && asked.into_iter().any(|id| language.text(id) == said)
    }

    /// A sentence was spoken.
    pub fn was_spoken(&mut self, id: &'static str) {
        self.spoken = Some(id);
        self.is_awaited = id != "walk-ready";
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(s: f64, metric: bool, offset_s: f64) -> Seen {
        Seen { now: Stamp::from_seconds(s), metric, offset_s: Some(offset_s), is_contradicted: false }
    }

    #[test]
    fn nothing_is_learned_of_a_calibrated_camera() {
        let learning = Learning::default();
        assert_eq!((learning.what_helps(), learning.news()), (None, None));
        // Nor of a lens that was learned on another day, by a phone whose motion sensors were not allowed today: it would wait for
        // metres that never come.
        assert_eq!(LensKnowledge::of(true, false), None);
        assert_eq!(LensKnowledge::of(false, false), Some(LensKnowledge::WithoutMotion));
    }

    #[test]
    fn a_phone_is_known_once_lens_metres_and_clocks_are() {
        let mut learning = Learning { lens: Some(LensKnowledge::Guessed), ..Learning::default() };
        (0..80).for_each(|k| learning.see(seen(0.1 * f64::from(k), true, 0.0)));
        assert_eq!(learning.what_helps(), Some("walk-learn"), "its lens is a guess");
        learning.lens = Some(LensKnowledge::Found);
        learning.begins_again();
        assert_eq!(learning.what_helps(), Some("walk-learn-move"));
        // No metres; then another offset of the clocks every second; then a contradicted metre.
        (0..50).for_each(|k| learning.see(seen(0.1 * f64::from(k), false, 0.0)));
        (50..100).for_each(|k| learning.see(seen(0.1 * f64::from(k), true, 0.01 * f64::from(k / 10))));
        for k in 100..150 {
            let is_contradicted = k % 20 == 0;
            learning.see(Seen { is_contradicted, ..seen(0.1 * f64::from(k), true, 0.05) });
        }
        assert_eq!(learning.what_helps(), Some("walk-learn-move"));
        let mut once = learning;
        (150..195)
            .for_each(|k| learning.see(seen(0.1 * f64::from(k), true, if k < 170 { 0.05 } else { 0.052 })));
        assert_eq!(learning.what_helps(), None);
        // An offset that was not found again has to last longer.
        (150..195).for_each(|k| once.see(seen(0.1 * f64::from(k), true, 0.05)));
        assert_eq!(once.what_helps(), Some("walk-learn-move"));
        (195..235).for_each(|k| once.see(seen(0.1 * f64::from(k), true, 0.05)));
        assert_eq!(once.what_helps(), None);
        // A moment without metres takes nothing back.
        learning.see(seen(20.0, false, 0.05));
        assert_eq!(learning.what_helps(), None);
    }

    #[test]
    fn ready_is_told_to_those_who_wait_until_it_was_spoken() {
        let mut learning = Learning { lens: Some(LensKnowledge::Guessed), ..Learning::default() };
        assert_eq!(learning.news(), Some("walk-learn"));
        learning.was_spoken("walk-learn");
        assert_eq!(learning.news(), None);
        learning.lens = Some(LensKnowledge::Found);
        assert_eq!(learning.news(), None);
        learning.is_steady = true;
        assert_eq!([learning.news(), learning.news()], [Some("walk-ready"); 2], "it was not spoken");
        let moot = |l: &Learning, id| l.is_moot(&Language::German.text(id), Language::German);
        assert!(moot(&learning, "walk-learn") && !moot(&learning, "walk-paused"));
        learning.was_spoken("walk-ready");
        assert_eq!(learning.news(), None);
        assert!(!moot(&learning, "walk-learn"));
        // Whoever comes with a lens that was kept hears it only where they asked too early.
        let mut learning = Learning { lens: Some(LensKnowledge::Found), ..Learning::default() };
        assert_eq!(learning.news(), None);
        learning.is_awaited();
        learning.is_steady = true;
        assert_eq!(learning.news(), Some("walk-ready"));
    }
}
