//! A recorded route as a reference path in the odometry frame: it is updated when the map is corrected.

use crate::place::Place;
use crate::ready::readiness;
use cairn_atlas::{KeyFrameId, KeyFrameName, MapId, Snapshot};
use cairn_geometry::{Odom, Se3, Sim3, Similarity, So3, Vec3, World};
use cairn_guide::{
    Anchor, CleanedRoute, Facing, Ground, ManeuverPlan, ManeuverPlanError, PlacedPoint, ReadyStretch, Route,
    RouteConfig, Travel, clean,
};
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;

/// The reference path is rebuilt when a recorded point has moved by more than this in the odometry frame, metres.
const MOVED_M: f64 = 0.05;
/// Interval of that check, seconds. A jump of `world_from_odom` is followed at once.
const MAP_CHECK_S: f64 = 1.0;
/// The relative change of the odometry's unit of length above which distances are rebuilt.
const SAME_UNIT: f64 = 0.05;

/// How the route changed in the odometry frame.
pub(crate) enum Moved {
    /// A correction of the map moved it.
    Corrected {
        /// The corrected plan.
        plan: ManeuverPlan,
        /// Its motion near the walker.
        moved: Se3,
    },
    /// A new segment of odometry began, or its unit of length became known: earlier poses cannot be compared.
    Segment(ManeuverPlan),
}

/// A route, resolved and cleaned.
pub struct ReferencePath {
    /// The ground plane of the walk, in the odometry frame.
    pub ground: Ground,
    /// The same in the map's frame.
    pub world_ground: Ground,
    /// The cleaned route in the odometry frame, in metres.
    pub cleaned: CleanedRoute,
    travel: Travel,
    /// The points of the route in the odometry frame, in metres.
    points: Vec<PlacedPoint>,
    frame: OdomFrame,
    /// The unit of length of the map became known.
    unit_is_due: bool,
    config: RouteConfig,
    /// When the map was last checked, and its version.
    checked: Stamp,
    version: u64,
}

/// The odometry frame, in metres.
#[derive(Clone, Copy)]
struct OdomFrame {
    /// The segment of odometry; `None` before the first pose.
    segment: Option<u32>,
    /// Metres per unit of the odometry.
    metres_per_unit: f64,
    /// From the map to the odometry frame in metres.
    odom_from_world: Similarity<Odom, World>,
}

impl OdomFrame {
    /// The frame of a place in a map whose unit is this many metres; before the first pose, the frame of the map.
    fn at(place: Option<&Place>, metres_per_map_unit: f64) -> Self {
        let Some(place) = place else {
            let odom_from_world =
                Similarity::new(Sim3::new(So3::identity(), Vec3::zeros(), metres_per_map_unit));
            return Self { segment: None, metres_per_unit: metres_per_map_unit, odom_from_world };
        };
        let metres_per_unit = place.world_from_odom.sim3.scale * metres_per_map_unit;
        Self { segment: Some(place.segment), metres_per_unit, ..Self::at(None, 1.0) }.moved(place)
    }

    /// The same frame, with its present relation to the map.
    fn moved(self, place: &Place) -> Self {
        let odom_from_world = place.world_from_odom.inverse().sim3;
        let metres = Sim3::new(So3::identity(), Vec3::zeros(), self.metres_per_unit);
        Self { odom_from_world: Similarity::new(metres * odom_from_world), ..self }
    }

    fn placed(&self, in_world: &[PlacedPoint]) -> Vec<PlacedPoint> {
        let place = |p: &PlacedPoint| {
            let frame_from_camera = self.odom_from_world.sim3.transform_pose(&p.frame_from_camera);
            PlacedPoint { frame_from_camera, ..*p }
        };
        in_world.iter().map(place).collect()
    }
}

impl ReferencePath {
    /// Resolves and cleans a route in the frame of the map.
    pub fn in_map(map: &Snapshot, route: &Route, travel: Travel, config: &RouteConfig) -> Self {
        Self::new(map, route, travel, None, Stamp::default(), config)
    }

