//! Whether depth that is said to be registered to the first camera's picture is: [`RegistrationCheck`] twice a second, until it knows.

use super::watch::Watch;
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_vision::RegistrationCheck;

/// Seconds between two looks.
const APART_S: f64 = 0.5;

/// Whether depth is registered to the picture, as the rig says.
#[derive(Clone, Debug)]
pub(super) struct RegistrationWatch {
    check: RegistrationCheck,
    last: Option<Stamp>,
}

impl RegistrationWatch {
    /// For the depth sensor of a rig; `None` where it is not said to be registered.
    pub fn new(rig: &Rig) -> Option<Self> {
        let depth = rig.depth.as_ref().filter(|depth| depth.registered);
        depth.map(|_| Self { check: RegistrationCheck::default(), last: None })
    }
}

impl Watch for RegistrationWatch {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let is_due = self.last.is_none_or(|last| packet.stamp - last >= APART_S);
        let (depth, picture) = packet.depth.as_ref().zip(packet.images.first())?;
        if self.check.is_sure() || !is_due {
            return None;
        }
        self.last = Some(packet.stamp);
        self.check.look(depth, picture);
        let found = self.check.found()?;
        Some(format!(
            "{found}: depth is not registered to it as the calibration says, and depths at features are those of other points; give a \
             rig with the depth camera's own calibration, or take poses from depth (--front-end dense)"
        ))
    }
}
