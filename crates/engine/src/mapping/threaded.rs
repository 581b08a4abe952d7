//! Mapping and closing on their own threads.

use super::done::Done;
use super::work::{take, text_of};
use crate::journal::{JobRecord, JournalWriter, Record};
use cairn_atlas::{Atlas, KeyFrameId, LandmarkId, MapId, Reader, Snapshot, Subscription};
use cairn_mapping::{Closed, Closer, Mapper};
use cairn_sensor::{Clock, Host, Task, Work};
use cairn_solve::to_end;
use cairn_tracking::KeyFrameRequest;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};

/// Messages to the mapping thread.
enum Message {
    Visibility(Vec<(LandmarkId, bool)>),
    KeyFrameRequest(Box<KeyFrameRequest>, SyncSender<Option<KeyFrameId>>),
    /// The closing job of this number has produced changes on a snapshot that may be outdated by now.
    Closed(u64, Arc<Snapshot>, Closed),
    /// A subscription to all changes.
    Subscribe(SyncSender<Subscription>),
    /// The run has ended: finish closing, and run the final bundle adjustment if asked to.
    End {
        final_adjustment: bool,
    },
}

/// A job for closing.
pub(super) enum Job {
    /// Recognise the place of a key frame.
    Place(Arc<Snapshot>, KeyFrameId),
    /// Adjust a map as a whole.
    Whole(Arc<Snapshot>, MapId),
}

impl Job {
    /// The journal record of the job with this number.
    pub fn record(&self, number: u64) -> JobRecord {
        let (snapshot, whole, id) = match self {
            Self::Place(snapshot, id) => (snapshot, false, *id),
            Self::Whole(snapshot, map) => (snapshot, true, map.root()),
        };
        JobRecord { number, version: snapshot.version(), whole, key_frame: id.index() as u64 }
    }

    /// Whether a newer job is done in its place: only the newest place matters.
    pub fn gives_way_to(&self, newer: &Self) -> bool {
        matches!(newer, Self::Whole(..)) || matches!(self, Self::Place(..))
    }

    /// Runs the job; returns the snapshot it ran on along with the changes. `stop` ends the adjustment of a map without
    /// changes.
    pub fn work(self, closer: &mut Closer, stop: &AtomicBool) -> (Arc<Snapshot>, Closed) {
        to_end(self.work_in_slices(closer, stop))
    }

    /// The same in slices.
    pub async fn work_in_slices(self, closer: &mut Closer, stop: &AtomicBool) -> (Arc<Snapshot>, Closed) {
        match self {
            Self::Place(snapshot, id) => {
                let closed = closer.step_in_slices(&snapshot, id).await;
                (snapshot, closed)
            }
            Self::Whole(snapshot, map) => {
                let stop = || stop.load(Ordering::Relaxed);
                let changes = closer.adjust_whole_in_slices(&snapshot, map, stop).await;
                (snapshot, Closed { changes, ..Closed::default() })
            }
        }
    }
}

/// Commits the changes of closing on an older snapshot; returns the job that adjusts the map as a whole after
/// it, if due.
pub(super) fn commit(atlas: &mut Atlas, base: &Snapshot, closed: Closed) -> Option<Job> {
    atlas.commit_since(base, closed.changes);
    let snapshot = atlas.latest();
    let joined = closed
        .joined
        .and_then(|id| snapshot.surviving_ancestor(id))
        .and_then(|(id, _)| snapshot.key_frame(id))?;
    Some(Job::Whole(snapshot.clone(), joined.map))
}

/// Tracking's side of the threads.
pub(crate) struct Threaded {
    to: Option<Sender<Message>>,
    pub reader: Reader,
    waiting: Arc<AtomicUsize>,
    done: Receiver<Done>,
    thread: Option<Task>,
    pub journal: JournalWriter,
    pub stop: Arc<AtomicBool>,
}

