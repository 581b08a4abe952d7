//! A grid of the ground where there is depth: from voxels, by a band of heights along gravity. What stands in the band is an obstacle, a
//! column of which the lowest part was seen to be free and in which nothing stands is free, all else is unknown.
//!
//! In: what voxels say at a point of the map; which way is up and where the ground is, or a surface from which both are found. Out: a
//! map of the ground in the level frame: that of the map, turned by the least angle so that z is up.

use crate::grid::{Grid, GridError, GridFrame};
use cairn_geometry::{Se2, So3, Vec3};

/// Surfaces within these angles of what is thought to be up count, pass by pass, in degrees.
const PASSES_DEG: [f64; 4] = [35.0, 20.0, 10.0, 5.0];
/// The ground has at least this share of the surface of the largest level.
const GROUND: f64 = 0.2;
/// Surfaces within this height of each other are one level, metres.
const LEVEL_M: f64 = 0.05;

/// Size of a cell, and the band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandConfig {
    /// Side of a cell in metres; voxels are asked at these steps of height too.
    pub resolution_m: f64,
    /// What stands between these heights above the ground is an obstacle, in metres.
    pub heights_m: (f64, f64),
    /// Free space has to be seen below this height for the ground to be free, in metres.
    pub low_m: f64,
}

impl Default for BandConfig {
    fn default() -> Self {
        Self { resolution_m: 0.05, heights_m: (0.1, 2.0), low_m: 0.5 }
    }
}

/// What the voxels say of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Voxel {
    /// Not seen.
    Unknown,
    /// Seen through.
    Free,
    /// A surface.
    Occupied,
}

/// A point of a surface and its normal, towards free space.
pub type SurfacePoint = (Vec3, Vec3);

/// The ground of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Up, as a unit vector in the frame of the map.
    pub up: Vec3,
    /// The height of the ground along it, from the origin of the map, in metres.
    pub height_m: f64,
}

impl Ground {
    /// The ground where up is known: the lowest level surface that is not small beside the largest. `None` where no surface is level.
    pub fn below(surface: &[SurfacePoint], up: &Vec3) -> Option<Self> {
        let up = up.try_normalize(1e-9).filter(|up| up.iter().all(|v| v.is_finite()))?;
        let mut heights: Vec<f64> = facing(surface, &up, 10.0).map(|(p, _)| p.dot(&up)).collect();
        heights.sort_by(f64::total_cmp);
        // How many are within a level above each.
        let count = |k: usize| heights[k..].partition_point(|h| *h <= heights[k] + LEVEL_M);
        let counts: Vec<usize> = (0..heights.len()).map(count).collect();
        let largest = counts.iter().max().copied()?;
        let first = counts.iter().position(|c| *c as f64 >= GROUND * largest as f64)?;
        // From there the fullest level within one step.
        let near = heights.partition_point(|h| *h <= heights[first] + LEVEL_M);
        let best = (first..near).max_by_key(|k| counts[*k])?;
        let level = &heights[best..best + counts[best]];
        Some(Self { up, height_m: level.iter().sum::<f64>() / level.len() as f64 })
    }

    /// The ground where up is known to within 35 degrees: up is the mean normal of the surfaces that are nearly level. `None` where there
    /// are none.
    pub fn near(surface: &[SurfacePoint], up: &Vec3) -> Option<Self> {
        let mut up = up.try_normalize(1e-9)?;
        for degrees in PASSES_DEG {
            let sum: Vec3 = facing(surface, &up, degrees).map(|(_, n)| *n).sum();
            up = sum.try_normalize(1e-9)?;
        }
        Self::below(surface, &up)
    }

    /// The turn from the frame of the map into the level frame.
    pub fn level_from_map(&self) -> So3 {
        let axis = self.up.cross(&Vec3::z());
        let (sine, cosine) = (axis.norm(), self.up.z);
        match axis.try_normalize(1e-12) {
            Some(axis) => So3::exp(&(axis * sine.atan2(cosine))),
            None if cosine < 0.0 => So3::exp(&(Vec3::x() * std::f64::consts::PI)),
            None => So3::identity(),
        }
    }

    /// The grid of what voxels say, as large as these points of the map need: 0 free, 100 occupied, -1 unknown.
    ///
    /// # Errors
    /// When there is no finite point, or the grid would be too large.
    pub fn grid(
        &self,
        extent: impl IntoIterator<Item = Vec3>,
        voxel: impl Fn(&Vec3) -> Voxel,
        config: &BandConfig,
    ) -> Result<Grid<i8>, GridError> {
        let turn = self.level_from_map();
        let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        for p in extent.into_iter().map(|p| turn * p).filter(|p| p.iter().all(|v| v.is_finite())) {
            (low, high) = (low.inf(&p), high.sup(&p));
        }
        let step = config.resolution_m;
        let cells = ((high - low) / step).map(|v| v.floor().max(-1.0) as usize + 1);
        let origin = if low.iter().all(|v| v.is_finite()) { low } else { Vec3::zeros() };
        let (width, height) = if low.x > high.x { (0, 0) } else { (cells.x, cells.y) };
        let frame = GridFrame::new(width, height, step, Se2::from_xy_angle(origin.x, origin.y, 0.0))?;
        let (from_m, to_m) = config.heights_m;
        let layers = ((to_m - from_m) / step).floor().max(0.0) as usize;
        let map_from_level = turn.inverse();
        let column = |k: usize| {
            let at = frame.centre(frame.cell(k));
            let mut state = -1;
            for layer in 0..layers {
                let over_m = from_m + (layer as f64 + 0.5) * step;
                let p = map_from_level * Vec3::new(at.x, at.y, self.height_m + over_m);
                match voxel(&p) {
                    Voxel::Occupied => return 100,
                    Voxel::Free if over_m < config.low_m => state = 0,
                    _ => {}
                }
            }
            state
        };
        Grid::from_values(frame, (0..width * height).map(column).collect())
    }
}

