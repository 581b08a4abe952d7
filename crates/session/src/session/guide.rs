//! Guidance along the route at hand: it begins, goes on with each pose, and ends.

use super::Session;
use crate::guidance::Guiding;
use crate::obstacles::ObstacleMonitor;
use crate::refused::Refused;
use crate::scale_basis::ScaleBasis;
use crate::slam::Slam;
use cairn_dense::DenseError;
use cairn_guide::{Confidence, Cue, Facing, GuideState, Priority, StopReason, Travel, ready_words};
use cairn_sensor::{FramePacket, Rig, Stamp};

/// The first words of guidance wait at most this long for other utterances to end, seconds.
const FIRST_WORDS_WAIT_S: f64 = 12.0;
/// A walker whose place is not recognised is told so after this time, seconds, and again at this interval.
const SEARCHING_S: f64 = 4.0;
const SEARCHING_AGAIN_S: f64 = 10.0;

impl<S: Slam> Session<S> {
    /// The guide's state; `None` without guidance.
    pub fn guide_state(&self) -> Option<GuideState> {
        self.guiding.as_ref().map(|g| g.guide.state())
    }

    /// Whether the last guidance ended at the end of its route.
    pub fn has_arrived(&self) -> bool {
        self.arrived
    }

    /// Why the guide gives no directions at present, while it has stopped for a reason.
    pub fn stop_reason(&self) -> Option<StopReason> {
        match self.guiding.as_ref()?.guide.state() {
            GuideState::Stopped(reason) => Some(reason),
            _ => None,
        }
    }

    /// Watches the walker's way with the rig's depth sensor while he is guided and the camera looks where he walks:
    /// obstacles, drops and missing depth stop him, and he is led past what leaves room. False without a depth sensor.
    ///
    /// # Errors
    /// A depth camera that cannot be used.
    pub fn watch_way(&mut self, rig: &Rig) -> Result<bool, DenseError> {
        self.obstacles = ObstacleMonitor::new(rig, &self.engine.camera().body_from_camera)?;
        Ok(self.obstacles.is_some())
    }

    /// Milliseconds that watching the way took at the last packet; `None` where it is not watched or nobody is guided.
    pub fn obstacles_ms(&self) -> Option<f64> {
        self.obstacles.as_ref().filter(|_| self.guiding.is_some()).map(|w| w.cost_ms)
    }

    pub(super) fn begin_guiding(&mut self, facing: Facing, again: bool) -> Result<String, Refused> {
        if self.recording.is_some() {
            return Err(self.speech.refuse("walk-stop-first"));
        }
        self.update_metric(self.status.metric);
        let held = self.route.as_ref().ok_or_else(|| self.speech.refuse("walk-no-route"))?;
        if !held.here {
            return Err(self.speech.refuse("walk-other-map"));
        }
        if held.route.header.lens_guessed || self.learning.reads_with_guess() {
            return Err(self.speech.refuse("walk-route-guessed"));
        }
        let travel = if again { Travel::Again } else { Travel::Home };
        let (map, place) = (self.engine.snapshot(), self.place.as_ref());
        let mut guiding =
            Guiding::begin(&map, &held.route, travel, facing, place, self.now, &self.config.route)
                .map_err(|why| self.speech.refuse(why.id()))?;
        // The first direction comes before all else; whether the map covers the route is said to those who ask.
        let camera = self.engine.camera();
        let ready = |facing| guiding.reference_path.readiness(&map, &held.route, camera, facing);
        let with_camera_back = (facing == Facing::Home).then(|| ready(Facing::Back));
        let phrases = self.speech.phrases_for(self.status.metric);
        guiding.ready = match self.engine.is_visual() {
            true => ready_words(&ready(facing), with_camera_back.as_deref(), &phrases),
            false => self.speech.text("ready-all"),
        };
        self.guiding = Some(guiding);
        self.arrived = false;
        Ok(self.speech.text("walk-guidance-begins"))
    }

    /// Whether somebody is being guided now.
    pub(super) fn is_guiding(&self) -> bool {
        self.guiding.as_ref().is_some_and(|g| !g.is_paused)
    }

    pub(super) fn pause(&mut self) -> Result<String, Refused> {
        let guiding = self.guiding.as_mut().ok_or_else(|| self.speech.refuse("walk-not-guiding"))?;
        guiding.is_paused = true;
        self.speech.drop_waiting();
        Ok(self.speech.text("walk-paused"))
    }

    /// Guidance goes on from where the walker is now, which may be elsewhere.
    pub(super) fn resume(&mut self) -> Result<String, Refused> {
        let before = self.guiding.take_if(|g| g.is_paused);
        let before = before.ok_or_else(|| self.speech.refuse("walk-not-paused"))?;
        let begun = self.begin_guiding(before.facing, before.again);
        self.guiding = match self.guiding.take() {
            Some(guiding) => Some(guiding.after(&before)),
            None => Some(before),
        };
        begun.map(|_| self.speech.text("walk-resumed"))
    }

