//! What has changed of the columns above the ground: for whoever shows them while they grow.

use super::{DenseMap, MapId};
use crate::walk::{ColumnAxes, ColumnTile};
use crate::{DenseError, Occupancy, OccupancyGrid};
use cairn_geometry::{Se3, Vec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A pose is another one when a point ten metres away moves by this, metres.
const MOVED_M: f64 = 0.01;
const LEVER_M: f64 = 10.0;

/// The columns of all submaps, as far as they differ from what was told before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColumnChange {
    /// How they stand, at first and where that is another than before: all that was told is gone then.
    pub axes: Option<ColumnAxes>,
    /// Tiles of which nothing is known any more.
    pub gone: Vec<[i32; 2]>,
    /// Tiles that are new or have changed.
    pub tiles: Vec<ColumnTile>,
}

/// A submap as it was when its tiles were last asked for.
struct Seen {
    revision: u64,
    pose: Se3,
    tiles: BTreeSet<[i32; 2]>,
}

/// Looks again at the tiles above submaps that have changed or moved.
#[derive(Default)]
pub struct ColumnChanges {
    axes: Option<ColumnAxes>,
    seen: BTreeMap<usize, Seen>,
    dirty: BTreeSet<[i32; 2]>,
    told: BTreeMap<[i32; 2], ColumnTile>,
}

impl ColumnChanges {
    /// Nothing is known yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// What has changed in this map, which is the same in every call, with the direction up in it; of all its submaps, or of those of one map of
    /// the atlas. At most `most` tiles are looked at, those
    /// nearest to `near` first; the others are left to the next call.
    ///
    /// # Errors
    /// A map so high that it would take too long.
    pub fn of(
        &mut self,
        map: &DenseMap,
        only: Option<MapId>,
        up: &Vec3,
        near: &Vec3,
        most: usize,
    ) -> Result<ColumnChange, DenseError> {
        let axes = ColumnAxes::new(up, map.config.occupancy.voxel_m);
        let is_new = self.axes != Some(axes);
        if is_new {
            *self = Self { axes: Some(axes), ..Self::default() };
        }
        let submaps: Vec<(usize, Se3, &Arc<OccupancyGrid>, u64)> = (0..map.submaps.len())
            .filter_map(|i| {
                // One whose free space is of other poses than its surface is looked at when it has been built anew.
                let submap = map.submaps[i].as_ref().filter(|s| !s.stale)?;
                let (_, pose) = map.place(i).filter(|(of, _)| only.is_none_or(|only| only == *of))?;
                Some((i, pose, &submap.occupancy, submap.field.revision()))
            })
            .collect();
        let mut heights: Option<[i32; 2]> = None;
        for (number, pose, occupancy, revision) in &submaps {
            let Some(corners) = occupancy.extent() else { continue };
            let Some((ends, steps)) = axes.around(corners.iter().map(|p| *pose * *p)) else { continue };
            heights = Some(heights.map_or(steps, |h| [h[0].min(steps[0]), h[1].max(steps[1])]));
            let stays = |s: &Seen| s.revision == *revision && moved_m(&s.pose, pose) < MOVED_M;
            if self.seen.get(number).is_some_and(stays) {
                continue;
            }
            let [low, high] = ends;
            let tiles = (low[1]..=high[1]).flat_map(|y| (low[0]..=high[0]).map(move |x| [x, y]));
            let tiles: BTreeSet<[i32; 2]> = tiles.collect();
            self.dirty.extend(&tiles);
            let now = Seen { revision: *revision, pose: *pose, tiles };
            if let Some(before) = self.seen.insert(*number, now) {
                self.dirty.extend(before.tiles);
            }
        }
        let is_gone = |number: &usize| map.submaps.get(*number).is_none_or(Option::is_none);
        let gone: Vec<usize> = self.seen.keys().copied().filter(is_gone).collect();
        for number in gone {
            self.dirty.extend(self.seen.remove(&number).into_iter().flat_map(|seen| seen.tiles));
        }
        let steps = heights.unwrap_or_default();
        let grids: Vec<_> = submaps.iter().map(|(_, pose, grid, _)| (pose.inverse(), grid)).collect();
        let at = |p: &Vec3| {
            let odds = grids.iter().map(|(submap_from_world, grid)| grid.odds_at(&(*submap_from_world * *p)));
            match odds.map(i32::from).sum::<i32>() {
                0 => Occupancy::Unknown,
                sum if sum < 0 => Occupancy::Free,
                _ => Occupancy::Occupied,
            }
        };
        let mut change = ColumnChange { axes: is_new.then_some(axes), ..ColumnChange::default() };
        for tile in self.nearest(&axes, near, most) {
            self.dirty.remove(&tile);
            match if steps[1] > steps[0] { axes.tile(tile, steps, at)? } else { None } {
                Some(new) if self.told.get(&tile) == Some(&new) => {}
                Some(new) => {
                    self.told.insert(tile, new.clone());
                    change.tiles.push(new);
                }
                None => change.gone.extend(self.told.remove(&tile).map(|_| tile)),
            }
        }
        Ok(change)
    }

    /// Tiles that are to be looked at, the nearest first.
    fn nearest(&self, axes: &ColumnAxes, near: &Vec3, most: usize) -> Vec<[i32; 2]> {
        let tile_m = f64::from(crate::walk::TILE) * axes.cell_m;
        let here = [axes.axes[0].dot(near), axes.axes[1].dot(near)];
        let away = |at: &[i32; 2]| {
            (0..2).map(|k| ((f64::from(at[k]) + 0.5) * tile_m - here[k]).powi(2)).sum::<f64>()
        };
        let mut all: Vec<[i32; 2]> = self.dirty.iter().copied().collect();
        all.sort_by(|a, b| away(a).total_cmp(&away(b)));
        all.truncate(most);
        all
    }
}

fn moved_m(from: &Se3, to: &Se3) -> f64 {
    let between = from.inverse() * *to;
    between.translation.norm() + LEVER_M * between.rotation.log().norm()
}
