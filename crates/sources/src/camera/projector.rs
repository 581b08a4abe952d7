//! The projector of a RealSense D4xx: off while its infrared pair is read without depth, since its dots move with the camera and
//! would be tracked; afterwards as it was.
//!
//! It is a control of the extension unit for depth. Unit, selector and values are those that the vendor's SDK uses
//! (`depth_xu` and `DEPTH_EMITTER_ENABLED` of librealsense); the number of the unit is taken from the device's descriptors.

use super::device::{Dequeued, DeviceError, ExtensionControl, Mode, VideoNode};
use std::time::Duration;

/// C9606CCB-594C-4D25-AF47-CCC496435995 as it stands in a descriptor: the first three groups with the lowest byte first.
const DEPTH_UNIT: [u8; 16] =
    [0xcb, 0x6c, 0x60, 0xc9, 0x4c, 0x59, 0x25, 0x4d, 0xaf, 0x47, 0xcc, 0xc4, 0x96, 0x43, 0x59, 0x95];
/// One byte: 0 off, 1 on, 2 as the camera decides.
pub const EMITTER: ExtensionControl = ExtensionControl { unit: DEPTH_UNIT, selector: 2 };
const OFF: u8 = 0;

/// Switches the projector of a node's device off for as long as the node is open. With the reason where that cannot be done:
/// the node is as it was then.
pub fn darken(mut node: Box<dyn VideoNode>) -> (Box<dyn VideoNode>, Option<DeviceError>) {
    let before = node.control(EMITTER).and_then(|before| {
        if before != OFF {
            node.set_control(EMITTER, OFF)?;
        }
        Ok(before)
    });
    match before {
        Ok(OFF) => (node, None),
        Ok(before) => (Box::new(Darkened { node, before }), None),
        Err(e) => (node, Some(e)),
    }
}

/// A node whose device was switched to darkness.
struct Darkened {
    node: Box<dyn VideoNode>,
    before: u8,
}

impl VideoNode for Darkened {
    fn modes(&mut self) -> Result<Vec<Mode>, DeviceError> {
        self.node.modes()
    }

    fn start(&mut self, wanted: &Mode) -> Result<Mode, DeviceError> {
        self.node.start(wanted)
    }

    fn dequeue(&mut self, wait: Duration, into: &mut Vec<u8>) -> Result<Option<Dequeued>, DeviceError> {
        self.node.dequeue(wait, into)
    }

    fn control(&mut self, control: ExtensionControl) -> Result<u8, DeviceError> {
        self.node.control(control)
    }

    fn set_control(&mut self, control: ExtensionControl, value: u8) -> Result<(), DeviceError> {
        self.node.set_control(control, value)
    }
}

impl Drop for Darkened {
    fn drop(&mut self) {
        // A camera that was unplugged forgets it by itself.
        let _ = self.node.set_control(EMITTER, self.before);
    }
}
