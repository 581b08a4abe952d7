//! `--status`: status lines on stderr.
//!
//! A frame can take longer to process than pictures may stay away, as beside a compiler: meanwhile nothing else of the run goes on.
//! A [`Watch`] says so from a thread of its own.

use super::sink::{Frame, Sink, Step};
use crate::failure::Failure;
use cairn_engine::{Phase, Status};
use cairn_session::{Age, Session};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest time between two status lines, seconds of the source's time.
const INTERVAL_S: f64 = 1.0;
/// In real time a picture is done so soon after the one before, or WAIT_FRAMES is said: what a walker covers in it is a foot.
const LATE: Duration = Duration::from_millis(200);
/// The same in periods of a source that gives fewer pictures.
const LATE_PERIODS: f64 = 2.5;
/// How often that is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// Prints complete lines, one below the other, so that a screen reader can follow.
#[derive(Clone)]
pub struct StatusLines(Arc<Mutex<Lines>>);

impl StatusLines {
    /// The first line, before there is a session.
    pub fn begin() -> Self {
        Self::to(Box::new(std::io::stderr()))
    }

    fn to(out: Box<dyn Write + Send>) -> Self {
        let mut lines = Lines { out, printed: None, done: None, late: None };
        lines.update(&Status::default(), Age::default());
        Self(Arc::new(Mutex::new(lines)))
    }

    fn lines(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The status of a session.
    pub fn update_from(&mut self, session: &Session) {
        self.lines().update(&session.engine_status(), session.age());
    }

    /// From now on WAIT_FRAMES is said while pictures of this rate are not done in time.
    ///
    /// # Errors
    /// When there is no thread for it.
    pub fn watch(&self, rate_hz: f64) -> Result<Watch, Failure> {
        let period_s = if rate_hz > 0.0 { 1.0 / rate_hz } else { 0.0 };
        self.lines().late =
            Duration::try_from_secs_f64(LATE_PERIODS * period_s).ok().map(|late| late.max(LATE));
        let (lines, ended) = (self.clone(), Arc::new(AtomicBool::new(false)));
        let is_ended = ended.clone();
        let look = move || {
            while !is_ended.load(Ordering::Relaxed) {
                std::thread::sleep(LOOK);
                lines.lines().look();
            }
        };
        let thread = std::thread::Builder::new().name("cairn-status".into()).spawn(look);
        let thread = thread.map_err(|e| {
            Failure::new("--status", format!("no thread for it ({e})"), "close other programs")
        })?;
        Ok(Watch { lines: self.clone(), ended, thread: Some(thread) })
    }
}

/// Watches the time between pictures until it is dropped.
pub struct Watch {
    lines: StatusLines,
    ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.lines.lines().late = None;
        self.ended.store(true, Ordering::Relaxed);
        // The thread only prints; were it to fail, nothing is lost by it.
        self.thread.take().map(JoinHandle::join);
    }
}

struct Lines {
    out: Box<dyn Write + Send>,
    printed: Option<Status>,
    /// When the last picture was done.
    done: Option<Instant>,
    /// The time after which the next one is late, if it is watched.
    late: Option<Duration>,
}

impl Lines {
    fn is_late(&self) -> bool {
        self.late.zip(self.done).is_some_and(|(late, done)| done.elapsed() > late)
    }

    /// Prints a line if something has changed or a second has passed; of a live source with the age of its last picture.
    fn update(&mut self, status: &Status, age: Age) {
        let mut status = status.clone();
        if self.is_late() && status.phase != Phase::Error {
            (status.phase, status.valid) = (Phase::WaitFrames, false);
            status.waits.clear();
            status.events.clear();
        }
        if self.printed.as_ref().is_some_and(|printed| !is_news(printed, &status)) {
            return;
        }
        // If nobody reads any more, the run continues.
        let _ = writeln!(self.out, "status: {status}{}", latency(age));
        self.printed = Some(status);
    }

