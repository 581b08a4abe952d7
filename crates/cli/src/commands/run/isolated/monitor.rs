//! What is shown, said and counted while the run goes on.

use super::super::Arguments;
use crate::processes::line;
use crate::progress::Progress;
use cairn_guide::{Cue, CueKind, StopReason};
use cairn_sensor::Stamp;
use cairn_voice::Voice;
use cairn_workers::message::Said;
use cairn_workers::{Death, Role, RunEvent};
use std::time::Instant;

/// What is shown and counted while the run goes on.
pub(super) struct Monitor {
    began: Instant,
    pub(super) progress: Progress,
    frames: usize,
    pub(super) first_pose_s: Option<f64>,
    first: Option<Stamp>,
    /// Seconds from the first frame to the last.
    t_s: f64,
    pub(super) voice: Box<dyn Voice>,
    /// What is said when the guide itself has died.
    guide_died: String,
}

impl Monitor {
    pub(super) fn new(a: &Arguments, began: Instant, voice: Box<dyn Voice>) -> Self {
        let language = a.speaking.language;
        Self {
            began,
            progress: Progress::new(None),
            frames: 0,
            first_pose_s: None,
            first: None,
            t_s: 0.0,
            voice,
            guide_died: stop_words(a, StopReason::StageDied)
                .unwrap_or_else(|| language.text("stop-stage-died")),
        }
    }

    fn died(&mut self, death: &Death) {
        if death.role == Role::Guide {
            self.voice.say(&self.guide_died, self.t_s, true);
        }
    }

    fn said(&mut self, said: &Said) {
        match said {
            Said::Words { text, t_s, interrupts } => self.voice.say(text, *t_s, *interrupts),
            Said::Sound { earcon, bearing_rad, t_s } => {
                if let Some(earcon) = cairn_workers::guide::earcon_of(*earcon) {
                    self.voice.sound(earcon, *bearing_rad, *t_s);
                }
            }
        }
    }

    pub(super) fn tell(&mut self, told: &RunEvent) {
        line(told).iter().for_each(|line| self.progress.note(line));
        match told {
            RunEvent::Opened(opened) => self.progress = Progress::new(opened.frames),
            RunEvent::Tracked(frame) => {
                self.frames += 1;
                let stamp = Stamp(frame.stamp);
                self.t_s = stamp - *self.first.get_or_insert(stamp);
                self.voice.pass(self.t_s);
                if frame.pose.is_some() {
                    self.first_pose_s.get_or_insert(self.began.elapsed().as_secs_f64());
                }
                self.progress.step(self.frames);
            }
            RunEvent::Died(death) => self.died(death),
            RunEvent::Said(said) => self.said(said),
            _ => {}
        }
    }
}

/// The sentence that stops the walker.
fn stop_words(a: &Arguments, reason: StopReason) -> Option<String> {
    let cue = Cue { stamp: Stamp::default(), facing: a.facing.facing(), kind: CueKind::Stop(reason) };
    a.speaking.phrases().words(&cue)
}