/// The points whose normal is within so many degrees of a direction.
fn facing<'a>(
    surface: &'a [SurfacePoint],
    up: &'a Vec3,
    degrees: f64,
) -> impl Iterator<Item = &'a SurfacePoint> {
    let least = degrees.to_radians().cos();
    surface.iter().filter(move |(p, n)| n.dot(up) >= least && p.iter().all(|v| v.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec2;

    /// A room of 4 x 3 m, its floor at -1.2 m, with a table of 1 x 1 m (0.75 m high) and a lamp at 1.9 m; turned by `turn`.
    fn room(turn: &So3) -> Vec<SurfacePoint> {
        let steps = |n: usize| (0..n).map(|i| 0.05 * (i as f64 + 0.5));
        let mut all = Vec::new();
        for x in steps(80) {
            for y in steps(60) {
                let table = (1.0..2.0).contains(&x) && (1.0..2.0).contains(&y);
                let z = if table { -0.45 } else { -1.2 };
                all.push((Vec3::new(x, y, z), Vec3::z()));
                // The ceiling is larger than what is seen of the floor, and is seen from below.
                all.push((Vec3::new(x, y, 1.3), -Vec3::z()));
            }
            for z in steps(50) {
                all.push((Vec3::new(x, 0.0, z - 1.2), Vec3::y()));
                all.push((Vec3::new(x, 3.0, z - 1.2), -Vec3::y()));
            }
        }
        all.into_iter().map(|(p, n)| (*turn * p, *turn * n)).collect()
    }

    #[test]
    fn up_and_the_ground_are_found_in_a_room_that_is_tilted() {
        // A camera that looks down by 20 degrees and is rolled by 8.
        let turn = So3::exp(&Vec3::new(0.35, 0.14, 0.0));
        let up = turn * Vec3::z();
        let found = Ground::near(&room(&turn), &Vec3::z()).unwrap();
        assert!(found.up.dot(&up) > 0.999_99, "{}", found.up);
        assert!((found.height_m + 1.2).abs() < 0.01, "{}", found.height_m);
        assert!((found.level_from_map() * found.up - Vec3::z()).norm() < 1e-9);
        assert!(Ground::near(&room(&turn), &-up).is_some(), "the ceiling, for one who hangs from it");
        assert_eq!(Ground::near(&room(&turn), &(turn * Vec3::x())), None, "no such wall is seen");
        assert_eq!(Ground::below(&[], &Vec3::z()), None);
        assert_eq!(Ground::below(&room(&turn), &Vec3::zeros()), None);
    }

    #[test]
    fn the_band_holds_what_a_body_meets() {
        let turn = So3::exp(&Vec3::new(0.3, -0.2, 0.5));
        let surface = room(&turn);
        let ground = Ground::below(&surface, &(turn * Vec3::z())).unwrap();
        let voxel = |p: &Vec3| {
            let p = turn.inverse() * *p;
            let over = p.z + 1.2;
            if !(0.0..4.0).contains(&p.x) || !(0.0..3.0).contains(&p.y) {
                return Voxel::Unknown;
            }
            let near = |a: f64, b: f64| (a - b).abs() < 0.05;
            let table = (1.0..2.0).contains(&p.x) && (1.0..2.0).contains(&p.y);
            let lamp = near(p.x, 3.0) && near(p.y, 0.5);
            match () {
                () if near(p.y, 0.0) || near(p.y, 3.0) => Voxel::Occupied,
                () if table && near(over, 0.75) || lamp && near(over, 1.9) => Voxel::Occupied,
                // Under the table nothing is seen, and behind x = 3.5 m only what is high.
                () if table && over < 0.75 || p.x > 3.5 && over < 1.0 => Voxel::Unknown,
                () => Voxel::Free,
            }
        };
        let ask = |config: &BandConfig| {
            let grid = ground.grid(surface.iter().map(|s| s.0), voxel, config).unwrap();
            move |x: f64, y: f64| {
                let p = ground.level_from_map() * (turn * Vec3::new(x, y, -1.2));
                grid.frame().cell_at(Vec2::new(p.x, p.y)).and_then(|c| grid.get(c)).unwrap()
            }
        };
        let at = ask(&BandConfig::default());
        assert_eq!((at(0.5, 1.5), at(1.5, 1.5), at(2.0, 0.03)), (0, 100, 100), "floor, table, wall");
        assert_eq!((at(3.0, 0.5), at(3.7, 1.5)), (100, -1), "lamp, and ground that was not seen");
        let low = ask(&BandConfig { heights_m: (0.1, 0.6), ..BandConfig::default() });
        assert_eq!((low(3.0, 0.5), low(1.5, 1.5)), (0, -1), "a low robot passes below the lamp");
        let nothing = ground.grid([Vec3::repeat(f64::NAN)], voxel, &BandConfig::default());
        assert!(matches!(nothing, Err(GridError::Empty { .. })), "{nothing:?}");
        let far = ground.grid([Vec3::zeros(), Vec3::repeat(1e9)], voxel, &BandConfig::default());
        assert!(far.is_err());
    }
}
