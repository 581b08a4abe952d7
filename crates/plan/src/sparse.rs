//! A grid of the ground where there is no depth: from the landmarks of a map and the way that its camera went. Walked ground is free,
//! landmarks within a band of heights are obstacles, and all else is unknown: a landmark says nothing of the ground before it, since the
//! ray may pass over a table.
//!
//! In: key frames in a level frame in metres, each with the landmarks it sees. Out: an occupancy grid.

use crate::grid::{GridError, GridFrame};
use crate::occupancy::{OccupancyConfig, OccupancyGrid};
use cairn_geometry::{Se2, Vec2, Vec3};

/// Heights and distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparseConfig {
    /// Side of a cell in metres.
    pub resolution_m: f64,
    /// Height of the camera above the ground in metres.
    pub camera_height_m: f64,
    /// Landmarks between these heights above the ground are obstacles, in metres.
    pub heights_m: (f64, f64),
    /// Ground within this distance of the way of the camera was walked, in metres.
    pub walked_m: f64,
    /// Between two key frames farther apart than this nothing is known of the way, in metres.
    pub gap_m: f64,
    /// Landmarks farther than this from a key frame are left out, in metres.
    pub range_m: f64,
}

impl SparseConfig {
    /// Defaults for a camera at this height above the ground, in metres.
    pub fn new(camera_height_m: f64) -> Self {
        Self {
            resolution_m: 0.05,
            camera_height_m,
            heights_m: (0.1, 2.0),
            walked_m: 0.25,
            gap_m: 1.5,
            range_m: 6.0,
        }
    }
}

/// A key frame: where its camera was (z up, metres), and the landmarks that it sees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Place of the camera.
    pub from: Vec3,
    /// Its landmarks.
    pub landmarks: Vec<Vec3>,
}

