//! Mapping and closing on one thread, as a journal tells that threads did: each frame sees the version of the map that it
//! saw then.
//!
//! When a frame needs a version that is not there yet, what mapping did next is done again until it is. Closing's jobs
//! are done as soon as they are given, which is before anyone asks for what came of them; their changes wait until the
//! journal says that they were committed.

use super::inline::Inline;
use super::threaded::{Job, commit};
use super::{Done, take, text_of};
use crate::journal::{FrameRecord, JobRecord, Journal, Record};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_mapping::Closed;
use cairn_sensor::Stamp;
use cairn_tracking::KeyFrameRequest;
use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

/// How far a replay has come.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Replayed {
    /// Frames whose state and pose are the same, bit for bit.
    pub equal: usize,
    /// Frames in the journal.
    pub of: usize,
    /// Whether the map at the end was compared too, and was the same.
    pub map_equal: bool,
    /// Why it goes no further, if so.
    pub stopped: Option<Stopped>,
}

/// Why a replay goes no further.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stopped {
    /// The journal ends here, before the run did; in words.
    Cut(String),
    /// Something came out otherwise than in the journal.
    Differs {
        /// At this frame; none when it was after the last.
        stamp: Option<Stamp>,
        /// What.
        what: String,
    },
}

/// What the keeper of the map did.
#[derive(Clone, Copy)]
enum Kept {
    KeyFrameRequest(Option<u64>),
    Closed(u64),
}

/// What tracking has given mapping that is not worked off yet.
enum Given {
    Seen(Vec<(LandmarkId, bool)>),
    KeyFrameRequest(Box<KeyFrameRequest>),
}

/// The stages with the journal that drives them.
pub(crate) struct Replay {
    pub stages: Inline,
    /// The map that was handed out last.
    pub current: Arc<Snapshot>,
    pub told: Replayed,
    frames: VecDeque<FrameRecord>,
    kept: VecDeque<Kept>,
    jobs: BTreeMap<u64, JobRecord>,
    end: Option<(u64, u64)>,
    cut: Option<String>,
    /// What came last of an offer that was worked off.
    answer: Option<KeyFrameId>,
    given: VecDeque<Given>,
    closed: VecDeque<(u64, Arc<Snapshot>, Closed)>,
    /// Every version that a frame may still ask for.
    versions: VecDeque<Arc<Snapshot>>,
    asked: u64,
}

impl Replay {
    pub fn new(mut stages: Inline, journal: Journal) -> Self {
        stages.atlas.keep_versions();
        let (mut frames, mut kept) = (VecDeque::new(), VecDeque::new());
        let (mut jobs, mut end) = (BTreeMap::new(), None);
        for record in journal.records {
            match record {
                Record::Frame(frame) => frames.push_back(frame),
                Record::KeyFrameRequest { stop_after } => kept.push_back(Kept::KeyFrameRequest(stop_after)),
                Record::Closed { job } => kept.push_back(Kept::Closed(job)),
                Record::Job(job) => {
                    jobs.insert(job.number, job);
                }
                Record::End { version, digest } => end = Some((version, digest)),
            }
        }
        Self {
            current: stages.atlas.latest().clone(),
            told: Replayed { of: frames.len(), ..Replayed::default() },
            stages,
            frames,
            kept,
            jobs,
            end,
            cut: journal.cut,
            answer: None,
            given: VecDeque::new(),
            closed: VecDeque::new(),
            versions: VecDeque::new(),
            asked: 0,
        }
    }

    pub fn look(&mut self, stamp: Stamp, done: &mut Done) -> (Arc<Snapshot>, bool) {
        let idle = match self.frames.front().copied() {
            Some(frame) if frame.stamp == stamp => {
                self.reach(frame.version, done);
                frame.idle
            }
            Some(_) => {
                self.stop("the journal has another frame here");
                true
            }
            None => {
                self.stop("the journal has no frame here");
                true
            }
        };
        (self.current.clone(), idle)
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        self.given.push_back(Given::Seen(seen));
    }

    pub fn submit(&mut self, request: KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        let starting = !matches!(request, KeyFrameRequest::Next { .. });
        self.given.push_back(Given::KeyFrameRequest(Box::new(request)));
        self.answer = None;
        // A start was waited for. Where nothing more was kept, mapping had died and nobody answered.
        let open = |given: &VecDeque<Given>| given.iter().any(|g| matches!(g, Given::KeyFrameRequest(_)));
        while starting && open(&self.given) && self.go_on(done) {}
        self.answer.filter(|_| starting && !open(&self.given))
    }

    pub fn after_start(&mut self, done: &mut Done) -> Arc<Snapshot> {
        match self.frames.front().and_then(|frame| frame.map_created) {
            Some(version) => self.reach(version, done),
            None => self.stop("the journal knows of no start here"),
        }
        self.current.clone()
    }

    /// Compares a frame with the journal's.
    pub fn compare(&mut self, frame: &FrameRecord) {
        let Some(theirs) = self.frames.front().filter(|_| self.told.stopped.is_none()) else { return };
        if theirs == frame {
            self.told.equal += 1;
            self.frames.pop_front();
        } else {
            self.stop("state or pose differ from the journal");
        }
    }

