//! Mapping and closing, run inline (lockstep), on threads of their own, or as a journal tells (replay).

mod inline;
mod replay;
mod threaded;

pub use replay::{Replayed, Stopped};

use crate::journal::{FrameRecord, Header, Journal, Record};
use cairn_atlas::{Atlas, ImuSegment, KeyFrameId, LandmarkId, MapPrior, Snapshot, Subscription};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::Attempt;
use cairn_mapping::{Begin, Closer, Mapper, Submitted, Verdict};
use cairn_sensor::Stamp;
use cairn_tracking::{AnchoredPose, KeyFrameRequest, RelocationPrior};
use inline::Inline;
use replay::Replay;
use std::io::Write;
use std::sync::Arc;
use threaded::Threaded;

/// How the stages are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Runner {
    /// One after the other: bit-identical from run to run, whatever the machine does beside.
    #[default]
    Lockstep,
    /// Mapping on its own thread, tracking never waits for it.
    Threaded,
}

/// What mapping and closing have done since they were last asked.
#[derive(Clone, Debug, Default)]
pub(crate) struct Done {
    /// Milliseconds of each key frame in mapping.
    pub ms: Vec<f64>,
    /// Milliseconds of each key frame in closing, and of each adjustment of a whole world.
    pub close_ms: Vec<f64>,
    /// What closing said of the places it compared.
    pub verdicts: Vec<Verdict>,
    /// How gravity, scale and biases were sought last.
    pub attempt: Option<Attempt>,
    /// Why a stage died, if one did.
    pub died: Option<String>,
}

impl Done {
    fn take(&mut self, other: Done) {
        self.ms.extend(other.ms);
        self.close_ms.extend(other.close_ms);
        self.verdicts.extend(other.verdicts);
        self.attempt = other.attempt.or(self.attempt.take());
        self.died = self.died.take().or(other.died);
    }
}

/// Mapping and closing, wherever they run.
pub(crate) enum Mapping {
    Inline(Box<Inline>),
    Thread(Threaded),
    Replay(Box<Replay>),
}

impl Mapping {
    pub fn new(runner: Runner, mapper: Mapper, closer: Closer, snapshot: Snapshot) -> Self {
        let atlas = Atlas::new(snapshot);
        match runner {
            Runner::Lockstep => Self::Inline(Box::new(Inline { mapper, closer, atlas })),
            Runner::Threaded => Self::Thread(Threaded::spawn(mapper, closer, atlas)),
        }
    }

    /// Writes what threads decide from now on; nothing else decides anything in lockstep.
    pub fn write_journal(&self, to: Box<dyn Write + Send>, header: &Header) {
        if let Self::Thread(thread) = self {
            thread.scribe.begin(to, header);
        }
    }

    /// Why the journal is not whole, if so.
    pub fn journal_failed(&self) -> Option<String> {
        match self {
            Self::Thread(thread) => thread.scribe.failed(),
            _ => None,
        }
    }

    /// Lets a journal decide what threads decided; `None` where there are threads.
    pub fn replay(self, journal: Journal) -> Option<Self> {
        match self {
            Self::Inline(inline) => Some(Self::Replay(Box::new(Replay::new(*inline, journal)))),
            _ => None,
        }
    }

    /// How far a replay has come, where it is one.
    pub fn replayed(&self) -> Option<&Replayed> {
        match self {
            Self::Replay(replay) => Some(&replay.told),
            _ => None,
        }
    }

    /// The map for a frame, and whether a key frame offered now would be taken up at once.
    pub fn look(&mut self, stamp: Stamp, done: &mut Done) -> (Arc<Snapshot>, bool) {
        match self {
            Self::Inline(inline) => (inline.atlas.latest().clone(), true),
            Self::Thread(thread) => (thread.reader.latest(), thread.idle()),
            Self::Replay(replay) => replay.look(stamp, done),
        }
    }

    pub fn latest(&self) -> Arc<Snapshot> {
        match self {
            Self::Inline(inline) => inline.atlas.latest().clone(),
            Self::Thread(thread) => thread.reader.latest(),
            Self::Replay(replay) => replay.current.clone(),
        }
    }

