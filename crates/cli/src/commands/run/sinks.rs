//! The sinks of a run as a list, in the order in which they hear of a frame and end.

use super::sink::{Ended, Frame, Processed, Run, Sink, Step};
use super::tally::Tally;
use crate::failure::Failure;
use crate::interrupt;
use crate::progress::Progress;
use crate::terminal::Terminal;
use cairn_engine::{DenseMapper, Output};
use cairn_sensor::FramePacket;
use cairn_session::{Command, Event, NotTracked, Observer, Refused, Session};
use std::rc::Rc;
use tracing::{debug, info, trace};

/// The list.
pub struct Sinks<'a> {
    /// On a terminal; cleared before the sinks end.
    pub progress: Rc<Progress>,
    list: Vec<Box<dyn Sink + 'a>>,
}

impl<'a> Sinks<'a> {
    /// An empty list.
    pub fn new(progress: Progress) -> Self {
        Self { progress: Rc::new(progress), list: Vec::new() }
    }

    /// Appends a sink, if there is one.
    pub fn add<S: Sink + 'a>(&mut self, sink: Option<S>) {
        self.list.extend(sink.map(|sink| Box::new(sink) as Box<dyn Sink + 'a>));
    }

    /// Appends what is done at the end only.
    pub fn at_end(&mut self, end: impl FnOnce(&mut Ended) -> Result<(), Failure> + 'a) {
        self.add(Some(AtEnd(end)));
    }

    /// A frame is done.
    pub fn frame(&mut self, tally: &mut Tally, frame: &Frame) {
        tally.frame(frame);
        self.list.iter_mut().for_each(|sink| sink.frame(frame));
        self.progress.step(tally.frames);
    }

    /// An utterance or a sound starts.
    pub fn event(&mut self, event: &Event) {
        self.list.iter_mut().for_each(|sink| sink.event(event));
    }

    /// Time has passed.
    pub fn step(&mut self, step: &mut Step) {
        self.list.iter_mut().for_each(|sink| sink.step(step));
    }

    /// Ends them all, whatever fails; returns all failures, `before` first.
    pub fn end(self, run: &mut dyn Run, before: Option<Failure>) -> (Vec<Failure>, Ended<'_>) {
        self.progress.clear();
        let mut failures: Vec<Failure> = before.into_iter().collect();
        let mut ended = Ended::new(run);
        for sink in self.list {
            ended.failed = !failures.is_empty();
            failures.extend(sink.end(&mut ended).err());
        }
        (failures, ended)
    }
}

/// A sink that hears of nothing but the end.
struct AtEnd<F>(F);

impl<F: FnOnce(&mut Ended) -> Result<(), Failure>> Sink for AtEnd<F> {
    fn end(self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        (self.0)(ended)
    }
}

/// Passes a session in this process to the sinks, and commands of the terminal to the session.
pub struct Follow<'t, 'a> {
    pub sinks: &'t mut Sinks<'a>,
    pub tally: &'t mut Tally,
    pub dense: Option<&'t mut DenseMapper>,
    terminal: Terminal,
    /// Whether the signal that ends the run has been passed on.
    quitting: bool,
    /// The replay has reached the end of its journal or a difference.
    replay_stopped: bool,
}

impl<'t, 'a> Follow<'t, 'a> {
    /// From the first frame on.
    pub fn new(
        sinks: &'t mut Sinks<'a>,
        tally: &'t mut Tally,
        dense: Option<&'t mut DenseMapper>,
        terminal: Terminal,
    ) -> Self {
        Self { sinks, tally, dense, terminal, quitting: false, replay_stopped: false }
    }
}

impl Observer for Follow<'_, '_> {
    fn on_event(&mut self, _: &Session, event: &Event) {
        self.sinks.event(event);
    }

    fn on_output(&mut self, session: &Session, packet: &FramePacket, output: &Result<Output, NotTracked>) {
        if let Ok(done) = output {
            if let Some(cause) = done.stage_failed() {
                self.sinks.progress.warn(cause);
            }
            log(done);
            if let Some(dense) = &mut self.dense {
                dense.on_packet(packet, done);
            }
        }
        let has_pose = output.as_ref().is_ok_and(|done| done.pose.is_some());
        let here = Processed { session, dense: self.dense.as_deref(), packet, output };
        self.sinks.frame(self.tally, &Frame { has_pose, here: Some(here) });
        self.replay_stopped = session.engine().replayed().is_some_and(|r| r.stopped.is_some());
    }

    fn on_command(&mut self, _: &Session, _: &Command, done: &Result<String, Refused>) {
        if let Err(why) = done {
            self.sinks.progress.warn(&why.words);
        }
    }

