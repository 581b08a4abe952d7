//! Guidance in progress: walker and route in the odometry frame, in metres.
//!
//! The guide is given poses that map corrections do not move. The route is resolved in the map and transformed into
//! the odometry frame by the current `world_from_odom`; where that or the map changes so that the route moves in the
//! odometry frame, the guide is given the change.

use crate::place::Place;
use crate::reference_path::{self, Moved, ReferencePath};
use crate::scale_basis::OtherMap;
use cairn_atlas::{MapId, Snapshot};
use cairn_geometry::{Camera, Odom, Pose, Se3};
use cairn_guide::{
    Anchor, Confidence, Cue, Facing, Guide, GuideConfig, GuideError, GuideInput, GuideState, Heading,
    ManeuverPlanError, Route, RouteConfig, RouteNote, StopReason, Travel, heading_of, wrap,
};
use cairn_phrases::Language;
use cairn_sensor::Stamp;

/// Distances are lost once the route has become longer or shorter by this share (of its logarithm) than when guidance began. Of
/// twenty simulated phones the length of a metre was off by 2.5 % at most after 30 s (figures/phone-imu.md), and of a route that was
/// recorded with clocks 52 ms apart by more than a third.
const LOST_DISTANCES: f64 = 0.1;

/// Why a route cannot be walked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NoGuidance {
    /// What is wrong with the route.
    Plan(ManeuverPlanError),
    /// What is wrong with walking it in this way.
    Guide(GuideError),
}

impl NoGuidance {
    /// The sentence that says it.
    pub fn id(self) -> &'static str {
        match self {
            Self::Plan(ManeuverPlanError::TooShort(_)) => "walk-route-too-short",
            Self::Plan(ManeuverPlanError::NotFinite(_)) => "walk-route-damaged",
            Self::Guide(GuideError::BackwardsOnStairs) => "walk-stairs-backwards",
        }
    }
}

/// Guidance in progress.
pub(crate) struct Guiding {
    pub guide: Guide,
    pub reference_path: ReferencePath,
    pub facing: Facing,
    /// How well the map covers the route, in words, for a walker who asks.
    pub ready: String,
    /// Whether from start to end, instead of home.
    pub again: bool,
    pub asked: Stamp,
    pub started: bool,
    /// The walker has asked for silence; the pose goes on.
    pub is_paused: bool,
    /// The walker was not in the route's map when it began: then it begins anew once he is.
    pub is_elsewhere: bool,
    /// When he was last told so.
    pub searched: Option<Stamp>,
    /// The length of the route in metres is another than when guidance began, so that nobody knows where on it he is.
    pub has_lost_distances: bool,
    /// That length, once lengths are metres.
    began_m: Option<f64>,
    /// Which notes he has been told.
    told: Vec<bool>,
    /// What was last found of [`Guiding::is_in_reach`]: for a version of the map and a key frame.
    reach: Option<(u64, Anchor, bool)>,
}

impl Guiding {
    /// Starts guidance along a route, from the last known place.
    ///
    /// # Errors
    /// Why the route cannot be walked in this way.
    pub fn begin(
        map: &Snapshot,
        route: &Route,
        travel: Travel,
        facing: Facing,
        place: Option<&Place>,
        now: Stamp,
        config: &RouteConfig,
    ) -> Result<Self, NoGuidance> {
        let reference_path = ReferencePath::new(map, route, travel, place, now, config);
        let plan = reference_path.plan().map_err(NoGuidance::Plan)?;
        let config = GuideConfig { facing, ..config.guide };
        let guide = Guide::new(plan, reference_path.ground, config).map_err(NoGuidance::Guide)?;
        let is_elsewhere = !place.is_some_and(|p| reference_path::is_reachable(map, route, p.anchor));
        Ok(Self {
            guide,
            reference_path,
            facing,
            ready: String::new(),
            again: travel == Travel::Again,
            asked: now,
            started: false,
            is_paused: false,
            is_elsewhere,
            searched: None,
            has_lost_distances: false,
            began_m: None,
            told: vec![false; route.notes.len()],
            reach: None,
        })
    }

    /// Goes on in place of guidance along the same route that was paused: what was said is not said again, and what its length
    /// was is not forgotten.
    pub fn after(mut self, before: &Self) -> Self {
        self.told.clone_from(&before.told);
        self.began_m = before.began_m;
        self
    }

    /// Whether the route lies in a map that has to do with the one of this key frame.
    pub fn is_in_reach(&mut self, map: &Snapshot, route: &Route, from: Anchor) -> bool {
        let known = self.reach.filter(|(version, at, _)| *version == map.version() && *at == from);
        let is_in_reach =
            known.map_or_else(|| reference_path::is_reachable(map, route, from), |(.., found)| found);
        self.reach = Some((map.version(), from, is_in_reach));
        is_in_reach
    }

