//! A recorded way as a route in the map of now: it follows when the map moves.

use crate::ready::readiness;
use cairn_atlas::{KeyFrameId, Map};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_guide::{
    Anchor, CleanSetting, CleanWay, Facing, Ground, PlacedPoint, ReadyStretch, Route, RouteError,
    RouteSetting, Travel, Way, clean,
};
use cairn_sensor::Stamp;
use cairn_vision::EyeModel;

/// The route is made anew when a recorded point has moved by more than this, metres,
const MOVED_M: f64 = 0.05;
/// looked at so often, seconds.
const LOOK_AT_MAP_S: f64 = 1.0;

/// A way, cleaned and placed.
pub struct Course {
    /// The ground of the walk.
    pub ground: Ground,
    /// Metres per unit of the map; a guess from the pace where the map has no metres.
    pub unit: f64,
    /// The cleaned way, in metres.
    pub cleaned: CleanWay,
    travel: Travel,
    placed: Vec<PlacedPoint>,
    /// When the map was looked at last; at once where it is not known.
    looked: Option<Stamp>,
    version: u64,
}

impl Course {
    /// Places and cleans a way. Which way is up, the walk itself tells where the map does not know.
    pub fn new(map: &Map, way: &Way, travel: Travel, now: Stamp) -> Self {
        let placed = way.resolve(|a| standing(map, a));
        let poses: Vec<Se3> = placed.iter().map(|p| p.frame_from_camera).collect();
        let ground = match map.is_level_throughout() {
            true => Ground::z_up(),
            false => Ground::of_walk(&poses).unwrap_or_else(|| way.header.ground()),
        };
        let unit = way.metres_per_unit();
        let cleaned = clean(&placed, unit, &ground, &CleanSetting::default());
        Self { ground, unit, cleaned, travel, placed, looked: Some(now), version: map.version() }
    }

    /// The route, in metres.
    pub fn route(&self) -> Result<Route, RouteError> {
        Route::from_way(&self.cleaned, self.travel, &self.ground, &RouteSetting::default())
    }

    /// The scale of the map was found: the route is due at once.
    pub fn found_scale(&mut self) {
        self.looked = None;
    }

    /// The route once more, when the map has moved under it.
    pub fn moved(&mut self, map: &Map, way: &Way, now: Stamp) -> Option<Route> {
        if self.looked.is_some_and(|looked| now - looked < LOOK_AT_MAP_S) {
            return None;
        }
        self.looked = Some(now);
        if map.version() == self.version {
            return None;
        }
        self.version = map.version();
        let placed = way.resolve(|a| standing(map, a));
        let moved = (self.placed.iter().zip(&placed))
            .map(|(a, b)| (a.frame_from_camera.translation - b.frame_from_camera.translation).norm())
            .fold(0.0, f64::max);
        let unit = way.metres_per_unit();
        if moved * unit <= MOVED_M && unit == self.unit {
            return None;
        }
        self.unit = unit;
        self.cleaned = clean(&placed, self.unit, &self.ground, &CleanSetting::default());
        self.placed = placed;
        self.route().ok()
    }

    /// What the map knows of the views that the camera will have, stretch by stretch of the way as recorded.
    pub fn readiness(&self, map: &Map, eye: &EyeModel, facing: Facing) -> Vec<ReadyStretch> {
        // On the way out again the camera that looks ahead looks as it did, the others look the other way.
        let facing = match (self.travel, facing) {
            (Travel::Home, facing) => facing,
            (Travel::Again, Facing::Home) => Facing::Back,
            (Travel::Again, _) => Facing::Home,
        };
        readiness(map, eye, &self.placed, self.unit, &self.ground, facing)
    }

    /// The corners of the cleaned way in the map's own units.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> {
        self.cleaned.points.iter().map(|p| p / self.unit)
    }
}

/// Where a key frame that a way hangs on stands in the map, with its unit of length.
pub fn standing(map: &Map, anchor: Anchor) -> Option<Sim3> {
    map.world_from_here(KeyFrameId::from_index(anchor.seq as usize)?)
}
