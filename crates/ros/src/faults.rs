//! What goes wrong, said once for each reason and counted from then on.

use cairn::sensor::{SkipKind, Skips};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How serious a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// For information.
    Info,
    /// Something is missing or wrong; the node goes on.
    Warn,
    /// The node cannot do its work.
    Error,
}

/// Which lines the node says, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Log {
    /// Lines below this are not said.
    pub least: Severity,
    /// On the standard error output.
    pub to_terminal: bool,
    /// On /rosout.
    pub to_rosout: bool,
}

impl Default for Log {
    fn default() -> Self {
        Self { least: Severity::Info, to_terminal: true, to_rosout: true }
    }
}

type Sink = Box<dyn Fn(Severity, &str) + Send>;

#[derive(Default)]
struct State {
    skips: Skips,
    log: Log,
    sink: Option<Sink>,
}

/// Counts and says; clones refer to the same.
#[derive(Clone, Default)]
pub struct Faults(Arc<Mutex<State>>);

impl Faults {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts all, and says what `log` lets through.
    pub fn new(log: &Log) -> Self {
        Self(Arc::new(Mutex::new(State { log: log.clone(), ..State::default() })))
    }

    /// Where lines go besides the standard error output.
    pub fn also_to(&self, sink: Sink) {
        self.lock().sink = Some(sink);
    }

    /// Says a line.
    pub fn say(&self, severity: Severity, line: &str) {
        let prefix = match severity {
            Severity::Info => "",
            Severity::Warn => "warning: ",
            Severity::Error => "error: ",
        };
        let state = self.lock();
        if severity < state.log.least {
            return;
        }
        if state.log.to_terminal {
            eprintln!("cairn-ros: {prefix}{line}");
        }
        if let Some(sink) = state.sink.as_ref().filter(|_| state.log.to_rosout) {
            sink(severity, line);
        }
    }

    /// Counts one, and says it if it is the first for this reason. `details` tell of the first one only.
    pub fn count(&self, kind: SkipKind, reason: &str, details: &str) {
        let first = {
            let mut state = self.lock();
            let before = state.skips.iter().count();
            state.skips.add_many(kind, reason, 1, details);
            state.skips.iter().count() > before
        };
        if first {
            let more = if details.is_empty() { String::new() } else { format!(": {details}") };
            self.say(Severity::Warn, &format!("{reason}{more} (said once; the count is in the diagnostics)"));
        }
    }

    /// The counts so far.
    pub fn counts(&self) -> Skips {
        self.lock().skips.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_leaves_out_what_is_less_serious() {
        let faults = Faults::new(&Log { least: Severity::Warn, ..Log::default() });
        let said = Arc::new(Mutex::new(Vec::new()));
        let lines = said.clone();
        faults.also_to(Box::new(move |severity, _| lines.lock().unwrap().push(severity)));
        for severity in [Severity::Info, Severity::Warn, Severity::Error] {
            faults.say(severity, "a line");
        }
        assert_eq!(*said.lock().unwrap(), [Severity::Warn, Severity::Error]);
    }

    #[test]
    fn a_reason_is_said_once_and_counted() {
        let faults = Faults::default();
        let said = Arc::new(Mutex::new(Vec::new()));
        let lines = said.clone();
        faults
            .also_to(Box::new(move |severity, line| lines.lock().unwrap().push((severity, line.to_owned()))));
        for k in 0..1000 {
            faults.count(SkipKind::Imu, "/imu: a number is not finite", &format!("at {k} s"));
        }
        faults.count(SkipKind::Frame, "/left: the time is repeated", "");
        let said = said.lock().unwrap();
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(said[0].1.contains("at 0 s") && said[0].0 == Severity::Warn);
        assert_eq!((faults.counts().count(SkipKind::Imu), faults.counts().total()), (1000, 1001));
    }
}
