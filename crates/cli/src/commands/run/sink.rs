//! What becomes of a run: one trait for all that follows its frames, its words and its end.
//!
//! In: frames, events, the passing of time and the end, of a run in this process or in others; sinks see the same of both,
//! and of a run in this process also its session. Out: files, speech, lines.

use super::outcome::Outcome;
use super::poses::Poses;
use crate::failure::Failure;
use cairn_atlas::store::MapFile;
use cairn_engine::{DenseMapper, Finished, Output, PoseTime};
use cairn_sensor::{FramePacket, Stamp};
use cairn_session::{Event, NotTracked, Session};
use std::collections::BTreeMap;
use std::path::Path;

/// Something that becomes of a run.
pub trait Sink {
    /// A frame is done.
    fn frame(&mut self, _: &Frame) {}
    /// An utterance or a sound starts.
    fn event(&mut self, _: &Event) {}
    /// Time has passed: after each frame, and of a live source about twenty times a second.
    fn step(&mut self, _: &mut Step) {}
    /// There are no more frames: writes what is left.
    ///
    /// # Errors
    /// What could not be written.
    fn end(self: Box<Self>, _: &mut Ended) -> Result<(), Failure> {
        Ok(())
    }
}

/// A frame that is done.
pub struct Frame<'a> {
    /// Whether its pose is known.
    pub has_pose: bool,
    /// Of a run in this process.
    pub here: Option<Processed<'a>>,
}

/// A frame with what this process has of it.
pub struct Processed<'a> {
    pub session: &'a Session,
    /// The surfaces of the depth until this frame, where they are made.
    pub dense: Option<&'a DenseMapper>,
    pub packet: &'a FramePacket,
    pub output: &'a Result<Output, NotTracked>,
}

impl Frame<'_> {
    /// What the engine made of it, if it did so in this process and rejected nothing.
    pub fn output(&self) -> Option<(&Processed<'_>, &Output)> {
        let here = self.here.as_ref()?;
        Some((here, here.output.as_ref().ok()?))
    }
}

/// A moment of the run.
pub struct Step<'a> {
    /// Seconds since the first frame.
    pub t_s: f64,
    /// Of a run in this process: its session, and its surfaces where they are made.
    pub here: Option<(&'a Session, Option<&'a mut DenseMapper>)>,
}

/// A run whose frames are all done, in this process or in others.
pub trait Run {
    /// The poses that trajectories hold, of all tracked frames.
    fn poses(&self, time: PoseTime) -> Poses;
    /// The map with these attachments; `None` where it is empty.
    fn map(&mut self, attached: &BTreeMap<String, Vec<u8>>) -> Option<MapFile>;
    /// The surface in the form of the ending of this file.
    ///
    /// # Errors
    /// When there is none.
    fn surface(&mut self, path: &Path) -> Result<Vec<u8>, Failure>;
    /// Completes the route that is recorded.
    ///
    /// # Errors
    /// When its file does not hold all of it.
    fn close_recording(&mut self) -> Result<(), Failure>;
    /// What the run came to.
    fn outcome(&mut self) -> Outcome;
    /// The run, where it is in this process.
    fn here(&mut self) -> Option<&mut Here> {
        None
    }
}

/// A run in this process.
pub struct Here {
    pub session: Session,
    /// The surfaces of the depth, where they are made.
    pub dense: Option<DenseMapper>,
    /// What was done after the last frame.
    pub finished: Finished,
    /// The time of the last frame.
    pub last: Stamp,
}

/// The end of a run.
pub struct Ended<'a> {
    pub run: &'a mut dyn Run,
    /// Whether anything has failed until now.
    pub failed: bool,
    outcome: Option<Outcome>,
}

impl<'a> Ended<'a> {
    /// The end of this run.
    pub fn new(run: &'a mut dyn Run) -> Self {
        Self { run, failed: false, outcome: None }
    }

    /// What the run came to, when this was first asked for.
    pub fn outcome(&mut self) -> &Outcome {
        self.outcome.get_or_insert_with(|| self.run.outcome())
    }

    /// The same, with the run.
    pub fn parts(&mut self) -> (&Outcome, &mut dyn Run) {
        (self.outcome.get_or_insert_with(|| self.run.outcome()), &mut *self.run)
    }
}
