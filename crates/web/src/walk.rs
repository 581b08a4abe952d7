//! The session's thread: opens the source, drives the session, and reports to the hub.

use crate::hub::Hub;
use crate::server::{CameraSource, ServeConfig};
use crate::wire::{self, ToPage};
use cairn_engine::{Engine, Output, Runner, SensorMode};
use cairn_sensor::{FramePacket, Source, SourceError};
use cairn_session::{Command, Event, Face, Script, Session, drive_live, feed};
use cairn_sources::{PhoneSource, Validator};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Interval of the status messages.
const STATUS_EVERY: Duration = Duration::from_millis(100);
/// Interval of the images.
const PICTURE_EVERY: Duration = Duration::from_millis(100);
/// Interval of the map.
const VIEW_EVERY: Duration = Duration::from_millis(1000);
/// Maximum number of landmarks drawn.
const MOST_POINTS: usize = 4000;

/// Runs the session until the source ends; a failure is sent to the pages and returned.
pub(crate) fn walk(hub: &Arc<Hub>, serve: ServeConfig) -> Result<(), SourceError> {
    // A session that was ended before its first picture has not failed.
    let result = run_session(hub, serve)
        .or_else(|e| if hub.shutting_down.load(Ordering::Relaxed) { Ok(()) } else { Err(e) });
    hub.running.store(false, Ordering::Relaxed);
    match &result {
        Err(e) => hub.broadcast(&ToPage::Trouble(&e.to_string())),
        Ok(()) => hub.broadcast(&ToPage::Ended(true)),
    }
    result
}

fn run_session(hub: &Arc<Hub>, serve: ServeConfig) -> Result<(), SourceError> {
    let (source, mode, has_imu): (Box<dyn Source>, SensorMode, bool) = match serve.camera {
        CameraSource::Page { rig } => {
            let phone = PhoneSource::open(&hub.port, rig.map(|r| *r))?;
            // A phone with motion data makes the map metric.
            let has_imu = phone.rig().imu.is_some();
            let to_pages = hub.clone();
            let watched =
                Validator::new(Box::new(phone), move |doubt| to_pages.broadcast(&ToPage::Doubt(doubt)))
                    .may_lack_imu();
            (Box::new(watched), SensorMode::Mono, has_imu)
        }
        CameraSource::Source { open, .. } => open()?,
    };
    let name = source.info().name.clone();
    let mut config = serve.config;
    config.inertial.enabled = has_imu;
    let engine = Engine::new(source.rig(), mode, source.info().rate_hz, Runner::Threaded, &config)
        .map_err(|e| SourceError::new(&name, e.to_string(), "give a calibration with --rig"))?;
    let mut session_config = serve.session;
    session_config.source.clone_from(&name);
    let mut session = Session::new(engine, session_config);
    feed(source, hub.inbox.clone()).map_err(|e| {
        SourceError::new(&name, format!("no thread to read it ({e})"), "close other programs")
    })?;
    hub.running.store(true, Ordering::Relaxed);
    let mut face = PageFace::new(hub.clone());
    let ended = drive_live(&mut session, &hub.inbox, &mut Script::default(), &mut face);
    let closed = session.close();
    face.finish(&mut session);
    ended?;
    closed.map_err(|why| SourceError::new(&name, why, "make room on the disk"))
}

/// Reports the session's events to the hub.
struct PageFace {
    hub: Arc<Hub>,
    status: Option<Instant>,
    picture: Option<Instant>,
    view: Option<Instant>,
    /// The time of the last image in the clock of its page, if it is from one.
    frame_ms: Option<f64>,
}

impl PageFace {
    fn new(hub: Arc<Hub>) -> Self {
        Self { hub, status: None, picture: None, view: None, frame_ms: None }
    }

    fn send_status(&self, session: &Session) {
        let status = session.status();
        let dropped = self.hub.inbox.dropped();
        let message = ToPage::Status { frame_ms: self.frame_ms, status: &status, dropped };
        self.hub.status.send_replace(message.text().into());
    }

    /// The last messages when the session has ended.
    fn finish(&mut self, session: &mut Session) {
        for event in session.events() {
            self.heard(session, &event);
        }
        self.send_status(session);
    }
}

/// Whether the interval has passed; stores the time if so.
fn due(last: &mut Option<Instant>, every: Duration) -> bool {
    let due = last.is_none_or(|t| t.elapsed() >= every);
    if due {
        *last = Some(Instant::now());
    }
    due
}

impl Face for PageFace {
    fn heard(&mut self, _: &Session, event: &Event) {
        let pose_ms = match event {
            Event::Said(said) => said.pose.and_then(|pose| self.hub.port.page_ms(pose)),
            Event::Sound(_) => None,
        };
        let _ = self.hub.messages.send(wire::event(event, pose_ms).into());
    }

    fn saw(&mut self, _: &Session, packet: &FramePacket, output: &Result<Output, String>) {
        self.frame_ms = self.hub.port.page_ms(packet.stamp);
        if self.hub.pictures_wanted.load(Ordering::Relaxed) == 0 || !due(&mut self.picture, PICTURE_EVERY) {
            return;
        }
        if let Some(image) = packet.images.first() {
            let features = output.as_ref().map_or(&[][..], |o| &o.frame.raw);
            self.hub.picture.send_replace(wire::preview(image, features).into());
        }
    }

    fn did(&mut self, _: &Session, command: &Command, done: &Result<String, String>) {
        // A page that sets how it is spoken to, as it does whenever it connects, needs no answer.
        if matches!(command, Command::Set(_)) {
            return;
        }
        let (ok, text) = match done {
            Ok(text) => (true, text),
            Err(text) => (false, text),
        };
        self.hub.broadcast(&ToPage::Did { ok, text });
        // The map on the screens is updated at once.
        self.view = None;
    }

    fn passed(&mut self, session: &Session) {
        if due(&mut self.status, STATUS_EVERY) {
            self.send_status(session);
        }
        if self.hub.maps_wanted.load(Ordering::Relaxed) > 0 && due(&mut self.view, VIEW_EVERY) {
            self.hub.view.send_replace(ToPage::View(&session.view(MOST_POINTS)).text().into());
        }
    }
}
