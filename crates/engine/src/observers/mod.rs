//! What follows from a frame, one file each; a new one is a field and a line in [`Observers::list`].

mod depth_views;
mod failures;
mod frame_log;
mod journal;
mod observer;
mod scale_report;
mod search_link;
mod status_report;

pub(crate) use observer::{DoneFrame, Observer, TrackedFrame, TrackingInput};
pub(crate) use scale_report::ScaleReport;
pub(crate) use search_link::SearchLink;
pub(crate) use status_report::StatusReport;

use crate::log::Log;
use crate::output::Output;
use cairn_mapping::DepthViews;
use cairn_sensor::FramePacket;
use failures::Failures;
use journal::FrameJournal;

/// The observers of an engine's frames.
pub(crate) struct Observers {
    pub search: SearchLink,
    pub depth_views: Option<DepthViews>,
    pub scale: ScaleReport,
    pub failures: Failures,
    pub journal: FrameJournal,
    pub log: Log,
    pub status: StatusReport,
}

impl Observers {
    pub fn new(depth_views: Option<DepthViews>, scale: ScaleReport, status: StatusReport) -> Self {
        Self {
            search: SearchLink::default(),
            depth_views,
            scale,
            failures: Failures::default(),
            journal: FrameJournal,
            log: Log::default(),
            status,
        }
    }

    /// All of them, in the order in which they are told; the log has what the scale report says, and the status the failures.
    fn list(&mut self) -> impl Iterator<Item = &mut dyn Observer> {
        let Self { search, depth_views, scale, failures, journal, log, status } = self;
        let views = depth_views.as_mut().map(|views| views as &mut dyn Observer);
        let others: [&mut dyn Observer; 6] = [search, scale, failures, journal, log, status];
        views.into_iter().chain(others)
    }
}

impl Observer for Observers {
    fn refused(&mut self, packet: &FramePacket, why: &str) {
        self.list().for_each(|o| o.refused(packet, why));
    }

    fn tracked(&mut self, frame: &TrackedFrame) {
        self.list().for_each(|o| o.tracked(frame));
    }

    fn done(&mut self, frame: &mut DoneFrame, output: &mut Output) {
        self.list().for_each(|o| o.done(frame, output));
    }

    fn failed(&mut self, why: &str) {
        self.list().for_each(|o| o.failed(why));
    }
}
