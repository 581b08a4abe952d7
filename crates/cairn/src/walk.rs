//! Routes: record one, load one, be guided along it by cues and words.
//!
//! What is to be said comes out of [`Slam::heard`]; the methods here also return their answer in words.

use crate::{Error, Slam};
use cairn_guide::{Facing, GuideState, Route};
use cairn_sensor::{Live, Stamp};
use cairn_session::{Command, Event, Refused, RouteChoice};
use std::path::Path;
use std::sync::Arc;

impl Slam {
    /// Starts to record the route into a new file, point by point, so that a crash loses little. Where the file cannot
    /// be created, or the disk is full, recording goes on in memory, and the words say so.
    ///
    /// # Errors
    /// [`Error::Refused`] while a recording is in progress.
    pub fn record(&mut self, path: impl AsRef<Path>) -> Result<String, Error> {
        Ok(self.session.record_to(path.as_ref())?)
    }

    /// Ends the recording; returns the route, which can be walked from now on.
    ///
    /// # Errors
    /// [`Error::Refused`] when nothing is or was recorded, or the file does not hold all of the route.
    pub fn stop_recording(&mut self) -> Result<&Route, Error> {
        self.command(&Command::Stop)?;
        let language = self.session.config().phrases.language;
        self.session.route().ok_or_else(|| Refused::new(language, "walk-nothing-recorded", &[]).into())
    }

    /// Loads a recorded route. Guidance along it needs the map it was recorded in: this one, or one given to
    /// [`crate::Builder::map`].
    ///
    /// # Errors
    /// [`Error::Route`] when it cannot be read, [`Error::Refused`] when it is empty.
    pub fn load_route(&mut self, path: impl AsRef<Path>) -> Result<String, Error> {
        // Read here for the typed error; the session holds the one that it reads itself.
        Route::load(path.as_ref())?;
        self.command(&Command::Load(RouteChoice::File(path.as_ref().to_owned())))
    }

    /// The route at hand: the one recorded or loaded last.
    pub fn route(&self) -> Option<&Route> {
        self.session.route()
    }

    /// Starts guidance along the route at hand, back to where it began, with the camera mounted as `facing` says. The
    /// words that are returned say how well the map covers the views on the way.
    ///
    /// # Errors
    /// [`Error::Refused`] without a route in this map, or when the route cannot be walked like this.
    pub fn guide_home(&mut self, facing: Facing) -> Result<String, Error> {
        self.command(&Command::Guide { facing: Some(facing), again: false })
    }

    /// Starts guidance along the route at hand from its start to its end, as it was recorded.
    ///
    /// # Errors
    /// As [`Slam::guide_home`].
    pub fn guide_again(&mut self, facing: Facing) -> Result<String, Error> {
        self.command(&Command::Guide { facing: Some(facing), again: true })
    }

    /// Ends guidance.
    ///
    /// # Errors
    /// [`Error::Refused`] when there is none.
    pub fn halt(&mut self) -> Result<String, Error> {
        self.command(&Command::Halt)
    }

    /// Time passes without a frame: the guide says stop when no picture arrives. Call it about twenty times a second
    /// while frames are late.
    pub fn tick(&mut self, now: Stamp) {
        self.session.tick(now);
    }

    /// Follows the clock of a live source: no direction is given from a pose that will be older than half a second by the
    /// time it is heard, or whose age is not known. Without it, the age of a picture counts from when it was given.
    pub fn follow(&mut self, live: Arc<dyn Live>) {
        self.session.follow(live);
    }

    /// The words and sounds that are due since the last call, in order.
    pub fn heard(&mut self) -> Vec<Event> {
        self.session.events()
    }

    /// The guide's state; `None` without guidance.
    pub fn guide_state(&self) -> Option<GuideState> {
        self.session.guide_state()
    }

    /// Whether the last guidance ended at the end of its route.
    pub fn has_arrived(&self) -> bool {
        self.session.has_arrived()
    }

    fn command(&mut self, command: &Command) -> Result<String, Error> {
        Ok(self.session.command(command)?)
    }
}
