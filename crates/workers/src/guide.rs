//! The guide process: poses and the journal of the map in, words out, or the file of a route that is recorded.
//!
//! It is the part that must speak when another has died. Word that what makes the poses is late or dead makes it say "stop" at once; once
//! poses come again it goes on. It keeps nothing: a guide that is started again finds the walker on the route by the next
//! pose.

use crate::journal::Tail;
use crate::message::{Failure, Order, Report, Tracked, first_order, read, write};
use crate::speech::Speech;
use cairn_atlas::Snapshot;
use cairn_guide::{Priority, RecorderConfig, StopReason};
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use cairn_session::{Event, NotSaved, Refused, RouteGuide, RouteRecorder, Said};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What the process does: it guides, or it records.
pub enum Work {
    /// Along a route.
    Guide(Box<RouteGuide>),
    /// A new route.
    Record(RecordTo),
}

/// Where a route is recorded.
pub struct RecordTo {
    /// Its file.
    pub path: PathBuf,
    /// It goes on in that file from the beginning.
    pub exists: bool,
    /// The run begins without a map.
    pub without_map: bool,
    /// A description of the source.
    pub source: String,
    /// The recorder's configuration.
    pub config: RecorderConfig,
    /// The language of what is said of the recording.
    pub language: Language,
}

/// Runs until the supervisor is gone. `open` reads the route. In real time poses grow old while none comes, and the guide
/// says stop by itself.
pub fn run<F>(mut from: impl Read, mut to: impl Write, is_realtime: bool, open: F)
where
    F: FnOnce() -> Result<Work, Failure>,
{
    let Some(Order::Guide { folder, began, again }) = first_order(&mut from, &mut to) else { return };
    let began = began.map(Stamp);
    let said = open().and_then(|work| match work {
        Work::Guide(guide) => {
            let guide = guide.began_at(began);
            let guiding = Guiding { guide, folder, tail: None, last: None, poses_come: true, is_realtime };
            guiding.work(&mut from, &mut to)
        }
        Work::Record(to_file) => {
            let resumes = to_file.exists || again;
            Recording { to: to_file, resumes, recorder: None, folder, tail: None, began }
                .work(&mut from, &mut to)
        }
    });
    if let Err(why) = said {
        // Without a supervisor there is nobody to tell.
        let _ = write(&mut to, &Report::Failed(why));
    }
}

/// Records a route. It keeps nothing: a process that takes its place goes on in the file.
struct Recording {
    to: RecordTo,
    resumes: bool,
    recorder: Option<RouteRecorder>,
    folder: PathBuf,
    tail: Option<Tail>,
    began: Option<Stamp>,
}

impl Recording {
    fn work(mut self, from: &mut impl Read, to: &mut impl Write) -> Result<(), Failure> {
        if self.resumes && self.to.path.exists() {
            let resumed = RouteRecorder::resume(&self.to.path, self.to.config);
            self.recorder = Some(resumed.map_err(|e| self.failed(&e))?);
        }
        let until = self.recorder.as_ref().and_then(RouteRecorder::until).map(|t| t.0);
        let mut reports = vec![Report::Ready { key_frames: 0, version: 0 }, Report::RecordedUntil(until)];
        loop {
            for report in reports.drain(..) {
                if write(to, &report).is_err() {
                    return Ok(());
                }
            }
            match read(from) {
                Ok(Some(Order::Tracked(frame))) => reports.extend(self.tracked(&frame)?),
                Ok(Some(Order::Missed(frame))) => drop(self.tracked(&frame)?),
                Ok(Some(Order::Ping)) => reports.push(Report::Pong),
                Ok(Some(Order::End)) => {
                    reports.push(Report::Recorded(self.finish()));
                }
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return Ok(()),
            }
        }
    }

    /// Ends the recording: how many points it has.
    fn finish(&mut self) -> Result<usize, NotSaved> {
        let Some(recorder) = self.recorder.take() else { return Ok(0) };
        let last = self.tail.as_ref().map(|tail| (tail.map(), tail.file().about.camera));
        recorder.finish(last.as_ref().map(|(map, camera)| (*map, camera)))
    }

