//! Pairing by voice: a phone without the access token asks for a code, the computer says six digits, and who types them is given
//! the token, which the page keeps and a bookmark of it has.
//!
//! A code bears three tries. The one after a code that was used up comes later each time: in a day a guesser has less than a
//! hundred tries at a million codes, each of them announced.

use crate::error::WebError;
use crate::hub::Hub;
use crate::token::{random, same};
use axum::Router;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::post;
use cairn_phrases::{Arg, Language};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Wrong tries that a code bears, and how long it is valid.
const TRIES: u8 = 3;
const VALID: Duration = Duration::from_secs(300);
/// A code is said again at most this often.
const SAID_EVERY: Duration = Duration::from_secs(5);
/// The rest after the first code that was used up, which doubles with each, and the longest.
const REST: Duration = Duration::from_secs(30);
const LONGEST_REST: Duration = Duration::from_secs(3600);

/// The largest request, bytes.
const LARGEST: usize = 256;

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

/// What a page is answered.
#[derive(Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Answer {
    /// The code has been said.
    Said(bool),
    /// Seconds until there may be another.
    Wait(u64),
    /// The digits were wrong; so many tries are left.
    Wrong(u8),
    /// The digits were right: the access token.
    Key(String),
}

/// What a page asks: to hear the code in its language, or whether these are its digits.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    #[serde(default)]
    language: String,
    digits: Option<String>,
}

impl Default for Pairing {
    fn default() -> Self {
        Self(Mutex::new(Codes { code: None, rest: REST, next: None }))
    }
}

impl Pairing {
    /// The digits to be said now; nothing where they were said a moment ago.
    fn ask(
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
    fn try_digits(&self, digits: &str, now: Instant) -> Result<(), u8> {
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
fn six_digits() -> Result<String, WebError> {
    Ok(format!("{:06}", u32::from_le_bytes(random()?) % 1_000_000))
}

/// The request by which a phone is paired.
pub(crate) fn routes() -> Router<Arc<Hub>> {
    Router::new().route("/pair", post(pair).layer(DefaultBodyLimit::max(LARGEST)))
}

async fn pair(State(hub): State<Arc<Hub>>, headers: HeaderMap, body: String) -> Response {
    if !is_own(&headers) {
        return StatusCode::FORBIDDEN.into_response();
    }
    let Ok(asked) = serde_json::from_str(&body) else { return StatusCode::BAD_REQUEST.into_response() };
    let text = serde_json::to_string(&answer(&hub, asked)).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-store")], text).into_response()
}

/// Whether this page asks, and not another site that a browser in the network shows: that would use up the codes.
fn is_own(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    text(header::ORIGIN)
        .is_none_or(|origin| origin.split_once("//").map(|(_, host)| host) == text(header::HOST))
}

fn answer(hub: &Hub, asked: Asked) -> Answer {
    let (now, pairing) = (Instant::now(), &hub.access.pairing);
    match asked.digits {
        None => match pairing.ask(now, six_digits) {
            Ok(digits) => {
                let language = asked.language.parse().unwrap_or_default();
                digits.iter().for_each(|digits| say(hub, digits, language));
                Answer::Said(true)
            }
            Err(wait) => Answer::Wait(wait),
        },
        Some(digits) => match pairing.try_digits(&digits, now) {
            Ok(()) => Answer::Key(hub.access.token.clone()),
            Err(left) => Answer::Wrong(left),
        },
    }
}

/// Says and prints the code, one digit at a time.
fn say(hub: &Hub, digits: &str, language: Language) {
    let digits: Vec<String> = digits.chars().map(String::from).collect();
    let text = language.say("page-pair-code", &[("digits", Arg::Text(&digits.join(", ")))]);
    (hub.access.tell)(&text);
    (hub.access.aloud)(language, &text);
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
    fn another_site_does_not_pair() {
        let headers = |origin: Option<&str>| {
            let named = [(header::HOST, Some("192.168.1.7:8443")), (header::ORIGIN, origin)];
            let given = named.into_iter().filter_map(|(name, value)| Some((name, value?.parse().ok()?)));
            given.collect::<HeaderMap>()
        };
        assert!(is_own(&headers(None)) && is_own(&headers(Some("https://192.168.1.7:8443"))));
        let others =
            ["https://evil.example", "https://192.168.1.7:8443.evil.example", "null", "https://192.168.1.7"];
        assert!(others.iter().all(|other| !is_own(&headers(Some(other)))));
    }

    #[test]
    fn digits_are_six() {
        let codes: Vec<String> = (0..50).map(|_| six_digits().unwrap()).collect();
        assert!(codes.iter().all(|c| c.len() == 6 && c.bytes().all(|b| b.is_ascii_digit())), "{codes:?}");
        assert!(codes[1..].iter().any(|c| *c != codes[0]));
    }
}
