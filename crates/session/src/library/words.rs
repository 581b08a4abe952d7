//! The sentences about kept routes, put together from the catalogue.

use super::{RouteEntry, WallTime};
use crate::refused::Refused;
use cairn_guide::PhraseConfig;
use cairn_phrases::{Arg, Language};

/// How many routes are named when the list is spoken.
pub(crate) const SPOKEN: usize = 5;

/// Why a route cannot be walked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RouteProblem {
    OtherMap,
    /// The lens was a guess.
    Guessed,
    Unreadable,
}

/// "Route 3, to the kitchen, 40 metres, yesterday"; without a length that was a guess.
pub(crate) fn route(entry: &RouteEntry, now: WallTime, phrases: &PhraseConfig) -> String {
    let mut parts = vec![short(entry, phrases.language)];
    parts.extend(entry.length_m.filter(|_| !entry.lens_guessed).map(|metres| phrases.distance(metres)));
    parts.extend(entry.recorded_s.map(|s| when(now.days_since(s), phrases.language)));
    parts.extend(entry.lens_guessed.then(|| phrases.language.text("walk-route-lens-unknown")));
    parts.join(", ")
}

/// "Route 3, to the kitchen".
pub(crate) fn short(entry: &RouteEntry, language: Language) -> String {
    let number = entry.number.to_string();
    let number = ("number", (&number).into());
    match &entry.name {
        Some(name) => language.say("walk-route-named", &[number, ("name", name.into())]),
        None => language.say("walk-route-number", &[number]),
    }
}

pub(crate) fn when(days: i64, language: Language) -> String {
    let say = |id: &str, name: &str, count: i64| language.say(id, &[(name, Arg::Number(count as f64, 0))]);
    match days {
        0..14 => say("walk-when", "days", days),
        14..60 => say("walk-when-weeks", "weeks", days / 7),
        60..730 => say("walk-when-months", "months", days / 30),
        _ => say("walk-when-years", "years", days / 365),
    }
}

/// The newest routes, newest first.
pub(crate) fn list<'a>(
    newest_first: impl ExactSizeIterator<Item = &'a RouteEntry>,
    now: WallTime,
    phrases: &PhraseConfig,
) -> String {
    let count = newest_first.len();
    let say = |id: &str, count: usize| phrases.language.say(id, &[("count", count.into())]);
    if count == 0 {
        return phrases.language.text("walk-routes-none");
    }
    let mut sentences = vec![say("walk-routes", count)];
    sentences.extend(newest_first.take(SPOKEN).map(|entry| format!("{}.", route(entry, now, phrases))));
    if count > SPOKEN {
        sentences.push(say("walk-routes-older", count - SPOKEN));
    }
    sentences.join(" ")
}

/// That a route is at hand; with the reason why it cannot be walked, if so.
pub(crate) fn loaded(route: &str, notes: usize, why_not: Option<RouteProblem>, language: Language) -> String {
    let route = match notes {
        0 => route.to_owned(),
        n => format!("{route}, {}", language.say("walk-with-notes", &[("count", n.into())])),
    };
    let route = ("route", (&route).into());
    match why_not {
        None => language.say("walk-route-loaded", &[route]),
        Some(why) => {
            let why = self::why_not(why, language);
            language.say("walk-route-loaded-elsewhere", &[route, ("why", (&why).into())])
        }
    }
}

/// Why a route cannot be walked, after a colon.
pub(crate) fn why_not(why: RouteProblem, language: Language) -> String {
    language.text(match why {
        RouteProblem::OtherMap => "walk-why-other-map",
        RouteProblem::Guessed => "walk-why-guessed",
        RouteProblem::Unreadable => "walk-why-damaged",
    })
}

/// A sentence about one route.
pub(crate) fn about(id: &str, route: &str, language: Language) -> String {
    language.say(id, &[("route", route.into())])
}

pub(crate) fn unknown(number: u32, language: Language) -> Refused {
    Refused::new(language, "walk-unknown-route", &[("number", (&number.to_string()).into())])
}

pub(crate) fn noted(text: &str, side: Option<cairn_guide::Side>, language: Language) -> String {
    let text = ("text", text.into());
    match side {
        Some(side) => language.say("walk-noted-side", &[text, ("side", side.name().into())]),
        None => language.say("walk-noted", &[text]),
    }
}