    fn tracked(&mut self, frame: &Tracked) -> Result<Option<Report>, Failure> {
        let stamp = Stamp(frame.stamp);
        let began = *self.began.get_or_insert(stamp);
        follow(&mut self.tail, &self.folder)?;
        let Some(tail) = &self.tail else { return Ok(None) };
        let camera = tail.file().about.camera;
        let mut trouble = None;
        let recorder = match &mut self.recorder {
            Some(recorder) => recorder,
            None => {
                // The map in which the run began: what was mapped since says nothing of that.
                let empty = Snapshot::with_octaves(tail.map().octaves());
                let map = if self.to.without_map { &empty } else { tail.map() };
                let begun =
                    RouteRecorder::begin(&self.to.path, map, &camera, &self.to.source, self.to.config);
                trouble = begun.1;
                self.recorder.insert(begun.0)
            }
        };
        if let Some(why) = trouble {
            return Err(self.failed(&why));
        }
        let place = frame.place.as_ref().and_then(|p| p.to_tracked(stamp, frame.metric));
        let words = recorder.tracked(tail.map(), &camera, stamp, place.as_ref());
        Ok(words.map(|id| {
            let language = self.to.language;
            let at = (stamp, stamp - began);
            said(Event::Said(Said::plain(language.text(id), language, Priority::High, at)))
        }))
    }

    fn failed(&self, why: &dyn std::fmt::Display) -> Failure {
        Failure::new(self.to.path.display().to_string(), why, "give another file with --record")
    }
}

struct Guiding {
    guide: RouteGuide,
    folder: PathBuf,
    tail: Option<Tail>,
    /// The last frame, and when its result came.
    last: Option<(Stamp, Instant)>,
    poses_come: bool,
    is_realtime: bool,
}

impl Guiding {
    fn work(mut self, from: &mut impl Read, to: &mut impl Write) -> Result<(), Failure> {
        let mut reports = vec![Report::Ready { key_frames: 0, version: 0 }];
        loop {
            for report in reports.drain(..) {
                if write(to, &report).is_err() {
                    return Ok(());
                }
            }
            match read(from) {
                Ok(Some(Order::Tracked(frame))) => self.tracked(&frame)?,
                Ok(Some(Order::PosesCome(lives))) => {
                    self.poses_come = lives;
                    self.tick()?;
                }
                Ok(Some(Order::Ping)) => {
                    self.tick()?;
                    reports.push(Report::Pong);
                }
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return Ok(()),
            }
            reports.extend(self.guide.events().into_iter().map(said));
        }
    }

    fn tracked(&mut self, frame: &Tracked) -> Result<(), Failure> {
        let stamp = Stamp(frame.stamp);
        self.last = Some((stamp, Instant::now()));
        follow(&mut self.tail, &self.folder)?;
        let Some(tail) = &self.tail else { return Ok(()) };
        // A frame from before capture died is late: no direction is given from it.
        if !self.poses_come {
            return Ok(());
        }
        let place = frame.place.as_ref().and_then(|p| p.to_tracked(stamp, frame.metric));
        self.guide.tracked(tail.map(), stamp, place.as_ref()).map_err(cannot_guide)
    }

    /// Time passes without a frame: while no poses come, each such moment is a reason to stop.
    fn tick(&mut self) -> Result<(), Failure> {
        let (Some((stamp, came)), Some(tail)) = (self.last, &self.tail) else { return Ok(()) };
        let hazard = (!self.poses_come).then_some(StopReason::StageDied);
        if hazard.is_none() && !self.is_realtime {
            return Ok(());
        }
        let now = stamp.plus_seconds(came.elapsed().as_secs_f64());
        self.guide.tick(tail.map(), now, hazard).map_err(cannot_guide)
    }
}

/// Reads what SLAM has written since.
fn follow(tail: &mut Option<Tail>, folder: &Path) -> Result<(), Failure> {
    let failed = |e| Failure::new("the journal of the map", e, "start the run again");
    match tail {
        Some(tail) => tail.follow().map_err(failed),
        None => {
            *tail = Tail::open(folder).map_err(failed)?;
            Ok(())
        }
    }
}

fn cannot_guide(why: Refused) -> Failure {
    Failure::new("the route", why, "give another route with --guide")
}

fn said(event: Event) -> Report {
    Report::Said(Speech::of(event))
}
