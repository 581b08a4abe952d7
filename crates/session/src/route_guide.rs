//! Guidance along one route from poses that another process tracks: the guide of a [`crate::Session`] without its engine.
//!
//! In: the map as the journal of changes tells it, poses as they come, and word when they do not. Out: what is said, and
//! earcons. It gives directions only from metric poses: what a pose of unknown scale rests on is known where it is tracked.

use crate::age::Ages;
use crate::event::Event;
use crate::guidance::Guiding;
use crate::place::Place;
use crate::reference_path::is_reachable;
use crate::refused::Refused;
use crate::speech::{Clock, Speech};
use cairn_atlas::Snapshot;
use cairn_geometry::Odom;
use cairn_geometry::{Camera, Pose, Se3, Similarity, World};
use cairn_guide::{
    Anchor, AnnouncerConfig, Confidence, Facing, GuideState, PhraseConfig, Priority, RecordInput, Route,
    RouteConfig, StopReason, Travel,
};
use cairn_sensor::Stamp;

/// A frame that was tracked elsewhere.
#[derive(Clone, Copy, Debug)]
pub struct TrackedPlace {
    /// Time of the frame.
    pub stamp: Stamp,
    /// In the map's frame and unit.
    pub world_from_camera: Pose<World, Camera>,
    /// In the frame and unit of the odometry.
    pub odom_from_camera: Pose<Odom, Camera>,
    /// Corrections of the map since.
    pub world_from_odom: Similarity<World, Odom>,
    /// The segment of odometry.
    pub segment: u32,
    /// The key frame it is anchored to.
    pub anchor: Anchor,
    /// The pose there.
    pub anchor_from_camera: Se3,
    /// How good it is.
    pub confidence: Confidence,
    /// The share of the matches that agree with it.
    pub quality: f32,
    /// Whether lengths are metres.
    pub metric: bool,
}

impl TrackedPlace {
    /// Of a frame that the engine has tracked; `None` without a pose.
    pub fn of(output: &cairn_engine::Output, seen: &RecordInput) -> Option<Self> {
        let place = Place::of(output, seen)?;
        Some(Self {
            stamp: place.stamp,
            world_from_camera: place.world_from_camera,
            odom_from_camera: place.odom_from_camera,
            world_from_odom: place.world_from_odom,
            segment: place.segment,
            anchor: place.anchor,
            anchor_from_camera: place.anchor_from_camera,
            confidence: seen.confidence,
            quality: seen.quality,
            metric: output.is_metric(),
        })
    }

    pub(crate) fn place(&self) -> Place {
        Place {
            stamp: self.stamp,
            world_from_camera: self.world_from_camera,
            odom_from_camera: self.odom_from_camera,
            world_from_odom: self.world_from_odom,
            segment: self.segment,
            anchor: self.anchor,
            anchor_from_camera: self.anchor_from_camera,
        }
    }
}

/// Guides one walker along one route.
pub struct RouteGuide {
    route: Route,
    travel: Travel,
    facing: Facing,
    config: RouteConfig,
    guiding: Option<Guiding>,
    speech: Speech,
    place: Option<Place>,
    confidence: Confidence,
    metric: bool,
    began: Option<Stamp>,
    now: Stamp,
    /// Whether there was a step, from which `now` is known.
    stepped: bool,
    /// The walker has arrived, or the distances are lost.
    has_ended: bool,
}

impl RouteGuide {
    /// A guide that waits for the first pose in the map of its route.
    pub fn new(
        route: Route,
        travel: Travel,
        facing: Facing,
        config: RouteConfig,
        phrases: PhraseConfig,
        announcer: AnnouncerConfig,
    ) -> Self {
        Self {
            route,
            travel,
            facing,
            config,
            guiding: None,
            speech: Speech::new(phrases, announcer),
            place: None,
            confidence: Confidence::Lost,
            metric: false,
            began: None,
            now: Stamp::default(),
            stepped: false,
            has_ended: false,
        }
    }