    /// The stream of changes from now on; `None` when mapping is gone.
    pub fn subscribe(&mut self) -> Option<Subscription> {
        match self {
            Self::Inline(inline) => Some(inline.atlas.subscribe()),
            Self::Thread(thread) => thread.subscribe(),
            Self::Replay(replay) => Some(replay.stages.atlas.subscribe()),
        }
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        match self {
            Self::Inline(inline) => inline.mapper.note(&seen),
            Self::Thread(thread) => thread.note(seen),
            Self::Replay(replay) => replay.note(seen),
        }
    }

    /// Hands over an offer. A start is waited for and answered with the key frame the eye stands at; later key
    /// frames are answered when mapping runs inline.
    pub fn submit(&mut self, request: KeyFrameRequest, done: &mut Done) -> Option<KeyFrameId> {
        match self {
            Self::Inline(inline) => inline.submit(&request, done),
            Self::Thread(thread) => thread.submit(request),
            Self::Replay(replay) => replay.submit(request, done),
        }
    }

    /// The map after a start was answered.
    pub fn after_start(&mut self, done: &mut Done) -> Arc<Snapshot> {
        match self {
            Self::Replay(replay) => replay.after_start(done),
            _ => self.latest(),
        }
    }

    /// What became of a frame goes into the journal, or is compared with it.
    pub fn tell(&mut self, frame: &FrameRecord) {
        match self {
            Self::Inline(_) => {}
            Self::Thread(thread) => thread.scribe.write(&Record::Frame(*frame)),
            Self::Replay(replay) => replay.compare(frame),
        }
    }

    /// The run has ended with this map: it goes into the journal, or is compared with it.
    pub fn tell_end(&mut self, version: u64, digest: u64) {
        match self {
            Self::Inline(_) => {}
            Self::Thread(thread) => thread.scribe.write(&Record::End { version, digest }),
            Self::Replay(replay) => replay.compare_end(version, digest),
        }
    }

    /// Collects what mapping has done meanwhile.
    pub fn poll(&self, into: &mut Done) {
        if let Self::Thread(thread) = self {
            thread.poll(into);
        }
    }

    /// Lets mapping end what it was given and settle the whole map, and waits for it.
    pub fn finish(&mut self, into: &mut Done) {
        match self {
            Self::Inline(inline) => inline.final_adjustment(into),
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
) -> (Option<KeyFrameId>, Option<Attempt>) {
    let id = match request {
        KeyFrameRequest::First { frame, relocation_prior, imu } => {
            Some(mapper.start(atlas, frame, &begin(relocation_prior, imu, true)))
        }
        KeyFrameRequest::Pair { first, second, first_from_second, points, relocation_prior, imu } => {
            let begin = begin(relocation_prior, imu, false);
            mapper.start_pair(atlas, first, second, *first_from_second, points, &begin)
        }
        KeyFrameRequest::Next { frame, landmarks, anchored, imu, orientation_only, rescale } => {
            let AnchoredPose { reference, reference_from_camera, .. } = *anchored;
            let imu = imu.as_ref();
            let (orientation_only, rescale) = (*orientation_only, *rescale);
            let submitted = Submitted {
                frame,
                landmarks,
                reference,
                reference_from_camera,
                imu,
                orientation_only,
                rescale,
            };
            let mapped = mapper.step(atlas, &submitted, stop);
            return mapped.map_or((None, None), |m| (Some(m.key_frame), m.attempt));
        }
    };
    (id, None)
}

/// Where a world begins: at a place believed in a former world, or as the first.
fn begin(relocation_prior: &Option<RelocationPrior>, imu: &Option<ImuSegment>, metric: bool) -> Begin {
    let begin = relocation_prior.map_or(Begin::default(), |a| Begin {
        world_from_camera: a.anchored.world_from_camera,
        tie: Some(MapPrior {
            to: a.anchored.reference,
            to_from_root: a.anchored.reference_from_camera,
            sigma: a.sigma,
            sigma_rad: a.sigma_rad,
            sigma_log_scale: a.sigma_log_scale,
        }),
        pace: a.pace,
        level: metric && a.level,
        ..Begin::default()
    });
    // The first world begins nearly upright, where that is felt.
    let up = imu.as_ref().and_then(|s| s.up).filter(|_| relocation_prior.is_none());
    let world_from_camera = up.map_or(begin.world_from_camera, |up| Se3::new(upright(&up), Vec3::zeros()));
    Begin { imu: imu.clone(), world_from_camera, ..begin }
}

/// The smallest turn that takes a direction to the z axis.
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
