//! "Take me to ..." during a walk: a way over the routes that are kept is planned from here, and guidance begins along it.
//!
//! In: the words of the command, the routes of the folder and of this session, the last pose. Out: guidance along the
//! planned way and its confirmation, or the reason why there is none. A place is the start or the end of a route, by the
//! route's number or name, or as it is spoken.

use super::{RouteAtHand, Session};
use crate::library::{SPOKEN, number_of};
use crate::refused::Refused;
use crate::slam::Slam;
use crate::take_me::{NoWay, WalkedRoutes};
use cairn_guide::Route;
use cairn_phrases::Language;
use cairn_plan::search::Place;
use cairn_plan::walked::NotWalked;
use std::path::Path;

/// A shorter way leads nowhere, metres: one stands at the place.
const THERE_M: f64 = 1.0;

/// A route that one can be taken along.
struct KnownRoute {
    number: Option<u32>,
    name: Option<String>,
    route: Route,
}

/// One of the ends of a route.
#[derive(Clone, Copy, Debug, PartialEq)]
enum RouteEnd {
    Start,
    End,
}

impl<S: Slam> Session<S> {
    /// Plans the way over the known routes from here to a place, and starts guidance along it. Without a place: says which places there are.
    pub(super) fn take_me(&mut self, to: &str) -> Result<String, Refused> {
        let to = said(to);
        let (known, language) = (self.known_routes(), self.speech.language());
        let snapshot = self.engine.snapshot();
        let walked = WalkedRoutes::new(&snapshot, known.iter().map(|k| (k.title(language), &k.route)));
        if to.is_empty() {
            return Ok(language.say("walk-way-places", &places(&known, language).args()));
        }
        let found = found(&known, to, language);
        let refused = |id, place: &str| Refused::new(language, id, &[("place", place.into())]);
        let (k, end) = match found[..] {
            [one] => one,
            [] => {
                let places = places(&known, language);
                let args = [&[("place", to.into())][..], &places.args()].concat();
                return Err(Refused::new(language, "walk-way-unknown", &args));
            }
            _ => return Err(refused("walk-way-ambiguous", to)),
        };
        let here = self.place.as_ref().zip(self.scale);
        let (place, scale) = here.ok_or_else(|| Refused::new(language, "walk-way-here-unknown", &[]))?;
        if walked.destinations().iter().all(|d| d.map != scale.map) {
            return Err(Refused::new(language, "walk-searching", &[]));
        }
        let spoken = known[k].place(end, language);
        let [start, last] = walked.ends(k);
        let to = if end == RouteEnd::Start { start } else { last };
        let from = place.world_from_camera.se3.translation;
        let planned = to
            .ok_or(NoWay::NotWalked(NotWalked::NoRoute))
            .and_then(|to| walked.take_me(scale.map, from, &to))
            .map_err(|why| refused(sentence(&why), &spoken))?;
        if planned.route.points.len() < 2 || planned.path.length_m < THERE_M {
            return Err(Refused::new(language, "walk-way-there", &[]));
        }
        let mut route = planned.route;
        route.header.name = Some(spoken.clone());
        let phrases = self.speech.phrases_for(route.header.metric);
        let ids = ["walk-way-going", "walk-way-going-unmeasured"];
        let going = phrases.measured(ids, planned.path.length_m, &[("place", (&spoken).into())]);
        let before = self.route.replace(RouteAtHand { route, path: None, here: true });
        match self.begin_guiding(self.config.facing, true) {
            Ok(_) => Ok(going),
            Err(why) => {
                // Guidance that was in progress goes on along its own route.
                self.route = before;
                Err(why)
            }
        }
    }

    /// The routes that are anchored in the map of this session, newest first: those of the folder, of this session, and
    /// the one at hand.
    fn known_routes(&mut self) -> Vec<KnownRoute> {
        self.refresh();
        let mut known = Vec::new();
        let named = |path: Option<&Path>, route: &Route| {
            let file = || Some(path?.file_stem()?.to_string_lossy().into_owned());
            let name = route.header.name.clone().or_else(file);
            name.unwrap_or_else(|| self.speech.text("walk-in-memory"))
        };
        if let Some(recording) = &self.recording {
            let (path, route) = (recording.path.as_deref(), recording.route());
            let number = path.filter(|p| p.parent() == Some(self.folder.path())).and_then(number_of);
            let name = number.is_none().then(|| named(path, route));
            known.push(KnownRoute { number, name, route: route.clone() });
        }
        for entry in self.folder.newest_first() {
            if self.why_not(entry).is_none()
                && let Ok(route) = Route::load(&entry.path)
            {
                known.push(KnownRoute { number: Some(entry.number), name: entry.name.clone(), route });
            }
        }
        let in_folder =
            |path: &Option<_>| path.as_deref().is_some_and(|p: &Path| self.folder.by_path(p).is_some());
        for (path, route) in self.recorded.iter().filter(|(path, _)| !in_folder(path)) {
            let name = Some(named(path.as_deref(), route));
            known.push(KnownRoute { number: None, name, route: route.clone() });
        }
        // A planned way has no file: it is made of the others.
        let held = self.route.as_ref().filter(|w| w.here && w.path.is_some() && !in_folder(&w.path));
        let is_new = |path: &Path| !self.recorded.iter().any(|(p, _)| p.as_deref() == Some(path));
        if let Some(held) = held.filter(|w| w.path.as_deref().is_some_and(is_new)) {
            let name = Some(named(held.path.as_deref(), &held.route));
            known.push(KnownRoute { number: None, name, route: held.route.clone() });
        }
        known.retain(|k| k.route.points.len() >= 2 && !k.route.header.lens_guessed);
        known
    }
}

