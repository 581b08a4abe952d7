//! What is looked for in packets at any time.

use cairn_sensor::FramePacket;

/// Looks for one fault.
pub(super) trait Watch: Send {
    /// Takes a packet; the doubt, once.
    fn packet(&mut self, packet: &FramePacket) -> Option<String>;
}
