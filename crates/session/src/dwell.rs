//! When a loss and a return are announced: a loss at once, a return only after it has lasted a second, and no warning
//! twice in half a minute.

use cairn_sensor::Stamp;

/// What was lost counts as back once it has been present for this long, seconds.
const BACK_S: f64 = 1.0;
/// The same warning is not said again within this time, seconds.
const AGAIN_S: f64 = 30.0;
/// Number of different warnings that are remembered.
const REMEMBERED: usize = 16;

/// Follows one condition that can be lost.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Dwell {
    lost: bool,
    back_since: Option<Stamp>,
}

impl Dwell {
    /// It is lost; true when this is to be announced.
    pub fn lost(&mut self) -> bool {
        self.back_since = None;
        !std::mem::replace(&mut self.lost, true)
    }

    /// It is missing for a moment: if it was lost, the wait for its return starts again.
    pub fn missing(&mut self) {
        self.back_since = None;
    }

    /// It is present; true when it was lost, has been present for a second, and this is to be announced.
    pub fn there(&mut self, now: Stamp) -> bool {
        if !self.lost {
            return false;
        }
        let back = now - *self.back_since.get_or_insert(now) >= BACK_S;
        if back {
            *self = Self::default();
        }
        back
    }

    /// Whether it was lost and has not returned since.
    pub fn is_lost(&self) -> bool {
        self.lost && self.back_since.is_none()
    }
}

/// Warnings given recently.
#[derive(Clone, Debug, Default)]
pub(crate) struct Warnings(Vec<(String, Stamp)>);

impl Warnings {
    /// Whether this warning is to be given now.
    pub fn due(&mut self, text: &str, now: Stamp) -> bool {
        self.0.retain(|(_, said)| now - *said < AGAIN_S);
        let due = self.0.iter().all(|(said, _)| said != text);
        if due {
            if self.0.len() == REMEMBERED {
                self.0.remove(0);
            }
            self.0.push((text.to_owned(), now));
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> Stamp {
        Stamp::from_seconds(s)
    }

    #[test]
    fn loss_is_told_at_once_and_return_after_a_second_of_it() {
        let mut dwell = Dwell::default();
        assert!(!dwell.there(at(0.0)) && dwell.lost() && !dwell.lost());
        assert!(!dwell.there(at(1.0)) && !dwell.is_lost());
        // Lost again within the second: neither change is announced.
        assert!(!dwell.lost() && dwell.is_lost());
        assert!(
            !dwell.there(at(1.5)) && !dwell.there(at(2.4)) && dwell.there(at(2.5)) && !dwell.there(at(2.6))
        );
        assert!(dwell.lost());
    }

    #[test]
    fn one_warning_of_a_kind_in_half_a_minute() {
        let mut warnings = Warnings::default();
        let said = (0..74).filter(|k| warnings.due("It is dark.", at(0.1 * f64::from(*k)))).count();
        assert_eq!(said, 1);
        assert!(warnings.due("It is bright.", at(8.0)) && !warnings.due("It is dark.", at(29.0)));
        assert!(warnings.due("It is dark.", at(30.5)));
    }
}
