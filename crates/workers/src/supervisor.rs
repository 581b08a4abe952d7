//! The supervisor: starts the processes of a run, carries their messages, and starts again what died or hangs.
//!
//! It does no work of its own and touches no image, so that nothing of what the workers stumble over reaches it. What it
//! keeps is what must survive a worker: the frames that are not acknowledged yet, the poses so far, what is known of the
//! source. It has one thread, and sees everything as one queue of events.

mod deaths;
mod frames;

use crate::message::{Failure, Finished, Opened, Order, Report, Tracked};
use crate::process::{Event, EventKind, Process};
use crate::run_folder::RunFolder;
use crate::slam::FINAL_MAP;
use crate::supervision::{RunEvent, Supervised, Supervision};
use crate::surfaces::Surfaces;
use crate::worker::Worker;
use crate::{Role, SuperviseError};
use cairn_atlas::store::MapFile;
use cairn_session::NotSaved;
use deaths::Deaths;
use frames::Frames;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// The queue of events is left at least so often.
const TICK: Duration = Duration::from_millis(20);

/// Supervises a run in its folder until the source has ended or `stop` is set, and the map is finished.
///
/// # Errors
/// [`SuperviseError`] when a worker says that it cannot go on, dies again and again, or there is no map in the end.
pub fn supervise(
    how: &Supervision,
    folder: &RunFolder,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(RunEvent),
) -> Result<Supervised, SuperviseError> {
    let (to, events) = channel();
    let mut run = Run {
        how,
        folder,
        tell,
        to,
        began: Instant::now(),
        starts: 0,
        capture: Worker::new(),
        slam: Worker::new(),
        dense: Worker::new(),
        guide: Worker::new(),
        listener: Listener { poses_come: true, waits: how.records, ..Listener::default() },
        opened: None,
        frames: Frames::new(),
        log: BTreeMap::new(),
        finished: None,
        surfaces: Surfaces::new(how.surfaces.is_some()),
        deaths: Deaths::default(),
    };
    run.start(Role::Capture)?;
    run.go(&events, stop)?;
    run.end()
}

struct Run<'a, 't> {
    how: &'a Supervision,
    folder: &'a RunFolder,
    tell: &'t mut dyn FnMut(RunEvent),
    to: Sender<Event>,
    began: Instant,
    starts: u64,
    capture: Worker,
    slam: Worker,
    dense: Worker,
    guide: Worker,
    listener: Listener,
    opened: Option<Opened>,
    frames: Frames,
    log: BTreeMap<u64, Tracked>,
    /// What SLAM had done when it had finished, and when that was.
    finished: Option<(Finished, Instant)>,
    surfaces: Surfaces,
    deaths: Deaths,
}

/// The guide as a listener to poses.
#[derive(Default)]
struct Listener {
    /// What it was told last: whether poses come.
    poses_come: bool,
    /// Poses of frames before this one are old: capture has died since.
    fresh_from: u64,
    /// It records, and has not said yet what it has: frames are kept for it.
    waits: bool,
    given_up: bool,
    recorded: Option<Result<usize, NotSaved>>,
}

impl Run<'_, '_> {
    fn go(&mut self, events: &Receiver<Event>, stop: &AtomicBool) -> Result<(), SuperviseError> {
        let mut looked = Instant::now();
        while self.finished.is_none() || self.is_recording() || self.surfaces.grow() {
            match events.recv_timeout(TICK) {
                Ok(event) => self.event(event)?,
                Err(RecvTimeoutError::Timeout) => {}
                // The queue has a sender here.
                Err(RecvTimeoutError::Disconnected) => break,
            }
            // A supervisor that was stopped itself must not take its workers for hanging.
            let was_away = looked.elapsed() > Duration::from_secs(1);
            looked = Instant::now();
            for role in [Role::Capture, Role::Slam, Role::Dense, Role::Guide] {
                if was_away {
                    self.worker(role).heard = looked;
                }
                self.look_after(role)?;
            }
            if stop.load(Ordering::Relaxed) && !self.frames.have_ended {
                self.frames.stop();
                self.capture.process = None;
                if self.opened.is_none() {
                    return Err(SuperviseError::Interrupted);
                }
            }
            self.pump();
        }
        Ok(())
    }

