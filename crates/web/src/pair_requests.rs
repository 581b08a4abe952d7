//! The request by which a phone is paired ([`crate::pairing`]): what a page asks, and what it is answered.

use crate::hub::Hub;
use crate::pairing::six_digits;
use axum::Router;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::post;
use cairn_phrases::{Arg, Language};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;

/// The largest request, bytes.
const LARGEST: usize = 256;

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

/// Where it is sent.
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
}
