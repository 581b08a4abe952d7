//! The space around a walker from live depth: the ground, and what stands or hangs in the way.
//!
//! In: depth images with poses in a frame that no correction of the map moves (the odometry frame). Out: obstacles above
//! the ground as points seen from above, and places where the ground drops. An occupancy grid around the walker is the
//! temporal filter: a voxel counts once several images more saw it occupied than saw through it, and is free again when a
//! few saw through it (Hornung et al., "OctoMap", Autonomous Robots 2013, section 3.2). The ground is a plane, fitted to each
//! image near where it was before.

use super::floor::Floor;
use crate::{DenseError, DepthConfig, DepthPreparer, OccupancyConfig, OccupancyGrid};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage};
use std::collections::BTreeMap;

/// Configuration of [`LocalSpace`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalConfig {
    /// How depth images are interpreted; depths beyond [`DepthConfig::farthest_m`] are left out.
    pub depth: DepthConfig,
    /// The grid. A low [`OccupancyConfig::limit`] lets it follow changes within a few images.
    pub occupancy: OccupancyConfig,
    /// Log-odds from which a voxel counts as occupied.
    pub confirmed: i8,
    /// Obstacles are searched within this horizontal distance, in metres.
    pub reach_m: f64,
    /// What lies farther away is forgotten, in metres.
    pub keep_m: f64,
    /// Nothing lower above the ground is an obstacle, in metres.
    pub clear_m: f64,
    /// Nothing higher above the ground is an obstacle, in metres.
    pub head_m: f64,
    /// From this height above the ground on the lower end of an obstacle is passed under by a cane, in metres.
    pub chest_m: f64,
    /// Space that is free this far below the ground is a drop, in metres.
    pub drop_m: f64,
}

impl Default for LocalConfig {
    fn default() -> Self {
        Self {
            depth: DepthConfig { farthest_m: 6.0, ..DepthConfig::default() },
            // Seen four times in a row against free space: at 20 images a second, 0.2 s. Free again after six.
            occupancy: OccupancyConfig { limit: 30, silent_m: 4.0, ..OccupancyConfig::default() },
            confirmed: 18,
            reach_m: 4.4,
            keep_m: 7.0,
            clear_m: 0.13,
            head_m: 2.0,
            chest_m: 1.1,
            drop_m: 0.2,
        }
    }
}

/// A cell seen from above that holds an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blocked {
    /// Its centre in the level frame, in metres.
    pub at: Vec2,
    /// Height of the lowest occupied voxel above the ground, in metres.
    pub low_m: f64,
    /// Occupied voxels above it.
    pub voxels: u32,
}

/// The first obstacle along a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Metres along the line.
    pub along_m: f64,
    /// Its mean position in the level frame, in metres.
    pub at: Vec2,
    /// Height of its lower end above the ground, in metres.
    pub low_m: f64,
}

/// The space around a walker.
pub struct LocalSpace {
    config: LocalConfig,
    preparer: DepthPreparer,
    /// The farthest depth in the sensor's unit, and the image with nothing beyond it.
    farthest: u16,
    near: DepthImage,
    grid: OccupancyGrid,
    level_from_here: So3,
    floor: Floor,
    /// The last camera, in the level frame.
    camera: Vec3,
    /// The most occupied voxels above the ground that each cell of the level frame has had since something came there.
    most: BTreeMap<[i32; 2], u32>,
}

/// When so many voxels of a cell have been seen through, and this share of what was there (as 1 over it), what stood there has
/// gone: the rest of it, too low or too high to be seen from here, is forgotten, and counts again when it is seen again.
const GONE_VOXELS: u32 = 4;
const GONE_SHARE: u32 = 5;

