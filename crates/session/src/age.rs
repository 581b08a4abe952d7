//! Age of the last image, and the rule based on it: no direction is given from an image older than [`STALE_S`].
//!
//! Input: the clock of a live source, the stamps of frames and poses. Output: the age with its error bound, and a
//! reason to stop. The time of capture counts, not the time of arrival; an unknown age counts as too old. A recording
//! has no age.

use cairn_guide::StopReason;
use cairn_phrases::{Arg, Language};
use cairn_sensor::{ClockReading, Live, Stamp};
use serde::{Serialize, Serializer};
use std::sync::Arc;

/// Limit in seconds beyond which an image gives no directions: for the age plus the larger of its error bound and the
/// delivery time of the words.
pub(crate) const STALE_S: f64 = 0.5;
/// Images that arrived within this time count as still arriving, however late they are, seconds.
const COMES_S: f64 = 1.0;
/// One reason is kept for this long, so that "stop" is not repeated for another symptom of the same problem, seconds.
const SAME_REASON_S: f64 = 3.0;

/// The age of the last image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Age {
    /// The images are from a recording, or none has arrived yet.
    #[default]
    Recorded,
    /// The source's clock is not known.
    Unknown,
    /// It is known.
    Known {
        /// Seconds since the capture.
        age_s: f64,
        /// The largest error, seconds.
        bound_s: f64,
        /// Seconds until spoken words reach the walker.
        delivery_s: f64,
    },
}

impl Age {
    fn of(reading: Option<ClockReading>, stamp: Stamp) -> Self {
        let known = |r: ClockReading| Age::Known {
            age_s: r.now - stamp,
            bound_s: r.bound_s,
            delivery_s: r.delivery_s,
        };
        reading.map_or(Age::Unknown, known)
    }

    /// Whether it is too old to guide by the time the words are heard; an unknown age is.
    pub fn is_stale(&self) -> bool {
        match *self {
            Age::Recorded => false,
            Age::Unknown => true,
            // As ClockReading::oldest_when_heard_s; NaN counts as stale.
            Age::Known { age_s, bound_s, delivery_s } => {
                let oldest_s = age_s + bound_s.max(delivery_s);
                oldest_s.is_nan() || oldest_s > STALE_S
            }
        }
    }

    /// As a sentence, for the status on request; `None` for a recording.
    pub fn words(&self, language: Language) -> Option<String> {
        match *self {
            Age::Recorded => None,
            Age::Unknown => Some(language.text("walk-age-unknown")),
            Age::Known { age_s, bound_s, .. } => {
                let oldest = (age_s + bound_s).max(0.0);
                let id = if self.is_stale() { "walk-age-too-old" } else { "walk-age" };
                Some(language.say(id, &[("seconds", Arg::Number(oldest, 1))]))
            }
        }
    }
}

impl Serialize for Age {
    /// `null` for a recording, `"unknown"`, or an object of `age_s`, `bound_s` and `delivery_s`.
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        match *self {
            Age::Recorded => s.serialize_none(),
            Age::Unknown => s.serialize_str("unknown"),
            Age::Known { age_s, bound_s, delivery_s } => {
                let mut known = s.serialize_struct("Age", 3)?;
                known.serialize_field("age_s", &age_s)?;
                known.serialize_field("bound_s", &bound_s)?;
                known.serialize_field("delivery_s", &delivery_s)?;
                known.end()
            }
        }
    }
}

/// Follows a live source's clock.
#[derive(Default)]
pub(crate) struct Ages {
    live: Option<Arc<dyn Live>>,
    /// When the last frame came, in the session's time.
    came: Option<Stamp>,
    /// The current reason, and since when.
    reason: Option<(StopReason, Stamp)>,
}

impl Ages {
    pub fn follow(&mut self, live: Arc<dyn Live>) {
        self.live = Some(live);
    }

    /// A frame arrived, at this time of the session.
    pub fn came(&mut self, now: Stamp) {
        self.came = Some(now);
    }

