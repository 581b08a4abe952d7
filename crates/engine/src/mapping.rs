//! Mapping and closing, run inline (lockstep) or on threads of their own.

use cairn_atlas::{Atlas, KeyFrameId, LandmarkId, Map, Reader, Tie, WorldId};
use cairn_mapping::{Begin, Closed, Closer, Mapper, Verdict};
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

/// What mapping and closing have done since they were last asked.
#[derive(Clone, Debug, Default)]
pub(crate) struct Done {
    /// Milliseconds of each key frame in mapping.
    pub ms: Vec<f64>,
    /// Milliseconds of each key frame in closing, and of each adjustment of a whole world.
    pub close_ms: Vec<f64>,
    /// What closing said of the places it compared.
    pub verdicts: Vec<Verdict>,
    /// Why a stage died, if one did.
    pub died: Option<String>,
}

impl Done {
    fn take(&mut self, other: Done) {
        self.ms.extend(other.ms);
        self.close_ms.extend(other.close_ms);
        self.verdicts.extend(other.verdicts);
        self.died = self.died.take().or(other.died);
    }
}

/// What the mapping thread is sent.
pub(crate) enum Message {
    Seen(Vec<(LandmarkId, bool)>),
    Offer(Offer, SyncSender<Option<KeyFrameId>>),
    /// Closing has made changes on a map that may be older by now.
    Closed(Arc<Map>, Closed),
    /// Nothing more will come: end closing, and settle the map if asked to.
    End {
        settle: bool,
    },
}

/// What the closing thread is sent.
enum Job {
    /// Look for the place of a key frame.
    Place(Arc<Map>, KeyFrameId),
    /// Adjust a world as a whole.
    Whole(Arc<Map>, WorldId),
}

