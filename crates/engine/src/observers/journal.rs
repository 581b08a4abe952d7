//! Writes a digest of every frame to the journal, or compares it with that of a journal that is replayed.

use super::observer::{DoneFrame, Observer};
use crate::digest::Digest;
use crate::journal::FrameRecord;
use crate::output::Output;

/// The frames of the journal; where mapping runs, it is written or replayed.
pub(crate) struct FrameJournal;

impl Observer for FrameJournal {
    fn done(&mut self, frame: &mut DoneFrame, output: &mut Output) {
        let mut digest = Digest::default();
        frame.earlier.iter().for_each(|(_, anchored)| digest.anchored(Some(anchored)));
        digest.state(output.state);
        digest.anchored(output.pose.map(|pose| pose.anchored).as_ref());
        let record = FrameRecord {
            stamp: frame.packet.stamp,
            version: frame.input.version,
            idle: frame.input.idle,
            map_created: frame.map_created,
            digest: digest.value(),
        };
        frame.mapping.record_frame(&record);
    }
}
