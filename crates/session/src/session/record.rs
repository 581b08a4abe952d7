//! Recording: it begins, takes each pose and the notes that are given, and ends.

use super::{NotSaved, RouteAtHand, Session};
use crate::library::{replace, words};
use crate::place::Place;
use crate::recording::{About, Recording};
use crate::refused::Refused;
use crate::route_metres::settle_astray;
use crate::slam::Slam;
use cairn_guide::{Confidence, PhraseConfig, Priority, RecordInput, Recorder, Route, Side};
use cairn_phrases::Arg;
use std::io;
use std::path::{Path, PathBuf};

/// A route of fewer points, three metres, leads nowhere.
const SHORT_POINTS: usize = 60;
/// A marked place waits this long for its note, seconds.
const MARKED_S: f64 = 120.0;

/// A recording that has ended.
struct Finished {
    route: Route,
    path: Option<PathBuf>,
    /// An error when the file does not hold all of the route.
    whole: io::Result<()>,
    /// In metres, or units of the map.
    length: f64,
}

impl<S: Slam> Session<S> {
    /// Every route recorded in this session, including the one in progress, with its file.
    pub fn recorded(&self) -> impl Iterator<Item = (Option<&Path>, &Route)> {
        let ended = self.recorded.iter().map(|(path, route)| (path.as_deref(), route));
        ended.chain(self.recording.iter().map(|r| (r.path.as_deref(), r.route())))
    }

    /// Continues a recording that has a file already, in the map it was recorded in.
    pub fn resume_recording(&mut self, recorder: Recorder, path: &Path) {
        self.auto_recorded = true;
        self.recording = Some(Recording::resume(recorder, path));
    }

    /// Whether a recording is in progress.
    pub fn is_recording(&self) -> bool {
        self.recording.is_some()
    }

    pub(super) fn record(&mut self, seen: &RecordInput) {
        let due = self.config.auto_record.is_some_and(|n| self.status.tracked >= n);
        if due
            && self.learning.what_helps().is_none()
            && !self.auto_recorded
            && self.recording.is_none()
            && self.guiding.is_none()
            && self.route.is_none()
        {
            self.auto_recorded = true;
            match self.begin_recording(None) {
                Ok(words) => self.say(&words, Priority::Normal),
                Err(why) => self.say(&why.words, Priority::High),
            }
            self.is_auto = self.recording.is_some();
        }
        let place = self.place.as_ref();
        let words = self.recording.as_mut().and_then(|r| r.observe(seen, place));
        if words == Some("guide-found") {
            self.speech.withdraw("walk-lost");
        }
        // Under guidance the guide reports on tracking; before the first pose nothing can be lost.
        if let Some(words) = words.filter(|_| self.guiding.is_none() && self.place.is_some()) {
            self.say(&self.speech.text(words), Priority::High);
        }
    }

    pub(super) fn begin_recording(&mut self, path: Option<PathBuf>) -> Result<String, Refused> {
        if self.recording.is_some() {
            return Err(self.speech.refuse("walk-already-recording"));
        }
        if let Some(helps) = self.learning.what_helps() {
            self.learning.is_awaited();
            return Err(self.speech.refuse(helps));
        }
        (self.auto_recorded, self.is_auto) = (true, false);
        let named = path.or_else(|| self.config.record_to.take());
        if named.is_none() {
            // Where the file cannot be created, the recording reports it.
            let _ = std::fs::create_dir_all(self.folder.path());
        }
        let is_full = named.is_none() && self.is_full();
        let path = named.or_else(|| (!is_full).then(|| self.folder.next_path()));
        // Without a pose nobody knows in which map the walker is.
        let is_placed = self.place_now().is_some() || self.engine.camera().has_depth();
        let metric = self.status.metric && is_placed;
        let (map, place) = (self.engine.snapshot(), self.place.as_ref());
        let kept = self.keeper.as_ref();
        let about = About {
            metric,
            source: &self.config.source,
            recorded_s: kept.map(|_| (self.wall)().unix_s),
            atlas: kept.map(|k| k.id().to_owned()),
        };
        let (recording, trouble) =
            Recording::begin(&*self.disk, path.as_deref(), &map, place, about, self.config.route.recorder);
        self.recording = Some(recording);
        Ok(match (trouble, metric) {
            (Some(why), _) => {
                let file = path.unwrap_or_default().display().to_string();
                let args: [(&str, Arg); 2] = [("file", (&file).into()), ("why", (&why).into())];
                self.speech.language().say("walk-recording-in-memory", &args)
            }
            (None, _) if is_full => self.speech.text("walk-library-full"),
            (None, true) => self.speech.text("walk-recording"),
            (None, false) => self.speech.text("walk-recording-unmeasured"),
        })
    }

