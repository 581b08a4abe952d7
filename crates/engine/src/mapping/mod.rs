//! Mapping and closing: inline (lockstep), in slices between frames, with drawn latencies, on their own threads, or replayed from a journal.

mod delayed;
mod done;
mod inline;
mod replay;
mod sliced;
mod threaded;
mod work;

pub use delayed::Delays;
pub use replay::{Replayed, Stopped};

use crate::journal::{FrameRecord, Header, Journal, Record};
use cairn_atlas::{Atlas, KeyFrameId, LandmarkId, Snapshot, Subscription};
use cairn_mapping::{Closer, Mapper};
use cairn_sensor::{Host, Stamp};
use cairn_tracking::KeyFrameRequest;
use delayed::Delayed;
pub(crate) use done::Done;
use inline::Inline;
use replay::Replay;
use sliced::Sliced;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use threaded::Threaded;

/// How the stages run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Runner {
    /// One after the other: bit-identical from run to run, independent of the load of the machine.
    #[default]
    Lockstep,
    /// Mapping and closing on threads that the host gives; tracking never waits for them.
    Threaded,
    /// In slices, which [`Engine::work`](crate::Engine::work) does between frames: for one thread in real time. Bit-identical for the same
    /// slices between the same frames.
    Sliced,
    /// As on threads, with latencies drawn by a seed instead of those of the machine: bit-identical from run to run.
    Delayed(Delays),
}

/// Mapping and closing, in one of its forms.
pub(crate) enum Mapping {
    Inline(Box<Inline>),
    Sliced(Box<Sliced>),
    Delayed(Box<Delayed>),
    Thread(Threaded),
    Replay(Box<Replay>),
}

impl Mapping {
    pub fn new(runner: Runner, mapper: Mapper, closer: Closer, snapshot: Snapshot, host: &Host) -> Self {
        let atlas = Atlas::new(snapshot);
        if runner == Runner::Threaded {
            return Self::Thread(Threaded::spawn(mapper, closer, atlas, host));
        }
        let stages = Inline { mapper, closer, atlas, stop: Arc::default(), clock: host.clock.clone() };
        match runner {
            Runner::Delayed(delays) => Self::Delayed(Box::new(Delayed::new(stages, delays))),
            Runner::Sliced => Self::Sliced(Box::new(Sliced::new(stages))),
            _ => Self::Inline(Box::new(stages)),
        }
    }

    /// Whether it runs on threads.
    pub fn is_threaded(&self) -> bool {
        matches!(self, Self::Thread(_))
    }

    /// Journals the decisions of the threads from now on; in lockstep there is nothing to write.
    pub fn write_journal(&self, to: Box<dyn Write + Send>, header: &Header) {
        if let Self::Thread(thread) = self {
            thread.journal.start(to, header);
        }
    }

    /// Why the journal is incomplete, if so.
    pub fn journal_failed(&self) -> Option<String> {
        match self {
            Self::Thread(thread) => thread.journal.failed(),
            _ => None,
        }
    }

    /// Replays the decisions in a journal; `None` where there are threads.
    pub fn replay(self, journal: Journal) -> Option<Self> {
        match self {
            Self::Inline(inline) => Some(Self::Replay(Box::new(Replay::new(*inline, journal)))),
            _ => None,
        }
    }

    /// Progress of a replay, where this is one.
    pub fn replayed(&self) -> Option<&Replayed> {
        match self {
            Self::Replay(replay) => Some(&replay.progress),
            _ => None,
        }
    }

    /// The snapshot for a frame, and whether a key frame requested now would be processed at once.
    pub fn snapshot_for(&mut self, stamp: Stamp, done: &mut Done) -> (Arc<Snapshot>, bool) {
        match self {
            Self::Inline(inline) => (inline.atlas.latest().clone(), true),
            Self::Sliced(sliced) => (sliced.reader.latest(), sliced.idle()),
            Self::Delayed(delayed) => delayed.snapshot_for(done),
            Self::Thread(thread) => (thread.reader.latest(), thread.idle()),
            Self::Replay(replay) => replay.snapshot_for(stamp, done),
        }
    }