    /// Resolves and cleans a route in the odometry frame of a place; before the first pose, in that of the map. Without
    /// gravity alignment the up direction is estimated from the walk itself.
    pub(crate) fn new(
        map: &Snapshot,
        route: &Route,
        travel: Travel,
        place: Option<&Place>,
        now: Stamp,
        config: &RouteConfig,
    ) -> Self {
        let in_world = route.resolve(|a| anchor_in_map(map, a));
        let world_ground = ground_of(map, route, &in_world);
        let frame = OdomFrame::at(place, route.metres_per_unit(&in_world));
        let ground = world_ground.rotated(&frame.odom_from_world.sim3.rotation);
        let points = frame.placed(&in_world);
        let cleaned = clean(&points, 1.0, &ground, &config.clean);
        let (checked, version, unit_is_due) = (now, map.version(), false);
        Self {
            ground,
            world_ground,
            cleaned,
            travel,
            points,
            frame,
            unit_is_due,
            checked,
            version,
            config: *config,
        }
    }

    /// The length of the route as recorded, by the present map, metres.
    pub(crate) fn recorded_m(&self) -> f64 {
        let at = |p: &PlacedPoint| p.frame_from_camera.translation;
        self.points.windows(2).map(|w| (at(&w[1]) - at(&w[0])).norm()).sum()
    }

    /// Metres per unit of the odometry.
    pub fn metres_per_unit(&self) -> f64 {
        self.frame.metres_per_unit
    }

    /// The maneuver plan, in metres.
    ///
    /// # Errors
    /// [`ManeuverPlanError`] for a cleaned route that is not usable, such as one with a single point.
    pub fn plan(&self) -> Result<ManeuverPlan, ManeuverPlanError> {
        ManeuverPlan::from_route(&self.cleaned, self.travel, &self.ground, &self.config.maneuvers)
    }

    /// Whether a map holds any of a route's points: then poses in it are in the route's unit of length.
    pub fn is_in(&self, snapshot: &Snapshot, route: &Route, map: MapId) -> bool {
        maps_of(snapshot, route).contains(&map)
    }

    /// The scale of the map was initialised: lengths are rebuilt from it at the next check.
    pub fn found_scale(&mut self) {
        self.unit_is_due = true;
    }

    /// Whether the unit of the odometry has turned out to be another number of metres than the path was built with: a map
    /// that was begun with a guessed unit of length has found its scale. A route without metric scale has only its own unit.
    fn is_in_another_unit(&self, route: &Route, place: &Place) -> bool {
        let now = place.world_from_odom.sim3.scale;
        route.header.metric && (now / self.metres_per_unit() - 1.0).abs() >= SAME_UNIT
    }

    /// The rebuilt plan, when the route moved in the odometry frame; `place` is the walker's.
    pub(crate) fn follow(
        &mut self,
        map: &Snapshot,
        route: &Route,
        place: &Place,
        now: Stamp,
    ) -> Option<Moved> {
        let is_due = std::mem::take(&mut self.unit_is_due) || self.is_in_another_unit(route, place);
        if self.frame.segment != Some(place.segment) || is_due {
            let rebuilt = Self::new(map, route, self.travel, Some(place), now, &self.config);
            let same_unit = (rebuilt.metres_per_unit() / self.metres_per_unit() - 1.0).abs() < SAME_UNIT;
            if self.frame.segment != Some(place.segment) || !same_unit {
                *self = rebuilt;
                return self.plan().ok().map(Moved::Segment);
            }
        }
        let frame = self.frame.moved(place);
        let at = frame.odom_from_world.sim3 * place.world_from_camera.se3.translation;
        let jumped = frame.odom_from_world.sim3 * (self.frame.odom_from_world.sim3.inverse() * at) - at;
        if now - self.checked < MAP_CHECK_S && jumped.norm() <= MOVED_M
            || map.version() == self.version && frame.odom_from_world == self.frame.odom_from_world
        {
            return None;
        }
        (self.checked, self.version, self.frame) = (now, map.version(), frame);
        let points = frame.placed(&route.resolve(|a| anchor_in_map(map, a)));
        let moves =
            || self.points.iter().zip(&points).map(|(a, b)| (&a.frame_from_camera, &b.frame_from_camera));
        let moved_m = moves().map(|(a, b)| (a.translation - b.translation).norm()).fold(0.0, f64::max);
        if moved_m <= MOVED_M {
            return None;
        }
        let near = moves()
            .min_by(|(a, _), (b, _)| (a.translation - at).norm().total_cmp(&(b.translation - at).norm()));
        let moved = near.map_or_else(Se3::identity, |(a, b)| *b * a.inverse());
        self.cleaned = clean(&points, 1.0, &self.ground, &self.config.clean);
        self.points = points;
        self.plan().ok().map(|plan| Moved::Corrected { plan, moved })
    }

