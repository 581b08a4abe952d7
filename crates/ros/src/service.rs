//! The services of the node and their names.

/// The services, all of type `std_srvs/Trigger`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Service {
    /// Save the map.
    SaveMap,
    /// Begin anew in the saved map.
    LoadMap,
    /// Begin anew without a map.
    Reset,
    /// Record the route.
    Record,
    /// End the recording.
    StopRecording,
    /// Guide back to where the route began.
    GuideHome,
    /// Guide along the route from its start to its end.
    GuideAgain,
    /// End guidance.
    Halt,
}

impl Service {
    /// All.
    pub const ALL: [Self; 8] = [
        Self::SaveMap,
        Self::LoadMap,
        Self::Reset,
        Self::Record,
        Self::StopRecording,
        Self::GuideHome,
        Self::GuideAgain,
        Self::Halt,
    ];

    /// Its name in the node's namespace.
    pub fn name(self) -> &'static str {
        match self {
            Self::SaveMap => "~/save_map",
            Self::LoadMap => "~/load_map",
            Self::Reset => "~/reset",
            Self::Record => "~/record",
            Self::StopRecording => "~/stop_recording",
            Self::GuideHome => "~/guide_home",
            Self::GuideAgain => "~/guide_again",
            Self::Halt => "~/halt",
        }
    }
}