    /// Prints a line if the next picture has become late since the last one.
    fn look(&mut self) {
        if let (true, Some(printed)) = (self.is_late(), self.printed.clone())
            && printed.phase != Phase::WaitFrames
        {
            self.update(&printed, Age::default());
        }
    }
}

impl Sink for StatusLines {
    fn frame(&mut self, frame: &Frame) {
        self.lines().done = Some(Instant::now());
        frame.here.iter().for_each(|here| self.update_from(here.session));
    }

    fn step(&mut self, step: &mut Step) {
        step.here.iter().for_each(|(session, _)| self.update_from(session));
    }
}

fn latency(age: Age) -> String {
    match age {
        Age::Recorded => String::new(),
        Age::Unknown => "; the picture's age is not known".into(),
        Age::Known { age_s, bound_s, .. } => {
            let late = if age.is_stale() { ", too old to guide" } else { "" };
            format!("; picture {:.0} ms old{}{late}", 1e3 * age_s, bound(bound_s))
        }
    }
}

fn bound(bound_s: f64) -> String {
    if bound_s > 0.0 { format!(" +- {:.0} ms", 1e3 * bound_s) } else { String::new() }
}

fn is_news(printed: &Status, now: &Status) -> bool {
    let key = |s: &Status| (s.phase, s.map, s.initialised, s.valid);
    let happened = now.frames > printed.frames && !now.events.is_empty();
    happened || key(printed) != key(now) || now.t_s - printed.t_s >= INTERVAL_S
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    impl Shared {
        /// The phases that were printed.
        fn phases(&self) -> String {
            let text = String::from_utf8(self.0.lock().unwrap().clone()).unwrap();
            let phase = |line: &str| {
                line.split_whitespace().nth(3).unwrap_or_default().trim_matches([',', ';']).to_owned()
            };
            text.lines().map(phase).collect::<Vec<_>>().join(" ")
        }
    }

    fn tracking(t_s: f64) -> Status {
        Status { phase: Phase::Tracking, valid: true, t_s, ..Status::default() }
    }

    #[test]
    fn a_picture_that_takes_long_is_said_to_be_waited_for_meanwhile() {
        let out = Shared::default();
        let mut lines = StatusLines::to(Box::new(out.clone()));
        let watch = lines.watch(20.0).unwrap();
        let mut done = |t_s: f64| {
            lines.frame(&Frame { has_pose: true, here: None });
            lines.lines().update(&tracking(t_s), Age::default());
        };
        for k in 0..3 {
            done(0.1 * f64::from(k));
            std::thread::sleep(Duration::from_millis(100));
        }
        assert_eq!(out.phases(), "LOADING_VOCAB TRACKING", "pictures in time");
        // The next one takes longer; what still believes to be tracking does not contradict.
        std::thread::sleep(Duration::from_millis(250));
        lines.lines().update(&tracking(0.4), Age::default());
        assert_eq!(out.phases(), "LOADING_VOCAB TRACKING WAIT_FRAMES");
        lines.frame(&Frame { has_pose: true, here: None });
        lines.lines().update(&tracking(0.5), Age::default());
        assert_eq!(out.phases(), "LOADING_VOCAB TRACKING WAIT_FRAMES TRACKING");
        // After the last picture nothing is waited for.
        drop(watch);
        std::thread::sleep(Duration::from_millis(300));
        assert_eq!(out.phases(), "LOADING_VOCAB TRACKING WAIT_FRAMES TRACKING");
    }

    #[test]
    fn pictures_of_a_slow_source_are_not_late() {
        let out = Shared::default();
        let mut lines = StatusLines::to(Box::new(out.clone()));
        let _watch = lines.watch(4.0).unwrap();
        lines.frame(&Frame { has_pose: true, here: None });
        lines.lines().update(&tracking(0.0), Age::default());
        std::thread::sleep(Duration::from_millis(400));
        assert_eq!(out.phases(), "LOADING_VOCAB TRACKING");
    }
}