impl Threaded {
    /// Begins the threads; where the host has none, mapping has failed, which is told as for any other reason.
    pub fn spawn(mapper: Mapper, closer: Closer, atlas: Atlas, host: &Host) -> Self {
        let reader = atlas.reader();
        let (to, from) = channel::<Message>();
        let (results, done) = channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        let journal = JournalWriter::default();
        let stop = Arc::new(AtomicBool::new(false));
        let clock = host.clock.clone();
        let closing = ClosingThread {
            closer,
            to: to.clone(),
            results: results.clone(),
            journal: journal.clone(),
            stop: stop.clone(),
            clock: clock.clone(),
        };
        let failed = results.clone();
        let thread = closing.spawn(host).and_then(|closing| {
            let mapping = MappingThread {
                mapper,
                atlas,
                waiting: waiting.clone(),
                results,
                closing,
                jobs: 0,
                journal: journal.clone(),
                stop: stop.clone(),
                clock,
            };
            host.threads.spawn(Work::new("cairn-mapping", move || mapping.work(from)))
        });
        if let Err(e) = &thread {
            let stage_failed = Some(format!("mapping could not begin: {e}"));
            let _ = failed.send(Done { stage_failed, ..Done::default() });
        }
        Self { to: Some(to), reader, waiting, done, thread: thread.ok(), journal, stop }
    }

    pub fn idle(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) == 0
    }

    pub fn note(&self, seen: Vec<(LandmarkId, bool)>) {
        if let Some(to) = &self.to {
            let _ = to.send(Message::Visibility(seen));
        }
    }

    pub fn submit(&self, request: KeyFrameRequest) -> Option<KeyFrameId> {
        let starting = !matches!(request, KeyFrameRequest::Next { .. });
        let (reply, answer) = sync_channel(1);
        self.waiting.fetch_add(1, Ordering::Relaxed);
        self.to.as_ref()?.send(Message::KeyFrameRequest(Box::new(request), reply)).ok()?;
        if starting { answer.recv().ok().flatten() } else { None }
    }

    /// Waits for the work mapping has in hand.
    pub fn subscribe(&self) -> Option<Subscription> {
        let (reply, answer) = sync_channel(1);
        self.to.as_ref()?.send(Message::Subscribe(reply)).ok()?;
        answer.recv().ok()
    }

    pub fn poll(&self, into: &mut Done) {
        self.done.try_iter().for_each(|d| into.take(d));
    }

    pub fn finish(&mut self, into: &mut Done) {
        self.end(true);
        self.poll(into);
    }

    fn end(&mut self, final_adjustment: bool) {
        if let Some(to) = self.to.take() {
            let _ = to.send(Message::End { final_adjustment });
        }
        if let Some(thread) = self.thread.take() {
            thread.join();
        }
    }
}

impl Drop for Threaded {
    fn drop(&mut self) {
        self.end(false);
    }
}

/// The thread that alone may write to the atlas: it runs mapping, and commits the changes of closing.
struct MappingThread {
    mapper: Mapper,
    atlas: Atlas,
    waiting: Arc<AtomicUsize>,
    results: Sender<Done>,
    closing: Closing,
    /// Jobs requested so far, including those that closing skipped.
    jobs: u64,
    journal: JournalWriter,
    stop: Arc<AtomicBool>,
    clock: Clock,
}

impl MappingThread {
    fn work(mut self, from: Receiver<Message>) {
        while let Ok(message) = from.recv() {
            let end = match message {
                Message::End { final_adjustment } => Some(final_adjustment),
                _ => None,
            };
            if end.is_some() {
                // Wait for what closing still has in hand.
                self.end_closing();
            }
            let handled = catch_unwind(AssertUnwindSafe(|| {
                self.handle(message);
                if let Some(final_adjustment) = end {
                    from.try_iter().for_each(|message| self.handle(message));
                    let stop = || self.stop.load(Ordering::Relaxed);
                    final_adjustment.then(|| self.mapper.final_adjustment(&mut self.atlas, stop));
                }
            }));
            if let Err(cause) = &handled {
                let _ = self.results.send(Done { stage_failed: Some(text_of(cause)), ..Done::default() });
            }
            if end.is_some() || handled.is_err() {
                return;
            }
        }
    }

