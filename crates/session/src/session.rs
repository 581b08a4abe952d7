//! One walk: packets and commands in, utterances and earcons out. It runs the engine, the recorder and the guide.
//!
//! It has no thread, and no clock except the stamps and, for a live source, that source's clock. The caller
//! ([`crate::drive`]) passes packets, and ticks while there are none: after a while the guide then says stop.

mod commands;
mod guide;
mod look;
mod record;
mod restart;
mod routes;
mod survive;
mod take_me;

use crate::age::Ages;
use crate::config::SessionConfig;
use crate::disk::{Disk, OwnDisk};
use crate::dwell::{Dwell, Warnings};
use crate::event::Event;
use crate::guidance::Guiding;
use crate::learning::{Learning, LensKnowledge, Seen};
use crate::library::{MapKeeper, RouteFolder, WallClock, WallTime};
use crate::obstacles::ObstacleMonitor;
use crate::place::Place;
use crate::recording::{Recording, tracked};
use crate::route_metres::may_have_metres;
use crate::slam::{NotTracked, Slam};
use crate::speech::{Clock, Speech};
use crate::status::SessionStatus;
use cairn_engine::{Engine, ImuStatus, Output, Scale, StatusEvent, record_input};
use cairn_geometry::Vec3;
use cairn_guide::{Confidence, Priority, Route};
use cairn_phrases::Language;
use cairn_sensor::{FramePacket, Live, Stamp};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;

/// Missing images are announced after this many seconds.
const PICTURE_TIMEOUT_S: f64 = 1.0;

/// A route that can be walked.
struct RouteAtHand {
    route: Route,
    path: Option<PathBuf>,
    /// It is anchored to the map of this session.
    here: bool,
}

/// A question that waits for yes or no: whether to delete a route.
struct PendingQuestion {
    number: u32,
    words: String,
    at: Stamp,
}

/// Why what a session leaves behind is not whole.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, serde::Serialize, serde::Deserialize)]
pub enum NotSaved {
    /// The file of a route.
    #[error("the route is not saved: {0}")]
    Route(String),
    /// The map of the routes.
    #[error("the map of the routes is not saved: {0}")]
    Map(String),
    /// Both.
    #[error("the route is not saved: {0}; nor is the map of the routes: {1}")]
    Both(String, String),
}

impl NotSaved {
    /// What helps.
    pub fn cure(&self) -> &'static str {
        let (Self::Route(why) | Self::Map(why) | Self::Both(why, _)) = self;
        // The system's words end in its number: EMFILE and ENFILE.
        match ["(os error 24)", "(os error 23)"].iter().any(|number| why.contains(number)) {
            true => "too many files are open: close other programs, or raise the limit (ulimit -n)",
            false => "make room on the disk, and see that its folder may be written to",
        }
    }
}

/// Readings of the IMU that are wrong for less than this are not worth a word, seconds: vision goes on without them.
const IMU_FAILS_S: f64 = 1.0;

/// One walk, over an engine here or elsewhere ([`Slam`]).
pub struct Session<S = Engine> {
    engine: S,
    config: SessionConfig,
    disk: Box<dyn Disk>,
    began: Option<Stamp>,
    now: Stamp,
    /// The last frame's time, and the last known place.
    frame: Option<Stamp>,
    place: Option<Place>,
    confidence: Confidence,
    /// What is known of the unit of length of the last pose, and since when nothing supports it.
    scale: Option<Scale>,
    unsupported: Option<Stamp>,
    recording: Option<Recording>,
    auto_recorded: bool,
    /// The recording in progress began by itself.
    is_auto: bool,
    /// Finished recordings of this session, with their files; where the atlas is kept, only those that are not on disk.
    recorded: Vec<(Option<PathBuf>, Route)>,
    /// The files of all recordings of this session: their routes are in its map.
    recorded_here: BTreeSet<PathBuf>,
    folder: RouteFolder,
    keeper: Option<MapKeeper>,
    wall: WallClock,
    /// A question that waits for yes or no.
    asked: Option<PendingQuestion>,
    /// The place of the next note.
    marked: Option<Place>,
    route: Option<RouteAtHand>,
    guiding: Option<Guiding>,
    /// What is in the walker's way; only with depth, and where it was asked for.
    obstacles: Option<ObstacleMonitor>,
    speech: Speech,
    /// The age of images.
    ages: Ages,
    picture: Dwell,
    /// The motion sensors.
    motion: Dwell,
    warnings: Warnings,
    arrived: bool,
    dead: Option<String>,
    learning: Learning,
    status: SessionStatus,
}

