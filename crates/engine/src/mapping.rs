//! The mapping stage, run inline (lockstep) or on a thread of its own.

use cairn_atlas::{Atlas, KeyFrameId, LandmarkId, Map, Reader, Tie};
use cairn_mapping::{Begin, Mapper};
use cairn_tracking::{Adrift, Offer};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

/// How the stages are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Runner {
    /// One after the other: bit-identical from run to run, whatever the machine does beside.
    #[default]
    Lockstep,
    /// Mapping on its own thread, tracking never waits for it.
    Threaded,
}

/// What mapping has done since it was last asked.
#[derive(Clone, Debug, Default)]
pub(crate) struct Done {
    /// Milliseconds of each key frame.
    pub ms: Vec<f64>,
    /// Why the stage died, if it did.
    pub died: Option<String>,
}

/// What the mapping thread is sent.
pub(crate) enum Message {
    Seen(Vec<(LandmarkId, bool)>),
    Settle,
    Offer(Offer, SyncSender<Option<KeyFrameId>>),
}

/// Mapping, wherever it runs.
pub(crate) enum Mapping {
    Inline {
        mapper: Box<Mapper>,
        atlas: Atlas,
    },
    Thread {
        to: Option<Sender<Message>>,
        reader: Reader,
        waiting: Arc<AtomicUsize>,
        done: Receiver<Done>,
        handle: Option<JoinHandle<()>>,
    },
}

impl Mapping {
    pub fn new(runner: Runner, mapper: Mapper, map: Map) -> Self {
        let atlas = Atlas::new(map);
        match runner {
            Runner::Lockstep => Self::Inline { mapper: Box::new(mapper), atlas },
            Runner::Threaded => Self::spawn(mapper, atlas),
        }
    }

    fn spawn(mut mapper: Mapper, mut atlas: Atlas) -> Self {
        let reader = atlas.reader();
        let (to, from) = channel::<Message>();
        let (tell, done) = channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let count = waiting.clone();
        let work = move || {
            for message in from {
                match message {
                    Message::Seen(seen) => mapper.note(&seen),
                    Message::Settle => {
                        if let Err(cause) = catch_unwind(AssertUnwindSafe(|| mapper.settle(&mut atlas))) {
                            let _ = tell.send(Done { ms: Vec::new(), died: Some(text_of(cause)) });
                            return;
                        }
                    }
                    Message::Offer(offer, reply) => {
                        let start = Instant::now();
                        // The one in hand counts as waiting: more than one means that another has come.
                        let stop = || count.load(Ordering::Relaxed) > 1;
                        let result =
                            catch_unwind(AssertUnwindSafe(|| take(&mut mapper, &mut atlas, &offer, stop)));
                        count.fetch_sub(1, Ordering::Relaxed);
                        let ms = vec![start.elapsed().as_secs_f64() * 1e3];
                        match result {
                            Ok(id) => {
                                let _ = reply.try_send(id);
                                let _ = tell.send(Done { ms, died: None });
                            }
                            Err(cause) => {
                                let _ = tell.send(Done { ms, died: Some(text_of(cause)) });
                                return;
                            }
                        }
                    }
                }
            }
        };
        let handle = std::thread::Builder::new().name("cairn-mapping".into()).spawn(work).ok();
        Self::Thread { to: Some(to), reader, waiting, done, handle }
    }

    pub fn latest(&self) -> Arc<Map> {
        match self {
            Self::Inline { atlas, .. } => atlas.latest().clone(),
            Self::Thread { reader, .. } => reader.latest(),
        }
    }

    /// Whether a key frame offered now would be taken up at once.
    pub fn idle(&self) -> bool {
        match self {
            Self::Inline { .. } => true,
            Self::Thread { waiting, .. } => waiting.load(Ordering::Relaxed) == 0,
        }
    }

    pub fn note(&mut self, seen: Vec<(LandmarkId, bool)>) {
        match self {
            Self::Inline { mapper, .. } => mapper.note(&seen),
            Self::Thread { to, .. } => {
                if let Some(to) = to {
                    let _ = to.send(Message::Seen(seen));
                }
            }
        }
    }

    /// Hands over an offer. A start is waited for and answered with the key frame the eye stands at; later key
    /// frames are answered when mapping runs inline.
    pub fn offer(&mut self, offer: Offer, done: &mut Done) -> Option<KeyFrameId> {
        match self {
            Self::Inline { mapper, atlas } => {
                let start = Instant::now();
                let result = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, &offer, || false)));
                done.ms.push(start.elapsed().as_secs_f64() * 1e3);
                result.unwrap_or_else(|cause| {
                    done.died = Some(text_of(cause));
                    None
                })
            }
            Self::Thread { to, waiting, .. } => {
                let starting = !matches!(offer, Offer::Next { .. });
                let (reply, answer) = sync_channel(1);
                waiting.fetch_add(1, Ordering::Relaxed);
                to.as_ref()?.send(Message::Offer(offer, reply)).ok()?;
                if starting { answer.recv().ok().flatten() } else { None }
            }
        }
    }

    /// Collects what mapping has done meanwhile.
    pub fn poll(&self, into: &mut Done) {
        if let Self::Thread { done, .. } = self {
            for d in done.try_iter() {
                into.ms.extend(d.ms);
                into.died = into.died.take().or(d.died);
            }
        }
    }

    /// Lets mapping end what it was given and settle the whole map, and waits for it.
    pub fn finish(&mut self, into: &mut Done) {
        match self {
            Self::Inline { mapper, atlas } => {
                if let Err(cause) = catch_unwind(AssertUnwindSafe(|| mapper.settle(atlas))) {
                    into.died = Some(text_of(cause));
                }
            }
            Self::Thread { to, .. } => {
                if let Some(to) = to {
                    let _ = to.send(Message::Settle);
                }
                self.join();
            }
        }
        self.poll(into);
    }

    fn join(&mut self) {
        if let Self::Thread { to, handle, .. } = self {
            *to = None;
            if let Some(handle) = handle.take() {
                let _ = handle.join();
            }
        }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        self.join();
    }
}

fn take(
    mapper: &mut Mapper,
    atlas: &mut Atlas,
    offer: &Offer,
    stop: impl FnMut() -> bool,
) -> Option<KeyFrameId> {
    match offer {
        Offer::First { frame, adrift } => Some(mapper.start(atlas, frame, &begin(adrift))),
        Offer::Pair { first, second, first_from_second, points, adrift } => {
            mapper.start_pair(atlas, first, second, *first_from_second, points, &begin(adrift))
        }
        Offer::Next { frame, landmarks, placed } => mapper
            .step(atlas, frame, landmarks, placed.reference, placed.reference_from_eye, stop)
            .map(|mapped| mapped.key_frame),
    }
}

/// Where a world begins: at a place believed in a former world, or as the first.
fn begin(adrift: &Option<Adrift>) -> Begin {
    adrift.map_or(Begin::default(), |a| Begin {
        world_from_eye: a.placed.world_from_eye,
        tie: Some(Tie {
            to: a.placed.reference,
            to_from_root: a.placed.reference_from_eye,
            sigma: a.sigma,
            sigma_rad: a.sigma_rad,
        }),
        depth: a.depth,
    })
}

fn text_of(cause: Box<dyn std::any::Any + Send>) -> String {
    let text = cause
        .downcast_ref::<&str>()
        .map(|s| s.to_string())
        .or_else(|| cause.downcast_ref::<String>().cloned());
    format!("mapping stopped: {}", text.unwrap_or_else(|| "no reason given".into()))
}
