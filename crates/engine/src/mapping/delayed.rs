//! Mapping and closing with latencies drawn by a seed: what a loaded machine does to the threaded runner, without its
//! clock, and the same bits each time.
//!
//! Time is counted in frames. A key frame keeps mapping busy for a drawn number of frames, the versions that it commits
//! become visible at drawn instants within them, and some key frames are told to leave out the work that can wait, as
//! if another one had arrived. Closing works on the snapshot of its job, and its changes arrive after a latency of
//! their own, to be rebased onto the map of that time. A request that starts a map is waited for.

use super::done::Done;
use super::inline::Inline;
use super::threaded::{Job, commit};
use super::work::{Input, take, text_of};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_mapping::Closed;
use cairn_random::Random;
use cairn_tracking::KeyFrameRequest;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// The latencies of mapping and closing in [`Runner::Delayed`](super::Runner::Delayed).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delays {
    /// Seed of the latencies.
    pub seed: u64,
    /// Longest time that a key frame keeps mapping busy, frames; closing takes up to 3 times as long.
    pub most_frames: u32,
}

/// Longest latency of closing over that of mapping.
pub const CLOSING_TIMES: u32 = 3;
/// One key frame in so many is told to leave out the work that can wait.
const STOPPED: u32 = 3;
/// It is told so within this many questions.
const QUESTIONS: u32 = 30;

/// The stages with their queues.
pub(crate) struct Delayed {
    pub stages: Inline,
    /// The snapshot that tracking sees.
    pub current: Arc<Snapshot>,
    delays: Delays,
    random: Random,
    /// Frames so far.
    frame: u64,
    inputs: VecDeque<Input>,
    /// The frame at which mapping takes the next message.
    free_at: u64,
    /// Versions that are not visible yet, each with the frame from which on it is.
    versions: VecDeque<(u64, Arc<Snapshot>)>,
    /// Jobs for closing, each with the frame at which it is handed over.
    jobs: VecDeque<(u64, Job)>,
    /// The result that closing has in hand, and the frame at which it delivers it.
    closing: Option<(u64, Arc<Snapshot>, Closed)>,
    /// The key frame of the last request that was processed.
    answer: Option<KeyFrameId>,
}

impl Delayed {
    pub fn new(mut stages: Inline, delays: Delays) -> Self {
        stages.atlas.keep_versions();
        Self {
            current: stages.atlas.latest().clone(),
            stages,
            delays,
            random: Random::new(delays.seed),
            frame: 0,
            inputs: VecDeque::new(),
            free_at: 0,
            versions: VecDeque::new(),
            jobs: VecDeque::new(),
            closing: None,
            answer: None,
        }
    }

    /// Begins a frame: what is done by now has been done. Returns the snapshot for it, and whether a key frame
    /// requested now would be processed at once.
    pub fn snapshot_for(&mut self, done: &mut Done) -> (Arc<Snapshot>, bool) {
        self.frame += 1;
        self.advance(done);
        let waiting = self.inputs.iter().any(|input| matches!(input, Input::KeyFrameRequest(_)));
        (self.current.clone(), !waiting && self.frame >= self.free_at)
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        self.inputs.push_back(Input::Visibility(seen));
    }

    pub fn submit(&mut self, request: KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        let starting = !matches!(request, KeyFrameRequest::Next { .. });
        self.inputs.push_back(Input::KeyFrameRequest(Box::new(request)));
        if !starting {
            self.advance(done);
            return None;
        }
        self.answer = None;
        self.catch_up(done);
        self.answer
    }

    /// Finishes all work and the final bundle adjustment.
    pub fn finish(&mut self, done: &mut Done) {
        self.catch_up(done);
        while !self.jobs.is_empty() || self.closing.is_some() {
            self.frame += 1;
            self.catch_up(done);
        }
        self.stages.final_adjustment(done);
        self.current = self.stages.atlas.latest().clone();
        self.stages.atlas.kept_versions();
    }

    /// Runs mapping's whole queue at once and shows the result.
    fn catch_up(&mut self, done: &mut Done) {
        self.advance(done);
        while !self.inputs.is_empty() {
            self.free_at = self.frame;
            self.advance(done);
        }
        self.free_at = self.frame;
        if let Some((_, latest)) = self.versions.drain(..).next_back() {
            self.current = latest;
        }
    }

