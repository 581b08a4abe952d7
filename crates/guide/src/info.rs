//! What is in a way: numbers for people and for reports, and lines to draw.

use crate::clean::{CleanSetting, CleanWay, clean, length};
use crate::route::{Route, RouteSetting, Travel};
use crate::way::Anchor;
use crate::way::{Stretch, Way};
use cairn_geometry::{Sim3, Vec2};
use serde::Serialize;

/// A way in numbers. Lengths in metres (in units of a metre guessed from the pace where `metric` is false).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WayInfo {
    /// What it was recorded from.
    pub source: String,
    /// Whether lengths are true metres.
    pub metric: bool,
    /// Recorded points.
    pub points: usize,
    /// Seconds from the first to the last.
    pub duration_s: f64,
    /// Length as recorded.
    pub length_m: f64,
    /// Of it, length that was bridged.
    pub bridged_m: f64,
    /// Of it, length of gaps.
    pub gap_m: f64,
    /// Length after cleaning.
    pub cleaned_m: f64,
    /// Detours left out.
    pub cuts: usize,
    /// Turns on the cleaned way, from its start to its end.
    pub turns: usize,
    /// Flights of stairs on it.
    pub stairs: usize,
    /// Largest distance from the cleaned to the recorded way.
    pub largest_distance_m: f64,
    /// The file's last line was torn by a crash.
    pub torn: bool,
}

/// A way's lines on the ground plane, in metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WayDrawing {
    /// As recorded, from start to end.
    pub recorded: Vec<[f64; 2]>,
    /// Corners of the cleaned way.
    pub cleaned: Vec<[f64; 2]>,
    /// Where a detour was cut.
    pub cuts: Vec<[f64; 2]>,
}

/// Cleans a way where its key frames are now and counts what is in it.
pub fn survey(
    way: &Way,
    frame_from_anchor: impl Fn(Anchor) -> Option<Sim3>,
    setting: &CleanSetting,
) -> (WayInfo, CleanWay, WayDrawing) {
    let (ground, unit) = (way.header.ground(), way.metres_per_unit());
    let placed = way.resolve(frame_from_anchor);
    let cleaned = clean(&placed, unit, &ground, setting);
    let of = |stretch: Stretch| {
        let steps = placed.windows(2).filter(|w| w[1].stretch == stretch);
        let metres =
            steps.map(|w| (w[1].frame_from_camera.translation - w[0].frame_from_camera.translation).norm());
        metres.sum::<f64>() * unit
    };
    let route = Route::from_way(&cleaned, Travel::Again, &ground, &RouteSetting::default()).ok();
    let maneuvers = route.as_ref().map_or(&[][..], |r| r.maneuvers());
    let duration_s = match (way.points.first(), way.points.last()) {
        (Some(a), Some(b)) => b.stamp - a.stamp,
        _ => 0.0,
    };
    let info = WayInfo {
        source: way.header.source.clone(),
        metric: way.header.metric,
        points: way.points.len(),
        duration_s,
        length_m: length(placed.iter().map(|p| p.frame_from_camera.translation * unit)),
        bridged_m: of(Stretch::Bridged),
        gap_m: of(Stretch::Gap),
        cleaned_m: cleaned.after_m,
        cuts: cleaned.cuts.len(),
        turns: maneuvers.iter().filter(|m| m.turn_rad != 0.0).count(),
        stairs: maneuvers.iter().filter(|m| m.stairs.is_some()).count(),
        largest_distance_m: if placed.len() < 2 { 0.0 } else { cleaned.largest_distance_to(&placed, unit) },
        torn: way.torn,
    };
    let flat = |p: &cairn_geometry::Vec3| -> [f64; 2] {
        let q: Vec2 = ground.plane(p);
        [q.x, q.y]
    };
    let drawing = WayDrawing {
        recorded: placed.iter().map(|p| flat(&(p.frame_from_camera.translation * unit))).collect(),
        cleaned: cleaned.points.iter().map(flat).collect(),
        cuts: cleaned.cuts.iter().map(|c| flat(&c.from)).collect(),
    };
    (info, cleaned, drawing)
}
