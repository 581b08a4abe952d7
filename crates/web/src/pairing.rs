//! Pairing by voice: a phone without the access token asks for a code, the computer says six digits, and who types them is given
//! the token, which the page keeps and a bookmark of it has.
//!
//! A code bears three tries. The one after a code that was used up comes later each time: in a day a guesser has less than a
//! hundred tries at a million codes, each of them announced.

use crate::error::WebError;
use crate::token::{random, same};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Wrong tries that a code bears, and how long it is valid.
const TRIES: u8 = 3;
const VALID: Duration = Duration::from_secs(300);
/// A code is said again at most this often.
const SAID_EVERY: Duration = Duration::from_secs(5);
/// The rest after the first code that was used up, which doubles with each, and the longest.
const REST: Duration = Duration::from_secs(30);
const LONGEST_REST: Duration = Duration::from_secs(3600);

/// The code that is valid now, and when there may be another.
pub(crate) struct Pairing(Mutex<Codes>);

struct Codes {
    code: Option<Code>,
    rest: Duration,
    next: Option<Instant>,
}

struct Code {
    digits: String,
    until: Instant,
    said: Option<Instant>,
    tries: u8,
}

impl Default for Pairing {
    fn default() -> Self {
        Self(Mutex::new(Codes { code: None, rest: REST, next: None }))
    }
}

impl Pairing {
    /// The digits to be said now; nothing where they were said a moment ago.
    pub(crate) fn ask(
        &self,
        now: Instant,
        fresh: impl FnOnce() -> Result<String, WebError>,
    ) -> Result<Option<String>, u64> {
        let mut codes = self.codes();
        codes.code.take_if(|code| now >= code.until);
        if codes.code.is_none() {
            if let Some(wait) = codes.next.and_then(|next| next.checked_duration_since(now)) {
                return Err(wait.as_secs() + 1);
            }
            let digits = fresh().map_err(|_| REST.as_secs())?;
            codes.code = Some(Code { digits, until: now + VALID, said: None, tries: TRIES });
        }
        let due = codes.code.as_mut().filter(|c| c.said.is_none_or(|said| now - said >= SAID_EVERY));
        Ok(due.map(|code| {
            code.said = Some(now);
            code.digits.clone()
        }))
    }

    /// Whether these are the digits of the code; else how many tries are left. A code is used once.
    pub(crate) fn try_digits(&self, digits: &str, now: Instant) -> Result<(), u8> {
        let mut codes = self.codes();
        let Some(code) = codes.code.as_mut().filter(|code| now < code.until) else { return Err(0) };
        let is_right = same(&code.digits, digits);
        code.tries -= 1;
        let left = code.tries;
        if is_right {
            *codes = Codes { code: None, rest: REST, next: None };
            return Ok(());
        }
        if left == 0 {
            let rest = codes.rest;
            *codes = Codes { code: None, rest: LONGEST_REST.min(2 * rest), next: Some(now + rest) };
        }
        Err(left)
    }

    fn codes(&self) -> MutexGuard<'_, Codes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Six digits that nobody can foresee.
pub(crate) fn six_digits() -> Result<String, WebError> {
    Ok(format!("{:06}", u32::from_le_bytes(random()?) % 1_000_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fresh() -> Result<String, WebError> {
        Ok("012345".into())
    }

    #[test]
    fn a_code_is_said_once_a_while_and_opens_once() {
        let (pairing, start) = (Pairing::default(), Instant::now());
        assert_eq!(pairing.try_digits("012345", start), Err(0), "nobody has asked");
        assert_eq!(pairing.ask(start, fresh), Ok(Some("012345".into())));
        assert_eq!(pairing.ask(start + Duration::from_secs(1), fresh), Ok(None));
        assert_eq!(pairing.ask(start + SAID_EVERY, fresh), Ok(Some("012345".into())));
        assert_eq!(pairing.try_digits("01234", start), Err(2));
        assert_eq!(pairing.try_digits("012345", start), Ok(()));
        assert_eq!(pairing.try_digits("012345", start), Err(0), "once");
        pairing.ask(start, fresh).unwrap();
        assert_eq!(pairing.try_digits("012345", start + VALID), Err(0), "too late");
    }

    #[test]
    fn a_guesser_has_few_tries_in_a_day() {
        let (pairing, start) = (Pairing::default(), Instant::now());
        let (mut tries, mut now) = (0, start);
        while now < start + Duration::from_secs(86_400) {
            match pairing.ask(now, fresh) {
                Ok(_) => {
                    tries += (0..).take_while(|_| pairing.try_digits("999999", now) != Err(0)).count() + 1
                }
                Err(wait) => now += Duration::from_secs(wait),
            }
        }
        assert!((60..100).contains(&tries), "{tries}");
        let again = now + LONGEST_REST;
        pairing.ask(again, fresh).unwrap();
        assert_eq!(pairing.try_digits("012345", again), Ok(()));
        for _ in 0..TRIES {
            pairing.ask(again, fresh).unwrap();
            let _ = pairing.try_digits("9", again);
        }
        assert_eq!(
            pairing.ask(again, fresh),
            Err(REST.as_secs() + 1),
            "after a success the rest is short again"
        );
    }

    #[test]
    fn digits_are_six() {
        let codes: Vec<String> = (0..50).map(|_| six_digits().unwrap()).collect();
        assert!(codes.iter().all(|c| c.len() == 6 && c.bytes().all(|b| b.is_ascii_digit())), "{codes:?}");
        assert!(codes[1..].iter().any(|c| *c != codes[0]));
    }
}
