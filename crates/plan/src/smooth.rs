//! Smooths a path over cells for driving: corners are cut where there is room and the rest is rounded. The path never
//! comes nearer to obstacles than it was, or than the desired clearance.
//!
//! Shortcuts are found greedily; rounding moves each point towards the mean of its neighbours and away from obstacles
//! nearer than desired (the forces of elastic bands, Quinlan and Khatib 1993). Each move is kept only if the clearance
//! at the point and half-way to both neighbours does not fall below what was there and what is desired.

use crate::distance::{DistanceField, NO_OBSTACLE};
use crate::grid::Cell;
use cairn_geometry::Vec2;

/// A point that would move by less than this counts as at rest, in metres.
const STILL_M: f64 = 5e-4;
/// A segment whose crossings of two borders are this near to each other, as part of it, passes through their corner: half-way between
/// cell centres rounding would decide.
const CORNER: f64 = 1e-9;

/// Smoothing configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothConfig {
    /// No point comes nearer to an obstacle than this, in metres, unless the path already did: the radius of the robot.
    pub radius_m: f64,
    /// Clearance that is kept where the path had it and sought where it had less, in metres.
    pub clearance_m: f64,
    /// Distance between points, in metres.
    pub spacing_m: f64,
    /// Number of rounding passes.
    pub rounds: usize,
}

impl Default for SmoothConfig {
    fn default() -> Self {
        Self { radius_m: 0.2, clearance_m: 0.4, spacing_m: 0.1, rounds: 150 }
    }
}

/// A smoothed path.
#[derive(Clone, Debug, PartialEq)]
pub struct SmoothPath {
    /// Points in metres, world, almost evenly spaced; the ends are those of the path.
    pub points: Vec<Vec2>,
    /// Length in metres.
    pub length_m: f64,
    /// Least distance to an obstacle along the path, in metres, between cell centres.
    pub clearance_m: f64,
}

/// Smooths a path of cells. A path that cannot be smoothed without coming too near to obstacles is returned as it was. Never does a path
/// over free cells touch an obstacle afterwards, even for a body without extent.
pub fn smooth(field: &DistanceField, cells: &[Cell], config: &SmoothConfig) -> SmoothPath {
    let raw: Vec<Vec2> = cells.iter().map(|&c| field.frame().centre(c)).collect();
    let resolution_m = field.frame().resolution_m();
    let radius_m = config.radius_m.max(resolution_m);
    let spacing_m = config.spacing_m.max(0.5 * resolution_m);
    let config =
        SmoothConfig { radius_m, clearance_m: config.clearance_m.max(radius_m), spacing_m, ..*config };
    let least = clearance_of(field, &raw).min(radius_m);
    let mut rounder = spaced(&pulled(field, &raw, &config), spacing_m);
    let mut resting = vec![false; rounder.len()];
    for _ in 0..config.rounds {
        if !rounded(field, &mut rounder, &mut resting, &config) {
            break;
        }
    }
    // Points at even distances cut the corners between them.
    let mut points = spaced(&rounder, spacing_m);
    for other in [rounder, raw] {
        if clearance_of(field, &points) >= least {
            break;
        }
        points = other;
    }
    let length_m = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    SmoothPath { length_m, clearance_m: clearance_of(field, &points), points }
}

/// Obstacle distance at the cell of a point; 0 outside.
fn distance(field: &DistanceField, point: Vec2) -> f64 {
    field.frame().cell_at(point).and_then(|c| field.distance_m(c)).unwrap_or(0.0)
}

/// Least obstacle distance of all cells that a segment touches (Amanatides and Woo, "A Fast Voxel Traversal Algorithm", 1987); where it
/// passes through a corner, both cells beside it count. 0 if an end is outside.
fn along_segment(field: &DistanceField, a: Vec2, b: Vec2) -> f64 {
    let frame = field.frame();
    let (Some(first), Some(last)) = (frame.cell_at(a), frame.cell_at(b)) else { return 0.0 };
    let (from, to) = (frame.in_cells(a), frame.in_cells(b));
    let (left, ray) = (|from: u32, to: u32| i64::from(to) - i64::from(from), to - from);
    let (mut left_x, mut left_y) = (left(first.x, last.x), left(first.y, last.y));
    let (mut x, mut y) = (i64::from(first.x), i64::from(first.y));
    // Part of the segment up to the border of the present cell.
    let border = |cell: i64, left: i64, from: f64, ray: f64| match left {
        0 => f64::INFINITY,
        _ => ((cell + i64::from(left > 0)) as f64 - from) / ray,
    };
    let width = frame.width() as i64;
    let squared = |x: i64, y: i64| field.squared()[(y * width + x) as usize];
    let mut least = squared(x, y);
    while left_x != 0 || left_y != 0 {
        let (to_x, to_y) = (border(x, left_x, from.x, ray.x), border(y, left_y, from.y, ray.y));
        let (step_x, step_y) = (left_x.signum(), left_y.signum());
        if left_x != 0 && left_y != 0 && (to_x - to_y).abs() < CORNER {
            least = least.min(squared(x + step_x, y)).min(squared(x, y + step_y));
            (x, left_x, y, left_y) = (x + step_x, left_x - step_x, y + step_y, left_y - step_y);
        } else if to_x < to_y {
            (x, left_x) = (x + step_x, left_x - step_x);
        } else {
            (y, left_y) = (y + step_y, left_y - step_y);
        }
        least = least.min(squared(x, y));
    }
    if least == NO_OBSTACLE { f64::INFINITY } else { f64::from(least).sqrt() * frame.resolution_m() }
}

