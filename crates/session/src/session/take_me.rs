//! "Take me to ..." during a walk: a way over recorded routes is planned from here, and guidance begins along it.

use super::{RouteAtHand, Session};
use crate::take_me::{NoWay, WalkedRoutes};
use cairn_guide::Route;
use cairn_plan::search::Place;
use cairn_plan::walked::NotWalked;

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
        let (place, scale) = here.ok_or_else(|| self.speech.text("walk-way-here-unknown"))?;
        let snapshot = self.engine.snapshot();
        let walked = WalkedRoutes::new(&snapshot, routes);
        let from = place.world_from_camera.se3.translation;
        let planned = walked
            .destination(to)
            .and_then(|to| walked.take_me(scale.map, from, &to))
            .map_err(|why| self.speech.language().say(sentence(&why), &[("place", to.into())]))?;
        if planned.route.points.len() < 2 {
            return Err(self.speech.text("walk-way-there"));
        }
        if self.recording.is_some() {
            self.end_recording()?;
        }
        self.route = Some(RouteAtHand { route: planned.route, path: None, here: true });
        self.begin_guiding(self.config.facing, true)
    }
}

/// The sentence that says why there is no way.
fn sentence(why: &NoWay) -> &'static str {
    match why {
        NoWay::Unknown(_) => "walk-way-unknown",
        NoWay::Ambiguous(_) => "walk-way-ambiguous",
        NoWay::OtherMap => "walk-way-other-map",
        NoWay::NotWalked(
            NotWalked::FarFromRoutes { place: Place::Start, .. } | NotWalked::NotFinite(Place::Start),
        ) => "walk-way-far",
        NoWay::NotWalked(_) => "walk-way-not-joined",
    }
}