    /// Drops a recording that nobody asked for and that is too short to lead anywhere, where routes are kept for another
    /// day: else every visit would leave one.
    pub(super) fn drop_unasked(&mut self) {
        let is_unasked = self.is_auto && self.keeper.is_some();
        let short = |r: &mut Recording| r.route().points.len() < SHORT_POINTS && r.route().notes.is_empty();
        let Some(recording) = self.recording.take_if(|r| is_unasked && short(r)) else { return };
        let (_, path, _) = recording.finish();
        if let Some(path) = path {
            let _ = std::fs::remove_file(path);
        }
    }

    pub(super) fn end_recording(&mut self) -> Result<String, Refused> {
        let recording = self.recording.take().ok_or_else(|| self.speech.refuse("walk-not-recording"))?;
        let Finished { route, path, whole, length } = self.finish(recording);
        if route.points.len() < 2 {
            self.folder.refresh(None);
            return Err(self.speech.refuse("walk-nothing-recorded"));
        }
        self.add_recorded(&path, &route, whole.is_ok());
        let metric = route.header.metric;
        // Guidance that is in progress, or paused, is along the route that was at hand.
        if self.guiding.is_none() {
            self.route = Some(RouteAtHand { route, path, here: true });
        }
        whole.map_err(|e| self.speech.refuse_because("walk-file-incomplete", e))?;
        let phrases = PhraseConfig { metric, ..*self.speech.phrases() };
        let words = phrases.measured(["walk-recorded", "walk-recorded-unmeasured"], length, &[]);
        // It was said when the map could not be saved first, but whoever ends a route relies on both.
        let trouble = self.keeper.as_ref().and_then(|keeper| keeper.trouble());
        Ok(match trouble.map(|why| self.speech.because("walk-map-not-saved", why.to_string())) {
            Some(unsaved) => format!("{words} {unsaved}"),
            None => words,
        })
    }

    pub(super) fn close_recording(&mut self) -> Result<(), NotSaved> {
        self.drop_unasked();
        let Some(recording) = self.recording.take() else { return Ok(()) };
        let Finished { route, path, whole, .. } = self.finish(recording);
        let name = path.as_ref().map_or_else(|| "the route".to_owned(), |p| p.display().to_string());
        let points = route.points.len();
        self.add_recorded(&path, &route, whole.is_ok());
        self.route = Some(RouteAtHand { route, path, here: true });
        whole.map_err(|e| NotSaved::Route(format!("{name}: {e}; {points} points were recorded")))
    }

    /// Ends a recording; what went astray of it is placed.
    fn finish(&self, recording: Recording) -> Finished {
        let length = recording.length();
        let (mut route, path, mut whole) = recording.finish();
        let file = path.as_deref().filter(|_| whole.is_ok()).map(|path| (&*self.disk, path));
        if self.learning.reads_with_guess() {
            route.header.lens_guessed = true;
            whole = file.map_or(whole, |(disk, path)| replace(disk, path, &route));
        }
        let carried = settle_astray(&self.engine.snapshot(), self.engine.camera(), &mut route, file);
        match carried {
            Ok(carried) => Finished { route, path, whole, length: carried.unwrap_or(length) },
            Err(e) => Finished { route, path, whole: whole.and(Err(e)), length },
        }
    }

    pub(super) fn add_recorded(&mut self, path: &Option<PathBuf>, route: &Route, is_on_disk: bool) {
        self.marked = None;
        if route.points.is_empty() {
            return;
        }
        self.recorded_here.extend(path.clone());
        if let Some(keeper) = &mut self.keeper {
            keeper.make_due();
        }
        // A session that keeps its routes may last for days: what is on disk is not held in memory.
        if self.keeper.is_none() || !is_on_disk {
            self.recorded.push((path.clone(), route.clone()));
        }
        self.folder.refresh(None);
    }

    pub(super) fn mark(&mut self) -> Result<String, Refused> {
        self.recording.as_ref().ok_or_else(|| self.speech.refuse("walk-note-no-recording"))?;
        self.marked = Some(self.place_now().ok_or_else(|| self.speech.refuse("walk-note-no-place"))?);
        Ok(self.speech.text("walk-marked"))
    }

    pub(super) fn note(&mut self, text: &str, side: Option<Side>) -> Result<String, Refused> {
        let here = self.place_now();
        let marked = self.marked.take().filter(|p| self.now - p.stamp <= MARKED_S);
        let language = self.speech.language();
        let recording =
            self.recording.as_mut().ok_or_else(|| Refused::new(language, "walk-note-no-recording", &[]))?;
        let place = marked.or(here).ok_or_else(|| Refused::new(language, "walk-note-no-place", &[]))?;
        let text = match text.trim() {
            "" => language.text("walk-landmark"),
            text => text.to_owned(),
        };
        recording.note(&text, side, &place).map_err(|why| Refused::new(language, why.sentence(), &[]))?;
        Ok(words::noted(&text, side, language))
    }

    /// The place of the last frame, where that had one.
    fn place_now(&self) -> Option<Place> {
        self.place.filter(|p| Some(p.stamp) == self.frame && self.confidence != Confidence::Lost)
    }
}
