//! Whether depth that is said to be registered to the first camera's picture is, as [`RegistrationCheck`] finds.

use super::watch::Watch;
use cairn_sensor::FramePacket;
use cairn_vision::RegistrationCheck;

impl Watch for RegistrationCheck {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        let found = RegistrationCheck::packet(self, packet)?;
        Some(format!(
            "{found}: depth is not registered to it as the calibration says, and depths at features are those of other points: poses are \
             taken from depth from here on; a rig with the depth camera's own calibration may be better"
        ))
    }
}