    /// The note that the walker passes and was not told yet, in words.
    pub fn note(
        &mut self,
        map: &Snapshot,
        route: &Route,
        place: &Place,
        language: Language,
    ) -> Option<String> {
        if self.told.iter().all(|told| *told) || self.guide.state() != GuideState::Moving {
            return None;
        }
        let ground = self.reference_path.ground;
        let walker = self.facing.heading(&ground, &self.in_metres(place))?;
        let taken = self.reference_path.notes(map, route);
        let notes = route.notes.iter().zip(&taken).zip(&mut self.told).filter(|(_, told)| !**told);
        let passed = notes.filter(|((_, at), _)| RouteNote::is_passed(&ground, at, &walker));
        let distance = |at: &Se3| (ground.plane(&at.translation) - walker.position).norm();
        let ((note, at), told) =
            passed.min_by(|((_, a), _), ((_, b), _)| distance(a).total_cmp(&distance(b)))?;
        *told = true;
        Some(note.words(note.lies(&ground, at, &walker), language))
    }

    /// A step of the guide with the last known place; `route` is the one of [`Guiding::begin`].
    pub fn step(
        &mut self,
        map: &Snapshot,
        route: &Route,
        place: &Place,
        confidence: Confidence,
        hazard: Option<StopReason>,
        now: Stamp,
    ) -> Option<Cue> {
        let moved = self.reference_path.follow(map, route, place, now);
        if route.header.metric && (moved.is_some() || self.began_m.is_none()) {
            let length_m = self.reference_path.recorded_m();
            let began_m = *self.began_m.get_or_insert(length_m);
            self.has_lost_distances |= (length_m / began_m).ln().abs() > LOST_DISTANCES;
        }
        match moved {
            Some(Moved::Corrected { plan, moved }) => self.guide.correct_route(plan, &moved, now),
            Some(Moved::Segment(plan)) => self.guide.begin_segment(plan, self.reference_path.ground),
            None => {}
        }
        self.guide.step(&GuideInput {
            now,
            pose_stamp: place.stamp,
            odom_from_camera: self.in_metres(place),
            confidence,
            speed: None,
            hazard,
        })
    }

    /// The direction in which the route continues, relative to the walker: radians, positive left.
    pub fn bearing_of_route(&self, place: &Place) -> f64 {
        match (self.walker(place), self.guide.place()) {
            (Some(walker), Some(at)) => wrap(walker.turn_to(at.heading)),
            _ => 0.0,
        }
    }

    /// How far the route is from the walker, metres, and where: radians, positive to his left.
    pub fn beside(&self, place: &Place) -> Option<(f64, f64)> {
        let (walker, at) = (self.walker(place)?, self.guide.place()?);
        let to = at.foot - walker.position;
        Some((to.norm(), walker.turn_to(heading_of(&to))))
    }

    /// What is known of a map that is not the route's, in which the walker is.
    pub fn other_map(&self, snapshot: &Snapshot, map: MapId, place: Option<&Place>) -> OtherMap {
        let prior = snapshot.maps().find(|(id, _)| *id == map).and_then(|(_, prior)| prior.copied());
        let root = snapshot.key_frames_of(map).next();
        let metres_per_unit =
            place.map(|p| self.reference_path.metres_per_unit() / p.world_from_odom.sim3.scale);
        let began_within =
            prior.zip(metres_per_unit).map(|(prior, metres)| [prior.sigma * metres, prior.sigma_rad]);
        let walked_m = root.zip(place).zip(metres_per_unit).map(|((root, place), metres)| {
            (place.world_from_camera.se3.translation - root.world_from_camera.translation).norm() * metres
        });
        OtherMap {
            began_within: began_within.unwrap_or([f64::INFINITY; 2]),
            walked_m: walked_m.unwrap_or(f64::INFINITY),
            to_next_m: self.guide.metres_to_next().unwrap_or(0.0),
            // On the way out again a camera that looks ahead does, on the way home one that looks back.
            sees_way_out: (self.facing == Facing::Home) == self.again,
        }
    }

    /// The walker's position and heading, in metres.
    pub fn walker(&self, place: &Place) -> Option<Heading> {
        self.facing.heading(&self.reference_path.ground, &self.in_metres(place))
    }

    pub fn in_metres(&self, place: &Place) -> Pose<Odom, Camera> {
        let pose = place.odom_from_camera.se3;
        Pose::new(Se3::new(pose.rotation, pose.translation * self.reference_path.metres_per_unit()))
    }
}