    fn handle(&mut self, message: Message) {
        match message {
            Message::Visibility(seen) => self.mapper.note(&seen),
            Message::KeyFrameRequest(request, reply) => {
                let start = self.clock.now();
                // The request in hand counts as waiting: more than one means that another has arrived. Once
                // `stop` has returned true it stays so.
                let (waiting, mut asked, mut stop_after) = (&self.waiting, 0, None);
                let stop = || {
                    if stop_after.is_none() && waiting.load(Ordering::Relaxed) > 1 {
                        stop_after = Some(asked);
                    }
                    asked += 1;
                    stop_after.is_some()
                };
                let taken = catch_unwind(AssertUnwindSafe(|| {
                    take(&mut self.mapper, &mut self.atlas, &request, stop)
                }));
                self.journal.write(&Record::KeyFrameRequest { stop_after });
                self.waiting.fetch_sub(1, Ordering::Relaxed);
                let ms = vec![self.clock.ms_since(start)];
                let mut done = Done { ms, ..Done::default() };
                let id = taken.map(|taken| done.taken(taken));
                let _ = self.results.send(done);
                let id = id.unwrap_or_else(|cause| std::panic::resume_unwind(cause));
                let _ = reply.try_send(id);
                if let Some(id) = id {
                    self.job(Job::Place(self.atlas.latest().clone(), id));
                }
            }
            Message::Closed(job, base, closed) => {
                let whole = commit(&mut self.atlas, &base, closed);
                self.journal.write(&Record::Closed { job });
                if let Some(whole) = whole {
                    self.job(whole);
                }
            }
            Message::Subscribe(reply) => {
                let _ = reply.try_send(self.atlas.subscribe());
            }
            Message::End { .. } => {}
        }
    }

    fn job(&mut self, job: Job) {
        if let Some(jobs) = &self.closing.jobs {
            let _ = jobs.send((self.jobs, job));
        }
        self.jobs += 1;
    }

    fn end_closing(&mut self) {
        self.closing.jobs = None;
        if let Some(thread) = self.closing.thread.take() {
            thread.join();
        }
    }
}

impl Drop for MappingThread {
    fn drop(&mut self) {
        self.end_closing();
    }
}

/// The queue of numbered closing jobs, and the closing thread.
struct Closing {
    jobs: Option<Sender<(u64, Job)>>,
    thread: Option<Task>,
}

/// The thread that recognises places and adjusts whole maps.
struct ClosingThread {
    closer: Closer,
    to: Sender<Message>,
    results: Sender<Done>,
    journal: JournalWriter,
    stop: Arc<AtomicBool>,
    clock: Clock,
}

impl ClosingThread {
    /// Begins it, in the background.
    fn spawn(self, host: &Host) -> io::Result<Closing> {
        let (jobs, from) = channel::<(u64, Job)>();
        let work = Work::new("cairn-closing", move || self.work(&from)).in_background();
        Ok(Closing { jobs: Some(jobs), thread: Some(host.threads.spawn(work)?) })
    }

    fn work(mut self, from: &Receiver<(u64, Job)>) {
        while let Ok(mut job) = from.recv() {
            // Older ones that queued up meanwhile are skipped.
            for newer in from.try_iter() {
                if job.1.gives_way_to(&newer.1) {
                    job = newer;
                }
            }
            if !self.close(job) {
                return;
            }
        }
    }

    /// Runs a job; false when closing or mapping has ended.
    fn close(&mut self, (number, job): (u64, Job)) -> bool {
        let start = self.clock.now();
        self.journal.write(&Record::Job(job.record(number)));
        let result = catch_unwind(AssertUnwindSafe(|| job.work(&mut self.closer, &self.stop)));
        let close_ms = vec![self.clock.ms_since(start)];
        match result {
            Ok((snapshot, mut closed)) => {
                let verdicts = std::mem::take(&mut closed.verdicts);
                let _ = self.results.send(Done { close_ms, verdicts, ..Done::default() });
                closed.changes.is_empty() || self.to.send(Message::Closed(number, snapshot, closed)).is_ok()
            }
            Err(cause) => {
                let stage_failed = Some(text_of(&cause).replace("mapping", "closing"));
                let _ = self.results.send(Done { close_ms, stage_failed, ..Done::default() });
                false
            }
        }
    }
}
