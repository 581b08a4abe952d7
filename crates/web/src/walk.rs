//! The session's thread: opens the source, drives the session, and reports to the hub.

use crate::config::{CameraSource, ServeConfig};
use crate::hub::Hub;
use crate::lens::{self, LensFound, LensWatch};
use crate::start::Start;
use crate::surface::SurfaceWork;
use crate::survive::{Survives, SurvivesIn};
use crate::wire::{self, ToPage};
use cairn_dense::SubmapConfig;
use cairn_engine::{Output, SensorMode};
use cairn_phrases::Language;
use cairn_sensor::{FramePacket, Source, SourceError};
use cairn_session::{
    Clock, Command, Drawn, Event, LensKnowledge, LibraryError, MapKeeper, NotSaved, NotTracked, Observer,
    Refused, RoutesLock, Script, Session, SessionStatus, Slam, WallClock, WallTime, drive, feed, routes_in,
};
use cairn_sources::{PhoneSource, Validator};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// A session over an engine here or elsewhere.
type Walk = Session<Box<dyn Slam>>;

/// Interval of the status messages.
const STATUS_EVERY: Duration = Duration::from_millis(100);
/// Interval of the images.
const PICTURE_EVERY: Duration = Duration::from_millis(100);
/// Interval of where the camera is in the map.
const VIEW_EVERY: Duration = Duration::from_millis(250);
/// Interval of the map.
const MAP_EVERY: Duration = Duration::from_millis(1000);
/// Maximum number of landmarks drawn.
const MOST_POINTS: usize = 4000;

/// Runs the session until the source ends; a failure is sent to the pages and returned.
pub(crate) fn walk(
    hub: &Arc<Hub>,
    serve: ServeConfig,
    routes: Option<RoutesLock>,
) -> Result<(), SourceError> {
    let result = run_session(hub, serve, routes);
    hub.running.store(false, Ordering::Relaxed);
    match &result {
        // Why is printed by who started the server.
        Err(_) => hub.broadcast(&ToPage::Failed(true)),
        Ok(()) => hub.broadcast(&ToPage::Ended(true)),
    }
    result
}

/// A session that was ended before its first picture has not failed.
fn run_session(hub: &Arc<Hub>, serve: ServeConfig, lock: Option<RoutesLock>) -> Result<(), SourceError> {
    let (mut session, mut observer) = match begin(hub, serve, lock) {
        Err(_) if hub.shutting_down.load(Ordering::Relaxed) => return Ok(()),
        begun => begun?,
    };
    hub.running.store(true, Ordering::Relaxed);
    let ended = drive(&mut session, Clock::Wall(&hub.inbox), &mut Script::default(), &mut observer);
    let closed = session.close();
    observer.finish(&mut session);
    let name = &session.config().source;
    let closed = closed.map_err(|why| SourceError::new(name, why.to_string(), why.cure()));
    match ended {
        // The source fails because it was asked to end.
        Err(_) if hub.shutting_down.load(Ordering::Relaxed) => closed,
        Err(e) => {
            // Both are said.
            if let Err(why) = closed {
                (hub.access.tell)(&why.to_string());
            }
            Err(e)
        }
        Ok(_) => closed,
    }
}

