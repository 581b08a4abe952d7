//! The state of a session for display: its status in numbers and in words, and polylines to draw.

use super::Session;
use crate::age::Age;
use crate::recording::Recording;
use crate::slam::Slam;
use crate::status::{GuidingStatus, RecordingStatus, RouteStatus, SessionStatus, View};
use crate::view::single;
use cairn_engine::Phase;
use cairn_geometry::Vec3;
use cairn_guide::{Facing, GuideState, StopReason, reason_words};
use cairn_phrases::Arg;
use std::path::PathBuf;

impl<S: Slam> Session<S> {
    /// The current status.
    pub fn status(&self) -> SessionStatus {
        let mut s = self.status.clone();
        let name = |path: &Option<PathBuf>| {
            let name = path.as_ref().and_then(|p| p.file_name());
            name.map_or_else(|| self.speech.text("walk-in-memory"), |n| n.to_string_lossy().into_owned())
        };
        self.speech.last_words().clone_into(&mut s.last_words);
        s.t_s = self.clock().elapsed_s(self.now);
        s.engine = self.engine_status();
        s.language = self.speech.language();
        (s.phase, s.words) = (s.engine.phase, s.engine.words_in(s.language));
        s.waits = s.engine.waits.iter().map(|wait| wait.words_in(s.language)).collect();
        s.age = self.age();
        (s.headline, s.alarm) = self.headline(&s.words);
        s.recording = self.recording.as_ref().map(|r| RecordingStatus {
            points: r.route().points.len(),
            length: r.length(),
            gaps: r.gaps(),
            file: name(&r.path),
            notes: r.route().notes.len(),
            trouble: r.trouble(),
        });
        s.route = self.route.as_ref().map(|w| RouteStatus {
            file: name(&w.path),
            name: self.short_name(w.path.as_deref(), &w.route),
            points: w.route.points.len(),
            here: w.here,
            is_new: w.path.as_ref().is_none_or(|path| self.recorded_here.contains(path)),
        });
        s.question = self.asked.as_ref().map(|asked| asked.words.clone());
        s.map_trouble = self.keeper.as_ref().and_then(|k| k.trouble().map(ToString::to_string));
        s.guiding = self.guiding.as_ref().map(|g| {
            let place = g.guide.place();
            GuidingStatus {
                facing: facing_name(g.facing),
                state: if g.is_paused { "paused" } else { state_name(g.guide.state()) },
                along_m: place.map_or(0.0, |m| m.along_m),
                length_m: g.guide.plan().length(),
                cross_m: place.map_or(0.0, |m| m.cross_m),
            }
        });
        s
    }

    /// The age of the last image.
    pub fn age(&self) -> Age {
        self.ages.of(self.frame)
    }

    /// The state in large print: the last instruction to the walker to move or stop; and whether it is an alarm.
    fn headline(&self, words: &str) -> (String, bool) {
        let facing = self.guiding.as_ref().map_or(Facing::Home, |g| g.facing);
        let why = |reason| reason_words(reason, facing, self.speech.language());
        match self.guiding.as_ref().filter(|g| !g.is_paused).map(|g| g.guide.state()) {
            Some(GuideState::Stopped(reason)) => {
                return (format!("{} {}", self.speech.text("guide-stop"), why(reason)), true);
            }
            _ if self.dead.is_some() || self.engine.away().is_some() || self.picture.is_lost() => {
                return (words.to_owned(), true);
            }
            Some(state) => {
                // The first word of the name is that of the catalogue.
                let name = state_name(state).split(' ').next().unwrap_or_default();
                return (self.speech.language().say("walk-guiding", &[("state", name.into())]), false);
            }
            None if self.guiding.is_some() => return (self.speech.text("walk-paused"), false),
            None => {}
        }
        match self.age() {
            Age::Unknown => (why(StopReason::AgeUnknown), true),
            age if age.is_stale() => (why(StopReason::PicturesLate), true),
            _ if self.recording.is_none() && self.learning.what_helps().is_some() => {
                (self.speech.text("walk-learning"), false)
            }
            _ if self.recording.is_some() => {
                (format!("{} {words}", self.speech.text("walk-recording")), false)
            }
            _ => (words.to_owned(), false),
        }
    }

