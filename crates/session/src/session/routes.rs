//! The commands about kept routes: list, load, name, delete.

use super::{PendingQuestion, RouteAtHand, Session};
use crate::command::RouteChoice;
use crate::library::words::RouteProblem;
use crate::library::{MOST_KEY_FRAMES, MOST_ROUTES, RouteEntry, RouteListed, checked_name, words};
use crate::refused::Refused;
use crate::slam::Slam;
use cairn_guide::{Priority, Route};
use std::path::{Path, PathBuf};

/// A question is open for this long, seconds.
const ASKED_S: f64 = 60.0;

impl<S: Slam> Session<S> {
    /// The routes of the folder as they are listed, newest first.
    pub fn routes(&self) -> Vec<RouteListed> {
        let (now, phrases) = ((self.wall)(), *self.speech.phrases());
        let held = self.route.as_ref().and_then(|w| w.path.as_deref());
        let listed = |e: &RouteEntry| {
            let why_not = self.why_not(e);
            RouteListed::of(e, now, &phrases, why_not, held == Some(&e.path))
        };
        self.folder.newest_first().into_iter().map(listed).collect()
    }

    /// Changes when [`Session::routes`] does.
    pub fn routes_version(&self) -> (u64, Option<&Path>) {
        (self.folder.version(), self.route.as_ref().and_then(|w| w.path.as_deref()))
    }

    /// Why a route cannot be walked in this session, if so.
    pub(super) fn why_not(&self, entry: &RouteEntry) -> Option<RouteProblem> {
        match &entry.damage {
            Some(_) => Some(RouteProblem::Unreadable),
            None if entry.lens_guessed => Some(RouteProblem::Guessed),
            None => (!self.is_here(&entry.path, entry.atlas.as_deref())).then_some(RouteProblem::OtherMap),
        }
    }

    /// Whether the route in a file is anchored in the map of this session.
    pub(super) fn is_here(&self, path: &Path, atlas: Option<&str>) -> bool {
        self.config.map_is_loaded
            || self.recorded_here.contains(path)
            || self.keeper.as_ref().is_some_and(|k| k.holds(path, atlas))
    }

    pub(super) fn refresh(&mut self) {
        self.folder.refresh(self.recording.as_ref().and_then(|r| r.path.as_deref()));
    }

    pub(super) fn list_words(&mut self) -> String {
        self.refresh();
        words::list(self.folder.newest_first().into_iter(), (self.wall)(), self.speech.phrases())
    }

