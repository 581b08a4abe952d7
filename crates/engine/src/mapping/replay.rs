//! Replay of a journal: mapping and closing on one thread, with the timing decisions of the recorded run, so
//! that each frame sees the same map version as then.
//!
//! When a frame needs a version that does not exist yet, the recorded steps of the mapping thread are
//! executed until it does. Closing jobs run as soon as they are queued, before their results are needed;
//! their changes wait until the journal says that they were committed.

use super::done::Done;
use super::inline::Inline;
use super::threaded::{Job, commit};
use super::work::{take, text_of};
use crate::journal::{FrameRecord, JobRecord, Journal, Record};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_mapping::Closed;
use cairn_sensor::Stamp;
use cairn_tracking::KeyFrameRequest;
use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// Progress of a replay.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Replayed {
    /// Frames whose state and pose are equal, bit for bit.
    pub equal: usize,
    /// Frames in the journal.
    pub of: usize,
    /// Whether the final map was compared too, and was equal.
    pub map_equal: bool,
    /// Why the replay stopped, if it did.
    pub stopped: Option<Stopped>,
}

/// Why a replay stopped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stopped {
    /// The journal ends here, before the run did, for this reason.
    Cut(String),
    /// A result differs from the journal.
    Differs {
        /// The frame; `None` after the last one.
        stamp: Option<Stamp>,
        /// What differs.
        what: String,
    },
}

/// A recorded step of the mapping thread.
#[derive(Clone, Copy)]
enum Step {
    KeyFrameRequest(Option<u64>),
    Closed(u64),
}

/// Input from tracking that mapping has not processed yet.
enum Input {
    Visibility(Vec<(LandmarkId, bool)>),
    KeyFrameRequest(Box<KeyFrameRequest>),
}

/// The stages with the journal that controls them.
pub(crate) struct Replay {
    pub stages: Inline,
    /// The snapshot that was handed out last.
    pub current: Arc<Snapshot>,
    pub progress: Replayed,
    frames: VecDeque<FrameRecord>,
    steps: VecDeque<Step>,
    jobs: BTreeMap<u64, JobRecord>,
    end: Option<(u64, u64)>,
    cut: Option<String>,
    /// The key frame of the last request that was processed.
    answer: Option<KeyFrameId>,
    inputs: VecDeque<Input>,
    closed: VecDeque<(u64, Arc<Snapshot>, Closed)>,
    /// Every version that a frame may still need.
    versions: VecDeque<Arc<Snapshot>>,
    asked: u64,
}

impl Replay {
    pub fn new(mut stages: Inline, journal: Journal) -> Self {
        stages.atlas.keep_versions();
        let (mut frames, mut steps) = (VecDeque::new(), VecDeque::new());
        let (mut jobs, mut end) = (BTreeMap::new(), None);
        for record in journal.records {
            match record {
                Record::Frame(frame) => frames.push_back(frame),
                Record::KeyFrameRequest { stop_after } => steps.push_back(Step::KeyFrameRequest(stop_after)),
                Record::Closed { job } => steps.push_back(Step::Closed(job)),
                Record::Job(job) => {
                    jobs.insert(job.number, job);
                }
                Record::End { version, digest } => end = Some((version, digest)),
            }
        }
        Self {
            current: stages.atlas.latest().clone(),
            progress: Replayed { of: frames.len(), ..Replayed::default() },
            stages,
            frames,
            steps,
            jobs,
            end,
            cut: journal.cut,
            answer: None,
            inputs: VecDeque::new(),
            closed: VecDeque::new(),
            versions: VecDeque::new(),
            asked: 0,
        }
    }