/// Opens the source and begins the session, with who reports on it.
fn begin(
    hub: &Arc<Hub>,
    serve: ServeConfig,
    lock: Option<RoutesLock>,
) -> Result<(Walk, PageObserver), SourceError> {
    // Routes are shown before there is a picture.
    if let Some(folder) = &serve.routes {
        let listed = routes_in(folder, wall_of(hub)(), &serve.session.phrases);
        hub.routes.send_replace(ToPage::Routes(&listed).text().into());
    }
    let (mut lens, mut knowledge, mut config) = (None, None, serve.config);
    let (source, mode, has_imu): (Box<dyn Source>, SensorMode, bool) = match serve.camera {
        CameraSource::Page { rig } => {
            let is_given = rig.is_some();
            let mut phone = PhoneSource::open(&hub.port, rig.map(|r| *r))?;
            lens = (!is_given).then(|| lens_of(hub, serve.keep.clone(), &mut phone)).flatten();
            // A phone with motion data makes the map metric.
            let has_imu = phone.rig().imu.is_some();
            let is_certain = is_given || lens.as_ref().is_some_and(LensWatch::is_certain);
            knowledge = LensKnowledge::of(is_certain, has_imu).filter(|_| !is_given);
            if has_imu {
                config.expect_phone(is_given);
            }
            let to_pages = hub.clone();
            let watched =
                Validator::new(Box::new(phone), move |doubt| to_pages.broadcast(&ToPage::Doubt(doubt)))
                    .may_lack_imu();
            (Box::new(watched), SensorMode::Mono, has_imu)
        }
        CameraSource::Source { open, .. } => open()?,
    };
    let name = source.info().name.clone();
    config.inertial.enabled = has_imu;
    let mut session_config = serve.session;
    session_config.source.clone_from(&name);
    let survives = serve.survives.map(SurvivesIn::new);
    let before = survives.as_ref().map(|s| s.before()).unwrap_or_default();
    let (rig, rate_hz) = (source.rig().clone(), source.info().rate_hz);
    let (begin, dense) = (serve.slam, serve.dense);
    let mut start = Start { begin, name: name.clone(), rig, mode, has_imu, rate_hz, config, dense };
    let surface;
    let mut session = match lock {
        None => {
            let (mut slam, _) = start
                .slam(None)
                .map_err(|e| SourceError::new(&name, e.to_string(), "give a calibration with --rig"))?;
            surface = dense.then(|| surface_of(&mut slam, &start, hub)).transpose()?;
            Session::new(slam, session_config)
        }
        Some(lock) => {
            let is_guessed = knowledge.is_some_and(|known| known != LensKnowledge::Found);
            let camera = start.camera(!is_guessed);
            let kept = camera.and_then(|camera| {
                MapKeeper::open_with(lock, before.atlas.clone(), &camera, |map| start.slam(map))
            });
            let mut kept = kept.map_err(|e| SourceError::new(&name, e.to_string(), cure_of(&e)))?;
            surface = dense.then(|| surface_of(&mut kept.engine, &start, hub)).transpose()?;
            kept.notes.iter().for_each(|note| hub.broadcast(&ToPage::Doubt(note)));
            Session::new(kept.engine, session_config).keeping(kept.keeper.with_clock(wall_of(hub)))
        }
    };
    session.go_on(&before);
    if let Some(known) = knowledge {
        session.knows_of_lens(known);
    }
    feed(source, hub.inbox.clone()).map_err(|e| {
        SourceError::new(&name, format!("no thread to read it ({e})"), "close other programs")
    })?;
    let lens = lens.map(|lens| (lens, start));
    Ok((session, PageObserver { lens, survives, surface, ..PageObserver::new(hub.clone()) }))
}

/// Takes the lens that is kept for the phone, and checks it; where none is, it is watched for. Nothing is kept without a
/// folder, or for a page that does not say which phone it is on.
fn lens_of(hub: &Hub, folder: Option<PathBuf>, source: &mut PhoneSource) -> Option<LensWatch> {
    let phone = hub.access.phones.current();
    let folder = folder.filter(|_| !phone.is_empty());
    let guess = source.rig().cameras.first()?.camera;
    let kept = folder.as_ref().and_then(|folder| lens::kept(folder, &phone, &guess));
    let kept = kept.filter(|lens| source.set_camera(lens.camera(&guess)));
    Some(LensWatch::new(folder, phone, guess, kept))
}

/// Begins to make surfaces of the depth.
fn surface_of(slam: &mut Box<dyn Slam>, start: &Start, hub: &Arc<Hub>) -> Result<SurfaceWork, SourceError> {
    let config = SubmapConfig::default();
    let failed = |why: String, cure| SourceError::new(&start.name, why, cure);
    let surfaces = slam
        .surfaces(&start.rig, config)
        .map_err(|e| failed(e.to_string(), "give a source with depth and --sensor rgbd"))?;
    SurfaceWork::begin(surfaces, &config, hub.clone())
        .map_err(|e| failed(format!("no thread for its surface ({e})"), "close other programs"))
}

fn cure_of(error: &LibraryError) -> &'static str {
    match error {
        LibraryError::Busy(_) | LibraryError::Folder { .. } => "give another folder with --data",
        LibraryError::Rig(_) => "give a calibration with --rig",
        LibraryError::Slam(_) => "leave out --isolated",
    }
}

