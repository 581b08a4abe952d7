//! An occupancy grid anchored to keyframes: scans and walked steps are stored in the frame of their keyframe, and the
//! grid is rebuilt when keyframes move (after a loop closure or a map merge) or are removed.
//!
//! Log odds that were clamped cannot be subtracted again, so the grid is rebuilt from all scans, in the order they
//! came: the result is that of a grid for which the poses were known from the beginning. The grid grows with what is
//! seen.

use crate::grid::{GridError, GridFrame};
use crate::occupancy::{OccupancyConfig, OccupancyGrid, ScanRejected, ScanReport};
use cairn_geometry::{Se2, Vec2};
use std::collections::{BTreeMap, BTreeSet};

/// The grid grows by this many cells at a time.
const BLOCK: f64 = 64.0;

/// What an update of the poses changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoseUpdate {
    /// Keyframes whose motion shifts any point within range by more than half a cell.
    pub moved: usize,
    /// Keyframes that were removed; their scans are dropped.
    pub gone: usize,
    /// Scans inserted again; 0 when nothing moved.
    pub scans: usize,
}

/// Why a scan or step was not inserted.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InsertError {
    /// A pose is not finite.
    #[error(transparent)]
    Rejected(#[from] ScanRejected),
    /// The grid would become too large.
    #[error(transparent)]
    Grid(#[from] GridError),
}

#[derive(Clone, Debug)]
enum Item {
    /// What a scan saw; or of it only what had newly come and may go again.
    Scan {
        key_from_sensor: Se2,
        rays: Vec<[f32; 2]>,
        is_new: bool,
    },
    Step {
        key_from_body: Se2,
        radius_m: f64,
    },
}

/// Scans and steps anchored to keyframes with identifiers of type `K`, and the grid built from them.
#[derive(Clone, Debug)]
pub struct AnchoredGrid<K> {
    config: OccupancyConfig,
    resolution_m: f64,
    items: Vec<(K, Item)>,
    /// Poses of the keyframes when the grid was last built, or of new ones when first inserted: `world_from_key`.
    keys: BTreeMap<K, Se2>,
    /// Keyframes at which something was inserted with another pose since: the grid shows them in two places.
    torn: BTreeSet<K>,
    grid: Option<OccupancyGrid>,
    last_step: Option<Vec2>,
}

impl<K: Copy + Ord> AnchoredGrid<K> {
    /// An empty grid with cells of this size.
    pub fn new(resolution_m: f64, config: OccupancyConfig) -> Self {
        let (items, keys, torn) = (Vec::new(), BTreeMap::new(), BTreeSet::new());
        Self { config, resolution_m, items, keys, torn, grid: None, last_step: None }
    }

    /// The grid; `None` before the first scan or step.
    pub fn grid(&self) -> Option<&OccupancyGrid> {
        self.grid.as_ref()
    }

    /// Inserts a scan (bearings in radians, ranges in metres) taken at `key_from_sensor`, relative to a keyframe at
    /// `world_from_key`.
    ///
    /// # Errors
    /// When a pose is not finite, or the grid would become too large; the scan is not stored then.
    pub fn insert_scan(
        &mut self,
        key: K,
        world_from_key: &Se2,
        key_from_sensor: Se2,
        rays: &[(f64, f64)],
    ) -> Result<ScanReport, InsertError> {
        self.insert_rays(key, world_from_key, key_from_sensor, rays, false)
    }

    /// As [`AnchoredGrid::insert_scan`], for rays that end on things that have newly come and may go again
    /// ([`AnchoredGrid::forget_new`]).
    ///
    /// # Errors
    /// As [`AnchoredGrid::insert_scan`].
    pub fn insert_new(
        &mut self,
        key: K,
        world_from_key: &Se2,
        key_from_sensor: Se2,
        rays: &[(f64, f64)],
    ) -> Result<ScanReport, InsertError> {
        self.insert_rays(key, world_from_key, key_from_sensor, rays, true)
    }

    fn insert_rays(
        &mut self,
        key: K,
        world_from_key: &Se2,
        key_from_sensor: Se2,
        rays: &[(f64, f64)],
        is_new: bool,
    ) -> Result<ScanReport, InsertError> {
        let rays = rays.iter().map(|&(bearing, range)| [bearing as f32, range as f32]).collect();
        let item = Item::Scan { key_from_sensor, rays, is_new };
        self.insert(key, world_from_key, item)
    }

    fn insert(&mut self, key: K, world_from_key: &Se2, item: Item) -> Result<ScanReport, InsertError> {
        let report = self.lay(&item, world_from_key)?;
        if self.keys.get(&key).is_some_and(|known| self.is_moved(known, world_from_key)) {
            self.torn.insert(key);
        }
        self.keys.entry(key).or_insert(*world_from_key);
        self.items.push((key, item));
        Ok(report)
    }

    /// Rebuilds the grid without what was inserted as new ([`AnchoredGrid::insert_new`]); returns how many such scans there
    /// were.
    ///
    /// # Errors
    /// When the grid cannot be rebuilt: it stays as it was.
    pub fn forget_new(&mut self) -> Result<usize, InsertError> {
        let is_new = |item: &Item| matches!(item, Item::Scan { is_new: true, .. });
        let count = self.items.iter().filter(|(_, item)| is_new(item)).count();
        if count > 0 {
            self.rebuild(self.keys.clone(), |item| !is_new(item))?;
        }
        Ok(count)
    }

    /// Rebuilds the grid from the items that are kept, with these poses; returns how many scans that were.
    fn rebuild(&mut self, now: BTreeMap<K, Se2>, keep: impl Fn(&Item) -> bool) -> Result<usize, InsertError> {
        let mut anew = Self::new(self.resolution_m, self.config);
        let mut scans = 0;
        for (key, item) in self.items.iter().filter(|(_, item)| keep(item)) {
            if let Some(pose) = now.get(key) {
                anew.lay(item, pose)?;
                scans += usize::from(matches!(item, Item::Scan { .. }));
            }
        }
        anew.items = std::mem::take(&mut self.items);
        anew.items.retain(|(key, item)| keep(item) && now.contains_key(key));
        anew.keys = now;
        *self = anew;
        Ok(scans)
    }

    /// Records that a body of this radius stood at `key_from_body`. Between two steps less than a metre apart it
    /// walked.
    ///
    /// # Errors
    /// When a pose is not finite, or the grid would become too large; the step is not stored then.
    pub fn insert_step(
        &mut self,
        key: K,
        world_from_key: &Se2,
        key_from_body: Se2,
        radius_m: f64,
    ) -> Result<(), InsertError> {
        self.insert(key, world_from_key, Item::Step { key_from_body, radius_m }).map(drop)
    }

    /// Takes the current poses of all keyframes, `None` for removed ones, and rebuilds the grid if that changes it.
    ///
    /// # Errors
    /// When a pose is not finite, or the grid would become too large: the grid stays as it was.
    pub fn set_poses(
        &mut self,
        world_from_key: impl Fn(K) -> Option<Se2>,
    ) -> Result<PoseUpdate, InsertError> {
        let now: BTreeMap<K, Se2> =
            self.keys.keys().filter_map(|&k| world_from_key(k).map(|pose| (k, pose))).collect();
        let gone = self.keys.len() - now.len();
        let moved = now.iter().filter(|(k, pose)| {
            self.torn.contains(k) || self.keys.get(k).is_some_and(|old| self.is_moved(old, pose))
        });
        let moved = moved.count();
        if gone + moved == 0 {
            return Ok(PoseUpdate::default());
        }
        let scans = self.rebuild(now, |_| true)?;
        Ok(PoseUpdate { moved, gone, scans })
    }

    fn is_moved(&self, old: &Se2, new: &Se2) -> bool {
        let by = old.inverse() * *new;
        let reach = by.translation.norm() + by.rotation.log().abs() * self.config.max_range_m;
        // NaN counts as moved: the rebuild then reports the error.
        reach.is_nan() || reach > 0.5 * self.resolution_m
    }

    fn lay(&mut self, item: &Item, world_from_key: &Se2) -> Result<ScanReport, InsertError> {
        match item {
            Item::Scan { key_from_sensor, rays, .. } => {
                let pose = *world_from_key * *key_from_sensor;
                let longest =
                    rays.iter().map(|r| f64::from(r[1])).filter(|r| r.is_finite()).fold(0.0, f64::max);
                let grid = self.grid_around(pose.translation, longest.min(self.config.max_range_m))?;
                Ok(grid.insert_scan(&pose, rays.iter().map(|r| (f64::from(r[0]), f64::from(r[1]))))?)
            }
            Item::Step { key_from_body, radius_m } => {
                let at = (*world_from_key * *key_from_body).translation;
                let from = self.last_step.filter(|last| (at - last).norm() < 1.0).unwrap_or(at);
                self.grid_around(at, *radius_m)?.mark_walked(&[from, at], *radius_m);
                self.last_step = Some(at);
                Ok(ScanReport::default())
            }
        }
    }

    /// The grid, grown so that it contains everything within `reach_m` of a point.
    fn grid_around(&mut self, at: Vec2, reach_m: f64) -> Result<&mut OccupancyGrid, InsertError> {
        if !(at.x.is_finite() && at.y.is_finite() && reach_m.is_finite()) {
            return Err(ScanRejected::Pose.into());
        }
        let block_m = BLOCK * self.resolution_m;
        let low = |v: f64| (v / block_m).floor();
        let (mut from, mut to) =
            (at.add_scalar(-reach_m).map(low), at.add_scalar(reach_m).map(|v| low(v) + 1.0));
        if let Some(grid) = &self.grid {
            let frame = grid.frame();
            let corner = (frame.world_from_grid().translation / block_m).map(f64::round);
            let size = Vec2::new(frame.width() as f64, frame.height() as f64) / BLOCK;
            (from, to) = (from.inf(&corner), to.sup(&(corner + size)));
            if from == corner && to == corner + size {
                return self.grid.as_mut().ok_or(InsertError::Rejected(ScanRejected::Outside));
            }
        }
        let [width, height] = [(to.x - from.x) * BLOCK, (to.y - from.y) * BLOCK].map(|n| n as usize);
        let corner = Se2::from_xy_angle(from.x * block_m, from.y * block_m, 0.0);
        let frame = GridFrame::new(width, height, self.resolution_m, corner)?;
        let grown = match self.grid.take() {
            Some(grid) => grid.grown(frame),
            None => OccupancyGrid::new(frame, self.config),
        };
        Ok(self.grid.insert(grown))
    }
}