    fn is_recording(&self) -> bool {
        self.how.records && self.listener.recorded.is_none() && !self.listener.given_up
    }

    /// Whether a process of this role has begun its work in this run.
    fn has_begun(&mut self, role: Role) -> bool {
        self.worker(role).ready || self.deaths.all.iter().any(|death| death.role == role)
    }

    /// Surfaces are written, or will not be.
    fn end_surfaces(&mut self, how: Result<(), Failure>) {
        self.surfaces.end(how);
        self.dense.process = None;
    }

    fn worker(&mut self, role: Role) -> &mut Worker {
        match role {
            Role::Capture => &mut self.capture,
            Role::Slam => &mut self.slam,
            Role::Dense => &mut self.dense,
            // A walk has a supervisor of its own (`respawn`): nothing of it is here.
            Role::Guide | Role::Walk => &mut self.guide,
        }
    }

    /// Tells the guide whether poses come.
    fn poses_come(&mut self, lives: bool) {
        if self.listener.poses_come != lives {
            self.listener.poses_come = lives;
            self.guide.order(Order::PosesCome(lives));
        }
    }

    fn start(&mut self, role: Role) -> Result<(), SuperviseError> {
        self.starts += 1;
        let (start, to) = (self.starts, self.to.clone());
        let first = match role {
            Role::Capture => Order::Capture {
                ring: self.folder.ring(),
                next: self.frames.next,
                delivered: self.frames.delivered,
                until: self.frames.credit,
            },
            Role::Slam | Role::Dense => {
                let Some(opened) = self.opened.clone() else { return Ok(()) };
                Order::Map {
                    ring: self.folder.ring(),
                    folder: self.folder.path().to_owned(),
                    opened,
                    start,
                    surfaces: self.how.surfaces,
                    session: None,
                }
            }
            Role::Walk => return Ok(()),
            Role::Guide => Order::Guide {
                folder: self.folder.path().to_owned(),
                began: self.frames.delivered.map(|(first, _)| first),
                again: self.guide.start > 0,
            },
        };
        let process = Process::start((self.how.command)(role), role, start, to)
            .map_err(|e| SuperviseError::Start { role, why: e.to_string() })?;
        process.order(first);
        if role == Role::Guide {
            self.listener.waits = self.how.records;
            process.order(Order::PosesCome(self.listener.poses_come));
        }
        (self.tell)(RunEvent::Started { role, id: process.id() });
        self.worker(role).started(process, start);
        Ok(())
    }

    fn event(&mut self, event: Event) -> Result<(), SuperviseError> {
        let worker = self.worker(event.role);
        // What a process said before it was killed is late, but true; its end is known.
        let is_current = worker.start == event.start && worker.process.is_some();
        match event.kind {
            EventKind::Said(report) => {
                if is_current {
                    worker.heard = Instant::now();
                    self.report(event.role, report)?;
                }
            }
            EventKind::Closed(why) if is_current => self.died(event.role, why)?,
            EventKind::Closed(_) => {}
        }
        Ok(())
    }

