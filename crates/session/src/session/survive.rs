//! What of a walk survives the death of its process, and going on with it in the next.
//!
//! The map survives in the journal of what tracks, routes survive in their files. This is the rest: what was being done.

use super::{RouteAtHand, Session};
use crate::recording::Recording;
use crate::slam::Slam;
use crate::walk_state::WalkState;
use cairn_guide::{Priority, Recorder, Route, RouteError, RouteWriter};
use std::path::Path;

impl<S: Slam> Session<S> {
    /// What is being done.
    pub fn walk_state(&self) -> WalkState {
        WalkState {
            atlas: self.keeper.as_ref().map(|k| k.id().to_owned()),
            recording: self.recording.as_ref().and_then(|r| r.path.clone()),
            is_auto: self.is_auto,
            auto_recorded: self.auto_recorded,
            route: self.route.as_ref().and_then(|held| held.path.clone()),
            guiding: self.guiding.as_ref().map(|g| (g.facing, g.again)),
            is_paused: self.guiding.as_ref().is_some_and(|g| g.is_paused),
        }
    }

    /// Goes on with what was being done in the same map; what cannot go on is said.
    pub fn go_on(&mut self, state: &WalkState) {
        (self.auto_recorded, self.is_auto) = (state.auto_recorded, state.is_auto);
        if let Some(path) = &state.recording
            && let Err(e) = self.go_on_recording(path)
        {
            self.say(&self.speech.because("walk-route-unreadable", e), Priority::High);
        }
        if let Some(path) = &state.route {
            match Route::load(path) {
                Ok(route) => {
                    let here = self.is_here(path, route.header.atlas.as_deref());
                    self.route = Some(RouteAtHand { route, path: Some(path.clone()), here });
                }
                Err(e) => self.say(&self.speech.because("walk-route-unreadable", e), Priority::High),
            }
        }
        if let Some((facing, again)) = state.guiding {
            // What the map covers was said when it began.
            if let Err(why) = self.begin_guiding(facing, again) {
                self.say(&why.words, Priority::High);
            }
            self.guiding.iter_mut().for_each(|g| g.is_paused = state.is_paused);
        }
    }

    fn go_on_recording(&mut self, path: &Path) -> Result<(), RouteError> {
        let (route, writer) = RouteWriter::resume(path)?;
        let recorder = Recorder::resume(self.config.route.recorder, route).with_writer(writer);
        self.recording = Some(Recording::resume(recorder, path));
        self.recorded_here.insert(path.to_owned());
        Ok(())
    }
}
