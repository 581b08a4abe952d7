//! What the supervisor tells of a run, as the frames and events of its sinks.

use super::super::arguments::Arguments;
use super::super::sink::{Frame, Step};
use super::super::sinks::Sinks;
use super::super::tally::Tally;
use crate::processes::line;
use cairn_guide::{Cue, CueKind, Priority, StopReason};
use cairn_sensor::Stamp;
use cairn_session::{Event, Said};
use cairn_workers::message::Tracked;
use cairn_workers::{Role, RunEvent};

/// Passes on what is told.
pub(super) struct Monitor<'t, 'a> {
    a: &'a Arguments,
    sinks: &'t mut Sinks<'a>,
    tally: &'t mut Tally,
    first: Option<Stamp>,
    last: Stamp,
}

impl<'t, 'a> Monitor<'t, 'a> {
    pub(super) fn new(a: &'a Arguments, sinks: &'t mut Sinks<'a>, tally: &'t mut Tally) -> Self {
        Self { a, sinks, tally, first: None, last: Stamp::default() }
    }

    pub(super) fn tell(&mut self, told: &RunEvent) {
        line(told).iter().for_each(|line| self.sinks.progress.note(line));
        match told {
            RunEvent::Opened(opened) => self.sinks.progress.begin(opened.frames),
            RunEvent::Tracked(frame) => self.tracked(frame),
            RunEvent::Said(event) => self.sinks.event(event),
            RunEvent::Died(death) if death.role == Role::Guide => self.guide_died(),
            _ => {}
        }
    }

    fn tracked(&mut self, frame: &Tracked) {
        self.last = Stamp(frame.stamp);
        self.first.get_or_insert(self.last);
        self.sinks.step(&mut Step { t_s: self.t_s(), here: None });
        self.sinks.frame(self.tally, &Frame { has_pose: frame.pose.is_some(), here: None });
    }

    /// Seconds from the first frame to the last.
    fn t_s(&self) -> f64 {
        self.first.map_or(0.0, |first| self.last - first)
    }

    /// The guide cannot say itself that it has died: the walker is to stop.
    fn guide_died(&mut self) {
        let kind = CueKind::Stop(StopReason::StageDied);
        let cue = Cue { stamp: Stamp::default(), facing: self.a.facing.facing(), kind };
        let language = self.a.speaking.language;
        let words = self.a.speaking.phrases().words(&cue);
        let words = words.unwrap_or_else(|| language.text("stop-stage-died"));
        let said = Said::plain(words, language, Priority::Urgent, (self.last, self.t_s()));
        self.sinks.event(&Event::Said(said));
    }
}