    fn on_step(&mut self, session: &mut Session) {
        let here = Some((&*session, self.dense.as_deref_mut()));
        self.sinks.step(&mut Step { t_s: session.elapsed_s(), here });
    }

    fn take_commands(&mut self) -> Vec<Command> {
        let (mut commands, mistakes) = self.terminal.asked();
        mistakes.iter().for_each(|why| self.sinks.progress.warn(&why.to_string()));
        if interrupt::requested() && !std::mem::replace(&mut self.quitting, true) {
            self.sinks
                .progress
                .warn("interrupted: writing what there is; press Ctrl-C again to stop at once");
            commands.push(Command::Quit);
        }
        commands.extend(self.replay_stopped.then_some(Command::Quit));
        commands
    }
}

/// Logs what a frame brought, for RUST_LOG.
fn log(done: &Output) {
    let at = done.stamp.seconds();
    trace!(at, state = ?done.state, extract_ms = done.timings.extract_ms, track_ms = done.timings.track_ms, "frame");
    for v in done.verdicts() {
        let (key_frame, candidate) = (v.key_frame.index(), v.candidate.index());
        match &v.result {
            Ok(accepted) => {
                info!(at, key_frame, candidate, joined = ?accepted.joined, off = accepted.off, "recognised")
            }
            Err(refusal) => debug!(at, key_frame, candidate, ?refusal, "refused"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::run::outcome::Outcome;
    use crate::commands::run::poses::Poses;
    use cairn_atlas::store::MapFile;
    use cairn_engine::{CameraPoses, PoseTime};
    use cairn_eval::RunReport;
    use cairn_geometry::Se3;
    use std::cell::RefCell;
    use std::collections::BTreeMap;
    use std::path::Path;
    use std::time::Instant;

    /// A run of no frames that counts how often it is asked what it came to.
    struct NoFrames(usize);

    impl Run for NoFrames {
        fn poses(&self, _: PoseTime) -> Poses {
            let of_camera = CameraPoses { body_from_camera: Se3::identity(), poses: Vec::new() };
            Poses { of_camera, cam0: None, frames: 0 }
        }
        fn map(&mut self, _: &BTreeMap<String, Vec<u8>>) -> Option<MapFile> {
            None
        }
        fn surface(&mut self, _: &Path) -> Result<Vec<u8>, Failure> {
            Ok(Vec::new())
        }
        fn close_recording(&mut self) -> Result<(), Failure> {
            Ok(())
        }
        fn outcome(&mut self) -> Outcome {
            self.0 += 1;
            Tally::new(Instant::now()).outcome(RunReport::default())
        }
    }

    /// Writes down what it hears, and fails at the end if it is told to.
    struct Listener<'t>(&'static str, bool, &'t RefCell<Vec<String>>);

    impl Listener<'_> {
        fn hears(&self, what: &str) {
            self.2.borrow_mut().push(format!("{} {what}", self.0));
        }
    }

    impl Sink for Listener<'_> {
        fn frame(&mut self, frame: &Frame) {
            self.hears(if frame.has_pose { "pose" } else { "frame" });
        }
        fn step(&mut self, step: &mut Step) {
            self.hears(&format!("{} s", step.t_s));
        }
        fn end(self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
            let frames = ended.outcome().report.frames;
            self.hears(&format!("end of {frames}, failed {}", ended.failed));
            if self.1 { Err(Failure::new(self.0, "the disk is full", "free some")) } else { Ok(()) }
        }
    }

    #[test]
    fn all_sinks_hear_in_order_and_end_whatever_fails() {
        let heard = RefCell::new(Vec::new());
        let mut sinks = Sinks::new(Progress::hidden());
        sinks.add(Some(Listener("a", true, &heard)));
        sinks.add(None::<Listener>);
        sinks.add(Some(Listener("b", false, &heard)));
        let mut tally = Tally::new(Instant::now());
        sinks.frame(&mut tally, &Frame { has_pose: true, here: None });
        sinks.step(&mut Step { t_s: 0.5, here: None });
        assert_eq!(tally.frames, 1);
        let mut run = NoFrames(0);
        let (failures, _) = sinks.end(&mut run, None);
        assert_eq!(failures.iter().map(|f| f.what.as_str()).collect::<Vec<_>>(), ["a"]);
        assert_eq!(run.0, 1, "what the run came to is asked for once");
        let ends = ["a end of 0, failed false", "b end of 0, failed true"];
        assert_eq!(*heard.borrow(), [&["a pose", "b pose", "a 0.5 s", "b 0.5 s"][..], &ends].concat());
    }
}
