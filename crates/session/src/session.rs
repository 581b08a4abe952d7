//! One walk: packets and commands in, utterances and earcons out. It runs the engine, the recorder and the guide.
//!
//! It has no thread, and no clock except the stamps and, for a live source, that source's clock. The caller
//! ([`crate::drive_live`], [`crate::drive_lockstep`]) passes packets, and ticks while there are none: after a while
//! the guide then says stop.

mod look;
mod routes;
mod take_me;

use crate::age::Ages;
use crate::command::Command;
use crate::disk::{Disk, OwnDisk};
use crate::dwell::{Dwell, Warnings};
use crate::event::{Event, Said, Sound, rank, turn_of};
use crate::guidance::Guiding;
use crate::library::{MapKeeper, RouteFolder, WallClock, WallTime};
use crate::place::Place;
use crate::recording::{About, Recording, tracked};
use crate::scale_basis::ScaleBasis;
use crate::settings::Setting;
use crate::status::Status;
use crate::way_ahead::WayAhead;
use cairn_dense::DenseError;
use cairn_engine::{Engine, Output, Scale, record_input};
use cairn_geometry::Vec3;
use cairn_guide::{
    Announcer, AnnouncerConfig, Confidence, Cue, CueKind, Facing, GuideState, PhraseConfig, Priority,
    RecordInput, Recorder, Route, RouteConfig, StopReason, Travel, ready_words,
};
use cairn_phrases::{Arg, Language};
use cairn_sensor::{FramePacket, Live, Rig, Stamp};
use std::collections::{BTreeSet, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Config of a session.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// The folder of the routes.
    pub folder: PathBuf,
    /// The file of the first recording; without it, a free name in the folder.
    pub record_to: Option<PathBuf>,
    /// A description of the image source, for the files.
    pub source: String,
    /// Start recording automatically after this many tracked frames.
    pub auto_record: Option<usize>,
    /// How the camera is mounted relative to the walker, unless a command says otherwise.
    pub facing: Facing,
    /// The map was loaded: routes from files are anchored to it.
    pub map_is_loaded: bool,
    /// Language, unit and form of what is said.
    pub phrases: PhraseConfig,
    /// Rate, volume and queueing of the voice.
    pub announcer: AnnouncerConfig,
    /// How routes are recorded, cleaned and guided.
    pub route: RouteConfig,
}

impl Default for SessionConfig {
    fn default() -> Self {
        Self {
            folder: PathBuf::from("routes"),
            record_to: None,
            source: String::new(),
            auto_record: None,
            facing: Facing::Home,
            map_is_loaded: false,
            phrases: PhraseConfig::default(),
            announcer: AnnouncerConfig::default(),
            route: RouteConfig::default(),
        }
    }
}

/// Missing images are announced after this many seconds.
const PICTURE_TIMEOUT_S: f64 = 1.0;
/// A route of fewer points, three metres, leads nowhere.
const SHORT_POINTS: usize = 60;
/// The first words of guidance wait at most this long for other utterances to end, seconds.
const FIRST_WORDS_WAIT_S: f64 = 12.0;

/// A route that can be walked.
struct RouteAtHand {
    route: Route,
    path: Option<PathBuf>,
    /// It is anchored to the map of this session.
    here: bool,
}

/// A question that waits for yes or no: whether to delete a route.
struct Asked {
    number: u32,
    words: String,
    at: Stamp,
}

/// One walk.
pub struct Session {
    engine: Engine,
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
    asked: Option<Asked>,
    /// The place of the next note.
    marked: Option<Place>,
    route: Option<RouteAtHand>,
    guiding: Option<Guiding>,
    /// What is in the walker's way; only with depth, and where it was asked for.
    way_ahead: Option<WayAhead>,
    voice: Announcer,
    /// The text queued last, and the turn it asks for.
    pushed: Option<(String, Option<f64>)>,
    /// The direction waiting to be spoken: its text, the time of the pose it is based on, and the cue.
    direction: Option<(String, Stamp, CueKind)>,
    events: VecDeque<Event>,
    /// The age of images.
    ages: Ages,
    picture: Dwell,
    warnings: Warnings,
    arrived: bool,
    dead: Option<String>,
    status: Status,
}