    pub fn snapshot_for(&mut self, stamp: Stamp, done: &mut Done) -> (Arc<Snapshot>, bool) {
        let idle = match self.frames.front().copied() {
            Some(frame) if frame.stamp == stamp => {
                self.advance_to(frame.version, done);
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
        self.inputs.push_back(Input::Visibility(seen));
    }

    pub fn submit(&mut self, request: KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        let starting = !matches!(request, KeyFrameRequest::Next { .. });
        self.inputs.push_back(Input::KeyFrameRequest(Box::new(request)));
        self.answer = None;
        // A map start was waited for. Where no step is left, mapping had failed and gave no answer.
        let pending =
            |inputs: &VecDeque<Input>| inputs.iter().any(|input| matches!(input, Input::KeyFrameRequest(_)));
        while starting && pending(&self.inputs) && self.run_next_step(done) {}
        self.answer.filter(|_| starting && !pending(&self.inputs))
    }

    pub fn after_start(&mut self, done: &mut Done) -> Arc<Snapshot> {
        match self.frames.front().and_then(|frame| frame.map_created) {
            Some(version) => self.advance_to(version, done),
            None => self.stop("the journal has no map start here"),
        }
        self.current.clone()
    }

    /// Compares a frame with the journal's.
    pub fn compare(&mut self, frame: &FrameRecord) {
        let Some(theirs) = self.frames.front().filter(|_| self.progress.stopped.is_none()) else { return };
        if theirs == frame {
            self.progress.equal += 1;
            self.frames.pop_front();
        } else {
            self.stop("state or pose differ from the journal");
        }
    }

    /// Executes the remaining steps and the final bundle adjustment as the run did.
    pub fn finish(&mut self, done: &mut Done) {
        while self.progress.stopped.is_none() && self.run_next_step(done) {}
        if self.progress.stopped.is_none() && self.end.is_some() && self.frames.is_empty() {
            self.stages.final_adjustment(done);
            self.current = self.stages.atlas.latest().clone();
        }
    }

    /// Compares the final map.
    pub fn compare_end(&mut self, version: u64, digest: u64) {
        match self.end {
            _ if !self.frames.is_empty() => {
                self.stop("the source has no such frame, or was not played to its end")
            }
            Some(end) if end == (version, digest) => {
                self.progress.map_equal = self.progress.stopped.is_none()
            }
            _ => self.stop("the map at the end differs"),
        }
    }

    /// Records why the replay stops; the first reason counts.
    fn stop(&mut self, what: &str) {
        if self.progress.stopped.is_some() {
            return;
        }
        let stamp = self.frames.front().map(|frame| frame.stamp);
        self.progress.stopped = Some(match &self.cut {
            // Everything up to the end of the journal was equal.
            Some(cut) if stamp.is_none() => Stopped::Cut(cut.clone()),
            _ => Stopped::Differs { stamp, what: what.to_owned() },
        });
    }

    /// Advances to a version of the map, which must be the current one or a later one.
    fn advance_to(&mut self, version: u64, done: &mut Done) {
        while self.stages.atlas.latest().version() < version && self.progress.stopped.is_none() {
            if self.run_next_step(done) {
                continue;
            }
            match self.cut.clone() {
                Some(cut) if self.steps.is_empty() => {
                    self.progress.stopped.get_or_insert(Stopped::Cut(cut));
                }
                _ => self.stop("the map has fewer versions than in the journal"),
            }
        }
        self.collect_versions();
        while self.versions.front().is_some_and(|snapshot| snapshot.version() < version) {
            self.versions.pop_front();
        }
        match self.versions.front() {
            Some(snapshot) if snapshot.version() == version => self.current = snapshot.clone(),
            _ => self.stop("the map does not have the version that is in the journal"),
        }
    }

    fn collect_versions(&mut self) {
        self.versions.extend(self.stages.atlas.kept_versions());
    }

    /// Executes the next recorded step of the mapping thread; false when there is none.
    fn run_next_step(&mut self, done: &mut Done) -> bool {
        let Some(step) = self.steps.pop_front().filter(|_| self.progress.stopped.is_none()) else {
            return false;
        };
        match step {
            Step::KeyFrameRequest(stop_after) => self.take_request(stop_after, done),
            Step::Closed(number) => match self.closed.pop_front().filter(|(n, ..)| *n == number) {
                Some((_, base, closed)) => {
                    if let Some(whole) = commit(&mut self.stages.atlas, &base, closed) {
                        self.close(whole, done);
                    }
                }
                None => self.stop("closing made other changes than in the journal"),
            },
        }
        self.collect_versions();
        true
    }

    /// Processes the next request; mapping is told to stop at the same point as in the run.
    fn take_request(&mut self, stop_after: Option<u64>, done: &mut Done) {
        let request = loop {
            match self.inputs.pop_front() {
                Some(Input::Visibility(seen)) => self.stages.mapper.note(&seen),
                Some(Input::KeyFrameRequest(request)) => break request,
                None => return self.stop("mapping took a key frame that tracking did not request"),
            }
        };
        let start = self.stages.clock.now();
        let mut asked = 0;
        let stop = || {
            asked += 1;
            stop_after.is_some_and(|n| asked > n)
        };
        let Inline { mapper, atlas, .. } = &mut self.stages;
        let outcome = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, &request, stop)));
        let id = outcome.map(|taken| done.taken(taken));
        done.ms.push(self.stages.clock.ms_since(start));
        self.answer = id.unwrap_or_else(|cause| {
            done.stage_failed = Some(text_of(&cause));
            None
        });
        if let Some(id) = self.answer {
            self.close(Job::Place(self.stages.atlas.latest().clone(), id), done);
        }
    }

    /// Runs a closing job now, if closing ran it in the recorded run.
    fn close(&mut self, job: Job, done: &mut Done) {
        let number = self.asked;
        self.asked += 1;
        let Some(recorded) = self.jobs.remove(&number) else { return };
        if job.record(number) != recorded {
            return self.stop("closing was given another key frame than in the journal");
        }
        let start = self.stages.clock.now();
        let outcome = catch_unwind(AssertUnwindSafe(|| job.work(&mut self.stages.closer, &self.stages.stop)));
        done.close_ms.push(self.stages.clock.ms_since(start));
        match outcome {
            Ok((snapshot, mut closed)) => {
                done.verdicts.append(&mut closed.verdicts);
                if !closed.changes.is_empty() {
                    self.closed.push_back((number, snapshot, closed));
                }
            }
            Err(cause) => done.stage_failed = Some(text_of(&cause).replace("mapping", "closing")),
        }
    }
}