    /// Why the unit of length of the last pose rules out directions along the route, if it does: the pose is in
    /// another map than the route, begun where scale could not be carried over, or its scale has been unsupported
    /// for longer than turning around takes.
    pub(super) fn scale_hazard(&self) -> Option<StopReason> {
        let (scale, guiding) = (self.scale.filter(|s| !s.metric)?, self.guiding.as_ref()?);
        let held = self.route.as_ref()?;
        let map = self.engine.snapshot();
        let is_other = !guiding.reference_path.is_in(&map, &held.route, scale.map);
        let basis = ScaleBasis {
            state: guiding.guide.state(),
            other_map: is_other.then(|| guiding.other_map(&map, scale.map, self.place.as_ref())),
            unsupported_s: self.unsupported.map(|since| self.now - since.max(guiding.asked)),
        };
        basis.rules_out_directions().then_some(StopReason::ScaleUncertain)
    }

    /// Takes the depth of a packet, while somebody is guided.
    pub(super) fn observe_way(&mut self, packet: &FramePacket, tracked: bool) {
        let Some(obstacles) = &mut self.obstacles else { return };
        match (&self.guiding, &self.place) {
            (Some(guiding), Some(place)) if guiding.facing == Facing::Home => {
                if tracked {
                    let (pose, ground) = (guiding.in_metres(place).se3, &guiding.reference_path.ground);
                    obstacles.observe(packet, &pose, place.segment, ground);
                }
            }
            _ => obstacles.reset(),
        }
    }

    /// A step of the guide, with the last pose.
    pub(super) fn guide(&mut self, now: Stamp) {
        if self.guiding.is_some() && !self.is_guiding() {
            return;
        }
        // Measured after the engine's step, so that its processing time counts.
        let too_old = self.ages.hazard(self.frame, self.now);
        let fails = self.dead.is_some() || self.engine.away().is_some();
        let stage_failed = fails.then_some(StopReason::StageDied);
        let hazard = stage_failed.or(too_old).or_else(|| self.scale_hazard());
        let speaking = self.speech.is_speaking(now);
        if !self.is_at_route(now, speaking) {
            return;
        }
        let (Some(guiding), Some(place), Some(held)) = (&mut self.guiding, self.place, &self.route) else {
            return;
        };
        let is_silent = !speaking && self.speech.waiting().is_none();
        let map = self.engine.snapshot();
        // In a map that has nothing to do with the route's the place on the route is not known.
        let elsewhere = (guiding.started && guiding.is_elsewhere).then_some(StopReason::TrackingLost);
        let hazard = hazard.or(elsewhere);
        // The first words of guidance do not cut off the answer to the command, and are not dropped because of it.
        if !guiding.started && speaking && now - guiding.asked < FIRST_WORDS_WAIT_S {
            return;
        }
        guiding.started = true;
        let hazard = hazard.or_else(|| {
            let walker = guiding.walker(&place).filter(|_| guiding.facing == Facing::Home)?;
            self.obstacles.as_mut()?.look(&guiding.guide, &walker, now).tell(&mut guiding.guide)
        });
        let cue = guiding.step(&map, &held.route, &place, self.confidence, hazard, now);
        let ahead = guiding.bearing_of_route(&place);
        let has_words = cue.as_ref().is_some_and(|cue| cue.earcon().is_none() || cue.is_direction());
        let note = (is_silent && !has_words && self.confidence == Confidence::Good)
            .then(|| guiding.note(&map, &held.route, &place, self.speech.language()))
            .flatten();
        let arrived = guiding.guide.state() == GuideState::Arrived;
        let has_lost_distances = guiding.has_lost_distances;
        if let Some(cue) = cue.filter(|_| !has_lost_distances) {
            self.cue(&cue, ahead);
        }
        if let Some(note) = note {
            self.say(&note, Priority::Normal);
        }
        if arrived {
            self.arrived = true;
            self.guiding = None;
        } else if has_lost_distances {
            self.guiding = None;
            self.say(&self.speech.text("walk-distances-lost"), Priority::Urgent);
        }
    }

    /// Says a cue, whose earcon is heard from ahead where it asks for no turn.
    fn cue(&mut self, cue: &Cue, ahead_rad: f64) {
        let (metric, clock) = (self.status.metric, self.clock());
        self.speech.cue(cue, ahead_rad, self.place, metric, clock);
    }

    /// Whether the walker's place on the route can be known: he is in its map. Before guidance has started he is told
    /// what helps, and the route is resolved anew once he is recognised.
    pub(super) fn is_at_route(&mut self, now: Stamp, speaking: bool) -> bool {
        let (Some(guiding), Some(held)) = (&mut self.guiding, &self.route) else { return true };
        let map = self.engine.snapshot();
        let here = self.place.filter(|p| guiding.is_in_reach(&map, &held.route, p.anchor));
        let was_elsewhere = std::mem::replace(&mut guiding.is_elsewhere, here.is_none());
        if guiding.started {
            return true;
        }
        if let (Some(place), true) = (&here, was_elsewhere) {
            let travel = if guiding.again { Travel::Again } else { Travel::Home };
            if let Ok(mut anew) = Guiding::begin(
                &map,
                &held.route,
                travel,
                guiding.facing,
                Some(place),
                guiding.asked,
                &self.config.route,
            ) {
                anew.ready = std::mem::take(&mut guiding.ready);
                *guiding = anew.after(guiding);
            }
        }
        if here.is_none() {
            let due = match guiding.searched {
                None => now - guiding.asked >= SEARCHING_S,
                Some(said) => now - said >= SEARCHING_AGAIN_S,
            };
            if due && !speaking && !self.picture.is_lost() {
                guiding.searched = Some(now);
                self.say(&self.speech.text("walk-searching"), Priority::Normal);
            }
        }
        here.is_some()
    }
}