    /// The time from which the times of what is said count: that of the first frame, for a guide that begins later.
    pub fn began_at(mut self, began: Option<Stamp>) -> Self {
        self.began = began;
        self
    }

    /// A frame was tracked at `stamp`; without a place its pose is not known.
    ///
    /// # Errors
    /// Why the route cannot be walked.
    pub fn tracked(
        &mut self,
        map: &Snapshot,
        stamp: Stamp,
        place: Option<&TrackedPlace>,
    ) -> Result<(), Refused> {
        self.confidence = place.map_or(Confidence::Lost, |p| p.confidence);
        self.metric = place.map_or(self.metric, |p| p.metric);
        self.place = place.map(TrackedPlace::place).or(self.place);
        self.step(map, stamp, None)
    }

    /// Time passes without a pose; `hazard` is a reason to stop, such as the death of what tracks.
    ///
    /// # Errors
    /// As [`RouteGuide::tracked`].
    pub fn tick(&mut self, map: &Snapshot, now: Stamp, hazard: Option<StopReason>) -> Result<(), Refused> {
        self.step(map, now, hazard)
    }

    fn step(&mut self, map: &Snapshot, now: Stamp, hazard: Option<StopReason>) -> Result<(), Refused> {
        self.began.get_or_insert(now);
        // The clock of a source may begin anywhere, before zero too.
        self.now = if std::mem::replace(&mut self.stepped, true) { self.now.max(now) } else { now };
        if let Some(place) = self.place.filter(|_| !self.has_ended) {
            self.guide(map, &place, hazard)?;
        }
        let clock = self.clock();
        let unheard = self.speech.speak(&Ages::default(), clock);
        if let (Some(cue), Some(guiding)) = (unheard, &mut self.guiding) {
            guiding.guide.not_heard(&cue);
        }
        Ok(())
    }

    fn guide(&mut self, map: &Snapshot, place: &Place, hazard: Option<StopReason>) -> Result<(), Refused> {
        if self.guiding.is_none() && is_reachable(map, &self.route, place.anchor) {
            let begun = Guiding::begin(
                map,
                &self.route,
                self.travel,
                self.facing,
                Some(place),
                self.now,
                &self.config,
            );
            self.guiding = Some(begun.map_err(|why| self.speech.refuse(why.id()))?);
        }
        let Some(guiding) = &mut self.guiding else { return Ok(()) };
        let elsewhere =
            (!guiding.is_in_reach(map, &self.route, place.anchor)).then_some(StopReason::TrackingLost);
        let hazard = hazard.or(elsewhere).or((!self.metric).then_some(StopReason::ScaleUncertain));
        let cue = guiding.step(map, &self.route, place, self.confidence, hazard, self.now);
        let ahead = guiding.bearing_of_route(place);
        let is_silent = !self.speech.is_speaking(self.now) && self.speech.waiting().is_none();
        let note = (is_silent && cue.is_none() && self.confidence == Confidence::Good)
            .then(|| guiding.note(map, &self.route, place, self.speech.language()))
            .flatten();
        if guiding.guide.state() == GuideState::Arrived {
            self.has_ended = true;
        }
        if guiding.has_lost_distances {
            self.has_ended = true;
            self.speech.say(&self.speech.text("walk-distances-lost"), Priority::Urgent, self.now);
            return Ok(());
        }
        if let Some(cue) = cue {
            self.speech.cue(&cue, ahead, Some(*place), self.metric, self.clock());
        }
        if let Some(note) = note {
            self.speech.say(&note, Priority::Normal, self.now);
        }
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock { now: self.now, began: self.began }
    }

    /// What is to be heard since the last call.
    pub fn events(&mut self) -> Vec<Event> {
        self.speech.take_events()
    }

    /// The guide's state; `None` before the first pose in the map of the route.
    pub fn state(&self) -> Option<GuideState> {
        self.guiding.as_ref().map(|g| g.guide.state())
    }
}
