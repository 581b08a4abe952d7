//! Mapping and closing on the thread of tracking, a slice at a time: as on threads, but whoever drives the engine does their work
//! between frames ([`Engine::work`](crate::Engine::work)). Pages in a browser run so, which have one thread for the engine.
//!
//! Key frames are mapped in order. While none waits, closing goes on, and its changes are rebased onto the map of that time.

use super::done::{Done, Taken};
use super::inline::Inline;
use super::threaded::{Job, commit};
use super::work::{Input, take_in_slices, text_of};
use cairn_atlas::{Atlas, KeyFrameId, LandmarkId, Reader, Snapshot, Subscription};
use cairn_mapping::{Closed, Closer, Mapper};
use cairn_sensor::Clock;
use cairn_tracking::KeyFrameRequest;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::task::{Context, Poll, Waker};

/// A stage: at rest, in the middle of a piece of work, or failed.
enum Stage<S, T> {
    Idle(S),
    Busy { work: Pin<Box<dyn Future<Output = (S, T)> + Send>>, ms: f64 },
    Failed,
}

/// What a slice of a stage led to.
enum Slice<T> {
    /// There was nothing to do.
    None,
    /// It is not at its end.
    Some,
    /// A piece of work is done, in so many milliseconds.
    Done(T, f64),
    /// The stage has failed, for this reason.
    Failed(String),
}

impl<S, T> Stage<S, T> {
    /// The next slice of what is in hand.
    fn slice(&mut self, clock: &Clock) -> Slice<T> {
        let Self::Busy { work, ms } = self else { return Slice::None };
        let start = clock.now();
        let mut context = Context::from_waker(Waker::noop());
        let polled = catch_unwind(AssertUnwindSafe(|| work.as_mut().poll(&mut context)));
        *ms += clock.ms_since(start);
        match polled {
            Ok(Poll::Pending) => Slice::Some,
            Ok(Poll::Ready((stage, result))) => {
                let ms = *ms;
                *self = Self::Idle(stage);
                Slice::Done(result, ms)
            }
            Err(cause) => {
                *self = Self::Failed;
                Slice::Failed(text_of(&cause))
            }
        }
    }

    /// Begins a piece of work; only where it is at rest.
    fn begin<W: Future<Output = (S, T)> + Send + 'static>(&mut self, work: impl FnOnce(S) -> W) {
        *self = match std::mem::replace(self, Self::Failed) {
            Self::Idle(stage) => Self::Busy { work: Box::pin(work(stage)), ms: 0.0 },
            other => other,
        };
    }
}

/// The stages with their queues.
pub(crate) struct Sliced {
    pub reader: Reader,
    mapping: Stage<(Mapper, Atlas), Taken>,
    closing: Stage<Closer, (Arc<Snapshot>, Closed)>,
    inputs: VecDeque<Input>,
    /// Key frames that are asked for and not mapped yet, that in hand included.
    waiting: Arc<AtomicUsize>,
    /// The next job of closing: the newest.
    job: Option<Job>,
    done: Done,
    /// The key frame of the last request that was processed.
    answer: Option<KeyFrameId>,
    pub stop: Arc<AtomicBool>,
    clock: Clock,
}

impl Sliced {
    pub fn new(stages: Inline) -> Self {
        let Inline { mapper, closer, atlas, stop, clock } = stages;
        Self {
            reader: atlas.reader(),
            mapping: Stage::Idle((mapper, atlas)),
            closing: Stage::Idle(closer),
            inputs: VecDeque::new(),
            waiting: Arc::default(),
            job: None,
            done: Done::default(),
            answer: None,
            stop,
            clock,
        }
    }

