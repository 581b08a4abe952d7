//! Pending re-fusion: key frames that moved inside their submap are removed and fused again, nearest first.

use super::{DenseMap, Inside, Kept, Submap, mark};
use crate::{DenseError, OccupancyGrid, TsdfConfig};
use cairn_geometry::{Se3, Vec3};
use std::sync::Arc;

/// Distance from the camera at which a rotation is measured as a movement, in metres.
const LEVER_M: f64 = 2.0;

/// Statistics of a slice of work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Images fused into or removed from a volume.
    pub images: usize,
    /// Key frames and grids being rebuilt that are still pending.
    pub waiting: usize,
    /// Key frames dropped because their pose or depth can no longer be fused.
    pub given_up: usize,
}

impl DenseMap {
    /// Finds the frames whose pose inside their submap differs from the one they were fused with.
    pub(super) fn find_moved(&mut self) {
        self.waiting.clear();
        for i in 0..self.kept.len() {
            let kept = &self.kept[i];
            let stays = kept.inside(kept.target).is_some_and(|fused| {
                self.wanted(kept).is_none_or(|pose| moved_m(fused, &pose) <= self.config.moved_m)
            });
            if !stays {
                self.waiting.push(i);
            }
        }
    }

    /// The pose of a frame in its destination submap.
    fn wanted(&self, kept: &Kept) -> Option<Se3> {
        let (_, world_from_submap) = self.place(kept.target)?;
        let anchor = self.anchors.get(&kept.anchored.anchor)?;
        Some(world_from_submap.inverse() * (anchor.world_from_anchor * kept.anchored.pose))
    }

    /// Whether every image is fused, where it was or where it is now, and every submap has its field and its free space: false for a
    /// while after a saved map was taken over, or all fields were asked for.
    pub fn is_complete(&self) -> bool {
        let is_built = |s: &Submap| s.field.whole().is_some() && (!s.stale || s.occupancy.bytes() > 0);
        self.waiting.iter().all(|&i| self.kept[i].inside.is_some())
            && self.submaps.iter().flatten().all(is_built)
    }

    /// Does part of the pending work, at most about `images` fusions, starting nearest to a place (for example the
    /// walker's). One fusion is the cost of one image.
    pub fn step(&mut self, near: &Vec3, images: usize) -> Progress {
        let mut progress = Progress::default();
        let away = |i: usize| {
            let at = self.anchors.get(&self.kept[i].anchored.anchor);
            let at = at.map(|a| (a.world_from_anchor * self.kept[i].anchored.pose).translation);
            at.map_or(f64::INFINITY, |p| (p - near).norm())
        };
        let mut waiting: Vec<(f64, usize)> = self.waiting.iter().map(|&i| (away(i), i)).collect();
        // The nearest is last, where it is popped from.
        waiting.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        while progress.images < images {
            let Some((_, index)) = waiting.pop() else { break };
            match self.fuse_again(index) {
                Ok(done) => progress.images += done,
                Err(_) => progress.given_up += 1,
            }
        }
        self.waiting = waiting.into_iter().map(|(_, i)| i).collect();
        if self.waiting.is_empty() {
            self.drop_empty();
            while progress.images < images && (self.fuse_one() || self.rebuild_one()) {
                progress.images += 1;
            }
        }
        self.release_fields();
        let is_waiting = |s: &&Submap| s.stale || self.is_wanted(s);
        progress.waiting = self.waiting.len() + self.submaps.iter().flatten().filter(is_waiting).count();
        progress
    }

    /// Removes a frame from its old place, if it has one, and fuses it at its new one; returns how many images that took.
    fn fuse_again(&mut self, index: usize) -> Result<usize, DenseError> {
        let kept = &self.kept[index];
        let (was, to) = (kept.inside, kept.target);
        let pose = self.wanted(kept).ok_or(DenseError::UnknownAnchor(kept.anchored.anchor.0))?;
        let frame = self.preparer.prepare_packed(&kept.depth)?;
        mark(&mut self.around, &self.config.tsdf, frame, &pose)?;
        let unknown = DenseError::UnknownAnchor(self.kept[index].anchored.anchor.0);
        let submap = self.submaps.get_mut(to).and_then(Option::as_mut).ok_or(unknown)?;
        // Fuses first: if that fails, nothing has changed. The sums do not depend on the order.
        submap.field.add(index, frame, &pose, &self.around.1)?;
        (submap.stale, submap.rebuilt) = (true, None);
        self.kept[index].inside = Some(Inside { submap: to, pose });
        let Some(was) = was else { return Ok(1) };
        if let Some(submap) = self.submaps.get_mut(was.submap).and_then(Option::as_mut) {
            submap.field.remove(index, frame, &was.pose)?;
            (submap.stale, submap.rebuilt) = (true, None);
        }
        Ok(2)
    }

