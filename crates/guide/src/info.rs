//! Route statistics for people and for reports, and polylines to draw.

use crate::anchor::Anchor;
use crate::clean::{CleanConfig, CleanedRoute, clean, length};
use crate::ground::Ground;
use crate::maneuvers::{ManeuverPlan, ManeuverPlanConfig, Travel};
use crate::route::{Route, Stretch};
use cairn_geometry::{Sim3, Vec2};
use serde::Serialize;

/// A route in numbers. Lengths are in metres (estimated from the walking pace where `metric` is false).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RouteInfo {
    /// The source it was recorded from.
    pub source: String,
    /// Whether lengths are true metres.
    pub metric: bool,
    /// Recorded points.
    pub points: usize,
    /// Seconds from the first to the last point.
    pub duration_s: f64,
    /// Length as recorded.
    pub length_m: f64,
    /// Of that, length that was bridged.
    pub bridged_m: f64,
    /// Of that, length of gaps.
    pub gap_m: f64,
    /// Length after cleaning.
    pub cleaned_m: f64,
    /// Detours removed.
    pub cuts: usize,
    /// Turns on the cleaned route, from its start to its end.
    pub turns: usize,
    /// Flights of stairs on it.
    pub stairs: usize,
    /// Largest distance from the cleaned to the recorded route.
    pub largest_distance_m: f64,
    /// The file's last line was truncated by a crash.
    pub torn: bool,
}

/// A route's lines on the ground plane, in metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RouteDrawing {
    /// As recorded, from start to end.
    pub recorded: Vec<[f64; 2]>,
    /// Corners of the cleaned route.
    pub cleaned: Vec<[f64; 2]>,
    /// Where a detour was cut.
    pub cuts: Vec<[f64; 2]>,
}

/// Cleans a route where its keyframes are now and collects its statistics.
pub fn survey(
    route: &Route,
    frame_from_anchor: impl Fn(Anchor) -> Option<Sim3>,
    config: &CleanConfig,
) -> (RouteInfo, CleanedRoute, RouteDrawing) {
    let placed = route.resolve(frame_from_anchor);
    let unit = route.metres_per_unit(&placed);
    // The header's ground is that of the poses as they were recorded.
    let first = route.points.first().zip(placed.first());
    let ground = first.map_or_else(Ground::z_up, |(recorded, placed)| {
        let turned = placed.frame_from_camera.rotation * recorded.odom_from_camera.rotation.inverse();
        route.header.ground().rotated(&turned)
    });
    let cleaned = clean(&placed, unit, &ground, config);
    let of = |stretch: Stretch| {
        let steps = placed.windows(2).filter(|w| w[1].stretch == stretch);
        let metres =
            steps.map(|w| (w[1].frame_from_camera.translation - w[0].frame_from_camera.translation).norm());
        metres.sum::<f64>() * unit
    };
    let plan =
        ManeuverPlan::from_route(&cleaned, Travel::Again, &ground, &ManeuverPlanConfig::default()).ok();
    let maneuvers = plan.as_ref().map_or(&[][..], |r| r.maneuvers());
    let duration_s = match (route.points.first(), route.points.last()) {
        (Some(a), Some(b)) => b.stamp - a.stamp,
        _ => 0.0,
    };
    let info = RouteInfo {
        source: route.header.source.clone(),
        metric: route.header.metric,
        points: route.points.len(),
        duration_s,
        length_m: length(placed.iter().map(|p| p.frame_from_camera.translation * unit)),
        bridged_m: of(Stretch::Bridged),
        gap_m: of(Stretch::Gap),
        cleaned_m: cleaned.after_m,
        cuts: cleaned.cuts.len(),
        turns: maneuvers.iter().filter(|m| m.turn_rad != 0.0).count(),
        stairs: maneuvers.iter().filter(|m| m.stairs.is_some()).count(),
        largest_distance_m: if placed.len() < 2 { 0.0 } else { cleaned.largest_distance_to(&placed, unit) },
        torn: route.torn,
    };
    let flat = |p: &cairn_geometry::Vec3| -> [f64; 2] {
        let q: Vec2 = ground.plane(p);
        [q.x, q.y]
    };
    let drawing = RouteDrawing {
        recorded: placed.iter().map(|p| flat(&(p.frame_from_camera.translation * unit))).collect(),
        cleaned: cleaned.points.iter().map(flat).collect(),
        cuts: cleaned.cuts.iter().map(|c| flat(&c.from)).collect(),
    };
    (info, cleaned, drawing)
}