/// Whether a segment is nowhere nearer to an obstacle than `floor`. Where both ends are far enough away, no samples are
/// needed: the distance changes by no more than the distance moved, and a cell centre is at most half a diagonal away.
fn keeps(field: &DistanceField, a: Vec2, b: Vec2, floor: f64) -> bool {
    let slack = 0.5 * (b - a).norm() + 1.5 * field.frame().resolution_m();
    distance(field, a).min(distance(field, b)) >= floor + slack || along_segment(field, a, b) >= floor
}

/// Least obstacle distance along a path.
pub fn clearance_of(field: &DistanceField, points: &[Vec2]) -> f64 {
    let ends = points.first().map_or(f64::INFINITY, |&p| distance(field, p));
    points.windows(2).map(|w| along_segment(field, w[0], w[1])).fold(ends, f64::min)
}

/// Removes corners where the straight line keeps the clearance.
fn pulled(field: &DistanceField, raw: &[Vec2], config: &SmoothConfig) -> Vec<Vec2> {
    let (Some(&first), Some(&last)) = (raw.first(), raw.last()) else { return Vec::new() };
    let at: Vec<f64> = raw.iter().map(|&p| distance(field, p)).collect();
    let mut kept = vec![first];
    let mut from = 0;
    while from + 1 < raw.len() {
        let (mut to, mut step, mut least) = (from + 1, 1, config.clearance_m.min(at[from]));
        // The stride grows, then shrinks again (a galloping search).
        while step > 0 && to + step < raw.len() {
            let floor = at[to..=to + step].iter().copied().fold(least, f64::min);
            if along_segment(field, raw[from], raw[to + step]) >= floor {
                (to, least, step) = (to + step, floor, step * 2);
            } else {
                step /= 2;
            }
        }
        while step > 0 {
            step /= 2;
            if step > 0 && to + step < raw.len() {
                let floor = at[to..=to + step].iter().copied().fold(least, f64::min);
                if along_segment(field, raw[from], raw[to + step]) >= floor {
                    (to, least) = (to + step, floor);
                }
            }
        }
        kept.push(raw[to]);
        from = to;
    }
    if kept.last() != Some(&last) {
        kept.push(last);
    }
    kept
}

/// Points at even distances along a line; its ends are kept.
pub(crate) fn spaced(line: &[Vec2], spacing_m: f64) -> Vec<Vec2> {
    let mut points: Vec<Vec2> = line.first().copied().into_iter().collect();
    let length: f64 = line.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    let pieces = (length / spacing_m).ceil().max(1.0);
    let step = length / pieces;
    let mut due = step;
    let mut done = 0.0;
    for pair in line.windows(2) {
        let long = (pair[1] - pair[0]).norm();
        while due <= done + long && (points.len() as f64) < pieces {
            points.push(pair[0] + (pair[1] - pair[0]) * ((due - done) / long.max(1e-12)));
            due += step;
        }
        done += long;
    }
    if line.len() > 1 {
        points.extend(line.last());
    }
    points
}

/// One pass over all inner points; false when no point moved. Points at rest between points at rest are skipped.
fn rounded(field: &DistanceField, points: &mut [Vec2], resting: &mut [bool], config: &SmoothConfig) -> bool {
    let res = field.frame().resolution_m();
    let mut moved = false;
    for i in 1..points.len().saturating_sub(1) {
        if resting[i - 1] && resting[i] && resting[i + 1] {
            continue;
        }
        let (before, here, after) = (points[i - 1], points[i], points[i + 1]);
        let clear = distance(field, here);
        let mut to = here + ((before + after) * 0.5 - here) * 0.5;
        if clear < config.clearance_m {
            let at = |dx: f64, dy: f64| distance(field, here + Vec2::new(dx, dy));
            let away = Vec2::new(at(res, 0.0) - at(-res, 0.0), at(0.0, res) - at(0.0, -res));
            let part = (config.clearance_m - clear) / config.clearance_m;
            to += away.try_normalize(1e-9).unwrap_or_default() * (0.2 * res * part);
        }
        let wished = config.clearance_m;
        let keeps = |p: Vec2, floor: f64| keeps(field, before, p, floor) && keeps(field, p, after, floor);
        let has = |p: Vec2| along_segment(field, before, p).min(along_segment(field, p, after));
        let floor = if keeps(here, wished) { wished } else { has(here).min(wished) };
        resting[i] = (to - here).norm() < STILL_M || !keeps(to, floor);
        if !resting[i] {
            moved = true;
            points[i] = to;
        }
    }
    moved
}