impl Session {
    /// A session on a new engine (or one that has loaded its map).
    pub fn new(engine: Engine, config: SessionConfig) -> Self {
        let voice = Announcer::new(config.announcer);
        let status = Status { metric: engine.is_metric(), ..Status::default() };
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
            way_ahead: None,
            voice,
            pushed: None,
            direction: None,
            events: VecDeque::new(),
            ages: Ages::default(),
            picture: Dwell::default(),
            warnings: Warnings::default(),
            arrived: false,
            dead: None,
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

    /// Watches the walker's way with the rig's depth sensor while he is guided and the camera looks where he walks:
    /// obstacles, drops and missing depth stop him, and he is led past what leaves room. False without a depth sensor.
    ///
    /// # Errors
    /// A depth camera that cannot be used.
    pub fn watch_way(&mut self, rig: &Rig) -> Result<bool, DenseError> {
        self.way_ahead = WayAhead::new(rig, &self.engine.front_end().model().body_from_camera)?;
        Ok(self.way_ahead.is_some())
    }

    /// Milliseconds that watching the way took at the last packet; `None` where it is not watched or nobody is guided.
    pub fn way_ahead_ms(&self) -> Option<f64> {
        self.way_ahead.as_ref().filter(|_| self.guiding.is_some()).map(|w| w.cost_ms)
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The engine, for shutting it down.
    pub fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    /// Processes a packet: a pose, a point of the route, a step of the guide.
    ///
    /// # Errors
    /// The reason why the packet was rejected; the session continues.
    pub fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, String> {
        self.began.get_or_insert(packet.stamp);
        self.now = self.now.max(packet.stamp);
        if let Some(why) = &self.dead {
            let why = why.clone();
            self.tick(packet.stamp);
            return Err(why);
        }
        let seen = catch_unwind(AssertUnwindSafe(|| self.engine.on_packet(packet)));
        let output = match seen {
            Ok(Ok(output)) => output,
            Ok(Err(e)) => {
                self.tick(packet.stamp);
                return Err(e.to_string());
            }
            Err(_) => {
                // The engine's state cannot be trusted after a panic.
                self.dead = Some(self.text("walk-tracking-failed"));
                self.tick(packet.stamp);
                return Err("tracking stopped by an error of the program".into());
            }
        };
        self.frame = Some(packet.stamp);
        self.ages.came(self.now);
        if self.picture.there(self.now) {
            self.withdraw("walk-no-picture");
            if self.guiding.is_none() {
                self.say(&self.text("walk-picture-back"), Priority::Normal);
            }
        }
        if output.stage_failed.is_some() {
            self.say(&self.text("walk-mapping-failed"), Priority::Urgent);
        }
        let seen = record_input(&output, &self.engine.snapshot());
        self.confidence = seen.confidence;
        if tracked(&seen) {
            self.place = Place::of(&output, &seen).or(self.place);
        }
        if output.scale.is_some() {
            self.scale = output.scale;
        }
        let rests_on_nothing = self.scale.is_some_and(|s| !s.supported);
        self.unsupported = self.unsupported.or(Some(packet.stamp)).filter(|_| rests_on_nothing);
        self.update_status(&output);
        if output.anchored.is_some() {
            // The pose of the frame that initialises the scale is still in the previous unit.
            self.update_metric(output.metric && self.engine.is_metric());
        }
        self.record(&seen);
        self.observe_way(packet, tracked(&seen));
        self.keep();
        self.guide(packet.stamp);
        self.speak(packet.stamp);
        Ok(output)
    }

    /// Time passes without a packet.
    pub fn tick(&mut self, now: Stamp) {
        self.now = self.now.max(now);
        let silent = self.frame.is_some_and(|t| self.now - t > PICTURE_TIMEOUT_S);
        if silent && self.picture.lost() && self.guiding.is_none() {
            self.say(&self.text("walk-no-picture"), Priority::High);
        }
        if let Some(why) = self.ages.trouble().filter(|why| self.warnings.due(why, self.now)) {
            self.say(&why, Priority::High);
        }
        self.guide(self.now);
        self.speak(self.now);
    }

    /// Carries out a command; returns the result in words, which are also said.
    ///
    /// # Errors
    /// Why the command could not be carried out, in words, which are also said.
    pub fn command(&mut self, command: &Command) -> Result<String, String> {
        // Whatever else is asked for, the question is no longer open.
        if !matches!(command, Command::Answer(_) | Command::Repeat | Command::Status) {
            self.asked = None;
        }
        let done = match command {
            Command::Record => self.begin_recording(None),
            Command::Stop => self.end_recording(),
            Command::Routes => Ok(self.list_words()),
            Command::Load(which) => self.load(which),
            Command::Rename(number, name) => self.rename(*number, name),
            Command::Delete(number) => self.ask_delete(*number),
            Command::Answer(yes) => self.take_answer(*yes),
            Command::Mark => self.mark(),
            Command::Note { text, side } => self.note(text, *side),
            Command::Guide { facing, again } => {
                self.begin_guiding(facing.unwrap_or(self.config.facing), *again)
            }
            Command::Halt => match self.guiding.take() {
                Some(_) => {
                    self.voice.drop_waiting();
                    Ok(self.text("walk-guidance-ended"))
                }
                None => Err(self.text("walk-not-guiding")),
            },
            Command::Repeat => {
                self.voice.repeat(self.now);
                self.speak(self.now);
                match self.status.last_words.as_str() {
                    "" => Ok(self.text("walk-nothing-to-repeat")),
                    words => return Ok(words.to_owned()),
                }
            }
            Command::Status => Ok(self.status_words()),
            Command::Quit => Ok(self.text("walk-goodbye")),
            Command::Set(setting) => {
                // Not said: the page sets what it keeps at every connection.
                self.set(*setting);
                return Ok(self.text("walk-set"));
            }
        };
        self.answer(done)
    }

    /// Starts recording into this new file, otherwise as [`Command::Record`].
    ///
    /// # Errors
    /// As [`Session::command`].
    pub fn record_to(&mut self, path: &Path) -> Result<String, String> {
        let done = self.begin_recording(Some(path.to_owned()));
        self.answer(done)
    }

    /// Says the result of a command.
    fn answer(&mut self, done: Result<String, String>) -> Result<String, String> {
        let (Ok(text) | Err(text)) = &done;
        self.say(text, Priority::High);
        self.speak(self.now);
        done
    }

    /// The events since the last call, in order.
    pub fn events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }

    /// The route at hand, if there is one.
    pub fn route(&self) -> Option<&Route> {
        self.route.as_ref().map(|w| &w.route)
    }

    /// Every route recorded in this session, including the one in progress, with its file.
    pub fn recorded(&self) -> impl Iterator<Item = (Option<&Path>, &Route)> {
        let ended = self.recorded.iter().map(|(path, route)| (path.as_deref(), route));
        ended.chain(self.recording.iter().map(|r| (r.path.as_deref(), r.route())))
    }

    /// What it was begun with.
    pub fn config(&self) -> &SessionConfig {
        &self.config
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

    /// The guide's state; `None` without guidance.
    pub fn guide_state(&self) -> Option<GuideState> {
        self.guiding.as_ref().map(|g| g.guide.state())
    }

    /// Whether the last guidance ended at the end of its route.
    pub fn has_arrived(&self) -> bool {
        self.arrived
    }

    /// Why the guide gives no directions at present, while it has stopped for a reason.
    pub fn stop_reason(&self) -> Option<StopReason> {
        match self.guiding.as_ref()?.guide.state() {
            GuideState::Stopped(reason) => Some(reason),
            _ => None,
        }
    }

    /// The camera's position in the last pose, in the map's units.
    pub fn place(&self) -> Option<Vec3> {
        self.place.map(|place| place.world_from_camera.se3.translation)
    }

    /// Seconds since the first packet.
    pub fn elapsed_s(&self) -> f64 {
        self.since_start(self.now)
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
    /// When a file does not hold all of its route.
    pub fn close(&mut self) -> Result<(), String> {
        self.guiding = None;
        let recorded = self.close_recording();
        let kept = self.keeper.as_mut().map_or(Ok(()), |keeper| keeper.end(&self.engine));
        recorded.and(kept.map_err(|why| format!("the map of the routes is not saved: {why}")))
    }

    fn close_recording(&mut self) -> Result<(), String> {
        self.drop_unasked();
        let Some(recording) = self.recording.take() else { return Ok(()) };
        let (route, path, whole) = recording.finish();
        let name = path.as_ref().map_or_else(|| "the route".to_owned(), |p| p.display().to_string());
        let points = route.points.len();
        self.add_recorded(&path, &route, whole.is_ok());
        self.route = Some(RouteAtHand { route, path, here: true });
        whole.map_err(|e| format!("{name}: {e}; {points} points were recorded"))
    }

    /// Updates whether lengths in the map are metres; the recording and the guidance in progress follow.
    fn update_metric(&mut self, metric: bool) {
        self.status.metric = metric;
        if !metric {
            return;
        }
        if let Some(recording) = self.recording.as_mut().filter(|r| !r.route().header.metric) {
            recording.found_scale(&self.engine.snapshot(), self.place.as_ref());
            self.say(&self.text("walk-distances-known"), Priority::Normal);
        }
        if let Some(held) = self.route.as_mut().filter(|w| w.here && !w.route.header.metric) {
            held.route.header.metric = true;
            self.guiding.iter_mut().for_each(|g| g.reference_path.found_scale());
        }
    }

    /// The phrases in use: with distances only where the map is metric.
    fn phrases(&self) -> PhraseConfig {
        let phrases = self.config.phrases;
        PhraseConfig { metric: phrases.metric && self.status.metric, ..phrases }
    }

    fn add_recorded(&mut self, path: &Option<PathBuf>, route: &Route, is_on_disk: bool) {
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

    fn since_start(&self, t: Stamp) -> f64 {
        self.began.map_or(0.0, |b| t - b)
    }

    /// The language of what is said.
    pub fn language(&self) -> Language {
        self.config.phrases.language
    }

    /// Changes how it is said from now on.
    fn set(&mut self, setting: Setting) {
        let phrases = &mut self.config.phrases;
        match setting {
            Setting::Language(language) => phrases.language = language,
            Setting::Unit(unit) => phrases.unit = unit,
            Setting::Directions(style) => phrases.directions = style,
            Setting::WordsPerMinute(words) => self.voice.set_words_per_minute(words),
        }
    }

    fn text(&self, id: &str) -> String {
        self.language().text(id)
    }

    /// A sentence with a reason in it.
    fn because(&self, id: &str, why: impl ToString) -> String {
        self.language().say(id, &[("why", (&why.to_string()).into())])
    }

    fn say(&mut self, text: &str, priority: Priority) {
        self.voice.push(text, priority, self.now);
        self.pushed = Some((text.to_owned(), None));
    }

    /// A line that still waits is not said any more: its reason is gone.
    fn withdraw(&mut self, id: &str) {
        if self.voice.waiting() == Some(&self.text(id)) {
            self.voice.drop_waiting();
        }
    }

    fn speak(&mut self, now: Stamp) {
        self.drop_old_direction();
        let Some(u) = self.voice.poll(now) else { return };
        let turn_rad = self.pushed.as_ref().filter(|(t, _)| *t == u.text).and_then(|(_, turn)| *turn);
        let pose = self.direction.take_if(|(text, ..)| *text == u.text).map(|(_, stamp, _)| stamp);
        self.status.last_words.clone_from(&u.text);
        let t_s = self.since_start(u.stamp);
        self.events.push_back(Event::Said(Said {
            t_s,
            stamp: u.stamp,
            priority: rank(u.priority),
            interrupts: u.interrupts,
            duration_s: u.duration_s,
            language: self.language(),
            text: u.text,
            turn_rad,
            pose,
        }));
    }

    /// A direction that waits for the voice is dropped with its pose: the guide gives it again from a new one.
    fn drop_old_direction(&mut self) {
        let Some((text, pose, cue)) = &self.direction else { return };
        if self.voice.waiting() != Some(text) {
            self.direction = None;
        } else if self.ages.of(Some(*pose)).is_stale() {
            if let Some(guiding) = &mut self.guiding {
                guiding.guide.not_heard(cue);
            }
            self.direction = None;
            self.voice.drop_waiting();
        }
    }

    fn update_status(&mut self, output: &Output) {
        let s = &mut self.status;
        s.frames += 1;
        s.tracked += usize::from(output.anchored.is_some());
        (s.features, s.inliers) = (output.evidence.features, output.evidence.inliers);
        s.step_ms = output.extract_ms + output.track_ms;
        let map = self.engine.snapshot();
        (s.key_frames, s.landmarks) = (map.key_frame_count(), map.landmark_count());
    }

    fn record(&mut self, seen: &RecordInput) {
        let due = self.config.auto_record.is_some_and(|n| self.status.tracked >= n);
        if due
            && !self.auto_recorded
            && self.recording.is_none()
            && self.guiding.is_none()
            && self.route.is_none()
        {
            self.auto_recorded = true;
            match self.begin_recording(None) {
                Ok(words) => self.say(&words, Priority::Normal),
                Err(words) => self.say(&words, Priority::High),
            }
            self.is_auto = self.recording.is_some();
        }
        let place = self.place.as_ref();
        let words = self.recording.as_mut().and_then(|r| r.observe(seen, place));
        if words == Some("guide-found") {
            self.withdraw("walk-lost");
        }
        // Under guidance the guide reports on tracking; before the first pose nothing can be lost.
        if let Some(words) = words.filter(|_| self.guiding.is_none() && self.place.is_some()) {
            self.say(&self.text(words), Priority::High);
        }
    }

    fn begin_recording(&mut self, path: Option<PathBuf>) -> Result<String, String> {
        if self.recording.is_some() {
            return Err(self.text("walk-already-recording"));
        }
        (self.auto_recorded, self.is_auto) = (true, false);
        let named = path.or_else(|| self.config.record_to.take());
        if named.is_none() {
            // Where the file cannot be created, the recording reports it.
            let _ = std::fs::create_dir_all(self.folder.path());
        }
        let is_full = named.is_none() && self.is_full();
        let path = named.or_else(|| (!is_full).then(|| self.folder.next_path()));
        let (metric, map, place) = (self.status.metric, self.engine.snapshot(), self.place.as_ref());
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
                self.language().say("walk-recording-in-memory", &args)
            }
            (None, _) if is_full => self.text("walk-library-full"),
            (None, true) => self.text("walk-recording"),
            (None, false) => self.text("walk-recording-unmeasured"),
        })
    }

    /// Drops a recording that nobody asked for and that is too short to lead anywhere, where routes are kept for another
    /// day: else every visit would leave one.
    fn drop_unasked(&mut self) {
        let is_unasked = self.is_auto && self.keeper.is_some();
        let short = |r: &mut Recording| r.route().points.len() < SHORT_POINTS && r.route().notes.is_empty();
        let Some(recording) = self.recording.take_if(|r| is_unasked && short(r)) else { return };
        let (_, path, _) = recording.finish();
        if let Some(path) = path {
            let _ = std::fs::remove_file(path);
        }
    }

    fn end_recording(&mut self) -> Result<String, String> {
        let recording = self.recording.take().ok_or_else(|| self.text("walk-not-recording"))?;
        let length = recording.length();
        let (route, path, whole) = recording.finish();
        if route.points.len() < 2 {
            self.folder.refresh(None);
            return Err(self.text("walk-nothing-recorded"));
        }
        self.add_recorded(&path, &route, whole.is_ok());
        self.route = Some(RouteAtHand { route, path, here: true });
        whole.map_err(|e| self.because("walk-file-incomplete", e))?;
        let phrases = PhraseConfig { metric: self.engine.is_metric(), ..self.phrases() };
        Ok(phrases.measured(["walk-recorded", "walk-recorded-unmeasured"], length, &[]))
    }

    fn begin_guiding(&mut self, facing: Facing, again: bool) -> Result<String, String> {
        if self.recording.is_some() {
            self.end_recording()?;
        }
        self.update_metric(self.status.metric);
        let held = self.route.as_ref().ok_or_else(|| self.text("walk-no-route"))?;
        if !held.here {
            return Err(self.text("walk-other-map"));
        }
        let travel = if again { Travel::Again } else { Travel::Home };
        let (map, place) = (self.engine.snapshot(), self.place.as_ref());
        let guiding = Guiding::begin(&map, &held.route, travel, facing, place, self.now, &self.config.route)
            .map_err(|why| self.text(why.id()))?;
        // The guide's first words give the length and the first direction; before that, whether the map covers the
        // route is said.
        let camera = self.engine.front_end().model();
        let ready = |facing| guiding.reference_path.readiness(&map, &held.route, camera, facing);
        let with_camera_back = (facing == Facing::Home).then(|| ready(Facing::Back));
        let words = ready_words(&ready(facing), with_camera_back.as_deref(), &self.phrases());
        self.guiding = Some(guiding);
        self.arrived = false;
        Ok(words)
    }

    /// Why the unit of length of the last pose rules out directions along the route, if it does: the pose is in
    /// another map than the route, begun where scale could not be carried over, or its scale has been unsupported
    /// for longer than turning around takes.
    fn scale_hazard(&self) -> Option<StopReason> {
        let (scale, guiding) = (self.scale.filter(|s| !s.metric)?, self.guiding.as_ref()?);
        let held = self.route.as_ref()?;
        let basis = ScaleBasis {
            state: guiding.guide.state(),
            other_map: !guiding.reference_path.is_in(&self.engine.snapshot(), &held.route, scale.map),
            unsupported_s: self.unsupported.map(|since| self.now - since.max(guiding.asked)),
        };
        basis.rules_out_directions().then_some(StopReason::ScaleUncertain)
    }

    /// Takes the depth of a packet, while somebody is guided.
    fn observe_way(&mut self, packet: &FramePacket, tracked: bool) {
        let Some(way_ahead) = &mut self.way_ahead else { return };
        match (&self.guiding, &self.place) {
            (Some(guiding), Some(place)) if guiding.facing == Facing::Home => {
                if tracked {
                    way_ahead.observe(packet, guiding, place);
                }
            }
            _ => way_ahead.reset(),
        }
    }

    /// A step of the guide, with the last pose.
    fn guide(&mut self, now: Stamp) {
        // Measured after the engine's step, so that its processing time counts.
        let too_old = self.ages.hazard(self.frame, self.now);
        let stage_failed = self.dead.as_ref().map(|_| StopReason::StageDied);
        let hazard = stage_failed.or(too_old).or_else(|| self.scale_hazard());
        let speaking = self.voice.is_speaking(now);
        if !self.is_at_route(now, speaking) {
            return;
        }
        let (Some(guiding), Some(place), Some(held)) = (&mut self.guiding, self.place, &self.route) else {
            return;
        };
        let is_silent = !speaking && self.voice.waiting().is_none();
        let map = self.engine.snapshot();
        // In a map that has nothing to do with the route's the place on the route is not known.
        let elsewhere = (guiding.started && guiding.is_elsewhere).then_some(StopReason::TrackingLost);
        let hazard = hazard.or(elsewhere);
        // The first words of guidance do not cut off the answer to the command, and are not dropped because of it.
        if !guiding.started && speaking && now - guiding.asked < FIRST_WORDS_WAIT_S {
            return;
        }
        guiding.started = true;
        let hazard = hazard.or_else(|| {
            let found = self.way_ahead.as_mut()?.look(guiding, &place, now);
            guiding.guide.detour(found.detour);
            found.stop
        });
        let cue = guiding.step(&map, &held.route, &place, self.confidence, hazard, now);
        let ahead = guiding.bearing_of_route(&place);
        let has_words = cue.as_ref().is_some_and(|cue| cue.earcon().is_none() || cue.is_direction());
        let note = (is_silent && !has_words && self.confidence == Confidence::Good)
            .then(|| guiding.note(&map, &held.route, &place, self.config.phrases.language))
            .flatten();
        let arrived = guiding.guide.state() == GuideState::Arrived;
        if let Some(cue) = cue {
            self.cue(&cue, ahead, now);
        }
        if let Some(note) = note {
            self.say(&note, Priority::Normal);
        }
        if arrived {
            self.arrived = true;
            self.guiding = None;
        }
    }

    fn cue(&mut self, cue: &Cue, ahead_rad: f64, now: Stamp) {
        let turn = turn_of(cue);
        if let Some(earcon) = cue.earcon() {
            let bearing_rad = turn.unwrap_or(ahead_rad);
            self.events.push_back(Event::Sound(Sound { t_s: self.since_start(now), earcon, bearing_rad }));
        }
        if let Some(words) = self.phrases().words(cue) {
            self.voice.push(words.clone(), cue.priority(), now);
            let place = self.place.filter(|_| cue.is_direction());
            if self.voice.waiting() == Some(&words) {
                self.direction = place.map(|place| (words.clone(), place.stamp, cue.kind));
            }
            self.pushed = Some((words, turn));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_engine::{Config, Runner, SensorMode};
    use cairn_sensor::{Camera, Rig};

    #[test]
    fn a_waiting_line_dies_with_its_reason_and_settings_are_not_said() {
        let rig = Rig::mono(Camera::pinhole(320, 240, 220.0, 220.0, 159.5, 119.5));
        let engine = Engine::new(&rig, SensorMode::Mono, 30.0, Runner::Lockstep, &Config::default()).unwrap();
        let mut session = Session::new(engine, SessionConfig::default());
        session.say(&session.text("walk-mapping-failed"), Priority::Urgent);
        session.speak(session.now);
        session.say(&session.text("walk-no-picture"), Priority::High);
        session.withdraw("walk-lost");
        assert!(session.voice.waiting().is_some());
        session.withdraw("walk-no-picture");
        assert_eq!(session.voice.waiting(), None);
        session.events();
        session.command(&Command::parse("set language de").unwrap()).unwrap();
        session.command(&Command::parse("set speed 90").unwrap()).unwrap();
        assert!(session.events().is_empty() && session.language() == Language::German);
        assert_eq!(session.voice.config().rate, 0.5);
        session.tick(Stamp::from_seconds(60.0));
        let answer = session.command(&Command::parse("guide").unwrap()).unwrap_err();
        let Some(Event::Said(said)) = session.events().pop() else { panic!("nothing was said") };
        assert_eq!(said.text, "Es gibt noch keine Route. Erst eine aufnehmen oder laden.");
        assert_eq!((said.text, said.language), (answer, Language::German));
        assert_eq!(session.status().words, "Ich warte auf das erste Bild der Kamera.");
    }
}