/// The grid of these key frames, in order of time. What is not finite is left out.
///
/// # Errors
/// When the grid would be too large, or has no cell: no key frame has a finite place.
pub fn grid_of(seen: &[Seen], config: &SparseConfig) -> Result<OccupancyGrid, GridError> {
    let finite = |p: &Vec3| p.iter().all(|v| v.is_finite());
    let frames: Vec<&Seen> = seen.iter().filter(|s| finite(&s.from)).collect();
    let (low_m, high_m) = config.heights_m;
    let obstacles = |s: &Seen| -> Vec<Vec2> {
        let ground_m = s.from.z - config.camera_height_m;
        let is_obstacle = |p: &&Vec3| {
            finite(p)
                && (low_m..=high_m).contains(&(p.z - ground_m))
                && (p.xy() - s.from.xy()).norm() <= config.range_m
        };
        s.landmarks.iter().filter(is_obstacle).map(|p| p.xy()).collect()
    };
    let hits: Vec<Vec<Vec2>> = frames.iter().map(|s| obstacles(s)).collect();
    let all = || frames.iter().map(|s| s.from.xy()).chain(hits.iter().flatten().copied());
    let margin = Vec2::repeat(config.walked_m + 2.0 * config.resolution_m);
    let low = all().fold(Vec2::repeat(f64::INFINITY), |low, p| low.inf(&p)) - margin;
    let high = all().fold(Vec2::repeat(f64::NEG_INFINITY), |high, p| high.sup(&p)) + margin;
    let cells = ((high - low) / config.resolution_m).map(|v| v.ceil().max(0.0) as usize);
    let origin = if low.iter().all(|v| v.is_finite()) { low } else { Vec2::zeros() };
    let frame =
        GridFrame::new(cells.x, cells.y, config.resolution_m, Se2::from_xy_angle(origin.x, origin.y, 0.0))?;
    // Rays say only where they end.
    let only_ends = OccupancyConfig {
        min_range_m: f64::INFINITY,
        max_range_m: config.range_m + config.resolution_m,
        ..OccupancyConfig::default()
    };
    let mut grid = OccupancyGrid::new(frame, only_ends);
    for (s, hits) in frames.iter().zip(&hits) {
        let polar = |p: &Vec2| {
            let off = p - s.from.xy();
            (off.y.atan2(off.x), off.norm())
        };
        // The place of the camera is in the grid and finite.
        let _ = grid.insert_scan(&Se2::from_xy_angle(s.from.x, s.from.y, 0.0), hits.iter().map(polar));
    }
    let mut way: Vec<Vec2> = Vec::new();
    for s in &frames {
        if way.last().is_some_and(|last| (last - s.from.xy()).norm() > config.gap_m) {
            way.push(Vec2::repeat(f64::NAN));
        }
        way.push(s.from.xy());
    }
    grid.mark_walked(&way, config.walked_m);
    Ok(grid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walked_ground_is_free_what_stands_is_occupied_and_all_else_unknown() {
        // Five metres along x, 1.4 m up, between a wall at y = 1 m and a table edge at y = -1 m; marks on floor and ceiling.
        let frames: Vec<Seen> = (0..=10)
            .map(|k| {
                let x = 0.5 * f64::from(k);
                let row = |y: f64, z: f64| (0..=50).map(move |i| Vec3::new(0.1 * f64::from(i), y, z));
                let near = |p: &Vec3| (p.x - x).abs() < 2.0;
                let landmarks = row(1.0, 1.5).chain(row(-1.0, 0.7)).chain(row(0.5, 0.0)).chain(row(0.5, 2.5));
                Seen { from: Vec3::new(x, 0.0, 1.4), landmarks: landmarks.filter(near).collect() }
            })
            .collect();
        let map = grid_of(&frames, &SparseConfig::new(1.4)).unwrap().to_map();
        let at = |x: f64, y: f64| map.get(map.frame().cell_at(Vec2::new(x, y)).unwrap()).unwrap();
        assert_eq!((at(2.5, 0.0), at(2.53, 0.2)), (0, 0), "walked");
        assert_eq!((at(2.5, 1.001), at(2.5, -1.001)), (100, 100), "wall and table");
        assert_eq!((at(2.5, 0.5), at(2.5, 0.7), at(2.5, -0.7)), (-1, -1, -1), "seen over, not walked");
        // A gap in the way is not walked, and a camera at another height has another ground.
        let apart: Vec<Seen> = frames.iter().filter(|s| s.from.x < 1.2 || s.from.x > 3.8).cloned().collect();
        let map = grid_of(&apart, &SparseConfig::new(1.4)).unwrap().to_map();
        assert_eq!(map.get(map.frame().cell_at(Vec2::new(2.5, 0.0)).unwrap()), Some(-1));
        let map = grid_of(&frames, &SparseConfig::new(0.5)).unwrap().to_map();
        let low = map.frame().cell_at(Vec2::new(2.5, -1.001)).and_then(|c| map.get(c));
        assert_ne!(low, Some(100), "0.7 m is below the ground of a camera 0.5 m up");
    }

    #[test]
    fn nothing_and_what_is_not_finite_gives_a_reason_or_is_left_out() {
        assert!(grid_of(&[], &SparseConfig::new(1.4)).is_err());
        let lost = Seen { from: Vec3::new(f64::NAN, 0.0, 0.0), landmarks: vec![Vec3::zeros()] };
        assert!(grid_of(std::slice::from_ref(&lost), &SparseConfig::new(1.4)).is_err());
        let far = Seen { from: Vec3::new(1e9, 0.0, 0.0), ..Seen::default() };
        let here = Seen { from: Vec3::zeros(), landmarks: vec![Vec3::repeat(f64::INFINITY)] };
        assert!(grid_of(&[here.clone(), far], &SparseConfig::new(1.4)).is_err(), "too large");
        let grid = grid_of(&[here, lost], &SparseConfig::new(1.4)).unwrap();
        assert!(grid.to_map().values().iter().all(|v| *v != 100));
    }
}