    /// How well the map covers the views that the camera will have, for each stretch of the route as recorded.
    pub fn readiness(
        &self,
        map: &Snapshot,
        route: &Route,
        camera: &RectifiedCamera,
        facing: Facing,
    ) -> Vec<ReadyStretch> {
        // On the way out again a forward-looking camera has the same views, the others the opposite ones.
        let facing = match (self.travel, facing) {
            (Travel::Home, facing) => facing,
            (Travel::Again, Facing::Home) => Facing::Back,
            (Travel::Again, _) => Facing::Home,
        };
        let in_world = route.resolve(|a| anchor_in_map(map, a));
        readiness(
            map,
            camera,
            &in_world,
            self.frame.odom_from_world.sim3.scale,
            &self.world_ground,
            facing,
            &self.config.ready,
        )
    }

    /// Where the notes of the route were taken: poses of the camera in the odometry frame, in metres.
    pub(crate) fn notes(&self, map: &Snapshot, route: &Route) -> Vec<Se3> {
        let in_world = route.resolve_notes(|a| anchor_in_map(map, a));
        in_world.iter().map(|p| self.frame.odom_from_world.sim3.transform_pose(p)).collect()
    }

    /// The corners of the cleaned route in the map's frame and unit.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> {
        let world_from_odom = self.frame.odom_from_world.inverse().sim3;
        self.cleaned.points.iter().map(move |p| world_from_odom * *p)
    }
}

/// The ground plane of a walk, in the map's frame.
pub(crate) fn ground_of(map: &Snapshot, route: &Route, in_world: &[PlacedPoint]) -> Ground {
    let maps = maps_of(map, route);
    if !maps.is_empty() && maps.into_iter().all(|of| map.is_gravity_aligned(of)) {
        return Ground::z_up();
    }
    let poses = in_world.iter().map(|p| &p.frame_from_camera);
    Ground::of_walk(poses).unwrap_or_else(|| route.header.ground())
}

/// The pose of the keyframe that a route point is anchored to, with its unit of length.
pub fn anchor_in_map(map: &Snapshot, anchor: Anchor) -> Option<Sim3> {
    map.world_from_here(key_frame_of(map, anchor)?)
}

/// The length of a key frame's unit in that of the map; `None` for one that the map does not hold.
pub fn unit_of(map: &Snapshot, anchor: Anchor) -> Option<f64> {
    anchor_in_map(map, anchor).map(|world_from_here| world_from_here.scale)
}

/// The maps that a route leads through.
fn maps_of(map: &Snapshot, route: &Route) -> BTreeSet<MapId> {
    let anchors: BTreeSet<Anchor> = route.points.iter().map(|p| p.anchor).collect();
    anchors.into_iter().filter_map(|anchor| map_of(map, key_frame_of(map, anchor)?)).collect()
}

/// The map of a key frame, which may be removed.
pub(crate) fn map_of(map: &Snapshot, id: KeyFrameId) -> Option<MapId> {
    let (alive, _) = map.surviving_ancestor(id)?;
    Some(map.key_frame(alive)?.map)
}

/// The key frame that a route point is anchored to, by its lasting name; perhaps a removed one.
pub(crate) fn key_frame_of(map: &Snapshot, anchor: Anchor) -> Option<KeyFrameId> {
    map.key_frame_named(KeyFrameName { robot: anchor.robot, seq: anchor.seq })
}

/// Whether a route lies in the map of this key frame, or in one whose place relative to it is known: maps that were begun
/// one from the other. The frames of other maps have nothing in common.
pub(crate) fn is_reachable(snapshot: &Snapshot, route: &Route, from: Anchor) -> bool {
    let former = |map: MapId| {
        let (_, prior) = snapshot.maps().find(|(id, _)| *id == map)?;
        map_of(snapshot, prior?.to).filter(|former| *former < map)
    };
    let first = |map: MapId| std::iter::successors(Some(map), |map| former(*map)).last();
    let here = key_frame_of(snapshot, from).and_then(|id| map_of(snapshot, id));
    let Some(here) = here.and_then(first) else { return false };
    let maps = maps_of(snapshot, route);
    maps.into_iter().any(|map| first(map) == Some(here))
}
