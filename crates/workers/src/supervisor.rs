//! The supervisor: starts the processes of a run, carries their messages, and starts again what died or hangs.
//!
//! It does no work of its own and touches no image, so that nothing of what the workers stumble over reaches it. What it
//! keeps is what must survive a worker: the frames that are not acknowledged yet, the poses so far, what is known of the
//! source. It has one thread, and sees everything as one queue of events.

mod deaths;

use crate::capture::SLOTS;
use crate::message::{Failure, Finished, Frame, LeftOut, Opened, Order, Report, Tracked};
use crate::process::{Event, EventKind, Process};
use crate::run_folder::RunFolder;
use crate::slam::FINAL_MAP;
use crate::supervision::{Death, RunEvent, Supervised, Supervision};
use crate::surfaces::Surfaces;
use crate::worker::Worker;
use crate::{Role, SuperviseError};
use cairn_atlas::store::MapFile;
use cairn_session::NotSaved;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// The queue of events is left at least so often.
const TICK: Duration = Duration::from_millis(20);
/// Frames that SLAM has in hand at most: few, so that a ping is answered soon.
const IN_HAND: usize = 4;

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
        poses_come: true,
        opened: None,
        pending: VecDeque::new(),
        sent: 0,
        next: 0,
        first_stamp: None,
        last_stamp: None,
        fresh_from: 0,
        credit: u64::from(SLOTS),
        log: BTreeMap::new(),
        source_ended: false,
        left_out: LeftOut::default(),
        left_out_before: LeftOut::default(),
        finished: None,
        recorded: None,
        guide_waits: how.records,
        guide_given_up: false,
        surfaces: Surfaces::new(how.surfaces.is_some()),
        finished_at: None,
        deaths: Vec::new(),
        died_at: (u64::MAX, 0),
        recovering: None,
        relocalised: Vec::new(),
    };
    run.start(Role::Capture)?;
    run.go(&events, stop)?;
    run.end()
}

