//! Guidance in progress: walker and route in the odometry frame, in metres.
//!
//! The guide is given poses that map corrections do not move. The route is resolved in the map and transformed into
//! the odometry frame by the current `world_from_odom`; where that or the map changes so that the route moves in the
//! odometry frame, the guide is given the change.

use crate::reference_path::{Moved, ReferencePath};
use cairn_atlas::Snapshot;
use cairn_engine::Output;
use cairn_geometry::{Camera, Odom, Pose, Se3, Similarity, World};
use cairn_guide::{
    Confidence, Cue, Facing, Guide, GuideConfig, GuideError, GuideInput, ManeuverPlanError, RecordInput,
    Route, StopReason, Travel, wrap,
};
use cairn_sensor::Stamp;

/// A pose, in the odometry frame and in the map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub stamp: Stamp,
    /// In the map's frame and unit.
    pub world_from_camera: Pose<World, Camera>,
    /// In the frame and unit of the odometry.
    pub odom_from_camera: Pose<Odom, Camera>,
    pub world_from_odom: Similarity<World, Odom>,
    /// The segment of odometry it belongs to.
    pub segment: u32,
}

impl Place {
    /// The poses of a frame that has one.
    pub fn of(output: &Output, seen: &RecordInput) -> Option<Self> {
        let (anchored, odometry) = output.anchored.zip(output.odometry)?;
        Some(Self {
            stamp: seen.stamp,
            world_from_camera: Pose::new(anchored.world_from_camera),
            odom_from_camera: seen.odom_from_camera,
            world_from_odom: odometry.world_from_odom,
            segment: odometry.segment,
        })
    }
}

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
    pub asked: Stamp,
    pub started: bool,
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
    ) -> Result<Self, NoGuidance> {
        let reference_path = ReferencePath::new(map, route, travel, place, now);
        let plan = reference_path.plan().map_err(NoGuidance::Plan)?;
        let config = GuideConfig { facing, ..GuideConfig::default() };
        let guide = Guide::new(plan, reference_path.ground, config).map_err(NoGuidance::Guide)?;
        Ok(Self { guide, reference_path, facing, asked: now, started: false })
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
        match self.reference_path.follow(map, route, place, now) {
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
        let walker = self.facing.heading(&self.reference_path.ground, &self.in_metres(place));
        match (walker, self.guide.place()) {
            (Some(walker), Some(at)) => wrap(walker.turn_to(at.heading)),
            _ => 0.0,
        }
    }

    fn in_metres(&self, place: &Place) -> Pose<Odom, Camera> {
        let pose = place.odom_from_camera.se3;
        Pose::new(Se3::new(pose.rotation, pose.translation * self.reference_path.metres_per_unit()))
    }
}