/// The time of day where the pages are.
fn wall_of(hub: &Arc<Hub>) -> WallClock {
    let hub = hub.clone();
    Arc::new(move || WallTime { offset_s: hub.zone_s.load(Ordering::Relaxed), ..WallTime::now() })
}

/// Reports the session's events to the hub.
struct PageObserver {
    hub: Arc<Hub>,
    status: Option<Instant>,
    picture: Option<Instant>,
    view: Option<Instant>,
    map: Option<Instant>,
    /// The routes that the pages have: a version, the route at hand, and the language that they are in.
    routes: Option<(u64, Option<PathBuf>, Language)>,
    /// While the lens is a guess, or was kept and is not checked yet; and how to begin again with another.
    lens: Option<(LensWatch, Start)>,
    /// A lens that was found, and is used once what hangs on the map has ended.
    lens_due: Option<LensFound>,
    survives: Option<SurvivesIn>,
    /// Makes surfaces, where they are wanted.
    surface: Option<SurfaceWork>,
    /// What is not on disk, as the terminal was told.
    unsaved: Vec<NotSaved>,
}

impl PageObserver {
    fn new(hub: Arc<Hub>) -> Self {
        Self {
            hub,
            status: None,
            picture: None,
            view: None,
            map: None,
            routes: None,
            lens: None,
            lens_due: None,
            survives: None,
            surface: None,
            unsaved: Vec::new(),
        }
    }

    fn send_status(&mut self, session: &Walk) {
        let status = session.status();
        self.tell_unsaved(&status);
        let dropped = self.hub.inbox.dropped();
        let message = ToPage::Status { status: &status, dropped };
        self.hub.status.send_replace(message.text().into());
    }

    /// Tells the terminal what is not on disk, once, and when the map is.
    fn tell_unsaved(&mut self, status: &SessionStatus) {
        let now = unsaved(status);
        let kind = |u: &[NotSaved]| u.iter().map(std::mem::discriminant).collect::<Vec<_>>();
        if kind(&now) != kind(&self.unsaved) {
            now.iter().for_each(|why| (self.hub.access.tell)(&told(why)));
            let is_map = |u: &[NotSaved]| u.iter().any(|why| matches!(why, NotSaved::Map(_)));
            if is_map(&self.unsaved) && !is_map(&now) {
                (self.hub.access.tell)("the map of the routes is saved now");
            }
            self.unsaved = now;
        }
    }

    /// The kept routes, where they have changed.
    fn send_routes(&mut self, session: &Walk) {
        let (version, held) = session.routes_version();
        let now = (version, held.map(Path::to_owned), session.language());
        if self.routes.as_ref() == Some(&now) {
            return;
        }
        self.routes = Some(now);
        let routes = session.routes();
        // With another camera than the page's it is no route of the phone.
        let own = routes.iter().find(|route| route.why_not.is_none() && self.hub.camera.is_empty());
        if let Some(route) = own {
            self.hub.access.phones.keep_route((route.number, route.name.clone()));
        }
        self.hub.routes.send_replace(ToPage::Routes(&routes).text().into());
    }

    /// Estimates the lens while it is a guess, and checks a kept one; begins again with one that was found, once nothing is in
    /// progress on the map that was made without it.
    fn watch_lens(&mut self, session: &mut Walk) {
        let Some((watch, start)) = &mut self.lens else { return };
        if self.lens_due.is_none()
            && let Some(found) = watch.step(&**session.engine())
        {
            if found.is_certain {
                let lens = found.lens;
                self.hub.broadcast(&ToPage::Lens {
                    focal: lens.focal,
                    radial: lens.radial,
                    sigma: lens.sigma,
                });
            }
            if let Some(why) = &found.not_kept {
                self.hub.broadcast(&ToPage::Doubt(why));
            }
            if found.is_in_use {
                session.knows_of_lens(LensKnowledge::of(true, start.has_imu));
                watch.with(found.lens).into_iter().for_each(|next| *watch = next);
                return;
            }
            if found.is_certain && !session.may_restart_slam() {
                session.knows_of_lens(LensKnowledge::FoundForLater);
            }
            self.lens_due = Some(found);
        }
        let Some(found) = self.lens_due.take_if(|_| session.may_restart_slam()) else { return };
        let Some(next) = watch.with(found.lens) else { return };
        start.rig.cameras[0].camera = next.camera();
        start.config.tracker.clocks = found.clocks;
        let camera = start.camera(found.is_certain);
        match camera.and_then(|camera| session.restart_slam(&camera, |map| start.slam(map))) {
            Ok(notes) => {
                notes.iter().for_each(|note| self.hub.broadcast(&ToPage::Doubt(note)));
                *watch = next;
                if found.is_certain {
                    session.knows_of_lens(LensKnowledge::of(true, start.has_imu));
                }
            }
            Err(e) => {
                self.hub.broadcast(&ToPage::Doubt(&e.to_string()));
                (self.hub.access.tell)(&e.to_string());
            }
        }
    }

