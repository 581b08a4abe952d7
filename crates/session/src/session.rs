//! One walk: packets and commands in, words and sounds out. The engine sees, the recorder keeps, the guide leads.
//!
//! It knows no clock but the stamps, and no thread. Whoever drives it ([`crate::drive_live`], [`crate::drive_lockstep`])
//! gives it packets, and ticks while there are none: then the guide says stop.

mod look;

use crate::command::Command;
use crate::disk::{Disk, OwnDisk};
use crate::event::{Event, Said, Sound, rank, turn_of};
use crate::recording::{Recording, latest, next_path, tracked};
use crate::reference_path::ReferencePath;
use crate::status::Status;
use cairn_engine::{Engine, Output, record_input};
use cairn_geometry::{Camera, Odom, Pose, Se3, Vec3};
use cairn_guide::{
    Announcer, AnnouncerConfig, Confidence, Cue, Facing, Guide, GuideConfig, GuideInput, GuideState,
    PhraseConfig, Priority, RecordInput, Recorder, Route, StopReason, Travel, ready_words, wrap,
};
use cairn_sensor::{FramePacket, Stamp};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// What a session goes by.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// Where ways are kept.
    pub folder: PathBuf,
    /// The file of the first recording; a free name in the folder without it.
    pub record_to: Option<PathBuf>,
    /// What the pictures come from, for the files.
    pub source: String,
    /// Record by itself after so many tracked frames.
    pub auto_record: Option<usize>,
    /// How the walker goes when nothing else is asked for.
    pub facing: Facing,
    /// The map was loaded: ways from files lie on it.
    pub map_is_loaded: bool,
    /// How things are said.
    pub phrases: PhraseConfig,
    /// Rate, volume and patience of the voice.
    pub announcer: AnnouncerConfig,
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
        }
    }
}

/// No picture for this long is told, seconds.
const GONE_S: f64 = 1.0;
/// The first words of guidance wait so long for others to end, seconds.
const WAITS_FOR_WORDS_S: f64 = 12.0;

/// A way that can be walked.
struct Held {
    route: Route,
    path: Option<PathBuf>,
    /// It hangs on the map of this session.
    here: bool,
}

/// Guidance under way.
struct Guiding {
    guide: Guide,
    reference_path: ReferencePath,
    facing: Facing,
    asked: Stamp,
    map_created: bool,
}

/// One walk.
pub struct Session {
    engine: Engine,
    config: SessionConfig,
    disk: Box<dyn Disk>,
    began: Option<Stamp>,
    now: Stamp,
    /// The last frame's time, and the last pose with its own.
    frame: Option<Stamp>,
    pose: Option<(Stamp, Se3)>,
    confidence: Confidence,
    recording: Option<Recording>,
    auto_recorded: bool,
    /// Ways recorded in this session and ended, with their files.
    recorded: Vec<(Option<PathBuf>, Route)>,
    route: Option<Held>,
    guiding: Option<Guiding>,
    voice: Announcer,
    /// Words pushed last, and the turn they ask for.
    pushed: Option<(String, Option<f64>)>,
    events: VecDeque<Event>,
    gone_told: bool,
    arrived: bool,
    dead: Option<String>,
    status: Status,
}

impl Session {
    /// A session over an engine that has seen nothing yet (or has loaded its map).
    pub fn new(engine: Engine, config: SessionConfig) -> Self {
        let voice = Announcer::new(config.announcer);
        let status = Status { metric: engine.is_metric(), ..Status::default() };
        Self {
            engine,
            config,
            disk: Box::new(OwnDisk),
            began: None,
            now: Stamp::default(),
            frame: None,
            pose: None,
            confidence: Confidence::Lost,
            recording: None,
            auto_recorded: false,
            recorded: Vec::new(),
            route: None,
            guiding: None,
            voice,
            pushed: None,
            events: VecDeque::new(),
            gone_told: false,
            arrived: false,
            dead: None,
            status,
        }
    }

