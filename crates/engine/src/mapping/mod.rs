//! Mapping and closing: inline (lockstep), with drawn latencies, on their own threads, or replayed from a journal.

mod delayed;
mod inline;
mod replay;
mod threaded;

pub use delayed::Delays;
pub use replay::{Replayed, Stopped};

use crate::journal::{FrameRecord, Header, Journal, Record};
use cairn_atlas::{Atlas, ImuSegment, KeyFrameId, LandmarkId, MapPrior, Snapshot, Subscription};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::Attempt;
use cairn_mapping::{Closer, KeyFrameInput, MapStart, Mapper, ScaleCheck, ScaleVerdict, Verdict};
use cairn_sensor::Stamp;
use cairn_tracking::{AnchoredPose, KeyFrameRequest, RelocationPrior};
use delayed::Delayed;
use inline::Inline;
use replay::Replay;
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
    /// Mapping and closing on their own threads; tracking never waits for them.
    Threaded,
    /// As on threads, with latencies drawn by a seed instead of those of the machine: bit-identical from run to run.
    Delayed(Delays),
}

/// The work that mapping and closing have finished since they were last polled.
#[derive(Clone, Debug, Default)]
pub(crate) struct Done {
    /// Milliseconds of each key frame in mapping.
    pub ms: Vec<f64>,
    /// Milliseconds of each key frame in closing, and of each adjustment of a whole map.
    pub close_ms: Vec<f64>,
    /// Verdicts of closing.
    pub verdicts: Vec<Verdict>,
    /// The last attempt to initialise gravity, scale and biases.
    pub attempt: Option<Attempt>,
    /// The last check of a metric scale; a correction stays until it is polled.
    pub scale_check: Option<ScaleCheck>,
    /// Why a stage failed, if one did.
    pub stage_failed: Option<String>,
}

impl Done {
    fn take(&mut self, other: Done) {
        self.ms.extend(other.ms);
        self.close_ms.extend(other.close_ms);
        self.verdicts.extend(other.verdicts);
        self.attempt = other.attempt.or(self.attempt.take());
        self.check(other.scale_check);
        self.stage_failed = self.stage_failed.take().or(other.stage_failed);
    }

    /// Takes a result of mapping; returns its key frame.
    fn taken(&mut self, taken: Taken) -> Option<KeyFrameId> {
        self.attempt = taken.attempt.or(self.attempt.take());
        self.check(taken.scale_check);
        taken.key_frame
    }

    fn check(&mut self, newer: Option<ScaleCheck>) {
        let corrected = |c: &ScaleCheck| c.verdict == ScaleVerdict::Corrected;
        if !self.scale_check.as_ref().is_some_and(corrected) || newer.as_ref().is_some_and(corrected) {
            self.scale_check = newer.or(self.scale_check);
        }
    }
}

/// What mapping made of a request.
#[derive(Default)]
struct Taken {
    key_frame: Option<KeyFrameId>,
    attempt: Option<Attempt>,
    scale_check: Option<ScaleCheck>,
}

/// Mapping and closing, in one of the four forms.
pub(crate) enum Mapping {
    Inline(Box<Inline>),
    Delayed(Box<Delayed>),
    Thread(Threaded),
    Replay(Box<Replay>),
}

impl Mapping {
    pub fn new(runner: Runner, mapper: Mapper, closer: Closer, snapshot: Snapshot) -> Self {
        let atlas = Atlas::new(snapshot);
        if runner == Runner::Threaded {
            return Self::Thread(Threaded::spawn(mapper, closer, atlas));
        }
        let stages = Inline { mapper, closer, atlas, stop: Arc::default() };
        match runner {
            Runner::Delayed(delays) => Self::Delayed(Box::new(Delayed::new(stages, delays))),
            _ => Self::Inline(Box::new(stages)),
        }
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
            Self::Delayed(delayed) => delayed.snapshot_for(done),
            Self::Thread(thread) => (thread.reader.latest(), thread.idle()),
            Self::Replay(replay) => replay.snapshot_for(stamp, done),
        }
    }

    pub fn latest(&self) -> Arc<Snapshot> {
        match self {
            Self::Inline(inline) => inline.atlas.latest().clone(),
            Self::Delayed(delayed) => delayed.current.clone(),
            Self::Thread(thread) => thread.reader.latest(),
            Self::Replay(replay) => replay.current.clone(),
        }
    }

    /// The stream of changes from now on; `None` when mapping has failed.
    pub fn subscribe(&mut self) -> Option<Subscription> {
        match self {
            Self::Inline(inline) => Some(inline.atlas.subscribe()),
            Self::Delayed(delayed) => Some(delayed.stages.atlas.subscribe()),
            Self::Thread(thread) => thread.subscribe(),
            Self::Replay(replay) => Some(replay.stages.atlas.subscribe()),
        }
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        match self {
            Self::Inline(inline) => inline.mapper.note(&seen),
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
            Self::Inline(_) | Self::Delayed(_) => {}
            Self::Thread(thread) => thread.journal.write(&Record::Frame(*frame)),
            Self::Replay(replay) => replay.compare(frame),
        }
    }

    /// Writes the final map to the journal, or compares it in a replay.
    pub fn record_end(&mut self, version: u64, digest: u64) {
        match self {
            Self::Inline(_) | Self::Delayed(_) => {}
            Self::Thread(thread) => thread.journal.write(&Record::End { version, digest }),
            Self::Replay(replay) => replay.compare_end(version, digest),
        }
    }

    /// Collects the work finished meanwhile.
    pub fn poll(&self, into: &mut Done) {
        if let Self::Thread(thread) = self {
            thread.poll(into);
        }
    }

    /// Set to end adjustments of whole maps early, the final one too.
    pub fn stop(&self) -> &Arc<AtomicBool> {
        match self {
            Self::Inline(inline) => &inline.stop,
            Self::Delayed(delayed) => &delayed.stages.stop,
            Self::Thread(thread) => &thread.stop,
            Self::Replay(replay) => &replay.stages.stop,
        }
    }

    /// Lets mapping finish its work and the final bundle adjustment, and waits for it.
    pub fn finish(&mut self, into: &mut Done) {
        match self {
            Self::Inline(inline) => inline.final_adjustment(into),
            Self::Delayed(delayed) => delayed.finish(into),
            Self::Thread(thread) => thread.finish(into),
            Self::Replay(replay) => replay.finish(into),
        }
    }
}