impl<S: Slam> Session<S> {
    /// A session on a new engine (or one that has loaded its map).
    pub fn new(engine: S, config: SessionConfig) -> Self {
        let speech = Speech::new(config.phrases, config.announcer);
        let status = SessionStatus { metric: engine.is_metric(), ..SessionStatus::default() };
        let folder = RouteFolder::new(&config.folder);
        Self {
            engine,
            config,
            folder,
            keeper: None,
            wall: Arc::new(WallTime::now),
            recorded_here: BTreeSet::new(),
            asked: None,
            marked: None,
            disk: Box::new(OwnDisk),
            began: None,
            now: Stamp::default(),
            frame: None,
            place: None,
            confidence: Confidence::Lost,
            scale: None,
            unsupported: None,
            recording: None,
            auto_recorded: false,
            is_auto: false,
            recorded: Vec::new(),
            route: None,
            guiding: None,
            obstacles: None,
            speech,
            ages: Ages::default(),
            picture: Dwell::default(),
            motion: Dwell::default(),
            warnings: Warnings::default(),
            arrived: false,
            dead: None,
            learning: Learning::default(),
            status,
        }
    }

    /// Writes routes to another disk.
    pub fn on_disk(mut self, disk: Box<dyn Disk>) -> Self {
        self.disk = disk;
        self
    }

    /// Keeps routes and their atlas in the keeper's folder, for another day.
    pub fn keeping(mut self, keeper: MapKeeper) -> Self {
        self.folder = RouteFolder::new(keeper.folder());
        self.wall = keeper.wall().clone();
        self.folder.refresh(None);
        self.keeper = Some(keeper);
        self
    }

    /// Follows the clock of a live source: from now on no direction is given from a pose that will be older than half
    /// a second by the time it is heard, or whose age is not known.
    pub fn follow(&mut self, live: Arc<dyn Live>) {
        self.ages.follow(live);
    }

    /// What is known of a lens that nobody calibrated: the walker is told what helps to learn it, and records no route before.
    /// Nothing, where there is nothing to be learned.
    pub fn knows_of_lens(&mut self, lens: impl Into<Option<LensKnowledge>>) {
        self.learning.lens = lens.into();
    }

    /// The engine.
    pub fn engine(&self) -> &S {
        &self.engine
    }

    /// The engine, for shutting it down.
    pub fn engine_mut(&mut self) -> &mut S {
        &mut self.engine
    }

    /// Does the next slice of what the engine does between packets; false when there was nothing to do.
    pub fn work(&mut self) -> bool {
        self.engine.work()
    }