    /// Runs what is due at this frame.
    fn advance(&mut self, done: &mut Done) {
        loop {
            self.advance_closing(done);
            if self.frame < self.free_at {
                break;
            }
            match self.inputs.pop_front() {
                Some(Input::Visibility(seen)) => self.stages.mapper.note(&seen),
                Some(Input::KeyFrameRequest(request)) => self.take_request(&request, done),
                Some(Input::Closed(base, closed)) => {
                    let whole = commit(&mut self.stages.atlas, &base, closed);
                    self.show_within(0);
                    self.jobs.extend(whole.map(|job| (self.frame, job)));
                }
                None => break,
            }
        }
        while self.versions.front().is_some_and(|(at, _)| *at <= self.frame) {
            if let Some((_, snapshot)) = self.versions.pop_front() {
                self.current = snapshot;
            }
        }
    }

    /// A number from 0 to `n - 1`.
    fn draw(&mut self, n: u32) -> u32 {
        self.random.below(n as usize) as u32
    }

    /// Processes a request; mapping is busy with it for a drawn number of frames.
    fn take_request(&mut self, request: &KeyFrameRequest, done: &mut Done) {
        let latency = self.draw(self.delays.most_frames + 1);
        let stop_after = (self.draw(STOPPED) == 0).then(|| self.draw(QUESTIONS));
        let mut asked = 0;
        let stop = || {
            asked += 1;
            stop_after.is_some_and(|n| asked > n)
        };
        let start = self.stages.clock.now();
        let Inline { mapper, atlas, .. } = &mut self.stages;
        let outcome = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, request, stop)));
        done.ms.push(self.stages.clock.ms_since(start));
        self.answer = outcome.map(|taken| done.taken(taken)).unwrap_or_else(|cause| {
            done.stage_failed = Some(text_of(&cause));
            None
        });
        self.free_at = self.frame + u64::from(latency);
        self.show_within(latency);
        if let Some(id) = self.answer {
            self.jobs.push_back((self.free_at, Job::Place(self.stages.atlas.latest().clone(), id)));
        }
    }

    /// The versions committed since the last call become visible at drawn frames, the last one after all of them.
    fn show_within(&mut self, latency: u32) {
        let new = self.stages.atlas.kept_versions();
        let mut at: Vec<u32> = new.iter().map(|_| self.draw(latency + 1)).collect();
        at.sort_unstable();
        if let Some(last) = at.last_mut() {
            *last = latency;
        }
        self.versions.extend(at.iter().map(|frames| self.frame + u64::from(*frames)).zip(new));
    }

    /// Closing delivers what is due and begins the newest job.
    fn advance_closing(&mut self, done: &mut Done) {
        if self.closing.as_ref().is_some_and(|(at, ..)| *at <= self.frame)
            && let Some((_, base, closed)) = self.closing.take()
            && !closed.changes.is_empty()
        {
            self.inputs.push_back(Input::Closed(base, closed));
        }
        if self.closing.is_some() {
            return;
        }
        // As on its thread: only the newest place matters.
        let mut next: Option<Job> = None;
        while self.jobs.front().is_some_and(|(at, _)| *at <= self.frame) {
            let Some((_, newer)) = self.jobs.pop_front() else { break };
            if next.as_ref().is_none_or(|job| job.gives_way_to(&newer)) {
                next = Some(newer);
            }
        }
        let Some(job) = next else { return };
        let start = self.stages.clock.now();
        let outcome = catch_unwind(AssertUnwindSafe(|| job.work(&mut self.stages.closer, &self.stages.stop)));
        done.close_ms.push(self.stages.clock.ms_since(start));
        match outcome {
            Ok((snapshot, mut closed)) => {
                done.verdicts.append(&mut closed.verdicts);
                let latency = self.draw(CLOSING_TIMES * self.delays.most_frames + 1);
                self.closing = Some((self.frame + u64::from(latency), snapshot, closed));
            }
            Err(cause) => done.stage_failed = Some(text_of(&cause).replace("mapping", "closing")),
        }
    }
}