    /// Writes ways to another disk.
    pub fn on_disk(mut self, disk: Box<dyn Disk>) -> Self {
        self.disk = disk;
        self
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The engine, to finish it.
    pub fn engine_mut(&mut self) -> &mut Engine {
        &mut self.engine
    }

    /// Takes a packet: a pose, a point of the way, a step of the guide. `Err` tells why the packet was not seen; the
    /// session goes on.
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
                // What the engine holds can not be trusted any more.
                self.dead = Some("tracking stopped by an error of the program".into());
                self.tick(packet.stamp);
                return Err("tracking stopped by an error of the program".into());
            }
        };
        self.frame = Some(packet.stamp);
        if std::mem::take(&mut self.gone_told) && self.guiding.is_none() {
            self.say("The picture is back.", Priority::Normal);
        }
        if output.died.is_some() {
            self.say("Stop. Mapping has failed. Record what you have and begin anew.", Priority::Urgent);
        }
        let seen = record_input(&output);
        self.confidence = seen.confidence;
        if tracked(&seen) {
            self.pose = Some((seen.stamp, seen.odom_from_camera.se3));
        }
        self.note(&output);
        if output.anchored.is_some() {
            // The pose of the frame with which scale is found is still in the unit before.
            self.measure(output.metric && self.engine.is_metric());
        }
        self.record(&seen);
        self.guide(packet.stamp);
        self.speak(packet.stamp);
        Ok(output)
    }

    /// Time passes without a packet.
    pub fn tick(&mut self, now: Stamp) {
        self.now = self.now.max(now);
        let silent = self.frame.is_some_and(|t| self.now - t > GONE_S);
        if silent && !self.gone_told {
            self.gone_told = true;
            if self.guiding.is_none() {
                self.say("No picture comes. Stand still.", Priority::High);
            }
        }
        self.guide(self.now);
        self.speak(self.now);
    }

    /// Does what was asked; gives what was done or why not, in words that are also said.
    pub fn command(&mut self, command: &Command) -> Result<String, String> {
        let done = match command {
            Command::Record => self.begin_recording(None),
            Command::Stop => self.end_recording(),
            Command::Load(path) => self.load(path.as_deref()),
            Command::Guide { facing, again } => {
                self.begin_guiding(facing.unwrap_or(self.config.facing), *again)
            }
            Command::Halt => match self.guiding.take() {
                Some(_) => Ok("Guidance has ended.".into()),
                None => Err("There is no guidance to end.".into()),
            },
            Command::Repeat => {
                self.voice.repeat(self.now);
                self.speak(self.now);
                return Ok(self.status.last_words.clone());
            }
            Command::Status => Ok(self.in_words()),
            Command::Quit => Ok("Good bye.".into()),
        };
        let (Ok(text) | Err(text)) = &done;
        self.say(text, Priority::High);
        self.speak(self.now);
        done
    }

    /// What happened since this was last asked, in order.
    pub fn events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }

    /// The way at hand, if there is one.
    pub fn route(&self) -> Option<&Route> {
        self.route.as_ref().map(|w| &w.route)
    }

    /// Every way recorded in this session, the one under way too, with its file.
    pub fn recorded(&self) -> impl Iterator<Item = (Option<&Path>, &Route)> {
        let ended = self.recorded.iter().map(|(path, route)| (path.as_deref(), route));
        ended.chain(self.recording.iter().map(|r| (r.path.as_deref(), r.route())))
    }

    /// Goes on with a record that has a file already, in the map it was recorded in.
    pub fn resume_recording(&mut self, recorder: Recorder, path: &Path) {
        self.auto_recorded = true;
        self.recording = Some(Recording::resume(recorder, path));
    }

    /// Whether a recording is under way.
    pub fn is_recording(&self) -> bool {
        self.recording.is_some()
    }

    /// What the guide does; `None` without guidance.
    pub fn guide_state(&self) -> Option<GuideState> {
        self.guiding.as_ref().map(|g| g.guide.state())
    }

    /// Whether the last guidance ended at the end of its way.
    pub fn has_arrived(&self) -> bool {
        self.arrived
    }

    /// Where the camera was in the last pose, in the map's units.
    pub fn place(&self) -> Option<Vec3> {
        self.pose.map(|(_, p)| p.translation)
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

    /// Ends what is under way; an error when a file does not hold all of its way.
    pub fn close(&mut self) -> Result<(), String> {
        self.guiding = None;
        let Some(recording) = self.recording.take() else { return Ok(()) };
        let (route, path, whole) = recording.finish();
        let name = path.as_ref().map_or_else(|| "the way".to_owned(), |p| p.display().to_string());
        let points = route.points.len();
        self.keep(&path, &route);
        self.route = Some(Held { route, path, here: true });
        whole.map_err(|e| format!("{name}: {e}; {points} points were recorded"))
    }

    /// Lengths in the map are metres now, or are not: what is recorded and walked by goes along.
    fn measure(&mut self, metric: bool) {
        self.status.metric = metric;
        if !metric {
            return;
        }
        if let Some(recording) = self.recording.as_mut().filter(|r| !r.route().header.metric) {
            recording.found_scale(&self.engine.snapshot());
            self.say("Distances are known now.", Priority::Normal);
        }
        if let Some(held) = self.route.as_mut().filter(|w| w.here && !w.route.header.metric) {
            held.route.header.metric = true;
            self.guiding.iter_mut().for_each(|g| g.reference_path.found_scale());
        }
    }

    /// How things are said: with distances where there are any.
    fn phrases(&self) -> PhraseConfig {
        let phrases = self.config.phrases;
        PhraseConfig { metric: phrases.metric && self.status.metric, ..phrases }
    }

    fn keep(&mut self, path: &Option<PathBuf>, route: &Route) {
        if !route.points.is_empty() {
            self.recorded.push((path.clone(), route.clone()));
        }
    }

    fn since_start(&self, t: Stamp) -> f64 {
        self.began.map_or(0.0, |b| t - b)
    }

    fn say(&mut self, text: &str, priority: Priority) {
        self.voice.push(text, priority, self.now);
        self.pushed = Some((text.to_owned(), None));
    }

    fn speak(&mut self, now: Stamp) {
        let Some(u) = self.voice.poll(now) else { return };
        let turn_rad = self.pushed.as_ref().filter(|(t, _)| *t == u.text).and_then(|(_, turn)| *turn);
        self.status.last_words.clone_from(&u.text);
        let t_s = self.since_start(u.stamp);
        self.events.push_back(Event::Said(Said {
            t_s,
            stamp: u.stamp,
            priority: rank(u.priority),
            interrupts: u.interrupts,
            duration_s: u.duration_s,
            text: u.text,
            turn_rad,
        }));
    }

    fn note(&mut self, output: &Output) {
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
        }
        let words = self.recording.as_mut().and_then(|r| r.observe(seen));
        // Under guidance the guide speaks about tracking; before the first pose there is nothing to lose.
        if let Some(words) = words.filter(|_| self.guiding.is_none() && self.pose.is_some()) {
            self.say(words, Priority::High);
        }
    }

    fn begin_recording(&mut self, path: Option<PathBuf>) -> Result<String, String> {
        if self.recording.is_some() {
            return Err("The way is being recorded already.".into());
        }
        self.auto_recorded = true;
        let named = path.or_else(|| self.config.record_to.take());
        if named.is_none() {
            // Where it can not be made, the recording says so.
            let _ = std::fs::create_dir_all(&self.config.folder);
        }
        let path = named.unwrap_or_else(|| next_path(&self.config.folder));
        let metric = self.status.metric;
        let (recording, trouble) =
            Recording::begin(&*self.disk, &path, &self.engine.snapshot(), metric, &self.config.source);
        self.recording = Some(recording);
        Ok(match (trouble, metric) {
            (Some(why), _) => format!("Recording in memory only: {}: {why}.", path.display()),
            (None, true) => "Recording.".into(),
            (None, false) => "Recording. The scale is not known: no distances will be told.".into(),
        })
    }

    fn end_recording(&mut self) -> Result<String, String> {
        let recording = self.recording.take().ok_or("Nothing is being recorded.")?;
        let length = recording.length();
        let (route, path, whole) = recording.finish();
        if route.points.len() < 2 {
            return Err("Recording has ended. Nothing was recorded.".into());
        }
        self.keep(&path, &route);
        self.route = Some(Held { route, path, here: true });
        whole.map_err(|e| {
            format!("Recording has ended, but the file is not whole: {e}. The way is kept in memory.")
        })?;
        Ok(match self.engine.is_metric() {
            true => format!("Recording has ended, {}.", self.phrases().distance(length)),
            false => "Recording has ended.".into(),
        })
    }

    fn load(&mut self, path: Option<&Path>) -> Result<String, String> {
        let path = match path {
            Some(path) => path.to_owned(),
            None => latest(&self.config.folder).ok_or("There is no recorded way to load.")?,
        };
        if let Some(held) = self.route.as_ref().filter(|w| w.path.as_deref() == Some(&path)) {
            return Ok(format!("The way is loaded, {} points.", held.route.points.len()));
        }
        let route = Route::load(&path).map_err(|e| format!("The way can not be read: {e}."))?;
        if route.points.len() < 2 {
            return Err("That way has no points.".into());
        }
        let words = format!("The way is loaded, {} points.", route.points.len());
        self.route = Some(Held { route, path: Some(path), here: self.config.map_is_loaded });
        Ok(words)
    }

    fn begin_guiding(&mut self, facing: Facing, again: bool) -> Result<String, String> {
        if self.recording.is_some() {
            self.end_recording()?;
        }
        self.measure(self.status.metric);
        let held = self.route.as_ref().ok_or("There is no way to guide along: record or load one first.")?;
        if !held.here {
            return Err("That way belongs to a map that is not loaded.".into());
        }
        let travel = if again { Travel::Again } else { Travel::Home };
        let reference_path = ReferencePath::new(&self.engine.snapshot(), &held.route, travel, self.now);
        let plan = reference_path.plan().map_err(|e| format!("There is no guidance: {e}."))?;
        let config = GuideConfig { facing, ..GuideConfig::default() };
        let guide = Guide::new(plan, reference_path.ground, config)
            .map_err(|e| format!("There is no guidance: {e}."))?;
        // What the guide says first tells the length and how to go; before that, whether the map knows the way.
        let ready =
            reference_path.readiness(&self.engine.snapshot(), self.engine.front_end().model(), facing);
        let words = ready_words(&ready, &self.phrases());
        self.guiding = Some(Guiding { guide, reference_path, facing, asked: self.now, map_created: false });
        self.arrived = false;
        Ok(words)
    }

    /// A step of the guide, with the last pose there is.
    fn guide(&mut self, now: Stamp) {
        let speaking = self.voice.is_speaking(now);
        let (Some(guiding), Some((pose_stamp, pose))) = (&mut self.guiding, self.pose) else { return };
        // What was just answered is not cut off by, and does not cost, the first words of guidance.
        if !guiding.map_created && speaking && now - guiding.asked < WAITS_FOR_WORDS_S {
            return;
        }
        guiding.map_created = true;
        if let Some(held) = &self.route
            && let Some(plan) = guiding.reference_path.moved(&self.engine.snapshot(), &held.route, now)
        {
            guiding.guide.correct_route(plan);
        }
        let in_metres = Se3::new(pose.rotation, pose.translation * guiding.reference_path.unit);
        let input = GuideInput {
            now,
            pose_stamp,
            odom_from_camera: Pose::<Odom, Camera>::new(in_metres),
            confidence: self.confidence,
            speed: None,
            hazard: self.dead.as_ref().map(|_| StopReason::StageDied),
        };
        let cue = guiding.guide.step(&input);
        let ahead = bearing_of_route(guiding, &in_metres);
        let arrived = guiding.guide.state() == GuideState::Arrived;
        if let Some(cue) = cue {
            self.cue(&cue, ahead, now);
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
            self.pushed = Some((words, turn));
        }
    }
}

/// Where the way goes on, seen from the walker's reference_path: radians, positive left.
fn bearing_of_route(guiding: &Guiding, pose: &Se3) -> f64 {
    let heading_kind = guiding.facing.heading_kind(&guiding.reference_path.ground, &Pose::new(*pose));
    match (heading_kind, guiding.guide.place()) {
        (Some(heading_kind), Some(place)) => wrap(heading_kind.turn_to(place.heading)),
        _ => 0.0,
    }
}
