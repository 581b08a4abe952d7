//! `--status`: status lines on stderr.

use super::sink::{Frame, Sink, Step};
use cairn_engine::Status;
use cairn_session::{Age, Session};
use std::io::Write;

/// Longest time between two status lines, seconds of the source's time.
const INTERVAL_S: f64 = 1.0;

/// Prints complete lines, one below the other, so that a screen reader can follow.
#[derive(Default)]
pub struct StatusLines {
    printed: Option<Status>,
}

impl StatusLines {
    /// The first line, before there is a session.
    pub fn begin() -> Self {
        let mut lines = Self::default();
        lines.update(&Status::default(), Age::default());
        lines
    }

    /// The same of a session.
    pub fn update_from(&mut self, session: &Session) {
        self.update(&session.engine_status(), session.age());
    }

    /// Prints a line if something has changed or a second has passed; of a live source with the age of its last picture.
    fn update(&mut self, status: &Status, age: Age) {
        if self.printed.as_ref().is_some_and(|printed| !is_news(printed, status)) {
            return;
        }
        // If stderr is closed, the run continues.
        let _ = writeln!(std::io::stderr().lock(), "status: {status}{}", latency(age));
        self.printed = Some(status.clone());
    }
}

impl Sink for StatusLines {
    fn frame(&mut self, frame: &Frame) {
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