/// Mapping and closing, wherever they run.
pub(crate) enum Mapping {
    Inline {
        mapper: Box<Mapper>,
        closer: Box<Closer>,
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
    pub fn new(runner: Runner, mapper: Mapper, closer: Closer, map: Map) -> Self {
        let atlas = Atlas::new(map);
        match runner {
            Runner::Lockstep => Self::Inline { mapper: Box::new(mapper), closer: Box::new(closer), atlas },
            Runner::Threaded => Self::spawn(mapper, closer, atlas),
        }
    }

    fn spawn(mapper: Mapper, closer: Closer, atlas: Atlas) -> Self {
        let reader = atlas.reader();
        let (to, from) = channel::<Message>();
        let (tell, done) = channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let closing = spawn_closing(closer, to.clone(), tell.clone());
        let keeper = Keeper { mapper, atlas, waiting: waiting.clone(), tell, closing };
        let handle =
            std::thread::Builder::new().name("cairn-mapping".into()).spawn(move || keeper.work(from)).ok();
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
            Self::Inline { mapper, closer, atlas } => {
                let start = Instant::now();
                let result = catch_unwind(AssertUnwindSafe(|| take(mapper, atlas, &offer, || false)));
                done.ms.push(start.elapsed().as_secs_f64() * 1e3);
                let closed = result.and_then(|id| {
                    catch_unwind(AssertUnwindSafe(|| close_inline(closer, atlas, id, done))).map(|()| id)
                });
                closed.unwrap_or_else(|cause| {
                    done.died = Some(text_of(&cause));
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
            done.try_iter().for_each(|d| into.take(d));
        }
    }

    /// Lets mapping end what it was given and settle the whole map, and waits for it.
    pub fn finish(&mut self, into: &mut Done) {
        match self {
            Self::Inline { mapper, atlas, .. } => {
                if let Err(cause) = catch_unwind(AssertUnwindSafe(|| mapper.settle(atlas))) {
                    into.died = Some(text_of(&cause));
                }
            }
            Self::Thread { to, .. } => {
                if let Some(to) = to.take() {
                    let _ = to.send(Message::End { settle: true });
                }
                self.join();
            }
        }
        self.poll(into);
    }

    fn join(&mut self) {
        if let Self::Thread { to, handle, .. } = self {
            if let Some(to) = to.take() {
                let _ = to.send(Message::End { settle: false });
            }
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

/// The thread that alone may write: mapping, and what closing hands back.
struct Keeper {
    mapper: Mapper,
    atlas: Atlas,
    waiting: Arc<AtomicUsize>,
    tell: Sender<Done>,
    closing: (Option<Sender<Job>>, Option<JoinHandle<()>>),
}

impl Keeper {
    fn work(mut self, from: Receiver<Message>) {
        while let Ok(message) = from.recv() {
            let end = match message {
                Message::End { settle } => Some(settle),
                _ => None,
            };
            if end.is_some() {
                // What closing still has in hand is waited for.
                self.end_closing();
            }
            let handled = catch_unwind(AssertUnwindSafe(|| {
                self.handle(message);
                if let Some(settle) = end {
                    from.try_iter().for_each(|message| self.handle(message));
                    settle.then(|| self.mapper.settle(&mut self.atlas));
                }
            }));
            if let Err(cause) = &handled {
                let _ = self.tell.send(Done { died: Some(text_of(cause)), ..Done::default() });
            }
            if end.is_some() || handled.is_err() {
                return;
            }
        }
    }

    fn handle(&mut self, message: Message) {
        match message {
            Message::Seen(seen) => self.mapper.note(&seen),
            Message::Offer(offer, reply) => {
                let start = Instant::now();
                // The one in hand counts as waiting: more than one means that another has come.
                let stop = || self.waiting.load(Ordering::Relaxed) > 1;
                let id =
                    catch_unwind(AssertUnwindSafe(|| take(&mut self.mapper, &mut self.atlas, &offer, stop)));
                self.waiting.fetch_sub(1, Ordering::Relaxed);
                let ms = vec![start.elapsed().as_secs_f64() * 1e3];
                let _ = self.tell.send(Done { ms, ..Done::default() });
                let id = id.unwrap_or_else(|cause| std::panic::resume_unwind(cause));
                let _ = reply.try_send(id);
                if let Some(id) = id {
                    self.job(Job::Place(self.atlas.latest().clone(), id));
                }
            }
            Message::Closed(base, closed) => {
                self.atlas.commit_since(&base, closed.changes);
                let map = self.atlas.latest();
                let joined =
                    closed.joined.and_then(|id| map.living(id)).and_then(|(id, _)| map.key_frame(id));
                if let Some(k) = joined {
                    self.job(Job::Whole(map.clone(), k.world));
                }
            }
            Message::End { .. } => {}
        }
    }

    fn job(&self, job: Job) {
        if let Some(closing) = &self.closing.0 {
            let _ = closing.send(job);
        }
    }

    fn end_closing(&mut self) {
        self.closing.0 = None;
        if let Some(handle) = self.closing.1.take() {
            let _ = handle.join();
        }
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.end_closing();
    }
}

/// The thread that looks for places and adjusts whole worlds.
fn spawn_closing(
    mut closer: Closer,
    to: Sender<Message>,
    tell: Sender<Done>,
) -> (Option<Sender<Job>>, Option<JoinHandle<()>>) {
    let (jobs, from) = channel::<Job>();
    let work = move || {
        while let Ok(mut job) = from.recv() {
            // The newest is the one that matters: places that were passed meanwhile are passed over.
            for newer in from.try_iter() {
                if matches!(newer, Job::Whole(..)) || matches!(job, Job::Place(..)) {
                    job = newer;
                }
            }
            let start = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| match job {
                Job::Place(map, id) => {
                    let closed = closer.step(&map, id);
                    (map, closed)
                }
                Job::Whole(map, world) => {
                    let changes = closer.adjust_whole(&map, world, || false);
                    (map, Closed { changes, ..Closed::default() })
                }
            }));
            let close_ms = vec![start.elapsed().as_secs_f64() * 1e3];
            match result {
                Ok((map, mut closed)) => {
                    let verdicts = std::mem::take(&mut closed.verdicts);
                    let _ = tell.send(Done { close_ms, verdicts, ..Done::default() });
                    if !closed.changes.is_empty() && to.send(Message::Closed(map, closed)).is_err() {
                        return;
                    }
                }
                Err(cause) => {
                    let died = Some(text_of(&cause).replace("mapping", "closing"));
                    let _ = tell.send(Done { close_ms, died, ..Done::default() });
                    return;
                }
            }
        }
    };
    let handle = std::thread::Builder::new().name("cairn-closing".into()).spawn(work).ok();
    (Some(jobs), handle)
}

/// Closing after a key frame, in step with it.
fn close_inline(closer: &mut Closer, atlas: &mut Atlas, id: Option<KeyFrameId>, done: &mut Done) {
    let Some(id) = id else { return };
    let start = Instant::now();
    let closed = closer.step(atlas.latest(), id);
    done.verdicts.extend(closed.verdicts);
    atlas.commit(closed.changes);
    done.close_ms.push(start.elapsed().as_secs_f64() * 1e3);
    if let Some(world) = closed.joined.and_then(|id| atlas.latest().key_frame(id)).map(|k| k.world) {
        let start = Instant::now();
        let changes = closer.adjust_whole(atlas.latest(), world, || false);
        atlas.commit(changes);
        done.close_ms.push(start.elapsed().as_secs_f64() * 1e3);
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
        pace: a.pace,
    })
}

fn text_of(cause: &Box<dyn std::any::Any + Send>) -> String {
    let text = cause
        .downcast_ref::<&str>()
        .map(|s| s.to_string())
        .or_else(|| cause.downcast_ref::<String>().cloned());
    format!("mapping stopped: {}", text.unwrap_or_else(|| "no reason given".into()))
}
