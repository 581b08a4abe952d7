//! "Take me to ..." during a walk: a way over recorded routes is planned from here, and guidance begins along it.

use super::{RouteAtHand, Session};
use crate::take_me::WalkedRoutes;
use cairn_guide::Route;

impl Session {
    /// Plans the way over recorded routes from here to a destination ([`WalkedRoutes::destination`]), and starts guidance
    /// along it. The routes, with their names, are anchored to the map of this session. A recording in progress ends.
    ///
    /// # Errors
    /// In words for the walker: the place is not known yet, no destination has this name, or no way leads there.
    pub fn take_me<'r>(
        &mut self,
        routes: impl IntoIterator<Item = (String, &'r Route)>,
        to: &str,
    ) -> Result<String, String> {
        let here = self.place.as_ref().zip(self.scale);
        let (place, scale) = here.ok_or("I do not know yet where you are.")?;
        let snapshot = self.engine.snapshot();
        let walked = WalkedRoutes::new(&snapshot, routes);
        let from = place.world_from_camera.se3.translation;
        let planned = walked
            .destination(to)
            .and_then(|to| walked.take_me(scale.map, from, &to))
            .map_err(|e| format!("I cannot take you to {to}: {e}."))?;
        if planned.route.points.len() < 2 {
            return Err(format!("You are at {} already.", planned.to.name));
        }
        if self.recording.is_some() {
            self.end_recording()?;
        }
        self.route = Some(RouteAtHand { route: planned.route, path: None, here: true });
        self.begin_guiding(self.config.facing, true)
    }
}
