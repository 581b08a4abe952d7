//! Another camera within a session: what tracks begins again in a map of its own, the walk and its settings stay.
//!
//! So a phone whose lens becomes known in the first half minute uses it at once. The map so far was made with a wrong lens: it is
//! dropped, and that is refused where anything hangs on it.

use super::Session;
use crate::learning::LensKnowledge;
use crate::library::{LibraryCamera, LibraryError};
use crate::slam::Slam;
use cairn_atlas::store::MapFile;
use cairn_engine::OpenMapError;
use cairn_guide::Confidence;
use cairn_sensor::{FramePacket, Stamp};

impl<S: Slam> Session<S> {
    /// Whether nothing that can be guided along hangs on the map of this session: no route, no recording, no guidance. Routes
    /// of a lens that is known to be another lead nobody.
    pub fn may_restart_slam(&self) -> bool {
        let has_route = self.route.as_ref().is_some_and(|held| held.here);
        let has_recorded = !self.recorded_here.is_empty() || !self.recorded.is_empty();
        let routes_count = self.learning.lens != Some(LensKnowledge::FoundForLater);
        self.dead.is_none()
            && self.recording.is_none()
            && self.guiding.is_none()
            && !(routes_count && (has_recorded || has_route))
    }

    /// Begins SLAM again with what `begin` begins for this camera: in an atlas of the folder that takes it, or in none. Returns what the user should
    /// know, as [`crate::Kept::notes`]. Where it cannot begin the session has no poses any more, and says so.
    ///
    /// # Errors
    /// What `begin` says where it is given no map.
    pub fn restart_slam(
        &mut self,
        camera: &LibraryCamera,
        mut begin: impl FnMut(Option<&MapFile>) -> Result<(S, Vec<String>), OpenMapError>,
    ) -> Result<Vec<String>, LibraryError> {
        self.engine.end();
        let begun = match &mut self.keeper {
            Some(keeper) => keeper.restart_slam(camera, begin),
            None => begin(None).map_err(LibraryError::from),
        };
        let (engine, notes) = begun.inspect_err(|_| {
            self.dead = Some(self.speech.text("walk-tracking-failed"));
        })?;
        self.engine = engine;
        self.learning.begins_again();
        // What was recorded hangs on the map before.
        self.recorded_here.clear();
        self.recorded.iter_mut().for_each(|(_, route)| route.header.lens_guessed = true);
        self.route.iter_mut().for_each(|held| held.here = false);
        (self.place, self.confidence, self.marked) = (None, Confidence::Lost, None);
        (self.scale, self.unsupported) = (None, None);
        self.status.metric = self.engine.is_metric();
        Ok(notes)
    }

    /// What was seen last before SLAM began again is seen again, with the lens it has begun with: so the phone is known as soon as its
    /// lens is, instead of after as many seconds of walking as that took. Nothing is said and nothing recorded meanwhile. Not with
    /// mapping on threads; packets in order, before the next one. `newest`: of the images that have come, which wait meanwhile.
    pub fn see_again(&mut self, packet: &FramePacket, newest: Stamp) {
        self.frame = Some(newest);
        // What had no result has none again.
        if let Ok(output) = self.engine.on_packet(packet) {
            self.learn_from(&output, packet.stamp);
        }
        self.status.metric = self.engine.is_metric();
    }
}