fn take(
    mapper: &mut Mapper,
    atlas: &mut Atlas,
    request: &KeyFrameRequest,
    stop: impl FnMut() -> bool,
) -> Taken {
    let key_frame = match request {
        KeyFrameRequest::First { frame, relocation_prior, imu } => {
            Some(mapper.start(atlas, frame, &map_start(relocation_prior, imu, true)))
        }
        KeyFrameRequest::Pair { first, second, first_from_second, points, relocation_prior, imu } => {
            let map_start = map_start(relocation_prior, imu, false);
            mapper.start_pair(atlas, first, second, *first_from_second, points, &map_start)
        }
        KeyFrameRequest::Next { frame, landmarks, anchored, imu, orientation_only, rescale } => {
            let AnchoredPose { reference, reference_from_camera, .. } = *anchored;
            let imu = imu.as_ref();
            let (orientation_only, rescale) = (*orientation_only, *rescale);
            let submitted = KeyFrameInput {
                frame,
                landmarks,
                reference,
                reference_from_camera,
                imu,
                orientation_only,
                rescale,
            };
            let mapped = mapper.step(atlas, &submitted, stop);
            return mapped.map_or(Taken::default(), |m| Taken {
                key_frame: Some(m.key_frame),
                attempt: m.attempt,
                scale_check: m.scale_check,
            });
        }
    };
    Taken { key_frame, ..Taken::default() }
}

/// The initial state of a map: at the prior pose in the previous map, or as the first one.
fn map_start(relocation_prior: &Option<RelocationPrior>, imu: &Option<ImuSegment>, metric: bool) -> MapStart {
    let map_start = relocation_prior.map_or(MapStart::default(), |prior| MapStart {
        world_from_camera: prior.anchored.world_from_camera,
        map_prior: Some(MapPrior {
            to: prior.anchored.reference,
            to_from_root: prior.anchored.reference_from_camera,
            sigma: prior.sigma,
            sigma_rad: prior.sigma_rad,
            sigma_log_scale: prior.sigma_log_scale,
        }),
        speed: prior.speed,
        gravity_aligned: metric && prior.gravity_aligned,
        assumed_since: prior.assumed_since,
        ..MapStart::default()
    });
    // The first map starts nearly upright, where the IMU shows the up direction.
    let up = imu.as_ref().and_then(|s| s.up).filter(|_| relocation_prior.is_none());
    let world_from_camera =
        up.map_or(map_start.world_from_camera, |up| Se3::new(upright(&up), Vec3::zeros()));
    MapStart { imu: imu.clone(), world_from_camera, ..map_start }
}

/// The smallest rotation that takes a direction to the z axis.
fn upright(up: &Vec3) -> So3 {
    let axis = up.cross(&Vec3::z());
    match axis.try_normalize(1e-9) {
        Some(axis) => So3::exp(&(axis * up.angle(&Vec3::z()))),
        None if up.z < 0.0 => So3::exp(&(Vec3::x() * std::f64::consts::PI)),
        None => So3::identity(),
    }
}

fn text_of(cause: &Box<dyn std::any::Any + Send>) -> String {
    let text = cause
        .downcast_ref::<&str>()
        .map(|s| s.to_string())
        .or_else(|| cause.downcast_ref::<String>().cloned());
    format!("mapping stopped: {}", text.unwrap_or_else(|| "no reason given".into()))
}