    /// Whether a key frame requested now would be processed at once.
    pub fn idle(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) == 0
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        // Once mapping has failed nobody takes them any more.
        if !matches!(self.mapping, Stage::Failed) {
            self.inputs.push_back(Input::Visibility(seen));
        }
    }

    /// A request that starts a map is done at once, with those before it.
    pub fn submit(&mut self, request: KeyFrameRequest) -> Option<KeyFrameId> {
        let starting = !matches!(request, KeyFrameRequest::Next { .. });
        self.waiting.fetch_add(1, Ordering::Relaxed);
        self.inputs.push_back(Input::KeyFrameRequest(Box::new(request)));
        if !starting {
            return None;
        }
        self.answer = None;
        while self.map() {}
        self.answer
    }

    /// Waits for the work mapping has in hand.
    pub fn subscribe(&mut self) -> Option<Subscription> {
        while self.map() {}
        match &mut self.mapping {
            Stage::Idle((_, atlas)) => Some(atlas.subscribe()),
            _ => None,
        }
    }

    pub fn poll(&mut self, into: &mut Done) {
        into.take(std::mem::take(&mut self.done));
    }

    /// Does the next slice; false when there was nothing to do.
    pub fn work(&mut self) -> bool {
        self.map() || self.close()
    }

    pub fn finish(&mut self, into: &mut Done) {
        while self.work() {}
        let stop = || self.stop.load(Ordering::Relaxed);
        if let Stage::Idle((mapper, atlas)) = &mut self.mapping
            && let Err(cause) = catch_unwind(AssertUnwindSafe(|| mapper.final_adjustment(atlas, stop)))
        {
            self.done.stage_failed = Some(text_of(&cause));
        }
        self.poll(into);
    }

    /// The next slice of mapping.
    fn map(&mut self) -> bool {
        if matches!(self.mapping, Stage::Idle(_)) {
            self.begin_mapping();
        }
        match self.mapping.slice(&self.clock) {
            Slice::None => return false,
            Slice::Some => {}
            Slice::Done(taken, ms) => {
                self.waiting.fetch_sub(1, Ordering::Relaxed);
                self.done.ms.push(ms);
                self.answer = self.done.taken(taken);
                if let Some(id) = self.answer {
                    self.queue(Job::Place(self.reader.latest(), id));
                }
            }
            Slice::Failed(why) => self.done.stage_failed = Some(why),
        }
        true
    }

    /// Takes what waits, up to the next key frame.
    fn begin_mapping(&mut self) {
        while let Some(input) = self.inputs.pop_front() {
            let Stage::Idle((mapper, atlas)) = &mut self.mapping else { return };
            match input {
                Input::Visibility(seen) => mapper.note(&seen),
                Input::Closed(base, closed) => {
                    let whole = commit(atlas, &base, closed);
                    whole.into_iter().for_each(|job| self.queue(job));
                }
                Input::KeyFrameRequest(request) => {
                    let waiting = self.waiting.clone();
                    self.mapping.begin(|(mut mapper, mut atlas)| async move {
                        let stop = || waiting.load(Ordering::Relaxed) > 1;
                        let taken = take_in_slices(&mut mapper, &mut atlas, &request, stop).await;
                        ((mapper, atlas), taken)
                    });
                    return;
                }
            }
        }
    }

    /// The next slice of closing.
    fn close(&mut self) -> bool {
        if matches!(self.closing, Stage::Idle(_))
            && let Some(job) = self.job.take()
        {
            let stop = self.stop.clone();
            self.closing.begin(|mut closer| async move {
                let closed = job.work_in_slices(&mut closer, &stop).await;
                (closer, closed)
            });
        }
        match self.closing.slice(&self.clock) {
            Slice::None => return false,
            Slice::Some => {}
            Slice::Done((base, mut closed), ms) => {
                self.done.close_ms.push(ms);
                self.done.verdicts.append(&mut closed.verdicts);
                if !closed.changes.is_empty() {
                    self.inputs.push_back(Input::Closed(base, closed));
                }
            }
            Slice::Failed(why) => self.done.stage_failed = Some(why.replace("mapping", "closing")),
        }
        true
    }

    fn queue(&mut self, newer: Job) {
        if self.job.as_ref().is_none_or(|job| job.gives_way_to(&newer)) {
            self.job = Some(newer);
        }
    }
}