impl LocalSpace {
    /// For a depth camera with images in units of `metres_per_unit`.
    ///
    /// # Errors
    /// An invalid camera or config.
    pub fn new(config: LocalConfig, camera: Camera, metres_per_unit: f64) -> Result<Self, DenseError> {
        let LocalConfig { confirmed, reach_m, keep_m, clear_m, head_m, chest_m, drop_m, .. } = config;
        let heights = clear_m > 0.0 && head_m > clear_m && chest_m > 0.0 && drop_m > 0.0;
        if !(heights && reach_m > 0.5 && keep_m >= reach_m && reach_m <= 10.0 && confirmed > 0) {
            return Err(DenseError::Config(format!("local space: {config:?}")));
        }
        // Casts of floats saturate.
        let farthest = ((config.depth.farthest_m - 0.01) / metres_per_unit) as u16;
        Ok(Self {
            config,
            farthest: farthest.min(u16::MAX - 1),
            near: DepthImage::new(camera.width, camera.height),
            preparer: DepthPreparer::new(config.depth, camera, metres_per_unit)?,
            grid: OccupancyGrid::new(config.occupancy)?,
            level_from_here: So3::identity(),
            floor: Floor::default(),
            camera: Vec3::zeros(),
            most: BTreeMap::new(),
        })
    }

    /// The configuration.
    pub fn config(&self) -> &LocalConfig {
        &self.config
    }

    /// Forgets everything: the frame of the poses has changed.
    pub fn clear(&mut self) {
        if let Ok(grid) = OccupancyGrid::new(self.config.occupancy) {
            self.grid = grid;
        }
        self.floor = Floor::default();
        self.most.clear();
    }

    /// Adds a depth image. `level_from_here` turns the frame of the poses upright (z up); it may change slowly.
    ///
    /// # Errors
    /// A pose that is not finite, an image of another size, too little depth in it. Nothing is added then.
    pub fn observe(
        &mut self,
        depth: &DepthImage,
        here_from_camera: &Se3,
        level_from_here: &So3,
    ) -> Result<(), DenseError> {
        // What lies beyond the range proves that the space up to there is free; the surface that this makes at the range is
        // out of reach, and is seen through when it comes nearer.
        let limit = self.farthest;
        self.near.resize(depth.width(), depth.height());
        for (out, &v) in self.near.data_mut().iter_mut().zip(depth.data()) {
            *out = if v == u16::MAX { v } else { v.min(limit) };
        }
        let frame = self.preparer.prepare(&self.near)?;
        self.grid.integrate(frame, here_from_camera)?;
        self.level_from_here = *level_from_here;
        let level_from_camera = Se3::new(*level_from_here, Vec3::zeros()) * *here_from_camera;
        self.camera = level_from_camera.translation;
        self.floor.update(frame, &level_from_camera);
        self.grid.forget_beyond(&here_from_camera.translation, self.config.keep_m);
        self.forget_gone();
        Ok(())
    }

    /// Forgets the rest of what was seen to have gone: of a barrier that is taken away only the upper part is in view from
    /// near by, of a lamp only the lower.
    fn forget_gone(&mut self) {
        let (reach, voxel) = (self.config.reach_m, self.config.occupancy.voxel_m);
        let Some(ground) = self.floor.height(&self.camera.xy()) else { return };
        let centre = self.level_from_here.inverse() * self.camera;
        let half = Vec3::repeat(reach + 0.5);
        let mut cells: BTreeMap<[i32; 2], Vec<[i32; 3]>> = BTreeMap::new();
        self.grid.occupied_within(&(centre - half), &(centre + half), self.config.confirmed, |p| {
            let level = self.level_from_here * p;
            let near = (level - self.camera).xy().norm() < reach;
            if near && level.z - ground > self.config.clear_m {
                let cell = [level.x, level.y].map(|v| (v / voxel).floor() as i32);
                cells.entry(cell).or_default().push([p.x, p.y, p.z].map(|v| (v / voxel).floor() as i32));
            }
        });
        for (cell, voxels) in &cells {
            let most = self.most.entry(*cell).or_default();
            let gone = most.saturating_sub(voxels.len() as u32);
            if gone >= GONE_VOXELS && gone * GONE_SHARE >= *most {
                voxels.iter().for_each(|v| self.grid.forget(*v));
                *most = 0;
            } else {
                *most = (*most).max(voxels.len() as u32);
            }
        }
        self.most.retain(|cell, _| cells.contains_key(cell));
    }