    /// The engine's status, combined with what only the session knows: missing images, or an engine that failed.
    pub fn engine_status(&self) -> cairn_engine::Status {
        let mut s = self.engine.status().clone();
        s.t_s = self.clock().elapsed_s(self.now);
        let away = || self.engine.away().map(|_| self.speech.text("walk-tracking-restarts"));
        let error = self.dead.clone().or_else(away);
        let beyond = match &error {
            Some(_) => Some(Phase::Error),
            None => self.picture.is_lost().then_some(Phase::WaitFrames),
        };
        if let Some(phase) = beyond {
            (s.phase, s.valid, s.error) = (phase, false, error);
            s.waits.clear();
            s.events.clear();
        }
        s
    }

    /// Polylines and points to draw; at most `most` landmarks.
    pub fn view(&self, most: usize) -> View {
        let map = self.engine.snapshot();
        let mut view = View::of_map(&map, None, most);
        let recording = self.recording.as_ref().map(Recording::route);
        let loaded = || self.route.as_ref().filter(|w| w.here).map(|w| &w.route);
        if let Some(route) = recording.or_else(loaded) {
            view.record(route, &map);
        }
        if let Some(guiding) = &self.guiding {
            view.up = single(&guiding.reference_path.world_ground.up());
            view.plan = guiding.reference_path.corners().map(|p| single(&p)).collect();
        }
        view.camera = self.camera().filter(|_| self.engine_status().valid);
        view
    }

    /// The camera: position, then the axes right, down and forward, in the map's frame.
    pub fn camera(&self) -> Option<[[f32; 3]; 4]> {
        let pose = self.place?.world_from_camera.se3;
        let axis = |v: Vec3| single(&(pose.rotation * v));
        Some([single(&pose.translation), axis(Vec3::x()), axis(Vec3::y()), axis(Vec3::z())])
    }

    pub(super) fn status_words(&self) -> String {
        let s = self.status();
        let mut words = s.headline.clone();
        let mut add = |sentence: String| words = format!("{words} {sentence}");
        s.age.words(s.language).filter(|_| s.age.is_stale()).into_iter().for_each(&mut add);
        let phrases = self.speech.phrases_for(self.status.metric);
        if let Some(r) = &s.recording {
            let says_so = s.headline.starts_with(&self.speech.text("walk-recording"));
            if phrases.metric || !says_so {
                add(phrases.measured(["walk-length-so-far", "walk-recording"], r.length, &[]));
            }
        }
        if let Some(g) = s.guiding.as_ref().filter(|_| self.is_guiding()) {
            let done = 100.0 * g.along_m / g.length_m.max(1e-9);
            let percent = [("percent", Arg::Number(done, 0))];
            add(phrases.measured(["walk-to-go", "walk-percent-done"], g.length_m - g.along_m, &percent));
        }
        if let Some(guiding) = self.guiding.as_ref().filter(|g| !s.alarm && !g.is_paused) {
            let beside = self.place.as_ref().and_then(|place| guiding.beside(place));
            if let Some((ahead, (away_m, bearing_rad))) = guiding.guide.ahead().zip(beside) {
                add(phrases.where_words(&ahead, away_m, bearing_rad, guiding.facing));
            }
            add(guiding.ready.clone());
        } else if self.recording.is_none() {
            self.learning.what_helps().into_iter().for_each(|id| add(self.speech.text(id)));
        }
        words
    }
}

/// The name of a facing, as it is written on the command line.
fn facing_name(facing: Facing) -> &'static str {
    match facing {
        Facing::Home => "home",
        Facing::Back => "back",
        Facing::Backwards => "backwards",
    }
}

fn state_name(state: GuideState) -> &'static str {
    match state {
        GuideState::Waiting => "waiting",
        GuideState::Turning => "turning",
        GuideState::Moving => "moving",
        GuideState::Checking => "checking behind",
        GuideState::SteppingAside => "stepping aside",
        GuideState::Stopped(_) => "stopped",
        GuideState::Arrived => "arrived",
    }
}