    /// The age of what was captured at `stamp`.
    pub fn of(&self, stamp: Option<Stamp>) -> Age {
        match (&self.live, stamp) {
            (Some(live), Some(stamp)) => Age::of(live.clock(), stamp),
            _ => Age::Recorded,
        }
    }

    /// Why the source's images cannot be used, if so.
    pub fn trouble(&self) -> Option<String> {
        self.live.as_ref()?.trouble()
    }

    /// The reason to stop, if the last frame is too old.
    pub fn hazard(&mut self, frame: Option<Stamp>, now: Stamp) -> Option<StopReason> {
        let age = self.of(frame);
        if !age.is_stale() {
            self.reason = None;
            return None;
        }
        let comes = self.came.is_some_and(|came| now - came < COMES_S);
        let found = match age {
            Age::Unknown => StopReason::AgeUnknown,
            _ if comes => StopReason::PicturesLate,
            _ => StopReason::PoseStale,
        };
        match self.reason {
            Some((reason, since)) if reason != found && now - since < SAME_REASON_S => Some(reason),
            Some((reason, _)) if reason == found => Some(reason),
            _ => {
                self.reason = Some((found, now));
                Some(found)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    /// A clock that shows what the test sets.
    #[derive(Default)]
    struct Shown(Mutex<Option<ClockReading>>);

    impl Live for Shown {
        fn clock(&self) -> Option<ClockReading> {
            *self.0.lock().unwrap()
        }
    }

    fn at(s: f64) -> Stamp {
        Stamp::from_seconds(s)
    }

    #[test]
    fn age_with_bound_or_delivery_counts_and_unknown_is_too_old() {
        let known = |age_s, bound_s, delivery_s| Age::Known { age_s, bound_s, delivery_s }.is_stale();
        assert!(
            !known(0.3, 0.1, 0.2) && known(0.3, 0.1, 0.21) && known(0.3, 0.21, 0.1) && known(0.6, 0.0, 0.0)
        );
        assert!(known(f64::NAN, 0.0, 0.0));
        assert!(Age::Unknown.is_stale() && !Age::Recorded.is_stale());
        let age = Age::Known { age_s: 0.15, bound_s: 0.05, delivery_s: 0.05 };
        assert_eq!(age.words(Language::English).unwrap(), "The picture is 0.2 seconds old.");
        let json = |age: Age| serde_json::to_value(age).unwrap();
        assert_eq!(json(age)["age_s"], 0.15);
        assert_eq!(json(Age::Unknown), "unknown");
        assert!(json(Age::Recorded).is_null());
    }

    #[test]
    fn reason_is_named_and_kept_for_a_while() {
        let shown = Arc::new(Shown::default());
        let mut ages = Ages::default();
        assert_eq!(ages.hazard(Some(at(0.0)), at(9.0)), None, "a recording has no age");
        ages.follow(shown.clone());
        assert_eq!(ages.hazard(None, at(0.0)), None, "no picture came yet");
        ages.came(at(1.0));
        assert_eq!(ages.hazard(Some(at(1.0)), at(1.0)), Some(StopReason::AgeUnknown));
        let show = |now: f64| {
            *shown.0.lock().unwrap() = Some(ClockReading { now: at(now), bound_s: 0.02, delivery_s: 0.03 })
        };
        show(1.47);
        assert_eq!(ages.hazard(Some(at(1.0)), at(1.1)), None);
        // The image was late, and the next does not arrive: one reason for three seconds.
        show(1.6);
        assert_eq!(ages.hazard(Some(at(1.0)), at(1.2)), Some(StopReason::PicturesLate));
        show(3.0);
        assert_eq!(ages.hazard(Some(at(1.0)), at(2.7)), Some(StopReason::PicturesLate));
        assert_eq!(ages.hazard(Some(at(1.0)), at(4.3)), Some(StopReason::PoseStale));
    }
}