    /// Height of the ground at a place of the level frame, in metres; `None` until it was seen.
    pub fn ground_m(&self, at: &Vec2) -> Option<f64> {
        self.floor.height(at)
    }

    /// Cells with an obstacle around the last camera, in a fixed order. Until the ground was seen: around the camera's own
    /// height, from 0.8 m below it.
    pub fn obstacles(&self) -> Vec<Blocked> {
        let (reach, cell) = (self.config.reach_m, self.config.occupancy.voxel_m);
        let side = (2.0 * reach / cell).ceil() as usize + 1;
        let mut cells = vec![(0u32, f32::INFINITY); side * side];
        let centre = self.level_from_here.inverse() * self.camera;
        let half = Vec3::repeat(reach + 0.5);
        let middle = self.camera.xy();
        self.grid.occupied_within(&(centre - half), &(centre + half), self.config.confirmed, |p| {
            let p = self.level_from_here * p;
            let above = match self.floor.height(&p.xy()) {
                Some(ground) => p.z - ground,
                None => p.z - self.camera.z + self.config.clear_m + 0.8,
            };
            let d = (p.xy() - middle).add_scalar(reach) / cell;
            if above < self.config.clear_m || above > self.config.head_m || d.x < 0.0 || d.y < 0.0 {
                return;
            }
            if let Some(c) =
                cells.get_mut(d.y as usize * side + d.x as usize).filter(|_| (d.x as usize) < side)
            {
                *c = (c.0 + 1, c.1.min(above as f32));
            }
        });
        let place = |i: usize| {
            middle + Vec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5) * cell - Vec2::repeat(reach)
        };
        let found = cells.iter().enumerate().filter(|(_, c)| c.0 > 0);
        found.map(|(i, &(voxels, low))| Blocked { at: place(i), low_m: f64::from(low), voxels }).collect()
    }

    /// Metres along a line (corners in the level frame) at which the ground drops, within `length_m` and half a strip's
    /// width: space is free below the ground there, close behind ground that was seen. `None` where no drop was seen; ground
    /// that was not seen is none.
    pub fn drop_along(&self, line: &[Vec2], half_m: f64, length_m: f64) -> Option<f64> {
        let here_from_level = self.level_from_here.inverse();
        let voxel = self.config.occupancy.voxel_m;
        let free = |p: &Vec3| {
            let v = (here_from_level * *p).map(|v| (v / voxel).floor());
            v.iter().all(|v| v.abs() < 1e9) && self.grid.odds([v.x as i32, v.y as i32, v.z as i32]) < 0
        };
        let drops = |at: &Vec2| {
            let Some(ground) = self.floor.height(at) else { return false };
            let below = |down: f64| free(&Vec3::new(at.x, at.y, ground - down));
            below(self.config.drop_m) && below(self.config.drop_m + voxel)
        };
        let seen = |at: &Vec2| {
            let ground = self.floor.height(at).unwrap_or(f64::NAN);
            [-0.1, -0.05, 0.0, 0.05, 0.1].iter().any(|up| {
                let v = (here_from_level * Vec3::new(at.x, at.y, ground + up)).map(|v| (v / voxel).floor());
                v.iter().all(|v| v.abs() < 1e9) && self.grid.odds([v.x as i32, v.y as i32, v.z as i32]) > 0
            })
        };
        // The edge hides what lies below it: the ground ends where it was last seen.
        let (mut run, mut edge) = (0, None);
        for (along, at, left) in along_line(line, 0.1, length_m) {
            let across = [-half_m, -0.5 * half_m, 0.0, 0.5 * half_m, half_m];
            let count = across.iter().filter(|a| drops(&(at + left * **a))).count();
            run = if count >= 2 { run + 1 } else { 0 };
            if seen(&at) {
                edge = Some(along);
            }
            // A stray ray frees a line of voxels, not an area.
            if let Some(edge) = edge.filter(|edge| run >= 3 && along - edge <= EDGE_M) {
                return Some(edge);
            }
        }
        None
    }
}