    pub fn latest(&self) -> Arc<Snapshot> {
        match self {
            Self::Inline(inline) => inline.atlas.latest().clone(),
            Self::Sliced(sliced) => sliced.reader.latest(),
            Self::Delayed(delayed) => delayed.current.clone(),
            Self::Thread(thread) => thread.reader.latest(),
            Self::Replay(replay) => replay.current.clone(),
        }
    }

    /// The stream of changes from now on; `None` when mapping has failed.
    pub fn subscribe(&mut self) -> Option<Subscription> {
        match self {
            Self::Inline(inline) => Some(inline.atlas.subscribe()),
            Self::Sliced(sliced) => sliced.subscribe(),
            Self::Delayed(delayed) => Some(delayed.stages.atlas.subscribe()),
            Self::Thread(thread) => thread.subscribe(),
            Self::Replay(replay) => Some(replay.stages.atlas.subscribe()),
        }
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        match self {
            Self::Inline(inline) => inline.mapper.note(&seen),
            Self::Sliced(sliced) => sliced.note(seen),
            Self::Delayed(delayed) => delayed.note(seen),
            Self::Thread(thread) => thread.note(seen),
            Self::Replay(replay) => replay.note(seen),
        }
    }

    /// Submits a request. When it starts a map, this waits for the result and returns the frame's key frame;
    /// later key frames are returned only when mapping runs inline.
    pub fn submit(&mut self, request: KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        match self {
            Self::Inline(inline) => inline.submit(&request, done),
            Self::Sliced(sliced) => sliced.submit(request),
            Self::Delayed(delayed) => delayed.submit(request, done),
            Self::Thread(thread) => thread.submit(request),
            Self::Replay(replay) => replay.submit(request, done),
        }
    }

    /// The snapshot after a map was created.
    pub fn after_start(&mut self, done: &mut Done) -> Arc<Snapshot> {
        match self {
            Self::Replay(replay) => replay.after_start(done),
            _ => self.latest(),
        }
    }

    /// Writes the result of a frame to the journal, or compares it in a replay.
    pub fn record_frame(&mut self, frame: &FrameRecord) {
        match self {
            Self::Inline(_) | Self::Sliced(_) | Self::Delayed(_) => {}
            Self::Thread(thread) => thread.journal.write(&Record::Frame(*frame)),
            Self::Replay(replay) => replay.compare(frame),
        }
    }

    /// Writes the final map to the journal, or compares it in a replay.
    pub fn record_end(&mut self, version: u64, digest: u64) {
        match self {
            Self::Inline(_) | Self::Sliced(_) | Self::Delayed(_) => {}
            Self::Thread(thread) => thread.journal.write(&Record::End { version, digest }),
            Self::Replay(replay) => replay.compare_end(version, digest),
        }
    }

    /// Collects the work finished meanwhile.
    pub fn poll(&mut self, into: &mut Done) {
        match self {
            Self::Thread(thread) => thread.poll(into),
            Self::Sliced(sliced) => sliced.poll(into),
            _ => {}
        }
    }

    /// Does the next slice, where the stages run in slices; false when there was nothing to do.
    pub fn work(&mut self) -> bool {
        match self {
            Self::Sliced(sliced) => sliced.work(),
            _ => false,
        }
    }

    /// Set to end adjustments of whole maps early, the final one too.
    pub fn stop(&self) -> &Arc<AtomicBool> {
        match self {
            Self::Inline(inline) => &inline.stop,
            Self::Sliced(sliced) => &sliced.stop,
            Self::Delayed(delayed) => &delayed.stages.stop,
            Self::Thread(thread) => &thread.stop,
            Self::Replay(replay) => &replay.stages.stop,
        }
    }

    /// Lets mapping finish its work and the final bundle adjustment, and waits for it.
    pub fn finish(&mut self, into: &mut Done) {
        match self {
            Self::Inline(inline) => inline.final_adjustment(into),
            Self::Sliced(sliced) => sliced.finish(into),
            Self::Delayed(delayed) => delayed.finish(into),
            Self::Thread(thread) => thread.finish(into),
            Self::Replay(replay) => replay.finish(into),
        }
    }
}