    fn report(&mut self, role: Role, report: Report) -> Result<(), SuperviseError> {
        match report {
            Report::Opened(opened) => {
                self.capture.ready = true;
                if self.opened.is_none() {
                    (self.tell)(RunEvent::Opened(&opened));
                    self.opened = Some(opened);
                    self.start(Role::Slam)?;
                    if self.how.surfaces.is_some() {
                        self.start(Role::Dense)?;
                    }
                    if self.how.guide {
                        self.start(Role::Guide)?;
                    }
                }
            }
            Report::Frame(frame) => {
                self.capture.progress = true;
                self.frames.add(frame);
            }
            Report::LeftOut(left_out) => self.frames.leaves_out(left_out),
            Report::SourceEnded => {
                self.frames.have_ended = true;
                self.capture.process = None;
            }
            Report::Ready { .. } if role == Role::Guide => self.guide.ready = true,
            Report::Ready { key_frames, .. } if role == Role::Dense => {
                self.dense.ready = true;
                if let Some(after_s) = self.surfaces.process_began() {
                    (self.tell)(RunEvent::DenseResumed { key_frames, after_s });
                }
            }
            Report::Ready { key_frames, .. } => {
                self.slam.ready = true;
                if let Some(after_s) = self.deaths.resumed() {
                    (self.tell)(RunEvent::Resumed { key_frames, after_s });
                }
            }
            Report::Tracked(tracked) => self.tracked(*tracked),
            Report::Amended { number, pose } => {
                if let Some(frame) = self.log.get_mut(&number) {
                    frame.pose = Some(pose);
                }
            }
            Report::Pong | Report::Shown(_) => {}
            Report::RecordedUntil(until) => self.missed(until),
            Report::Recorded(recorded) => {
                self.listener.recorded = Some(recorded);
                self.guide.process = None;
            }
            Report::Said(speech) => {
                speech.event().iter().for_each(|event| (self.tell)(RunEvent::Said(event)))
            }
            Report::Followed => self.dense.progress = true,
            Report::NoSurfaces(why) => self.end_surfaces(Err(why)),
            Report::Finished(_) if role == Role::Dense => self.end_surfaces(Ok(())),
            Report::Finished(finished) => {
                self.finished = Some((finished, Instant::now()));
                self.slam.process = None;
            }
            // What was done until now is worth more than the surface.
            Report::Failed(why) if role == Role::Dense && self.has_begun(role) => self.end_surfaces(Err(why)),
            Report::Failed(why) => return Err(why.into()),
        }
        Ok(())
    }

    fn tracked(&mut self, tracked: Tracked) {
        self.frames.done(tracked.number);
        self.slam.progress = true;
        self.slam.backoff.calm();
        if let Some(relocalised) = self.deaths.frame(tracked.pose.is_some()) {
            (self.tell)(relocalised);
        }
        if self.how.guide {
            if tracked.number >= self.listener.fresh_from {
                self.poses_come(true);
            }
            if !self.listener.waits {
                self.guide.progress = true;
                self.guide.order(Order::Tracked(Box::new(tracked.clone())));
            }
        }
        (self.tell)(RunEvent::Tracked(&tracked));
        self.log.insert(tracked.number, tracked);
    }

    /// Gives a guide that records the frames since its last point, that frame too.
    fn missed(&mut self, until: Option<i64>) {
        for tracked in self.log.values().filter(|t| until.is_none_or(|until| t.stamp >= until)) {
            self.guide.order(Order::Missed(Box::new(tracked.clone())));
        }
        self.listener.waits = false;
    }

    /// Gives frames to SLAM and credit to capture, and says when there are no more.
    fn pump(&mut self) {
        if self.slam.ready {
            while let Some(frame) = self.frames.take_next() {
                self.slam.order(Order::Frame(frame));
            }
            if self.frames.are_done() && !self.slam.ending {
                self.slam.ending = true;
                self.slam.order(Order::End);
            }
        }
        // Its end may take minutes, so that one that hangs is to be found out before.
        let answers = self.finished.is_some_and(|(_, at)| self.dense.has_answered_since(at));
        if answers && self.dense.ready && !self.dense.ending {
            self.dense.ending = true;
            // One that dies at its end again and again is in a crash loop, whatever it did before.
            self.dense.progress = false;
            self.dense.order(Order::End);
        }
        let has_all = self.frames.are_done() && !self.listener.waits;
        if self.is_recording() && has_all && self.guide.ready && !self.guide.ending {
            self.guide.ending = true;
            self.guide.order(Order::End);
        }
        if let Some(credit) = self.frames.more_credit() {
            self.capture.order(Order::Credit(credit));
        }
    }

    fn end(self) -> Result<Supervised, SuperviseError> {
        let opened = self.opened.ok_or(SuperviseError::Interrupted)?;
        let map = MapFile::load(&self.folder.path().join(FINAL_MAP))?;
        Ok(Supervised {
            opened,
            frames: self.log.into_values().collect(),
            map,
            finished: self.finished.map(|(finished, _)| finished).unwrap_or_default(),
            left_out: self.frames.left_out(),
            recorded: self.listener.recorded,
            surfaces: self.surfaces.outcome(),
            deaths: self.deaths.all,
            relocalised: self.deaths.relocalised,
        })
    }
}
