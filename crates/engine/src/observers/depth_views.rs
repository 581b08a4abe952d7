//! Keeps the depth of frames that may become key frames, for the alignment of key frames by depth.

use super::observer::{Observer, TrackedFrame};
use cairn_mapping::DepthViews;

impl Observer for DepthViews {
    fn tracked(&mut self, frame: &TrackedFrame) {
        if let Some(depth) = frame.packet.depth.as_ref().filter(|_| frame.key_frame_requested) {
            self.offer(frame.packet.stamp, depth.clone());
        }
    }
}