/// Points each `step_m` along a line with the unit vector to their left, and how far along they lie.
fn along_line(line: &[Vec2], step_m: f64, length_m: f64) -> impl Iterator<Item = (f64, Vec2, Vec2)> + '_ {
    let mut begin = 0.0;
    line.windows(2)
        .flat_map(move |leg| {
            let d = leg[1] - leg[0];
            let (length, from) = (d.norm(), begin);
            begin += length;
            let n = (length / step_m).floor() as usize;
            let unit = d / length.max(1e-9);
            (0..=n).map(move |i| {
                (from + i as f64 * step_m, leg[0] + unit * (i as f64 * step_m), Vec2::new(-unit.y, unit.x))
            })
        })
        .take_while(move |(along, ..)| *along <= length_m)
}

/// A drop begins at most so far beyond the ground that was seen last, in metres: over an edge 2.5 m away one looks half a metre
/// beyond it. Farther from it the ground is extrapolated, and may be what is wrong.
const EDGE_M: f64 = 0.8;
/// Depth of a cluster of cells that makes an obstacle, in metres.
const CLUSTER_M: f64 = 0.25;

/// The first obstacle within `half_m` of a line (corners in the level frame, from the walker on), at most `length_m` along
/// it: a cluster of at least `least` voxels.
pub fn first_hit(
    obstacles: &[Blocked],
    line: &[Vec2],
    half_m: f64,
    length_m: f64,
    least: u32,
) -> Option<Hit> {
    let legs = Leg::all(line);
    let mut near: Vec<(f64, &Blocked)> = obstacles
        .iter()
        .filter_map(|b| Some((project(&legs, &b.at, half_m)?, b)))
        .filter(|n| n.0 <= length_m)
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (i, (along_m, _)) in near.iter().enumerate() {
        let cluster = || near[i..].iter().take_while(|n| n.0 <= along_m + CLUSTER_M);
        let voxels: u32 = cluster().map(|n| n.1.voxels).sum();
        if voxels >= least {
            let n = cluster().count() as f64;
            let at = cluster().map(|n| n.1.at).sum::<Vec2>() / n;
            let low_m = cluster().map(|n| n.1.low_m).fold(f64::INFINITY, f64::min);
            return Some(Hit { along_m: *along_m, at, low_m });
        }
    }
    None
}

/// A straight piece of a line, `length` metres long, that begins so far along it; `unit` is zero where it has no length.
struct Leg {
    from: Vec2,
    unit: Vec2,
    length: f64,
    begin: f64,
}

impl Leg {
    /// Those of a line.
    fn all(line: &[Vec2]) -> Vec<Self> {
        let mut begin = 0.0;
        line.windows(2)
            .map(|leg| {
                let d = leg[1] - leg[0];
                let length = d.norm();
                let leg = Self { from: leg[0], unit: d / length.max(1e-9), length, begin };
                begin += length;
                leg
            })
            .collect()
    }
}

/// Metres along a line of the first place within `half_m` of a point; `None` where there is none, or only behind its start.
fn project(legs: &[Leg], p: &Vec2, half_m: f64) -> Option<f64> {
    legs.iter().enumerate().find_map(|(i, leg)| {
        let along = (p - leg.from).dot(&leg.unit);
        let on = along.clamp(0.0, leg.length);
        let is_near = (leg.from + leg.unit * on - p).norm_squared() <= half_m * half_m;
        (is_near && (i > 0 || along > 0.0)).then_some(leg.begin + on)
    })
}
