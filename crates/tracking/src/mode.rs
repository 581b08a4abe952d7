//! The mode of tracking: what is known of the camera at present, with the data that only this mode needs.

use cairn_geometry::So3;
use cairn_vision::Frame;
use std::sync::Arc;

/// What tracking is at.
#[derive(Clone, Debug)]
pub(crate) enum Mode {
    /// There is no map yet.
    Starting,
    /// The last frame was located by its features.
    Tracking,
    /// The last frame was not; what else measures the motion carries the pose.
    Coasting(Gap),
    /// It was not either; it differs from the one before by a rotation alone.
    Rotating(Gap),
    /// The pose is not known.
    Lost(Gap),
}

/// Frames that were not located by their features.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gap {
    /// How many, one after the other.
    pub frames: usize,
    /// Since rotation alone was tracked: an earlier frame with its orientation, against which later ones are checked.
    pub checked: Option<(Arc<Frame>, So3)>,
}

impl Mode {
    /// Whether the pose is not known but for its orientation.
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Rotating(_) | Self::Lost(_))
    }

    /// Frames in a row that were not located by their features.
    pub fn missed(&self) -> usize {
        self.gap().map_or(0, |gap| gap.frames)
    }

    /// The frame against which rotations are checked.
    pub fn checked(&self) -> Option<&(Arc<Frame>, So3)> {
        self.gap()?.checked.as_ref()
    }

    /// A frame was not located; what else measures the motion has carried the pose.
    pub fn coast(&mut self) {
        *self = Self::Coasting(self.next_gap());
    }

    /// A frame was not located; it has turned from the one before. Later ones are checked against this frame.
    pub fn rotate(&mut self, checked: (Arc<Frame>, So3)) {
        *self = Self::Rotating(Gap { checked: Some(checked), ..self.next_gap() });
    }

    /// The pose of a frame is not known.
    pub fn lose(&mut self) {
        *self = Self::Lost(self.next_gap());
    }

    /// The pose of no frame is known in this map.
    pub fn unplace(&mut self) {
        *self = Self::Lost(self.take_gap());
    }

    /// Something else than features has found the place.
    pub fn replace(&mut self) {
        *self = Self::Coasting(self.take_gap());
    }

    fn gap(&self) -> Option<&Gap> {
        match self {
            Self::Coasting(gap) | Self::Rotating(gap) | Self::Lost(gap) => Some(gap),
            Self::Starting | Self::Tracking => None,
        }
    }

    fn take_gap(&mut self) -> Gap {
        match self {
            Self::Coasting(gap) | Self::Rotating(gap) | Self::Lost(gap) => std::mem::take(gap),
            Self::Starting | Self::Tracking => Gap::default(),
        }
    }

    fn next_gap(&mut self) -> Gap {
        let gap = self.take_gap();
        Gap { frames: gap.frames + 1, ..gap }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked() -> (Arc<Frame>, So3) {
        (Arc::new(Frame::default()), So3::identity())
    }

    #[test]
    fn a_gap_goes_on_through_all_modes_until_features_locate_a_frame() {
        let mut mode = Mode::Tracking;
        mode.coast();
        assert!(!mode.is_lost() && mode.missed() == 1 && mode.checked().is_none());
        mode.rotate(checked());
        assert!(mode.is_lost() && mode.missed() == 2);
        mode.lose();
        assert!(matches!(mode, Mode::Lost(_)) && mode.missed() == 3);
        assert!(mode.checked().is_some(), "a turn may be seen again");
        mode.replace();
        assert!(!mode.is_lost() && mode.missed() == 3, "no frame came");
        mode.coast();
        assert!(mode.missed() == 4 && mode.checked().is_some());
        mode = Mode::Tracking;
        mode.lose();
        assert!(mode.missed() == 1 && mode.checked().is_none(), "the gap before is over");
    }

    #[test]
    fn a_map_in_which_the_camera_has_no_place_yet_is_lost_without_a_missed_frame() {
        let mut mode = Mode::Starting;
        assert!(!mode.is_lost());
        mode.unplace();
        assert!(mode.is_lost() && mode.missed() == 0);
    }
}