    /// Removes submaps whose frames have all moved to another.
    fn drop_empty(&mut self) {
        for index in 0..self.submaps.len() {
            if self.submaps[index].is_some()
                && self.kept.iter().all(|k| k.inside(index).is_none() && k.target != index)
            {
                self.submaps[index] = None;
                self.active.retain(|_, active| *active != index);
            }
        }
    }

    /// Whether all fields are wanted from now on, for who is to look into all of them: then released ones are fused again by
    /// [`Self::step`], and none is released.
    pub fn want_all(&mut self, all: bool) {
        self.are_all_wanted = all;
    }

    /// Whether the field of a submap is released and has to come back: all are wanted, or it is the one in use.
    fn is_wanted(&self, submap: &Submap) -> bool {
        submap.field.whole().is_none() && (self.are_all_wanted || submap.used == self.added)
    }

    /// Fuses one more frame into a field that is wanted again; false when there is no such field.
    fn fuse_one(&mut self) -> bool {
        let is_wanted = |s: &Option<Submap>| s.as_ref().is_some_and(|s| self.is_wanted(s));
        let Some(index) = self.submaps.iter().position(is_wanted) else { return false };
        let config = self.fields();
        let Some(submap) = self.submaps[index].as_mut() else { return false };
        let (kept, preparer) = (&self.kept, &mut self.preparer);
        let done = submap.field.fuse_next(config, |from| {
            let (i, pose) = (from..kept.len()).find_map(|i| Some((i, *kept[i].inside(index)?)))?;
            Some((preparer.prepare_packed(&kept[i].depth), pose, i))
        });
        done.is_ok()
    }

    /// Releases the fields that nothing was added to for longest, as far as all take more than they may; that of the submap in use
    /// stays.
    pub(super) fn release_fields(&mut self) {
        let added = self.added;
        while !self.are_all_wanted {
            let whole = || self.submaps.iter().flatten().filter(|s| s.field.whole().is_some());
            if whole().map(|s| s.field.bytes()).sum::<usize>() <= self.config.most_bytes {
                return;
            }
            let whole = self.submaps.iter_mut().flatten().filter(|s| s.field.whole().is_some());
            let Some(oldest) = whole.filter(|s| s.used != added).min_by_key(|s| s.used) else { return };
            oldest.field.release();
        }
    }

    /// How the fields of submaps are made: nobody reads colours there.
    pub(super) fn fields(&self) -> TsdfConfig {
        TsdfConfig { colour: false, ..self.config.tsdf }
    }

    /// Fuses one more frame into the new grid of a submap with stale occupancy; false when there is no such submap.
    fn rebuild_one(&mut self) -> bool {
        let Some(index) = self.submaps.iter().position(|s| s.as_ref().is_some_and(|s| s.stale)) else {
            return false;
        };
        let config = self.config.occupancy;
        let Some(submap) = self.submaps[index].as_mut() else { return false };
        let (mut grid, from) = match submap.rebuilt.take() {
            Some(partial) => partial,
            None => match OccupancyGrid::new(config) {
                Ok(grid) => (grid, 0),
                Err(_) => return false,
            },
        };
        let next = (from..self.kept.len()).find_map(|i| Some((i, *self.kept[i].inside(index)?)));
        let Some((next, pose)) = next else {
            // All frames are fused: the new grid replaces the old one.
            (submap.occupancy, submap.stale) = (Arc::new(grid), false);
            return true;
        };
        if let Ok(frame) = self.preparer.prepare_packed_for_occupancy(&self.kept[next].depth) {
            // A pose that the field accepted is also accepted by the grid.
            let _ = grid.integrate(frame, &pose);
        }
        submap.rebuilt = Some((grid, next + 1));
        true
    }
}

/// How far a point [`LEVER_M`] in front of the camera moves from one pose to another, at most.
fn moved_m(from: &Se3, to: &Se3) -> f64 {
    let between = from.inverse() * *to;
    between.translation.norm() + LEVER_M * between.rotation.log().norm()
}
