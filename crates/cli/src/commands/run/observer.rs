//! The interface between `cairn run` and its session: counts frames, passes announcements to a voice, reads commands
//! from the terminal.

use super::events::Events;
use super::map::Saver;
use super::mcap;
use super::rerun;
use super::status::StatusLines;
use super::tally::Tally;
use crate::failure::Failure;
use crate::interrupt;
use crate::progress::Progress;
use crate::terminal::Terminal;
use cairn_engine::{DenseMapper, Output};
use cairn_sensor::FramePacket;
use cairn_session::{Command, Event, NotTracked, Observer, Refused, Session};
use cairn_voice::Voice;
use tracing::{debug, info, trace};

/// Callbacks of a run.
pub struct RunObserver<'t, 'a> {
    /// Counts and times.
    pub tally: &'t mut Tally,
    progress: Progress,
    status: Option<StatusLines>,
    voice: Box<dyn Voice>,
    terminal: Terminal,
    saver: Saver<'a>,
    events: &'t mut Option<Events>,
    mcap: Option<&'t mut mcap::Recording>,
    rerun: Option<&'t mut rerun::Scene>,
    dense: Option<&'t mut DenseMapper>,
    /// Whether the signal that ends the run has been passed on.
    quitting: bool,
    /// The replay has reached the end of its journal or a difference.
    replay_stopped: bool,
}

impl<'t, 'a> RunObserver<'t, 'a> {
    /// Callbacks for a run of `frames` frames, where that is known.
    pub fn new(
        tally: &'t mut Tally,
        frames: Option<usize>,
        voice: Box<dyn Voice>,
        terminal: Terminal,
        saver: Saver<'a>,
        events: &'t mut Option<Events>,
        status: Option<StatusLines>,
    ) -> Self {
        // Status lines and a progress bar would disturb each other.
        let progress = if status.is_some() { Progress::hidden() } else { Progress::new(frames) };
        Self {
            tally,
            progress,
            status,
            voice,
            terminal,
            saver,
            events,
            mcap: None,
            rerun: None,
            dense: None,
            quitting: false,
            replay_stopped: false,
        }
    }

    /// Also writes the run to an MCAP file, if there is one.
    pub fn with_mcap(mut self, mcap: Option<&'t mut mcap::Recording>) -> Self {
        self.mcap = mcap;
        self
    }

    /// Also writes the run to a recording of rerun, if there is one.
    pub fn with_rerun(mut self, rerun: Option<&'t mut rerun::Scene>) -> Self {
        self.rerun = rerun;
        self
    }

    /// Also makes surfaces of the depth.
    pub fn with_dense(mut self, dense: Option<&'t mut DenseMapper>) -> Self {
        self.dense = dense;
        self
    }

    /// Waits until the last announcement has been given, unless a signal ended the run and it is given `aloud`; returns
    /// the saver, which still has to be ended.
    pub fn end(mut self, aloud: bool) -> (Saver<'a>, Result<(), Failure>) {
        let voice_ended = match aloud && interrupt::requested() {
            true => Ok(()),
            false => self.voice.end().map_err(super::say::fail),
        };
        (self.saver, voice_ended)
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

impl Observer for RunObserver<'_, '_> {
    fn on_event(&mut self, _: &Session, event: &Event) {
        match event {
            Event::Said(said) => {
                if let Some(mcap) = &mut self.mcap {
                    mcap.said(said);
                }
                if let Some(rerun) = &mut self.rerun {
                    rerun.said(said);
                }
                self.voice.set_language(said.language);
                self.voice.say(&said.text, said.t_s, said.interrupts);
            }
            Event::Sound(s) => self.voice.sound(s.earcon, s.bearing_rad, s.t_s),
        }
    }

    fn on_output(&mut self, session: &Session, packet: &FramePacket, output: &Result<Output, NotTracked>) {
        match output {
            Ok(done) => {
                if let Some(cause) = done.stage_failed() {
                    self.progress.warn(cause);
                }
                self.tally.frame(packet, done);
                let history = &mut self.tally.history;
                if history.wants_size(done.stamp) {
                    history.size(done.stamp, &session.engine().snapshot());
                }
                log(done);
                if let Some(events) = self.events {
                    events.write(done.stamp, done.verdicts());
                }
                if let Some(dense) = &mut self.dense {
                    dense.on_packet(packet, done);
                }
                if let Some(mcap) = &mut self.mcap {
                    mcap.frame(packet, done, session.engine());
                }
                if let Some(rerun) = &mut self.rerun {
                    rerun.frame(packet, done, session, self.dense.as_deref());
                }
            }
            Err(why) => self.tally.rejected(packet, why),
        }
        let status = session.engine_status();
        if let Some(lines) = &mut self.status {
            lines.update(&status, session.age());
        }
        if let Ok(done) = output {
            self.tally.history.events(done.stamp, &status.events);
        }
        self.tally.status.add(status);
        self.replay_stopped = session.engine().replayed().is_some_and(|r| r.stopped.is_some());
        self.progress.step(self.tally.frames);
    }

    fn on_command(&mut self, _: &Session, _: &Command, done: &Result<String, Refused>) {
        if let Err(why) = done {
            self.progress.warn(&why.words);
        }
    }

    fn on_step(&mut self, session: &mut Session) {
        self.voice.pass(session.elapsed_s());
        if let Some(lines) = &mut self.status {
            lines.update(&session.engine_status(), session.age());
        }
        let dense = self.dense.as_deref_mut();
        self.saver.save_if_due(session, dense, |text| self.progress.warn(text));
    }

    fn take_commands(&mut self) -> Vec<Command> {
        let (mut commands, mistakes) = self.terminal.asked();
        mistakes.iter().for_each(|why| self.progress.warn(&why.to_string()));
        if interrupt::requested() && !std::mem::replace(&mut self.quitting, true) {
            self.progress.warn("interrupted: writing what there is; press Ctrl-C again to stop at once");
            commands.push(Command::Quit);
        }
        commands.extend(self.replay_stopped.then_some(Command::Quit));
        commands
    }
}