/// SLAM since its last death, until it has a pose.
struct Recovering {
    died: Instant,
    resumed: Option<Instant>,
    frames: usize,
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
    /// Poses of frames before this one are old: capture has died since.
    fresh_from: u64,
    /// What the guide was told last.
    poses_come: bool,
    opened: Option<Opened>,
    /// Frames that SLAM has not acknowledged, oldest first; the first `sent` were given to its process.
    pending: VecDeque<Frame>,
    sent: usize,
    /// The number of the next frame of capture, and the stamps of the first and the last.
    next: u64,
    first_stamp: Option<i64>,
    last_stamp: Option<i64>,
    credit: u64,
    log: BTreeMap<u64, Tracked>,
    source_ended: bool,
    /// By this process of capture, and by those before it.
    left_out: LeftOut,
    left_out_before: LeftOut,
    finished: Option<Finished>,
    recorded: Option<Result<usize, NotSaved>>,
    /// A guide that records has not said yet what it has: frames are kept for it.
    guide_waits: bool,
    guide_given_up: bool,
    surfaces: Surfaces,
    /// When SLAM had finished.
    finished_at: Option<Instant>,
    deaths: Vec<Death>,
    /// The frame at which SLAM died last, and how often.
    died_at: (u64, usize),
    recovering: Option<Recovering>,
    relocalised: Vec<(usize, f64)>,
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
            if stop.load(Ordering::Relaxed) && !self.source_ended {
                self.source_ended = true;
                self.capture.process = None;
                self.pending.truncate(self.sent);
                if self.opened.is_none() {
                    return Err(SuperviseError::Interrupted);
                }
            }
            self.pump();
        }
        Ok(())
    }

    fn is_recording(&self) -> bool {
        self.how.records && self.recorded.is_none() && !self.guide_given_up
    }

    /// Whether a process of this role has begun its work in this run.
    fn has_begun(&mut self, role: Role) -> bool {
        self.worker(role).ready || self.deaths.iter().any(|death| death.role == role)
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
        if self.poses_come != lives {
            self.poses_come = lives;
            self.guide.order(Order::PosesCome(lives));
        }
    }

    fn start(&mut self, role: Role) -> Result<(), SuperviseError> {
        self.starts += 1;
        let (start, to) = (self.starts, self.to.clone());
        let first = match role {
            Role::Capture => Order::Capture {
                ring: self.folder.ring(),
                next: self.next,
                delivered: self.first_stamp.zip(self.last_stamp),
                until: self.credit,
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
                began: self.first_stamp,
                again: self.guide.start > 0,
            },
        };
        let process = Process::start((self.how.command)(role), role, start, to)
            .map_err(|e| SuperviseError::Start { role, why: e.to_string() })?;
        process.order(first);
        if role == Role::Guide {
            self.guide_waits = self.how.records;
            process.order(Order::PosesCome(self.poses_come));
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
                self.first_stamp.get_or_insert(frame.stamp);
                (self.next, self.last_stamp) = (frame.number + 1, Some(frame.stamp));
                self.pending.push_back(frame);
            }
            Report::LeftOut(left_out) => self.left_out = left_out,
            Report::SourceEnded => {
                self.source_ended = true;
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
                if let Some(r) = &mut self.recovering {
                    r.resumed = Some(Instant::now());
                    (self.tell)(RunEvent::Resumed { key_frames, after_s: r.died.elapsed().as_secs_f64() });
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
                self.recorded = Some(recorded);
                self.guide.process = None;
            }
            Report::Said(said) => (self.tell)(RunEvent::Said(&said)),
            Report::Followed => self.dense.progress = true,
            Report::NoSurfaces(why) => self.end_surfaces(Err(why)),
            Report::Finished(_) if role == Role::Dense => self.end_surfaces(Ok(())),
            Report::Finished(finished) => {
                self.finished = Some(finished);
                self.finished_at = Some(Instant::now());
                self.slam.process = None;
            }
            // What was done until now is worth more than the surface.
            Report::Failed(why) if role == Role::Dense && self.has_begun(role) => self.end_surfaces(Err(why)),
            Report::Failed(why) => return Err(why.into()),
        }
        Ok(())
    }

    fn tracked(&mut self, tracked: Tracked) {
        while self.pending.front().is_some_and(|f| f.number <= tracked.number) {
            self.pending.pop_front();
            self.sent = self.sent.saturating_sub(1);
        }
        self.slam.progress = true;
        self.slam.backoff.calm();
        if let Some(r) = &mut self.recovering {
            if tracked.pose.is_some() {
                let (after_s, since) = (r.died.elapsed().as_secs_f64(), r.resumed.unwrap_or(r.died));
                let (frames, resumed_s) = (r.frames, since.elapsed().as_secs_f64());
                (self.tell)(RunEvent::Relocalised { frames, after_s, resumed_s });
                self.relocalised.push((frames, after_s));
                self.recovering = None;
            } else {
                r.frames += 1;
            }
        }
        if self.how.guide {
            if tracked.number >= self.fresh_from {
                self.poses_come(true);
            }
            if !self.guide_waits {
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
        self.guide_waits = false;
    }

    /// Gives frames to SLAM and credit to capture, and says when there are no more.
    fn pump(&mut self) {
        if self.slam.ready {
            while self.sent < self.pending.len().min(IN_HAND) {
                self.slam.order(Order::Frame(self.pending[self.sent].clone()));
                self.sent += 1;
            }
            if self.source_ended && self.pending.is_empty() && !self.slam.ending {
                self.slam.ending = true;
                self.slam.order(Order::End);
            }
        }
        // Its end may take minutes, so that one that hangs is to be found out before.
        let answers = self.finished_at.is_some_and(|at| self.dense.has_answered_since(at));
        if answers && self.dense.ready && !self.dense.ending {
            self.dense.ending = true;
            // One that dies at its end again and again is in a crash loop, whatever it did before.
            self.dense.progress = false;
            self.dense.order(Order::End);
        }
        let has_all = self.source_ended && self.pending.is_empty() && !self.guide_waits;
        if self.is_recording() && has_all && self.guide.ready && !self.guide.ending {
            self.guide.ending = true;
            self.guide.order(Order::End);
        }
        // No frame is written over that is not acknowledged.
        let oldest = self.pending.front().map_or(self.next, |f| f.number);
        let credit = oldest + u64::from(SLOTS);
        if credit > self.credit {
            self.credit = credit;
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
            finished: self.finished.unwrap_or_default(),
            left_out: self.left_out_before.and(&self.left_out),
            recorded: self.recorded,
            surfaces: self.surfaces.outcome(),
            deaths: self.deaths,
            relocalised: self.relocalised,
        })
    }
}