    /// The last messages when the session has ended.
    fn finish(&mut self, session: &mut Walk) {
        for event in session.events() {
            self.on_event(session, &event);
        }
        self.send_status(session);
    }
}

/// What is not on disk at present.
fn unsaved(status: &SessionStatus) -> Vec<NotSaved> {
    let route = status.recording.as_ref().and_then(|r| Some(NotSaved::Route(r.trouble.clone()?)));
    route.into_iter().chain(status.map_trouble.clone().map(NotSaved::Map)).collect()
}

/// As the terminal is told.
fn told(why: &NotSaved) -> String {
    format!("{why}; {}", why.cure())
}

/// Whether the interval has passed; stores the time if so.
fn due(last: &mut Option<Instant>, every: Duration) -> bool {
    let due = last.is_none_or(|t| t.elapsed() >= every);
    if due {
        *last = Some(Instant::now());
    }
    due
}

impl Observer<Box<dyn Slam>> for PageObserver {
    fn on_event(&mut self, _: &Walk, event: &Event) {
        let pose_ms = match event {
            Event::Said(said) => said.pose.and_then(|pose| self.hub.port.page_ms(pose)),
            Event::Sound(_) => None,
        };
        let _ = self.hub.messages.send(wire::event(event, pose_ms).into());
    }

    fn on_output(&mut self, _: &Walk, packet: &FramePacket, output: &Result<Output, NotTracked>) {
        self.hub.frame.send_replace(ToPage::Frame { ms: self.hub.port.page_ms(packet.stamp) }.text().into());
        if let (Some(surface), Ok(output)) = (&self.surface, output) {
            surface.on_packet(packet, output);
        }
        if self.hub.wanted.pictures.load(Ordering::Relaxed) == 0 || !due(&mut self.picture, PICTURE_EVERY) {
            return;
        }
        if let Some(image) = packet.images.first() {
            let features = output.as_ref().map_or(&[][..], |o| &o.frame.raw);
            self.hub.picture.send_replace(wire::preview(image, features).into());
        }
    }

    fn on_command(&mut self, session: &Walk, command: &Command, done: &Result<String, Refused>) {
        // A page that sets how it is spoken to, as it does whenever it connects, needs no answer.
        if matches!(command, Command::Set(_)) {
            return;
        }
        let (ok, text) = match done {
            Ok(text) => (true, text),
            Err(why) => (false, &why.words),
        };
        self.hub.broadcast(&ToPage::Did { ok, text });
        if *command == Command::Stop {
            (self.hub.access.tell)(text);
            // Whoever stops a recording relies on it.
            unsaved(&session.status()).iter().for_each(|why| (self.hub.access.tell)(&told(why)));
        }
        // The map on the screens is updated at once.
        self.map = None;
    }

    fn on_step(&mut self, session: &mut Walk) {
        self.hub.steps.fetch_add(1, Ordering::Relaxed);
        if due(&mut self.status, STATUS_EVERY) {
            self.send_status(session);
            self.send_routes(session);
            self.watch_lens(session);
            if let Some(file) = &mut self.survives {
                file.keep(Survives { holder: self.hub.held(), walk: session.walk_state() });
            }
        }
        if self.hub.wanted.maps.load(Ordering::Relaxed) == 0 {
            return;
        }
        if due(&mut self.view, VIEW_EVERY) {
            let camera = session.camera().filter(|_| session.engine_status().valid);
            self.hub.view.send_replace(ToPage::View { camera }.text().into());
        }
        if due(&mut self.map, MAP_EVERY) {
            let view = session.view(MOST_POINTS);
            self.hub.map.send_modify(|map| *map = Arc::new(Drawn::of(&view, map)));
        }
    }
}