impl KnownRoute {
    /// "kitchen", or "route 3".
    fn title(&self, language: Language) -> String {
        match (&self.name, self.number) {
            (Some(name), _) => said(name).to_owned(),
            (None, Some(number)) => numbered(number, language),
            (None, None) => language.text("walk-in-memory"),
        }
    }

    /// An end as it is spoken: "kitchen", "the start of kitchen", "the end of route 3".
    fn place(&self, end: RouteEnd, language: Language) -> String {
        match (end, &self.name) {
            (RouteEnd::End, Some(name)) => said(name).to_owned(),
            _ => {
                let (end, title) =
                    (if end == RouteEnd::Start { "start" } else { "end" }, self.title(language));
                language.say("walk-way-place", &[("end", end.into()), ("route", (&title).into())])
            }
        }
    }

    /// Whether a place, in lower case and without "to the", is this end of a route of this title.
    fn is_called(&self, end: RouteEnd, title: &str, wanted: &str) -> bool {
        let title = bare(title);
        match end {
            RouteEnd::Start => {
                [format!("{title} start"), format!("start of {title}")].contains(&wanted.into())
            }
            RouteEnd::End => {
                [title.clone(), format!("{title} end"), format!("end of {title}")].contains(&wanted.into())
            }
        }
    }
}

/// "route 3".
fn numbered(number: u32, language: Language) -> String {
    language.say("walk-way-route", &[("number", (&number.to_string()).into())])
}

/// The places of some words: those of a number, else those of a name.
fn found(known: &[KnownRoute], to: &str, language: Language) -> Vec<(usize, RouteEnd)> {
    let wanted = bare(to);
    let all = || (0..known.len()).flat_map(|k| [(k, RouteEnd::Start), (k, RouteEnd::End)]);
    let by_number = all().filter(|&(k, end)| {
        let number = known[k].number.map(|n| [n.to_string(), format!("route {n}"), numbered(n, language)]);
        number.iter().flatten().any(|title| known[k].is_called(end, title, &wanted))
    });
    let by_number: Vec<_> = by_number.collect();
    if !by_number.is_empty() {
        return by_number;
    }
    let named = |&(k, end): &(usize, RouteEnd)| {
        let spoken = bare(&known[k].place(end, language)) == wanted;
        spoken || known[k].name.as_ref().is_some_and(|name| known[k].is_called(end, name, &wanted))
    };
    all().filter(named).collect()
}

/// Words in lower case, without "to" and "the" before them: "take me to the kitchen" finds kitchen and "to the kitchen".
fn bare(words: &str) -> String {
    let words = words.split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase();
    let words = words.strip_prefix("to ").unwrap_or(&words);
    words.strip_prefix("the ").unwrap_or(words).to_owned()
}

/// A name after "Going to": without a "to" of its own.
fn said(name: &str) -> &str {
    match name.split_once(' ') {
        Some((to, rest)) if to.eq_ignore_ascii_case("to") && !rest.trim().is_empty() => rest.trim(),
        _ => name,
    }
}

/// The places that are named when somebody asks for them: those of the newest routes.
struct Places {
    count: usize,
    names: String,
}

impl Places {
    fn args(&self) -> [(&str, cairn_phrases::Arg<'_>); 2] {
        [("count", self.count.into()), ("places", (&self.names).into())]
    }
}

fn places(known: &[KnownRoute], language: Language) -> Places {
    let ends = |k: &KnownRoute| [RouteEnd::End, RouteEnd::Start].map(|end| k.place(end, language));
    let names: Vec<String> = known.iter().take(SPOKEN).flat_map(ends).collect();
    Places { count: known.len(), names: names.join(", ") }
}

/// The sentence that says why there is no way.
fn sentence(why: &NoWay) -> &'static str {
    match why {
        NoWay::Unknown(_) => "walk-way-unknown",
        NoWay::Ambiguous(_) => "walk-way-ambiguous",
        NoWay::OtherMap => "walk-way-other-map",
        NoWay::NotWalked(
            NotWalked::FarFromRoutes { place: Place::Start, .. } | NotWalked::NotFinite(Place::Start),
        ) => "walk-way-far",
        NoWay::NotWalked(_) => "walk-way-not-joined",
    }
}