    /// Works off what is left and settles the map as the run did.
    pub fn finish(&mut self, done: &mut Done) {
        while self.told.stopped.is_none() && self.go_on(done) {}
        if self.told.stopped.is_none() && self.end.is_some() && self.frames.is_empty() {
            self.stages.final_adjustment(done);
            self.current = self.stages.atlas.latest().clone();
        }
    }

    /// Compares the map that the run ended with.
    pub fn compare_end(&mut self, version: u64, digest: u64) {
        match self.end {
            _ if !self.frames.is_empty() => {
                self.stop("the source has no such frame, or was not played to its end")
            }
            Some(end) if end == (version, digest) => self.told.map_equal = self.told.stopped.is_none(),
            _ => self.stop("the map at the end differs"),
        }
    }

    /// Notes why it ends here; the first reason counts.
    fn stop(&mut self, what: &str) {
        if self.told.stopped.is_some() {
            return;
        }
        let stamp = self.frames.front().map(|frame| frame.stamp);
        self.told.stopped = Some(match &self.cut {
            // All that is there was the same.
            Some(cut) if stamp.is_none() => Stopped::Cut(cut.clone()),
            _ => Stopped::Differs { stamp, what: what.to_owned() },
        });
    }

    /// Hands out a version of the map, which must be the one that was handed out last or a later one.
    fn reach(&mut self, version: u64, done: &mut Done) {
        while self.stages.atlas.latest().version() < version && self.told.stopped.is_none() {
            if self.go_on(done) {
                continue;
            }
            match self.cut.clone() {
                Some(cut) if self.kept.is_empty() => {
                    self.told.stopped.get_or_insert(Stopped::Cut(cut));
                }
                _ => self.stop("the map has fewer versions than in the journal"),
            }
        }
        self.keep();
        while self.versions.front().is_some_and(|snapshot| snapshot.version() < version) {
            self.versions.pop_front();
        }
        match self.versions.front() {
            Some(snapshot) if snapshot.version() == version => self.current = snapshot.clone(),
            _ => self.stop("the map does not have the version that is in the journal"),
        }
    }

    fn keep(&mut self) {
        self.versions.extend(self.stages.atlas.kept());
    }

    /// Does again what the keeper of the map did next; false when there is nothing more.
    fn go_on(&mut self, done: &mut Done) -> bool {
        let Some(kept) = self.kept.pop_front().filter(|_| self.told.stopped.is_none()) else { return false };
        match kept {
            Kept::KeyFrameRequest(stop_after) => self.take_request(stop_after, done),
            Kept::Closed(number) => match self.closed.pop_front().filter(|(n, ..)| *n == number) {
                Some((_, base, closed)) => {
                    if let Some(whole) = commit(&mut self.stages.atlas, &base, closed) {
                        self.close(whole, done);
                    }
                }
                None => self.stop("closing made other changes than in the journal"),
            },
        }
        self.keep();
        true
    }

    /// Maps the next offer; mapping is told to stop when it was told then.
    fn take_request(&mut self, stop_after: Option<u64>, done: &mut Done) {
        let request = loop {
            match self.given.pop_front() {
                Some(Given::Seen(seen)) => self.stages.mapper.note(&seen),
                Some(Given::KeyFrameRequest(request)) => break request,
                None => return self.stop("mapping took a key frame that tracking has not offered"),
            }
        };
        let start = Instant::now();
        let mut asked = 0;
        let stop = || {
            asked += 1;
            stop_after.is_some_and(|n| asked > n)
        };
        let Inline { mapper, atlas, .. } = &mut self.stages;
        let taken = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, &request, stop)));
        let id = taken.map(|(id, attempt)| {
            done.attempt = attempt.or(done.attempt.take());
            id
        });
        done.ms.push(start.elapsed().as_secs_f64() * 1e3);
        self.answer = id.unwrap_or_else(|cause| {
            done.died = Some(text_of(&cause));
            None
        });
        if let Some(id) = self.answer {
            self.close(Job::Place(self.stages.atlas.latest().clone(), id), done);
        }
    }

    /// Gives closing a job, which it does at once if it did it then.
    fn close(&mut self, job: Job, done: &mut Done) {
        let number = self.asked;
        self.asked += 1;
        let Some(then) = self.jobs.remove(&number) else { return };
        if job.record(number) != then {
            return self.stop("closing was given another key frame than in the journal");
        }
        let start = Instant::now();
        let worked = catch_unwind(AssertUnwindSafe(|| job.work(&mut self.stages.closer)));
        done.close_ms.push(start.elapsed().as_secs_f64() * 1e3);
        match worked {
            Ok((snapshot, mut closed)) => {
                done.verdicts.append(&mut closed.verdicts);
                if !closed.changes.is_empty() {
                    self.closed.push_back((number, snapshot, closed));
                }
            }
            Err(cause) => done.died = Some(text_of(&cause).replace("mapping", "closing")),
        }
    }
}