    /// "Route 3, to the kitchen"; for a route without a number the name of its file.
    pub(super) fn short_name(&self, path: Option<&Path>, route: &Route) -> String {
        let file = || path.and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned());
        match path.and_then(|p| self.folder.by_path(p)) {
            Some(entry) => words::short(entry, self.speech.language()),
            None => {
                route.header.name.clone().or_else(file).unwrap_or_else(|| self.speech.text("walk-in-memory"))
            }
        }
    }

    /// Whether there is no room for one more route.
    pub(super) fn is_full(&mut self) -> bool {
        self.refresh();
        let large = || self.engine.snapshot().key_frame_count() >= MOST_KEY_FRAMES;
        self.keeper.is_some() && (self.folder.entries().len() >= MOST_ROUTES || large())
    }

    pub(super) fn load(&mut self, which: &RouteChoice) -> Result<String, Refused> {
        if self.guiding.is_some() {
            return Err(self.speech.refuse("walk-halt-first"));
        }
        self.refresh();
        let path = self.path_of(which)?;
        let held = self.route.as_ref().filter(|w| w.path.as_deref() == Some(&path));
        let route = match held {
            Some(held) => held.route.clone(),
            None => Route::load(&path).map_err(|e| self.speech.refuse_because("walk-route-unreadable", e))?,
        };
        if route.points.len() < 2 {
            return Err(self.speech.refuse("walk-route-empty"));
        }
        // A recording in progress ends, complete: the route to be walked is another one from now on.
        self.drop_unasked();
        let ended = self.recording.is_some().then(|| self.end_recording());
        let entry = self.folder.by_path(&path).cloned();
        let here = self.is_here(&path, route.header.atlas.as_deref());
        let named = match &entry {
            Some(entry) => words::route(entry, (self.wall)(), self.speech.phrases()),
            None => self.short_name(Some(&path), &route),
        };
        let why_not = match route.header.lens_guessed {
            true => Some(RouteProblem::Guessed),
            false => (!here).then_some(RouteProblem::OtherMap),
        };
        let text = words::loaded(&named, route.notes.len(), why_not, self.speech.language());
        self.route = Some(RouteAtHand { route, path: Some(path), here });
        Ok(match ended {
            Some(ended) => format!("{} {text}", ended.unwrap_or_else(|why| why.words)),
            None => text,
        })
    }

    fn path_of(&self, which: &RouteChoice) -> Result<PathBuf, Refused> {
        match which {
            RouteChoice::File(path) => Ok(path.clone()),
            RouteChoice::Number(number) => self
                .folder
                .get(*number)
                .map(|e| e.path.clone())
                .ok_or_else(|| words::unknown(*number, self.speech.language())),
            RouteChoice::Latest => {
                let newest = self.folder.newest_first().into_iter().find(|e| e.damage.is_none());
                let newest = newest.map(|e| e.path.clone());
                let other = || crate::library::latest(self.folder.path());
                newest.or_else(other).ok_or_else(|| self.speech.refuse("walk-no-saved-route"))
            }
        }
    }

    /// The number that is meant: this one, else that of the route at hand.
    fn number(&mut self, number: Option<u32>) -> Result<u32, Refused> {
        self.refresh();
        if let Some(number) = number {
            let being = self.recording.as_ref().and_then(|r| r.path.as_deref());
            if being.is_some_and(|p| p == self.folder.path().join(format!("route-{number:04}.route"))) {
                return Err(self.speech.refuse("walk-being-recorded"));
            }
            return self
                .folder
                .get(number)
                .map(|e| e.number)
                .ok_or_else(|| words::unknown(number, self.speech.language()));
        }
        let held = self.route.as_ref().and_then(|w| w.path.as_deref());
        let entry = held.and_then(|path| self.folder.by_path(path));
        entry.map(|e| e.number).ok_or_else(|| self.speech.refuse("walk-no-route-at-hand"))
    }

    pub(super) fn rename(&mut self, number: Option<u32>, name: &str) -> Result<String, Refused> {
        let number = self.number(number)?;
        let name = checked_name(name).map_err(|e| self.speech.refuse(e.sentence()))?;
        let named = self.folder.rename(number, name, &*self.disk);
        named.map_err(|why| self.speech.refuse_because("walk-rename-failed", why))?;
        self.refresh();
        let entry =
            self.folder.get(number).cloned().ok_or_else(|| words::unknown(number, self.speech.language()))?;
        if let Some(held) = self.route.as_mut().filter(|w| w.path.as_deref() == Some(&entry.path)) {
            held.route.header.name.clone_from(&entry.name);
        }
        Ok(words::about(
            "walk-renamed",
            &words::short(&entry, self.speech.language()),
            self.speech.language(),
        ))
    }

    pub(super) fn ask_delete(&mut self, number: Option<u32>) -> Result<String, Refused> {
        let number = self.number(number)?;
        let entry = self.folder.get(number).ok_or_else(|| words::unknown(number, self.speech.language()))?;
        let held = self.route.as_ref().and_then(|w| w.path.as_deref()) == Some(&entry.path);
        if held && self.guiding.is_some() {
            return Err(self.speech.refuse("walk-halt-first"));
        }
        let route = words::route(entry, (self.wall)(), self.speech.phrases());
        let words = words::about("walk-ask-delete", &route, self.speech.language());
        self.asked = Some(PendingQuestion { number, words: words.clone(), at: self.now });
        Ok(words)
    }

    pub(super) fn take_answer(&mut self, yes: bool) -> Result<String, Refused> {
        let asked = self.asked.take().filter(|asked| self.now - asked.at <= ASKED_S);
        let number = asked.ok_or_else(|| self.speech.refuse("walk-no-question"))?.number;
        if !yes {
            return Ok(self.speech.text("walk-nothing-deleted"));
        }
        let entry =
            self.folder.get(number).cloned().ok_or_else(|| words::unknown(number, self.speech.language()))?;
        self.folder.remove(number).map_err(|e| self.speech.refuse_because("walk-delete-failed", e))?;
        if self.route.as_ref().is_some_and(|w| w.path.as_deref() == Some(&entry.path)) {
            self.route = None;
        }
        self.recorded_here.remove(&entry.path);
        self.recorded.retain(|(path, _)| path.as_ref() != Some(&entry.path));
        self.refresh();
        Ok(words::about(
            "walk-deleted",
            &words::short(&entry, self.speech.language()),
            self.speech.language(),
        ))
    }

    /// Saves the atlas where it is kept and that is due, and says when it cannot be saved.
    pub(super) fn keep(&mut self) {
        let Some(keeper) = &mut self.keeper else { return };
        if keeper.pass(&self.engine, self.recording.is_some(), self.now) {
            let trouble = keeper.trouble().map(ToString::to_string);
            let saved = || self.speech.text("walk-map-saved");
            let words = trouble.map_or_else(saved, |why| self.speech.because("walk-map-not-saved", why));
            self.say(&words, Priority::High);
        }
    }
}