    /// Processes a packet: a pose, a point of the route, a step of the guide.
    ///
    /// # Errors
    /// [`NotTracked`]: why the packet has no result; the session continues.
    pub fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        if self.began.is_none() {
            // The clock of a source may begin anywhere, before zero too.
            (self.began, self.now) = (Some(packet.stamp), packet.stamp);
        }
        self.now = self.now.max(packet.stamp);
        if let Some(why) = &self.dead {
            let why = why.clone();
            self.tick(packet.stamp);
            return Err(NotTracked::Failed(why));
        }
        let seen = catch_unwind(AssertUnwindSafe(|| self.engine.on_packet(packet)));
        let output = match seen {
            Ok(Ok(output)) => output,
            Ok(Err(why)) => {
                self.tick(packet.stamp);
                return Err(why);
            }
            Err(_) => {
                // The engine's state cannot be trusted after a panic.
                self.dead = Some(self.speech.text("walk-tracking-failed"));
                self.tick(packet.stamp);
                return Err(NotTracked::Failed("tracking stopped by an error of the program".into()));
            }
        };
        self.frame = Some(packet.stamp);
        self.ages.came(self.now);
        if self.picture.there(self.now) {
            self.speech.withdraw("walk-no-picture");
            if !self.is_guiding() {
                self.say(&self.speech.text("walk-picture-back"), Priority::Normal);
            }
        }
        if output.stage_failed().is_some() {
            self.say(&self.speech.text("walk-mapping-failed"), Priority::Urgent);
        }
        let seen = record_input(&output, &self.engine.snapshot());
        self.confidence = seen.confidence;
        if tracked(&seen) {
            self.place = Place::of(&output, &seen).or(self.place);
        }
        self.scale = output.pose.map(|pose| pose.scale).or(self.scale);
        let rests_on_nothing = self.scale.is_some_and(|s| !s.supported);
        self.unsupported = self.unsupported.or(Some(packet.stamp)).filter(|_| rests_on_nothing);
        self.update_status(&output);
        if let Some(pose) = &output.pose {
            // The pose of the frame that initialises the scale is still in the previous unit.
            self.update_metric(pose.scale.metric && self.routes_may_have_metres());
        }
        self.learn(&output);
        self.tell_imu(output.status.imu.as_ref());
        self.record(&seen);
        self.observe_way(packet, tracked(&seen));
        self.keep();
        self.guide(packet.stamp);
        self.speak();
        Ok(output)
    }

    /// Time passes without a packet.
    pub fn tick(&mut self, now: Stamp) {
        self.now = self.now.max(now);
        self.engine.look_after();
        let is_away = self.engine.away().is_some();
        let silent = self.frame.is_some_and(|t| self.now - t > PICTURE_TIMEOUT_S);
        if silent && is_away && self.warnings.due("away", self.now) && !self.is_guiding() {
            self.say(&self.speech.text("walk-tracking-restarts"), Priority::High);
        }
        if silent && !is_away && self.picture.lost() && !self.is_guiding() {
            self.say(&self.speech.text("walk-no-picture"), Priority::High);
        }
        if let Some(why) = self.ages.trouble().filter(|why| self.warnings.due(why, self.now)) {
            self.say(&why, Priority::High);
        }
        self.guide(self.now);
        self.speak();
    }

    /// The events since the last call, in order.
    pub fn events(&mut self) -> Vec<Event> {
        self.speech.take_events()
    }

    /// The language of what is said.
    pub fn language(&self) -> Language {
        self.speech.language()
    }

    fn say(&mut self, text: &str, priority: Priority) {
        self.speech.say(text, priority, self.now);
    }

    /// Learns the phone from a frame, and says what is new, once nothing else is being said, or nothing that still counts. It counts as
    /// said when it was spoken.
    fn learn(&mut self, output: &Output) {
        self.learn_from(output, self.now);
        let is_moot = self.learning.is_moot(self.speech.last_words(), self.language());
        let is_free = self.speech.is_free(self.now) || (is_moot && self.speech.waiting().is_none());
        let Some(news) = self.learning.news().filter(|_| is_free) else { return };
        let words = self.speech.text(news);
        self.say(&words, Priority::High);
        self.speak();
        if self.speech.last_words() == words {
            self.learning.was_spoken(news);
        }
    }

    pub(super) fn learn_from(&mut self, output: &Output, now: Stamp) {
        let is_contradicted =
            output.status.events.iter().any(|e| matches!(e, StatusEvent::ScaleContradicted { .. }));
        // Without motion sensors there is no metre to wait for.
        let has_motion = self.engine.status().imu.is_some();
        let metric = output.pose.is_some_and(|pose| pose.scale.metric) || !has_motion;
        let offset_s = has_motion.then(|| self.engine.snapshot().imu_offset());
        self.learning.see(Seen { now, metric, offset_s, is_contradicted });
    }

    /// Says that the readings of the IMU are not used any more, and when they are again.
    fn tell_imu(&mut self, imu: Option<&ImuStatus>) {
        let Some(imu) = imu else { return };
        let told = match imu.fault {
            None if self.motion.there(self.now) => "walk-imu-back",
            None => return,
            Some(_) if imu.fault_s < IMU_FAILS_S => return self.motion.missing(),
            Some(_) if self.motion.lost() => "walk-imu-failed",
            Some(_) => return,
        };
        self.say(&self.speech.text(told), Priority::Normal);
    }

    /// Starts what waits to be said. A direction that has become too old is given again by the guide, from a new pose.
    fn speak(&mut self) {
        let clock = self.clock();
        let unheard = self.speech.speak(&self.ages, clock);
        if let (Some(cue), Some(guiding)) = (unheard, &mut self.guiding) {
            guiding.guide.not_heard(&cue);
        }
    }

    fn clock(&self) -> Clock {
        Clock { now: self.now, began: self.began }
    }

    /// The route at hand, if there is one.
    pub fn route(&self) -> Option<&Route> {
        self.route.as_ref().map(|w| &w.route)
    }

    /// What it was begun with.
    pub fn config(&self) -> &SessionConfig {
        &self.config
    }

    /// The camera's position in the last pose, in the map's units.
    pub fn place(&self) -> Option<Vec3> {
        self.place.map(|place| place.world_from_camera.se3.translation)
    }

    /// Seconds since the first packet.
    pub fn elapsed_s(&self) -> f64 {
        self.clock().elapsed_s(self.now)
    }

    /// The time now, in the source's clock.
    pub fn now(&self) -> Stamp {
        self.now
    }

    /// Frames with a pose so far.
    pub fn tracked(&self) -> usize {
        self.status.tracked
    }

    /// Ends what is in progress.
    ///
    /// # Errors
    /// [`NotSaved`] when a file does not hold all of its route, or the map of the routes is not saved.
    pub fn close(&mut self) -> Result<(), NotSaved> {
        self.guiding = None;
        let recorded = self.close_recording();
        if let Some(keeper) = &mut self.keeper {
            keeper.end(&self.engine);
        }
        let trouble = self.keeper.as_ref().and_then(MapKeeper::trouble).map(ToString::to_string);
        match (recorded, trouble) {
            (recorded, None) => recorded,
            (Err(NotSaved::Route(route)), Some(map)) => Err(NotSaved::Both(route, map)),
            (_, Some(map)) => Err(NotSaved::Map(map)),
        }
    }

    /// Whether the routes at hand lie in maps with metres, but for a few seconds.
    fn routes_may_have_metres(&self) -> bool {
        let recorded = self.recording.as_ref().map(Recording::route);
        let held = self.route.as_ref().filter(|held| held.here).map(|held| &held.route);
        let mut without = recorded.into_iter().chain(held).filter(|route| !route.header.metric).peekable();
        if without.peek().is_none() {
            return true;
        }
        let map = self.engine.snapshot();
        without.all(|route| may_have_metres(&map, self.engine.camera(), route))
    }

    /// Updates whether lengths in the map are metres; the recording and the guidance in progress follow.
    fn update_metric(&mut self, metric: bool) {
        self.status.metric = metric;
        if !metric {
            return;
        }
        if let Some(recording) = self.recording.as_mut().filter(|r| !r.route().header.metric) {
            recording.found_scale(&self.engine.snapshot(), self.place.as_ref());
            self.say(&self.speech.text("walk-distances-known"), Priority::Normal);
        }
        if let Some(held) = self.route.as_mut().filter(|w| w.here && !w.route.header.metric) {
            held.route.header.metric = true;
            self.guiding.iter_mut().for_each(|g| g.reference_path.found_scale());
        }
    }

    fn update_status(&mut self, output: &Output) {
        let s = &mut self.status;
        s.frames += 1;
        s.tracked += usize::from(output.pose.is_some());
        (s.features, s.inliers) = (output.evidence.features, output.evidence.inliers);
        s.step_ms = output.timings.step_ms();
        let map = self.engine.snapshot();
        (s.key_frames, s.landmarks) = (map.key_frame_count(), map.landmark_count());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::Command;
    use cairn_engine::{Config, Host, Runner, SensorMode};
    use cairn_sensor::{Camera, Rig};

    #[test]
    fn settings_are_not_said_and_the_answer_is_in_the_language_set() {
        let rig = Rig::mono(Camera::pinhole(320, 240, 220.0, 220.0, 159.5, 119.5));
        let engine =
            Engine::new(&rig, SensorMode::Mono, 30.0, Runner::Lockstep, &Config::default(), &Host::bare())
                .unwrap();
        let mut session = Session::new(engine, SessionConfig::default());
        session.command(&Command::parse("set language de").unwrap()).unwrap();
        session.command(&Command::parse("set speed 90").unwrap()).unwrap();
        assert!(session.events().is_empty() && session.language() == Language::German);
        let refused = session.command(&Command::parse("guide").unwrap()).unwrap_err();
        assert_eq!(refused.id, "walk-no-route");
        let Some(Event::Said(said)) = session.events().pop() else { panic!("nothing was said") };
        assert_eq!(said.text, "Es gibt noch keine Route. Nehmen Sie erst eine auf, oder laden Sie eine.");
        assert_eq!((said.text, said.language), (refused.words, Language::German));
        assert_eq!(session.status().words, "Ich warte auf das erste Bild der Kamera.");
    }
}
